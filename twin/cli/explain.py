"""`twin explain`: which row disagrees, why, where, and the edit that cures it."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from twin import api
from twin.cli import show
from twin.cli.variants import asked
from twin.core.errors import TwinError
from twin.core.units import decimals

if TYPE_CHECKING:
    from twin.validation.explain.result import Explanation, Identified, Repair


def explain(args: argparse.Namespace) -> int:
    """Explain, print; the exit code is 0 agree, 1 disagree, 2 could not check."""
    from twin.validation.explain.explain import explain as explain_

    if not (math.isfinite(args.seconds) and args.seconds >= 0):
        raise TwinError(f"--seconds {args.seconds:g}: give a number of seconds, 0 or more")
    robot = api.load(args.robot)
    formula = robot.formula
    chosen = asked(args.variant)
    with show.progress(args.quiet or args.json) as progress:
        progress("read CAD", 0.0)
        result = explain_(
            robot.name,
            formula,
            robot.reference(),
            chosen,
            tolerance=_tolerance(robot, args.tolerance_um),
            progress=progress,
            budget=args.seconds,
            root=Path.cwd(),
            cad=robot.cad if robot.files is not None else None,
        )
    if args.json:
        print(show.as_json(result.as_dict()))
        return result.exit_code
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    for line, style in lines(result):
        console.print(Text(line, style=style))
    return result.exit_code


def _tolerance(robot: api.Robot, um: float | None):
    from twin.core.units import UM
    from twin.validation.explain.judge import Tolerance
    from twin.validation.rows import Tolerances

    if um is not None and not (math.isfinite(um) and um > 0):
        raise TwinError(f"--tolerance-um {um:g}: give a positive number of micrometres")
    t = Tolerances().widened(um * UM if um is not None else 10 * robot.cad.placement_loss)
    return Tolerance(t.position, t.rotation)


def lines(x: Explanation) -> Iterator[tuple[str, str]]:
    """Yield what is to be read, line by line, each with its style."""
    yield f"{x.robot} · {', '.join(f'{k} {v}' for k, v in x.variants.items())} · {x.samples} poses of the mechanism", ""
    yield "", ""
    if x.verdict == "agree":
        count = f"{x.judged} of {x.rows_of_formula} rows judged"
        yield f"  AGREE: {count}, and each holds at every pose; there is nothing to explain", "bold green"
    elif x.lead == "drawing":
        yield f"  {x.verdict.upper()}: {_drawn(x)}", "bold red" if x.verdict == "disagree" else "bold yellow"
    elif not x.rows:
        yield "  UNCHECKED: not every row could be judged", "bold yellow"
    else:
        what = "explained" if x.explained else "NOT explained by anything that twin knows to try"
        number = f"{len(x.rows)} row{'s' if len(x.rows) > 1 else ''} off"
        yield f"  {x.verdict.upper()}: {number}, {what}", "bold green" if x.explained else "bold red"
    if x.drawing:
        yield "", ""
        yield "the CAD", "bold"
        yield from ((show.finding(f), "") for f in x.drawing)
        yield from ((f"  {p.message}", "green" if p.part and not p.others else "yellow") for p in x.parts)
    if x.lead == "numbers":
        yield from _numbers(x)
    if x.rows:
        yield "", ""
        yield "what is off", "bold"
        for r in x.rows:
            if r.why:
                yield f"  {r.equation} ({r.variant}), {r.symbol} = {r.means}: {r.why}", ""
                yield f"      {r.file}:{r.line}   {r.text}", "dim"
                yield f"      at {r.worst_at}", "dim"
                continue
            much = (
                f"{r.off:.4g} {'°' if r.unit == 'deg' else r.unit}".replace(" °", "°") if r.off == r.off else "no value"
            )
            share = "at every pose" if r.share == 1 else f"at {100 * r.share:.0f} % of the poses"
            yield f"  {r.equation} ({r.variant}), {r.symbol} = {r.means}: {much}, {share}", ""
            yield f"      {r.file}:{r.line}   {r.text}", "dim"
            if r.term:
                yield f"      term: {r.term}", "dim"
            yield f"      worst at {r.worst_at}", "dim"
            if r.share < 1:
                yield f"      right at {r.least_at}", "dim"
    if x.invariants:
        yield "", ""
        yield "what cannot be", "bold"
        yield from ((show.finding(f), "") for f in x.invariants)
    if x.repairs:
        yield "", ""
        yield "what would cure it", "bold"
        for repair in x.repairs:
            yield from _repair(repair)
    if x.lead != "numbers":
        yield from _numbers(x)
    if x.conventions:
        yield "", ""
        yield "conventions", "bold"
        for c in x.conventions:
            yield f"  {c.message}", "green"
            yield f"      cures {', '.join(c.rows)}", "dim"
    if x.notes:
        yield "", ""
        yield from ((f"  · {n}", "dim") for n in x.notes)


def _drawn(x: Explanation) -> str:
    """Return what the drawing explains."""
    if not x.rows:
        return "parts do not meet in the CAD; every row holds"
    rows = f"{len(x.rows)} row{'s' if len(x.rows) > 1 else ''} off"
    return f"{rows}; the CAD explains them: with it corrected every row holds, the equations need no edit"


def _repair(r: Repair) -> Iterator[tuple[str, str]]:
    rows = ", ".join(r.rows)
    if not r.ways:
        yield f"  {rows}: {r.note}", "red"
        yield f"      {_tried(r)}", "dim"
        return
    margin = "nothing else comes near" if r.margin == float("inf") else f"the next best is {r.margin:.1g} times worse"
    yield f"  {rows}" + (" (TIE)" if r.tie else ""), "yellow" if r.tie else "green"
    for i, way in enumerate(r.ways):
        for reading in way:
            mark = (
                f"    {i + 1}. " if len(r.ways) > 1 else "    or " if len(way) > 1 and reading is not way[0] else "    "
            )
            yield mark + " and ".join(f"{c.edit}   ({c.kind}, {c.file}:{c.line})" for c in reading.changes), "bold"
            for line in reading.diff.splitlines():
                if not line.startswith(("---", "+++")):
                    yield f"        {line}", "red" if line[0] == "-" else "green" if line[0] == "+" else "dim"
            if reading.dropped:
                yield f"        the row then depends no more on {', '.join(reading.dropped)}", "dim"
            if reading.note:
                yield f"        {reading.note}", "dim"
    if r.tie:
        yield f"      tie: {r.tie}", "yellow"
    yield f"      {margin}: {r.runner_up}; {_tried(r)}", "dim"


def _tried(r: Repair) -> str:
    if not r.seconds:
        return f"{r.tried} edits tried"
    most = "every pair of tokens" if r.complete else "not every pair (--seconds gives more time)"
    return f"{r.tried} edits and pairs tried, pairs for {r.seconds:.1f} s, {most}"


def _numbers(x: Explanation) -> Iterator[tuple[str, str]]:
    if x.identified is not None:
        yield "", ""
        yield "numbers" + (", as good an explanation as the edit" if x.lead == "edits or numbers" else ""), "bold"
        yield from _identified(x.identified)


def _identified(x: Identified) -> Iterator[tuple[str, str]]:
    if not x.moved:
        yield f"  no values of {', '.join(x.names)} make the rows agree", "red"
    elif x.alternatives:
        yield "  one of these alone makes every row agree; the rows do not tell which:", "yellow"
    for m in x.moved:
        note = f"  ({m.note})" if m.note else ""
        n = decimals(abs(m.fitted - m.formula))
        fitted = f"{m.fitted:.{n}f} ± {m.sigma:.1g} {m.unit} in the CAD"
        yield f"  {m.name}: {m.formula:.{n}f} {m.unit} in the formula, {fitted}{note}", "green"
    for b in x.blind:
        yield f"  no row depends on this change together: {b}", "dim"
