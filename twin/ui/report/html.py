"""Write the report as a self-contained HTML page: no network access, no scripts, inline figures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

from twin.core import format as fmt
from twin.core.findings import Finding, by_severity
from twin.core.provenance import Parameter
from twin.ui.report import curves
from twin.ui.report.matrix import PAIRS, label, pair_names
from twin.validation.cause import SIDES
from twin.validation.commands import again
from twin.validation.result import Report, Residual, headline

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup
    from matplotlib.figure import Figure

VERDICTS = {"agree": "Equations (A), CAD (B) and USD (C) agree", "disagree": "", "unchecked": "Could not check"}
"""Headline of the report for each verdict; "": the function `word` makes the headline."""

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


def render_html(report: Report, figures: Mapping[str, Figure] | None = None) -> str:
    """Return the report as a self-contained HTML page; the same report always gives the same bytes.

    `figures` are the plots by name, as `twin.ui.report.plots.figures` returns them; None: this function draws them.
    """
    from markupsafe import Markup

    from twin.ui.report import style
    from twin.ui.report.plots import figures as draw

    drawn = draw(report) if figures is None else figures
    title = f"{report.robot} on {report.protocol}"
    pictures = {
        name: {
            "svg": Markup(style.svg(figure, name, f"{CAPTIONS.get(name, name)} {title}")),
            "caption": CAPTIONS.get(name, name),
        }
        for name, figure in drawn.items()
    }
    told = {id(f) for c in report.causes for f in c.findings}
    untold = [f for f in by_severity(report.findings) if id(f) not in told]
    return _template().render(
        report=report,
        word=word(report),
        reason=reason(report),
        to_do=_with_commands(report),
        figures_strip=key_figures(report),
        causes=report.causes,
        grave=[f for f in untold if f.severity != "info"],
        infos=[f for f in untold if f.severity == "info"],
        counts=_counts(report),
        groups=_groups(report),
        pictures=pictures,
        drawable=style.drawable(),
        parameters=_parameters(report),
        origins=[(o, sum(p.provenance == o for p in report.parameters)) for o in _ORIGINS],
        command=command(report),
    )


def word(report: Report) -> str:
    """Return the headline for the verdict; for a disagreement, it names the models that disagree."""
    text = VERDICTS[report.verdict] or SIDES[report.causes[0].side]
    return text[:1].upper() + text[1:]


def reason(report: Report) -> str:
    """Return the reason for the verdict as one sentence."""
    if report.verdict == "unchecked":
        return f"{_sentence(report.causes[0].head)} Unchecked quantities have no verdict."
    if report.verdict == "disagree":
        return _sentence(report.causes[0].head)
    failing = [r for r in report.residuals if not r.agrees]
    judged = [r for r in report.residuals if r.tolerance is not None]
    if not judged:
        return "No finding of a disagreement; no residual has a tolerance."
    fewest, most = min(r.samples for r in judged), max(r.samples for r in judged)
    span = fmt.count(most, "sample") if fewest == most else f"{fewest} to {fmt.count(most, 'sample')}"
    over = f", each at {span}" if most > 1 else ""
    if failing:  # a failing residual without a finding
        return f"No finding of a disagreement; residuals above their tolerance: {len(failing)}."
    return f"All {len(judged)} residuals with a tolerance are within their tolerance{over}."


def key_figures(report: Report) -> list[dict[str, str]]:
    """Return the key numbers of the report, each with the entries label, value, note, state and optionally link.

    The state is "good", "near", "bad" or "none". If the models disagree, the first number is that of the first cause.
    """

    def worst(name: str, rows: list[Residual]) -> dict[str, str]:
        if not rows:
            return {"label": name, "value": fmt.NONE, "note": "not compared", "state": "none"}
        r = headline(rows)
        note = "no tolerance" if r.tolerance is None else f"limit {fmt.quantity(r.tolerance, r.unit)}"
        state = "none" if r.tolerance is None else "good" if r.agrees else "bad"
        if not r.agrees and r.consequence_of:
            note, state = f"follows from {r.consequence_of}", "near"
        return {"label": name, "value": fmt.quantity(r.worst, r.unit), "note": note, "state": state}

    out = [
        *_headline_figure(report),
        worst("Tool position, A–B", curves.rows(report, "tool", "m", "A-B")),
        worst("Tool rotation, A–B", curves.rows(report, "tool", "rad", "A-B")),
        worst("Loop gap, B", curves.rows(report, "loop", "m", "B")),
        _rcm_figure(report),
        _clearance_figure(report),
    ]
    length = curves.duration(report)
    phases = fmt.count(len(report.phases), "phase")
    out.append({"label": "Duration", "value": fmt.seconds(length), "note": phases, "state": "none"})
    if report.parameters:
        n = len(report.assumed)
        note = f"of {fmt.count(len(report.parameters), 'parameter')}"
        entry = {"label": "Assumed", "value": str(n), "note": note, "state": "none"}
        out.append(entry | {"link": "#parameters"})
    return out


def command(report: Report) -> str:
    """Return the command line that reproduces this report."""
    if "command" in report.environment:
        return report.environment["command"]
    return report.commands.get("validate") or again(report.robot, report.protocol, report.variants)


def _with_commands(report: Report) -> Markup:
    """Return the report's suggestion as HTML, with formatted command lines."""
    from markupsafe import Markup, escape

    text, lines = str(escape(report.what_to_do)), [str(escape(line)) for line in report.commands.values()]
    if lines:  # the longest first: a line can be a part of another line
        text = re.sub("|".join(map(re.escape, sorted(lines, key=len, reverse=True))), r"<code>\g<0></code>", text)
    return Markup(text)


