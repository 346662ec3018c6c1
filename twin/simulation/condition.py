"""The condition of a session: with or without forces on the hands, participant of a study, and run.

The paper lets every user do the peg board with and without haptics, in random order. Here, the order follows from
the number of the participant, so that no list is needed: of four successive participants, two begin with forces.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from twin.core.errors import TwinError
from twin.schema import Table

RUNS = 2
"""Number of runs of a participant, one with and one without forces."""

_BLOCK_SIZE = 4
"""Number of successive participants in a block; half of the participants of each block begin with forces."""


class Condition(Table):
    """Condition of a session, by which a study can group sessions."""

    haptics: Annotated[bool, Field(description="whether the forces on the hands are on at the start")]
    participant: Annotated[
        int | None, Field(ge=1, description="number of the participant in a study; null: no study")
    ] = None
    run: Annotated[int | None, Field(ge=1, le=RUNS, description="first or second run of the participant")] = None


def randomised(participant: int, run: int) -> Condition:
    """Return the condition of a run of a participant, in the randomised order.

    Args:
        participant: number of the participant, from 1 on.
        run: 1 or 2; exactly one of the two runs has forces.

    Raises:
        TwinError: a number is out of range.
    """
    if participant < 1:
        raise TwinError(f"participant {participant}: give a number of at least 1")
    if not 1 <= run <= RUNS:
        raise TwinError(f"there is no run {run}: the number is 1 to {RUNS}; one run has forces on the hands")
    block, place = divmod(participant - 1, _BLOCK_SIZE)
    first = np.random.default_rng(block).permutation(_BLOCK_SIZE)[place] < _BLOCK_SIZE // 2
    return Condition(haptics=bool(first) == (run == 1), participant=participant, run=run)
