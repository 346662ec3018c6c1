"""What a run of the benchmarks leaves behind: Markdown, JSON, a picture, and the record that later runs are held to."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from race import Row, Table, measures

from twin.core import machine_code

RECORD = Path(__file__).with_name("recorded.json")
FALL = 0.4
"""How far a ratio (of shortest times, see `Row.best`) may fall below its recorded value."""

PACKAGES = (
    *("numpy", "casadi", "llvmlite", "pin", "mujoco", "scipy", "toppra", "drake", "numba", "mink", "pin-pink", "daqp"),
    *("roboticstoolbox-python", "pybullet", "eaik", "ssik"),
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

PAGE = Path(__file__).resolve().parents[2] / "docs/benchmarks.md"
"""The published page. What stands above its date is written by hand, and kept."""

_WHEN = re.compile(r"^\d{4}-\d\d-\d\d, ", re.MULTILINE)
"""How the line with date, machine and versions begins."""


def head() -> str:
    """Return what the published page says before the figures."""
    text = PAGE.read_text(encoding="utf-8")
    first = _WHEN.search(text)
    assert first is not None, f"{PAGE} has no line with the date of the record"
    return text[: first.start()]


def when(where: Mapping[str, Any]) -> str:
    """Return the line with date, machine and versions."""
    versions = ", ".join(f"{n} {v}" for n, v in where["versions"].items() if v != "-")
    return (
        f"{where['date']}, {where['processor']}, {where['processors']} processors, {where['doubles a vector']} doubles "
        f"a vector, load average {where['load']}; {versions}.\n"
    )


def renew(results: Results, where: Mapping[str, Any], short: bool) -> None:
    """Put the figures of some topics into the published page; those of the others stay, and so does the picture."""
    text = PAGE.read_text(encoding="utf-8")
    form = "short form, small sizes and few rounds; " if short else ""
    for topic, tables in results.items():
        lines = [f"## {topic}\n", f"Recorded apart from the other topics ({form}{measures()}): {when(where)}"]
        for t in tables:
            lines += [f"### {t.title}\n", *table(t)]
        section = "\n".join(lines).rstrip() + "\n\n"
        old = re.compile(rf"^## {re.escape(topic)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
        if old.search(text):
            text = old.sub(lambda _, section=section: section, text, count=1)
        else:
            text = text.rstrip() + "\n\n" + section
        rows = [row for row in summary({topic: tables}) if row.startswith(f"| {topic}: ")]
        text = _renewed_rows(text, topic, rows)
    PAGE.write_text(text.rstrip() + "\n", encoding="utf-8")


def _renewed_rows(text: str, topic: str, rows: list[str]) -> str:
    """Return the page with the rows of a topic in the table of bars replaced, or added at its end."""
    lines = text.split("\n")
    own = [k for k, line in enumerate(lines) if line.startswith(f"| {topic}: ")]
    if own:
        first = own[0]
        lines = [line for k, line in enumerate(lines) if k not in own]
    else:
        first = lines.index("|---|---|---:|---:|---|") + 1
        while lines[first].startswith("|"):
            first += 1
    return "\n".join([*lines[:first], *rows, *lines[first:]])


def markdown(results: Results, where: Mapping[str, Any], picture: str, short: bool) -> str:
    """Return the page."""
    lines = [head()]
    if short:
        lines.append("This is the short form: small sizes, few rounds.\n")
    lines.append(when(where))
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


def record_of_this_processor() -> Path:
    """Return the record of this processor, whose vectors and caches favour one way or another; else the first one."""
    own = RECORD.with_name(f"recorded-{here()['processor'].replace(' ', '-')}.json")
    return own if own.exists() else RECORD


def record(results: Results, where: Mapping[str, Any], short: bool) -> None:
    """Keep the ratios of a run; those of topics that did not run stay."""
    file = record_of_this_processor()
    data = json.loads(file.read_text()) if file.exists() else {}
    form = "short" if short else "full"
    kept = {k: v for k, v in data.get(form, {}).get("ratios", {}).items() if k.split("/")[0] not in results}
    kept |= {key: float(f"{row.best:.3g}") for key, row in watched(results).items()}
    data[form] = {"where": where, "ratios": dict(sorted(kept.items()))}
    file.write_text(json.dumps(data, indent=1, sort_keys=True, ensure_ascii=False) + "\n")


def fallen(results: Results, short: bool) -> dict[str, list[str]]:
    """Return by topic what is worse than the record allows, or less exact than it must be."""
    form = "short" if short else "full"
    data = json.loads(RECORD.read_text())[form] | json.loads(record_of_this_processor().read_text()).get(form, {})
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
