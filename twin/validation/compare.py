"""Compare the equations (A) with the independent mechanism from the CAD (B), and separate causes from consequences.

The protocol defines tool poses. The mechanism is solved for the joint values at these poses, and for the tool pose at
the joint values of the equations. Each printed equation is also checked with correct inputs: its points are compared
with the CAD's points at the same pose, and its joint values, computed from the CAD's points, with the mechanism's joint
values. Consequences of a located error are reported as consequences, not as further errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from twin.core.errors import AssemblyError
from twin.core.findings import Finding, Kind, disagreement, finding
from twin.core.quantity import mm
from twin.core.spatial import Array, Index
from twin.core.units import MM
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, Run
from twin.validation.forward import forward
from twin.validation.result import Residual, RowKind, headline
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text

COARSE = 10
"""Every tenth sample is a coarse sample (joints, points, speeds, stage); tool and loops are compared at all samples."""

Progress = Callable[[str, float], None]


_NOT_RIGID = Kind("points.not_rigid", "disagreement", word="")


@dataclass
class Comparison:
    """Rows, findings and curves of one comparison, filled by its checks."""

    residuals: list[Residual] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    series: dict[str, Array] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    driven: Run | None = None
    """The mechanism driven by the equations' joint values, at every sample; None if it cannot be assembled."""

    posed: Run | None = None
    """States of the mechanism at the protocol's tool poses, at the coarse samples; None before they are computed."""

    coarse: Index = field(default_factory=lambda: np.zeros(0, np.intp))
    """Indices of the coarse samples."""


def compare(
    kin: Kinematics | None,
    model: ReferenceModel,
    trajectory: Trajectory,
    clock: Clock,
    tolerances: Tolerances,
    progress: Progress,
) -> Comparison:
    """Compare the equations `kin` with the independent mechanism along a trajectory; return rows and findings.

    If `kin` is None, the joint values of the trajectory drive the mechanism, and only its loops and rates are judged.
    The same applies if `kin` has only forward equations and the path was computed with the mechanism.
    """
    out = Comparison()
    rows = _coarse_rows(trajectory)
    out.coarse = rows
    coarse = clock.at(rows)
    Ts = trajectory.Ts_base_tool
    asked = kin if kin is not None and (kin.closed_inverse or not trajectory.followed) else None
    q = trajectory.q if asked is None else asked.inverse_many(Ts)
    if asked is not None:
        q[:, asked.auxiliary] = trajectory.q[:, asked.auxiliary]  # the equations do not change these joints
    out.series |= {"q": q, "t_coarse": coarse.t}
    if asked is not None and not np.isfinite(q).all():
        k = int(np.argmin(np.isfinite(q).all(axis=1)))
        out.findings.append(
            disagreement(
                "driven.no_answer",
                ", ".join(j for j, bad in zip(asked.joints, ~np.isfinite(q[k]), strict=True) if bad),
                f"the equations give no joint values for {np.sum(~np.isfinite(q).all(axis=1))} of {len(q)} tool "
                f"poses that the mechanism can reach ({', '.join(f'{n} {v}' for n, v in asked.variants.items())})",
                when=f"{clock.phase(float(clock.t[k]))}, t = {clock.t[k]:.2f} s",
                cause=_equation_of(asked, tuple(asked.joints)),
            )
        )

    def report(fraction: float) -> None:
        progress("mechanism at the tool poses", fraction)

    by_joints = trajectory.followed or any(p.type == "free" for p in trajectory.phases)
    chosen = asked is not None and by_joints and model.redundant
    if chosen:  # redundant: the equations may choose a solution that differs from the path, so their solution is judged
        posed = model.run_poses(Ts[rows], progress=report, near=q[rows])
    elif trajectory.followed:  # the poses were computed by driving the mechanism with these joint values
        posed = model.run(trajectory.q[rows], progress=report)
    else:
        posed = model.run_poses(Ts[rows], progress=report, near=trajectory.q[rows])
    out.posed = posed
    blamed = joints = _Blame()
    if kin is not None:
        blamed = _points(kin, model, posed, Ts[rows], out, coarse, tolerances)
        if asked is not None:
            joints = _driven(asked, posed, q[rows], blamed, out, coarse, tolerances)
        rows_forward, found = forward(kin, posed, coarse, tolerances, alone=asked is None)
        out.residuals += rows_forward
        out.findings += found
        _passive(kin, posed, Ts[rows], blamed, out, coarse, tolerances)
    if asked is not None:
        _tool(asked, model, trajectory, q, blamed or joints, out, clock, tolerances, progress)
    else:
        out.driven = model.run(q, progress=lambda f: progress("mechanism driven by its joints", f))
        _closed(model, out.driven, out, clock, tolerances)
    if out.driven is not None and not joints.row:
        taken = model.run(trajectory.q).x if chosen else out.driven.x
        _rates(model, trajectory, out, taken[rows], rows, coarse, tolerances)
    return out


