"""What a run of the benchmarks leaves behind: Markdown, JSON, a picture, and the record that later runs are held to."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from race import Row, Table

from twin.core import machine_code

RECORD = Path(__file__).with_name("recorded.json")
FALL = 0.4
"""How far a ratio (of shortest times, see `Row.best`) may fall below its recorded value."""

PACKAGES = (
    *("numpy", "casadi", "llvmlite", "pin", "mujoco", "scipy", "toppra", "drake", "numba", "mink", "pin-pink", "daqp"),
    *("roboticstoolbox-python", "pybullet"),
)
Results = Mapping[str, list[Table]]


def here() -> dict[str, Any]:
    """Return what the figures depend on: processor, versions, date."""
    info = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    models = [line.split(":")[1].strip() for line in info.splitlines() if line.startswith("model name")]
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "-"
    if shutil.which("gcc"):
        said = subprocess.run(["gcc", "-dumpfullversion"], capture_output=True, text=True, check=False)
        versions["gcc"] = said.stdout.strip()
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "processor": models[0] if models else platform.processor(),
        "processors": len(os.sched_getaffinity(0)),
        "doubles a vector": machine_code.lanes() // 2,
        "load": round(os.getloadavg()[0], 1),
        "versions": versions,
    }


def write(results: Results, where: Mapping[str, Any], page: Path, picture: Path, short: bool) -> None:
    """Write the page, the picture that it shows, and the same as JSON beside it."""
    page.parent.mkdir(parents=True, exist_ok=True)
    picture.parent.mkdir(parents=True, exist_ok=True)
    plot(results, picture)
    page.write_text(markdown(results, where, os.path.relpath(picture, page.parent), short))
    data = {"where": where, "short": short}
    data["topics"] = {topic: [dataclasses.asdict(t) for t in tables] for topic, tables in results.items()}
    if page.parent.name != "docs":
        page.with_suffix(".json").write_text(json.dumps(data, indent=1) + "\n")


# -- for people -------------------------------------------------------------------------------------------

HEAD = """# Benchmarks

Written by `make bench` (tests/benchmarks). Contenders take turns in one process, so that a busy moment meets them all;
what counts is the **ratio**: the time of a contender over that of the first row in the same round, median over rounds,
with its quartiles. Above 1 the first row is faster. Absolute times depend on the machine and its load and are given
for scale. Every error is measured by one judge for all, which is named.

How to read it:

- Peers are called from Python as their users call them, and tuned in tolerance only; in C++ they would be faster. They
  are installed by `uv sync --group peers`; those that are not there are left out, and named.
- Closed loops: every peer gets the same mechanism, the same start and the same joint coordinates; Gauss-Newton leaves
  out rows that say nothing, and takes numpy's cheapest solver. CasADi and scipy get twin's own equations, so that they
  only differ in what solves them. "Right" counts answers that are closed to 10 µm on the branch of the truth.
- Closed forms: gcc is a peer of the benchmark only; twin needs no compiler. Rows with one thread are compared with one
  thread, into memory that is there.
- Exponents include what a call costs by itself, which is why they can be below 1. Loops and links are reported without
  a bar: how cost grows depends on how loops hang together.
- Not in the table are the next five measurements.
- OMPL (tests/benchmarks/obstacles.py, which says how to run it): out of the dome, three seeds, busy
  machine, processor time, medians: our FMT* took 0.33 s with 500 samples, 0.62 s with 1000 and 1.09 s with 2000;
  OMPL's FMT with the same test of states, called from Python at its own spacing, 3.9, 7.8 and 9.1 s (12.4, 12.6 and
  8.4 times). To a path as short as OMPL's, our search with shortcuts took 0.12, 0.13 and 0.07 s (32, 58 and 126 times
  less). With Pinocchio and coal in C++ as the test OMPL found no path in 30 s.
- tests/benchmarks/dome.py: plans of 500 samples out of the dome, followed by simulated motors, judged by coal.
  Of 200 seeds, 200 came out of the dome with tracking; no plan and no tracked motion collides. On a machine with a
  load of 2 to 4 a path takes 0.46 s with its timing and the certificate 0.30 s more (medians of 14 seeds); it is at
  most 0.54 mm below the exact minimum and never above it. Without the cache of distances, the first search takes 12 s
  longer.
