"""Simulate computed-torque control of a robot along a motion, and the tip error caused by model mismatch.

    effort = M(q) [qdd_d + Kv (qd_d - qd) + Kp (q_d - q)] + C(q, qd) qd + g(q) + F qd,   Kp = w^2, Kv = 2 w

The plant has the robot's stated parameters. The controller's model may have wrong masses, tensors (rotors are assumed
known) and friction. The controller reads the joints once per tick, exactly or in encoder steps; its efforts are
constant until the next tick. With an exact model, constant efforts are the only cause of errors: an effort that is
correct at the start of a tick is on average half a tick old, while friction, gravity and acceleration change. Therefore
the equations are evaluated at the state predicted for the middle of the tick (`Conditions.middle`); measurement and
feedback are unchanged. Efforts are commanded to the motors, which saturate at their limits. Errors are computed from
the true joint values at the ticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.progress import StepProgress, silent_step
from twin.core.spatial import Array
from twin.reference.dynamics import Dynamics, SharedLoops
from twin.reference.loops import LENGTH_SCALE
from twin.simulation.dynamics.arm import Arm
from twin.simulation.dynamics.effort_plants import STEP, ModelPlant, MujocoPlant, Plant

ENCODER = 2 * np.pi / (4096 * 4 * 50)
"""Rotation of the link in rad for one encoder step: 4096 lines, fourfold evaluation, gear ratio 50.

