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
from twin.core.result import TextTable
from twin.core.spatial import Array, Index
from twin.core.units import MM, ROUNDING
from twin.formula.contract import Equation
from twin.kinematics import Kinematics
from twin.planning.trajectory import Trajectory
from twin.reference import ReferenceModel, SolvedSamples
from twin.validation.result import Residual, RowKind, headline
from twin.validation.rows import SampleClock, Tolerances, pose_rows, rotation_vectors, row, text

COARSE = 10
"""Joints, points, speeds and stage are compared at every tenth sample (coarse samples), tool and loops at all."""

Progress = Callable[[str, float], None]

_FORWARD = Kind("tool.forward", "disagreement", word="tolerance")
_NOT_RIGID = Kind("points.not_rigid", "disagreement", word="")


@dataclass
class EquationsComparison:
    """Rows, findings and curves of one comparison of equations and mechanism; the checks add to them."""

    residuals: list[Residual] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    series: dict[str, Array] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    tables: dict[str, TextTable] = field(default_factory=dict)
    driven: SolvedSamples | None = None
    """States of the mechanism at the equations' joint values, at every sample; None if it cannot be assembled there."""

    posed: SolvedSamples | None = None
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
        if r.consequence_of:
            kind = Kind(f"{r.quantity}.differs", "info", word="tolerance")
            suggestion = f"caused by {r.consequence_of}; fix that first"
        else:
            kind = Kind(f"{r.quantity}.differs", "disagreement", word="tolerance")
            suggestion = ""
        self.judge(r, kind, what, suggestion=suggestion, cause=cause)


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
    out = EquationsComparison(coarse=_coarse_rows(trajectory))
    # The inverse of these equations is judged. A path that followed the mechanism needs no numeric inverse.
    asked = None
    if kin is not None and (kin.closed_inverse or not trajectory.followed):
        asked = kin
    q = trajectory.q
    if asked is not None:
        q = asked.inverse_many(trajectory.Ts_base_tool)
        q[:, asked.auxiliary] = trajectory.q[:, asked.auxiliary]  # the equations do not change these joints
        _unsolved(asked, q, out, clock)
    # If the mechanism is redundant, the equations may choose another solution than the path: judge that solution.
    by_joints = trajectory.followed or any(p.type == "free" for p in trajectory.phases)
    chosen = asked is not None and by_joints and model.redundant
    posed = _posed(model, trajectory, out.coarse, q if chosen else None, progress)
    out.posed = posed
    check = _Check(model, trajectory, clock, tolerances, progress, out, posed)
    out.series["q"] = q
    out.series["t_coarse"] = check.coarse.t
    blamed = _Blame()
    joints = _Blame()
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
        # The planned rates are those of the path: they are compared at its own joint values.
        states = out.driven.x
        if chosen:
            states = model.run(trajectory.q).x
        _rates(check, states[out.coarse])
    return out


def _coarse_rows(trajectory: Trajectory) -> Index:
    count = len(trajectory.t)
    every_tenth = range(0, count, COARSE)
    # with the ends of the phases, where a motion changes
    ends = [phase.stop for phase in trajectory.phases]
    return np.unique(np.array([*every_tenth, *ends, count - 1], np.intp))


def _unsolved(kin: Kinematics, q: Array, out: EquationsComparison, clock: SampleClock) -> None:
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
    cause = _equation_of(kin, tuple(kin.joints))
    found = disagreement("driven.no_answer", ", ".join(unsolved), what, when=clock.when(first), cause=cause)
    out.findings.append(found)


def _posed(
    model: ReferenceModel, trajectory: Trajectory, rows: Index, q: Array | None, progress: Progress
) -> SolvedSamples:
    """Return the states of the mechanism at the tool poses of the samples with the indices `rows`.

    `q` (k, n) are start values of the solver: joint values near the solution, at all k samples of the trajectory. None:
    the joint values of the trajectory.
    """

    def report(fraction: float) -> None:
        progress("mechanism at the tool poses", fraction)

    if q is None and trajectory.followed:  # the poses were computed by driving the mechanism with these joint values
        return model.run(trajectory.q[rows], progress=report)
    near = trajectory.q
    if q is not None:
        near = q
    return model.run_poses(trajectory.Ts_base_tool[rows], progress=report, near=near[rows])


