"""The mechanism on pieces of a path: poses of all bodies and gaps of all loops as Taylor models.

Bodies are placed along the spanning tree of the mechanism, joint by joint. A joint that is not in the tree closes a
loop: its two frames may differ only in its free directions. The rotation of a ball joint is a predicted rotation, which
moves along the piece, and three small turns about z, y and x after it; so every unknown is one number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof.motion.loop_gaps import ARM, gap_derivatives, gap_rows
from twin.proof.motion.taylor import TaylorModel, constant, cross, stacked
from twin.proof.rigid_frame import RigidFrame, joint_frames, rigid_frame

_PARTS: dict[str, tuple[str, ...]] = {
    "revolute": ("turn",),
    "prismatic": ("slide",),
    "cylindrical": ("slide", "turn"),
    "spherical": ("z", "y", "x"),
    "fixed": (),
}
"""The coordinates of each type of joint, in the order in which they move the child; see `LinkageCoordinate.part`."""

_AXES = {"turn": 2, "z": 2, "y": 1, "x": 0}
"""Number of the axis of the joint's frame about which a coordinate turns."""


@dataclass(frozen=True)
class PlacedFrame:
    """A frame in base: rotation (N, 3, 3) and origin (N, 3)."""

    R: TaylorModel
    p: TaylorModel

    def then(self, frame: RigidFrame) -> PlacedFrame:
        """Return the frame at a constant pose in this frame."""
        T = frame.T
        R = self.R @ T[:3, :3]
        p = self.p + (self.R @ T[:3, 3:])[..., 0]
        if frame.R_radius > 0 or frame.p_radius.any():
            sizes = self.R.sizes()
            R = R.widened((sizes.sum(axis=-1) * frame.R_radius)[..., None])
            p = p.widened(sizes @ frame.p_radius)
        return PlacedFrame(R, p)


@dataclass(frozen=True)
class LinkageCoordinate:
    """Where one coordinate stands in the mechanism.

    Attributes:
        joint: name of its joint.
        part: "turn" or "slide"; of a ball joint "z", "y", "x", its turns in this order.
        active: whether it is driven.
    """

    joint: str
    part: str
    active: bool

    @property
    def slides(self) -> bool:
        """Whether the coordinate is a length."""
        return self.part == "slide"


@dataclass(frozen=True)
class CoordinateAxes:
    """How each of m coordinates moves the bodies after it: axis (N, m, 3) and a point on it (N, m, 3), in base."""

    axes: TaylorModel
    centres: TaylorModel


@dataclass(frozen=True)
class PlacedLinkage:
    """All bodies on N pieces.

    Attributes:
        frames: {body: its frame in base}.
        motions: the motion by each coordinate.
    """

    frames: Mapping[str, PlacedFrame]
    motions: CoordinateAxes


