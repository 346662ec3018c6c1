"""What `twin export` of a robot costs: time by step, size by format, and whether a second run gives the same bytes.

    python tests/benchmarks/export.py [robot]

Seconds of the processor are those that other work on the machine does not change; the wall's are printed beside them.
Not a test.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import filecmp
import sys
import tempfile
import time
from pathlib import Path

LIMIT_S, LIMIT_MB = 20.0, 10.0


class Watch:
    """Adds up seconds by the label that `progress` is told."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {}
        self._label, self._since = "imports", (time.perf_counter(), time.process_time())

    def __call__(self, label: str, fraction: float) -> None:
        now = (time.perf_counter(), time.process_time())
        row = self.spent.setdefault(self._label, [0.0, 0.0])
        row[0] += now[0] - self._since[0]
        row[1] += now[1] - self._since[1]
        self._label, self._since = label, now


def main(name: str) -> None:
    """Export twice, print, compare."""
    watch = Watch()
    from twin import api

    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        made = api.export(api.load(name), out=Path(first), progress=watch)
        watch("", 0.0)
        again = api.export(api.load(name), out=Path(second))
        same = [f for f in made.files if filecmp.cmp(Path(first) / f, Path(second) / f, shallow=False)]
        sizes: dict[str, int] = {}
        for file in made.files:
            sizes[file.parts[0]] = sizes.get(file.parts[0], 0) + (Path(first) / file).stat().st_size
    print(f"{name}: {', '.join(f'{c.name} {c.rate:g} Hz' for c in made.order.clips)}; {made.verdict}")
    print(f"  {'':30s} {'wall s':>8s} {'processor s':>12s}")
    for label, (wall, cpu) in watch.spent.items():
        print(f"  {label:30s} {wall:8.2f} {cpu:12.2f}")
    wall, cpu = (sum(row[i] for row in watch.spent.values()) for i in (0, 1))
    print(f"  {'all':30s} {wall:8.2f} {cpu:12.2f}   (limit {LIMIT_S:g} s)")
    for part, size in sizes.items():
        print(f"  {part:30s} {size / 1e6:8.2f} MB")
    print(f"  {'all':30s} {sum(sizes.values()) / 1e6:8.2f} MB   (limit {LIMIT_MB:g} MB)")
    print(f"  {len(same)} of {len(again.files)} files have the same bytes the second time")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sils")
