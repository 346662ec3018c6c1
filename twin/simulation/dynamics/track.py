"""Computed torque control of an arm along a motion, and what a wrong model costs at the tip.

    torque = M(q) [qdd_d + Kv (qd_d - qd) + Kp (q_d - q)] + C(q, qd) qd + g(q) + F qd,   Kp = w^2, Kv = 2 w

Model and plant are two things. The plant is the arm of the file; the controller's model may be wrong in masses and
tensors (rotors are taken as known) and in friction. The controller sees the joints once a tick, whole or in encoder
steps, and its torque is held until the next tick. With an exact model that hold is what limits it: a torque that is
right when the tick begins is half a tick old on average, and friction, gravity and acceleration have moved on. So
the equations are evaluated where the arm will be in the middle of the tick (`Conditions.middle`); what is measured
and fed back is not changed by that. Errors are those of the true joints at the ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.spatial import Array
from twin.simulation.dynamics.inertia import Arm
from twin.simulation.dynamics.model import Dynamics, ModelPlant, poses, signs
from twin.simulation.dynamics.plant import STEP, MujocoPlant

ENCODER = 2 * np.pi / (4096 * 4 * 50)
"""rad at the link of one encoder step: 4096 lines, read fourfold, gear of 50. ASSUMED: the encoders of the PA-10 are
not published; the gear follows from the rotors at motor and link."""

EXACT_LIMIT, TIP_LIMIT = 10e-6, 1e-3
"""Metres of tip error: with an exact model, where only the hold of one tick is left; and as the paper reports."""

_LOST = 1.0
"""rad of joint error beyond which nothing follows anything."""

PlantName = Literal["mujoco", "pinocchio"]


@dataclass(frozen=True)
class Conditions:
    """All that a tracking error depends on besides the motion.

    Attributes:
        rate: ticks of the controller per second.
        w: rad/s, Kp = w^2, Kv = 2 w for each joint.
        inertia_error: masses and tensors of the controller's model are wrong by this fraction.
        signs: None: all links too heavy (for a positive error). Otherwise the seed of a sign for each link.
        friction_known: the model has the plant's friction.
        friction_error: by which fraction the model's friction is wrong if it is not known; with `signs` by chance.
        quantisation: encoder step in rad; 0: true positions and true velocities.
        velocity_cutoff: Hz, of the first-order low-pass on differences of quantised positions.
        saturation: torques stop at the limits of the drives.
        middle: the equations are evaluated for the middle of the tick rather than for its beginning.
        plant: "mujoco" (independent of the model), or "pinocchio" (the model's own equations).
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
        """Return the same with a wrong model: inertia by a fraction, friction not known, joints in encoder steps."""
        return replace(self, inertia_error=inertia_error, signs=signs, friction_known=False, quantisation=ENCODER)


@dataclass(frozen=True)
class Motion:
    """What the arm shall do, one row a tick.

    Attributes:
        t: (k,) s, equally spaced.
        q, qd, qdd: (k, n) in rad, rad/s, rad/s2.
        T_last_tip: (4, 4) tip in the last joint frame.
        shaft: (3,) direction of the instrument in the tip frame.
        rcm: (k, 3) in base in m, the point that the shaft shall keep to; NaN where there is none. Or None.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    T_last_tip: Array
    shaft: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    rcm: Array | None = None


@dataclass(frozen=True)
class Run:
    """One motion under control.

    Attributes:
        conditions: under which.
        t: (k,) s.
        tip_error: (k,) m, between the tip and where it should be.
        joint_error: (k, n) rad, desired less true.
        rcm_error: (k,) m, from the RCM to the true shaft; NaN where there is none.
        torque: (k, n) N m, as applied from this tick on.
        saturated: (k, n) bool, where the drive's limit cut the torque.
    """

    conditions: Conditions
    t: Array
    tip_error: Array
    joint_error: Array
    rcm_error: Array
    torque: Array
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
        """Largest distance from RCM to shaft in m; None if there never is an RCM."""
        seen = self.rcm_error[np.isfinite(self.rcm_error)]
        return float(seen.max()) if seen.size else None

    def as_dict(self) -> dict[str, Any]:
        """Return conditions and largest errors as plain data."""
        return {
            "conditions": vars(self.conditions),
            "tip_max_m": self.tip_max,
            "tip_rms_m": self.tip_rms,
            "rcm_max_m": self.rcm_max,
            "saturated_ticks": int(self.saturated.any(axis=1).sum()),
        }


@dataclass(frozen=True)
class TorqueRow:
    """Torques of one joint in N m; `margin` is what is left of the limit at the peak, as a part of it."""

    joint: str
    peak: float
    rms: float
    limit: float

    @property
    def margin(self) -> float:
        """1 where nothing is needed, 0 at the limit, negative beyond it."""
        return 1.0 - self.peak / self.limit

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {"joint": self.joint, "peak": self.peak, "rms": self.rms, "limit": self.limit, "margin": self.margin}


class Plant(Protocol):
    """What moves under torques."""

    @property
    def q(self) -> Array:
        """Joints (n,) in rad."""
        ...

    @property
    def qd(self) -> Array:
        """Rates (n,) in rad/s."""
        ...

    def reset(self, q: ArrayLike, qd: ArrayLike) -> None:
        """Put it at q (n,) with qd (n,)."""
        ...

    def advance(self, torque: Array, duration: float) -> None:
        """Move on for a duration in s under constant torques (n,) in N m."""
        ...


def model_of(arm: Arm, conditions: Conditions = Conditions()) -> Dynamics:
    """Return the controller's model of the arm under these conditions."""
    n, c = len(arm.links), conditions
    true = Dynamics(arm.placements, arm.links, arm.rotor, arm.friction)
    # Links and frictions are wrong by separate chances.
    drawn = signs(2 * n, c.signs)
    off = 0.0 if c.friction_known else c.friction_error
    return true.altered(1.0 + c.inertia_error * drawn[:n], arm.friction * (1.0 + off * drawn[n:]))


def plant_of(arm: Arm, conditions: Conditions = Conditions()) -> Plant:
    """Return the arm as it is, in the engine that the conditions name.

    Raises:
        TwinError: there is no such engine, or it is not installed.
    """
    if conditions.plant == "mujoco":
        return MujocoPlant(arm.placements, arm.links, arm.rotor, arm.friction)
    if conditions.plant == "pinocchio":
        return ModelPlant(Dynamics(arm.placements, arm.links, arm.rotor, arm.friction), STEP)
    raise TwinError(f"there is no plant '{conditions.plant}'. Known: mujoco, pinocchio.")


def run(arm: Arm, motion: Motion, conditions: Conditions = Conditions()) -> Run:
    """Return what the arm does under computed torque control; it starts where it should be.

    Raises:
        TwinError: the motion does not fit the arm or the rate, or the arm is lost on the way.
    """
    c, tick = conditions, 1.0 / conditions.rate
    k, n = _checked(arm, motion, c)
    if not (c.w > 0 and c.velocity_cutoff > 0 and c.quantisation >= 0):
        raise TwinError(f"w = {c.w:g} rad/s and the cut-off of {c.velocity_cutoff:g} Hz must be above 0")
    if abs(tick / STEP - round(tick / STEP)) > 1e-9:
        raise TwinError(f"a rate of {c.rate:g} Hz is no whole number of steps of {STEP * 1e3:g} ms")
    model, plant, half = model_of(arm, c), plant_of(arm, c), 0.5 * tick * c.middle
    limit = arm.torque if c.saturation else np.full(n, np.inf)
    ahead = 0.5 * (motion.qdd + np.vstack([motion.qdd[1:], motion.qdd[-1:]])) if c.middle else motion.qdd
    Kp, Kv, blend = c.w**2, 2 * c.w, 1.0 - np.exp(-2 * np.pi * c.velocity_cutoff * tick)
    plant.reset(motion.q[0], motion.qd[0])
    qs, torques, cut = np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n), bool)
    before, rate = _measured(motion.q[0], c.quantisation), motion.qd[0]
    for i in range(k):
        qs[i] = plant.q
        if not np.abs(motion.q[i] - qs[i]).max() < _LOST:  # also what is not finite
            raise TwinError(
                f"at {motion.t[i]:.3f} s a joint is more than {_LOST:g} rad from where it should be: the drives are "
                f"too weak for this motion, or w = {c.w:g} rad/s is unstable at {c.rate:g} Hz"
            )
        seen = _measured(qs[i], c.quantisation)
        if c.quantisation:
            if i:
                rate = rate + blend * ((seen - before) / tick - rate)
            before = seen
        else:
            rate = plant.qd
        wish = ahead[i] + Kv * (motion.qd[i] - rate) + Kp * (motion.q[i] - seen)
        asked = model.inverse(seen + half * rate, rate + half * ahead[i], wish)
        torques[i] = np.clip(asked, -limit, limit)
        cut[i] = torques[i] != asked
        plant.advance(torques[i], tick)
    tip, wanted = (poses(arm.placements, q, motion.T_last_tip) for q in (qs, motion.q))
    error = np.linalg.norm(tip[:, :3, 3] - wanted[:, :3, 3], axis=1)
    beside = np.full(k, np.nan)
    if motion.rcm is not None:
        beside = spatial.point_to_line(motion.rcm, tip[:, :3, 3], tip[:, :3, :3] @ motion.shaft)
    return Run(c, motion.t, error, motion.q - qs, beside, torques, cut)