class Linkage:
    """The tree of a mechanism, its coordinates and its loops.

    Attributes:
        mechanism: the mechanism.
        coordinates: the coordinates, in the order of the tree.
        driven, passive: indices of the driven coordinates, in the order of q, and of the others.
        tool: the tool frame on its body.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Find the coordinates.

        Raises:
            TwinError: a frame of a joint, or that of the tool, is no rotation but for rounding.
        """
        self.mechanism = mechanism
        self.coordinates: list[LinkageCoordinate] = []
        for joint in mechanism.tree:
            for part in _parts(joint):
                self.coordinates.append(LinkageCoordinate(joint.name, part, joint.active))
        self.passive = [i for i, coordinate in enumerate(self.coordinates) if not coordinate.active]
        # q has the order of the mechanism, which need not be that of the tree
        self.driven = [self.index(joint.name) for joint in mechanism.active]
        self._moving = self._moving_coordinates()
        self._frames: dict[str, tuple[RigidFrame, RigidFrame]] = {}
        for joint in mechanism.joints:
            self._frames[joint.name] = joint_frames(
                mechanism.name, joint.name, joint.T_parent_joint, joint.T_child_joint
            )
        tool = mechanism.frame(mechanism.tool)
        self.tool = rigid_frame(tool.T_body_frame, f"{mechanism.name}: frame {mechanism.tool}")

    @property
    def closes(self) -> bool:
        """Whether there are loops or couplings to close."""
        return bool(self.mechanism.loops or self.mechanism.couplings)

    def _moving_coordinates(self) -> dict[str, np.ndarray]:
        """Return {body: mask (m,) of the coordinates that move it}."""
        masks = {self.mechanism.base: np.zeros(len(self.coordinates), bool)}
        for joint in self.mechanism.tree:
            mask = masks[joint.parent].copy()
            mask[self.indices(joint.name)] = True
            masks[joint.child] = mask
        return masks

    def place(self, coordinates: TaylorModel, balls: Mapping[str, TaylorModel]) -> PlacedLinkage:
        """Return all bodies at coordinates (N, m) in m or rad.

        Args:
            coordinates: the coordinates; those of ball joints are the small turns after the predicted rotation.
            balls: {ball joint: its predicted rotation (N, 3, 3)}.
        """
        count = coordinates.shape[0]
        order = coordinates.order
        R_origin = constant(np.broadcast_to(np.eye(3), (count, 3, 3)), order)
        origin = PlacedFrame(R_origin, constant(np.zeros((count, 3)), order))
        frames = {self.mechanism.base: origin}
        axes = []
        centres = []
        index = 0  # of the coordinate
        for joint in self.mechanism.tree:
            on_parent, on_child = self._frames[joint.name]
            frame = frames[joint.parent].then(on_parent)
            if joint.name in balls:
                frame = PlacedFrame(frame.R @ balls[joint.name], frame.p)
            for part in _parts(joint):
                value = coordinates[:, index]
                if part == "slide":
                    axis = frame.R[..., 2]
                    frame = PlacedFrame(frame.R, frame.p + axis * value[:, None])
                else:
                    axis_number = _AXES[part]
                    axis = frame.R[..., axis_number]
                    frame = PlacedFrame(_turned(frame.R, value, axis_number), frame.p)
                axes.append(axis)
                centres.append(frame.p)
                index += 1
            frames[joint.child] = frame.then(on_child.inverse())
        if not axes:
            return PlacedLinkage(frames, CoordinateAxes(origin.p[:, None, :], origin.p[:, None, :]))
        return PlacedLinkage(frames, CoordinateAxes(stacked(axes, -2), stacked(centres, -2)))

    def relative(
        self, placed: PlacedLinkage, joint: Joint
    ) -> tuple[PlacedFrame, PlacedFrame, TaylorModel, TaylorModel]:
        """Return (frame on the parent, frame on the child, offset (N, 3), rotation (N, 3, 3)) of a joint.

        Offset and rotation are those of the second frame in the first.
        """
        on_parent, on_child = self._frames[joint.name]
        first = placed.frames[joint.parent].then(on_parent)
        second = placed.frames[joint.child].then(on_child)
        R_first_base = first.R.swapped()
        offset = (R_first_base @ (second.p - first.p)[..., None])[..., 0]
        return first, second, offset, R_first_base @ second.R

    def gaps(self, placed: PlacedLinkage, coordinates: TaylorModel) -> TaylorModel:
        """Return the gaps (N, rows) of all loops and couplings, in m; angles in rad are multiplied by `ARM`."""
        rows = []
        for joint in self.mechanism.loops:
            _, _, offset, R = self.relative(placed, joint)
            rows += gap_rows(joint, offset, R)
        for coupling in self.mechanism.couplings:
            total = constant(np.full(coordinates.shape[:1], -coupling.total), coordinates.order)
            for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
                total = total + coordinates[:, self.index(name)] * ratio
            rows.append(total * self._scale(coupling.joints[0]))
        return stacked(rows)

    def aligned(self, placed: PlacedLinkage) -> np.ndarray:
        """Return (N,) where no loop joint can be turned by half a turn, which its gaps do not show.

        The gaps are sines: they are zero too where the two z axes of a joint, or the y axes of one that cannot turn,
        are opposite.
        """
        is_aligned = np.ones(placed.motions.axes.shape[0], bool)
        for joint in self.mechanism.loops:
            if joint.type not in ("revolute", "cylindrical", "prismatic", "fixed"):
                continue
            _, _, _, R = self.relative(placed, joint)
            lowest_cosine, _ = R[:, 2, 2].range()  # of the angle between the z axes
            is_aligned &= lowest_cosine > 0
            if joint.type in ("prismatic", "fixed"):
                lowest_cosine, _ = R[:, 1, 1].range()  # of that between the y axes
                is_aligned &= lowest_cosine > 0
        return is_aligned

    def jacobian(self, placed: PlacedLinkage) -> TaylorModel:
        """Return the derivatives (N, rows, m) of the gaps with respect to the coordinates."""
        rows = []
        axes = placed.motions.axes
        slides = self._slides()
        for joint in self.mechanism.loops:
            first, second, _, R = self.relative(placed, joint)
            # a coordinate that moves both bodies, or none, changes no gap; one of the parent counts backwards
            relative_motion = self._moving[joint.child].astype(float) - self._moving[joint.parent]
            axes_in_first = (axes @ first.R) * relative_motion[:, None]
            turns = axes_in_first * (~slides)[:, None].astype(float)
            lever = second.p[:, None, :] - placed.motions.centres
            offsets_by_turns = (cross(axes, lever) @ first.R) * (relative_motion * ~slides)[:, None]
            offsets_by_slides = axes_in_first * slides[:, None].astype(float)
            rows += gap_derivatives(joint, offsets_by_turns + offsets_by_slides, turns, R)
        for coupling in self.mechanism.couplings:
            row = np.zeros((axes.shape[0], len(self.coordinates)))
            for name, ratio in zip(coupling.joints, coupling.ratios, strict=True):
                row[:, self.index(name)] = ratio * self._scale(coupling.joints[0])
            rows.append(constant(row, axes.order))
        return stacked(rows, -2)

    def twist(
        self, placed: PlacedLinkage, body: str, p: TaylorModel, rates: TaylorModel
    ) -> tuple[TaylorModel, TaylorModel]:
        """Return (velocity (N, 3) of a point of a body at p (N, 3), its angular velocity (N, 3)), both in base.

        `rates` (N, m) are the rates of the coordinates.
        """
        slides = self._slides()
        is_moved = self._moving[body]
        axes = placed.motions.axes
        lever = p[:, None, :] - placed.motions.centres
        turning = axes * rates[..., None] * (is_moved & ~slides)[:, None].astype(float)
        sliding = axes * rates[..., None] * (is_moved & slides)[:, None].astype(float)
        velocity = (cross(turning, lever) + sliding).total(-2)
        return velocity, turning.total(-2)

    def _slides(self) -> np.ndarray:
        """Return (m,) which coordinates are lengths."""
        return np.array([coordinate.slides for coordinate in self.coordinates])

    def indices(self, joint: str) -> list[int]:
        """Return the indices of the coordinates of a joint of the tree."""
        indices = []
        for i, coordinate in enumerate(self.coordinates):
            if coordinate.joint == joint:
                indices.append(i)
        return indices

    def index(self, joint: str) -> int:
        """Return the index of the (last) coordinate of a joint of the tree."""
        return self.indices(joint)[-1]

    def _scale(self, joint: str) -> float:
        """Return the length in m of a unit of a joint's coordinate, in gaps: `ARM` of an angle, 1 of a length."""
        if self.mechanism.joint(joint).is_angle:
            return ARM
        return 1.0

    def coordinates_at(self, poses: Mapping[str, Array]) -> tuple[Array, dict[str, Array]]:
        """Return (coordinates (k, m), {ball joint: rotations (k, 3, 3)}) at body poses {body: (k, 4, 4)}."""
        columns = []
        balls = {}
        for joint in self.mechanism.tree:
            T = joint.relative(poses[joint.parent], poses[joint.child])
            if joint.type == "spherical":
                # the rotation is the predicted one: its small turns are 0
                balls[joint.name] = T[:, :3, :3]
                columns += [np.zeros(len(T))] * 3
                continue
            for part in _parts(joint):
                if part == "slide":
                    columns.append(T[:, 2, 3])
                else:
                    columns.append(np.asarray(joint.angle(T), float))
        return np.stack(columns, axis=1), balls