def _sentence(finding: Finding) -> str:
    text = finding.message.strip()
    text = text[:1].upper() + text[1:]
    if finding.where and finding.where not in text:
        text = f"{finding.where}: {finding.message.strip()}"
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _headline_figure(report: Report) -> list[dict[str, str]]:
    """Return the first cause's key number, a value that `reason` also states; [] without cause or without value."""
    if report.verdict != "disagree" or report.causes[0].head.size is None:
        return []
    cause = report.causes[0]
    limit = "" if cause.head.limit is None else f", limit {fmt.shown(cause.head.limit, cause.head.unit)}"
    note = f"{cause.head.where}{limit}" if cause.head.where != cause.name else limit.removeprefix(", ")
    value = fmt.shown(cause.head.size, cause.head.unit)
    return [{"label": cause.name, "value": value, "note": note, "state": "bad", "link": "#findings"}]


def _rcm_figure(report: Report) -> dict[str, str]:
    """Return the mechanism's RCM error (if unknown, the planned RCM error), with the limit from the protocol."""
    rows, planned = curves.rows(report, "rcm", "m"), curves.pair(report, "rcm_error")
    if not rows and planned is None:
        return {"label": "RCM error", "value": fmt.NONE, "note": "no RCM registered", "state": "none"}
    limit = curves.rcm_tolerance(report)
    values = [r.worst for r in rows] if rows or planned is None else [float(x) for x in planned[1].ravel() if x == x]
    value = max(values, key=lambda x: math.inf if math.isnan(x) else x)
    note = f"limit {fmt.quantity(limit, 'm')}" if limit else "no tolerance"
    bad = any(not r.agrees for r in rows) or (limit is not None and not value <= limit)
    state = "bad" if bad else "none" if limit is None else "good"
    return {"label": "RCM error", "value": fmt.quantity(value, "m"), "note": note, "state": state}


def _clearance_figure(report: Report) -> dict[str, str]:
    found = curves.pair(report, "clearance", "clearance_t")
    if found is None or found[1].ndim != 1:
        return {"label": "Minimum clearance", "value": fmt.NONE, "note": "not computed", "state": "none"}
    t, y = found
    k = min((i for i in range(len(y)) if y[i] == y[i]), key=lambda i: y[i])
    state = "bad" if y[k] < 0 else "none"
    return {
        "label": "Minimum clearance",
        "value": fmt.quantity(float(y[k]), "m"),
        "note": f"at {fmt.seconds(float(t[k]))}",
        "state": state,
    }


