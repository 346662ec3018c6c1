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

Placed = tuple[int, Array]
"""(number of the Pinocchio joint that carries a body, 0 if at rest; vertices (m, 3) in the frame of this joint)."""


_BALL = "JointModelSpherical"


class Reach:
    """Upper bounds of the relative motion of pairs of bodies, per m or rad of each coordinate."""

    def __init__(self, tree: Tree, pairs: Sequence[tuple[Placed, Placed]]) -> None:
        self._tree = tree
        model = tree.model
        self._fixed = np.zeros((len(pairs), model.nv))
        self._slides: list[tuple[int, Array]] = []  # (configuration index of a slide, mask (pairs, nv) of affected rho)
        sliding = [n for n in range(1, model.njoints) if model.joints[n].nq == 1 and _slides(model, n)]
        adds = {n: np.zeros_like(self._fixed) for n in sliding}
        for row, (a, b) in enumerate(pairs):
            for (number, vertices), other in ((a, b[0]), (b, a[0])):
                for j in self._above(number):
                    if tree.moves(other)[model.joints[j].idx_v] if other else False:
                        continue  # the joint moves both bodies
                    self._fill(row, j, number, vertices, adds)
        self._slides = [(model.joints[n].idx_q, where) for n, where in adds.items() if where.any()]

    def _above(self, number: int) -> list[int]:
        """Return the joint `number` and all joints between this joint and the base."""
        out = []
        while number:
            out.append(number)
            number = self._tree.model.parents[number]
        return out

    def _fill(self, row: int, j: int, number: int, vertices: Array, adds: dict[int, Array]) -> None:
        model = self._tree.model
        joint = model.joints[j]
        columns = slice(joint.idx_v, joint.idx_v + joint.nv)
        if _slides(model, j) and joint.nv == 1:
            self._fixed[row, columns] += 1.0
            return
        between = self._above(number)
        between = between[: between.index(j)][::-1]  # in outward order from j
        if not between:
            across = np.linalg.norm(vertices[:, :2] if joint.nv == 1 else vertices, axis=1).max(initial=0.0)
        else:
            first = model.jointPlacements[between[0]].translation
            across = np.linalg.norm(first[:2] if joint.nv == 1 else first)
            across += sum(np.linalg.norm(model.jointPlacements[k].translation) for k in between[1:])
            across += np.linalg.norm(vertices, axis=1).max(initial=0.0)
        size = np.full(joint.nv, across)
        if joint.nv == 6:
            size[:3] = 1.0
        self._fixed[row, columns] += size
        for k in between:
            if k in adds:
                adds[k][row, columns] += 1.0

    def bounds(self, X: Array, ahead: Array) -> Array:
        """Return bounds (pairs, nv) in m: relative motion of each pair per m or rad of each coordinate.

        Args:
            X: (k, nq) configurations along the motion.
            ahead: (nv,) in m or rad, how far each coordinate may move beyond its range in X.
        """
        out = self._fixed.copy()
        for place, where in self._slides:
            column = int(np.flatnonzero([j.idx_q == place for j in self._tree.model.joints])[-1])
            out += where * (np.abs(X[:, place]).max() + ahead[self._tree.model.joints[column].idx_v])
        return out


class Levers:
    """Bounds of the relative motion of pairs of bodies around given states; much smaller than those of `Reach`.

    All joints of the tree must be revolute, prismatic or ball joints. In a state, let rho be the distance of a body's
    farthest point from an axis, or from the centre of a ball joint. While the joints between axis and body move the
    body by at most S, rho grows by at most S. Therefore S is summed from the body to the base: a rotation by dx adds
    (rho + S) dx to S, a translation adds dx.
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
        for row, number in enumerate(int(n) for n in numbers):
            while number:
                above[row, number] = True
                number = model.parents[number]
        shared = above[pairs[:, 0]] & above[pairs[:, 1]]
        highest = np.where(shared.any(axis=1), model.njoints - 1 - np.argmax(shared[:, ::-1], axis=1), 0)
        self._pairs = [np.flatnonzero(highest == n) for n in range(model.njoints)]
        self._joints, self._bodies = np.nonzero(above.T)
        self._moved = [np.flatnonzero(self._joints == n) for n in range(model.njoints)]
        self._columns = np.array([j.idx_v for j in model.joints])
        self._balls = np.array([j.shortname() == _BALL for j in model.joints])
        self._turn = [n > 0 and not _slides(model, n) for n in range(model.njoints)]
        self._rows = pairs

    @staticmethod
    def possible(tree: Tree) -> bool:
        """Return whether every joint of a tree is a rotation about z, a translation along z, or a ball joint."""
        kinds = {tree.model.joints[n].shortname() for n in range(1, tree.model.njoints)}
        return kinds <= {"JointModelRZ", "JointModelPZ", _BALL}

    def bounds(self, joints: Array, centres: Array, radii: Array, moved: Array) -> Array:
        """Return bounds (pairs, k) in m of the relative motion of each pair.

        Args:
            joints: (k, joints, 4, 4) poses of all joint frames in base.
            centres: (bodies, 3, k) centre of a ball around each body, in base.
            radii: (bodies,) radius of this ball in m.
            moved: (k, nv) in m or rad, largest motion of each coordinate.
        """
        # the states last: numpy is fast along the last axis
        steps, place = moved.T[self._columns], np.ascontiguousarray(np.moveaxis(joints[:, :, :3, 2:], 0, -1))
        off = centres[self._bodies] - place[self._joints, :, 1]
        along = (off * place[self._joints, :, 0]).sum(axis=1)
        for n in np.flatnonzero(self._balls):
            # the sum, not the norm: the body may rotate about each of the three axes in turn
            steps[n] = moved[:, self._columns[n] : self._columns[n] + 3].sum(axis=1)
            along[self._joints == n] = 0.0
        rho = np.sqrt(np.maximum((off * off).sum(axis=1) - along**2, 0.0)) + radii[self._bodies, None]
        total, out = np.zeros((len(radii), len(joints))), np.zeros((len(self._rows), len(joints)))
        for n in range(len(self._columns) - 1, -1, -1):
            if len(here := self._pairs[n]):
                a, b = self._rows[here].T
                out[here] = total[a] + total[b]
            which = self._moved[n]
            if n:
                total[self._bodies[which]] += steps[n] * (
                    rho[which] + total[self._bodies[which]] if self._turn[n] else 1.0
                )
        return out


def _slides(model: pin.Model, number: int) -> bool:
    return model.joints[number].shortname() == "JointModelPZ"
