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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.reference.dynamics import Dynamics, State
from twin.reference.loops import LENGTH_SCALE
from twin.simulation.dynamics.arm import Arm
from twin.simulation.dynamics.effort_plants import STEP, ModelPlant, MujocoPlant, Plant

ENCODER = 2 * np.pi / (4096 * 4 * 50)
"""Rotation of the link in rad for one encoder step: 4096 lines, fourfold evaluation, gear ratio 50.

ASSUMED: the encoders of the PA-10 are not published; the gear ratio follows from the rotor inertias at motor and link.
A prismatic joint has steps of this number times `LENGTH_SCALE` in m.
"""

EXACT_LIMIT, TIP_LIMIT = 10e-6, 1e-3
"""Limits of the tip error in m: `EXACT_LIMIT` for an exact model, whose only errors come from constant efforts within a
tick; `TIP_LIMIT`, the value of the paper, for a wrong model."""

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
        seen = self.rcm_error[np.isfinite(self.rcm_error)]
        return float(seen.max()) if seen.size else None

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
        return None if self.limit is None else 1.0 - self.peak / self.limit

    def as_dict(self) -> JsonObject:
        """Return plain data."""
        return {**vars(self), "margin": self.margin}


def model_of(arm: Arm, conditions: Conditions = Conditions()) -> Dynamics:
    """Return the controller's model of the robot under the given conditions."""
    c, parts, n = conditions, len(arm.masses), len(arm.friction)
    # The errors of masses and of frictions are independent.
    drawn = signs(parts + n, c.signs)
    off = 0.0 if c.friction_known else c.friction_error
    return arm.dynamics(1.0 + c.inertia_error * drawn[:parts], arm.friction * (1.0 + off * drawn[parts:]))


def signs(n: int, seed: int | None) -> Array:
    """Return n signs: all +1 if seed is None, otherwise random +1 or -1."""
    return np.ones(n) if seed is None else np.random.default_rng(seed).choice([-1.0, 1.0], n)


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
        return MujocoPlant(arm.mjcf, [j.name for j in arm.mechanism.active], arm.rotor, arm.friction)
    if conditions.plant == "pinocchio":
        return ModelPlant(arm.dynamics())
    raise TwinError(f"there is no plant '{conditions.plant}'. Known: mujoco, pinocchio.")


