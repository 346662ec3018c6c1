"""The path of a free phase: between two sets of joint values in the robot's own space, as the mechanism carries it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin.core.errors import ProtocolError, TwinError
from twin.core.spatial import Array
from twin.planning.feasible import Anchor, margins_at, said
from twin.planning.path import Path
from twin.planning.protocol import Free
from twin.planning.trajectory import PathKinematics

Progress = Callable[[str], None]


def way(
    phase: Free,
    kinematics: PathKinematics,
    ends: tuple[Array, Array],
    Ts: Array,
    where: str,
    progress: Progress = lambda label: None,
) -> Path:
    """Return the path of the driven joints in a free phase.

    Besides what is in the way it keeps what every phase must keep: limits, motors, carriages apart, reach, and the
    side of every singularity and the working mode on which it starts.

    Args:
        phase: its clearance, seed and scene.
        kinematics: the robot.
        ends: joint values (n,) at its start and its goal.
        Ts: T_base_tool (2, 4, 4) there.
        where: protocol and phase, for messages.
        progress: called with what is being done.

    Raises:
        ProtocolError: start or goal is not free, or no way was found; the message names pair, size and what was tried.
    """
    from twin.planning.around import around  # with scipy, which takes long to load

    if kinematics.space is None:
        raise ProtocolError(f"{where}: a free motion needs the mechanism, but there is none")
    anchor = Anchor.at(kinematics, Ts[:1], ends[0][None])
    for name, q, T in zip(("start", "goal"), ends, Ts, strict=True):
        if reason := said(kinematics, margins_at(kinematics, T[None], q[None], anchor)):
            raise ProtocolError(f"{where} cannot be carried out: at its {name}, {reason}")

    def keep(Ts: Array, q: Array) -> np.ndarray:
        return np.all([m >= 0 for m in margins_at(kinematics, Ts, q, anchor).values()], axis=0)

    def report(fraction: float) -> None:
        progress(f"{phase.name}: way around obstacles, {100 * fraction:.0f} %")

    try:
        space = kinematics.space(phase.scene, phase.clearance, keep)
        return around(space, *ends, seed=phase.seed, progress=report)
    except TwinError as error:
        raise ProtocolError(f"{where} cannot be carried out: {error}") from error