- tests/benchmarks/table2.py, the paper's Table 2 with our dome, ten seeds: with 200, 500, 1000 and 2000
  samples, 0.14, 0.34, 0.60 and 1.18 s, lengths 0.238, 0.224, 0.209 and 0.205 m, all seeds with a path. The time grows
  by n^0.91 and the length by n^-0.07 (paper: time n^1.75; its cost of eq. (1), which is not this length, n^-0.61). The
  paper's 3.7 and 216 s, on its machine, are 27 and 182 times these times. The printed algorithm found no path with any
  of the ten seeds: its loop does not end. The shortest path of OMPL's RRT* (30 s) is 0.220 m, of BIT* (30 s) 0.206 m,
  of our search with 4000 samples and
  shortcuts 0.173 m; 500 samples and three informed rounds lead below it with every seed (1.3 s; by 4.1 % in the
  median).
- These times of OMPL, dome.py and table2.py were measured before coal decided in searches too. Since then 500 samples
  out of the dome take 0.41 s instead of 0.25 s (medians of six seeds, same machine).
- tests/benchmarks/plans.py: plans between random configurations whose straight path is not free, all but 6 of
  106, judged by coal with pairs of its own. Raven in the dome 27 plans, PA-10 in `vsrs` 25 of 27, an arm of the da
  Vinci in `davinci` 26, SILS before a cube 20 of 26; for the other 8, an end seems to be enclosed. No plan collides.
  The certificate is never above the exact minimum and 0.19 to 0.84 mm below it. Medians of a plan, processor time:
  0.31, 0.59, 2.1 and 5.5 s.
- tests/benchmarks/closing.py: loops of SILS closed for 2000 states together take 71 us a state, one state
  after the other 2.4 ms (34 times, medians of five rounds).
- Not here: ruckig, whose free version knows no waypoints.
- `make bench-check` runs the short form and fails when a ratio (of the shortest times) is more than 40 % below the one
  in tests/benchmarks/recorded.json. A machine with wider vectors does better than the record, one with narrower worse.
