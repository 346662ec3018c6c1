"""A against B: the published equations against the independent model, cause separated from consequence.

The protocol gives tool poses. The mechanism is solved twice: for the poses (which joint values would take the
tool there?) and for the equations' joint values (where would they take it?). Each printed equation is judged
on its own input: the points that an equation places against the CAD's points at the same pose, and the joint
values that an equation makes of the CAD's points against the mechanism's. What follows from an error that is
already located is reported as its consequence, not as another error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from twin.core.errors import AssemblyError
from twin.core.findings import Finding
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, Run
from twin.validation.forward import forward
from twin.validation.result import Quantity, Residual, headline
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text

COARSE = 10
"""Joints, points, speeds and the stage are compared at every tenth sample, tool and loops at every one."""

Progress = Callable[[str, float], None]


@dataclass
class Comparison:
    """Rows, findings and curves of one comparison, being collected."""

    residuals: list[Residual] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    series: dict[str, Array] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    driven: Run | None = None
    """The mechanism driven by the equations' joint values, at every sample; None if it cannot be assembled."""

    posed: Run | None = None
    """The mechanism with its tool at the protocol's poses, at the coarse samples."""

    coarse: Index = field(default_factory=lambda: np.zeros(0, np.intp))
    """The samples that are compared coarsely."""


def compare(
    kin: Kinematics | None,
    model: ReferenceModel,
    trajectory: Trajectory,
    clock: Clock,
    tolerances: Tolerances,
    progress: Progress,
) -> Comparison:
    """Return rows and findings of the equations `kin` against the independent model along a trajectory.

    Without equations (None) the mechanism is driven by the trajectory's own joint values, and only its loops and rates
    are judged. So it is where equations lead only forward and the mechanism itself has said where the tool goes.
    """
    out = Comparison()
    rows = _coarse_rows(trajectory)
    out.coarse = rows
    coarse = clock.at(rows)
    Ts = trajectory.Ts_base_tool
    asked = kin if kin is not None and (kin.closed_inverse or not trajectory.followed) else None
    q = trajectory.q if asked is None else asked.inverse_many(Ts)
    if asked is not None:
        q[:, asked.auxiliary] = trajectory.q[:, asked.auxiliary]  # which the equations leave where they are
    out.series |= {"q": q, "t_coarse": coarse.t}
    if asked is not None and not np.isfinite(q).all():
        k = int(np.argmin(np.isfinite(q).all(axis=1)))
        out.findings.append(
            Finding(
                "driven.no_answer",
                "disagreement",
                f"the equations give no joint values for {np.sum(~np.isfinite(q).all(axis=1))} of {len(q)} tool "
                f"poses that the mechanism can take ({', '.join(f'{n} {v}' for n, v in asked.variants.items())})",
                where=", ".join(j for j, bad in zip(asked.joints, ~np.isfinite(q[k]), strict=True) if bad),
                when=f"{clock.phase(float(clock.t[k]))}, t = {clock.t[k]:.2f} s",
                cause=_equation_of(asked, tuple(asked.joints)),
            )
        )

    def told(fraction: float) -> None:
        progress("mechanism at the tool poses", fraction)

    if trajectory.followed:  # the poses are where the mechanism was taken by these joint values
        posed = model.run(trajectory.q[rows], progress=told)
    else:
        posed = model.run_poses(Ts[rows], progress=told, near=trajectory.q[rows])
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
        _rates(model, trajectory, out, rows, coarse, tolerances)
    return out


@dataclass(frozen=True)
class _Blame:
    """The row that explains others, the equation that yields it, and by point which equation is off there; or ""."""

    row: str = ""
    cause: str = ""
    points: Mapping[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.row)


def _coarse_rows(trajectory: Trajectory) -> Index:
    ends = [p.stop for p in trajectory.phases]
    return np.unique(np.array([*range(0, len(trajectory.t), COARSE), *ends, len(trajectory.t) - 1], np.intp))


