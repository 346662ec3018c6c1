"""Compare the equations (A) with the independent mechanism from the CAD (B), and separate causes from consequences.

The protocol defines tool poses. The mechanism is solved twice: for the joint values at these tool poses, and for the
tool poses at the joint values of the equations. Each printed equation is also checked with correct inputs: its points
are compared with the CAD's points at the same tool pose; its joint values are computed from the CAD's points and
compared with the mechanism's joint values. Consequences of a located error are not reported as further errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from twin.core.errors import AssemblyError
from twin.core.findings import Finding, Kind, disagreement, finding
from twin.core.quantity import mm
from twin.core.spatial import Array, Index
from twin.core.units import MM, ROUNDING
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, SolvedSamples
from twin.validation.equations_comparison import (
    Blame,
    ComparedSamples,
    EquationsComparison,
    Progress,
    equation_of,
    named_with_variant,
)
from twin.validation.residual_rows import SampleClock, Tolerances, display_text, pose_rows, rotation_vectors, row
from twin.validation.result import Residual, RowKind, headline

COARSE_STEP = 10
"""Joints, points, speeds and stage are compared at every tenth sample (coarse samples), tool and loops at all."""

_RADIANS_PER_METRE = 10
"""Rotation in rad that counts like a translation of 1 m: it moves a point at 0.1 m from the axis, the size of a tool,
so far."""

_NOT_RIGID = Kind("points.not_rigid", "disagreement", word="")
_FORWARD_DIFFERS = Kind("tool.forward", "disagreement", word="tolerance")


def compare(
    kin: Kinematics | None,
    model: ReferenceModel,
    trajectory: Trajectory,
    clock: SampleClock,
    tolerances: Tolerances,
    progress: Progress,
) -> EquationsComparison:
    """Compare the equations `kin` with the independent mechanism along a trajectory; return rows and findings.

    If `kin` is None, the joint values of the trajectory drive the mechanism, and only its loops and rates are judged.
    If `kin` has only forward equations and the path was computed with the mechanism, the joint values of the trajectory
    also drive the mechanism, and the forward equations are compared with it.
    """
    comparison = EquationsComparison(coarse=_coarse_indices(trajectory))
    # The inverse of these equations is judged. A path that followed the mechanism needs no numeric inverse.
    inverse = None
    if kin is not None and (kin.closed_inverse or not trajectory.followed):
        inverse = kin
    q = trajectory.q
    if inverse is not None:
        q = inverse.inverse_many(trajectory.Ts_base_tool)
        q[:, inverse.auxiliary] = trajectory.q[:, inverse.auxiliary]  # the equations do not change these joints
        _note_unsolved(inverse, q, comparison, clock)
    # If the mechanism is redundant, the equations may choose another solution than the path: judge that solution.
    path_has_joints = trajectory.followed or any(phase.type == "free" for phase in trajectory.phases)
    another_solution = inverse is not None and path_has_joints and model.redundant
    start_values = None
    if another_solution:
        start_values = q
    comparison.posed = _states_at_tool_poses(model, trajectory, comparison.coarse, q=start_values, progress=progress)
    compared = ComparedSamples(
        model=model,
        trajectory=trajectory,
        clock=clock,
        tolerances=tolerances,
        progress=progress,
        comparison=comparison,
        posed=comparison.posed,
    )
    comparison.series["q"] = q
    comparison.series["t_coarse"] = compared.coarse.t
    wrong_point = Blame()
    wrong_joint = Blame()
    if kin is not None:
        # in the order of the computation, so that each check knows which of its inputs is wrong
        wrong_point = _check_points(compared, kin)
        if inverse is not None:
            wrong_joint = _check_joints(compared, inverse, q[comparison.coarse], wrong_point)
        # Forward equations without an inverse are otherwise checked by `_check_tool`: their numeric inverse drives the
        # mechanism.
        if kin.closed_forward and (kin.closed_inverse or inverse is None):
            _check_forward(compared, kin)
        _check_passive(compared, kin, wrong_point)
    if inverse is not None:
        _check_tool(compared, inverse, q, wrong_point or wrong_joint)
    else:
        comparison.driven = model.run(q, progress=lambda fraction: progress("mechanism driven by its joints", fraction))
        _check_loops(compared, comparison.driven)
    if comparison.driven is not None and not wrong_joint:
        # The planned rates are those of the path: they are compared at its own joint values.
        states = comparison.driven.x
        if another_solution:
            states = model.run(trajectory.q).x
        _check_rates(compared, states[comparison.coarse])
    return comparison


def _coarse_indices(trajectory: Trajectory) -> Index:
    """Return the indices of the coarse samples, in increasing order."""
    count = len(trajectory.t)
    every_tenth = range(0, count, COARSE_STEP)
    # with the ends of the phases, where a motion changes
    ends = [phase.stop for phase in trajectory.phases]
    return np.unique(np.array([*every_tenth, *ends, count - 1], np.intp))


def _note_unsolved(kin: Kinematics, q: Array, comparison: EquationsComparison, clock: SampleClock) -> None:
    """Add a finding if the equations give no joint values at some of the tool poses."""
    solved = np.isfinite(q).all(axis=1)
    if solved.all():
        return
    first = int(np.argmin(solved))
    unsolved = []
    for joint, value in zip(kin.joints, q[first], strict=True):
        if not np.isfinite(value):
            unsolved.append(joint)
    variants = ", ".join(f"{equation} {variant}" for equation, variant in kin.variants.items())
    what = (
        f"the equations give no joint values for {np.sum(~solved)} of {len(q)} tool poses that the mechanism can reach "
        f"({variants})"
    )
    cause = equation_of(kin, tuple(kin.joints))
    no_answer = disagreement("driven.no_answer", ", ".join(unsolved), what, when=clock.when(first), cause=cause)
    comparison.findings.append(no_answer)


def _states_at_tool_poses(
    model: ReferenceModel, trajectory: Trajectory, indices: Index, q: Array | None, progress: Progress
) -> SolvedSamples:
    """Return the states of the mechanism at the tool poses of the samples with the given indices.

    `q` (k, n) are start values of the solver: joint values near the solution, at all k samples of the trajectory. None:
    the joint values of the trajectory.
    """

    def report(fraction: float) -> None:
        progress("mechanism at the tool poses", fraction)

    if q is None and trajectory.followed:  # the poses were computed by driving the mechanism with these joint values
        return model.run(trajectory.q[indices], progress=report)
    start_values = trajectory.q
    if q is not None:
        start_values = q
    return model.run_poses(trajectory.Ts_base_tool[indices], progress=report, near=start_values[indices])


def tool_rates(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return planned velocity (k, 3) in m/s and acceleration (k, 3) in m/s2 of the tool's origin, in base."""
    lever = trajectory.Ts_base_tool[:, :3, 3] - trajectory.Ts_base_frame[:, :3, 3]
    w = trajectory.angular_velocity
    turning = np.cross(w, lever)
    centripetal = np.cross(w, turning)
    velocity = trajectory.tip_velocity + turning
    acceleration = trajectory.tip_acceleration + np.cross(trajectory.angular_acceleration, lever) + centripetal
    return velocity, acceleration