@dataclass(frozen=True)
class _Blame:
    """A wrong row that explains other rows; its attributes are empty if there is no such row.

    Attributes:
        row: name of the row.
        cause: name of the equation that computes the row.
        points: name of the wrong equation, by point.
    """

    row: str = ""
    cause: str = ""
    points: Mapping[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.row)


def _coarse_rows(trajectory: Trajectory) -> Index:
    ends = [p.stop for p in trajectory.phases]
    return np.unique(np.array([*range(0, len(trajectory.t), COARSE), *ends, len(trajectory.t) - 1], np.intp))


def _equation_of(kin: Kinematics, symbols: tuple[str, ...]) -> str:
    """Return the equation that computes one of the symbols, as "name (variant)"; "" if there is none."""
    for equation in kin.formula.equations:
        if equation.stage != "helper" and set(symbols) & set(equation.outputs):
            variant = kin.variants.get(equation.name, equation.default)
            return f"{equation.name} ({variant})"
    return ""


def _points(
    kin: Kinematics,
    model: ReferenceModel,
    posed: Run,
    Ts: Array,
    out: Comparison,
    clock: Clock,
    tolerances: Tolerances,
) -> _Blame:
    """Compare the named points of the equations with the CAD's points, with the tool at the requested pose."""
    points = {n: p for n, p in kin.points_many(Ts=Ts, qs=posed.q).items() if n in posed.points}
    rows: dict[str, Residual] = {}
    equations: dict[str, str] = {}
    for name, value in points.items():
        symbols = kin.formula.points[name]
        equations[name] = _equation_of(kin, (symbols,) if isinstance(symbols, str) else symbols)
        difference = value - posed.points[name]
        out.series[f"residual_point.{name}"] = np.linalg.norm(difference, axis=1)
        rows[name] = row("A-B", "point", name, "m", difference, tolerances.position, clock, note=equations[name])
    off = {n: equations[n] for n, r in rows.items() if not r.agrees and equations[n]}
    wrong = [rows[n] for n in off] or [r for r in rows.values() if not r.agrees]
    first = headline(wrong).name if wrong else ""
    blame = _Blame(first, off.get(first, first), off)
    for name, r in rows.items():
        # The error of a point that no equation computes is a consequence of wrong points that equations compute.
        if not equations[name] and off:
            r = replace(r, consequence_of=first)
        out.residuals.append(r)
        if not r.agrees:
            by = f" by {equations[name]}" if equations[name] else ""
            message = f"point {name}{by} differs from its position in the CAD in {r.component}"
            _add(out, r, message, equations[name] or blame.cause)
    _distances(model, points, posed, out, clock, tolerances, blame)
    return blame


def _distances(
    model: ReferenceModel,
    points: Mapping[str, Array],
    posed: Run,
    out: Comparison,
    clock: Clock,
    tolerances: Tolerances,
    blamed: _Blame,
) -> None:
    """Check that points of one body keep their distances; otherwise the equations do not describe a rigid body."""
    on: dict[str, list[str]] = {}
    for point in model.mechanism.points:
        if point.name in points:
            on.setdefault(point.body, []).append(point.name)
    ends = [int(np.argmin(np.abs(clock.t - t))) for t in (clock.phases[0].t0, *(p.t1 for p in clock.phases))]
    for body, names in on.items():
        for a, b in combinations(names, 2):
            length = np.linalg.norm(points[a] - points[b], axis=1)
            true = np.linalg.norm(posed.points[a] - posed.points[b], axis=1)
            at = {"start": 0} | {p.name: i for p, i in zip(clock.phases, ends[1:], strict=True)}
            out.facts.setdefault("distances by the equations, mm (start, end of each phase)", {})[
                f"{a}-{b} (CAD {true[0] / MM:.3f})"
            ] = ", ".join(f"{n} {length[i] / MM:.3f}" for n, i in at.items())
            ends_off = [n for n in (a, b) if n in blamed.points]
            r = row(
                "A-B",
                "point",
                f"{a}-{b}",
                "m",
                length - true,
                tolerances.position,
                clock,
                consequence_of=ends_off[0] if ends_off else blamed.row,
                note=f"distance on '{body}'",
            )
            out.residuals.append(r)
            if not r.agrees:
                i = int(np.argmax(np.abs(length - true)))
                out.findings.append(
                    r.finding(
                        _NOT_RIGID,
                        f"the equations put {a} and {b} {mm(length[0])} apart at the start and {mm(length[i])} in "
                        f"the worst case; in the CAD both are on '{body}', {mm(true[0])} apart",
                        f"{a}, {b}",
                        cause=blamed.points[ends_off[0]] if ends_off else blamed.cause,
                    )
                )


