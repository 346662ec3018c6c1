"""Compare the equations (A) with the independent mechanism from the CAD (B), and separate causes from consequences.

The protocol defines tool poses. The mechanism is solved twice: for the joint values at these tool poses, and for the
tool poses at the joint values of the equations. Each printed equation is also checked with correct inputs: its points
are compared with the CAD's points at the same tool pose; its joint values are computed from the CAD's points and
compared with the mechanism's joint values. Consequences of a located error are not reported as further errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from twin.core.errors import AssemblyError
from twin.core.findings import Finding, Kind, disagreement, finding
from twin.core.quantity import mm
from twin.core.result import Table
from twin.core.spatial import Array, Index
from twin.core.units import MM, ROUNDING
from twin.formula.contract import Equation
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, Run
from twin.validation.result import Residual, RowKind, headline
from twin.validation.rows import Clock, Tolerances, pose_rows, rotation_vectors, row, text

COARSE = 10
"""Joints, points, speeds and stage are compared at every tenth sample (coarse samples), tool and loops at all."""

Progress = Callable[[str, float], None]

_FORWARD = Kind("tool.forward", "disagreement", word="tolerance")
_NOT_RIGID = Kind("points.not_rigid", "disagreement", word="")


@dataclass
class Comparison:
    """Rows, findings and curves of one comparison of equations and mechanism; the checks add to them."""

    residuals: list[Residual] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    series: dict[str, Array] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    driven: Run | None = None
    """States of the mechanism at the equations' joint values, at every sample; None if it cannot be assembled there."""

    posed: Run | None = None
    """States of the mechanism at the protocol's tool poses, at the coarse samples; None before they are computed."""

    coarse: Index = field(default_factory=lambda: np.zeros(0, np.intp))
    """Indices of the coarse samples."""

    def judge(self, r: Residual, kind: Kind, what: str, where: str = "", **more: str) -> None:
        """Add a row and, if the row disagrees, a finding; for the arguments see `Residual.finding`."""
        self.residuals.append(r)
        if not r.agrees:
            self.findings.append(r.finding(kind, what, where, **more))

    def differs(self, r: Residual, what: str, cause: str = "") -> None:
        """Add a row and, if the row disagrees, a finding.

        The severity is info if the row is a consequence of another row, else disagreement. `cause` is the name of the
        wrong equation, if known.
        """
        first = r.consequence_of
        kind = Kind(f"{r.quantity}.differs", "info" if first else "disagreement", word="tolerance")
        self.judge(r, kind, what, suggestion=f"caused by {first}; fix that first" if first else "", cause=cause)


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
    If `kin` has only forward equations and the path was computed with the mechanism, the joint values of the trajectory
    also drive the mechanism, and the forward equations are compared with it.
    """
    out = Comparison(coarse=_coarse_rows(trajectory))
    asked = kin if kin is not None and (kin.closed_inverse or not trajectory.followed) else None
    q = trajectory.q if asked is None else asked.inverse_many(trajectory.Ts_base_tool)
    if asked is not None:
        q[:, asked.auxiliary] = trajectory.q[:, asked.auxiliary]  # the equations do not change these joints
        _unsolved(asked, q, out, clock)
    # If the mechanism is redundant, the equations may choose another solution than the path: judge that solution.
    by_joints = trajectory.followed or any(p.type == "free" for p in trajectory.phases)
    chosen = asked is not None and by_joints and model.redundant
    out.posed = posed = _posed(model, trajectory, out.coarse, q if chosen else None, progress)
    check = _Check(model, trajectory, clock, tolerances, progress, out, posed)
    out.series |= {"q": q, "t_coarse": check.coarse.t}
    blamed = joints = _Blame()
    if kin is not None:
        blamed = check.points(kin)
        if asked is not None:
            joints = check.joints(asked, q[out.coarse], blamed)
        # Otherwise `tool` checks forward equations without inverse: their numeric inverse drives the mechanism.
        if kin.closed_forward and (kin.closed_inverse or asked is None):
            check.forward(kin)
        check.passive(kin, blamed)
    if asked is not None:
        check.tool(asked, q, blamed or joints)
    else:
        out.driven = model.run(q, progress=lambda f: progress("mechanism driven by its joints", f))
        check.loops(out.driven)
    if out.driven is not None and not joints.row:
        taken = model.run(trajectory.q).x if chosen else out.driven.x
        _rates(check, taken[out.coarse])
    return out


def _coarse_rows(trajectory: Trajectory) -> Index:
    ends = [p.stop for p in trajectory.phases]
    return np.unique(np.array([*range(0, len(trajectory.t), COARSE), *ends, len(trajectory.t) - 1], np.intp))


def _unsolved(kin: Kinematics, q: Array, out: Comparison, clock: Clock) -> None:
    """Add a finding if the equations give no joint values at some of the tool poses."""
    solved = np.isfinite(q).all(axis=1)
    if solved.all():
        return
    k = int(np.argmin(solved))
    out.findings.append(
        disagreement(
            "driven.no_answer",
            ", ".join(j for j, bad in zip(kin.joints, ~np.isfinite(q[k]), strict=True) if bad),
            f"the equations give no joint values for {np.sum(~solved)} of {len(q)} tool "
            f"poses that the mechanism can reach ({', '.join(f'{n} {v}' for n, v in kin.variants.items())})",
            when=clock.when(k),
            cause=_equation_of(kin, tuple(kin.joints)),
        )
    )


def _posed(model: ReferenceModel, trajectory: Trajectory, rows: Index, q: Array | None, progress: Progress) -> Run:
    """Return the states of the mechanism at the tool poses of the samples with the indices `rows`.

    `q` (k, n) are start values of the solver: joint values near the solution, at all k samples of the trajectory. None:
    the joint values of the trajectory.
    """

    def report(fraction: float) -> None:
        progress("mechanism at the tool poses", fraction)

    if q is None and trajectory.followed:  # the poses were computed by driving the mechanism with these joint values
        return model.run(trajectory.q[rows], progress=report)
    near = trajectory.q if q is None else q
    return model.run_poses(trajectory.Ts_base_tool[rows], progress=report, near=near[rows])


def tool_rates(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return planned velocity (k, 3) in m/s and acceleration (k, 3) in m/s2 of the tool's origin, in base."""
    lever = trajectory.Ts_base_tool[:, :3, 3] - trajectory.Ts_base_frame[:, :3, 3]
    w, dw = trajectory.angular_velocity, trajectory.angular_acceleration
    v = trajectory.tip_velocity + np.cross(w, lever)
    return v, trajectory.tip_acceleration + np.cross(dw, lever) + np.cross(w, np.cross(w, lever))