def _check_points(compared: ComparedSamples, kin: Kinematics) -> Blame:
    """Compare the named points of the equations with the CAD's points; return the worst of the wrong rows."""
    points: dict[str, Array] = {}
    equations: dict[str, str] = {}
    rows: dict[str, Residual] = {}
    for name, value in kin.points_many(Ts=compared.Ts, qs=compared.posed.q).items():
        if name not in compared.posed.points:
            continue
        points[name] = value
        equations[name] = equation_of(kin, kin.formula.points[name])
        error = value - compared.posed.points[name]
        limit = compared.tolerances.position
        # added to the comparison after all points are known: only then is it clear which of them is to blame
        rows[name] = row(
            "A-B",
            "point",
            name,
            unit="m",
            differences=error,
            tolerance=limit,
            clock=compared.coarse,
            note=equations[name],
        )
        compared.comparison.series[f"residual_point.{name}"] = np.linalg.norm(error, axis=1)
    blame = _worst_point(rows, equations)
    for name, residual in rows.items():
        # If no equation computes a point, its error follows from the wrong points that equations compute.
        if not equations[name] and blame.points:
            residual = replace(residual, consequence_of=blame.row)
        by = ""
        if equations[name]:
            by = f" by {equations[name]}"
        what = f"point {name}{by} differs from its position in the CAD in {residual.component}"
        compared.comparison.differs(residual, what, equations[name] or blame.cause)
    _check_distances(compared, points, blame)
    return blame