def tool_rates(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return planned velocity (k, 3) in m/s and acceleration (k, 3) in m/s2 of the tool's origin, in base."""
    lever = trajectory.Ts_base_tool[:, :3, 3] - trajectory.Ts_base_frame[:, :3, 3]
    w = trajectory.angular_velocity
    turning = np.cross(w, lever)
    centripetal = np.cross(w, turning)
    velocity = trajectory.tip_velocity + turning
    acceleration = trajectory.tip_acceleration + np.cross(trajectory.angular_acceleration, lever) + centripetal
    return velocity, acceleration


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
    if isinstance(symbols, str):
        symbols = (symbols,)
    asked = set(symbols)
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
    clock: SampleClock
    tolerances: Tolerances
    progress: Progress
    out: EquationsComparison
    posed: SolvedSamples

    @property
    def coarse(self) -> SampleClock:
        """Times and phases of the coarse samples."""
        return self.clock.at(self.out.coarse)

    @property
    def Ts(self) -> Array:  # noqa: N802
        """Tool poses (k, 4, 4) of the coarse samples."""
        return self.trajectory.Ts_base_tool[self.out.coarse]

    def points(self, kin: Kinematics) -> _Blame:
        """Compare the named points of the equations with the CAD's points, with the tool at the requested pose."""
        points: dict[str, Array] = {}
        equations: dict[str, str] = {}
        rows: dict[str, Residual] = {}
        for name, value in kin.points_many(Ts=self.Ts, qs=self.posed.q).items():
            if name not in self.posed.points:
                continue
            points[name] = value
            equations[name] = _equation_of(kin, kin.formula.points[name])
            error = value - self.posed.points[name]
            limit = self.tolerances.position
            rows[name] = row("A-B", "point", name, "m", error, limit, self.coarse, note=equations[name])
            self.out.series[f"residual_point.{name}"] = np.linalg.norm(error, axis=1)
        blame = self._blame_of_points(rows, equations)
        for name, r in rows.items():
            # If no equation computes a point, its error follows from the wrong points that equations compute.
            if not equations[name] and blame.points:
                r = replace(r, consequence_of=blame.row)
            by = ""
            if equations[name]:
                by = f" by {equations[name]}"
            what = f"point {name}{by} differs from its position in the CAD in {r.component}"
            self.out.differs(r, what, equations[name] or blame.cause)
        self._distances(points, blame)
        return blame

    def _blame_of_points(self, rows: Mapping[str, Residual], equations: Mapping[str, str]) -> _Blame:
        """Return the worst of the wrong rows of points; points that no equation computes are blamed last.

        Args:
            rows: the rows, by point.
            equations: the equation that computes the point, by point; "" if there is none.
        """
        wrong = []
        wrong_computed = []
        computed: dict[str, str] = {}
        for name, r in rows.items():
            if r.agrees:
                continue
            wrong.append(r)
            if equations[name]:
                wrong_computed.append(r)
                computed[name] = equations[name]
        suspects = wrong_computed or wrong
        if not suspects:
            return _Blame()
        first = headline(suspects).name
        return _Blame(first, computed.get(first, first), computed)

    def _distances(self, points: Mapping[str, Array], blamed: _Blame) -> None:
        """Check that points of one body keep their distances; otherwise the equations do not describe a rigid body."""
        names_on: dict[str, list[str]] = {}
        for point in self.model.mechanism.points:
            if point.name in points:
                names_on.setdefault(point.body, []).append(point.name)
        for body, names in names_on.items():
            for a, b in combinations(names, 2):
                self._distance(body, (a, points[a]), (b, points[b]), blamed)

    def _distance(self, body: str, a: tuple[str, Array], b: tuple[str, Array], blamed: _Blame) -> None:
        """Check that two points of a body, each as (name, positions (k, 3)), keep their distance."""
        name_a, p_a = a
        name_b, p_b = b
        length = np.linalg.norm(p_a - p_b, axis=1)
        true = np.linalg.norm(self.posed.points[name_a] - self.posed.points[name_b], axis=1)

        shown = [f"start {length[0] / MM:.3f}"]
        for phase in self.clock.phases:
            end = int(np.argmin(np.abs(self.coarse.t - phase.t1)))
            shown.append(f"{phase.name} {length[end] / MM:.3f}")
        facts = self.out.facts.setdefault("distances by the equations, mm (start, end of each phase)", {})
        facts[f"{name_a}-{name_b} (CAD {true[0] / MM:.3f})"] = ", ".join(shown)

        reason = blamed.row
        cause = blamed.cause
        for name in (name_b, name_a):  # of two wrong points, the first is named
            if name in blamed.points:
                reason = name
                cause = blamed.points[name]
        error = length - true
        worst = length[np.argmax(np.abs(error))]
        limit = self.tolerances.position
        note = f"distance on '{body}'"
        r = row("A-B", "point", f"{name_a}-{name_b}", "m", error, limit, self.coarse, consequence_of=reason, note=note)
        what = (
            f"the equations put {name_a} and {name_b} {mm(length[0])} apart at the start and {mm(worst)} in the worst "
            f"case; in the CAD both are on '{body}', {mm(true[0])} apart"
        )
        self.out.judge(r, _NOT_RIGID, what, f"{name_a}, {name_b}", cause=cause)

    def joints(self, kin: Kinematics, q: Array, blamed: _Blame) -> _Blame:
        """Compare the joint values q (k, n) of the equations with the joint values of the mechanism.

        The equations are also evaluated at the CAD's points. If the result agrees with the mechanism,
        only the inputs are wrong.
        """
        true = self.posed.q
        alone = self._from_points(kin)
        if alone is not None:  # without full turns, which are no disagreement
            turns_alone = np.zeros(len(kin.joints))
            for i, joint in enumerate(kin.joints):
                turns_alone[i] = self._turns(joint, alone[:, i], true[:, i])
            alone = alone - 2 * np.pi * turns_alone
        wrong: dict[str, tuple[Residual, str]] = {}
        for i, joint in enumerate(kin.joints):
            if kin.auxiliary[i] or not np.isfinite(q[:, i]).any():
                continue
            unit = "m"
            limit = self.tolerances.position
            if kin.revolute[i]:
                unit = "rad"
                limit = self.tolerances.rotation
            turns = self._turns(joint, q[:, i], true[:, i])
            error = q[:, i] - true[:, i] - 2 * np.pi * turns
            self.out.series[f"residual_driven.{joint}"] = np.abs(error)
            because = ""
            if alone is not None:
                error_alone = float(np.abs(alone[:, i] - true[:, i]).max())
                if error_alone <= limit:
                    because = blamed.row
            equation = _equation_of(kin, joint)
            if because:
                cause = blamed.cause
                by = f", because {because} is wrong,"
            else:
                cause = equation or _equation_of(kin, tuple(kin.joints)) or joint
                by = f" by {equation}" if equation else ""
            r = row("A-B", "driven", joint, unit, error, limit, self.coarse, consequence_of=because, note=equation)
            self.out.differs(r, f"joint {joint}{by} differs from its value in the mechanism", cause)
            if not r.agrees:
                wrong[joint] = r, cause
            elif turns:
                self._note_turns(joint, by, turns, cause)
        if alone is not None and blamed:
            difference = float(np.abs(alone - true).max())
            facts = self.out.facts.setdefault("equations by themselves", {})
            facts[_equation_of(kin, kin.joints)] = (
                "computed from the CAD's points, the joint values differ from those of the mechanism by at most "
                f"{text(difference, 'm')}"
            )
        if not wrong:
            return _Blame()
        first = headline([r for r, _ in wrong.values()]).name
        _, cause = wrong[first]
        return _Blame(first, cause)

    def _note_turns(self, joint: str, by: str, turns: int, cause: str) -> None:
        """Add a finding that a joint value of the equations is full turns away from that of the mechanism."""
        count = f"{abs(turns)} full turn"
        if abs(turns) > 1:
            count += "s"
        side = "above" if turns > 0 else "below"
        what = f"joint {joint}{by}: the equations' value is {count} {side} the mechanism's; the poses are the same"
        advice = f"give {joint} limits less than 360 deg apart, which select one of them"
        self.out.findings.append(finding("info", "driven.turns", joint, what, suggestion=advice, cause=cause))

    def _turns(self, joint: str, q: Array, true: Array) -> int:
        """Return the number of full turns by which joint values q (k,) in rad exceed `true` (k,), at all samples.

        `true` are the mechanism's values. Full turns change no pose, and are no disagreement if q is within the joint's
        limits. Return 0 if q exceeds the limits, or if the number of turns differs between samples.
        """
        described = self.model.mechanism.joint(joint)
        if not described.is_angle:
            return 0
        for coupling in self.model.mechanism.couplings:
            if joint in coupling.joints:
                return 0  # a full turn of one joint moves the others
        finite = np.isfinite(q)
        if not finite.any():
            return 0
        q = q[finite]
        low, high = described.limits or (-np.inf, np.inf)
        if q.min() < low - ROUNDING or q.max() > high + ROUNDING:
            return 0
        turns = np.rint((q - true[finite]) / (2 * np.pi))
        if np.ptp(turns):
            return 0
        return int(turns[0])

    def _from_points(self, kin: Kinematics) -> Array | None:
        """Return the equations' joint values (k, n) computed from the CAD's points; None if a point is missing."""
        if not kin.closed_inverse:
            return None
        positions: dict[str, Array] = {}
        for name, symbols in kin.formula.points.items():
            if not _equation_of(kin, symbols):
                continue
            if name not in self.posed.points:
                return None
            positions[name] = self.posed.points[name]
        if not positions:
            return None
        return kin.joints_from_points(positions)

    def forward(self, kin: Kinematics) -> None:
        """Compare the tool poses of forward equations and mechanism, both at the mechanism's joint values."""
        readings = []
        for equation in kin.formula.equations:
            if equation.stage == "forward":
                readings.append(_reading(kin, equation))
        by = ", ".join(readings)
        Ts = kin.forward_many(self.posed.q)
        unsolved = ~np.isfinite(Ts).all(axis=(1, 2))
        if unsolved.any():
            what = (
                f"the forward equations have no real solution at {unsolved.sum()} of {len(Ts)} joint values that the "
                f"mechanism can take ({by})"
            )
            when = self.coarse.when(int(np.argmax(unsolved)))
            self.out.findings.append(disagreement("forward.no_answer", "tool", what, when=when, cause=by))
            return
        limits = (self.tolerances.position, self.tolerances.rotation)
        for r in pose_rows("A-B", "tool, forward", self.posed.Ts_base_tool, Ts, limits, self.coarse, note=by):
            what = f"at the same joint values, the forward equations ({by}) and the mechanism give different tool poses"
            self.out.judge(r, _FORWARD, what, "tool", cause=by)

    def passive(self, kin: Kinematics, blamed: _Blame) -> None:
        """Compare the passive joint angles of the equations with the passive joint angles of the mechanism."""
        true = self.posed.q_passive
        limit = self.tolerances.rotation
        for name, value in kin.passive_many(Ts=self.Ts, qs=self.posed.q).items():
            if name not in true:
                continue
            error = np.angle(np.exp(1j * (value - true[name])))  # modulo full turns
            r = row("A-B", "passive", name, "rad", error, limit, self.coarse, consequence_of=blamed.row)
            cause = blamed.cause or _equation_of(kin, name)
            self.out.differs(r, f"passive joint {name} differs from its value in the mechanism", cause)

    def tool(self, kin: Kinematics, q: Array, blamed: _Blame) -> None:
        """Drive the mechanism with the equations' joint values, and compare its tool pose with the requested pose."""
        if not np.isfinite(q).all():
            return
        Ts = self.trajectory.Ts_base_tool
        try:
            run = self.model.run(q, progress=lambda f: self.progress("mechanism driven by the equations", f))
        except AssemblyError as failed:
            self._no_assembly(kin, failed, blamed)
            return
        self.out.driven = run
        shift = run.Ts_base_tool[:, :3, 3] - Ts[:, :3, 3]
        self.out.series["residual_tool"] = np.linalg.norm(shift, axis=1)
        self.out.series["residual_rotation"] = np.linalg.norm(rotation_vectors(Ts, run.Ts_base_tool), axis=1)
        self.out.series["p_tool_B"] = run.Ts_base_tool[self.out.coarse, :3, 3]
        limits = (self.tolerances.position, self.tolerances.rotation)
        for r in pose_rows("A-B", "tool", Ts, run.Ts_base_tool, limits, self.clock, consequence_of=blamed.row):
            what = "the joint values of the equations do not move the mechanism's tool to the requested pose"
            self.out.differs(r, what, blamed.cause)
        self.loops(run, blamed.cause)

    def _no_assembly(self, kin: Kinematics, failed: AssemblyError, blamed: _Blame) -> None:
        """Add a finding that the mechanism cannot be assembled at the joint values of the equations."""
        what = f"the mechanism cannot be assembled at the joint values of the equations ({failed})"
        when = f"{self.clock.phase(0.0)}, from the start"
        if blamed:
            where = ", ".join(kin.joints)
            advice = f"caused by {blamed.row}; fix that first"
            found = finding("info", "tool.no_assembly", where, what, suggestion=advice, when=when, cause=blamed.cause)
        else:
            found = finding("disagreement", "tool.no_assembly", "mechanism", what, when=when, cause=blamed.cause)
        self.out.findings.append(found)

    def loops(self, run: SolvedSamples, cause: str = "") -> None:
        """Check that the loops of the driven mechanism close; `cause` names the wrong equation, if known."""
        balls = set()
        for joint in self.model.mechanism.loops:
            if joint.type == "spherical":
                balls.add(joint.name)
        for i, loop in enumerate(run.loop_names):
            what = f"loop {loop} does not close: its parts do not fit together (least-squares solution)"
            shift = run.gaps[:, i, 0]
            self.out.differs(row("B", "loop", loop, "m", shift, self.tolerances.loop, self.clock), what, cause)
            if loop not in balls:  # a ball turns freely
                turn = run.gaps[:, i, 1]
                self.out.differs(row("B", "loop", loop, "rad", turn, self.tolerances.rotation, self.clock), what, cause)


def _rates(check: _Check, states: Array) -> None:
    """Compare the tool's planned speed and acceleration with those from the constraint Jacobian of the mechanism."""
    trajectory = check.trajectory
    rows = check.out.coarse
    twist, acceleration = check.model.rates(states, trajectory.qd[rows], trajectory.qdd[rows])
    check.out.series["v_tool_B"] = twist[:, :3]
    check.out.series["a_tool_B"] = acceleration[:, :3]
    planned_v, planned_a = tool_rates(trajectory)
    off_v = twist[:, :3] - planned_v[rows]
    off_w = twist[:, 3:] - trajectory.angular_velocity[rows]
    off_a = acceleration[:, :3] - planned_a[rows]
    off_dw = acceleration[:, 3:] - trajectory.angular_acceleration[rows]
    limits = check.tolerances
    kinds: tuple[tuple[RowKind, str, Array, float], ...] = (
        ("speed", "m/s", off_v, limits.speed),
        ("speed", "rad/s", off_w, 10 * limits.speed),
        ("acceleration", "m/s2", off_a, limits.acceleration),
        ("acceleration", "rad/s2", off_dw, 10 * limits.acceleration),
    )
    for kind, unit, off, limit in kinds:
        r = row("A-B", kind, "tool", unit, off, limit, check.coarse)
        check.out.differs(r, f"the tool's planned {kind} differs from its {kind} in the mechanism")