"""


def markdown(results: Results, where: Mapping[str, Any], picture: str, short: bool) -> str:
    """Return the page."""
    versions = ", ".join(f"{n} {v}" for n, v in where["versions"].items() if v != "-")
    lines = [HEAD]
    if short:
        lines.append("This is the short form: small sizes, few rounds.\n")
    lines.append(
        f"{where['date']}, {where['processor']}, {where['processors']} processors, {where['doubles a vector']} doubles "
        f"a vector, load average {where['load']}; {versions}.\n"
    )
    lines += [f"![Ratios]({picture})\n", *summary(results)]
    for topic, tables in results.items():
        lines.append(f"## {topic}\n")
        for t in tables:
            lines += [f"### {t.title}\n", *table(t)]
    return "\n".join(lines).rstrip() + "\n"


def summary(results: Results) -> Iterator[str]:
    """Yield the rows and numbers that have a bar."""
    yield "| what | against | measured | bar | |"
    yield "|---|---|---:|---:|---|"
    for topic, tables in results.items():
        for t in tables:
            for r in (r for r in t.rows if r.bar is not None):
                yield f"| {topic}: {t.name} | {r.name} | {_x(r.ratio)} | ≥ {_x(r.bar or 0)} | {_verdict(r.met)} |"
            if t.limit is not None and t.rows:
                error = t.rows[0].error
                yield f"| {topic}: {t.name}, error | {t.judge} | {error:.1e} | ≤ {t.limit:g} | {_verdict(t.exact)} |"
            for f in (f for f in t.facts if f.bar is not None):
                sign = "≥" if f.least else "≤"
                yield f"| {topic}: {f.name} | | {f.value:.3g} {f.unit} | {sign} {f.bar:g} | {_verdict(f.met)} |"
    yield ""


def table(t: Table) -> Iterator[str]:
    """Yield the Markdown of a table."""
    if t.rows:
        judged, counted = any(r.error is not None for r in t.rows), any(r.good for r in t.rows)
        yield "| | µs each | ratio | quartiles |" + " error |" * judged + " right |" * counted
        yield "|---|---:|---:|---:|" + "---:|" * judged + "---:|" * counted
        for r in t.rows:
            cells = [r.name, f"{r.us:.4g}", _x(r.ratio), "" if t.sizes else f"{r.low:.3g} to {r.high:.3g}"]
            cells += ["" if r.error is None else f"{r.error:.1e}"] * judged + [r.good] * counted
            yield f"| {' | '.join(cells)} |"
        yield ""
    if t.judge:
        yield f"Error: {t.judge}.\n"
    for f in t.facts:
        yield f"- {f.name}: {f.value:.3g} {f.unit}".rstrip()
    if t.facts:
        yield ""
    for note in t.notes:
        yield f"{note}\n"
    if t.missing:
        yield f"Not installed, left out: {', '.join(t.missing)}.\n"


def _x(ratio: float) -> str:
    return f"{ratio:.3g}×" if ratio < 1000 else f"{ratio:.0f}×"


def _verdict(met: bool) -> str:
    return "met" if met else "**not met**"


TITLE: dict[str, Any] = {"fontsize": 7.5, "weight": "bold", "backgroundcolor": "white", "zorder": 3}


def plot(results: Results, path: Path) -> None:
    """Draw all ratios against others, on a logarithmic axis; a stroke where a bar is."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    shown = [(t, [r for r in t.rows[1:] if not r.name.startswith("twin:")]) for ts in results.values() for t in ts]
    shown = [(t, rows) for t, rows in shown if rows and not t.sizes]
    if not shown:
        return
    height = sum(len(rows) + 1.6 for _, rows in shown)
    figure, axes = plt.subplots(figsize=(9, 0.19 * height + 0.8), layout="constrained")
    y, ticks, colours = 0.0, [], plt.get_cmap("tab10")
    for k, (t, rows) in enumerate(shown):
        axes.text(0.0, y, t.title, transform=axes.get_yaxis_transform(), va="center", **TITLE)
        for r in rows:
            y += 1
            axes.barh(y, r.ratio - 1, left=1, height=0.75, color=colours(k % 10), xerr=None)
            axes.plot([r.low, r.high], [y, y], color="black", linewidth=0.8)
            if r.bar is not None:
                axes.plot([r.bar, r.bar], [y - 0.45, y + 0.45], color="black", linewidth=1.6)
            axes.text(max(r.high, 1) * 1.06, y, _x(r.ratio), fontsize=6.5, va="center")
            ticks.append((y, r.name))
        y += 1.6
    axes.set_xscale("log")
    axes.axvline(1, color="black", linewidth=0.8)
    axes.set_yticks([p for p, _ in ticks], [n for _, n in ticks], fontsize=6.5)
    axes.set_ylim(y, -1)
    axes.set_xlim(right=2 * axes.get_xlim()[1])
    axes.set_xlabel("time of the contender / time of twin (thin line: quartiles; thick stroke: bar)", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)
    axes.grid(axis="x", linewidth=0.3)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


# -- for the next run ---------------------------------------------------------------------------------------


def watched(results: Results) -> dict[str, Row]:
    """Return the rows whose ratio is recorded, by "topic/table/contender"."""
    tables = [(topic, t) for topic, ts in results.items() for t in ts if not t.sizes]
    return {f"{topic}/{t.name}/{r.name}": r for topic, t in tables for r in t.rows[1:] if r.watched}


def record(results: Results, where: Mapping[str, Any], short: bool) -> None:
    """Keep the ratios of a run; those of topics that did not run stay."""
    data = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    form = "short" if short else "full"
    kept = {k: v for k, v in data.get(form, {}).get("ratios", {}).items() if k.split("/")[0] not in results}
    kept |= {key: float(f"{row.best:.3g}") for key, row in watched(results).items()}
    data[form] = {"where": where, "ratios": dict(sorted(kept.items()))}
    RECORD.write_text(json.dumps(data, indent=1, sort_keys=True, ensure_ascii=False) + "\n")


def fallen(results: Results, short: bool) -> dict[str, list[str]]:
    """Return by topic what is worse than the record allows, or less exact than it must be."""
    data = json.loads(RECORD.read_text())["short" if short else "full"]
    out: dict[str, list[str]] = {}
    for key, row in watched(results).items():
        before = data["ratios"].get(key)
        if before is not None and not row.best >= (1 - FALL) * before:
            text = f"{key}: ratio {row.best:.3g}, more than 40 % below the recorded {before:.3g} of an "
            out.setdefault(key.split("/")[0], []).append(text + data["where"]["processor"])
    for topic, tables in results.items():
        for t in (t for t in tables if not t.exact):
            out.setdefault(topic, []).append(f"{topic}/{t.name}: error {t.rows[0].error} above {t.limit:g}; {t.judge}")
    return out