def _worst_point(rows: Mapping[str, Residual], equations: Mapping[str, str]) -> Blame:
    """Return the worst of the wrong rows of points; points that no equation computes are blamed last.

    Args:
        rows: the rows, by point.
        equations: the equation that computes the point, by point; "" if there is none.
    """
    wrong = []
    wrong_computed = []
    computed: dict[str, str] = {}
    for name, residual in rows.items():
        if residual.agrees:
            continue
        wrong.append(residual)
        if equations[name]:
            wrong_computed.append(residual)
            computed[name] = equations[name]
    # a point without an equation is an input of the formula, and follows those that equations compute
    suspects = wrong_computed or wrong
    if not suspects:
        return Blame()
    worst = headline(suspects).name
    return Blame(worst, computed.get(worst, worst), computed)


def _check_distances(compared: ComparedSamples, points: Mapping[str, Array], blamed: Blame) -> None:
    """Check that points of one body keep their distances; otherwise the equations do not describe a rigid body."""
    names_on: dict[str, list[str]] = {}
    for point in compared.model.mechanism.points:
        if point.name in points:
            names_on.setdefault(point.body, []).append(point.name)
    for body, names in names_on.items():
        for a, b in combinations(names, 2):
            _check_distance(compared, body, (a, points[a]), (b, points[b]), blamed)


def _check_distance(
    compared: ComparedSamples, body: str, a: tuple[str, Array], b: tuple[str, Array], blamed: Blame
) -> None:
    """Check that two points of a body, each as (name, positions (k, 3)), keep their distance."""
    name_a, p_a = a
    name_b, p_b = b
    distance = np.linalg.norm(p_a - p_b, axis=1)
    cad_distance = np.linalg.norm(compared.posed.points[name_a] - compared.posed.points[name_b], axis=1)

    distances = [f"start {distance[0] / MM:.3f}"]
    for phase in compared.clock.phases:
        end = int(np.argmin(np.abs(compared.coarse.t - phase.t1)))
        distances.append(f"{phase.name} {distance[end] / MM:.3f}")
    facts = compared.comparison.facts.setdefault("distances by the equations, mm (start, end of each phase)", {})
    facts[f"{name_a}-{name_b} (CAD {cad_distance[0] / MM:.3f})"] = ", ".join(distances)

    reason = blamed.row
    cause = blamed.cause
    for name in (name_b, name_a):  # of two wrong points, the first is named
        if name in blamed.points:
            reason = name
            cause = blamed.points[name]
    error = distance - cad_distance
    worst = distance[np.argmax(np.abs(error))]
    limit = compared.tolerances.position
    note = f"distance on '{body}'"
    residual = row(
        "A-B",
        "point",
        f"{name_a}-{name_b}",
        unit="m",
        differences=error,
        tolerance=limit,
        clock=compared.coarse,
        consequence_of=reason,
        note=note,
    )
    what = (
        f"the equations put {name_a} and {name_b} {mm(distance[0])} apart at the start and {mm(worst)} in the worst "
        f"case; in the CAD both are on '{body}', {mm(cad_distance[0])} apart"
    )
    compared.comparison.judge(residual, _NOT_RIGID, what, f"{name_a}, {name_b}", cause=cause)


