"""Algorithm 1 of the Raven paper as printed, with four errors that can be kept or corrected one by one.

Symbols are those of the paper: z the current node, theta its neighbours, V the samples, J the cost to come. Line 11
takes the open neighbours of theta from N_theta, which line 10 has just computed; the available text of the paper has
Theta_near there, which contains no open node. `fmt.FmtSearch` is the algorithm that twin uses.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from twin.core.spatial import Array
from twin.planning.costs import Cost

Slip = Literal["goal", "open", "closed", "next"]
"""An error of the printed algorithm.

goal: line 2 leaves theta_goal out of the samples; open: line 22 removes theta instead of z from V_open; closed: line 22
adds theta instead of z to V_closed; next: line 27 chooses the next theta instead of the next z.
"""

SLIPS: tuple[Slip, ...] = get_args(Slip)


@dataclass
class Outcome:
    """What the algorithm did.

    Attributes:
        path: rows of the samples from start to goal; None if the algorithm failed.
        reason: why the algorithm failed; "" if it found a path.
        overlap: number of passes of the loop after which some node was both open and closed.
        lost: rows of the samples that, after some pass, were in the tree but neither open nor closed.
        cost: J of the goal; infinite if the algorithm failed.
    """

    path: list[int] | None
    reason: str
    overlap: int = 0
    lost: set[int] = field(default_factory=set)
    cost: float = np.inf


def algorithm1(
    q: Array,
    near: list[np.ndarray],
    cost: Cost,
    free: Callable[[Array, Array], np.ndarray],
    slips: Collection[Slip] = SLIPS,
) -> Outcome:
    """Run the algorithm on samples q (n, joints), the start first and the goal second.

    Args:
        q: the samples; they include theta_goal even if `slips` has "goal", in which case V does not include theta_goal.
        near: for each sample, the rows of its neighbours.
        cost: cost of a connection.
        free: returns (k,) bool for k connections: whether a connection is free of collisions.
        slips: the errors to keep; () is the corrected algorithm.
    """
    unvisited = {i for i in range(1, len(q)) if i != 1 or "goal" not in slips}
    open_, closed, J, parent = {0}, set[int](), {0: 0.0}, dict[int, int]()
    z, out = 0, Outcome(None, "")
    while z != 1:
        new, theta, before = set[int](), z, (len(unvisited), frozenset(open_), z)
        for theta in [int(i) for i in near[z] if int(i) in unvisited]:
            choices = [int(i) for i in near[theta] if int(i) in open_]
            if not choices:
                continue
            through = [J[i] + float(cost(q[[i]], q[[theta]])[0]) for i in choices]
            least = int(np.argmin(through))
            if free(q[[choices[least]]], q[[theta]])[0]:
                parent[theta], J[theta] = choices[least], through[least]
                new.add(theta)
                unvisited.discard(theta)
        left, kept = theta if "open" in slips else z, theta if "closed" in slips else z
        open_ = (open_ | new) - {left}
        closed = closed | {kept}
        out.overlap += bool(open_ & closed)
        out.lost |= set(J) - open_ - closed
        if not open_:
            out.reason = "V_open is empty, so the algorithm returns Failure"
            return out
        chosen = min(open_, key=lambda i: J[i])
        if "next" not in slips:
            z = chosen
        if before == (len(unvisited), frozenset(open_), z):
            out.reason = "the loop does not end: z, V_open and V_unvisited do not change any more"
            return out
    out.path, out.cost = [1], J[1]
    while out.path[-1] != 0:
        out.path.append(parent[out.path[-1]])
    out.path.reverse()
    return out
