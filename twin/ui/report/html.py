"""Write the report as a self-contained HTML page: no network access, inline figures, its scripts inside."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from twin.core import format as fmt
from twin.core.findings import Finding, by_severity
from twin.core.json_types import JsonObject
from twin.core.provenance import DRAWING, Parameter
from twin.ui.report import plot_data
from twin.ui.report.first_screen import answers, not_judged, times_limit
from twin.ui.report.residual_matrix import PAIR_TITLES, label, pair_names
from twin.validation.cause import SIDES
from twin.validation.repeat_commands import validate_command
from twin.validation.result import Report, Residual, headline

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup
    from matplotlib.figure import Figure

    from twin.ui.report.robot_picture import RobotPicture

VERDICTS = {
    "agree": "Equations (A), CAD (B) and USD (C) agree",
    "disagree": "",
    "unchecked": "Could not check",
}
"""Headline of the report for each verdict; "": the function `verdict_word` makes the headline."""

CAPTIONS = {
    "residual_matrix": "Worst residual of every compared quantity over all samples. Read a row from left to right: the "
    "first red cell is the first comparison that disagrees.",
    "active_joints": "Displacement, speed and acceleration of the active joints over the phases.",
    "tool_motion": "Displacement, speed and acceleration of the tool frame in the base. Coloured curves are "
    "planned; dashed curves belong to the independent mechanism, if computed.",
    "residuals": "Difference between formula and mechanism on a logarithmic scale, with the tolerances.",
    "rcm": "Distance from the registered remote centre of motion (the trocar) to the shaft axis. "
    "The axis is logarithmic; there is no curve while no RCM is registered.",
    "fulcrum": "The trocar acts as a fulcrum: tip and outer shaft move to opposite sides. "
    "Sideways is the direction across the shaft in which the tip moves most.",
    "margins": "Distance to a joint limit, the end of the reach, or a singularity. A singularity measure is shown "
    "relative to its alarm value and is 0 at the singularity; 1 is the alarm.",
    "clearance": "Minimum distance between bodies, except pairs that touch by design.",
    "path_cost": "Cost of each path around obstacles over the number of samples of the search. Shortcuts make the path "
    "that the search tree contains shorter; rings mark the paths of the plan.",
    "convergence": "Residual of tip and trocar after each step of Levenberg-Marquardt, one start for each of 300 "
    "random problems; up to 20 searches of each outcome are drawn. A search that converges with the arm beyond the tip "
    "is no solution: the trocar is not between them.",
}
"""Caption of each plot, by name."""

_ORIGINS = ("ASSUMED", "DERIVED", "CITED", "PUBLISHED")


def render_html(
    report: Report,
    figures: Mapping[str, Figure] | None = None,
    robot: RobotPicture | None = None,
    robot_missing: str = "",
) -> str:
    """Return the report as a self-contained HTML page; the same report always gives the same bytes.

    `figures` are the plots by name, as `twin.ui.report.plots.figures` returns them; None: this function draws them.
    `robot` is the picture of the robot at the top; None: no picture. `robot_missing` is the error because of which it
    could not be drawn; "": no error.
    """
    from markupsafe import Markup

    from twin.ui.report import figure_output, style
    from twin.ui.report.plots import figures as draw

    if figures is None:
        figures = draw(report)
    title = f"{report.robot} on {report.protocol}"
    pictures = {}
    for name, figure in figures.items():
        caption = CAPTIONS.get(name, name)
        axes = figure_output.hover_data(figure, name)
        svg = figure_output.svg(figure, name, f"{caption} {title}")
        pictures[name] = {"svg": Markup(svg), "caption": caption, "axes": json.dumps(axes) if axes else ""}
    robot_data = Markup("")
    if robot is not None:
        robot_data = Markup(robot.data)
    grave = []
    infos = []
    for finding in by_severity(_without_cause(report)):
        if finding.severity == "info":
            infos.append(finding)
        else:
            grave.append(finding)
    # in the order of `_ORIGINS`, also those without parameters
    numbers = dict.fromkeys(_ORIGINS, 0)
    for parameter in report.parameters:
        numbers[parameter.provenance] += 1
    return _template().render(
        report=report,
        word=verdict_word(report),
        reason=verdict_reason(report),
        to_do=_with_commands(report),
        figures_strip=key_figures(report),
        causes=report.causes,
        grave=grave,
        infos=infos,
        counts=_counts(report),
        groups=_pair_groups(report),
        pictures=pictures,
        plots=_plots(report, pictures),
        drawable=style.drawable(),
        parameters=_parameters(report),
        origins=list(numbers.items()),
        command=command(report),
        answers=answers(report, robot),
        unjudged="; ".join(not_judged(report)),
        robot=robot,
        robot_data=robot_data,
        robot_missing=robot_missing,
        hovers=any(picture["axes"] for picture in pictures.values()),
    )


def _plots(report: Report, pictures: Iterable[str]) -> list[str]:
    """Return the names of the plots in the order of the page; after a disagreement, the residuals come first."""
    names = [name for name in pictures if name != "residual_matrix"]
    if report.causes and "residuals" in names:
        names.remove("residuals")
        names.insert(0, "residuals")
    return names


def _without_cause(report: Report) -> list[Finding]:
    """Return the findings that belong to none of the report's causes."""
    # by identity: two findings with the same content can belong to different causes
    explained = set()
    for cause in report.causes:
        for finding in cause.findings:
            explained.add(id(finding))
    others = []
    for finding in report.findings:
        if id(finding) not in explained:
            others.append(finding)
    return others


