"""Prove that equations and mechanism agree at all poses, or find where they do not."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as made
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from twin.core.errors import KinematicsError
from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.model.body import Point
from twin.model.mechanism import Mechanism
from twin.proof import draws, field, formula_side, mechanism, values
from twin.proof import form as forms
from twin.proof.branches import Branches, BranchReport, examined
from twin.proof.claims import JudgedClaim, judged, unclaimed
from twin.proof.constants import exact_angle, exact_number
from twin.proof.drawing import Drawing
from twin.proof.formula_side import Outputs
from twin.proof.mechanism import ExactMechanism
from twin.proof.precise import certainly_not_zero
from twin.proof.program import ProgramStep
from twin.proof.replay import Notes, RootedStates, replay
from twin.proof.transforms import Matrix
from twin.proof.values import Angle, ExactValue, RootMark, Truths, Value

STATES = 4096
"""Number of random states."""

SPREAD_LENGTH = 0.04
"""Distance in m to both sides of a seed within which lengths of a pose are drawn, if there are no forward equations."""

SPREAD_ANGLE = 0.3
"""The same for angles, in rad."""

SPREAD_PARAMETER = 0.05
"""The same for a parameter that is an angle, around its published value."""

_TRIAL_STATES = 256
"""Number of states at which other values of a parameter are tried."""

_ROOTED_FACTORS = (16, 128)
"""Numbers of states, as multiples, among which those with all roots are searched for claims with many roots."""

_ROOTED_STATES = 256
"""Largest number of states with all roots that are kept for a claim."""

_CONDITION_STATES = 2048
"""Number of states at which conditions have their answers, before others are searched."""

_BESIDES = 16
"""How often each state that was found is judged, because roots do not exist in the field at all of them."""

_PRECISE = 64
"""Maximum number of states that were found at which signs of roots are judged with more digits."""

_REASONS = 3
"""Number of numbers without an exact form that a claim names."""

_ANGULAR = ("deg", "rad")
"""Units of parameters that are angles."""

_FORMULA_STATES = 16
"""Number of states at which formulas are computed; they do not depend on it."""

Found = Mapping[str, list[Value]]
"""{output of the equations: its entries}."""


@dataclass(frozen=True)
class Proof:
    """The claims about a robot, with what they rest on.

    Attributes:
        claims: all claims.
        states: number of random states.
        inside: smallest share of the states within reach.
        branches: the conditions in the equations; None if a claim is refuted.
        drawn: parameters for all of whose values the claims are proved.
        fixed: other parameters that are angles: with other values, a claim is wrong, or none was tried.
        inexact: parameters without an exact form.
        largest: largest difference in m or rad between a number of the CAD and its exact form.
        unrecognised: numbers of the CAD without an exact form.
        recognised: {length of the CAD as text: its exact form}, for lengths that are no decimals.
        uncovered: bodies that no claim covers.
        ranges: {random number: (whether it is an angle, low, high)}, in m and rad.
    """

    claims: tuple[JudgedClaim, ...]
    states: int
    inside: float
    branches: BranchReport | None
    drawn: tuple[str, ...]
    fixed: tuple[str, ...]
    inexact: tuple[str, ...]
    largest: float
    unrecognised: tuple[str, ...]
    recognised: Mapping[str, str]
    uncovered: tuple[str, ...]
    ranges: Mapping[str, tuple[bool, float, float]]

    def count(self, status: str) -> int:
        """Return the number of claims with a status."""
        return sum(claim.status == status for claim in self.claims)


RootGroup = tuple[frozenset[int], frozenset[int]]
"""Instructions with roots in the first and in the second function of the equations."""


@dataclass
class _Work:
    """What the steps of a proof share.

    `states` of the `drawn_states` are kept: all, or those where the roots of one of the groups in `rooted` exist.
    """

    formula: Formula
    variants: Mapping[str, str]
    robot: Mechanism
    states: int
    generator: np.random.Generator
    formulas: bool = False
    rooted: Sequence[RootGroup] = ()
    drawn_states: int = 0
    near: Mapping[str, Array] | None = None
    zero_shares: Mapping[str, float] = made(default_factory=dict)
    rootless: bool = False
    roots: list[tuple[int, RootMark, int]] = made(default_factory=list)
    parameters: dict[str, Value] = made(default_factory=dict)
    drawn: list[str] = made(default_factory=list)
    inexact: list[str] = made(default_factory=list)
    notes: Notes = made(default_factory=Notes)
    reach: list[ProgramStep] = made(default_factory=list)
    claims: list[JudgedClaim] = made(default_factory=list)
    uncovered: set[str] = made(default_factory=set)
    ranges: dict[str, tuple[bool, float, float]] = made(default_factory=dict)
    sides: list[Truths] = made(default_factory=list)
    shares: list[float] = made(default_factory=list)


def prove(
    formula: Formula,
    variants: Mapping[str, str],
    robot: Mechanism,
    states: int = STATES,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda label, fraction: None,
) -> Proof:
    """Return the claims about a robot and their verdicts.

    The claims are judged with the published parameters. Then each parameter that is an angle gets other values: if no
    claim is wrong with them, what is proved holds for all of its values. An angle without an exact form, such as 52
    degrees, is possible only in this way.

    Args:
        formula: the equations.
        variants: the chosen variant of each equation.
        robot: the mechanism of the CAD; it is independent of the equations.
        states: number of random states.
        seed: of the random numbers.
        progress: called with a label and the finished fraction.
    """
    primes = list(field.PRIMES)
    works: list[_Work] = []

    def attempt(
        drawn: Collection[str],
        count: int,
        formulas: bool = False,
        rooted: Sequence[RootGroup] = (),
        near: Mapping[str, Array] | None = None,
        zero_shares: Mapping[str, float] = {},
    ) -> Proof:
        while True:
            generator = np.random.default_rng(seed)
            work = _Work(formula, variants, robot, count, generator, formulas, rooted, count, near, zero_shares)
            with field.modulo(primes[0]):
                proof = _attempt(work, drawn)
            works[:] = [work]
            if not work.rootless or len(primes) == 1:
                return proof
            primes.pop(0)

    progress("the published parameters", 0.0)
    exact = all(exact_angle(float(p.value), 1e-12) for p in formula.parameters if p.unit in _ANGULAR)
    # with an angle without an exact form nothing is proved yet: this attempt only refutes
    proof = attempt((), states if exact else min(states, STATES))
    if proof.count("refuted"):
        progress("the errors as formulas", 0.5)
        formulas = {claim.name: claim.error for claim in attempt((), _FORMULA_STATES, formulas=True).claims}
        claims = [replace(claim, error=formulas[claim.name]) for claim in proof.claims]
        return replace(proof, claims=tuple(claims))
    angles = _angles(formula)
    # the parameters without an exact form together, because an angle of the CAD may be a sum of two
    groups = [[name for name in angles if name in proof.inexact]]
    groups += [[name] for name in angles if name not in proof.inexact]
    general: list[str] = []
    for k, group in enumerate(groups):
        progress(f"other values of {', '.join(group)}", (1 + k) / (2 + len(groups)))
        if not group:
            continue
        trial = attempt([*general, *group], _TRIAL_STATES)
        if trial.inside > 0 and not trial.count("refuted"):
            general += group
    if general:
        progress("all of these values", (1 + len(groups)) / (2 + len(groups)))
        proof = _either(proof, attempt(general, states))
    for factor in _ROOTED_FACTORS:
        groups_of_roots = _root_groups(proof, works[0])
        if groups_of_roots:
            progress("states with roots", 0.9)
            proof = _completed(proof, attempt(general, factor * states, rooted=groups_of_roots))
    progress("conditions", 0.95)
    report = _examined(formula, variants, proof, seed)
    proof = _with_found_states(proof, report, attempt)
    progress("the signs of roots", 0.98)
    return _with_branches(_with_signs(proof, report), report)


def _examined(formula: Formula, variants: Mapping[str, str], proof: Proof, seed: int) -> BranchReport:
    """Return what is known of the conditions in the equations."""
    conditions = Branches(formula, variants, proof.drawn)
    ranges = {name: proof.ranges[name] for name in conditions.names}
    state = draws.named(np.random.default_rng([seed, 1]), ranges, _CONDITION_STATES)
    limits = np.array([[low, high] for _, low, high in ranges.values()])
    drawn = np.array([values.real_of(value) for value in state.values()])
    published = drawn.copy()
    parameters = {parameter.name: float(parameter.value) for parameter in formula.parameters}
    for place, name in enumerate(conditions.names):
        if name in proof.drawn:
            published[place] = parameters[name]
    return examined(conditions, drawn, published, limits)


def _with_found_states(proof: Proof, report: BranchReport, attempt: Callable[..., Proof]) -> Proof:
    """Return the proof after its claims were judged at states with rare answers of conditions."""
    near = {name: np.tile(numbers, _BESIDES) for name, numbers in report.states.items()}
    count = len(next(iter(near.values())))
    if not count:
        return proof
    shares = {claim.name: claim.share for claim in proof.claims if claim.status == "proved" and claim.roots}
    return _judged_besides(proof, attempt(proof.drawn, count, near=near, zero_shares=shares))


def _judged_besides(proof: Proof, found: Proof) -> Proof:
    """Return the proof with the claims that are wrong, or not exactly zero, at states that a search found."""
    claims = []
    for claim, other in zip(proof.claims, found.claims, strict=True):
        if other.status == "refuted":
            claims.append(other)
        elif claim.status == "proved" and (other.different or other.undefined):
            claims.append(replace(claim, status="unproved", reason=other.reason, nodes=()))
        else:
            claims.append(claim)
    return replace(proof, claims=tuple(claims))


def _with_signs(proof: Proof, report: BranchReport) -> Proof:
    """Return the proof without the claims that are wrong with the signs of their roots, by however little.

    They are judged where exact values were not zero, and where a search found rare answers of conditions.
    """
    claims = []
    count = len(next(iter(report.states.values())))
    rare = []
    for place in range(0, count, 1 + count // _PRECISE):
        rare.append({name: float(numbers[place]) for name, numbers in report.states.items()})
    for claim in proof.claims:
        wrong = 0.0
        if claim.status == "proved" and claim.roots:
            wrong = certainly_not_zero(claim.nodes, [*claim.doubtful, *rare])
        if wrong:
            reason = (
                f"with the signs of its roots, a value is {wrong:.3g} at a state within reach: a difference below 1e-6"
            )
            claim = replace(claim, status="unproved", reason=reason, nodes=())
        claims.append(claim)
    return replace(proof, claims=tuple(claims))


def _with_branches(proof: Proof, report: BranchReport) -> Proof:
    """Return the proof with the claims that all conditions were judged, and that there is a value within reach."""
    claims = list(proof.claims)
    if report.open:
        reason = (
            f"{len(report.open)} of {report.count} conditions have one answer at all drawn states, and a search found "
            f"no state with the other: {', '.join(report.open[:_REASONS])}"
        )
        if len(report.open) > _REASONS:
            reason += " and others"
        claims.append(unclaimed("conditions", "all answers of the conditions were judged", reason))
    if report.without_value:
        sentence = "the equations have a value at each pose within reach"
        state = ", ".join(f"{name} = {value:.6g}" for name, value in report.without_value.items())
        reason = f"they have neither a value nor a negative margin at {state}: the mechanism may reach it, or may not"
        claims.append(unclaimed("values", sentence, reason))
    return replace(proof, claims=tuple(claims), branches=report)


def _root_groups(proof: Proof, work: _Work) -> list[RootGroup]:
    """Return the roots of each claim that needs more states where they exist; of the last attempt `work`."""
    groups: list[RootGroup] = []
    for claim, other in zip(proof.claims, work.claims, strict=True):
        if not claim.luckless:
            continue
        found: tuple[set[int], set[int]] = set(), set()
        for function, mark, instruction in work.roots:
            if mark in other.roots:
                found[function].add(instruction)
        group = (frozenset(found[0]), frozenset(found[1]))
        if group not in groups:
            groups.append(group)
    return groups


def _completed(proof: Proof, rooted: Proof) -> Proof:
    """Return the proof with the claims that need states where all roots exist."""
    claims = []
    for claim, other in zip(proof.claims, rooted.claims, strict=True):
        better = claim.luckless and (other.status != "unproved" or other.zeros > claim.zeros)
        claims.append(other if better else claim)
    return replace(proof, claims=tuple(claims))


def _either(published: Proof, general: Proof) -> Proof:
    """Return the proof for arbitrary parameters, where a claim is only proved for published ones with that verdict."""
    claims = []
    for claim, other in zip(published.claims, general.claims, strict=True):
        better = other.status == "proved" or (claim.status == "unproved" and other.zeros >= claim.zeros)
        claims.append(other if better and other.status != "refuted" else claim)
    special = [c for c, other in zip(claims, general.claims, strict=True) if c.status == "proved" != other.status]
    if special or not any(claim.status == "proved" for claim in general.claims):
        return replace(published, claims=tuple(claims))
    drawn = general.drawn
    return replace(published, claims=tuple(claims), drawn=drawn, fixed=general.fixed, ranges=general.ranges)


def _angles(formula: Formula) -> list[str]:
    """Return the parameters that are angles."""
    return [parameter.name for parameter in formula.parameters if parameter.unit in _ANGULAR]


def _attempt(work: _Work, drawn: Collection[str]) -> Proof:
    """Return a proof in which some angles among the parameters are drawn."""
    formula = work.formula
    _set_parameters(work, drawn)
    if formula.has("forward"):
        work.ranges |= _joint_ranges(work)
        state = _state(work, _joint_ranges(work))
        exact = _exact_mechanism(work)
        found = _replayed(work, formula_side.from_joints(formula, work.variants), list(state.values()))
        inside = _inside(work, found)
        _claim_mechanism(work, exact, "forward", found, state, inside, state)
        if formula.has("inverse"):
            outputs = formula_side.from_pose(formula, work.variants, coordinates=False)
            again = _replayed(work, outputs, found["pose"])
            _claim_inverse(work, exact, again, inside & _inside(work, again), state)
    else:
        outputs = formula_side.from_pose(formula, work.variants, coordinates=True)
        work.ranges |= _coordinate_ranges(formula)
        state = _state(work, _coordinate_ranges(formula))
        exact = _exact_mechanism(work)
        found = _replayed(work, outputs, list(state.values()))
        _claim_inverse(work, exact, found, _inside(work, found), state)
    return Proof(
        claims=tuple(work.claims),
        states=work.states,
        inside=min(work.shares),
        branches=None,
        drawn=tuple(work.drawn),
        fixed=tuple(name for name in _angles(formula) if name not in work.drawn),
        inexact=tuple(work.inexact),
        largest=exact.drawing.largest,
        unrecognised=tuple(dict.fromkeys(exact.drawing.unrecognised)),
        recognised=dict(exact.drawing.recognised),
        uncovered=tuple(sorted(work.uncovered)),
        ranges=work.ranges,
    )


# ------------------------------------------------------------------------------------------- numbers


def _set_parameters(work: _Work, drawn: Collection[str]) -> None:
    """Set the parameters to their published values, but those of `drawn`, which are angles, to random ones nearby."""
    for parameter in work.formula.parameters:
        name = parameter.name
        value = float(parameter.value)
        if not math.isfinite(value):
            raise KinematicsError(
                f"formula '{work.formula.name}': parameter '{name}' is {value}, not a finite number; nothing can be "
                "proved with it"
            )
        if parameter.unit not in _ANGULAR:
            number = values.constant(value, work.states)
            if work.formulas:
                number = replace(number, form=forms.variable(name), constant=None)
            work.parameters[name] = number
            if exact_number(value) is None:
                work.inexact.append(name)
        elif name in drawn:
            low = value - SPREAD_PARAMETER
            high = value + SPREAD_PARAMETER
            work.ranges[name] = (True, low, high)
            near = None if work.near is None else work.near[name]
            angle = draws.turn(work.generator, low, high, work.states, name, near=near)
            work.parameters[name] = replace(angle, published=value)
            work.drawn.append(name)
        else:
            angle = draws.fixed_angle(value, work.states)
            work.parameters[name] = angle
            if not (angle.cosine.known.all() and angle.sine.known.all()):
                work.inexact.append(name)


def _exact_mechanism(work: _Work) -> ExactMechanism:
    """Return the mechanism with exact numbers, in which parameters of the equations are recognised."""
    angles = {}
    lengths = {}
    for parameter in work.formula.parameters:
        value = work.parameters[parameter.name]
        if isinstance(value, Angle) and parameter.name in work.drawn:
            angles[parameter.name] = value
        exact = exact_number(float(parameter.value))
        if parameter.unit in ("mm", "m") and exact is not None and exact.decimal:
            lengths[parameter.name] = exact.decimal
    return ExactMechanism(work.robot, Drawing(work.states, angles, lengths, work.formulas))


def _joint_ranges(work: _Work) -> dict[str, tuple[bool, float, float]]:
    """Return the limits of the active joints of the equations."""
    ranges = {}
    for joint in work.formula.joints:
        widest = math.pi if joint.kind == "revolute" else 1.0
        low, high = work.robot.joint(joint.name).limits or (-widest, widest)
        if not low < high:
            low, high = -widest, widest
        if not math.isfinite(low) or not math.isfinite(high):
            low = max(low, -widest)
            high = min(high, widest)
        ranges[joint.name] = (joint.kind == "revolute", low, high)
    return ranges


def _coordinate_ranges(formula: Formula) -> dict[str, tuple[bool, float, float]]:
    """Return ranges of the coordinates around the first seed."""
    ranges = {}
    for name, unit, value in zip(formula.coordinates.names, formula.coordinates.units, formula.seeds[0], strict=True):
        spread = SPREAD_ANGLE if unit == "rad" else SPREAD_LENGTH
        ranges[name] = (unit == "rad", value - spread, value + spread)
    return ranges


def _state(work: _Work, ranges: Mapping[str, tuple[bool, float, float]]) -> dict[str, Value]:
    """Return random states by name; with `rooted`, those where the roots of one group exist in the field."""
    state = draws.named(work.generator, ranges, work.states, work.formulas, work.near)
    if not work.rooted:
        return state
    kept = np.zeros(work.states, bool)
    for group in work.rooted:
        kept[_rooted(work, state, group)[:_ROOTED_STATES]] = True
    places = np.flatnonzero(kept)
    work.states = len(places)
    work.parameters = {name: values.taken(value, places) for name, value in work.parameters.items()}
    return {name: values.taken(value, places) for name, value in state.items()}


def _rooted(work: _Work, state: Mapping[str, Value], group: RootGroup) -> NDArray[np.integer]:
    """Return the places of the states where the roots of a group exist."""
    first, second = group
    formula = work.formula
    if formula.has("forward"):
        outputs = formula_side.from_joints(formula, work.variants)
    else:
        outputs = formula_side.from_pose(formula, work.variants, coordinates=True)
    pose = outputs.names.index("pose")
    inputs = [list(state.values()), list(work.parameters.values())]
    results = [pose] if second else []
    rooted = RootedStates(first, results, np.arange(work.states))
    found = replay(outputs.function, inputs, Notes(), rooted)
    if not second:
        return rooted.places
    parameters = [values.taken(value, rooted.places) for value in work.parameters.values()]
    again = RootedStates(second, [], np.arange(len(rooted.places)))
    outputs = formula_side.from_pose(formula, work.variants, coordinates=False)
    replay(outputs.function, [found[pose], parameters], Notes(), again)
    return rooted.places[again.places]


def _replayed(work: _Work, outputs: Outputs, state: Sequence[Value]) -> dict[str, list[Value]]:
    """Return the outputs of the equations at a state."""
    inputs = [list(state), list(work.parameters.values())]
    work.notes = Notes()
    found = replay(outputs.function, inputs, work.notes)
    work.rootless |= work.notes.rootless
    second = int(bool(work.shares))  # the share of the first function is known when the second one is repeated
    work.roots += [(second, mark, instruction) for mark, instruction in work.notes.roots]
    return dict(zip(outputs.names, found, strict=True))


def _inside(work: _Work, found: Found) -> Truths:
    """Return the states within reach: all values are defined, and no margin is negative."""
    inside = np.ones(work.states, bool)
    for name in ("pose", "joints", "reach"):
        for value in found.get(name, ()):
            inside &= np.isfinite(values.real_of(value))
    for margin in found.get("reach", ()):
        inside &= values.real_of(margin) >= 0
        node = values.scalar(margin).node
        if node is not None:
            work.reach.append(node)
    work.shares.append(float(inside.mean()))
    work.sides += [answers & inside for answers in work.notes.conditions]
    work.sides += [~answers & inside for answers in work.notes.conditions]
    return inside


def _matrix(entries: Sequence[Value]) -> Matrix:
    """Return a pose (16,), row by row, as rows."""
    return [[values.scalar(entries[4 * i + j]) for j in range(4)] for i in range(4)]


# ------------------------------------------------------------------------------------------- claims


def _claim_mechanism(
    work: _Work,
    exact: ExactMechanism,
    stage: str,
    found: Found,
    joints: Mapping[str, Value],
    inside: Truths,
    state: Mapping[str, Value],
) -> mechanism.PlacedBodies:
    """Claim that all joints fit where the equations put tool and joints; return the placed bodies."""
    known = dict(joints)
    if "passive" in found:
        known |= zip(work.formula.passive, found["passive"], strict=True)
    placed = mechanism.place(exact, known, _matrix(found["pose"]))
    uncovered = set(placed.missing)
    for joint in placed.closing:
        numbers = mechanism.conditions(exact, placed, joint, known.get(joint.name))
        sentence = f"joint {joint.name} ({joint.type}) between {joint.parent} and {joint.child} fits"
        _claim(work, exact, f"{stage}: joint {joint.name}", sentence, numbers, inside, state)
    for body, sentence, numbers in mechanism.slides(exact, placed):
        _claim(work, exact, f"{stage}: {body}", sentence, numbers, inside, state)
        uncovered.remove(body)
    work.uncovered |= uncovered
    for name in joints:
        joint = work.robot.joint(name)
        unplaced = {joint.parent, joint.child} & uncovered
        if unplaced:
            body = min(unplaced)
            reason = f"no joint with a known value places {body}; give the passive joints in the formula"
            sentence = f"joint {name} between {joint.parent} and {joint.child} fits"
            work.claims.append(unclaimed(f"{stage}: joint {name}", sentence, reason))
    return placed


def _claim_inverse(
    work: _Work, exact: ExactMechanism, found: Found, inside: Truths, state: Mapping[str, Value]
) -> None:
    """Claim that the joints of the inverse equations put the tool and the named points where the equations say."""
    names = [joint.name for joint in work.formula.joints]
    joints = dict(zip(names, found["joints"], strict=True))
    placed = _claim_mechanism(work, exact, "inverse", found, joints, inside, state)
    for point in work.robot.points:
        entries = found.get(f"point {point.name}")
        if entries is None or point.body not in placed.poses:
            continue
        p = mechanism.moved(placed.poses[point.body], exact.point(point.body, point.p_body, point.name))
        if len(entries) != len(p):
            raise KinematicsError(
                f"formula '{work.formula.name}': point '{point.name}' has {len(entries)} entries, not 3: return (3,)"
            )
        numbers = [values.difference(a, values.scalar(b)) for a, b in zip(p, entries, strict=True)]
        sentence = f"point {point.name} of the equations is that of {point.body}"
        _claim(work, exact, f"inverse: point {point.name}", sentence, numbers, inside, state)
    for first, second in combinations(work.robot.points, 2):
        ends = [found.get(f"point {point.name}") for point in (first, second)]
        if first.body != second.body or None in ends:
            continue
        square = _square(found, first.name, second.name)
        own_square = _own_square(exact, first, second)
        distance = values.difference(square, own_square)
        distance = replace(distance, real=np.sqrt(square.real) - np.sqrt(own_square.real))
        sentence = f"points {first.name} and {second.name} of the equations keep their distance on {first.body}"
        _claim(work, exact, f"inverse: {first.name} to {second.name}", sentence, [distance], inside, state)
        claim = work.claims[-1]
        if claim.error:
            work.claims[-1] = replace(claim, error=f"{claim.error} of the square")
    if "again" in found:
        numbers = list(mechanism.deviations(_matrix(found["again"]), _matrix(found["pose"])))
        sentence = "forward equations of the joints of the inverse equations give the pose"
        _claim(work, exact, "forward of inverse", sentence, numbers, inside, state)


def _square(found: Found, first: str, second: str) -> ExactValue:
    """Return the square of the distance of two points of the equations, in m2."""
    pairs = zip(found[f"point {first}"], found[f"point {second}"], strict=True)
    return _length_squared([values.difference(values.scalar(a), values.scalar(b)) for a, b in pairs])


def _own_square(exact: ExactMechanism, first: Point, second: Point) -> ExactValue:
    """Return the square of the distance of two points of a body, in m2."""
    p = exact.point(first.body, first.p_body, first.name)
    q = exact.point(second.body, second.p_body, second.name)
    return _length_squared([values.difference(a, b) for a, b in zip(p, q, strict=True)])


def _length_squared(vector: Sequence[ExactValue]) -> ExactValue:
    square = values.product(vector[0], vector[0])
    for x in vector[1:]:
        square = values.total(square, values.product(x, x))
    return square


def _claim(
    work: _Work,
    exact: ExactMechanism,
    name: str,
    sentence: str,
    numbers: Iterator[ExactValue] | list[ExactValue],
    inside: Truths,
    state: Mapping[str, Value],
) -> None:
    """Judge a claim and keep it."""
    reals: dict[str, Array] = {key: values.real_of(value) for key, value in state.items()}
    for key in work.drawn:
        reals[key] = values.real_of(work.parameters[key])
    numbers = list(numbers)
    reasons = [f"parameter {key}" for key in work.inexact]
    reasons += dict.fromkeys(exact.drawing.unrecognised)
    reasons += dict.fromkeys(work.notes.inexact)
    share = work.zero_shares.get(name)
    claim = judged(name, sentence, numbers, inside, reals, reasons[:_REASONS], work.drawn_states, work.sides, share)
    work.claims.append(replace(claim, reach=tuple(work.reach)))