def _counts(report: Report) -> list[str]:
    """Return texts that state the numbers of causes, of findings that follow from the causes, and of other findings."""
    causes = report.causes
    told = {id(f) for c in causes for f in c.findings}
    out = [fmt.count(len(causes), "cause")] if causes else []
    for name, many in (("of the same kind", "also"), ("that follows", "follows"), ("that may follow", "perhaps")):
        n = sum(len(getattr(c, many)) for c in causes)
        out += [f"{fmt.count(n, 'finding')} {name if n == 1 else name.replace('follows', 'follow')}"] if n else []
    for severity in ("warning", "info"):
        n = sum(f.severity == severity and id(f) not in told for f in report.findings)
        out += [fmt.count(n, "note" if severity == "info" else severity)] if n else []
    return out


def _groups(report: Report) -> list[dict[str, Any]]:
    """Return the residuals by pair of models: failing residuals first, consequences directly after their cause."""
    out = []
    for pair in pair_names(report):
        rows = [r for r in report.residuals if r.pair == pair]
        own = sorted((r for r in rows if not r.consequence_of), key=lambda r: r.agrees)
        ordered: list[Residual] = []
        for r in own:
            ordered.append(r)
            ordered += [c for c in rows if c.consequence_of in _aliases(r) and c not in ordered]
        ordered += [r for r in rows if r not in ordered]
        title, short = PAIRS.get(pair, (pair, pair))
        out.append(
            {
                "pair": short,
                "title": title[:1].upper() + title[1:],
                "rows": ordered,
                "bad": sum(not r.agrees for r in rows),
                "judged": sum(r.tolerance is not None for r in rows),
            }
        )
    return out


def _aliases(row: Residual) -> set[str]:
    """Return the names by which other residuals refer to this residual."""
    name = f"{row.quantity} {row.name}"
    return {row.name, label(row), name, f"{row.pair} {name}"} - {""}


def _parameters(report: Report) -> list[tuple[str, list[Parameter]]]:
    """Return (title, parameters) of two groups: CAD, and all others. Assumed parameters are first in each group."""
    ordered = sorted(report.parameters, key=lambda p: _ORIGINS.index(p.provenance))
    drawn = [p for p in ordered if p.name.startswith("drawing.")]
    return [
        ("Equations, limits, protocol", [p for p in ordered if p not in drawn]),
        ("Dimensions of the CAD", drawn),
    ]


def _parameter_value(p: Parameter) -> str:
    return fmt.shown(p.shown, p.unit, 6)


def _when(row: Residual) -> str:
    return fmt.seconds(row.t) if math.isfinite(row.t) else fmt.NONE


def _bar(f: Finding, beside: Iterable[Finding] = ()) -> dict[str, float] | None:
    """Return the positions, 0 to 100, of a finding's size and limit on a linear bar; None without size or limit.

    The bar ends at the largest of these values: the size, twice the limit, and the sizes of the findings `beside` in
    the same unit.
    """
    if f.size is None or not f.limit or not math.isfinite(f.size):
        return None
    alike = [abs(o.size) for o in beside if o.size is not None and o.unit == f.unit and math.isfinite(o.size)]
    full = max(abs(f.size), 2 * abs(f.limit), *alike)
    return {"size": round(100 * abs(f.size) / full, 1), "limit": round(100 * abs(f.limit) / full, 1)}


@cache
def _template() -> Template:
    from twin.ui.report import style

    made = style.template(
        "report.html.j2",
        quantity=fmt.quantity,
        shown=fmt.shown,
        seconds=fmt.seconds,
        point=fmt.point,
        count=fmt.count,
        label=label,
        value=_parameter_value,
        when=_when,
        bar=_bar,
        times=lambda r: fmt.ratio(r.worst, r.tolerance),
        words=lambda name: name.replace("_", " "),
    )
    made.globals["NONE"] = fmt.NONE
    return made
