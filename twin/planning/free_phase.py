"""Plan the path of a free phase: around obstacles, in joint space, between two sets of joint values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.errors import ProtocolError, TwinError
from twin.core.spatial import Array
from twin.core.units import ROUNDING
from twin.planning.feasibility import Anchor, margins_at, violation
from twin.planning.path import Path
from twin.planning.path_kinematics import PathKinematics, StateTest
from twin.planning.protocol import Free
from twin.planning.rounds import SearchRound, SearchRounds

PhaseProgress = Callable[[str], None]
"""Function that is called with the name of each phase before it is planned, and with each step of its search."""

Searched = Callable[[str, SearchRounds], None]
"""Function of (name of a free phase, rounds of its search); called only if there was a search."""


def limits_satisfied(kinematics: PathKinematics, anchor: Anchor) -> StateTest:
    """Return a function of T_base_tool (k, 4, 4) and q (k, n) that returns (k,) bool: whether limits are satisfied.

    The limits are those of `margins_at`, including the working mode and the signs of `anchor`.
    """

    def keep(Ts: Array, q: Array) -> np.ndarray:
        margins = margins_at(kinematics, Ts, q, anchor)
        is_allowed = np.ones(len(q), bool)
        for margin in margins.values():
            # So that NaN, an unknown margin, is not allowed either.
            is_allowed &= margin >= -ROUNDING
        return is_allowed

    return keep


def free_path(
    phase: Free,
    kinematics: PathKinematics,
    ends: tuple[Array, Array],
    Ts: Array,
    where: str,
    progress: PhaseProgress = lambda label: None,
    searched: Searched = lambda name, rounds: None,
) -> Path:
    """Return the path of the driven joints in a free phase.

    Like the path of every phase, this path respects joint and motor limits, minimum distances of carriages on one rail,
    and the reach. It also stays on the same side of every singularity, and in the working mode of its start.

    Args:
        phase: the phase, with clearance, seed and scene.
        kinematics: the robot's planning data.
        ends: joint values (n,) at start and goal.
        Ts: (2, 4, 4) T_base_tool at start and goal.
        where: names of protocol and phase, for messages.
        progress: called with a description of the current step.
        searched: called after the search; not called if the straight path is free.

    Raises:
        ProtocolError: start or goal collides or exceeds a limit, or no path was found; the message names bodies, sizes
            and searches.
    """
    from twin.planning.costs import COSTS, SMALLEST_WHEN_STRAIGHT
    from twin.planning.obstacle_avoidance import around  # imports scipy, which loads slowly

    if kinematics.space is None:
        raise ProtocolError(f"{where}: a free motion requires a mechanism, but there is none")
    anchor = Anchor.at(kinematics, Ts[:1], ends[0][None])
    for name, q, T in zip(("start", "goal"), ends, Ts, strict=True):
        reason = violation(kinematics, margins_at(kinematics, T[None], q[None], anchor))
        if reason:
            raise ProtocolError(f"{where} cannot be carried out: at the {name}, {reason}")

    def report(fraction: float) -> None:
        progress(f"{phase.name}: path around obstacles, {100 * fraction:.0f} %")

    rounds: list[SearchRound] = []
    try:
        space = kinematics.space(phase.scene, phase.clearance, limits_satisfied(kinematics, anchor))
        cost = None
        if phase.cost == "published":
            from twin.planning.published_cost import published_cost

            cost = published_cost(space.mechanism, space.limits, phase.eta)
        elif phase.cost != "length":  # the default of `around`, which then leaves out useless samples
            cost = COSTS[phase.cost](space)
        path = around(
            space,
            *ends,
            seed=phase.seed,
            progress=report,
            cost=cost,
            straight=phase.cost in SMALLEST_WHEN_STRAIGHT,
            samples=phase.samples,
            ended=lambda search_round, tree: rounds.append(search_round),
        )
    except TwinError as error:
        raise ProtocolError(f"{where} cannot be carried out: {error}") from error
    if rounds:
        searched(phase.name, SearchRounds(phase.cost, tuple(rounds)))
    return path
