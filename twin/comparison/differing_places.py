"""Robots with loops whose links differ: which joint has another place on which link.

If the links of both sides do not agree (`link_motions`), the fewest places of joints are searched without which all
other places agree. A joint can have another place on its parent, on its child, or, as where a file states one point for
both, on both.

The search of deviating joints in `search` follows a tree, in which a joint that closes a loop has no child to move;
here all joints are treated alike, and the posture in which a side is drawn does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from twin.comparison.compared_items import ComparedItem, shift_and_turn_text
from twin.comparison.fit_problem import FitProblem
from twin.comparison.link_motions import JointPlace, LinkMotions, PlaceDifference
from twin.core.spatial import Array

_REWEIGHTED_FITS = 12
"""Number of fits that find the places which differ most, each with less weight for places that do not fit."""

_SMALLEST_MISFIT = 1e-2
"""Misfit, in units of the tolerance, below which a place has no more weight."""

_MAX_PAIRED_JOINTS = 8
"""Number of joints of which two are tried together."""

_SMALLEST_SHOWN = 1e-9
"""Shift in m or turn in rad below which a difference is told as none."""


def differing_places(problem: FitProblem) -> list[tuple[PlaceDifference, ...]]:
    """Return the explanations with the fewest places of joints that differ; [] if no two places explain all.

    Each explanation is a tuple of one or two places. Several explanations are as good: of a bar with two joints,
    either has another place. A place that differs by less than the tolerance explains nothing.
    """
    explanations: list[tuple[PlaceDifference, ...]] = []
    for places in _explanations(problem):
        differing = [place for place in places if not _is_within_tolerance(problem, place)]
        if differing:
            explanations.append(places)
    return explanations


def _is_within_tolerance(problem: FitProblem, place: PlaceDifference) -> bool:
    """Return whether a place differs by no more than two lines may that coincide."""
    shift = float(np.linalg.norm(place.shift))
    turn = float(np.linalg.norm(place.turn))
    return shift <= problem.tolerance and turn <= problem.angle_tolerance


def _explanations(problem: FitProblem) -> list[tuple[PlaceDifference, ...]]:
    """Return the explanations by one place; else by one joint on both links; else by two places of two joints."""
    links = LinkMotions(problem)
    motions = links.fitted_to_all()
    on_one_link: list[list[JointPlace]] = []
    for i, kind in enumerate(problem.kinds):
        # a free joint does not tie its links to each other: it has no place
        if kind != "free":
            on_one_link += [[JointPlace(i, "parent")], [JointPlace(i, "child")]]
    by_one_place = _valid_explanations(links, on_one_link, motions)
    if by_one_place:
        return by_one_place
    suspects = _joints_by_misfit(links, motions)
    # a file may state one point for both links, as a `connect` does
    on_both_links = [[JointPlace(i, "both")] for i in suspects]
    by_one_place = _valid_explanations(links, on_both_links, motions)
    if by_one_place:
        return by_one_place
    places: list[JointPlace] = []
    for i in suspects[:_MAX_PAIRED_JOINTS]:
        places += [JointPlace(i, "parent"), JointPlace(i, "child"), JointPlace(i, "both")]
    two_joints: list[list[JointPlace]] = []
    for first_place, second_place in combinations(places, 2):
        # two places of one joint are its place on both links, which was tried
        if first_place.joint != second_place.joint:
            two_joints.append([first_place, second_place])
    return _simplest_explanations(_valid_explanations(links, two_joints, motions))


def _valid_explanations(
    links: LinkMotions, candidates: Sequence[Sequence[JointPlace]], start: Array
) -> list[tuple[PlaceDifference, ...]]:
    """Return the differences of those sets of places without which all other places agree."""
    explanations: list[tuple[PlaceDifference, ...]] = []
    for places in candidates:
        explanation = links.differences_without(places, start)
        if explanation is not None:
            explanations.append(explanation)
    return explanations


def _simplest_explanations(explanations: Sequence[tuple[PlaceDifference, ...]]) -> list[tuple[PlaceDifference, ...]]:
    """Return the explanations with the fewest places on both links: another place on one link is simpler."""
    simplest: list[tuple[PlaceDifference, ...]] = []
    fewest = math.inf
    for explanation in explanations:
        on_both = [place.where for place in explanation].count("both")
        if on_both < fewest:
            simplest = []
            fewest = on_both
        if on_both == fewest:
            simplest.append(explanation)
    return simplest


def _joints_by_misfit(links: LinkMotions, start: Array) -> list[int]:
    """Return the joints, those first that fit least if as many places as possible fit."""
    T = start
    for _ in range(_REWEIGHTED_FITS):
        # iteratively reweighted least squares: the sum of the misfits, not of their squares, becomes smallest
        weights = []
        for i, where in links.places:
            misfit = max(links.misfit(T, i, where), _SMALLEST_MISFIT)
            weights.append(1.0 / np.sqrt(misfit))
        T = links.fitted(links.places, weights, T)
    worst = np.zeros(links.problem.count)
    for i, where in links.places:
        worst[i] = max(worst[i], links.misfit(T, i, where))
    return np.argsort(-worst, kind="stable").tolist()


def place_items(problem: FitProblem, places: Sequence[PlaceDifference]) -> list[ComparedItem]:
    """Return the differences as items."""
    items = []
    for place in places:
        joint = problem.second.axes[place.joint]
        groups = problem.second.groups
        parent = groups[joint.parent].bodies[-1]
        child = groups[joint.child].bodies[-1]
        link = child if place.where == "child" else parent
        on = f"on link '{link}'"
        if place.where == "both":
            on = f"on links '{parent}' and '{child}'"
        shift = place.shift if np.linalg.norm(place.shift) > _SMALLEST_SHOWN else np.zeros(3)
        turn = place.turn if np.linalg.norm(place.turn) > _SMALLEST_SHOWN else np.zeros(3)
        text = f"the place of joint '{joint.name}' {on} differs by {shift_and_turn_text(shift, turn)}"
        length = float(np.linalg.norm(shift))
        items.append(ComparedItem("link", joint.name, text, link, length, float(np.linalg.norm(turn))))
    return items
