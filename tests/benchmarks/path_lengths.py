"""Shortest paths out of the dome: time and length against the number of samples, and beside the best known.

Each row plans out of the dome by FMT* without shortcuts, for the length; table2.py has the cost of the Raven paper. The
printed algorithm runs on the same samples. The exponents are those of a fit; the paper's times grow by about n^1.75,
its costs by about n^-0.61. With OMPL on the path (see obstacles.py), the length of our improved paths is compared with
the shortest of RRT* and BIT* after 30 s each and of our improvement by 4000 samples with other seeds. All times are
times of the processor.

    python tests/benchmarks/path_lengths.py [seeds] [picture.png]
"""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
from obstacles import length, ompls, problem

from twin.planning.costs import length as length_of
from twin.planning.fmt import FmtSearch
from twin.planning.obstacle_avoidance import around

sys.path.append(str(Path(__file__).parents[1]))
from made.printed import algorithm1

COUNTS = (200, 500, 1000, 2000)
IMPROVED = (500, 2000)
LONG = 5
"""Number of seeds of the long run of ours, of which the shortest path counts."""
PAPER = (3.7, 216.0)
"""Times in s of the paper at the smallest and the largest number of samples, on its machine."""


def table(seeds):
    """Return (time in s, length in m, nan without a path) (counts, seeds, 2), and reasons of the printed algorithm."""
    space, start, goal, box = problem()
    FmtSearch(space, start, goal, box, np.random.default_rng(99)).path(100)  # loads grids, which a space keeps
    out, reasons = np.full((len(COUNTS), seeds, 2), np.nan), {}
    for i, count in enumerate(COUNTS):
        for seed in range(seeds):
            search, began = FmtSearch(space, start, goal, box, np.random.default_rng(seed)), time.process_time()
            corners = search.path(count)
            out[i, seed, 0] = time.process_time() - began
            if corners is not None:
                out[i, seed, 1] = length(space, corners)
            if count == COUNTS[0]:
                found = algorithm1(search._q, search._neighbours, length_of(space.weights), space.free_each)
                reasons[found.reason or "a path"] = reasons.get(found.reason or "a path", 0) + 1
        t, cost = out[i].T
        print(
            f"{count:5d} samples: {np.median(t):.2f} s, length {np.nanmean(cost):.4f} m, "
            f"{np.isfinite(cost).sum()} of {seeds} with a path",
            flush=True,
        )
    return out, reasons


def improved(space, start, goal, samples, seed):
    """Return the length in m of a path improved by up to `samples` samples, and the processor time in s."""
    rounds, began = [], time.process_time()
    around(space, start, goal, seed=seed, samples=samples, ended=lambda done, tree: rounds.append(done))
    return rounds[-1].best, time.process_time() - began


def best(seeds):
    """Print lengths of our improved paths beside the shortest path known."""
    space, start, goal, box = problem()
    free = lambda q: bool(space.free(q[None], exact=False)[0])  # noqa: E731
    known = {p: ompls(space, start, goal, box, 0, 0, free, planner=p)[1] for p in ("RRTstar", "BITstar")}
    longest = 4000
    known[f"ours, {longest} samples"] = min(improved(space, start, goal, longest, 1000 + k)[0] for k in range(LONG))
    for name, value in known.items():
        print(f"  {name}: {value:.4f} m", flush=True)
    shortest = np.nanmin(list(known.values()))
    for samples in IMPROVED:
        found, took = np.array([improved(space, start, goal, samples, seed) for seed in range(seeds)]).T
        over = 100 * (found / shortest - 1)
        print(
            f"  ours, {samples} samples: {np.median(took):.2f} s, {np.median(over):+.1f} % (median), "
            f"{over.max():+.1f} % (largest) of the shortest",
            flush=True,
        )


def draw(out, name):
    """Draw times and lengths."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for axis, k, label in ((axes[0], 0, "processor time (s)"), (axes[1], 1, "path length (m)")):
        for seed in range(out.shape[1]):
            axis.plot(COUNTS, out[:, seed, k], ".", color="0.7", markersize=4)
        axis.plot(COUNTS, np.nanmedian(out[:, :, k], axis=1), "o-", color="tab:blue", label="median")
        axis.set(xscale="log", xlabel="number of samples", ylabel=label, xticks=COUNTS, xticklabels=COUNTS)
        axis.minorticks_off()
        axis.grid(linewidth=0.3)
    axes[0].set_yscale("log")
    axes[0].plot((COUNTS[0], COUNTS[-1]), PAPER, "s--", color="tab:orange", label="paper, another machine")
    axes[0].legend(fontsize=8)
    figure.savefig(name, dpi=110, metadata={"Software": None})


def main(seeds: int, picture: str | None) -> None:
    """Print the table, the exponents, the printed algorithm's results and the best known."""
    out, reasons = table(seeds)
    n = np.log(COUNTS)
    powers = [np.polyfit(n, np.log(np.nanmean(out[:, :, k], axis=1)), 1)[0] for k in (0, 1)]
    print(f"time ~ n^{powers[0]:.2f} (paper 1.75), length ~ n^{powers[1]:.2f} (paper -0.61)")
    first, last = np.median(out[[0, -1], :, 0], axis=1)
    print(f"times of the paper, on its machine: {PAPER[0] / first:.0f} and {PAPER[1] / last:.0f} times ours")
    print("the printed algorithm:", ", ".join(f"{n} of {seeds}: {text}" for text, n in reasons.items()))
    if importlib.util.find_spec("ompl"):
        best(seeds)
    else:
        print("!! the best known LEFT OUT: OMPL is not on the path, see obstacles.py")
    if picture:
        draw(out, picture)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, sys.argv[2] if len(sys.argv) > 2 else None)
