"""Side-by-side benchmarks of all topics, or of those named (`make bench`; `make bench-check` is the short form).

    python tests/benchmarks/run.py                        all topics -> bench-out/bench.md, .json, .png
    python tests/benchmarks/run.py loops timing           two of them
    python tests/benchmarks/run.py --short --check        under a minute; 1 if a ratio fell far below its record
    python tests/benchmarks/run.py --docs --record        docs/benchmarks.md, and the record, anew
    python tests/benchmarks/run.py loops --docs --record  the figures of one topic in both, the others stay

A topic is a module here with `topic(effort) -> list[Table]`. Absolute times depend on the machine; ratios do, much
less: they are recorded by the machine that `recorded.json` names. Peers: `uv sync --group peers`; those that are not
installed are left out, loudly. Nothing here is a test.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import importlib
import sys
import time
from pathlib import Path

import pages
import race
from race import Effort, Table

TOPICS = {
    "loops": "closed_loops",
    "closed form": "closed_form",
    "instrument arm": "psm_inverse",
    "serial arm": "serial_arm",
    "timing": "timing",
    "trocar": "trocar",
    "control": "control",
    "workspace": "workspace",
    "scaling": "scaling",
    "da Vinci": "davinci",
}
"""Name -> module."""
ROOT = Path(__file__).resolve().parents[2]
AGAIN = 2
"""How often a topic that fell short is run once more: what is busy for a moment is not slower."""


def run(topics: list[str], effort: Effort) -> dict[str, list[Table]]:
    """Return the tables of each topic."""
    out = {}
    for name in topics:
        start = time.monotonic()
        print(f"\n== {name}")
        out[name] = importlib.import_module(TOPICS[name]).topic(effort)
        print(f"   ({time.monotonic() - start:.0f} s)")
    return out


def main(argv: list[str] | None = None) -> int:
    """Run, write, and compare; 1 when something fell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=f"of {', '.join(TOPICS)}; default all")
    parser.add_argument("--short", action="store_true", help="small sizes and few rounds")
    parser.add_argument("--check", action="store_true", help="compare with recorded.json")
    parser.add_argument("--record", action="store_true", help="write recorded.json")
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks.md and its picture, too")
    parser.add_argument("--busy", action="store_true", help="compare processor times of all threads, not the clock's")
    parser.add_argument("--out", type=Path, default=Path("bench-out"), help="folder (default bench-out)")
    options = parser.parse_args(argv)
    if strange := [t for t in options.topics if t not in TOPICS]:
        parser.error(f"no topic is named {', '.join(strange)}; there are {', '.join(TOPICS)}")
    if options.busy:
        race.by_processor_time()
    effort, where = Effort(options.short), pages.here()
    results = run(options.topics or list(TOPICS), effort)
    pages.write(results, where, options.out / "bench.md", options.out / "bench.png", options.short)
    print(f"\n{options.out / 'bench.md'}, .json and .png")
    if options.docs and options.topics:
        pages.renew(results, where, options.short)
    elif options.docs:
        pages.write(results, where, ROOT / "docs/benchmarks.md", ROOT / "docs/pictures/benchmarks.png", options.short)
    if options.record:
        pages.record(results, where, options.short)
    if not options.check:
        return 0
    bad = pages.fallen(results, options.short)
    for _ in range(AGAIN):
        if bad:
            print(f"\nonce more, slower than recorded: {', '.join(bad)}")
            bad = pages.fallen(run(list(bad), effort), options.short)
    for text in (line for lines in bad.values() for line in lines):
        print(f"FALLEN  {text}", file=sys.stderr)
    if not bad:
        print("no ratio is 40 % below its record, and every error is within its limit")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