def _equation_of(kin: Kinematics, symbols: tuple[str, ...]) -> str:
    """Return the equation that yields a symbol, with the variant in use, for messages."""
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
    """Judge where the equations place the named points when the tool is where it should be."""
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
        # A point that no equation yields (an apex) follows from those that one does.
        if not equations[name] and off:
            r = replace(r, consequence_of=first)
        out.residuals.append(r)
        if not r.agrees:
            by = f" by {equations[name]}" if equations[name] else ""
            message = f"point {name}{by} is {text(r.worst, 'm')} off where the CAD has it, in {r.component}"
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
    """Judge whether points of one body keep their distances: equations that break them describe no rigid body."""
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
                    Finding(
                        "points.not_rigid",
                        "disagreement",
                        f"the equations make {a}-{b} {length[0] / MM:.3f} mm at the start and "
                        f"{length[i] / MM:.3f} mm at worst; on '{body}' in the CAD it is {true[0] / MM:.3f} mm: "
                        "they describe no rigid body",
                        where=f"{a}, {b}",
                        when=f"{r.phase}, t = {r.t:.2f} s",
                        size=r.worst / MM,
                        unit="mm",
                        limit=tolerances.position / MM,
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
    """Judge the joint values: those of the whole chain, and those made of the CAD's own points."""
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
            by = f", because {because} is off," if because else f" by {equation}" if equation else ""
            away = f"{text(r.worst, unit)} {'from where the mechanism has it' if unit == 'm' else 'off'}"
            _add(out, r, f"joint {joint}{by} is {away}", cause)
    if alone is not None and blamed:
        out.facts.setdefault("equations by themselves", {})[_equation_of(kin, kin.joints)] = (
            f"given the CAD's own points it yields the joints to {text(float(np.abs(alone - posed.q).max()), 'm')}"
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
        difference = np.angle(np.exp(1j * (value - posed.q_passive[name])))  # to within a turn
        r = row("A-B", "passive", name, "rad", difference, tolerances.rotation, clock, consequence_of=blamed.row)
        out.residuals.append(r)
        if not r.agrees:
            cause = blamed.cause or _equation_of(kin, (name,))
            _add(out, r, f"passive joint {name} is {text(r.worst, 'rad')} from the mechanism's", cause)


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
    """Drive the mechanism with the equations' joint values and judge where the tool goes."""
    Ts = trajectory.Ts_base_tool
    if not np.isfinite(q).all():
        return
    try:
        run = model.run(q, progress=lambda f: progress("mechanism driven by the equations", f))
    except AssemblyError as error:
        out.findings.append(
            Finding(
                "tool.no_assembly",
                "info" if blamed else "disagreement",
                f"driven to the joint values of the equations the mechanism cannot be assembled ({error})",
                where=", ".join(kin.joints) if blamed else "mechanism",
                when=f"{clock.phase(0.0)}, from the start",
                suggestion=f"a consequence of {blamed.row}: fix that first" if blamed else "",
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
            _add(out, r, f"driven by the equations the tool is {text(r.worst, unit)} from where they say", blamed.cause)
    _closed(model, run, out, clock, tolerances, blamed.cause)


def _closed(
    model: ReferenceModel, run: Run, out: Comparison, clock: Clock, tolerances: Tolerances, cause: str = ""
) -> None:
    """Judge whether the loops of the driven mechanism close; `cause` is what the joint values are put down to."""
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
                    f"loop {loop} does not close: {text(gap.worst, gap.unit)} remain in the "
                    "least-squares sense; the parts of this limb do not fit",
                    cause,
                )


def _rates(
    model: ReferenceModel,
    trajectory: Trajectory,
    out: Comparison,
    rows: Index,
    clock: Clock,
    tolerances: Tolerances,
) -> None:
    """Judge speed and acceleration of the tool: the protocol's against the mechanism's constraint Jacobian."""
    run = out.driven
    assert run is not None
    twist, acceleration = model.rates(run.x[rows], trajectory.qd[rows], trajectory.qdd[rows])
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
        kind: Quantity = "speed" if quantity == "speed" else "acceleration"
        r = row("A-B", kind, "tool", unit, difference, tolerance, clock)
        out.residuals.append(r)
        if not r.agrees:
            _add(out, r, f"the tool's {quantity} differs by {text(r.worst, unit)}")


def _add(out: Comparison, r: Residual, message: str, cause: str = "") -> None:
    """Add a disagreement for a row, or a note if the row is a consequence of another."""
    scale, unit = (MM, "mm" + r.unit[1:]) if r.unit.startswith("m") else (DEG, "deg" + r.unit[3:])
    out.findings.append(
        Finding(
            f"{r.quantity}.differs",
            "info" if r.consequence_of else "disagreement",
            message,
            where=r.name,
            when=f"{r.phase}, t = {r.t:.2f} s",
            size=r.worst / scale,
            unit=unit,
            limit=None if r.tolerance is None else r.tolerance / scale,
            suggestion=f"a consequence of {r.consequence_of}" if r.consequence_of else "",
            cause=cause,
        )
    )
