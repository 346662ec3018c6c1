"""The proxy of a tool among planes: the nearest point outside all of them, computed exactly in a fixed time.

The smallest displacement w that leaves planes with normals n_i and depths x_i minimises |w|^2 / 2, subject to
n_i . w >= x_i (Zilles and Salisbury, IROS 1995; Ruspini, Kolarov and Khatib, SIGGRAPH 1997). If planes squeeze the
tool, as in a slot narrower than the tool, either there is no such w, or w is long and its direction is sensitive
to the normals. Therefore w minimises |w|^2 / 2 + REACH s, where s >= 0 is the largest depth that remains. If a short
displacement leaves all planes, s is 0. Otherwise, w is the displacement of a tool that is smaller by s on all sides and
therefore fits: in a slot, w moves the tool to the middle.

The dual problem has a push p_i >= 0 for each plane, and the sum of all p_i is REACH. The condition s >= 0 adds a plane
with n = 0 and x = 0. There is an optimum with at most four positive pushes. It is therefore the best of the
stationary points of all sets of up to four planes (docs/derivations.md). There are few planes, hence all sets are
computed: the number of operations is the same in each tick, without iterations and without branches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import casadi as ca

from twin.simulation.local_plane import PLANE_SIZE

REACH = 0.1
"""Sum of all pushes in m; ASSUMED. Each mm of the way must reduce the largest depth by more than |way| / REACH mm."""

_LARGEST_SET = 4
"""Number of planes in the largest set."""

_LEAST_PIVOT = 1e-10
"""Pivot above which the planes of a set are independent."""

_LEAST_DUAL_VALUE = 1e-20
"""Dual value in m2 above which a set is used."""


@dataclass(frozen=True)
class _PlaneSet:
    """A set of planes, with the factors L D L' of the matrix G with the elements n_i . n_j + 1.

    Attributes:
        planes: indices of the planes.
        regular: whether the planes are independent.
        rows, pivots: rows of L, left of the diagonal; diagonal of D.
        depths, ones: D^-1 L^-1 times depths x and times (1, ..., 1).
        way, unit: sums of the components of G^-1 x and of G^-1 (1, ..., 1).
    """

    planes: tuple[int, ...] = ()
    regular: ca.SX = field(default_factory=lambda: ca.SX(1))
    rows: tuple[tuple[ca.SX, ...], ...] = ()
    pivots: tuple[ca.SX, ...] = ()
    depths: tuple[ca.SX, ...] = ()
    ones: tuple[ca.SX, ...] = ()
    way: ca.SX = field(default_factory=lambda: ca.SX(0))
    unit: ca.SX = field(default_factory=lambda: ca.SX(0))

    def with_plane(self, k: int, gram: Sequence[Sequence[ca.SX]], x: Sequence[ca.SX]) -> _PlaneSet:
        """Return the set with plane k added."""
        scaled: list[ca.SX] = []  # the new row of L D
        row: list[ca.SX] = []  # the new row of L
        pivot = gram[k][k]
        depth = x[k]
        one = ca.SX(1)
        for i, plane in enumerate(self.planes):
            product = ca.SX(0)
            for new, old in zip(scaled, self.rows[i], strict=False):  # a row ends left of the diagonal
                product = product + new * old
            c = gram[k][plane] - product
            pivot = pivot - c * c / self.pivots[i]
            depth = depth - c * self.depths[i]
            one = one - c * self.ones[i]
            scaled.append(c)
            row.append(c / self.pivots[i])
        return _PlaneSet(
            planes=(*self.planes, k),
            regular=ca.logic_and(self.regular, pivot > _LEAST_PIVOT),
            rows=(*self.rows, tuple(row)),
            pivots=(*self.pivots, pivot),
            depths=(*self.depths, depth / pivot),
            ones=(*self.ones, one / pivot),
            way=self.way + one * (depth / pivot),
            unit=self.unit + one * (one / pivot),
        )

    def solved(self, x: Sequence[ca.SX]) -> tuple[list[ca.SX], ca.SX, ca.SX]:
        """Return (stationary pushes in m with sum REACH, whether all are non-negative, twice the dual value in m2)."""
        s = (self.way - REACH * (1 - self.unit)) / self.unit
        pushes = []
        for depth, one in zip(self.depths, self.ones, strict=True):
            pushes.append(depth + (REACH - s) * one)
        # back substitution with the transpose of L
        for j in reversed(range(len(pushes))):
            for i in range(j):
                pushes[i] = pushes[i] - self.rows[j][i] * pushes[j]
        is_valid = self.regular
        value = s * REACH
        for plane, push in zip(self.planes, pushes, strict=True):
            is_valid = ca.logic_and(is_valid, push >= 0)
            value = value + x[plane] * push
        return pushes, is_valid, value


def _plane_sets(
    gram: Sequence[Sequence[ca.SX]], x: Sequence[ca.SX], start: _PlaneSet | None = None
) -> Iterator[_PlaneSet]:
    """Yield all sets of one to `_LARGEST_SET` planes."""
    start = start or _PlaneSet()
    # in ascending order, so that each set comes once
    first = 0
    if start.planes:
        first = start.planes[-1] + 1
    for k in range(first, len(x)):
        larger = start.with_plane(k, gram, x)
        yield larger
        if len(larger.planes) < _LARGEST_SET:
            yield from _plane_sets(gram, x, larger)


def proxy(planes: ca.SX, T_world_tool: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the expressions (way (3,), pull (3,)), in m in the World.

    The way is the displacement from the point in contact to its proxy: the sum of the planes' pushes times their
    normals. The pull is the same sum with levers instead of normals; the force at the tool acts along the pull.

    Args:
        planes: (k, WIDTH) rows of `local_plane`.
        T_world_tool: (4, 4) pose of the tool.
    """
    p = T_world_tool[:3, 3]
    R = T_world_tool[:3, :3]
    # The first row (0) is the plane of s >= 0; unused rows are 0 as well.
    rows = ca.vertcat(ca.SX(1, PLANE_SIZE), planes)
    count = rows.shape[0]
    levers = []
    normals = []
    depths = []
    for i in range(count):
        lever = rows[i, 0:3].T
        normal = rows[i, 3:6].T
        levers.append(lever)
        normals.append(normal)
        depths.append(rows[i, 9] - ca.dot(lever, p) - ca.dot(normal, R @ rows[i, 6:9].T))
    gram = []
    for i in range(count):
        gram.append([ca.dot(normals[i], normals[j]) + 1 for j in range(i + 1)])
    best = ca.SX(_LEAST_DUAL_VALUE)
    candidates = []
    for planes_set in _plane_sets(gram, depths):
        pushes, is_valid, value = planes_set.solved(depths)
        value = ca.if_else(is_valid, value, 0)
        candidates.append((planes_set.planes, pushes, value, value > best))
        best = ca.fmax(best, value)
    push = [ca.SX(0)] * count
    for planes_of_set, pushes, value, is_better in candidates:
        # of equal sets, only the first is better than those before it
        is_best = ca.logic_and(is_better, value == best)
        for plane, plane_push in zip(planes_of_set, pushes, strict=True):
            push[plane] = push[plane] + ca.if_else(is_best, plane_push, 0)
    displacement = ca.SX.zeros(3)
    pull = ca.SX.zeros(3)
    for normal, lever, plane_push in zip(normals, levers, push, strict=True):
        displacement = displacement + normal * plane_push
        pull = pull + lever * plane_push
    return displacement, pull
