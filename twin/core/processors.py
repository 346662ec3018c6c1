"""The number of processors that the parallel work of one command may use."""

from __future__ import annotations

import os
from functools import cache

from twin.core.errors import TwinError

PROCESSORS = "TWIN_PROCESSORS"
"""Environment variable that limits the number, for computers that several people or programs share."""


@cache
def usable() -> int:
    """Return the number of processors for parallel work: that of `TWIN_PROCESSORS`, else all that the system grants.

    Both are read once: a compiled kernel asks at every call.

    Raises:
        TwinError: `TWIN_PROCESSORS` is not a whole number of at least 1.
    """
    # The system grants fewer processors than the computer has, for example in a container or under `taskset`.
    granted = len(os.sched_getaffinity(0))
    limit = os.environ.get(PROCESSORS)
    if not limit:
        return granted
    if not limit.isdecimal() or int(limit) < 1:
        raise TwinError(f"{PROCESSORS} is {limit!r}: give a whole number of processors, 1 or more, or unset it")
    return min(int(limit), granted)