def run(
    arm: Arm,
    motion: DesiredMotion,
    conditions: Conditions = Conditions(),
    progress: Callable[[float], None] = lambda part: None,
) -> Run:
    """Simulate the robot under computed-torque control along a motion; return errors and efforts.

    The robot starts with the joint values and rates of the first sample of the motion. `progress` is called with the
    fraction done.

    Raises:
        TwinError: the motion does not fit the robot or the control rate, or the robot diverges.
    """
    c, tick = conditions, 1.0 / conditions.rate
    k, n = _checked(arm, motion, c)
    if not (c.w > 0 and c.velocity_cutoff > 0 and c.quantisation >= 0):
        raise TwinError(
            f"w = {c.w:g} rad/s and the cut-off of {c.velocity_cutoff:g} Hz must be above 0, and the encoder step of "
            f"{c.quantisation:g} rad at least 0"
        )
    if abs(tick / STEP - round(tick / STEP)) > 1e-9:
        raise TwinError(f"at {c.rate:g} Hz, a control tick is not a whole number of steps of {STEP * 1e3:g} ms")
    model, plant, half = model_of(arm, c), plant_of(arm, c), 0.5 * tick * c.middle
    limit = arm.limit if c.saturation else np.full(n, np.inf)
    unit = np.where([j.is_angle for j in arm.mechanism.active], 1.0, LENGTH_SCALE)
    ahead = 0.5 * (motion.qdd + np.vstack([motion.qdd[1:], motion.qdd[-1:]])) if c.middle else motion.qdd
    Kp, Kv, blend = c.w**2, 2 * c.w, 1.0 - np.exp(-2 * np.pi * c.velocity_cutoff * tick)
    step = c.quantisation * unit
    plant.reset(motion.q[0], motion.qd[0])
    qs, efforts, cut = np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n), bool)
    before, rate, state = _measured(motion.q[0], step), motion.qd[0], None
    for i in range(k):
        if i % _OFTEN == 0:
            progress(i / k)
        qs[i] = plant.q
        if not np.abs((motion.q[i] - qs[i]) / unit).max() < _LOST:  # true also for NaN
            raise TwinError(
                f"at {motion.t[i]:.3f} s a joint is more than {_LOST:g} rad or {_LOST * LENGTH_SCALE:g} m from its "
                f"target: the drives are too weak for this motion, or the bandwidth w = {c.w:g} rad/s of "
                f"the controller is unstable at {c.rate:g} Hz"
            )
        seen = _measured(qs[i], step)
        if c.quantisation:
            if i:
                rate = rate + blend * ((seen - before) / tick - rate)
            before = seen
        else:
            rate = plant.qd
        wish = ahead[i] + Kv * (motion.qd[i] - rate) + Kp * (motion.q[i] - seen)
        state: State | None = model.near(seen + half * rate, state)
        asked = model.motor_efforts(state, rate + half * ahead[i], wish)
        efforts[i] = np.clip(asked, -limit, limit)
        cut[i] = efforts[i] != asked
        plant.advance(arm.joint_efforts(efforts[i]), tick)
    tip, wanted = (model.tools(q) @ motion.T_tool_tip for q in (qs, motion.q))
    error = np.linalg.norm(tip[:, :3, 3] - wanted[:, :3, 3], axis=1)
    beside = np.full(k, np.nan)
    if motion.rcm is not None:
        beside = spatial.point_to_line(motion.rcm, tip[:, :3, 3], tip[:, :3, :3] @ motion.shaft)
    return Run(c, motion.t, error, motion.q - qs, beside, efforts, cut)


def curve(
    arm: Arm,
    motion: DesiredMotion,
    fractions: Sequence[float],
    conditions: Conditions = Conditions(),
    progress: Callable[[float], None] = lambda part: None,
) -> list[Run]:
    """Return one run for each inertia error in `fractions`; the other conditions are unchanged."""
    out = []
    for i, fraction in enumerate(fractions):
        out.append(run(arm, motion, replace(conditions, inertia_error=float(fraction))))
        progress((i + 1) / len(fractions))
    return out


def effort_table(arm: Arm, *runs: Run) -> list[EffortRow]:
    """Return peak effort, root-mean-square effort and effort limit of each motor, over all runs."""
    effort = np.vstack([r.effort for r in runs])
    peak, rms = np.abs(effort).max(axis=0), np.sqrt(np.mean(effort**2, axis=0))
    return [
        EffortRow(name, unit, float(p), float(r), float(limit) if np.isfinite(limit) else None)
        for name, unit, p, r, limit in zip(arm.motors, arm.effort_units, peak, rms, arm.limit, strict=True)
    ]


def _measured(q: Array, step: Array) -> Array:
    """Return joint values as the encoders measure them, in multiples of `step`; exact if step is 0."""
    return step * np.round(q / step) if step.all() else q


def _checked(arm: Arm, motion: DesiredMotion, c: Conditions) -> tuple[int, int]:
    """Return the shape (k, n) of a motion; raise `TwinError` if it does not fit the robot and the control rate."""
    k, n = len(motion.t), len(arm.friction)
    for name, values in (("q", motion.q), ("qd", motion.qd), ("qdd", motion.qdd)):
        if values.shape != (k, n) or not np.isfinite(values).all():
            raise TwinError(f"motion: {name} {values.shape} must be {k} rows of {n} finite numbers")
    if k < 2 or np.abs(np.diff(motion.t) * c.rate - 1).max() > 1e-6:
        raise TwinError(f"motion: the time between two samples is not one tick of {1e3 / c.rate:g} ms")
    return k, n
