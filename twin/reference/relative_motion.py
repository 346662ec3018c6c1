"""Upper bound of the relative motion of two bodies while the joints of the mechanism move.

Only coordinates that move exactly one of the two bodies count. A slide by dx moves a body by dx. A rotation by dx moves
any point of the body by at most rho dx, where rho is the largest possible distance of the body's points from the axis.
Let the axis be that of joint 1, and let joints 2, 3, ... follow up to the body. At any joint values, rho is at most the
sum of four terms: the distance of the origin of joint 2 from the axis; the lengths of the offsets from joint 2 to joint
3 and so on; the largest distance of the body's points from the origin of its last joint; the extensions of sliding
joints between axis and body. For a slide, let rho be 1. Let L(s0, s1) be the path length of a coordinate along q(s)
from s0 to s1. In this interval, two points of the pair approach each other by at most the sum of rho L(s0, s1) over
all coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports] - installed beside site-packages

from twin.core.spatial import Array
from twin.reference.tree import Tree

PlacedVertices = tuple[int, Array]
"""(number of the Pinocchio joint that carries a body, 0 if at rest; vertices (m, 3) in the frame of this joint)."""


_BALL = "JointModelSpherical"


class GlobalMotionBounds:
    """Upper bounds of the relative motion of pairs of bodies at any joint values, per m or rad of each coordinate."""

    def __init__(self, tree: Tree, pairs: Sequence[tuple[PlacedVertices, PlacedVertices]]) -> None:
        self._tree = tree
        model = tree.model
        self._fixed_rho = np.zeros((len(pairs), model.nv))
        # (Pinocchio number of a slide, mask (pairs, nv) of affected rho)
        self._slides: list[tuple[int, Array]] = []
        slide_masks: dict[int, Array] = {}
        for number in range(1, model.njoints):
            if _is_slide(model, number) and model.joints[number].nq == 1:
                slide_masks[number] = np.zeros_like(self._fixed_rho)
        for row, (a, b) in enumerate(pairs):
            for body, partner in ((a, b), (b, a)):
                number, vertices = body
                partner_number, _ = partner
                for j in self._above(number):
                    if partner_number and self._tree.moves(partner_number)[model.joints[j].idx_v]:
                        continue  # the joint moves both bodies
                    self._add_rho(row, j, number, vertices, slide_masks)
        for number, mask in slide_masks.items():
            if mask.any():
                self._slides.append((number, mask))

    def _above(self, number: int) -> list[int]:
        """Return the joint `number` and all joints between this joint and the base."""
        joints_above = []
        while number:
            joints_above.append(number)
            number = self._tree.model.parents[number]
        return joints_above

    def _add_rho(self, row: int, j: int, number: int, vertices: Array, slide_masks: dict[int, Array]) -> None:
        """Add the rho of joint `j` for the body of joint `number`, with its `vertices`, to row `row`.

        `slide_masks` holds, by the number of each slide, the mask (pairs, nv) of the rho that its extension increases.
        """
        model = self._tree.model
        joint = model.joints[j]
        columns = slice(joint.idx_v, joint.idx_v + joint.nv)
        if _is_slide(model, j) and joint.nv == 1:
            self._fixed_rho[row, columns] += 1.0
            return
        above = self._above(number)
        between = above[: above.index(j)][::-1]  # in outward order from j
        if not between:
            if joint.nv == 1:
                vertices = vertices[:, :2]  # the distance from an axis; else, from a point
            rho = np.linalg.norm(vertices, axis=1).max(initial=0.0)
        else:
            first = model.jointPlacements[between[0]].translation
            if joint.nv == 1:
                first = first[:2]
            offsets = []
            for k in between[1:]:
                offsets.append(np.linalg.norm(model.jointPlacements[k].translation))
            rho = np.linalg.norm(first)
            rho += sum(offsets)
            rho += np.linalg.norm(vertices, axis=1).max(initial=0.0)
        size = np.full(joint.nv, rho)
        if joint.nv == 6:
            size[:3] = 1.0  # translations of a free joint
        self._fixed_rho[row, columns] += size
        for k in between:
            if k in slide_masks:
                slide_masks[k][row, columns] += 1.0

    def bounds(self, X: Array, beyond: Array) -> Array:
        """Return bounds (pairs, nv) in m: relative motion of each pair per m or rad of each coordinate.

        Args:
            X: (k, nq) configurations along the motion.
            beyond: (nv,) in m or rad, how far each coordinate may move beyond its range in X.
        """
        joints = self._tree.model.joints
        bounds = self._fixed_rho.copy()
        for number, mask in self._slides:
            slide = joints[number]
            extension = np.abs(X[:, slide.idx_q]).max() + beyond[slide.idx_v]
            bounds += mask * extension
        return bounds


class LocalMotionBounds:
    """Bounds of the relative motion of pairs of bodies around given states, much smaller than `GlobalMotionBounds`.

    All joints of the tree must be revolute, prismatic or ball joints. In a state, let rho be the distance of a body's
    farthest point from an axis, or from the centre of a ball joint. While the joints between axis and body move the
    body by at most S, rho grows by at most S. Therefore S is summed from the body to the base: a rotation by dx
    adds (rho + S) dx to S, a translation adds dx.
    """

    def __init__(self, tree: Tree, numbers: np.ndarray, pairs: np.ndarray) -> None:
        """Define bodies and pairs.

        Args:
            tree: the tree; see `possible`.
            numbers: (bodies,) Pinocchio joint that carries each body, 0 if at rest.
            pairs: (pairs, 2) indices of the bodies.
        """
        model = tree.model
        above = np.zeros((len(numbers), model.njoints), bool)
        for row, number in enumerate(numbers.tolist()):
            joint = number
            while joint:
                above[row, joint] = True
                joint = model.parents[joint]
        shared = above[pairs[:, 0]] & above[pairs[:, 1]]
        last_shared = model.njoints - 1 - np.argmax(shared[:, ::-1], axis=1)
        last_shared_joint = np.where(shared.any(axis=1), last_shared, 0)
        self._joints, self._bodies = np.nonzero(above.T)
        self._columns = np.zeros(model.njoints, int)
        self._balls = np.zeros(model.njoints, bool)
        for number, joint in enumerate(model.joints):
            self._columns[number] = joint.idx_v
            self._balls[number] = joint.shortname() == _BALL
        # by joint: the pairs whose last common joint it is, its rows in `_joints`, and whether it rotates
        self._pairs_parting_at: list[np.ndarray] = []
        self._rows_of_joint: list[np.ndarray] = []
        self._rotates: list[bool] = []
        for number in range(model.njoints):
            self._pairs_parting_at.append(np.flatnonzero(last_shared_joint == number))
            self._rows_of_joint.append(np.flatnonzero(self._joints == number))
            self._rotates.append(number > 0 and not _is_slide(model, number))
        self._body_pairs = pairs

    @staticmethod
    def possible(tree: Tree) -> bool:
        """Return whether every joint of a tree is a rotation about z, a translation along z, or a ball joint."""
        # joint 0 is the base, which has no type
        for joint in list(tree.model.joints)[1:]:
            if joint.shortname() not in ("JointModelRZ", "JointModelPZ", _BALL):
                return False
        return True

    def bounds(self, joints: Array, centres: Array, radii: Array, moved: Array) -> Array:
        """Return bounds (pairs, k) in m of the relative motion of each pair.

        Args:
            joints: (k, joints, 4, 4) poses of all joint frames in base.
            centres: (bodies, 3, k) centre of a ball around each body, in base.
            radii: (bodies,) radius of this ball in m.
            moved: (k, nv) in m or rad, largest motion of each coordinate.
        """
        # the states last: numpy is fast along the last axis
        steps = moved.T[self._columns]
        place = np.ascontiguousarray(np.moveaxis(joints[:, :, :3, 2:], 0, -1))
        axis = place[self._joints, :, 0]
        offsets = centres[self._bodies] - place[self._joints, :, 1]
        along = (offsets * axis).sum(axis=1)
        for number in np.flatnonzero(self._balls):
            # the sum, not the norm: the body may rotate about each of the three axes in turn
            column = self._columns[number]
            steps[number] = moved[:, column : column + 3].sum(axis=1)
            along[self._joints == number] = 0.0
        across = np.maximum((offsets * offsets).sum(axis=1) - along**2, 0.0)
        rho = np.sqrt(across) + radii[self._bodies, None]
        total = np.zeros((len(radii), len(joints)))  # S of each body, so far
        bounds = np.zeros((len(self._body_pairs), len(joints)))
        # from the bodies to the base; 0 is the base, which does not move
        for number in range(len(self._columns) - 1, -1, -1):
            pairs = self._pairs_parting_at[number]
            if len(pairs):
                a, b = self._body_pairs[pairs].T
                bounds[pairs] = total[a] + total[b]
            if not number:
                break
            rows_of_joint = self._rows_of_joint[number]
            bodies = self._bodies[rows_of_joint]
            motion_per_step = 1.0
            if self._rotates[number]:
                motion_per_step = rho[rows_of_joint] + total[bodies]
            total[bodies] += steps[number] * motion_per_step
        return bounds


def _is_slide(model: pin.Model, number: int) -> bool:
    """Return whether a joint of Pinocchio, given by its number, is a translation along z."""
    return model.joints[number].shortname() == "JointModelPZ"
