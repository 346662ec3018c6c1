"""What commands print: tables and progress. Nothing else in twin prints."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence

from twin.findings import Finding, by_severity
from twin.validation.result import Report

_MARKS = {"error": "✖", "disagreement": "✖", "warning": "▲", "info": "·"}
_VERDICTS = {
    "agree": "AGREE: equations, mechanism and stage tell the same story",
    "disagree": "DISAGREE",
    "unchecked": "UNCHECKED: something could not be judged",
}


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


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = (), indent: str = "  ") -> str:
    """Return rows as aligned text."""
    lines = [list(header), *rows] if header else [list(r) for r in rows]
    if not lines:
        return ""
    widths = [max(len(str(r[i])) for r in lines) for i in range(len(lines[0]))]
    out = [indent + "  ".join(str(c).ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in lines]
    if header:
        out.insert(1, indent + "  ".join("-" * w for w in widths))
    return "\n".join(out)


def finding(f: Finding) -> str:
    """Return a finding in one or two lines."""
    place = ", ".join(x for x in (f.where, f.when) if x)
    head = f"  {_MARKS[f.severity]} {f.message}" + (f"  [{place}]" if place else "")
    return head + (f"\n      {f.suggestion}" if f.suggestion else "")


def report(r: Report, *, all_findings: bool = False) -> str:
    """Return a report for the terminal: verdict, what is wrong, the matrix in short."""
    from twin.report.format import quantity

    lines = [f"{r.robot} · {r.protocol} · {', '.join(f'{k} {v}' for k, v in r.variants.items())}", ""]
    lines += [f"  {_VERDICTS[r.verdict]}", ""]
    shown = [f for f in by_severity(r.findings) if all_findings or f.severity != "info"]
    if shown:
        lines += [*(finding(f) for f in shown), ""]
    groups: dict[tuple[str, str, str], list] = {}
    for row in r.residuals:
        groups.setdefault((row.pair, row.quantity, row.unit), []).append(row)
    rows = []
    for (pair, name, _), group in groups.items():
        worst = max(group, key=lambda x: -1.0 if x.tolerance is None else x.worst / x.tolerance)
        rows.append(
            (
                pair,
                name,
                quantity(worst.worst, worst.unit),
                "" if worst.tolerance is None else quantity(worst.tolerance, worst.unit),
                worst.name,
                worst.phase,
                "" if worst.tolerance is None else "ok" if worst.agrees else "DIFFERS",
            )
        )
    lines += [table(rows, ("pair", "what", "worst", "tolerance", "where", "phase", "")), ""]
    if r.assumed:
        lines.append(f"  {len(r.assumed)} assumed values (unpublished) are listed in the report and by `twin info`.")
    return "\n".join(lines)
