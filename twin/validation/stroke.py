"""Move one joint through its stroke and compare the tool poses of equations and mechanism.

For comparison, the errors of two common simplified loop models are computed. Both models are fitted to the mechanism by
least squares:

    mimic    every passive joint between base and tool is a linear function of the driven joint,
             multiplier * q + offset, as URDF's <mimic>; fitted to the values of each passive joint
    serial   the tool rotates by its true angle about one fixed pivot or, if it does not rotate, moves along a
             straight line; fitted to the tool positions
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.errors import AssemblyError, KinematicsError, TwinError, unknown
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.reference import ReferenceModel, SolvedSamples
from twin.validation.joint_range import poses_by_inverse
from twin.validation.residual_rows import Tolerances, rotation_vectors

SIMPLIFIED_MODELS = ("serial", "mimic")

_CONSTANT_CHANGE = 1e-9
"""Change (m, rad, or quaternion component) below which a coordinate counts as constant."""


@dataclass(frozen=True)
class ErrorCurve:
    """Error of the tool pose of one model, relative to the mechanism.

    Attributes:
        offset: (k, 3) in m, position error in base.
        turn: (k,) in rad, rotation error.
        note: how the model was fitted, or why it is not available (`offset` and `turn` are then empty).
    """

    offset: Array
    turn: Array
    note: str = ""

    @property
    def distance(self) -> Array:
        """Position error (k,) in m."""
        return np.linalg.norm(self.offset, axis=1)

    def as_dict(self) -> JsonObject:
        """Return mean, standard deviation and maximum in SI units; of an empty curve only that it has no maximum."""
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
class StrokeSweep:
    """Comparison over the stroke of one joint.

    Attributes:
        joint: the moved joint.
        angle: whether the coordinate of this joint is an angle.
        q: (k,) values of the joint in m or rad; the other joints are at their home values.
        limits: the joint's limits in m or rad; `q` covers only the reachable part of this range around home.
        gap: largest loop gap, in m.
        equations: error of the equations.
        standins: errors of the simplified models, by name.
        tolerance: largest errors in m and rad that count as agreement.
    """

    joint: str
    angle: bool
    q: Array
    limits: tuple[float, float]
    gap: float
    equations: ErrorCurve
    standins: Mapping[str, ErrorCurve]
    tolerance: tuple[float, float]

    @property
    def agrees(self) -> bool:
        """Whether the equations agree with the mechanism over the stroke."""
        position_limit, rotation_limit = self.tolerance
        position = float(self.equations.distance.max())
        rotation = float(self.equations.turn.max())
        return position <= position_limit and rotation <= rotation_limit

    @property
    def curves(self) -> dict[str, ErrorCurve]:
        """Errors of the equations, then of the simplified models, by name."""
        return {"equations": self.equations, **self.standins}

    def as_dict(self) -> JsonObject:
        """Return the comparison as plain data in SI units."""
        return {
            "joint": self.joint,
            "unit": "rad" if self.angle else "m",
            "from": float(self.q[0]),
            "to": float(self.q[-1]),
            "stroke": list(self.limits),
            "samples": len(self.q),
            "loop_gap": self.gap,
            "agrees": self.agrees,
            "formula": self.equations.as_dict(),
            **{name: curve.as_dict() for name, curve in self.standins.items()},
        }


def sweep(
    kin: Kinematics,
    model: ReferenceModel,
    joint: str,
    home: Array,
    standins: tuple[str, ...] = (),
    samples: int = 501,
) -> StrokeSweep:
    """Compare equations and mechanism while one active joint moves from limit to limit.

    `home` (n,) contains the values of the other joints; `standins` names the simplified models to compute, of
    `SIMPLIFIED_MODELS`.

    Raises:
        TwinError: a simplified model is unknown, the joint has no limits, or no part of its stroke is reachable.
    """
    i = kin.joints.index(joint)
    limits = model.mechanism.joint(joint).limits
    if limits is None:
        raise TwinError(f"joint '{joint}' has no limits, so its stroke is unknown; add a [[limit]] to the TOML file")
    tolerances = Tolerances()
    q = np.tile(home, (samples, 1))
    q[:, i] = np.linspace(*limits, samples)
    if kin.determined or not kin.closed_inverse:
        start = model.solve(home)
        Ts = _poses_by_equations(kin, q, i, home, start.T_base_tool)
        q, Ts, run = _reachable(kin, model, q, Ts, i, home)
    else:
        q, Ts, run = _by_inverse(kin, model, q, i, home, tolerances)
    curves: dict[str, ErrorCurve] = {}
    for name in standins:
        if name == "mimic":
            curves[name] = _mimic_error(model, run, q[:, i])
        elif name == "serial":
            curves[name] = _serial_error(run.Ts_base_tool, q[:, i])
        else:
            raise TwinError(unknown("simplified loop model", name, SIMPLIFIED_MODELS))
    return StrokeSweep(
        joint,
        angle=bool(kin.revolute[i]),
        q=q[:, i],
        limits=limits,
        gap=float(run.gaps[..., 0].max(initial=0.0)),
        equations=_error_curve(run.Ts_base_tool, Ts),
        standins=curves,
        tolerance=(tolerances.position, tolerances.rotation),
    )


def _error_curve(true: Array, Ts: Array, note: str = "") -> ErrorCurve:
    """Return the error of tool poses Ts (k, 4, 4) relative to the poses `true` of the mechanism."""
    offset = Ts[:, :3, 3] - true[:, :3, 3]
    turn = np.linalg.norm(rotation_vectors(true, Ts), axis=1)
    return ErrorCurve(offset, turn, note)


def _poses_by_equations(kin: Kinematics, q: Array, i: int, home: Array, T_home: Array) -> Array:
    """Return the equations' tool poses (k, 4, 4), solved from home towards both limits; NaN without a solution."""
    if kin.closed_forward:
        return kin.forward_many(q)
    middle = int(np.argmin(np.abs(q[:, i] - home[i])))
    seed = kin.forward(home, T_home)
    upwards = kin.forward_many(q[middle:], seed)
    downwards = kin.forward_many(q[middle::-1], seed)
    # both begin with the middle, which the result has once
    return np.concatenate([downwards[::-1][:-1], upwards])


