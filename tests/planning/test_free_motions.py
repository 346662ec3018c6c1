"""Protocols led around obstacles: which phases change, what they keep, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.api.scene_obstacles import obstacles_in_base
from twin.core.errors import ProtocolError, TwinError
from twin.planning.protocol import Auxiliary, Free, Home, Insertion, Joints, Positioning, Samples, Waypoint
from twin.planning.protocol.free_motions import with_free_motions


@pytest.mark.parametrize("name", ["sils", "pa10", "davinci_psm"])
def test_only_motions_outside_the_patient_change_and_keep_their_waypoints(name):
    protocol = twin.load(name).protocol(None)
    changed = with_free_motions(protocol, "vsrs", 0.002, 3)
    for before, after in zip(protocol.phases, changed.phases, strict=True):
        if isinstance(before, (Joints, Positioning, Home)):
            assert isinstance(after, Free)
            assert (after.name, after.to, after.clearance, after.seed, after.scene) == (
                *(before.name, before.to, 0.002, 3, "vsrs"),
            )
            assert changed.limits["free"].tip_speed <= protocol.limits[before.type].tip_speed
        else:
            assert after == before
    assert "go around obstacles" in changed.findings[-1].message


def test_one_phase_is_told_in_the_singular():
    protocol = twin.load("sils").protocol(None)
    (first,) = [phase for phase in protocol.phases if isinstance(phase, (Joints, Positioning, Home))][:1]
    changed = with_free_motions(replace(protocol, phases=(first,)))
    assert changed.findings[-1].message == f"1 phase goes around obstacles: {first.name}"


@pytest.mark.parametrize(
    ("clearance", "seed", "words"),
    [
        (0.0, 0, "is 0 m; give a finite number above 0"),
        (float("nan"), 0, "is nan m"),
        (0.005, -1, "is -1; give at least 0"),
    ],
)
def test_impossible_numbers_are_refused(clearance, seed, words):
    with pytest.raises(ProtocolError, match=words):
        with_free_motions(twin.load("sils").protocol(None), "", clearance, seed)


@pytest.mark.parametrize("name", ["psm1", "davinci_psm"])
def test_the_other_arms_of_a_scene_are_obstacles(name):
    """A robot is found by its name in the scene or by its kind; the other arms have names of their own there."""
    bodies = {still.name for still in obstacles_in_base("davinci", name, twin.load)}
    assert {"psm2/base", "ecm/base"} <= bodies
    assert not any(b.startswith("psm1/") for b in bodies)


def test_a_robot_that_is_not_in_the_scene_is_named():
    with pytest.raises(TwinError, match=r"has no robot 'sher'; it has: .*psm1"):
        obstacles_in_base("davinci", "sher", twin.load)


@pytest.mark.parametrize(
    ("approach", "position"),
    [
        (Positioning("approach", "port"), (0.1, 0.2, 0.3)),
        (Free("approach", "port", 0.005), (0.1, 0.2, 0.3)),
        (Joints("approach", "by_joints"), None),
        (Samples("approach", np.zeros(2), np.zeros((2, 1)), ("q",), frozenset()), None),
        (Samples("approach", np.zeros(2), np.zeros((2, 1)), ("q",), frozenset(), "by_joints"), None),
        (Auxiliary("approach", {"jaw": 0.1}, frozenset()), (0.0, 0.0, 0.0)),
    ],
)
def test_the_first_rcm_is_where_the_phase_before_the_insertion_ends(approach, position):
    """Whatever type this phase has: only positionings counted, and the RCM after others was said to be at the start."""

    def waypoint(name: str, place: tuple[float, float, float] | None) -> Waypoint:
        return Waypoint(name, np.zeros(3), None if place is None else np.array(place), None, name, "ASSUMED", "")

    places = {"start": (0.0, 0.0, 0.0), "port": (0.1, 0.2, 0.3), "by_joints": None}
    protocol = replace(
        twin.load("sils").protocol(None),
        start="start",
        waypoints={name: waypoint(name, place) for name, place in places.items()},
        phases=(approach, Insertion("insertion", 0.05)),
        trocars={},
        rcm=None,
    )
    found = protocol.first_rcm
    assert (None if found is None else tuple(found)) == position