def verdict_word(report: Report) -> str:
    """Return the headline for the verdict; for a disagreement, it names the models that disagree."""
    text = VERDICTS[report.verdict] or SIDES[report.causes[0].side]
    return _capitalised(text)


def verdict_reason(report: Report) -> str:
    """Return the reason for the verdict as one sentence."""
    if report.verdict == "unchecked":
        return f"{_sentence(report.causes[0].head)} Unchecked quantities have no verdict."
    if report.verdict == "disagree":
        return _sentence(report.causes[0].head)
    samples = []
    failing = 0
    for residual in report.residuals:
        if residual.tolerance is not None:
            samples.append(residual.samples)
        if not residual.agrees:
            failing += 1
    if not samples:
        return "No finding of a disagreement; no residual has a tolerance."
    if failing:  # a failing residual without a finding
        return f"No finding of a disagreement; residuals above their tolerance: {failing}."
    fewest = min(samples)
    most = max(samples)
    text = f"All {len(samples)} residuals with a tolerance are within their tolerance"
    if most <= 1:
        return f"{text}."
    span = fmt.count(most, "sample")
    if fewest < most:
        span = f"{fewest} to {span}"
    return f"{text}, each at {span}."


def key_figures(report: Report) -> list[dict[str, str]]:
    """Return the key numbers of the report, each with the entries label, value, note, state and optionally link.

    The state is "good", "near", "bad" or "none". If the models disagree, the first number is that of the first cause.
    """
    length = plot_data.duration(report)
    phases = fmt.count(len(report.phases), "phase")
    numbers = [
        *_headline_figure(report),
        _worst_figure("Tool position, A–B", plot_data.rows(report, "tool", "m", "A-B")),
        _worst_figure("Tool rotation, A–B", plot_data.rows(report, "tool", "rad", "A-B")),
        _worst_figure("Loop gap, B", plot_data.rows(report, "loop", "m", "B")),
        _rcm_figure(report),
        _clearance_figure(report),
        _key_figure("Duration", fmt.seconds(length), phases),
    ]
    if report.parameters:
        counts = report.assumed_counts
        others = replace(counts, robot=0)
        note = "of the robot" + (f"; {others}" if str(others) else "")
        assumed = _key_figure("Assumed", str(counts.robot), note)
        numbers.append(assumed | {"link": "#parameters"})
    return numbers


def _key_figure(label: str, value: str, note: str, state: str = "none") -> dict[str, str]:
    return {"label": label, "value": value, "note": note, "state": state}


def _worst_figure(name: str, rows: list[Residual]) -> dict[str, str]:
    """Return the key number of a compared quantity: the residual that the report's headline names."""
    if not rows:
        return _key_figure(name, fmt.NONE, "not compared")
    row = headline(rows)
    value = fmt.deviation(row.worst, row.unit, row.tolerance)
    if not row.agrees and row.consequence_of:
        return _key_figure(name, value, f"follows from {row.consequence_of}", "near")
    if row.tolerance is None:
        return _key_figure(name, value, "no tolerance")
    state = "good" if row.agrees else "bad"
    return _key_figure(name, value, f"limit {fmt.quantity(row.tolerance, row.unit)}", state)