def _check_joints(compared: ComparedSamples, kin: Kinematics, q: Array, wrong_point: Blame) -> Blame:
    """Compare the joint values q (k, n) of the equations with those of the mechanism; return the worst wrong row.

    The equations are also evaluated at the CAD's points. If the result agrees with the mechanism, only their inputs are
    wrong: `wrong_point`, the wrong row of the points, is then the cause.
    """
    mechanism_q = compared.posed.q
    q_at_cad_points = _q_at_cad_points(compared, kin)
    if q_at_cad_points is not None:
        q_at_cad_points = _without_turns(compared, kin, q_at_cad_points)
        if wrong_point:
            _note_q_at_cad_points(compared, kin, q_at_cad_points)
    wrong: list[Residual] = []
    causes: dict[str, str] = {}
    for i, joint in enumerate(kin.joints):
        if kin.auxiliary[i] or not np.isfinite(q[:, i]).any():
            continue
        unit = "m"
        limit = compared.tolerances.position
        if kin.revolute[i]:
            unit = "rad"
            limit = compared.tolerances.rotation
        turns = _full_turns(compared, joint, q[:, i], mechanism_q[:, i])
        error = q[:, i] - mechanism_q[:, i] - 2 * np.pi * turns
        compared.comparison.series[f"residual_driven.{joint}"] = np.abs(error)
        wrong_input = ""
        if q_at_cad_points is not None:
            # right from right points: then the equation of the joint is right, and its points are wrong
            error_at_cad_points = float(np.abs(q_at_cad_points[:, i] - mechanism_q[:, i]).max())
            if error_at_cad_points <= limit:
                wrong_input = wrong_point.row
        equation = equation_of(kin, joint)
        if wrong_input:
            cause = wrong_point.cause
            by = f", because {wrong_input} is wrong,"
        else:
            cause = equation or equation_of(kin, tuple(kin.joints)) or joint
            by = f" by {equation}" if equation else ""
        residual = row(
            "A-B",
            "driven",
            joint,
            unit=unit,
            differences=error,
            tolerance=limit,
            clock=compared.coarse,
            consequence_of=wrong_input,
            note=equation,
        )
        compared.comparison.differs(residual, f"joint {joint}{by} differs from its value in the mechanism", cause)
        if not residual.agrees:
            wrong.append(residual)
            causes[joint] = cause
        elif turns:
            _note_turns(compared, joint, by, turns, cause)
    if not wrong:
        return Blame()
    worst = headline(wrong).name
    return Blame(worst, causes[worst])


def _note_q_at_cad_points(compared: ComparedSamples, kin: Kinematics, q: Array) -> None:
    """State how far joint values q (k, n), which the equations give at the CAD's points, are from the mechanism's."""
    difference = float(np.abs(q - compared.posed.q).max())
    facts = compared.comparison.facts.setdefault("equations by themselves", {})
    facts[equation_of(kin, kin.joints)] = (
        "computed from the CAD's points, the joint values differ from those of the mechanism by at most "
        f"{display_text(difference, 'm')}"
    )


def _without_turns(compared: ComparedSamples, kin: Kinematics, q: Array) -> Array:
    """Return joint values q (k, n) without the full turns by which they exceed the mechanism's, see `_full_turns`."""
    mechanism_q = compared.posed.q
    turns = np.zeros(len(kin.joints))
    for i, joint in enumerate(kin.joints):
        turns[i] = _full_turns(compared, joint, q[:, i], mechanism_q[:, i])
    return q - 2 * np.pi * turns


def _note_turns(compared: ComparedSamples, joint: str, by: str, turns: int, cause: str) -> None:
    """Add a finding that a joint value of the equations is full turns away from that of the mechanism."""
    count = f"{abs(turns)} full turn"
    if abs(turns) > 1:
        count += "s"
    side = "above" if turns > 0 else "below"
    what = f"joint {joint}{by}: the equations' value is {count} {side} the mechanism's; the poses are the same"
    advice = f"give {joint} limits less than 360 deg apart, which select one of them"
    compared.comparison.findings.append(finding("info", "driven.turns", joint, what, suggestion=advice, cause=cause))


