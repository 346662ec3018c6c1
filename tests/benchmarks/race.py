"""Contenders in turns, so that a busy moment of the machine meets them all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np

ROUNDS = 7


def race(
    title: str,
    contenders: Mapping[str, Callable[[], object]],
    per: int = 1,
    rounds: int = ROUNDS,
    tries: int | None = None,
) -> None:
    """Print the median time of each, in µs per item, and its ratio to the first.

    Args:
        title: printed above.
        contenders: what to run. per: items in one run.
        rounds: of all of them.
        tries: of one run, which then returns how many succeeded: the time is per success.
    """
    times: dict[str, list[float]] = {name: [] for name in contenders}
    good: dict[str, int] = {}
    for _ in range(rounds):
        for name, run in contenders.items():
            start = time.perf_counter()
            done = run()
            spent = time.perf_counter() - start
            good[name] = done if isinstance(done, int) else 0
            times[name].append(spent / (per if tries is None else max(good[name], 1)) * 1e6)
    print(title)
    first = float(np.median(next(iter(times.values()))))
    for name in contenders:
        median = float(np.median(times[name]))
        count = "" if tries is None else f"   {good[name]} of {tries}"
        print(f"  {name:52s} {median:10.2f} µs   x {median / first:7.2f}{count}")