def command(report: Report) -> str:
    """Return the command line that reproduces this report."""
    if "command" in report.environment:
        return report.environment["command"]
    return report.commands.get("validate") or validate_command(report.robot, report.protocol, report.variants)


def _with_commands(report: Report) -> Markup:
    """Return the report's suggestion as HTML, with formatted command lines."""
    from markupsafe import Markup, escape

    text = str(escape(report.what_to_do))
    lines = []
    for line in report.commands.values():
        lines.append(str(escape(line)))
    if lines:
        lines.sort(key=len, reverse=True)  # the longest first: a line can be a part of another line
        any_line = "|".join(map(re.escape, lines))
        text = re.sub(any_line, r"<code>\g<0></code>", text)
    return Markup(text)


def _capitalised(text: str) -> str:
    """Return the text with a capital first letter; unlike `str.capitalize`, keep all other letters."""
    return text[:1].upper() + text[1:]


def _sentence(finding: Finding) -> str:
    """Return the message as a sentence, which begins with the place of the finding if the message does not name it."""
    message = finding.message.strip()
    text = _capitalised(message)
    if finding.where and finding.where not in text:
        text = f"{finding.where}: {message}"
    if text.endswith((".", "!", "?")):
        return text
    return f"{text}."


def _headline_figure(report: Report) -> list[dict[str, str]]:
    """Return the first cause's key number, which `verdict_reason` also states; [] without cause or value."""
    if report.verdict != "disagree":
        return []
    cause = report.causes[0]
    finding = cause.head
    if finding.size is None:
        return []
    limit = ""
    if finding.limit is not None:
        limit = f"limit {fmt.shown(finding.limit, finding.unit)}"
    if finding.where == cause.name:
        note = limit
    elif limit:
        note = f"{finding.where}, {limit}"
    else:
        note = finding.where
    figure = _key_figure(cause.name, fmt.shown(finding.size, finding.unit), note, "bad")
    return [figure | {"link": "#findings"}]


def _rcm_figure(report: Report) -> dict[str, str]:
    """Return the mechanism's RCM error (if unknown, the planned RCM error), with the limit from the protocol."""
    rows = plot_data.rows(report, "rcm", "m")
    planned = plot_data.curve_of(report, "rcm_error")
    if rows:
        value = max(rows, key=_failing_size).worst
    elif planned is not None:
        _, errors = planned
        value = float(np.nanmax(errors))
    else:
        return _key_figure("RCM error", fmt.NONE, "no RCM registered")
    limit = plot_data.rcm_tolerance(report)
    note = "no tolerance"
    if limit:
        note = f"limit {fmt.quantity(limit, 'm')}"
    state = "none"
    if limit is not None:
        # written so that NaN, which compares as False, is not good
        state = "good" if value <= limit else "bad"
    for row in rows:
        if not row.agrees:
            state = "bad"
    return _key_figure("RCM error", fmt.deviation(value, "m", limit), note, state)


def _failing_size(row: Residual) -> float:
    """Return the worst value of a residual; one that could not be computed (NaN) counts as infinite."""
    if math.isnan(row.worst):
        return math.inf
    return row.worst


def _clearance_figure(report: Report) -> dict[str, str]:
    curve = plot_data.curve_of(report, "clearance", "clearance_t")
    if curve is None or curve[1].ndim != 1:
        return _key_figure("Minimum clearance", fmt.NONE, "not computed")
    t, distances = curve
    k = int(np.nanargmin(distances))
    distance = float(distances[k])
    state = "bad" if distance < 0 else "none"
    return _key_figure("Minimum clearance", fmt.quantity(distance, "m"), f"at {fmt.seconds(float(t[k]))}", state)


def _counts(report: Report) -> list[str]:
    """Return texts that state the numbers of causes, of findings that follow from the causes, and of other findings."""
    alike = 0
    following = 0
    perhaps = 0
    for cause in report.causes:
        alike += len(cause.also)
        following += len(cause.follows)
        perhaps += len(cause.perhaps)
    verb = "follows" if following == 1 else "follow"
    warnings = 0
    infos = 0
    for finding in _without_cause(report):
        warnings += finding.severity == "warning"
        infos += finding.severity == "info"
    texts = []
    for number, noun, addition in (
        (len(report.causes), "cause", ""),
        (alike, "finding", " of the same kind"),
        (following, "finding", f" that {verb}"),
        (perhaps, "finding", " that may follow"),
        (warnings, "warning", ""),
        (infos, "note", ""),
    ):
        if number:
            texts.append(f"{fmt.count(number, noun)}{addition}")
    return texts