ASSUMED: the encoders of the PA-10 are not published; the gear ratio follows from the rotor inertias at motor and link.
A prismatic joint has steps of this number times `LENGTH_SCALE` in m.
"""

EXACT_LIMIT = 10e-6
"""Limit of the tip error in m for an exact model, whose only errors come from constant efforts within a tick."""

TIP_LIMIT = 1e-3
"""Limit of the tip error in m for a wrong model: the value of the paper."""

_LOST = 1.0
"""Joint error in rad above which a run is stopped as divergent; for a length, times `LENGTH_SCALE`, in m."""

_OFTEN = 200
"""Number of ticks between two progress reports."""

PlantName = Literal["mujoco", "pinocchio"]


@dataclass(frozen=True)
class Conditions:
    """Conditions of a run, except the motion.

    Attributes:
        rate: rate of the controller in Hz (ticks per second).
        w: control bandwidth in rad/s: Kp = w^2 and Kv = 2 w for each joint.
        inertia_error: relative error of masses and tensors in the controller's model.
        signs: seed of random signs of the errors, one sign per body; None: all errors have the sign of `inertia_error`
            (positive: too heavy).
        friction_known: whether the model has the plant's friction.
        friction_error: relative error of the model's friction if `friction_known` is False; with a seed `signs`, the
            sign of this error is random for each joint.
        quantisation: encoder step in rad for angles, and `LENGTH_SCALE` times this number in m for lengths; 0: exact
            positions and velocities.
        velocity_cutoff: cut-off frequency in Hz of the first-order low-pass for velocities, which are computed from
            quantised positions.
        saturation: whether efforts are limited to the limits of the motors.
        middle: whether the equations are evaluated for the middle of the tick instead of the start of the tick.
        plant: "mujoco" (independent of the model) or "pinocchio" (the model's own equations).
    """

    rate: float = 1000.0
    w: float = 80.0
    inertia_error: float = 0.0
    signs: int | None = None
    friction_known: bool = True
    friction_error: float = 0.2
    quantisation: float = 0.0
    velocity_cutoff: float = 100.0
    saturation: bool = True
    middle: bool = True
    plant: PlantName = "mujoco"

    def realistic(self, inertia_error: float, signs: int | None = None) -> Conditions:
        """Return these conditions with a wrong model: the given inertia error, unknown friction, and encoder steps."""
        return replace(self, inertia_error=inertia_error, signs=signs, friction_known=False, quantisation=ENCODER)


@dataclass(frozen=True)
class DesiredMotion:
    """The desired motion, one row per tick.

    Attributes:
        t: (k,) times in s, equally spaced.
        q, qd, qdd: (k, n) joint values in rad or m, and their derivatives per s and per s2.
        T_tool_tip: (4, 4) pose of the tip in the tool frame.
        shaft: (3,) direction of the instrument in the tip frame.
        rcm: (k, 3) position of the RCM in base in m, NaN at times without RCM; the shaft must pass through the RCM.
            None: no RCM.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    T_tool_tip: Array = field(default_factory=lambda: np.eye(4))
    shaft: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    rcm: Array | None = None


@dataclass(frozen=True)
class Run:
    """Simulated motion under control.

    Attributes:
        conditions: conditions of the run.
        t: (k,) times in s.
        tip_error: (k,) distance in m of the tip from its desired position.
        joint_error: (k, n) desired minus true joint values, in rad or m.
        rcm_error: (k,) distance in m from the RCM to the true shaft; NaN without RCM.
        effort: (k, n) motor efforts in N m or N, applied from this tick to the next.
        saturated: (k, n) bool, whether the motor's limit reduced the effort.
    """

    conditions: Conditions
    t: Array
    tip_error: Array
    joint_error: Array
    rcm_error: Array
    effort: Array
    saturated: np.ndarray

    @property
    def tip_max(self) -> float:
        """Largest tip error in m."""
        return float(self.tip_error.max())

    @property
    def tip_rms(self) -> float:
        """Root mean square of the tip error in m."""
        return float(np.sqrt(np.mean(self.tip_error**2)))

    @property
    def rcm_max(self) -> float | None:
        """Largest distance in m from the RCM to the shaft; None if there is no RCM during the motion."""
        distances = self.rcm_error[np.isfinite(self.rcm_error)]
        if not distances.size:
            return None
        return float(distances.max())

    def as_dict(self) -> JsonObject:
        """Return the conditions, the tip and RCM errors, and the number of saturated ticks as plain data."""
        return {
            "conditions": vars(self.conditions),
            "tip_max_m": self.tip_max,
            "tip_rms_m": self.tip_rms,
            "rcm_max_m": self.rcm_max,
            "saturated_ticks": int(self.saturated.any(axis=1).sum()),
        }


@dataclass(frozen=True)
class EffortRow:
    """Efforts of one motor in N m or N; a directly driven joint is its own motor. `limit` is None if unknown."""

    joint: str
    unit: str
    peak: float
    rms: float
    limit: float | None

    @property
    def margin(self) -> float | None:
        """Relative margin at the peak: 1 for zero effort, 0 at the limit, negative beyond; None without a limit."""
        if self.limit is None:
            return None
        return 1.0 - self.peak / self.limit

    def as_dict(self) -> JsonObject:
        """Return plain data."""
        return {**vars(self), "margin": self.margin}


def model_of(arm: Arm, conditions: Conditions = Conditions()) -> Dynamics:
    """Return the controller's model of the robot under the given conditions."""
    bodies = len(arm.masses)
    joints = len(arm.friction)
    # The errors of masses and of frictions are independent.
    error_signs = _signs(bodies + joints, conditions.signs)
    friction_error = 0.0 if conditions.friction_known else conditions.friction_error
    mass_factors = 1.0 + conditions.inertia_error * error_signs[:bodies]
    friction_factors = 1.0 + friction_error * error_signs[bodies:]
    return arm.dynamics(mass_factors, arm.friction * friction_factors)


def _signs(n: int, seed: int | None) -> Array:
    """Return n signs: all +1 if seed is None, otherwise random +1 or -1."""
    if seed is None:
        return np.ones(n)
    return np.random.default_rng(seed).choice([-1.0, 1.0], n)


def plant_of(arm: Arm, conditions: Conditions = Conditions()) -> Plant:
    """Return the plant, with the true parameters, in the simulation engine that the conditions select.

    Raises:
        TwinError: the engine is unknown or not installed, or the robot has no MJCF.
    """
    if conditions.plant == "mujoco":
        if not arm.mjcf:
            raise TwinError(
                f"{arm.mechanism.name}: MuJoCo needs the robot as MJCF; without it, use the plant 'pinocchio'"
            )
        joint_names = [joint.name for joint in arm.mechanism.active]
        return MujocoPlant(arm.mjcf, joint_names, arm.rotor, arm.friction)
    if conditions.plant == "pinocchio":
        return ModelPlant(arm.dynamics())
    raise TwinError(f"there is no plant '{conditions.plant}'. Known: mujoco, pinocchio.")


def run(
    arm: Arm,
    motion: DesiredMotion,
    conditions: Conditions = Conditions(),
    progress: StepProgress = silent_step,
) -> Run:
    """Simulate the robot under computed-torque control along a motion; return errors and efforts.

    See `side_by_side`, for one set of conditions.
    """
    return side_by_side(arm, motion, [conditions], progress)[0]


def side_by_side(
    arm: Arm,
    motion: DesiredMotion,
    conditions: Sequence[Conditions],
    progress: StepProgress = silent_step,
) -> list[Run]:
    """Simulate the robot under several conditions, tick by tick together; return a run for each of them.

    The runs do not affect each other. In each tick, the loops of the controllers' models are closed for all runs at
    once, which takes hardly longer than for one. The robot starts with the joint values and rates of the first sample
    of the motion. `progress` is called with the fraction done.

    Raises:
        TwinError: the motion does not fit the robot or the control rate, or the robot diverges.
    """
    for condition in conditions:
        _check_motion(arm, motion, condition)
        _check_control(condition)
    sample_count, joint_count = motion.q.shape
    # One rad of an angle counts as much as LENGTH_SCALE of a length, for the encoder steps and the divergence.
    joint_scale = np.ones(joint_count)
    for i, joint in enumerate(arm.mechanism.active):
        if not joint.is_angle:
            joint_scale[i] = LENGTH_SCALE
    controls = _Controls(arm, motion, conditions, joint_scale)
    loops = SharedLoops(controls.models)
    for i in range(sample_count):
        if i % _OFTEN == 0:
            progress(i / sample_count)
        q, qd, qdd = controls.wishes(i)
        efforts = loops.efforts(q, qd, qdd)
        controls.act(i, arm.mechanism.motor_efforts(efforts))
    return controls.runs()


class _Controls:
    """Runs side by side: their controllers, encoders and plants, and what they have done so far.

    Attributes:
        models: the model of each controller.
    """

    def __init__(self, arm: Arm, motion: DesiredMotion, conditions: Sequence[Conditions], joint_scale: Array) -> None:
        """Set the plants to the first sample of the motion; `joint_scale` (n,): see `side_by_side`."""
        self._conditions = conditions
        self.models = []
        for condition in conditions:
            self.models.append(model_of(arm, condition))
        self._arm = arm
        self._motion = motion
        self._joint_scale = joint_scale
        # the same for all runs: the motion has one sample per tick
        self._tick = 1.0 / conditions[0].rate
        # a row for each run from here on
        self._w = np.zeros((len(conditions), 1))
        # Time in s by which the state of the equations is ahead of the tick; see the head of the file.
        self._lead = np.zeros((len(conditions), 1))
        self._limit = np.full((len(conditions), len(joint_scale)), np.inf)
        self._plants: list[Plant] = []
        for i, condition in enumerate(conditions):
            self._w[i] = condition.w
            if condition.middle:
                self._lead[i] = 0.5 * self._tick
            if condition.saturation:
                self._limit[i] = arm.limit
            plant = plant_of(arm, condition)
            plant.reset(motion.q[0], motion.qd[0])
            self._plants.append(plant)
        self._encoders = _Encoders(conditions, joint_scale, motion.q[0], motion.qd[0])
        # (k, runs, n)
        shape = (len(motion.q), len(conditions), len(joint_scale))
        self._desired_qdd = self._mean_accelerations()
        self._q = np.zeros(shape)
        self._efforts = np.zeros(shape)
        self._saturated = np.zeros(shape, bool)

    def _mean_accelerations(self) -> Array:
        """Return the desired accelerations (k, runs, n): in the middle of the tick, or at its start."""
        at_start = self._motion.qdd
        next_qdd = np.vstack([at_start[1:], at_start[-1:]])
        in_middle = 0.5 * (at_start + next_qdd)
        desired = []
        for condition in self._conditions:
            desired.append(in_middle if condition.middle else at_start)
        return np.stack(desired, axis=1)

    def wishes(self, i: int) -> tuple[Array, Array, Array]:
        """Read the encoders in tick i; return states q, qd of the equations and accelerations to reach, (runs, n)."""
        motion = self._motion
        true_q = np.array([plant.q for plant in self._plants])
        true_qd = np.array([plant.qd for plant in self._plants])
        self._q[i] = true_q
        _check_convergence(motion, i, true_q, self._joint_scale, self._conditions)
        measured_q, rate = self._encoders.read(true_q, true_qd)
        rate_error = motion.qd[i] - rate
        position_error = motion.q[i] - measured_q
        desired = self._desired_qdd[i]
        wished_qdd = desired + 2 * self._w * rate_error + self._w**2 * position_error
        return measured_q + self._lead * rate, rate + self._lead * desired, wished_qdd

    def act(self, i: int, commanded: Array) -> None:
        """Let the motors act with the commanded efforts (runs, n), within their limits, until the next tick."""
        efforts = np.minimum(np.maximum(commanded, -self._limit), self._limit)
        self._efforts[i] = efforts
        self._saturated[i] = efforts != commanded
        for plant, joint_efforts in zip(self._plants, self._arm.joint_efforts(efforts), strict=True):
            plant.advance(joint_efforts, self._tick)

    def runs(self) -> list[Run]:
        """Return the errors of the completed runs."""
        motion = self._motion
        desired_tips = self.models[0].tools(motion.q) @ motion.T_tool_tip
        runs = []
        for i, (conditions, model) in enumerate(zip(self._conditions, self.models, strict=True)):
            true_q = self._q[:, i]
            true_tips = model.tools(true_q) @ motion.T_tool_tip
            tip_error = np.linalg.norm(true_tips[:, :3, 3] - desired_tips[:, :3, 3], axis=1)
            rcm_error = np.full(len(motion.t), np.nan)
            if motion.rcm is not None:
                shafts = true_tips[:, :3, :3] @ motion.shaft
                rcm_error = spatial.point_to_line(motion.rcm, true_tips[:, :3, 3], shafts)
            joint_error = motion.q - true_q
            efforts = self._efforts[:, i]
            saturated = self._saturated[:, i]
            runs.append(Run(conditions, motion.t, tip_error, joint_error, rcm_error, efforts, saturated))
        return runs


class _Encoders:
    """Joint values and rates as the controllers of several runs read them, once per tick; all arrays (runs, n)."""

    def __init__(self, conditions: Sequence[Conditions], joint_scale: Array, q: Array, qd: Array) -> None:
        """Store the start, joint values q (n,) and rates qd (n,); `joint_scale` (n,) multiplies the encoder steps."""
        quantisation = np.zeros((len(conditions), 1))
        cutoff = np.zeros((len(conditions), 1))
        for i, condition in enumerate(conditions):
            quantisation[i] = condition.quantisation
            cutoff[i] = condition.velocity_cutoff
        self._tick = 1.0 / conditions[0].rate
        # share of the difference that the first-order low-pass adds in each tick
        self._share = 1.0 - np.exp(-2 * np.pi * cutoff * self._tick)
        self._is_exact = quantisation == 0
        self._step = np.where(self._is_exact, 1.0, quantisation) * joint_scale
        self._q = self._measured(q)
        self._rate = np.tile(qd, (len(conditions), 1))
        self._is_first = True

    def read(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Return measured joint values and rates for the true ones; without encoder steps, the true ones."""
        measured = self._measured(q)
        # The first tick has no earlier position; its rate is that of the start.
        if not self._is_first:
            difference_quotient = (measured - self._q) / self._tick
            self._rate = self._rate + self._share * (difference_quotient - self._rate)
        self._is_first = False
        self._q = measured
        return measured, np.where(self._is_exact, qd, self._rate)

    def _measured(self, q: Array) -> Array:
        """Return joint values in multiples of the encoder steps; without encoder steps, the true ones."""
        return np.where(self._is_exact, q, self._step * np.round(q / self._step))


def curve(
    arm: Arm,
    motion: DesiredMotion,
    fractions: Sequence[float],
    conditions: Conditions = Conditions(),
    progress: StepProgress = silent_step,
) -> list[Run]:
    """Return one run for each inertia error in `fractions`; the other conditions are unchanged."""
    changed = []
    for fraction in fractions:
        changed.append(replace(conditions, inertia_error=float(fraction)))
    return side_by_side(arm, motion, changed, progress)


def effort_table(arm: Arm, *runs: Run) -> list[EffortRow]:
    """Return peak effort, root-mean-square effort and effort limit of each motor, over all runs."""
    efforts = np.vstack([run.effort for run in runs])
    peaks = np.abs(efforts).max(axis=0)
    rms = np.sqrt(np.mean(efforts**2, axis=0))
    units = arm.effort_units
    rows = []
    for i, motor in enumerate(arm.motors):
        limit = float(arm.limit[i])
        known_limit = limit if np.isfinite(limit) else None
        rows.append(EffortRow(motor, units[i], float(peaks[i]), float(rms[i]), known_limit))
    return rows


def _check_motion(arm: Arm, motion: DesiredMotion, conditions: Conditions) -> None:
    """Raise `TwinError` if a motion does not fit the robot and the control rate."""
    k = len(motion.t)
    n = len(arm.friction)
    for name, values in (("q", motion.q), ("qd", motion.qd), ("qdd", motion.qdd)):
        if values.shape != (k, n) or not np.isfinite(values).all():
            raise TwinError(f"motion: {name} {values.shape} must be {k} rows of {n} finite numbers")
    if k < 2 or np.abs(np.diff(motion.t) * conditions.rate - 1).max() > 1e-6:
        raise TwinError(f"motion: the time between two samples is not one tick of {1e3 / conditions.rate:g} ms")


def _check_control(conditions: Conditions) -> None:
    """Raise `TwinError` for impossible parameters, or if a tick is not a whole number of integration steps."""
    c = conditions
    if not (c.w > 0 and c.velocity_cutoff > 0 and c.quantisation >= 0):
        raise TwinError(
            f"w = {c.w:g} rad/s and the cut-off of {c.velocity_cutoff:g} Hz must be above 0, and the encoder step of "
            f"{c.quantisation:g} rad at least 0"
        )
    steps = 1.0 / c.rate / STEP
    # far above the rounding error of the quotient, far below a step
    if abs(steps - round(steps)) > 1e-9:
        raise TwinError(f"at {c.rate:g} Hz, a control tick is not a whole number of steps of {STEP * 1e3:g} ms")


def _check_convergence(
    motion: DesiredMotion, tick: int, q: Array, joint_scale: Array, conditions: Sequence[Conditions]
) -> None:
    """Raise `TwinError` if a joint is far from its target in a tick, or is NaN, in a run; q (runs, n)."""
    errors = np.abs((motion.q[tick] - q) / joint_scale)
    # written so that NaN, which compares as False, raises too
    close = errors < _LOST
    if close.all():
        return
    condition = conditions[int(np.argmin(close.all(axis=1)))]
    raise TwinError(
        f"at {motion.t[tick]:.3f} s a joint is more than {_LOST:g} rad or {_LOST * LENGTH_SCALE:g} m from its "
        f"target: the drives are too weak for this motion, or the bandwidth w = {condition.w:g} rad/s of "
        f"the controller is unstable at {condition.rate:g} Hz"
    )
