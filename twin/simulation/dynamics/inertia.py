"""Masses, inertias and drives of a serial arm from TOML, each number with its origin.

The file gives every link in the frame of Khalil and Kleinfinger's modified Denavit-Hartenberg form,

    T_previous_link = Rx(alpha) Tx(d) Rz(theta) Tz(r),

after the shift r. Rz and Tz commute, so that frame turns with its joint about its own z axis. `arm` takes those
frames as joint frames; a mechanism whose joint frames lie elsewhere on the same axes (or are turned about them
while all joints are zero) passes its placements, and the links are expressed in its frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import DescriptionError, MechanismError
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.mechanism import Inertia
from twin.schema import Identifier, Origin, Table, Vector, at, error_at, load_toml

_BESIDE = 1e-6
"""Metres, and radians, by which two axes that should be one may differ: far above rounding, far below any part."""

_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]


class _Cited(Table):
    provenance: Origin
    note: str = Field(min_length=1)


class Length(_Cited):
    """A length."""

    value: float
    unit: Literal["m"]


class Mass(_Cited):
    """A mass."""

    value: _Positive
    unit: Literal["kg"]


class Centre(_Cited):
    """Mass centre in the link frame."""

    value: Vector
    unit: Literal["m"]


class Tensor(_Cited):
    """Diagonal xx, yy, zz of the inertia about the mass centre in the axes of the link frame; products are zero."""

    value: Vector
    unit: Literal["kg m2"]


class Rotor(_Cited):
    """Inertia of the motor's rotor as the link feels it: times the square of the gear ratio."""

    value: _NotNegative
    unit: Literal["kg m2"]


class Friction(_Cited):
    """Viscous friction."""

    value: _NotNegative
    unit: Literal["N m s/rad"]


class Torque(_Cited):
    """Largest torque at the link."""

    value: _Positive
    unit: Literal["N m"]


class _Solid(Table):
    mass: Mass
    centre: Centre
    tensor: Tensor

    @model_validator(mode="after")
    def _possible(self) -> _Solid:
        bad = _inertia(self).violations()
        if bad:
            raise at("tensor", "; ".join(bad))
        return self


class Link(_Solid):
    """One link with the joint that moves it and that joint's drive."""

    joint: Identifier
    alpha_deg: float
    d_m: float
    r: Length
    rotor: Rotor
    friction: Friction
    torque: Torque


class Instrument(_Solid):
    """What the last link carries, in its frame."""


class Inertias(Table):
    """The whole file; links in the order of the chain."""

    title: str
    source: str
    link: list[Link] = Field(min_length=1)
    instrument: Instrument | None = None


@dataclass(frozen=True)
class Arm:
    """A serial arm of n revolute joints as the engines take it. Joint j turns link j about z of joint frame j.

    Attributes:
        joints: names, from the base outwards.
        placements: (n, 4, 4) joint frame j in joint frame j-1 (the first: in base) with joint j at zero.
        links: mass, mass centre in m and tensor about it, in joint frame j; the last one holds the instrument.
        rotor: (n,) kg m2 at the link.
        friction: (n,) N m s/rad.
        torque: (n,) largest, N m.
        parameters: every number with its origin.
    """

    joints: tuple[str, ...]
    placements: Array
    links: tuple[Inertia, ...]
    rotor: Array
    friction: Array
    torque: Array
    parameters: tuple[Parameter, ...] = ()


def load(path: Path) -> Inertias:
    """Read an inertia file.

    Raises:
        DescriptionError: file, line, key, value and what would be right; also a tensor that no body has.
    """
    table = load_toml(path, Inertias)
    names = [link.joint for link in table.link]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise error_at(path, ("link", i, "joint"), f"joint '{name}' has two links")
    return table


def of_robot(folder: Path) -> Inertias:
    """Read `inertia.toml` of a robot's CAD folder.

    Raises:
        DescriptionError: there is none: masses of the robot are not known, and nothing can be said of its torques.
    """
    path = Path(folder) / "inertia.toml"
    if not path.is_file():
        raise DescriptionError(f"{path}: there is no such file: no masses are known, hence no dynamics")
    return load(path)


