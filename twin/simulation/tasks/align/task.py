"""The camera task: a grey line that is fixed in the picture, and a green rectangle on a plate in the scene.

The user turns the camera until the upper side of the rectangle coincides with the line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field, model_validator

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM, linear_rgba
from twin.model.body import Body, Finish, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.task import TaskKind
from twin.schema import Row, Table, Vector, at

BODY = "target"
"""Name of the drawn body: a plate with the rectangle."""

RECTANGLE = "target_rectangle"
"""Name of the rectangle's surface."""

_PLATE_RGBA = (0.08, 0.085, 0.09, 1.0)
_PLATE_THICKNESS = 2e-3
"""Thickness of the plate in m."""

_RECTANGLE_GAP = 1e-4
"""Distance in m from the plate to the rectangle, so that the plate does not hide it."""

_BOX_FACES = ((3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
"""Corners of the faces of the plate, counter-clockwise seen from outside: its back first, then its front."""


class AlignTable(Table):
    """A green rectangle on a plate, and a grey line in the middle of the picture; the task is to align them.

    The rectangle's middle is at `position_mm` in the world frame; `facing` points out of the plate. `roll_deg` is the
    rotation of the rectangle about `facing`; at 0, the upper side is horizontal. `line` is the length of the line
    divided by the height of the picture. The task is done if two conditions hold at its end: the angle between the line
    and the rectangle's upper side is at most `tolerance_deg`, and the distance between the ends of the side and the
    ends of the line is at most `tolerance_line` times the length of the line.
    """

    position_mm: Vector
    facing: Vector
    roll_deg: float = Field(gt=-45, lt=45)
    size_mm: tuple[float, float]
    plate_mm: tuple[float, float]
    color: str = Field("#20a040", pattern="^#[0-9a-f]{6}$", description="sRGB; green must exceed red and blue")
    line: float = Field(ge=0.1, le=0.95)
    tolerance_deg: float = Field(gt=0, le=10)
    tolerance_line: float = Field(gt=0, le=0.5)

    @model_validator(mode="after")
    def _whole(self) -> AlignTable:
        length = math.hypot(*self.facing)
        if not 1e-6 <= length <= 1e6:
            raise at("facing", f"{list(self.facing)} has the length {length:g}; it must be 1e-6 to 1e6")
        if not math.hypot(*self.facing[:2]) > 1e-6 * length:
            raise at("facing", f"{list(self.facing)} is vertical: the plate then has no upper side")
        if min(self.size_mm) <= 0:
            raise at("size_mm", f"width and height must be above 0 mm; {list(self.size_mm)} was given")
        if self.plate_mm[0] <= self.size_mm[0] or self.plate_mm[1] <= self.size_mm[1]:
            raise at("plate_mm", f"the plate {list(self.plate_mm)} must be larger than the rectangle")
        red, green, blue = bytes.fromhex(self.color[1:])
        # the measurement finds the rectangle by its colour alone
        if green < 1.5 * max(red, blue):
            raise at("color", f"{self.color} is not green enough to be found in the picture: green must be at least "
                     "1.5 times red and blue")  # fmt: skip
        return self


@dataclass(frozen=True)
class Alignment:
    """A rectangle on a plate, and a line in the picture; the rectangle's upper side must be aligned with the line.

    Attributes:
        T_world_plate: (4, 4) frame at the rectangle's middle: x to the right, parallel to the upper side; y towards the
            upper side; z out of the plate.
        size: width and height of the rectangle in m.
        plate: width and height of the plate in m.
        color_rgba: colour of the rectangle, linear, 0..1.
        line: length of the line in the middle of the picture, divided by the height of the picture.
        tolerance: maximum angle in rad between line and upper side at the end of the task.
        off: maximum distance between an end of the upper side and the corresponding end of the line, divided by the
            length of the line.
    """

    T_world_plate: Array
    size: tuple[float, float]
    plate: tuple[float, float]
    color_rgba: tuple[float, float, float, float]
    line: float
    tolerance: float
    off: float

    @property
    def upper(self) -> Array:
        """Left and right end (2, 3) in m of the rectangle's upper side in the World."""
        w, h = self.size
        return self._in_world(np.array([[-w / 2, h / 2, _RECTANGLE_GAP], [w / 2, h / 2, _RECTANGLE_GAP]]))

    def _in_world(self, p_plate: Array) -> Array:
        """Return points (n, 3) in the World for points (n, 3) in the frame of the plate, in m."""
        T = self.T_world_plate
        return p_plate @ T[:3, :3].T + T[:3, 3]

    def body(self) -> Body:
        """Return the plate and the rectangle as a drawn body in the World frame."""
        box = np.concatenate([_corners(self.plate, -_PLATE_THICKNESS), _corners(self.plate, 0.0)])
        triangles = []
        for a, b, c, d in _BOX_FACES:
            triangles += [(a, b, c), (a, c, d)]
        rectangle = _corners(self.size, _RECTANGLE_GAP)
        halves = [(0, 1, 2), (0, 2, 3)]
        finish = Finish(roughness=0.9)
        meshes = (
            Mesh(f"{BODY}_plate", self._in_world(box), np.array(triangles, np.int32), _PLATE_RGBA, finish),
            Mesh(RECTANGLE, self._in_world(rectangle), np.array(halves, np.int32), self.color_rgba, finish),
        )
        return Body(BODY, meshes)


def _corners(size: tuple[float, float], z: float) -> Array:
    """Return the corners (4, 3) of a rectangle with this width and height at z, counter-clockwise from below left."""
    x = size[0] / 2
    y = size[1] / 2
    return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])


