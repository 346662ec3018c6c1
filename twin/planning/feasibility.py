"""Check before timing whether a robot can follow a path; if not, report where and why, and what is reachable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.core.errors import ProtocolError
from twin.core.spatial import Array
from twin.core.units import DEG, MM, ROUNDING
from twin.planning.path_kinematics import PathKinematics
from twin.planning.phase_path import PhasePath
from twin.planning.protocol import Insertion, Pivot, Retraction

_CHECKED_POINTS = 401
"""Number of points of a phase that are checked; the 1 kHz samples are checked again after timing."""

_HALVINGS = 40
"""Number of bisections for the first unreachable point of a phase; s is then exact to rounding."""

_SAFETY_PART = 1e-4
"""Part of the phase by which the proposed end is before the first unreachable point, so that it is surely reachable."""

Cause = Literal["reach", "inverse", "lower", "upper", "motor", "gap", "singularity", "branch"]
"""Reason why a pose is unreachable."""

Margins = dict[tuple[Cause, str], Array]
"""Margins (k,) in m or rad by (cause, name); a margin is negative where a pose is unreachable."""


def require_feasible(path: PhasePath, kinematics: PathKinematics, frame: str, protocol: str) -> None:
    """Raise an error if the robot cannot follow the path.

    Raises:
        ProtocolError: the robot cannot follow the path; the message contains the phase, the cause, the point of the
            phase from which a limit is violated, the excess, and what is reachable.
    """
    s = np.linspace(0.0, 1.0, _CHECKED_POINTS)

    def at(s: Array) -> tuple[Array, Array]:
        return path.motion(s).Ts_base_tool, path.joints(s, kinematics)

    T_start, q_start = at(np.zeros(1))
    anchor = Anchor.at(kinematics, T_start, q_start)

    def margins_of(s: Array) -> Margins:
        Ts, q = at(s)
        return margins_at(kinematics, Ts, q, anchor)

    margins = margins_of(s)
    is_violated = np.zeros(len(s), bool)
    for margin in margins.values():
        is_violated |= margin < -ROUNDING
    if not is_violated.any():
        return
    first = int(np.argmax(is_violated))
    low = 0.0
    high = 0.0
    where = "already at the start of the phase"
    if first > 0:
        # bisection between the last feasible and the first infeasible point
        low = float(s[first - 1])
        high = float(s[first])
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if violation(kinematics, margins_of(np.array([middle]))):
                high = middle
            else:
                low = middle
        where = f"from {100 * high:.1f} % of the phase on"
    cause, name, margin = _first_negative(margins, first)
    # argmin would choose NaN, a margin that is not known, as the smallest.
    known_margin = np.where(np.isnan(margin), 0.0, margin)
    worst = int(np.argmin(known_margin))
    text = _violation_text(kinematics, cause, name, float(-margin[worst]))
    if cause not in ("branch", "inverse", "singularity"):  # the margins of these three are no distances
        where += f", worst at {100 * s[worst]:.0f} %"
    position = _mm(path.motion(np.array([high])).p[0])
    message = (
        f"{protocol}: phase '{path.phase.name}' ({path.phase.type}) cannot be carried out: {text}, {where}, "
        f"with {frame} at {position}."
    )
    if cause == "inverse":
        message += _inverse_failure(kinematics, path, high)
    raise ProtocolError(f"{message} {_reachable(path, low, first == 0)}")


def pose_margins(kinematics: PathKinematics, Ts: Array, q: Array) -> Margins:
    """Return the margins of poses Ts (k, 4, 4) with joint values q (k, n).

    A margin (k,) in m or rad is the distance from a limit; it is negative where the pose is beyond the limit. The
    margin "inverse" is -1 where the inverse kinematics has no solution, else 0.
    """
    margins: Margins = {}
    for name, margin in kinematics.reach(Ts).items():
        margins["reach", name] = np.asarray(margin)
    solved = np.all(np.isfinite(q), axis=1)
    margins["inverse", ""] = np.where(solved, 0.0, -1.0)
    # without a solution, only the margin "inverse" is negative
    for j, name in enumerate(kinematics.joint_names):
        margins["lower", name] = np.where(solved, q[:, j] - kinematics.lower[j], 0.0)
        margins["upper", name] = np.where(solved, kinematics.upper[j] - q[:, j], 0.0)
    motors = kinematics.motors
    for i, name in enumerate(motors.names):
        position = q @ motors.rows[i]
        inside = np.minimum(position - motors.lower[i], motors.upper[i] - position)
        margins["motor", name] = np.where(solved, inside, 0.0)
    for gap in kinematics.gaps:
        distance = np.abs(q[:, gap.i] - q[:, gap.j])
        margins["gap", gap.name] = np.where(solved, distance - gap.smallest, 0.0)
    return margins


@dataclass(frozen=True)
class Anchor:
    """Signs of the singularity measures, and the working mode; neither may change during a phase.

    Attributes:
        signs: signs of the singularity measures at the start of the phase; empty if the joint values there are unknown.
        branch: working mode at the start of the phase; None if unknown.
    """

    signs: Mapping[str, float]
    branch: object

    @staticmethod
    def at(kinematics: PathKinematics, Ts: Array, q: Array) -> Anchor:
        """Return the anchor for a pose (1, 4, 4) with joint values (1, n)."""
        if not np.all(np.isfinite(q)):
            return Anchor({}, None)
        signs = {}
        for name, measure in kinematics.singularity(Ts, q).items():
            signs[name] = float(np.sign(measure[0]))
        branch = None
        if kinematics.branch:
            branch = kinematics.branch(Ts, q)[0]
        return Anchor(signs, branch)


def margins_at(kinematics: PathKinematics, Ts: Array, q: Array, anchor: Anchor) -> Margins:
    """Return the margins of `pose_margins`, the margins of singularities, and the margin of the working mode.

    The margin of a singularity measure is negative where the measure has another sign than in `anchor`. The margin of
    the working mode is -1 where the working mode is not that of `anchor`, else 0.
    """
    margins = pose_margins(kinematics, Ts, q)
    solved = np.all(np.isfinite(q), axis=1)
    unknown_start = not anchor.signs and anchor.branch is None
    if unknown_start or not solved.any():
        return margins
    for name, measure in kinematics.singularity(Ts[solved], q[solved]).items():
        margins["singularity", name] = _scattered(solved, measure * anchor.signs.get(name, 1.0))
    if kinematics.branch:
        same = kinematics.branch(Ts[solved], q[solved]) == anchor.branch
        margins["branch", ""] = _scattered(solved, np.where(same, 0.0, -1.0))
    return margins


def violation(kinematics: PathKinematics, margins: Margins) -> str:
    """Return a text for the first cause whose margin (1,) is negative; "" if no margin is negative."""
    for (cause, name), margin in margins.items():
        if margin[0] < -ROUNDING:
            return _violation_text(kinematics, cause, name, float(-margin[0]))
    return ""


def _first_negative(margins: Margins, k: int) -> tuple[Cause, str, Array]:
    """Return (cause, name, margin) of the first margin that is negative at point k; there is one."""
    for (cause, name), margin in margins.items():
        if margin[k] < -ROUNDING:
            return cause, name, margin
    raise AssertionError(f"no margin is negative at point {k}")


def _scattered(rows: np.ndarray, values: Array) -> Array:
    """Return (k,) with the values (m,) in the m rows of a mask (k,), and 0 in the other rows."""
    spread = np.zeros(len(rows))
    spread[rows] = values
    return spread


def _inverse_failure(kinematics: PathKinematics, path: PhasePath, s: float) -> str:
    """Return why the equations have no finite joint values at s, as a sentence with a leading space; "" if unknown."""
    if not kinematics.unsolved_reason:
        return ""
    text = kinematics.unsolved_reason(path.motion(np.array([s])).Ts_base_tool[0])
    if not text:
        return ""
    return f" {text}"


def _violation_text(kinematics: PathKinematics, cause: Cause, name: str, size: float) -> str:
    """Return a text on a cause, with the excess `size` in m or rad and the limit."""
    if cause in ("lower", "upper"):
        j = kinematics.joint_names.index(name)
        unit, factor = kinematics.unit(j)
        if cause == "lower":
            side = "below its lower"
            limit = kinematics.lower[j] / factor
        else:
            side = "above its upper"
            limit = kinematics.upper[j] / factor
        return f"joint {name} would go {size / factor:.2f} {unit} {side} limit of {limit:.2f} {unit}"
    if cause == "motor":
        i = kinematics.motors.names.index(name)
        unit, factor = kinematics.motors.unit(i)
        low = kinematics.motors.lower[i] / factor
        high = kinematics.motors.upper[i] / factor
        return f"motor {name} would go {size / factor:.2f} {unit} beyond its limits of {low:.2f}..{high:.2f} {unit}"
    if cause == "gap":
        (gap,) = [gap for gap in kinematics.gaps if gap.name == name]
        unit, factor = kinematics.unit(gap.i)
        required = gap.smallest / factor
        remaining = (gap.smallest - size) / factor
        text = f"gap {name} would shrink to {remaining:.2f} {unit}"
        return f"{text}, {size / factor:.2f} {unit} less than the required {required:g} {unit}"
    if cause == "reach":
        return f"{name} is too short by {size / MM:.2f} mm"
    if cause == "singularity":
        return f"the motion would cross a singularity: the measure {name} changes its sign"
    if cause == "branch":
        return "the working mode changes"
    return "the inverse kinematics has no solution"


def _reachable(path: PhasePath, last_s: float, is_unreachable: bool) -> str:
    """Return a sentence on the reachable part of the phase, up to s minus a small margin."""
    if is_unreachable:
        return "No part of the phase is reachable; change the pose at the start of the phase."
    last_s = max(0.0, last_s - _SAFETY_PART)
    angles = _two_decimals(path.angles(last_s) / DEG)
    match path.phase:
        case Insertion():
            return f"Reachable: insertion to a depth of {path.depth(last_s) / MM:.2f} mm."
        case Retraction():
            return f"Reachable: retraction to a depth of {path.depth(last_s) / MM:.2f} mm."
        case Pivot():
            ends = path.motion(np.array([0.0, last_s])).Ts_base_tool[:, :3, :3]
            first_shaft, last_shaft = ends @ path.n_tool_shaft
            sine = np.linalg.norm(np.cross(first_shaft, last_shaft))
            tilt = np.arctan2(sine, first_shaft @ last_shaft) / DEG
            tilted = f"tilted by {tilt:.2f} deg from the start of the phase"
            return f"Reachable: ({angles}) deg at a depth of {path.depth(last_s) / MM:.2f} mm, {tilted}."
        case _:
            position = _mm(path.motion(np.array([last_s])).p[0])
            return f"Reachable: up to the position {position} with the angles ({angles}) deg."


def _mm(p: Array) -> str:
    """Return a position p (3,) in m as text in mm."""
    return f"({_two_decimals(p / MM)}) mm"


def _two_decimals(numbers: Array) -> str:
    """Return numbers as text, such as "1.00, -2.50, 0.00"."""
    return ", ".join(f"{number:.2f}" for number in numbers)