def curve(
    arm: Arm,
    motion: Motion,
    fractions: Sequence[float],
    conditions: Conditions = Conditions(),
    progress: Callable[[float], None] = lambda part: None,
) -> list[Run]:
    """Return a run for each inertia error; everything else as in the conditions."""
    out = []
    for i, fraction in enumerate(fractions):
        out.append(run(arm, motion, replace(conditions, inertia_error=float(fraction))))
        progress((i + 1) / len(fractions))
    return out


def torque_table(arm: Arm, *runs: Run) -> list[TorqueRow]:
    """Return peak and root mean square torque of each joint over all runs, against its limit."""
    torque = np.vstack([r.torque for r in runs])
    peak, rms = np.abs(torque).max(axis=0), np.sqrt(np.mean(torque**2, axis=0))
    return [
        TorqueRow(name, float(p), float(r), float(limit))
        for name, p, r, limit in zip(arm.joints, peak, rms, arm.torque, strict=True)
    ]


def _measured(q: Array, step: float) -> Array:
    """Return joints as the encoder gives them."""
    return step * np.round(q / step) if step else q


def _checked(arm: Arm, motion: Motion, c: Conditions) -> tuple[int, int]:
    """Return the shape (k, n) of a motion that fits the arm and the rate."""
    k, n = len(motion.t), len(arm.links)
    for name, values in (("q", motion.q), ("qd", motion.qd), ("qdd", motion.qdd)):
        if values.shape != (k, n) or not np.isfinite(values).all():
            raise TwinError(f"motion: {name} must be {k} rows of {n} finite numbers, not {values.shape}")
    if k < 2 or np.abs(np.diff(motion.t) * c.rate - 1).max() > 1e-6:
        raise TwinError(f"motion: its samples are not one tick of {1e3 / c.rate:g} ms apart")
    return k, n
