"""What commands print: tables and progress. Nothing else in twin prints."""

from __future__ import annotations

import contextlib
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from twin.core.findings import Finding, by_severity
from twin.core.units import DEG, MM
from twin.validation.cause import SIDES, Cause
from twin.validation.result import Report, as_json, headline

if TYPE_CHECKING:
    from twin.api import Robot

__all__ = ["as_json", "finding", "info", "progress", "report", "table", "told", "verdict_line", "way_out"]

_MARKS = {"error": "✖", "disagreement": "✖", "warning": "▲", "info": "·"}
_VERDICTS = {
    "agree": "AGREE: equations, mechanism and stage agree",
    "disagree": "DISAGREE: {}",
    "unchecked": "UNCHECKED: something could not be judged",
}


_WITHOUT = "AGREE: mechanism and stage agree; there are no equations to judge yet"


def told(robot: Robot, quiet: bool) -> None:
    """Print what was taken for the tool of a stage that names none, beside what the command prints."""
    if not quiet and robot.files is None and robot.mechanism and robot.told:
        print(f"  {robot.told} Choose another with --tool.", file=sys.stderr)


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that shows what is being done; nothing if quiet or not on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda label, fraction: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("start", total=None)

        def update(label: str, fraction: float) -> None:
            # A step that does not know how far it is shows a moving bar.
            bar.update(task, description=label, total=1.0 if fraction else None, completed=fraction)

        yield update


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), indent: str = "  ", *, fit: bool = False) -> str:
    """Return rows as aligned text; `fit` cuts long lines on a terminal, where they would wrap."""
    lines = [list(header), *rows] if header else [list(r) for r in rows]
    if not lines:
        return ""
    widths = [max(len(str(r[i])) for r in lines) for i in range(len(lines[0]))]
    out = [indent + "  ".join(str(c).ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in lines]
    if header:
        out.insert(1, indent + "  ".join("-" * w for w in widths))
    if fit and sys.stdout.isatty():
        width = shutil.get_terminal_size().columns
        out = [line if len(line) <= width else f"{line[: width - 1]}…" for line in out]
    return "\n".join(out)


def finding(f: Finding) -> str:
    """Return a finding in one or two lines."""
    place = ", ".join(x for x in (f.where, f.when) if x)
    head = f"  {_MARKS[f.severity]} {f.message}" + (f"  [{place}]" if place else "")
    return head + (f"\n      {f.suggestion}" if f.suggestion else "")


def info(data: Mapping[str, Any], bodies: int) -> str:
    """Return what is known of a robot: mechanism, variants of its equations, parameters with provenance."""
    loops = [j["name"] for j in data["joints"] if j["closes_loop"]]
    lines = [
        f"{data['name']}: {data['title']}" if data["title"] else data["name"],
        f"  {data['source']}",
        "",
        f"  {bodies} bodies, {len(data['joints'])} joints, {data['degrees_of_freedom']} degrees of freedom, "
        f"{data['redundant_constraints']} redundant constraints; "
        + (f"loops closed by {', '.join(loops)}" if loops else "no loops"),
        *(f"    redundant at {name}: {r['count']} of {', '.join(r['among'])}" for name, r in data["redundant"].items()),
        f"  frames: {', '.join(data['frames'])}   points: {', '.join(data['points']) or 'none'}",
        "",
    ]
    rows = []
    for j in data["joints"]:
        scale, unit = (DEG, "deg") if j["type"] == "revolute" else (MM, "mm")
        limits = "" if j["limits"] is None else f"{j['limits'][0] / scale:g} .. {j['limits'][1] / scale:g} {unit}"
        role = (
            "auxiliary" if j["auxiliary"] else "driven" if j["active"] else "closes a loop" if j["closes_loop"] else ""
        )
        rows.append((j["name"], j["type"], f"{j['parent']} -> {j['child']}", limits, role))
    lines += [table(rows, ("joint", "type", "between", "limits", "")), ""]
    lines += _motors(data["actuators"], data["transmissions"])
    for name, choices in data["variants"].items():
        for variant, reason in choices.items():
            mark = "*" if data["chosen"][name] == variant else " "
            lines.append(f" {mark}{name}={variant}: {reason}")
    if not data["variants"]:
        lines.append("  no equations")
    if data["parameters"]:
        lines += ["", "  parameters (* assumed: nobody has published it)"]
        # What was only drawn comes last: there is much of it.
        parameters = sorted(data["parameters"], key=lambda p: (p["name"].startswith("drawing."), p["provenance"]))
        rows = []
        for p in parameters:
            mark = "*" if p["provenance"] == "ASSUMED" else " "
            rows.append((mark + p["name"], f"{p['shown']:g} {p['unit']}", p["provenance"], p["note"]))
        lines.append(table(rows, fit=True))
    return "\n".join([*lines, *(finding(Finding(**f)) for f in data["findings"])])


def _motors(actuators: Sequence[Mapping[str, Any]], transmissions: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines about motors and what leads them to joints; none if every driven joint is driven directly."""
    if not transmissions:
        return []
    rows = []
    for a in actuators:
        scale, unit, effort = (DEG, "deg", "N m") if a["kind"] == "angle" else (MM, "mm", "N")
        limits = "" if a["limits"] is None else f"{a['limits'][0] / scale:g} .. {a['limits'][1] / scale:g} {unit}"
        speed = "" if a["max_speed"] is None else f"{a['max_speed'] / scale:g} {unit}/s"
        force = "" if a["max_effort"] is None else f"{a['max_effort']:g} {effort}"
        inertia = "" if a["rotor_inertia"] is None else f"{a['rotor_inertia']:g} {'kg m2' if unit == 'deg' else 'kg'}"
        rows.append((a["name"], a["kind"], limits, speed, force, inertia))
    header = ("actuator", "coordinate", "limits", "max speed", "max effort", "rotor")
    told = [f"  transmission {t['name']} (rad, m): {t['equations']}" for t in transmissions]
    return [table(rows, header), "", *told, ""]


def report(r: Report, *, all_findings: bool = False) -> str:
    """Return a report for the terminal: verdict, what is wrong by cause, the matrix in short."""
    from twin.ui.report.format import quantity

    lines = [f"{r.robot} · {r.protocol} · {', '.join(f'{k} {v}' for k, v in r.variants.items())}", ""]
    unjudged = not r.variants and r.verdict == "agree"
    lines += [f"  {_WITHOUT if unjudged else verdict_line(r)}", ""]
    told = {id(f) for c in r.causes for f in c.findings}
    others = [f for f in by_severity(r.findings) if id(f) not in told and (all_findings or f.severity != "info")]
    shown = [*(cause(c) for c in r.causes), *(finding(f) for f in others)]
    if shown:
        lines += [*shown, ""]
    groups: dict[tuple[str, str, str], list] = {}
    for row in r.residuals:
        groups.setdefault((row.pair, row.quantity, row.unit), []).append(row)
    rows = []
    for (pair, name, _), group in groups.items():
        worst = headline(group)
        state = "ok" if worst.agrees else f"follows from {worst.consequence_of}" if worst.consequence_of else "DIFFERS"
        rows.append(
            (
                pair,
                name,
                quantity(worst.worst, worst.unit),
                "" if worst.tolerance is None else quantity(worst.tolerance, worst.unit),
                worst.name,
                worst.phase,
                "" if worst.tolerance is None else state,
            )
        )
    lines += [table(rows, ("pair", "what", "worst", "tolerance", "where", "phase", "")), ""]
    if r.assumed:
        lines.append(f"  {len(r.assumed)} assumed values (unpublished) are listed in the report and by `twin info`.")
    return "\n".join(lines)


def verdict_line(r: Report) -> str:
    """Return the verdict in a few words; of a disagreement, which two sides differ."""
    return _VERDICTS[r.verdict].format(SIDES[r.causes[0].side] if r.causes else "")


def way_out(r: Report) -> str:
    """Return what to do as the last line of a verdict; "" if nothing is to be done."""
    return f"\n  what to do: {r.what_to_do}\n" if r.what_to_do else ""


def cause(c: Cause) -> str:
    """Return a cause: its headline, and on one line each the same elsewhere and what follows."""
    lines = [finding(c.head)]
    for words, found in (("also", c.also), ("follows from it", c.follows), ("may follow from it", c.perhaps)):
        if found:
            lines.append(f"      {words}: {_sizes(found)}")
    return "\n".join(lines)


def _sizes(found: Sequence[Finding], most: int = 6) -> str:
    """Return places and sizes, the first few of them."""
    from twin.ui.report.format import shown

    words = [
        f.code.partition(".")[2].replace("_", " ") if f.size is None else f"{f.where} {shown(f.size, f.unit)}".strip()
        for f in found
    ]
    return "; ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")