def _pair_groups(report: Report) -> list[JsonObject]:
    """Return the residuals by pair of models: failing residuals first, consequences directly after their cause."""
    groups = []
    for pair in pair_names(report):
        rows = []
        problem_count = 0
        judged = 0
        for row in report.residuals:
            if row.pair != pair:
                continue
            rows.append(row)
            problem_count += not row.agrees
            judged += row.tolerance is not None
        title, short = PAIR_TITLES.get(pair, (pair, pair))
        group = {
            "pair": short,
            "title": _capitalised(title),
            "rows": _by_cause(rows),
            "bad": problem_count,
            "judged": judged,
        }
        groups.append(group)
    return groups


def _by_cause(rows: list[Residual]) -> list[Residual]:
    """Return residuals with failing ones first and each consequence directly after its cause."""
    causes = [row for row in rows if not row.consequence_of]
    causes.sort(key=lambda row: row.agrees)
    ordered: list[Residual] = []
    for cause in causes:
        ordered.append(cause)
        names = _aliases(cause)
        for row in rows:
            if row.consequence_of in names and row not in ordered:
                ordered.append(row)
    # last, consequences of residuals of another pair of models
    others = [row for row in rows if row not in ordered]
    return ordered + others


def _aliases(row: Residual) -> set[str]:
    """Return the names by which other residuals refer to this residual."""
    name = f"{row.quantity} {row.name}"
    return {row.name, label(row), name, f"{row.pair} {name}"} - {""}


def _parameters(report: Report) -> list[tuple[str, list[Parameter]]]:
    """Return (title, parameters) of two groups: CAD, and all others. Assumed parameters are first in each group."""
    figures = []
    others = []
    for parameter in sorted(report.parameters, key=lambda p: _ORIGINS.index(p.provenance)):
        if parameter.name.startswith(DRAWING):
            figures.append(parameter)
        else:
            others.append(parameter)
    return [("Equations, limits, protocol", others), ("Dimensions of the CAD", figures)]


def _parameter_value(p: Parameter) -> str:
    return fmt.shown(p.shown, p.unit, 6)


def _worst_time(row: Residual) -> str:
    if not math.isfinite(row.t):
        return fmt.NONE
    return fmt.seconds(row.t)


def _limit_bar(finding: Finding, beside: Iterable[Finding] = ()) -> dict[str, float] | None:
    """Return the positions, 0 to 100, of a finding's size and limit on a linear bar; None without size or limit.

    The bar ends at the largest of these values: the size, twice the limit, and the sizes of the findings `beside` in
    the same unit.
    """
    if finding.size is None or not finding.limit or not math.isfinite(finding.size):
        return None
    size = abs(finding.size)
    limit = abs(finding.limit)
    full = max(size, 2 * limit)
    for other_finding in beside:
        if other_finding.size is not None and other_finding.unit == finding.unit and math.isfinite(other_finding.size):
            full = max(full, abs(other_finding.size))
    return {"size": round(100 * size / full, 1), "limit": round(100 * limit / full, 1)}


def _shown_size(f: Finding) -> str:
    """Return the size of a finding as text; that of a difference within its tolerance can be a rounding error."""
    within = f.severity == "info" and f.limit is not None and f.size is not None and 0 <= f.size <= f.limit
    if within and fmt.is_exact(f.size, f.unit):
        return fmt.EXACT
    return fmt.shown(f.size, f.unit)


@cache
def _template() -> Template:
    from twin.ui.report.page_template import template

    report_template = template(
        "report.html.j2",
        quantity=fmt.quantity,
        shown=fmt.shown,
        size=_shown_size,
        seconds=fmt.seconds,
        point=fmt.point,
        count=fmt.count,
        label=label,
        value=_parameter_value,
        when=_worst_time,
        bar=_limit_bar,
        capital=_capitalised,
        times_limit=times_limit,
        times=lambda r: fmt.ratio(r.worst, r.tolerance),
        words=lambda name: name.replace("_", " "),
    )
    report_template.globals["NONE"] = fmt.NONE
    return report_template
