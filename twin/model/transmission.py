"""Motors, and linear maps from motors to joints: gears, belts, cables, lead screws, differentials.

Joint values q and motor values m of a transmission are related by one matrix, q = matrix @ m, without an offset.
Power balance gives the efforts from the transpose: tau_m = matrix.T @ tau_q.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from twin.core.errors import unknown
from twin.core.spatial import Array

Coordinate = Literal["angle", "length"]

LARGEST_CONDITION = 1e6
"""Condition number (see `condition`) above which a matrix counts as singular."""


@dataclass(frozen=True)
class Actuator:
    """A motor that moves joints through a transmission.

    All numbers are on the motor's side, in the units of `kind`: rad, N m and kg m2 for an angle; m, N and kg for a
    length.

    Attributes:
        name: identifier; differs from all joint names.
        kind: kind of its coordinate, "angle" or "length".
        limits: hard range of the coordinate, or None.
        max_speed, max_effort: maximum absolute values, or None if unknown.
        rotor_inertia: inertia or mass of the parts that move with the motor, or None.
        stiffness, damping: gains of the position drive of the motor; if stiffness is None, the motor has no drive.
    """

    name: str
    kind: Coordinate = "angle"
    limits: tuple[float, float] | None = None
    max_speed: float | None = None
    max_effort: float | None = None
    rotor_inertia: float | None = None
    stiffness: float | None = None
    damping: float = 0.0

    @property
    def is_angle(self) -> bool:
        """Whether the coordinate is an angle."""
        return self.kind == "angle"


@dataclass(frozen=True)
class Transmission:
    """A linear map from the coordinates of n actuators to the coordinates of n active joints.

    A `Coupling`, by contrast, is a constraint between joints and has no motor.

    Attributes:
        name: identifier.
        joints: names of active joints, n.
        actuators: names of actuators, n.
        matrix: (n, n) q_joints = matrix @ m_actuators; entries in unit of the joint per unit of the actuator.
    """

    name: str
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    matrix: Array

    @cached_property
    def inverse(self) -> Array:
        """The inverse (n, n) of the matrix: m_actuators = inverse @ q_joints."""
        return np.asarray(np.linalg.inv(self.matrix), float)

    @property
    def equations(self) -> str:
        """The matrix as text, such as "q1 = 0.05 m1; q2 = -0.02 m1 + 0.04 m2"."""
        equations = []
        for joint, row in zip(self.joints, self.matrix, strict=True):
            terms = []
            for ratio, actuator in zip(row, self.actuators, strict=True):
                if ratio:
                    terms.append(f"{ratio:g} {actuator}")
            sum_of_terms = " + ".join(terms).replace("+ -", "- ")
            equations.append(f"{joint} = {sum_of_terms}")
        return "; ".join(equations)

    def single(self, joint: str) -> tuple[str, float] | None:
        """Return (actuator, matrix entry) if the joint has only one actuator, which moves no other joint; else None."""
        row = self.joints.index(joint)
        (columns,) = np.nonzero(self.matrix[row])
        if len(columns) != 1:
            return None
        column = columns[0]
        if np.count_nonzero(self.matrix[:, column]) != 1:
            return None
        return self.actuators[column], float(self.matrix[row, column])


def joint_gains(transmission: Transmission, actuators: Sequence[Actuator]) -> tuple[Array, Array] | None:
    """Return (stiffness (n,), damping (n,)) at each joint due to the motors' drives, with the other joints fixed.

    Each array is the diagonal of inverse.T @ diag(g) @ inverse, where g (n,) is the stiffness or the damping of the
    motors' drives. The arrays are written to file formats whose drives act on joints. None: a motor has no drive.
    """
    actuator_of = {actuator.name: actuator for actuator in actuators}
    stiffness = []
    damping = []
    for name in transmission.actuators:
        motor = actuator_of[name]
        if motor.stiffness is None:
            return None
        stiffness.append(motor.stiffness)
        damping.append(motor.damping)
    # the diagonal of inverse.T @ diag(g) @ inverse is g @ squares
    squares = transmission.inverse**2
    return np.array(stiffness) @ squares, np.array(damping) @ squares


def condition(matrix: Array) -> float:
    """Return the condition number of a matrix after scaling, so that units have no effect; infinite for a zero row.

    First each row, then each column is divided by its largest absolute entry. A zero column also gives infinity.
    """
    M = np.abs(matrix)
    if not (M.max(axis=0).all() and M.max(axis=1).all()):
        return np.inf
    scaled = matrix / M.max(axis=1, keepdims=True)
    scaled = scaled / np.abs(scaled).max(axis=0)
    return float(np.linalg.cond(scaled))


Fault = tuple[Literal["actuator", "transmission"], str, str, str]
"""A fault of an actuator or transmission: (kind of the entry, name of the entry, wrong field, message)."""


def faults(
    actuators: Sequence[Actuator],
    transmissions: Sequence[Transmission],
    active: Sequence[str],
    joints: Sequence[str],
    own_drive: Collection[str],
) -> Iterator[Fault]:
    """Yield the faults of actuators and transmissions; later faults may be caused by earlier ones.

    `joints` has the names of all joints of the mechanism, `active` the names of the active joints, and `own_drive` the
    names of the joints with a position drive.
    """
    for actuator in actuators:
        for key, text in _actuator_faults(actuator, joints):
            yield "actuator", actuator.name, key, f"actuator '{actuator.name}': {text}"
    actuator_names = [a.name for a in actuators]
    moved_by: dict[str, str] = {}
    leads_to: dict[str, str] = {}
    for transmission in transmissions:
        for key, text in (
            *_name_faults("active joint", "joints", transmission.joints, active, transmission.name, moved_by),
            *_name_faults("actuator", "actuators", transmission.actuators, actuator_names, transmission.name, leads_to),
            *_drive_faults(transmission, own_drive),
            *_matrix_faults(transmission),
        ):
            yield "transmission", transmission.name, key, f"transmission '{transmission.name}': {text}"
    for name in actuator_names:
        if name not in leads_to:
            text = f"actuator '{name}' is in no transmission; a joint that is driven directly needs no actuator"
            yield "actuator", name, "name", text


def _name_faults(
    kind: str,
    key: str,
    names: Sequence[str],
    known_names: Sequence[str],
    own_transmission: str,
    transmission_of: dict[str, str],
) -> Iterator[tuple[str, str]]:
    for name in names:
        if name not in known_names:
            yield key, unknown(kind, name, known_names)
        if name in transmission_of:
            where = f"by transmission '{transmission_of[name]}' already"
            if transmission_of[name] == own_transmission:
                where = "twice"
            yield key, f"{kind} '{name}' is used {where}; it may be used once, in one transmission"
        transmission_of[name] = own_transmission


def _drive_faults(transmission: Transmission, own_drive: Collection[str]) -> Iterator[tuple[str, str]]:
    for name in transmission.joints:
        if name in own_drive:
            text = f"joint '{name}' has a drive, but actuators move the joint: give stiffness, damping and max_effort "
            yield "joints", text + "to the actuators"


def _actuator_faults(actuator: Actuator, joints: Sequence[str]) -> Iterator[tuple[str, str]]:
    if actuator.name in joints:
        yield "name", f"a joint has this name; choose another, for instance '{actuator.name}_motor'"
    if actuator.kind not in ("angle", "length"):
        yield "kind", unknown("kind", actuator.kind, ("angle", "length"))
    if actuator.limits is not None and not actuator.limits[0] < actuator.limits[1]:
        yield "limits", f"limits {actuator.limits[0]:g} .. {actuator.limits[1]:g} are not ordered"
    for key in ("max_speed", "max_effort", "rotor_inertia", "stiffness"):
        value = getattr(actuator, key)
        if value is not None and not (np.isfinite(value) and value > 0):
            yield key, f"{key} is {value:g}; it must be finite and above 0"
    if not (np.isfinite(actuator.damping) and actuator.damping >= 0):
        yield "damping", f"damping is {actuator.damping:g}; it must be finite and at least 0"
    if actuator.damping and actuator.stiffness is None:
        yield "damping", "damping needs stiffness: both are gains of one drive"


def _matrix_faults(transmission: Transmission) -> Iterator[tuple[str, str]]:
    n = len(transmission.joints)
    if not n or len(transmission.actuators) != n:
        yield (
            "actuators",
            f"{n} joints and {len(transmission.actuators)} actuators; the numbers must be equal and at least 1",
        )
        return
    shape = np.shape(transmission.matrix)
    if shape != (n, n):
        size = " x ".join(map(str, shape))
        yield "matrix", f"the matrix is {size}; it must be {n} x {n}, one row for each joint"
        return
    if not np.all(np.isfinite(transmission.matrix)):
        yield "matrix", "the matrix has entries that are not finite"
        return
    number = condition(transmission.matrix)
    if not number <= LARGEST_CONDITION:  # also true for NaN
        yield (
            "matrix",
            f"the matrix cannot be inverted (condition number {number:.3g}, limit {LARGEST_CONDITION:.0e}): some "
            "motion of the motors moves no joint, or a joint is moved by no motor; check the rows of the matrix",
        )