def _by_inverse(
    kin: Kinematics, model: ReferenceModel, q: Array, i: int, home: Array, tolerances: Tolerances
) -> tuple[Array, Array, SolvedSamples]:
    """Return (joint values, tool poses, run) for an inverse alone whose joints do not determine a pose.

    The inverse is evaluated at the tool poses of the mechanism. The tool poses of the equations are those of the
    mechanism at the joint values that result.
    """
    first, last, run = _states_of_mechanism(kin, model, q, 0, len(q) - 1, i, home)
    q = q[first : last + 1]
    Ts, _ = poses_by_inverse(kin, model, run, tolerances)
    answered = np.asarray(~np.isnan(Ts).any(axis=(1, 2)), bool)
    is_regular = _is_regular(kin, run.Ts_base_tool, q, answered, i)
    first, last = _around_home(is_regular, q, i, home)
    around_home = slice(first, last + 1)
    return q[around_home], Ts[around_home], model.collect(run.x[around_home])


def _reachable(
    kin: Kinematics, model: ReferenceModel, q: Array, Ts: Array, i: int, home: Array
) -> tuple[Array, Array, SolvedSamples]:
    """Return (joint values, tool poses, run) around home, up to the first unsolved or near-singular state."""
    solved = np.asarray(np.isfinite(Ts).all(axis=(1, 2)), bool)
    is_regular = _is_regular(kin, Ts, q, solved, i)
    first, last = _around_home(is_regular, q, i, home)
    first, last, run = _states_of_mechanism(kin, model, q, first, last, i, home)
    return q[first : last + 1], Ts[first : last + 1], run


def _is_regular(kin: Kinematics, Ts: Array, q: Array, solved: np.ndarray, i: int) -> np.ndarray:
    """Return (k,) bool: whether the equations have a solution and are not near a singularity."""
    if not solved.any():
        raise KinematicsError(f"the equations have no solution anywhere on the stroke of '{kin.joints[i]}'")
    is_regular = solved
    for alarm in kin.singularity_alarm(Ts, q).values():
        is_regular = np.logical_and(is_regular, ~alarm)
    if not is_regular.any():
        raise TwinError(
            f"the equations are near a singularity on the whole stroke of '{kin.joints[i]}' (other joints: home)"
        )
    return is_regular


def _around_home(is_usable: np.ndarray, q: Array, i: int, home: Array) -> tuple[int, int]:
    """Return the first and the last index of the good states around home."""
    distance = np.where(is_usable, np.abs(q[:, i] - home[i]), np.inf)
    first = int(np.argmin(distance))
    last = first
    while first > 0 and is_usable[first - 1]:
        first -= 1
    while last < len(q) - 1 and is_usable[last + 1]:
        last += 1
    return first, last


