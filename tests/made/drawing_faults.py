"""CAD files with one wrong part: faces of a STEP are moved before they are measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin import api
from twin.cad import build
from twin.cad.build import CadModel
from twin.cad.features import MeasuredFeature
from twin.cad.step import Face, Part, StepModel, read_step
from twin.core import spatial
from twin.core.units import DEG, MM, UM


@dataclass(frozen=True)
class Off:
    """A displaced feature of a part.

    `size` is the offset in m (`unit` "mm") or the tilt in rad ("deg") that the joint must show. `T_drawn` (4, 4) is the
    motion of the faces, in the frame of the drawing.
    """

    joint: str
    body: str
    feature: str
    unit: str
    size: float
    T_drawn: np.ndarray

    def __str__(self) -> str:
        shown = f"{self.size / MM:.3f} mm" if self.unit == "mm" else f"{self.size / DEG:.3f} deg"
        return f"{self.body}.{self.feature} at {self.joint}, {shown}"


def some(robot: api.Robot, rng: np.random.Generator) -> Off:
    """Return a random fault of 0.05 to 0.5 mm or degrees in a direction that its joint locks."""
    cad = robot.cad
    joints = [j for j in cad.description.joint if j.on_parent.origin and j.on_child.origin]
    while True:
        joint = joints[rng.integers(len(joints))]
        body, spec = ((joint.parent, joint.on_parent), (joint.child, joint.on_child))[rng.integers(2)]
        size = rng.uniform(0.05, 0.5)
        if not isinstance(spec.origin, str):
            continue
        face = cad.measured[body][spec.origin].face
        u = rng.normal(size=3)
        if face.kind == "cylinder":
            u -= face.direction * (face.direction @ u)
        u /= np.linalg.norm(u)
        if rng.integers(2) and face.kind == "cylinder" and spec.z == spec.origin:
            R = spatial.exp_so3(size * DEG * u)
            T = spatial.pose(R, face.point - R @ face.point)
            turned = size * DEG
            if (
                joint.type in ("fixed", "prismatic") and spec.x_along
            ):  # the face of x does not move, so the frame also rotates a little about z
                x = cad.measured[body][spec.x_along].face.direction
                turned = _angle(_frame(face.direction, x), _frame(R @ face.direction, x))
            return Off(joint.name, body, spec.origin, "deg", turned, T)
        return Off(joint.name, body, spec.origin, "mm", size * MM, spatial.pose(p=size * MM * u))


def noisy(robot: api.Robot, rng: np.random.Generator) -> CadModel:
    """Return the robot's CAD as read with every feature of a joint moved by 5 to 20 µm."""
    offs = []
    for joint in robot.cad.description.joint:
        for body, spec in joint.sides:
            if isinstance(spec.origin, str):
                u = rng.normal(size=3)
                size = rng.uniform(5 * UM, 20 * UM)
                T = spatial.pose(p=size * u / np.linalg.norm(u))
                offs.append(Off(joint.name, body, spec.origin, "mm", size, T))
    return drawn(robot, *offs)


def _frame(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the axes (3, 3) of a frame with the given z, and x in the plane of z and the given x."""
    x = x - z * (z @ x)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _angle(A: np.ndarray, B: np.ndarray) -> float:
    """Return the angle in rad between two frames, from the distance of their matrices: accurate for small angles."""
    return 2 * np.arcsin(np.linalg.norm(A - B) / np.sqrt(8))


def drawn(robot: api.Robot, *offs: Off) -> CadModel:
    """Return the robot's CAD as read with the given faults."""
    assert robot.files is not None
    moves: list[Callable[[StepModel], StepModel]] = []
    for off in offs:
        m, node = robot.cad.measured[off.body][off.feature], robot.cad.description.body[off.body].node or off.body
        moves.append(
            lambda step, m=m, node=node, T=off.T_drawn: replace(
                step, parts=tuple(_part(p, m, T) if node in (p.name, *p.path) else p for p in step.parts)
            )
        )

    def read(path, *args, **settings):
        step = read_step(path, *args, **settings)
        for move in moves:
            step = move(step)
        return step

    real, build.read_step = build.read_step, read
    try:
        return build.read_mechanism(robot.files.description, with_mass=False)
    finally:
        build.read_step = real


def _part(part: Part, m: MeasuredFeature, T: np.ndarray) -> Part:
    """Return a part with motion T of all faces that have the same axis, plane or centre as the measured face."""
    return replace(part, faces=tuple(_face(f, T) if _alike(f, m.face) else f for f in part.faces))


def _alike(a: Face, b: Face) -> bool:
    if a.kind != b.kind:
        return False
    if a.kind == "sphere":
        return bool(np.linalg.norm(a.point - b.point) < 1e-9)
    if np.linalg.norm(np.cross(a.direction, b.direction)) > 1e-9:
        return False
    if a.kind == "plane":
        return abs(float((a.point - b.point) @ a.direction)) < 1e-9
    return float(spatial.point_to_line(b.point, a.point, a.direction)) < 1e-9


def _face(f: Face, T: np.ndarray) -> Face:
    return replace(f, point=T[:3, :3] @ f.point + T[:3, 3], direction=T[:3, :3] @ f.direction)