def _full_turns(compared: ComparedSamples, joint: str, q: Array, mechanism_q: Array) -> int:
    """Return the number of full turns by which values q (k,) of a joint in rad exceed the mechanism's, at all samples.

    `mechanism_q` (k,) are the mechanism's values. Full turns change no pose, and are no disagreement if q is within the
    joint's limits. Return 0 if q exceeds the limits, or if the number of turns differs between samples.
    """
    described = compared.model.mechanism.joint(joint)
    if not described.is_angle:
        return 0
    for coupling in compared.model.mechanism.couplings:
        if joint in coupling.joints:
            return 0  # a full turn of one joint moves the others
    finite = np.isfinite(q)
    if not finite.any():
        return 0
    q = q[finite]
    low, high = described.limits or (-np.inf, np.inf)
    if q.min() < low - ROUNDING or q.max() > high + ROUNDING:
        return 0
    turns = np.rint((q - mechanism_q[finite]) / (2 * np.pi))
    if np.ptp(turns):
        return 0  # a jump by a full turn on the way is a fault: a controller would follow it
    return int(turns[0])


def _q_at_cad_points(compared: ComparedSamples, kin: Kinematics) -> Array | None:
    """Return the equations' joint values (k, n) computed from the CAD's points; None if a point is missing."""
    if not kin.closed_inverse:
        return None
    positions: dict[str, Array] = {}
    for name, symbols in kin.formula.points.items():
        if not equation_of(kin, symbols):
            continue
        if name not in compared.posed.points:
            return None
        positions[name] = compared.posed.points[name]
    if not positions:
        return None
    return kin.joints_from_points(positions)


def _check_forward(compared: ComparedSamples, kin: Kinematics) -> None:
    """Compare the tool poses of forward equations and mechanism, both at the mechanism's joint values."""
    readings = []
    for equation in kin.formula.equations:
        if equation.stage == "forward":
            readings.append(named_with_variant(kin, equation))
    by = ", ".join(readings)
    Ts = kin.forward_many(compared.posed.q)
    unsolved = ~np.isfinite(Ts).all(axis=(1, 2))
    if unsolved.any():
        unsolved_count = unsolved.sum()
        what = (
            f"the forward equations have no real solution at {unsolved_count} of {len(Ts)} joint values that the "
            f"mechanism can take ({by})"
        )
        when = compared.coarse.when(int(np.argmax(unsolved)))
        compared.comparison.findings.append(disagreement("forward.no_answer", "tool", what, when=when, cause=by))
        return
    limits = (compared.tolerances.position, compared.tolerances.rotation)
    for residual in pose_rows(
        "A-B", "tool, forward", Ts=compared.posed.Ts_base_tool, others=Ts, limits=limits, clock=compared.coarse, note=by
    ):
        what = f"at the same joint values, the forward equations ({by}) and the mechanism give different tool poses"
        compared.comparison.judge(residual, _FORWARD_DIFFERS, what, "tool", cause=by)


def _check_passive(compared: ComparedSamples, kin: Kinematics, blamed: Blame) -> None:
    """Compare the passive joint angles of the equations with the passive joint angles of the mechanism."""
    mechanism_values = compared.posed.q_passive
    limit = compared.tolerances.rotation
    for name, value in kin.passive_many(Ts=compared.Ts, qs=compared.posed.q).items():
        if name not in mechanism_values:
            continue
        error = np.angle(np.exp(1j * (value - mechanism_values[name])))  # modulo full turns, which change no pose
        residual = row(
            "A-B",
            "passive",
            name,
            unit="rad",
            differences=error,
            tolerance=limit,
            clock=compared.coarse,
            consequence_of=blamed.row,
        )
        cause = blamed.cause or equation_of(kin, name)
        compared.comparison.differs(residual, f"passive joint {name} differs from its value in the mechanism", cause)


