"""Rates of all coordinates of a mechanism with closed loops, from those of the driven ones."""

from __future__ import annotations

import numpy as np

from twin.proof.motion.closure import MARGIN, ClosedLinkage
from twin.proof.motion.linkage import Linkage
from twin.proof.motion.taylor import TaylorModel

_STEPS = 8
"""Number of steps in which the bound of the errors approaches one that is mapped into itself."""

_FACTOR = 1.5
"""Factor by which this bound is increased before it is tested: the steps approach it from below."""

_SMALLEST_ERROR = 1e-15
"""Smallest bound of the error of a rate, in m or rad per unit of s."""


def rates(closed: ClosedLinkage, linkage: Linkage, driven: TaylorModel) -> TaylorModel:
    """Return the rates (N, m) of all coordinates, for rates (N, n) of the driven ones; infinite where not closed.

    The passive rates y solve A J y = -A J_driven driven. An approximate solution with the remainder e is off by an
    error d with d = (1 - A J) d - e. A bound b with |e| + |1 - A J| b <= b is mapped into itself, so that d is within
    b: such a bound is sought, and rates without one are infinite.
    """
    count = driven.shape[0]
    order = driven.order
    c = np.zeros((order + 1, count, len(linkage.coordinates)))
    r = np.zeros((count, len(linkage.coordinates)))
    c[:, :, linkage.driven] = driven.c
    r[:, linkage.driven] = driven.r
    if closed.full_jacobian is None or closed.inverse is None or closed.jacobian is None:
        return TaylorModel(c, r)
    right = (closed.full_jacobian[:, :, linkage.driven] @ driven[..., None]).before(closed.inverse)[..., 0]
    product = closed.jacobian.before(closed.inverse)
    # y = -right + (1 - A J) y, repeated: each step is more accurate by a factor, up to the order of the models
    y = -right
    for _ in range(order + 1):
        y = _polynomial(y)
        y = y - _remainder(product, y, right)
    y = _polynomial(y)
    remainder = _remainder(product, y, right).sizes()
    defect = (product - np.eye(len(linkage.passive))).sizes()
    bound = remainder
    for _ in range(_STEPS):
        bound = remainder + (defect @ bound[..., None])[..., 0]
    bound = _FACTOR * bound + _SMALLEST_ERROR
    mapped = (remainder + (defect @ bound[..., None])[..., 0]) * MARGIN
    is_proved = np.all(mapped <= bound, axis=1) & closed.closed
    c[:, :, linkage.passive] = y.c
    r[:, linkage.passive] = np.where(is_proved[:, None], bound, np.inf)
    return TaylorModel(c, r)


def _polynomial(y: TaylorModel) -> TaylorModel:
    """Return an approximation without its bound, which is found anew."""
    return TaylorModel(y.c, np.zeros(y.shape))


def _remainder(product: TaylorModel, y: TaylorModel, right: TaylorModel) -> TaylorModel:
    """Return A J y + A J_driven driven (N, passive)."""
    return (product @ y[..., None])[..., 0] + right