def _driven(
    kin: Kinematics,
    posed: Run,
    q: Array,
    blamed: _Blame,
    out: Comparison,
    clock: Clock,
    tolerances: Tolerances,
) -> _Blame:
    """Compare the mechanism's joint values with the equations', from the equations' points and the CAD's points."""
    alone = None
    if kin.closed_inverse and kin.formula.points:
        names = [n for n, s in kin.formula.points.items() if _equation_of(kin, (s,) if isinstance(s, str) else s)]
        if names and all(n in posed.points for n in names):
            alone = kin.joints_from_points({n: posed.points[n] for n in names})
    wrong: dict[str, tuple[Residual, str]] = {}
    for i, joint in enumerate(kin.joints):
        equation = _equation_of(kin, (kin.joints[i],))
        if kin.auxiliary[i] or not np.isfinite(q[:, i]).any():
            continue
        unit = "rad" if kin.revolute[i] else "m"
        tolerance = tolerances.rotation if kin.revolute[i] else tolerances.position
        out.series[f"residual_driven.{joint}"] = np.abs(q[:, i] - posed.q[:, i])
        innocent = alone is not None and float(np.abs(alone[:, i] - posed.q[:, i]).max()) <= tolerance
        because = blamed.row if innocent else ""
        difference = q[:, i] - posed.q[:, i]
        r = row("A-B", "driven", joint, unit, difference, tolerance, clock, consequence_of=because, note=equation)
        out.residuals.append(r)
        if not r.agrees:
            cause = blamed.cause if because else equation or _equation_of(kin, tuple(kin.joints)) or joint
            wrong[joint] = r, cause
            by = f", because {because} is wrong," if because else f" by {equation}" if equation else ""
            _add(out, r, f"joint {joint}{by} differs from the mechanism's", cause)
    if alone is not None and blamed:
        out.facts.setdefault("equations by themselves", {})[_equation_of(kin, kin.joints)] = (
            "computed from the CAD's points, its joint values differ from the mechanism's by at most "
            f"{text(float(np.abs(alone - posed.q).max()), 'm')}"
        )
    if not wrong:
        return _Blame()
    first = headline([r for r, _ in wrong.values()]).name
    return _Blame(first, wrong[first][1])


def _passive(
    kin: Kinematics, posed: Run, Ts: Array, blamed: _Blame, out: Comparison, clock: Clock, tolerances: Tolerances
) -> None:
    for name, value in kin.passive_many(Ts=Ts, qs=posed.q).items():
        if name not in posed.q_passive:
            continue
        difference = np.angle(np.exp(1j * (value - posed.q_passive[name])))  # modulo full turns
        r = row("A-B", "passive", name, "rad", difference, tolerances.rotation, clock, consequence_of=blamed.row)
        out.residuals.append(r)
        if not r.agrees:
            cause = blamed.cause or _equation_of(kin, (name,))
            _add(out, r, f"passive joint {name} differs from the mechanism's", cause)


