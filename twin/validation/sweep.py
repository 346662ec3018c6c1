"""One joint through its whole stroke: where the equations put the tool, and where the mechanism has it.

Beside it, what two common stand-ins for the loops would have cost. Both are fitted to the mechanism, as well
as their form allows, so the figures are the least that each can be off:

    mimic    no loop: every passive joint between base and tool follows the driven one along a straight line,
             multiplier * q + offset, as URDF's <mimic> has it
    serial   no linkage: the tool turns about one fixed pivot by its true angle; where it does not turn, it
             moves along one straight line
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, KinematicsError, TwinError
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.reference import ReferenceModel, Run
from twin.validation.rows import Tolerances, rotation_vectors

STANDINS = ("serial", "mimic")

_STILL = 1e-9
"""Change (m, rad, or quaternion) below which a coordinate does not move."""


@dataclass(frozen=True)
class Curve:
    """What one model of the tool is off by, against the mechanism.

    Attributes:
        offset: (k, 3) in m, in base.
        turn: (k,) rad.
        note: how it was fitted, or why there is none (then both are empty).
    """

    offset: Array
    turn: Array
    note: str = ""

    @property
    def distance(self) -> Array:
        """Length (k,) of the offset in m."""
        return np.linalg.norm(self.offset, axis=1)

    def as_dict(self) -> dict[str, Any]:
        """Return mean, standard deviation and worst, SI; None where there is no curve."""
        if not len(self.offset):
            return {"note": self.note, "position_max": None}
        d = self.distance
        return {
            "note": self.note,
            "position_mean": float(d.mean()),
            "position_std": float(d.std()),
            "position_max": float(d.max()),
            "component_mean": self.offset.mean(axis=0).tolist(),
            "rotation_max": float(self.turn.max()),
        }


@dataclass(frozen=True)
class Sweep:
    """One stroke.

    Attributes:
        joint: the joint that moves. angle: whether it is one.
        q: (k,) its values in m or rad; the others stand at home.
        stroke: the limits that were asked for; `q` is the part around home that can be reached.
        gap: worst loop gap in m.
        formula: the equations against the mechanism.
        standins: the stand-ins against the mechanism, by name.
        tolerance: position in m and rotation in rad that count as agreement.
    """

    joint: str
    angle: bool
    q: Array
    stroke: tuple[float, float]
    gap: float
    formula: Curve
    standins: Mapping[str, Curve]
    tolerance: tuple[float, float]

    @property
    def agrees(self) -> bool:
        """Whether equations and mechanism agree over the stroke."""
        worst = self.formula.as_dict()
        return bool(worst["position_max"] <= self.tolerance[0] and worst["rotation_max"] <= self.tolerance[1])

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, SI."""
        return {
            "joint": self.joint,
            "unit": "rad" if self.angle else "m",
            "from": float(self.q[0]),
            "to": float(self.q[-1]),
            "stroke": list(self.stroke),
            "samples": len(self.q),
            "loop_gap": self.gap,
            "agrees": self.agrees,
            "formula": self.formula.as_dict(),
            **{name: curve.as_dict() for name, curve in self.standins.items()},
        }


def sweep(
    kin: Kinematics,
    model: ReferenceModel,
    joint: str,
    home: Array,
    standins: tuple[str, ...] = (),
    samples: int = 501,
    tolerances: Tolerances | None = None,
    progress: Callable[[float], None] | None = None,
) -> Sweep:
    """Return the sweep of one active joint from limit to limit, the others at home (n,).

    Raises:
        TwinError: the joint has no limits, or nothing of its stroke can be reached.
    """
    i = kin.joints.index(joint)
    limits = model.mechanism.joint(joint).limits
    if limits is None:
        raise TwinError(f"joint '{joint}' has no limits: there is no stroke to sweep; add a [[limit]]")
    tolerances = tolerances or Tolerances()
    q = np.tile(home, (samples, 1))
    q[:, i] = np.linspace(*limits, samples)
    start = model.solve(home)
    Ts = _formula(kin, q, i, home, start.T_base_tool)
    q, Ts, run = _reachable(kin, model, q, Ts, i, home)
    if progress is not None:
        progress(1.0)
    formula = Curve(
        Ts[:, :3, 3] - run.Ts_base_tool[:, :3, 3], np.linalg.norm(rotation_vectors(run.Ts_base_tool, Ts), axis=1)
    )
    makers = {"mimic": lambda: _mimic(model, run, q[:, i]), "serial": lambda: _serial(run.Ts_base_tool, q[:, i])}
    return Sweep(
        joint,
        bool(kin.revolute[i]),
        q[:, i],
        limits,
        float(run.gaps[..., 0].max(initial=0.0)),
        formula,
        {name: makers[name]() for name in standins},
        (tolerances.position, tolerances.rotation),
    )