def _check_tool(compared: ComparedSamples, kin: Kinematics, q: Array, blamed: Blame) -> None:
    """Drive the mechanism with the equations' joint values, and compare its tool pose with the requested pose."""
    if not np.isfinite(q).all():
        return
    Ts = compared.trajectory.Ts_base_tool

    def report(fraction: float) -> None:
        compared.progress("mechanism driven by the equations", fraction)

    try:
        run = compared.model.run(q, progress=report)
    except AssemblyError as error:
        compared.comparison.findings.append(_no_assembly(compared, kin, error, blamed))
        return
    compared.comparison.driven = run
    shift = run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3]
    compared.comparison.series["residual_tool"] = np.linalg.norm(shift, axis=1)
    compared.comparison.series["residual_rotation"] = np.linalg.norm(rotation_vectors(Ts, run.Ts_base_tool), axis=1)
    compared.comparison.series["p_tool_B"] = run.Ts_base_tool[compared.comparison.coarse, :3, 3]
    limits = (compared.tolerances.position, compared.tolerances.rotation)
    for residual in pose_rows(
        "A-B", "tool", Ts=Ts, others=run.Ts_base_tool, limits=limits, clock=compared.clock, consequence_of=blamed.row
    ):
        what = "the joint values of the equations do not move the mechanism's tool to the requested pose"
        compared.comparison.differs(residual, what, blamed.cause)
    _check_loops(compared, run, blamed.cause)


def _no_assembly(compared: ComparedSamples, kin: Kinematics, error: AssemblyError, blamed: Blame) -> Finding:
    """Return the finding that the mechanism cannot be assembled at the joint values of the equations."""
    what = f"the mechanism cannot be assembled at the joint values of the equations ({error})"
    when = f"{compared.clock.phase(0.0)}, from the start"
    if not blamed:
        return finding("disagreement", "tool.no_assembly", "mechanism", what, when=when, cause=blamed.cause)
    where = ", ".join(kin.joints)
    advice = f"caused by {blamed.row}; fix that first"
    return finding("info", "tool.no_assembly", where, what, suggestion=advice, when=when, cause=blamed.cause)


def _check_loops(compared: ComparedSamples, run: SolvedSamples, cause: str = "") -> None:
    """Check that the loops of the driven mechanism close; `cause` names the wrong equation, if known."""
    tolerances = compared.tolerances
    spherical = {joint.name for joint in compared.model.mechanism.loops if joint.type == "spherical"}
    for loop, name in enumerate(run.loop_names):
        what = f"loop {name} does not close: its parts do not fit together (least-squares solution)"
        gap_limits = [("m", tolerances.loop), ("rad", tolerances.rotation)]
        if name in spherical:  # a ball turns freely: only its centre must fit
            gap_limits = gap_limits[:1]
        for component, (unit, limit) in enumerate(gap_limits):  # offset, rotation
            gaps = run.gaps[:, loop, component]
            residual = row("B", "loop", name, unit=unit, differences=gaps, tolerance=limit, clock=compared.clock)
            compared.comparison.differs(residual, what, cause)


def _check_rates(compared: ComparedSamples, states: Array) -> None:
    """Compare the tool's planned speed and acceleration with those from the constraint Jacobian of the mechanism."""
    trajectory = compared.trajectory
    coarse = compared.comparison.coarse
    twist, acceleration = compared.model.rates(states, trajectory.qd[coarse], trajectory.qdd[coarse])
    compared.comparison.series["v_tool_B"] = twist[:, :3]
    compared.comparison.series["a_tool_B"] = acceleration[:, :3]
    planned_v, planned_a = tool_rates(trajectory)
    # twists are linear first
    velocity_error = twist[:, :3] - planned_v[coarse]
    turning_error = twist[:, 3:] - trajectory.angular_velocity[coarse]
    acceleration_error = acceleration[:, :3] - planned_a[coarse]
    turning_acceleration_error = acceleration[:, 3:] - trajectory.angular_acceleration[coarse]
    limits = compared.tolerances
    kinds: tuple[tuple[RowKind, str, Array, float], ...] = (
        ("speed", "m/s", velocity_error, limits.speed),
        ("speed", "rad/s", turning_error, _RADIANS_PER_METRE * limits.speed),
        ("acceleration", "m/s2", acceleration_error, limits.acceleration),
        ("acceleration", "rad/s2", turning_acceleration_error, _RADIANS_PER_METRE * limits.acceleration),
    )
    for kind, unit, error, limit in kinds:
        residual = row("A-B", kind, "tool", unit=unit, differences=error, tolerance=limit, clock=compared.coarse)
        compared.comparison.differs(residual, f"the tool's planned {kind} differs from its {kind} in the mechanism")
