"""Explain mutants of the equations of eight robots, in one process; see `explain_mutants` for their kinds.

    PYTHONPATH=tests python tests/made/explain_campaign.py judge KIND COUNT SEED SECONDS FILE
    PYTHONPATH=tests python tests/made/explain_campaign.py report FILE...

`judge` writes a JSON object of each mutant as a line of FILE, until COUNT mutants that make a row wrong are in it, or
SECONDS are over; it goes on where FILE ends. KIND is one (token), two (tokens), or rewrites: equations that say the
same in another way, which must agree. `report` prints shares, times and misses of one or several such files.

Times are processor times: those of a machine that does nothing else.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import warnings
from collections import Counter
from itertools import cycle
from pathlib import Path

import numpy as np

from made import explain_mutants as mutants
from made import explain_rewrites as rewrites
from made import explain_seeds as seeds
from twin.core.errors import TwinError

SEARCH = 8.0
"""Processor time in s of one search, as of `twin explain`."""

FOUND = ("rank 1", "tie")
"""Outcomes of a mutant whose fix is the first one, or one of several that cannot be told apart."""

NO_MUTANTS = ("no fault", "no formula")
"""Outcomes of texts that are no mutants: no row is wrong, or Python itself reports the error."""

WORSE = "a cure makes a row worse"


def outcomes(kind, seed, folder, known=()):
    """Yield entries of drawn mutants or rewrites, without end: draw, robot, what was changed, outcome, seconds.

    Those whose number of draw is in `known` are drawn and not judged. An outcome of a mutant is that of
    `explain_seeds.outcome`, that of a rewrite "agree" or what is said of it.
    """
    generator = np.random.default_rng(seed)
    for draw, case in enumerate(cycle(seeds.built_ins())):
        path = folder / f"{kind}_{seed}_{draw}" / "formula.py"
        path.parent.mkdir()
        if kind == "rewrites":
            text = rewrites.rewritten(case, generator)
            what = "rewritten"
            if text is not None:
                path.write_text(text, encoding="utf-8")
        else:
            what = mutants.mutant(case, path, generator, {"one": 1, "two": 2}[kind])
        if not path.exists() or what is None or draw in known:
            continue
        try:
            formula = case.load(path)
        except TwinError:
            continue
        began = time.process_time()
        outcome = _rewrite(case, formula) if kind == "rewrites" else _mutant(case, formula, path.parent)
        seconds = round(time.process_time() - began, 2)
        entry = {"kind": kind, "seed": seed, "draw": draw, "robot": case.name, "what": what}
        yield {**entry, "outcome": outcome, "seconds": seconds}


def _mutant(case, formula, folder):
    try:
        return seeds.outcome(case, formula, folder, SEARCH)
    except AssertionError as error:
        return f"{WORSE}: {error}"


def _rewrite(case, formula):
    from twin import api
    from twin.validation.explain.explain import explain

    told = explain(case.name, formula, api.load(case.name).reference())
    if told.verdict == "agree":
        return "agree"
    return f"{told.verdict}: {[row.symbol for row in told.rows]} {told.notes}"


def judge(kind, count, seed, seconds, file):
    """Judge mutants or rewrites and append what was found to a file."""
    warnings.simplefilter("ignore", RuntimeWarning)  # most mutants have no value somewhere
    end = time.monotonic() + float(seconds)
    path = Path(file)
    entries = _read(path) if path.is_file() else []
    known = {entry["draw"] for entry in entries if (entry["kind"], entry["seed"]) == (kind, int(seed))}
    judged = [entry for entry in entries if entry["outcome"] not in NO_MUTANTS]
    number = len(judged)
    clock = time.monotonic
    time.monotonic = time.process_time  # the time of a machine that does nothing else
    with tempfile.TemporaryDirectory() as folder, path.open("a", encoding="utf-8") as out:
        if number < int(count):
            for entry in outcomes(kind, int(seed), Path(folder), known):
                out.write(json.dumps(entry) + "\n")
                out.flush()
                number += entry["outcome"] not in NO_MUTANTS
                if number >= int(count) or clock() > end:
                    break
    print(f"{kind} seed {seed}: {number} of {count} in {path}", flush=True)


def report(*files):
    """Print shares, processor times and misses of files of `judge`, together for each kind."""
    entries = [entry for file in files for entry in _read(Path(file))]
    for kind in dict.fromkeys(entry["kind"] for entry in entries):
        judged = [entry for entry in entries if entry["kind"] == kind and entry["outcome"] not in NO_MUTANTS]
        print("\n".join(summary(kind, judged)))


def summary(kind, judged):
    """Return the lines that tell of mutants or rewrites of one kind."""
    right = ("agree",) if kind == "rewrites" else FOUND
    lines = []
    for entry in judged:
        if entry["outcome"] not in right:
            told = f"{entry['seed']} #{entry['draw']} {entry['robot']} {entry['what']}"
            lines.append(f"{entry['seconds']:5.1f} s {told}: {entry['outcome']}")
    told = Counter(entry["outcome"] if entry["outcome"] in right else "missed" for entry in judged)
    times = [entry["seconds"] for entry in judged]
    found = sum(told[name] for name in right)
    share = f"{found} of {len(judged)} = {100 * found / len(judged):.1f} % {dict(told)}, harmful {len(harmful(judged))}"
    lines.append(f"{kind}: {share}; p95 {np.quantile(times, 0.95):.1f} s, maximum {max(times):.1f} s")
    return lines


def harmful(judged):
    """Return the entries whose fix makes a row worse, or holds only for the present values of parameters."""
    return [e for e in judged if e["outcome"] == seeds.BY_CHANCE or e["outcome"].startswith(WORSE)]


def _read(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


if __name__ == "__main__":
    {"judge": judge, "report": report}[sys.argv[1]](*sys.argv[2:])