def supported(mechanism: Mechanism) -> str:
    """Return why a mechanism cannot be proved along a path; "" if it can."""
    for joint in mechanism.tree:
        if joint.type == "free":
            return f"joint {joint.name} is free in all six directions: give the robot a base"
        if joint.active and joint.type not in ("revolute", "prismatic"):
            return f"joint {joint.name} is driven and {joint.type}: only revolute and prismatic driven joints are known"
    spanning = {joint.name for joint in mechanism.tree}
    for joint in mechanism.active:
        if joint.name not in spanning:
            return f"driven joint {joint.name} closes a loop: list it before the joint that should close the loop"
    return ""


def _parts(joint: Joint) -> tuple[str, ...]:
    """Return the coordinates of a joint, in the order in which they move the child."""
    return _PARTS.get(joint.type, ())


def _turned(R: TaylorModel, angle: TaylorModel, axis: int) -> TaylorModel:
    """Return R (N, 3, 3) turned about its own axis 0, 1 or 2 by angles (N,)."""
    sine, cosine = angle.sine_cosine()
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    columns = [R[..., 0], R[..., 1], R[..., 2]]
    columns[i] = R[..., i] * cosine[:, None] + R[..., j] * sine[:, None]
    columns[j] = R[..., j] * cosine[:, None] - R[..., i] * sine[:, None]
    return stacked(columns)


def rotation_of(quaternions: TaylorModel) -> TaylorModel:
    """Return the rotations (N, 3, 3) of quaternions (N, 4), scalar first, of any length."""
    w = quaternions[:, 0]
    x = quaternions[:, 1]
    y = quaternions[:, 2]
    z = quaternions[:, 3]
    ww = w * w
    xx = x * x
    yy = y * y
    zz = z * z
    # divided by the square of the length: the quaternions need not be unit ones
    share = (ww + xx + yy + zz).inverted()  # 1 / |quaternion|^2
    entries = [
        [ww + xx - yy - zz, (x * y - w * z) * 2.0, (x * z + w * y) * 2.0],
        [(x * y + w * z) * 2.0, ww - xx + yy - zz, (y * z - w * x) * 2.0],
        [(x * z - w * y) * 2.0, (y * z + w * x) * 2.0, ww - xx - yy + zz],
    ]
    rows = [stacked(row) for row in entries]
    return stacked(rows, -2) * share[:, None, None]
