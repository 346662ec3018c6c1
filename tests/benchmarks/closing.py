"""Loops of SILS closed for many states together, as a search does, and one state after the other, as the model does.

Rounds alternate, with the same joint values. Times are times of the processor per state; states that cannot be closed
are left out of both.

    python tests/benchmarks/closing.py [states] [rounds]
"""

from __future__ import annotations

import sys
import time

import numpy as np

import twin
from twin.reference import ReferenceModel
from twin.reference.loop_closing import Closing

SINGLE = 40
"""Number of the states that are also solved singly."""

PART = 0.15
"""Width of the box around the rest pose, relative to the range of each joint."""


def main(count: int, rounds: int) -> None:
    """Print one row for each round, and the medians."""
    model = ReferenceModel(twin.load("sils").mechanism)
    home, (low, high) = model.home(), model.mechanism.limits.T
    rows = []
    for seed in range(rounds):
        rng = np.random.default_rng(seed)
        q = np.clip(home.q + rng.uniform(-PART / 2, PART / 2, (2 * count, len(low))) * (high - low), low, high)
        q = q[Closing(model, np.ones(len(low))).states(q)[1]][:count]
        closing, began = Closing(model, np.ones(len(low))), time.process_time()
        X, _ = closing.states(q, thorough=False)
        together, began = (time.process_time() - began) / len(q), time.process_time()
        single = [model.solve(values, home).x for values in q[:SINGLE]]
        alone = (time.process_time() - began) / SINGLE
        off = float(np.abs(np.array(single) - X[:SINGLE]).max())
        rows.append((together, alone))
        print(
            f"{len(q)} states: together {1e6 * together:.0f} us, alone {1e6 * alone:.0f} us a state, "
            f"{alone / together:.0f} times; largest difference {off:.1e}",
            flush=True,
        )
    together, alone = np.median(np.array(rows), axis=0)
    print(f"median: {1e6 * together:.0f} us, {1e6 * alone:.0f} us, {alone / together:.0f} times")


if __name__ == "__main__":
    given = [int(x) for x in sys.argv[1:]]
    main(*given, *(2000, 5)[len(given) :])