def chain(table: Inertias) -> Array:
    """Return (n, 4, 4): link frame j in link frame j-1 with all joints zero, Rx(alpha) Tx(d) Tz(r)."""
    out = []
    for link in table.link:
        R = spatial.exp_so3([link.alpha_deg * DEG, 0.0, 0.0])
        out.append(spatial.pose(R, R @ [link.d_m, 0.0, link.r.value]))
    return np.array(out)


def arm(
    table: Inertias,
    placements: ArrayLike | None = None,
    T_base_zero: ArrayLike | None = None,
    *,
    instrument: bool = True,
) -> Arm:
    """Return the arm in the joint frames of the file, or in those of a mechanism.

    Args:
        table: the file.
        placements: (n, 4, 4) as `Arm.placements`, of a mechanism whose joints are zero where the file's are.
        T_base_zero: (4, 4) frame 0 of the file in that mechanism's base; default the same.
        instrument: whether the last link carries it.

    Raises:
        MechanismError: the mechanism has another number of joints, or its axes are not those of the file.
    """
    ours = chain(table)
    links = [_inertia(link) for link in table.link]
    if instrument and table.instrument is not None:
        links[-1] = links[-1] + _inertia(table.instrument)
    if placements is not None:
        theirs = np.asarray(placements, float)
        if theirs.shape != ours.shape:
            raise MechanismError(f"the file has {len(ours)} links, the mechanism {len(theirs)} joints in a row")
        start = np.eye(4) if T_base_zero is None else np.asarray(T_base_zero, float)
        Ts_link, Ts_joint = start @ _along(ours), _along(theirs)
        for i, (a, b) in enumerate(zip(Ts_link, Ts_joint, strict=True)):
            T = spatial.inverse(b) @ a
            tilt, aside = np.hypot(*T[:2, 2]) + (T[2, 2] < 0) * np.pi, np.hypot(*T[:2, 3])
            if tilt > _BESIDE or aside > _BESIDE:
                raise MechanismError(
                    f"joint {table.link[i].joint}: the axis of the mechanism is {aside * 1e3:.3g} mm beside that of "
                    f"the inertia file and {tilt / DEG:.3g} deg off: which link is meant cannot be told"
                )
            links[i] = links[i].seen_from(T)
        ours = theirs
    return Arm(
        tuple(link.joint for link in table.link),
        ours,
        tuple(links),
        np.array([link.rotor.value for link in table.link]),
        np.array([link.friction.value for link in table.link]),
        np.array([link.torque.value for link in table.link]),
        tuple(_parameters(table)),
    )


def scaled(links: tuple[Inertia, ...], factors: ArrayLike) -> tuple[Inertia, ...]:
    """Return links with mass and tensor times a factor (n,) each; mass centres stay."""
    factors = np.broadcast_to(np.asarray(factors, float), len(links))
    return tuple(replace(b, mass=b.mass * float(f), I_com=b.I_com * f) for b, f in zip(links, factors, strict=True))


def _inertia(solid: _Solid) -> Inertia:
    return Inertia(solid.mass.value, np.array(solid.centre.value), np.diag(solid.tensor.value))


def _along(placements: Array) -> Array:
    """Return the frames (n, 4, 4) in base, all joints zero."""
    out, T = [], np.eye(4)
    for step in placements:
        T = T @ step
        out.append(T)
    return np.array(out)


def _parameters(table: Inertias) -> Iterator[Parameter]:
    for owner, solid in (*((link.joint, link) for link in table.link), ("instrument", table.instrument)):
        if solid is None:
            continue
        for key in ("mass", "centre", "tensor", "rotor", "friction", "torque"):
            entry = getattr(solid, key, None)
            if entry is None:
                continue
            values = entry.value if isinstance(entry.value, tuple) else (entry.value,)
            labels = ("",) if len(values) == 1 else (".x", ".y", ".z") if key == "centre" else (".xx", ".yy", ".zz")
            for label, value in zip(labels, values, strict=True):
                name = f"inertia.{owner}.{key}{label}"
                yield Parameter(name, value, entry.unit, value, entry.provenance, entry.note)
