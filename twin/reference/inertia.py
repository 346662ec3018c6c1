"""Masses, inertias and drives of a robot, read from TOML, each number with its provenance.

A link is the part moved by one joint. Mass centre and tensor of a link are given in the link frame of the modified
Denavit-Hartenberg form of Khalil and Kleinfinger. This frame is determined on the mechanism with all joints at zero: z
is along the joint axis, and x is along x of the base. The origin is the point of the joint axis nearest to the joint
axis of the next link in the file. For the last link, and if the next axis is parallel, the origin is the point of the
joint axis nearest to the origin of the previous link. Instead, a link may name a frame of the robot's description on
the same body (`frame`); then mass centre and tensor of the link are given in this frame.

Source: W. Khalil, J.-F. Kleinfinger, A new geometric notation for open and closed-loop robots, Proc. IEEE Int. Conf.
Robotics and Automation (1986) 1174-1179: T_previous_link = Rx(alpha) Tx(d) Rz(theta) Tz(r), so that the x axes of all
frames are parallel if every theta is zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.errors import DescriptionError, MechanismError, unknown
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.schema import Identifier, NotNegative, Positive, Sourced, Table, Vector, at, error_at, load_toml

NAME = "inertia.toml"
"""Name of the inertia file in a robot's CAD folder."""

_AXIS_TOLERANCE = 1e-6
"""Tolerance in rad for perpendicular and parallel axes: far above rounding errors."""

_UNITS = {"rotor": ("kg m2", "kg"), "friction": ("N m s/rad", "N s/m"), "torque": ("N m", "N")}
"""Units of each quantity, for revolute and prismatic joints."""

_PRODUCTS = (".xx", ".yy", ".zz", ".xy", ".xz", ".yz")
"""Ends of the names of the six entries of an inertia matrix."""


class Mass(Sourced):
    """A mass with its unit and provenance."""

    value: Positive
    unit: Literal["kg"]


class Centre(Sourced):
    """Mass centre in the link frame."""

    value: Vector
    unit: Literal["m"]


class Tensor(Sourced):
    """Inertia about the mass centre in the axes of the link frame: xx, yy, zz, and optionally xy, xz, yz.

    Products that are not given are zero. The product xy is the element (x, y) of the tensor; its sign is not reversed.
    """

    value: Vector | tuple[float, float, float, float, float, float]
    unit: Literal["kg m2"]


class Rotor(Sourced):
    """Inertia of the motor's rotor as it acts at the link: rotor inertia times the square of the gear ratio."""

    value: NotNegative
    unit: Literal["kg m2", "kg"]


class Friction(Sourced):
    """Viscous friction."""

    value: NotNegative
    unit: Literal["N m s/rad", "N s/m"]


class Effort(Sourced):
    """Largest torque or force at the link."""

    value: Positive
    unit: Literal["N m", "N"]


class _Solid(Table):
    mass: Mass
    centre: Centre
    tensor: Tensor

    @model_validator(mode="after")
    def _possible(self) -> _Solid:
        violations = _inertia(self).violations()
        if violations:
            raise at("tensor", "; ".join(violations))
        return self


class Link(_Solid):
    """One link: its joint, inertia and drive (no drive if a motor of the mechanism moves the joint).

    `frame` names a frame of the description on the body that the joint moves. Without `frame`, mass centre and tensor
    are given in the link frame of the module docstring.
    """

    joint: Identifier
    frame: Identifier | None = None
    rotor: Rotor | None = None
    friction: Friction | None = None
    torque: Effort | None = None


class Instrument(_Solid):
    """Instrument that the last link carries: mass, mass centre and tensor in the frame of this link."""


class Inertias(Table):
    """Content of the inertia file; the links are in the order of the chain."""

    title: str
    source: str
    link: list[Link] = Field(min_length=1)
    instrument: Instrument | None = None


def load(path: Path) -> Inertias:
    """Read an inertia file.

    Raises:
        DescriptionError: the file is invalid, or a tensor is physically impossible; the message has file, line, key
            and value.
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
        DescriptionError: the file does not exist or is invalid.
    """
    path = Path(folder) / NAME
    if not path.is_file():
        raise DescriptionError(f"{path}: the file does not exist: without masses, torques cannot be computed")
    return load(path)


def weighed(table: Inertias, mechanism: Mechanism, *, instrument: bool = True) -> Mechanism:
    """Return the mechanism with only the file's masses: the body that a link's joint moves gets the mass of this link.

    Args:
        table: the inertia file.
        mechanism: the mechanism; bodies that are fixed to a link's body get no mass.
        instrument: whether the last link carries the instrument of the file.

    Raises:
        MechanismError: a joint of the file is not in the mechanism, or the frame of a link is ambiguous.
        AssemblyError: the mechanism cannot be assembled with all joints at zero.
    """
    links = [_inertia(link) for link in table.link]
    if instrument and table.instrument is not None:
        links[-1] = links[-1] + _inertia(table.instrument)
    poses = ReferenceModel(mechanism).solve(np.zeros(len(mechanism.active))).link_poses
    body_of_joint = {joint.name: joint.child for joint in mechanism.tree}
    inertias = {}
    frames = _frames(table, mechanism, poses)
    for link, inertia, T_base_link in zip(table.link, links, frames, strict=True):
        body_name = body_of_joint[link.joint]
        T_body_link = spatial.inverse(poses[body_name]) @ T_base_link
        inertias[body_name] = inertia.seen_from(T_body_link)
    bodies = []
    for body in mechanism.bodies:
        bodies.append(replace(body, inertia=inertias.get(body.name)))
    return replace(mechanism, bodies=tuple(bodies))