def beside(props: Mechanism | None, alignment: Alignment | None) -> Mechanism | None:
    """Return one mechanism with the props of a scene and the plate of a task, all fixed in the World.

    Without an alignment, the props are returned as they are.
    """
    if alignment is None:
        return props
    scenery = props
    if scenery is None:  # a scene without props: a base without a shape carries the plate
        base = Body("scenery")
        scenery = Mechanism(base.name, base.name, (base,), (), rest={base.name: np.eye(4)})
    T = spatial.inverse(scenery.rest[scenery.base])
    joint = Joint(f"{BODY}_stands", "fixed", scenery.base, BODY, T_parent_joint=T)
    return replace(
        scenery,
        bodies=(*scenery.bodies, alignment.body()),
        joints=(*scenery.joints, joint),
        rest={**scenery.rest, BODY: np.eye(4)},
    )


def frame(middle: Array, facing: Array, roll: float) -> Array:
    """Return the frame (4, 4) of a plate: z is along `facing`, and x is horizontal before a rotation by `roll` about z.

    `middle` (3,) is the middle of the rectangle in m. `facing` (3,) is the direction out of the plate; it must not be
    vertical. `roll` is counter-clockwise as seen from in front of the plate, in rad.
    """
    z = facing / np.linalg.norm(facing)
    x = np.cross([0.0, 0.0, 1.0], z)
    x = x / np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z]) @ spatial.rotation_z(roll)
    return spatial.pose(R, middle)


def _goal(a: AlignTable) -> Alignment:
    """Return the `Alignment` that a table describes, in SI units."""
    return Alignment(
        frame(np.array(a.position_mm) * MM, np.array(a.facing, float), a.roll_deg * DEG),
        (a.size_mm[0] * MM, a.size_mm[1] * MM),
        (a.plate_mm[0] * MM, a.plate_mm[1] * MM),
        linear_rgba(a.color),
        a.line,
        a.tolerance_deg * DEG,
        a.tolerance_line,
    )


def _rows(a: AlignTable) -> Iterator[Row]:
    """Yield (name, value, unit) of each number of an alignment."""
    yield "rectangle", a.position_mm, "mm"
    for what, (width, height) in (("rectangle", a.size_mm), ("plate", a.plate_mm)):
        yield f"{what} width", width, "mm"
        yield f"{what} height", height, "mm"
    yield "facing", a.facing, "1"
    yield "roll", a.roll_deg, "deg"
    yield "tolerance", a.tolerance_deg, "deg"
    yield "line", a.line, "1"
    yield "tolerance of the line", a.tolerance_line, "1"


KIND = TaskKind(
    name="align",
    title="a camera to align with a rectangle",
    order=40,
    field=(AlignTable | None, None),
    goal=_goal,
    rows=_rows,
    props=True,
    judged=True,
    package=__package__,
)