def _formula(kin: Kinematics, q: Array, i: int, home: Array, T_home: Array) -> Array:
    """Return the equations' tool poses (k, 4, 4), walked outwards from home; NaN where there is none."""
    if kin.closed_forward:
        return kin.forward_many(q)
    middle = int(np.argmin(np.abs(q[:, i] - home[i])))
    seed = kin.forward(home, T_home)
    up, down = kin.forward_many(q[middle:], seed), kin.forward_many(q[middle::-1], seed)
    return np.concatenate([down[::-1][:-1], up])


def _reachable(
    kin: Kinematics, model: ReferenceModel, q: Array, Ts: Array, i: int, home: Array
) -> tuple[Array, Array, Run]:
    """Return the unbroken part around home where equations and mechanism both have an answer."""
    good = np.asarray(np.isfinite(Ts).all(axis=(1, 2)), bool)
    if not good.any():
        raise KinematicsError(f"the equations have no answer anywhere on the stroke of '{kin.joints[i]}'")
    for alarm in kin.singularity_alarm(Ts, q).values():
        good = np.logical_and(good, ~alarm)
    if not good.any():
        raise TwinError(f"the whole stroke of '{kin.joints[i]}' is singular with the other joints at home")
    middle = int(np.argmin(np.where(good, np.abs(q[:, i] - home[i]), np.inf)))
    first, last = middle, middle
    while first > 0 and good[first - 1]:
        first -= 1
    while last < len(q) - 1 and good[last + 1]:
        last += 1
    while True:
        if last - first < 2:
            raise TwinError(f"joint '{kin.joints[i]}' cannot move from home: nothing to sweep")
        try:
            down = model.run(q[middle : first - 1 if first else None : -1])
            up = model.run(q[middle : last + 1])
            break
        except AssemblyError:  # the mechanism ends before the equations do: come in from both sides
            first, last = (first + middle + 1) // 2, (last + middle) // 2
    states = np.concatenate([down.x[::-1][:-1], up.x])
    return q[first : last + 1], Ts[first : last + 1], model.collect(states)


def _mimic(model: ReferenceModel, run: Run, q: Array) -> Curve:
    """Return what straight lines in place of the loops cost."""
    tree = model.tree
    index = {n: c for n, c in tree.configuration.items() if n not in {j.name for j in model.mechanism.active}}
    scalar = set(index.values()) | {tree.configuration[j.name] for j in model.mechanism.active}
    mechanism = model.mechanism
    path = [j.name for j in mechanism.path(mechanism.frame(mechanism.tool).body)]
    for joint in path:
        k = tree.model.joints[tree.joint_id[joint]].idx_q if joint in tree.joint_id else -1
        if k >= 0 and k not in scalar and np.ptp(run.x[:, k : k + 4], axis=0).max() > _STILL:
            return Curve(
                np.zeros((0, 3)), np.zeros(0), f"none: joint '{joint}' between base and tool has no single coordinate"
            )
    states, lines = run.x.copy(), []
    for name, k in index.items():
        if name in path and np.ptp(run.x[:, k]) > _STILL:
            slope, offset = np.polyfit(q, run.x[:, k], 1)
            states[:, k] = slope * q + offset
            lines.append(f"{name} = {slope:.5g} q {offset:+.5g}")
    poses, _ = tree.update(states)
    Ts, true = tree.tool(poses), run.Ts_base_tool
    return Curve(
        Ts[:, :3, 3] - true[:, :3, 3],
        np.linalg.norm(rotation_vectors(true, Ts), axis=1),
        "; ".join(lines) or "exact: no passive joint between base and tool moves",
    )


def _serial(true: Array, q: Array) -> Curve:
    """Return what one fixed pivot (or one straight line) costs: the least-squares one, p = c + R r."""
    R, p = true[:, :3, :3], true[:, :3, 3]
    k = len(p)
    if spatial.rotation_angle(np.swapaxes(R[:1], 1, 2) @ R).max() < _STILL:
        A = np.column_stack([np.ones(k), q])
        fitted = A @ np.linalg.lstsq(A, p, rcond=None)[0]
        return Curve(fitted - p, np.zeros(k), "a straight line: the tool does not turn")
    A = np.concatenate([np.tile(np.eye(3), (k, 1, 1)), R], axis=2).reshape(3 * k, 6)
    x = np.linalg.lstsq(A, p.reshape(-1), rcond=None)[0]
    axis = np.linalg.svd(spatial.log_so3(R @ R[k // 2].T))[2][0]
    c = x[:3] - axis * (axis @ x[:3])
    return Curve((A @ x).reshape(k, 3) - p, np.zeros(k), f"pivot at ({', '.join(f'{v * 1e3:.2f}' for v in c)}) mm")