def _frames(table: Inertias, mechanism: Mechanism, poses: dict[str, Array]) -> list[Array]:
    """Return T_base_link (4, 4) of each link with all joints at zero; see the module docstring."""
    single_axis_joints = {joint.name: joint for joint in mechanism.tree if len(joint.free_axes) == 1}
    axes: list[tuple[Array, Array]] = []
    named_frames: list[Array | None] = []
    for link in table.link:
        if link.joint not in single_axis_joints:
            text = unknown("joint with one coordinate", link.joint, single_axis_joints)
            raise MechanismError(f"inertia.toml: {text}")
        joint = single_axis_joints[link.joint]
        _require_units(link, joint)
        T = poses[joint.parent] @ joint.T_parent_joint
        if link.frame is None and abs(T[0, 2]) > _AXIS_TOLERANCE:
            raise MechanismError(
                f"joint {joint.name}: its axis must be perpendicular to the x axis of the base, with all joints at "
                f"zero; the error is {np.arcsin(abs(T[0, 2])) / DEG:.3g} deg, "
                "so the link frame of inertia.toml is ambiguous"
            )
        named_frames.append(_named(link, mechanism, joint.child, poses))
        axes.append((T[:3, 3], T[:3, 2]))
    origins = _link_origins(axes, poses[mechanism.base][:3, 3])
    frames = []
    for (_, z), origin, named_frame in zip(axes, origins, named_frames, strict=True):
        if named_frame is None:
            named_frame = spatial.pose(spatial.frame_from_axes(z, [1.0, 0.0, 0.0]), origin)
        frames.append(named_frame)
    return frames


def _require_units(link: Link, joint: Joint) -> None:
    """Raise an error if a number of a link has the unit of the other type of joint, revolute or prismatic."""
    for key, units in _UNITS.items():
        entry = getattr(link, key)
        if entry is not None and entry.unit != units[not joint.is_angle]:
            raise MechanismError(
                f"inertia.toml: {key} of {joint.name} is in {entry.unit}, but the joint is {joint.type}"
            )


def _link_origins(axes: list[tuple[Array, Array]], p_base: Array) -> list[Array]:
    """Return the origin (3,) of each link frame: the point of its joint axis nearest to the next axis.

    `axes` are (point (3,), direction (3,)) of the joint axes in base; `p_base` (3,) is the origin of the base.
    """
    origins = []
    origin = p_base
    for i, (p, z) in enumerate(axes):
        if i + 1 < len(axes):
            p_next, z_next = axes[i + 1]
        else:
            # as if the next axis were parallel: the origin is then the point nearest to the previous one
            p_next = origin
            z_next = z
        across = z_next - (z_next @ z) * z
        if np.linalg.norm(across) > _AXIS_TOLERANCE:
            # the axes are not parallel: the origin is the foot of the common normal
            step = (p_next - p) @ z
            step -= (z_next @ z) * ((p_next - p) @ across) / (across @ across)
        else:
            step = (origin - p) @ z
        origin = p + step * z
        origins.append(origin)
    return origins


def _named(link: Link, mechanism: Mechanism, body: str, poses: dict[str, Array]) -> Array | None:
    """Return T_base_frame (4, 4) of the frame that a link names; None: the link names no frame."""
    if link.frame is None:
        return None
    frames = {frame.name: frame for frame in mechanism.frames if frame.body == body}
    if link.frame not in frames:
        raise MechanismError(
            f"inertia.toml: link of {link.joint}: {unknown(f'frame of body {body}', link.frame, frames)}"
        )
    return poses[body] @ frames[link.frame].T_body_frame


def _inertia(solid: _Solid) -> Inertia:
    """Return the inertia of a link or instrument about its mass centre; products that are not given are zero."""
    tensor = np.diag(solid.tensor.value[:3])
    products = solid.tensor.value[3:]
    for (i, j), product in zip(((0, 1), (0, 2), (1, 2)), products, strict=False):
        tensor[i, j] = product
        tensor[j, i] = product
    return Inertia(solid.mass.value, np.array(solid.centre.value), tensor)


def parameters(table: Inertias) -> Iterator[Parameter]:
    """Yield every number of the file with its provenance."""
    solids: list[tuple[str, Link | Instrument]] = []
    for link in table.link:
        solids.append((link.joint, link))
    if table.instrument is not None:
        solids.append(("instrument", table.instrument))
    for owner, solid in solids:
        for key in ("mass", "centre", "tensor", "rotor", "friction", "torque"):
            entry = getattr(solid, key, None)
            if entry is None:
                continue
            values = entry.value
            if not isinstance(values, tuple):
                values = (values,)
            if len(values) == 1:
                labels = ("",)
            elif key == "centre":
                labels = (".x", ".y", ".z")
            else:
                labels = _PRODUCTS[: len(values)]  # a tensor may be given by its diagonal alone
            for label, value in zip(labels, values, strict=True):
                name = f"inertia.{owner}.{key}{label}"
                yield Parameter(name, value, entry.unit, value, entry.provenance, entry.note)