def _states_of_mechanism(
    kin: Kinematics, model: ReferenceModel, q: Array, first: int, last: int, i: int, home: Array
) -> tuple[int, int, SolvedSamples]:
    """Return (first index, last index, run) of the states from `first` to `last` that the mechanism reaches."""
    middle = first + int(np.argmin(np.abs(q[first : last + 1, i] - home[i])))
    while True:
        if last - first < 2:
            raise TwinError(f"joint '{kin.joints[i]}' cannot move from home, so there is no stroke to compare")
        try:
            downwards = model.run(q[first : middle + 1][::-1])
            upwards = model.run(q[middle : last + 1])
            break
        except AssemblyError:  # the mechanism has a smaller range than the equations: shorten the range at both ends
            # halved, because each attempt solves the whole range
            first = (first + middle + 1) // 2
            last = (last + middle) // 2
    # both begin with the middle, which the result has once
    states = np.concatenate([downwards.x[::-1][:-1], upwards.x])
    return first, last, model.collect(states)


def _mimic_error(model: ReferenceModel, run: SolvedSamples, q: Array) -> ErrorCurve:
    """Return the error of the model "mimic": each passive joint is a linear function of the driven joint."""
    tree = model.tree
    mechanism = model.mechanism
    path = [joint.name for joint in mechanism.path(mechanism.frame(mechanism.tool).body)]
    joint = _without_coordinate(model, run, path)
    if joint:
        return ErrorCurve(
            np.zeros((0, 3)), np.zeros(0), f"none: joint '{joint}' between base and tool has no single coordinate"
        )
    active = {joint.name for joint in mechanism.active}
    states = run.x.copy()
    functions: list[str] = []
    for name, k in tree.configuration.items():
        if name in active or name not in path or np.ptp(run.x[:, k]) <= _CONSTANT_CHANGE:
            continue
        # the best that <mimic> can do: a worse fit would make the equations look better than they are
        slope, offset = np.polyfit(q, run.x[:, k], 1)
        states[:, k] = slope * q + offset
        functions.append(f"{name} = {slope:.5g} q {offset:+.5g}")
    note = "; ".join(functions) or "exact: no passive joint between base and tool moves"
    poses, _ = tree.update(states)
    return _error_curve(run.Ts_base_tool, tree.tool(poses), note)


def _without_coordinate(model: ReferenceModel, run: SolvedSamples, path: list[str]) -> str:
    """Return the first moving joint of a path that has no single coordinate, such as a ball joint; "" if none."""
    tree = model.tree
    scalar = set(tree.configuration.values())
    for joint in path:
        if joint not in tree.joint_id:
            continue
        k = tree.model.joints[tree.joint_id[joint]].idx_q
        if k < 0 or k in scalar:
            continue
        quaternion = run.x[:, k : k + 4]
        if np.ptp(quaternion, axis=0).max() > _CONSTANT_CHANGE:
            return joint
    return ""


def _serial_error(true: Array, q: Array) -> ErrorCurve:
    """Return the error of the model with a fixed pivot or a straight line, fitted by least squares.

    The pivot model is p = c + R r, with the tool's position p and rotation R in `true` and constants c, r (3,) in m.
    """
    R = true[:, :3, :3]
    p = true[:, :3, 3]
    k = len(p)
    turns_from_start = spatial.rotation_angle(np.swapaxes(R[:1], 1, 2) @ R)
    if turns_from_start.max() < _CONSTANT_CHANGE:
        A = np.column_stack([np.ones(k), q])
        fitted = A @ np.linalg.lstsq(A, p, rcond=None)[0]
        return ErrorCurve(fitted - p, np.zeros(k), "a straight line: the tool does not turn")
    A = np.concatenate([np.tile(np.eye(3), (k, 1, 1)), R], axis=2).reshape(3 * k, 6)
    x = np.linalg.lstsq(A, p.reshape(-1), rcond=None)[0]
    fitted = (A @ x).reshape(k, 3)
    # Every point of the axis is a pivot: the one nearest to the origin of the base is shown.
    turns = spatial.log_so3(R @ R[k // 2].T)
    _, _, directions = np.linalg.svd(turns)
    axis = directions[0]
    pivot = x[:3] - axis * (axis @ x[:3])
    listed = ", ".join(f"{coordinate * 1e3:.2f}" for coordinate in pivot)
    return ErrorCurve(fitted - p, np.zeros(k), f"pivot at ({listed}) mm")