@dataclass(frozen=True)
class _Blame:
    """A wrong row that explains other rows; all attributes are empty if there is no such row.

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


def _reading(kin: Kinematics, equation: Equation) -> str:
    """Return an equation with its variant in use, as "name (variant)"."""
    return f"{equation.name} ({kin.variants.get(equation.name, equation.default)})"


def _equation_of(kin: Kinematics, symbols: str | tuple[str, ...]) -> str:
    """Return the equation that computes one of the symbols, as "name (variant)"; "" if there is none."""
    asked = {symbols} if isinstance(symbols, str) else set(symbols)
    for equation in kin.formula.equations:
        if equation.stage != "helper" and asked & set(equation.outputs):
            return _reading(kin, equation)
    return ""


@dataclass(frozen=True)
class _Check:
    """The checks of one comparison; each adds its rows and findings to `out`.

    Attributes:
        model, trajectory, clock, tolerances, progress: see `compare`.
        out: the comparison to fill.
        posed: states of the mechanism at the tool poses of the coarse samples.
    """

    model: ReferenceModel
    trajectory: Trajectory
    clock: Clock
    tolerances: Tolerances
    progress: Progress
    out: Comparison
    posed: Run

    @property
    def coarse(self) -> Clock:
        """Times and phases of the coarse samples."""
        return self.clock.at(self.out.coarse)

    @property
    def Ts(self) -> Array:  # noqa: N802
        """Tool poses (k, 4, 4) of the coarse samples."""
        return self.trajectory.Ts_base_tool[self.out.coarse]

    def points(self, kin: Kinematics) -> _Blame:
        """Compare the named points of the equations with the CAD's points, with the tool at the requested pose."""
        out, posed = self.out, self.posed
        points = {n: p for n, p in kin.points_many(Ts=self.Ts, qs=posed.q).items() if n in posed.points}
        equations = {n: _equation_of(kin, kin.formula.points[n]) for n in points}
        rows: dict[str, Residual] = {}
        for name, value in points.items():
            off = value - posed.points[name]
            out.series[f"residual_point.{name}"] = np.linalg.norm(off, axis=1)
            limit = self.tolerances.position
            rows[name] = row("A-B", "point", name, "m", off, limit, self.coarse, note=equations[name])
        wrong = {n: equations[n] for n, r in rows.items() if not r.agrees and equations[n]}
        suspects = [rows[n] for n in wrong] or [r for r in rows.values() if not r.agrees]
        first = headline(suspects).name if suspects else ""
        blame = _Blame(first, wrong.get(first, first), wrong)
        for name, r in rows.items():
            # If no equation computes a point, its error follows from the wrong points that equations compute.
            if not equations[name] and wrong:
                r = replace(r, consequence_of=first)
            by = f" by {equations[name]}" if equations[name] else ""
            what = f"point {name}{by} differs from its position in the CAD in {r.component}"
            out.differs(r, what, equations[name] or blame.cause)
        self._distances(points, blame)
        return blame

    def _distances(self, points: Mapping[str, Array], blamed: _Blame) -> None:
        """Check that points of one body keep their distances; otherwise the equations do not describe a rigid body."""
        on: dict[str, list[str]] = {}
        for point in self.model.mechanism.points:
            if point.name in points:
                on.setdefault(point.body, []).append(point.name)
        at = {"start": 0} | {p.name: int(np.argmin(np.abs(self.coarse.t - p.t1))) for p in self.clock.phases}
        for body, names in on.items():
            for a, b in combinations(names, 2):
                length = np.linalg.norm(points[a] - points[b], axis=1)
                true = np.linalg.norm(self.posed.points[a] - self.posed.points[b], axis=1)
                shown = ", ".join(f"{n} {length[i] / MM:.3f}" for n, i in at.items())
                facts = self.out.facts.setdefault("distances by the equations, mm (start, end of each phase)", {})
                facts[f"{a}-{b} (CAD {true[0] / MM:.3f})"] = shown
                off, limit = length - true, self.tolerances.position
                ends = [n for n in (a, b) if n in blamed.points]
                more = {"consequence_of": ends[0] if ends else blamed.row, "note": f"distance on '{body}'"}
                worst = length[np.argmax(np.abs(off))]
                self.out.judge(
                    row("A-B", "point", f"{a}-{b}", "m", off, limit, self.coarse, **more),
                    _NOT_RIGID,
                    f"the equations put {a} and {b} {mm(length[0])} apart at the start and {mm(worst)} in "
                    f"the worst case; in the CAD both are on '{body}', {mm(true[0])} apart",
                    f"{a}, {b}",
                    cause=blamed.points[ends[0]] if ends else blamed.cause,
                )

    def joints(self, kin: Kinematics, q: Array, blamed: _Blame) -> _Blame:
        """Compare the joint values q (k, n) of the equations with the joint values of the mechanism.

        The equations are also evaluated at the CAD's points. If the result agrees with the mechanism,
        only the inputs are wrong.
        """
        out, true = self.out, self.posed.q
        alone = self._from_points(kin)
        if alone is not None:  # without full turns, which are no disagreement
            turned = [self._turns(joint, alone[:, i], true[:, i]) for i, joint in enumerate(kin.joints)]
            alone = alone - 2 * np.pi * np.array(turned)
        wrong: dict[str, tuple[Residual, str]] = {}
        for i, joint in enumerate(kin.joints):
            if kin.auxiliary[i] or not np.isfinite(q[:, i]).any():
                continue
            turns = self._turns(joint, q[:, i], true[:, i])
            equation, off = _equation_of(kin, joint), q[:, i] - true[:, i] - 2 * np.pi * turns
            unit, limit = ("rad", self.tolerances.rotation) if kin.revolute[i] else ("m", self.tolerances.position)
            out.series[f"residual_driven.{joint}"] = np.abs(off)
            innocent = alone is not None and float(np.abs(alone[:, i] - true[:, i]).max()) <= limit
            because = blamed.row if innocent else ""
            r = row("A-B", "driven", joint, unit, off, limit, self.coarse, consequence_of=because, note=equation)
            cause = blamed.cause if because else equation or _equation_of(kin, tuple(kin.joints)) or joint
            by = f", because {because} is wrong," if because else f" by {equation}" if equation else ""
            out.differs(r, f"joint {joint}{by} differs from its value in the mechanism", cause)
            if not r.agrees:
                wrong[joint] = r, cause
            elif turns:
                count = f"{abs(turns)} full turn{'s' if abs(turns) > 1 else ''} {'above' if turns > 0 else 'below'}"
                what = f"joint {joint}{by}: the equations' value is {count} the mechanism's; the poses are the same"
                advice = f"give {joint} limits less than 360 deg apart, which select one of them"
                out.findings.append(finding("info", "driven.turns", joint, what, suggestion=advice, cause=cause))
        if alone is not None and blamed:
            out.facts.setdefault("equations by themselves", {})[_equation_of(kin, kin.joints)] = (
                "computed from the CAD's points, the joint values differ from those of the mechanism by at most "
                f"{text(float(np.abs(alone - true).max()), 'm')}"
            )
        if not wrong:
            return _Blame()
        first = headline([r for r, _ in wrong.values()]).name
        return _Blame(first, wrong[first][1])

    def _turns(self, joint: str, q: Array, true: Array) -> int:
        """Return the number of full turns by which joint values q (k,) in rad exceed `true` (k,), at all samples.

        `true` are the mechanism's values. Full turns change no pose, and are no disagreement if q is within the joint's
        limits. Return 0 if q exceeds the limits, or if the number of turns differs between samples.
        """
        told = self.model.mechanism.joint(joint)
        coupled = any(joint in c.joints for c in self.model.mechanism.couplings)
        low, high = told.limits or (-np.inf, np.inf)
        q, true = q[np.isfinite(q)], true[np.isfinite(q)]
        if not len(q):
            return 0
        turns = np.rint((q - true) / (2 * np.pi))
        if not told.is_angle or coupled or np.ptp(turns) or q.min() < low - ROUNDING or q.max() > high + ROUNDING:
            return 0
        return int(turns[0])

    def _from_points(self, kin: Kinematics) -> Array | None:
        """Return the equations' joint values (k, n) computed from the CAD's points; None if a point is missing."""
        there = self.posed.points
        names = [n for n, s in kin.formula.points.items() if _equation_of(kin, s)]
        if not kin.closed_inverse or not names or any(n not in there for n in names):
            return None
        return kin.joints_from_points({n: there[n] for n in names})

    def forward(self, kin: Kinematics) -> None:
        """Compare the tool poses of forward equations and mechanism, both at the mechanism's joint values."""
        by = ", ".join(_reading(kin, e) for e in kin.formula.equations if e.stage == "forward")
        Ts = kin.forward_many(self.posed.q)
        lost = ~np.isfinite(Ts).all(axis=(1, 2))
        if lost.any():
            what = (
                f"the forward equations have no real solution at {lost.sum()} of {len(Ts)} joint values that the "
                f"mechanism can take ({by})"
            )
            when = self.coarse.when(int(np.argmax(lost)))
            self.out.findings.append(disagreement("forward.no_answer", "tool", what, when=when, cause=by))
            return
        limits = self.tolerances.position, self.tolerances.rotation
        for r in pose_rows("A-B", "tool, forward", self.posed.Ts_base_tool, Ts, limits, self.coarse, note=by):
            what = f"at the same joint values, the forward equations ({by}) and the mechanism give different tool poses"
            self.out.judge(r, _FORWARD, what, "tool", cause=by)

    def passive(self, kin: Kinematics, blamed: _Blame) -> None:
        """Compare the passive joint angles of the equations with the passive joint angles of the mechanism."""
        true, limit = self.posed.q_passive, self.tolerances.rotation
        for name, value in kin.passive_many(Ts=self.Ts, qs=self.posed.q).items():
            if name in true:
                off = np.angle(np.exp(1j * (value - true[name])))  # modulo full turns
                r = row("A-B", "passive", name, "rad", off, limit, self.coarse, consequence_of=blamed.row)
                cause = blamed.cause or _equation_of(kin, name)
                self.out.differs(r, f"passive joint {name} differs from its value in the mechanism", cause)

    def tool(self, kin: Kinematics, q: Array, blamed: _Blame) -> None:
        """Drive the mechanism with the equations' joint values, and compare its tool pose with the requested pose."""
        if not np.isfinite(q).all():
            return
        out, Ts = self.out, self.trajectory.Ts_base_tool
        try:
            run = self.model.run(q, progress=lambda f: self.progress("mechanism driven by the equations", f))
        except AssemblyError as failed:
            out.findings.append(
                finding(
                    "info" if blamed else "disagreement",
                    "tool.no_assembly",
                    ", ".join(kin.joints) if blamed else "mechanism",
                    f"the mechanism cannot be assembled at the joint values of the equations ({failed})",
                    suggestion=f"caused by {blamed.row}; fix that first" if blamed else "",
                    when=f"{self.clock.phase(0.0)}, from the start",
                    cause=blamed.cause,
                )
            )
            return
        out.driven = run
        out.series |= {
            "residual_tool": np.linalg.norm(run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3], axis=1),
            "residual_rotation": np.linalg.norm(rotation_vectors(Ts, run.Ts_base_tool), axis=1),
            "p_tool_B": run.Ts_base_tool[out.coarse, :3, 3],
        }
        limits = self.tolerances.position, self.tolerances.rotation
        for r in pose_rows("A-B", "tool", Ts, run.Ts_base_tool, limits, self.clock, consequence_of=blamed.row):
            what = "the joint values of the equations do not move the mechanism's tool to the requested pose"
            out.differs(r, what, blamed.cause)
        self.loops(run, blamed.cause)

    def loops(self, run: Run, cause: str = "") -> None:
        """Check that the loops of the driven mechanism close; `cause` names the wrong equation, if known."""
        balls = {j.name for j in self.model.mechanism.loops if j.type == "spherical"}
        for i, loop in enumerate(run.loop_names):
            kinds = [("m", self.tolerances.loop), ("rad", self.tolerances.rotation)]
            for k, (unit, limit) in enumerate(kinds[:1] if loop in balls else kinds):
                r = row("B", "loop", loop, unit, run.gaps[:, i, k], limit, self.clock)
                what = f"loop {loop} does not close: its parts do not fit together (least-squares solution)"
                self.out.differs(r, what, cause)


def _rates(check: _Check, states: Array) -> None:
    """Compare the tool's planned speed and acceleration with those from the constraint Jacobian of the mechanism."""
    trajectory, rows, limits = check.trajectory, check.out.coarse, check.tolerances
    twist, acceleration = check.model.rates(states, trajectory.qd[rows], trajectory.qdd[rows])
    v, a = (x[rows] for x in tool_rates(trajectory))
    w, dw = trajectory.angular_velocity[rows], trajectory.angular_acceleration[rows]
    check.out.series |= {"v_tool_B": twist[:, :3], "a_tool_B": acceleration[:, :3]}
    kinds: tuple[tuple[RowKind, str, Array, float], ...] = (
        ("speed", "m/s", twist[:, :3] - v, limits.speed),
        ("speed", "rad/s", twist[:, 3:] - w, 10 * limits.speed),
        ("acceleration", "m/s2", acceleration[:, :3] - a, limits.acceleration),
        ("acceleration", "rad/s2", acceleration[:, 3:] - dw, 10 * limits.acceleration),
    )
    for kind, unit, off, limit in kinds:
        r = row("A-B", kind, "tool", unit, off, limit, check.coarse)
        check.out.differs(r, f"the tool's planned {kind} differs from its {kind} in the mechanism")