def _tool(
    kin: Kinematics,
    model: ReferenceModel,
    trajectory: Trajectory,
    q: Array,
    blamed: _Blame,
    out: Comparison,
    clock: Clock,
    tolerances: Tolerances,
    progress: Progress,
) -> None:
    """Drive the mechanism with the equations' joint values and compare its tool pose with the requested pose."""
    Ts = trajectory.Ts_base_tool
    if not np.isfinite(q).all():
        return
    try:
        run = model.run(q, progress=lambda f: progress("mechanism driven by the equations", f))
    except AssemblyError as failed:
        out.findings.append(
            finding(
                "info" if blamed else "disagreement",
                "tool.no_assembly",
                ", ".join(kin.joints) if blamed else "mechanism",
                f"the mechanism cannot be assembled at the joint values of the equations ({failed})",
                suggestion=f"caused by {blamed.row}; fix that first" if blamed else "",
                when=f"{clock.phase(0.0)}, from the start",
                cause=blamed.cause,
            )
        )
        return
    out.driven = run
    offset, turn = run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], rotation_vectors(Ts, run.Ts_base_tool)
    out.series |= {
        "residual_tool": np.linalg.norm(offset, axis=1),
        "residual_rotation": np.linalg.norm(turn, axis=1),
        "p_tool_B": run.Ts_base_tool[out.coarse, :3, 3],
    }
    for name, unit, values, tolerance in (
        ("tool", "m", offset, tolerances.position),
        ("tool", "rad", turn, tolerances.rotation),
    ):
        r = row("A-B", "tool", name, unit, values, tolerance, clock, consequence_of=blamed.row)
        out.residuals.append(r)
        if not r.agrees:
            _add(
                out,
                r,
                "driven by the joint values of the equations, the mechanism's tool misses the requested pose",
                blamed.cause,
            )
    _closed(model, run, out, clock, tolerances, blamed.cause)


def _closed(
    model: ReferenceModel, run: Run, out: Comparison, clock: Clock, tolerances: Tolerances, cause: str = ""
) -> None:
    """Check that the loops of the driven mechanism close; `cause` names the wrong equation, if known."""
    balls = {j.name for j in model.mechanism.loops if j.type == "spherical"}
    for i, loop in enumerate(run.loop_names):
        r = row("B", "loop", loop, "m", run.gaps[:, i, 0], tolerances.loop, clock)
        turned = row("B", "loop", loop, "rad", run.gaps[:, i, 1], tolerances.rotation, clock)
        for gap in (r,) if loop in balls else (r, turned):
            out.residuals.append(gap)
            if not gap.agrees:
                _add(
                    out,
                    gap,
                    f"loop {loop} does not close: its parts do not fit together (least-squares solution)",
                    cause,
                )


def _rates(
    model: ReferenceModel,
    trajectory: Trajectory,
    out: Comparison,
    states: Array,
    rows: Index,
    clock: Clock,
    tolerances: Tolerances,
) -> None:
    """Compare the planned speed and acceleration of the tool with those from the mechanism's constraint Jacobian."""
    twist, acceleration = model.rates(states, trajectory.qd[rows], trajectory.qdd[rows])
    lever = trajectory.Ts_base_tool[rows, :3, 3] - trajectory.Ts_base_frame[rows, :3, 3]
    w, dw = trajectory.angular_velocity[rows], trajectory.angular_acceleration[rows]
    v = trajectory.tip_velocity[rows] + np.cross(w, lever)
    a = trajectory.tip_acceleration[rows] + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))
    out.series |= {"v_tool_B": twist[:, :3], "a_tool_B": acceleration[:, :3]}
    for quantity, unit, difference, tolerance in (
        ("speed", "m/s", twist[:, :3] - v, tolerances.speed),
        ("speed", "rad/s", twist[:, 3:] - w, 10 * tolerances.speed),
        ("acceleration", "m/s2", acceleration[:, :3] - a, tolerances.acceleration),
        ("acceleration", "rad/s2", acceleration[:, 3:] - dw, 10 * tolerances.acceleration),
    ):
        kind: RowKind = "speed" if quantity == "speed" else "acceleration"
        r = row("A-B", kind, "tool", unit, difference, tolerance, clock)
        out.residuals.append(r)
        if not r.agrees:
            _add(out, r, f"the tool's planned {quantity} differs from the mechanism's")


def _add(out: Comparison, r: Residual, what: str, cause: str = "") -> None:
    """Add a disagreement for a row, or an info finding if the row is a consequence of another row."""
    out.findings.append(
        r.finding(
            Kind(f"{r.quantity}.differs", "info" if r.consequence_of else "disagreement", word="tolerance"),
            what,
            suggestion=f"caused by {r.consequence_of}; fix that first" if r.consequence_of else "",
            cause=cause,
        )
    )
