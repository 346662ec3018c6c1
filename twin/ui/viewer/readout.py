"""Format the readings of a robot as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from twin.core.format import EXACT, is_exact, quantity
from twin.core.units import DEG, MM
from twin.ui.session.readings import LIVE_TOLERANCE, EquationDeviation, JointReading, RobotReading

# Colours have the contrast of WCAG AA, on the light and on the dark page.
_GOOD_COLOR = "light-dark(#17703f, #57c98e)"
_BAD_COLOR = "light-dark(#b8201f, #ff8a80)"
_WARNING_COLOR = "light-dark(#8f5200, #f0b34a)"

_RCM_TOLERANCE = 0.1 * MM
"""Trocar error in m from which it is shown in red (ASSUMED)."""

_LARGE_CONDITION = 100
"""Condition number of the Jacobian above which a warning colour is shown (ASSUMED)."""

_NEAR_ALARM = 2
"""Singularity measure, as a multiple of its alarm value, up to which a warning colour is shown (ASSUMED)."""

_AT_LIMIT = 0.02
"""Distance of a joint from its nearer limit, as a part of its range, below which its mark is red."""

_NEAR_LIMIT = 0.1
"""The same below which its mark has the warning colour."""

_NAME_STYLE = "opacity:.78"
"""Style of the names of values."""

_COORDINATES_STYLE = (
    "display:grid;grid-auto-flow:column;gap:0 .8em;white-space:nowrap;font-variant-numeric:tabular-nums;"
    "padding-bottom:.4em"
)
"""Style of the coordinates, in two columns with the lengths first; a value and its unit are on one line."""


def length_text(metres: float) -> str:
    """Return a length in m as text with a suitable unit, and three decimals so that its width does not change."""
    if not np.isfinite(metres):
        return "-"
    for smallest, scale, unit in ((1e-4, MM, "mm"), (1e-7, 1e-6, "µm"), (1e-10, 1e-9, "nm")):
        if abs(metres) >= smallest:
            return f"{metres / scale:.3f} {unit}"
    return quantity(metres, "m")


def difference_text(metres: float) -> str:
    """Return a difference in m, which should be 0, as text: "exact" if it is a rounding error."""
    if is_exact(metres, "m"):
        return EXACT
    return length_text(metres)


def residual_text(residual: EquationDeviation) -> str:
    """Return a residual (a length or an angle) as text with a suitable unit."""
    if is_exact(residual.size, "rad" if residual.is_angle else "m"):
        return EXACT
    if residual.is_angle:
        return angle_text(residual.size)
    return length_text(residual.size)


def angle_text(radians: float) -> str:
    """Return the size of an angle in rad, without its sign, as text in degrees with a suitable number of digits."""
    degrees = abs(radians) / DEG
    if degrees >= 0.001:
        return f"{degrees:.3f}°"
    return f"{degrees:.1e}°"


def table(reading: RobotReading, variants: str = "") -> str:
    """Return the panel with all readings as HTML; values at or beyond their limits are red.

    `variants` is a text that names the chosen variants of the equations; "": no line for them.
    """
    row_count = (len(reading.coordinates) + 1) // 2
    numbers = "".join(_number(*coordinate) for coordinate in reading.coordinates)
    rows = [f"<div style='{_COORDINATES_STYLE};grid-template-rows:repeat({row_count},auto)'>{numbers}</div>"]
    if variants:
        rows.append(_line("equations", escape(variants)))
    if reading.residual is not None:
        text, color = _agreement(reading, reading.residual)
        rows.append(_line("formula ↔ mechanism", text, color))
    rows.append(_line("loop gap", escape(difference_text(reading.gap)), _color_below(reading.gap, LIVE_TOLERANCE)))
    for trocar in reading.trocars:
        which_trocar = ""
        if len(reading.trocars) > 1:
            which_trocar = f", {escape(trocar.name)}"
        error_text = escape(difference_text(trocar.error))
        rows.append(_line(f"RCM error{which_trocar}", error_text, _color_below(trocar.error, _RCM_TOLERANCE)))
        if trocar.depth is not None:
            rows.append(_line(f"insertion depth{which_trocar}", f"{trocar.depth / MM:.3f} mm"))
    if reading.condition is not None:
        color = _WARNING_COLOR if reading.condition > _LARGE_CONDITION else ""
        rows.append(_line("condition number", f"{reading.condition:.1f}", color))
    rows += _singularities(reading)
    if reading.branch:
        rows.append(_line("branch", escape(reading.branch)))
    rows.append(_bars(reading.limits))
    if reading.reason:
        rows.append(f"<div style='color:{_BAD_COLOR};padding-top:.5em' data-reason>{escape(reading.reason)}</div>")
    agrees = "yes" if reading.agrees else "no"
    return f"<div style='font-size:12px;line-height:1.5;padding:0 .8em' data-agrees='{agrees}'>{''.join(rows)}</div>"


def headline(reading: RobotReading) -> str:
    """Return the most important readings as HTML in short lines, for a narrow page, which has no side panel."""
    items = []
    if reading.residual is not None:
        text, color = _agreement(reading, reading.residual)
        items.append(f"<span style='color:{color};font-weight:600'>equations {text}</span>")
    for trocar in reading.trocars:
        if trocar.depth is not None:
            items.append(f"depth {trocar.depth / MM:.1f} mm")
    nearest_limit = _nearest_limit(reading.limits)
    if nearest_limit is not None:
        items.append(nearest_limit)
    lines = "".join(f"<div>{item}</div>" for item in items)
    if reading.reason:
        lines += f"<div style='color:{_BAD_COLOR}'>{escape(reading.reason)}</div>"
    return f"<div class='twin-headline'>{lines}</div>"


def _nearest_limit(limits: Sequence[JointReading]) -> str | None:
    """Return HTML text on the joint that is nearest to a limit, as a part of its range; None without limits."""
    nearest: JointReading | None = None
    smallest_margin = np.inf
    for limit in limits:
        if limit.part is None:
            continue
        margin = min(limit.part, 1 - limit.part)
        if margin < smallest_margin:
            nearest = limit
            smallest_margin = margin
    if nearest is None:
        return None
    distance = min(nearest.value - nearest.low, nearest.high - nearest.value)
    return f"nearest limit: {escape(nearest.joint)}, {max(distance, 0.0):.1f} {nearest.unit} left"


def _agreement(reading: RobotReading, residual: EquationDeviation) -> tuple[str, str]:
    """Return (HTML text, colour) on the agreement of equations and mechanism."""
    if reading.agrees and not reading.comparable:
        return escape(reading.incomparable), _WARNING_COLOR
    text = "DISAGREE"
    color = _BAD_COLOR
    if reading.agrees:
        text = "agree"
        color = _GOOD_COLOR
    if residual.what:
        text += f": {escape(residual_text(residual))} ({escape(residual.what)})"
    return text, color


def _color_below(value: float, limit: float) -> str:
    """Return the colour of a value that must be below a limit; NaN is not below."""
    if value < limit:
        return _GOOD_COLOR
    return _BAD_COLOR


def _singularities(reading: RobotReading) -> list[str]:
    """Return a line on the nearest singularity of each type; the measures are sorted, the nearest is first."""
    lines = []
    for singularity_type, title in (("type1", "type I"), ("type2", "type II")):
        measures = [measure for measure in reading.singular if measure[1] == singularity_type]
        if not measures:
            continue
        name, _, ratio = measures[0]
        color = ""
        if ratio <= 1:
            color = _BAD_COLOR
        elif ratio <= _NEAR_ALARM:
            color = _WARNING_COLOR
        lines.append(_line(f"to {title} singularity", f"{ratio:.2f} × alarm ({escape(name)})", color))
    return lines


def phase_bar(phases: Sequence[tuple[str, float, float]], current: str) -> str:
    """Return the phases as an HTML bar with segments proportional to their durations.

    Args:
        phases: (name, start in s, end in s) of each phase, in order.
        current: name of the phase whose segment is filled.
    """
    duration = phases[-1][2] if phases else 0.0
    if duration == 0.0:
        duration = 1.0  # a bar of no length, instead of a division by 0
    cells = ""
    for name, start, end in phases:
        percent = 100 * (end - start) / duration
        fill = "background:#8882"
        if name == current:
            fill = "background:#1b6ec2;color:#fff"
        cells += (
            f"<span title='{escape(name)}: {start:.2f} to {end:.2f} s' style='flex:0 0 {percent:.2f}%;"
            f"overflow:hidden;text-overflow:ellipsis;white-space:nowrap;padding:1px 3px;box-sizing:border-box;"
            f"border-left:1px solid #8886;{fill}'>{escape(name)}</span>"
        )
    return f"<div style='display:flex;font-size:11px;margin:0 .8em .5em'>{cells}</div>"


def legend(names: Sequence[str], colors: Sequence[str]) -> str:
    """Return the legend of the curves as HTML: a line in the colour of each curve, followed by its name.

    `names` are the names of the curves; if there are more curves than colours, the colours are used again.
    """
    items = ""
    for number, name in enumerate(names):
        color = colors[number % len(colors)]
        items += (
            f"<span style='white-space:nowrap'><span style='display:inline-block;width:1.2em;height:3px;"
            f"margin-right:.3em;vertical-align:middle;background:{color}'></span>{escape(name)}</span>"
        )
    return f"<div style='display:flex;flex-wrap:wrap;gap:.1em .9em;font-size:11px;margin:0 .8em'>{items}</div>"


def _number(name: str, value: float, unit: str) -> str:
    """Return a coordinate as HTML: its name, its value with a constant number of decimals, and its unit."""
    # "z" writes -0.0000 as 0.0000: a rounding error at zero would change its sign all the time
    digits = f"{value:z.3f}" if unit == "mm" else f"{value:z.4f}"
    return f"<span><span style='{_NAME_STYLE}'>{escape(name)}</span> {digits} {unit}</span>"


def _line(name: str, text: str, color: str = "") -> str:
    """Return a line of the panel as HTML; `name` and `text` are HTML already, so texts of files must be escaped."""
    style = f"color:{color};font-weight:600" if color else ""
    return (
        f"<div style='display:flex;justify-content:space-between;gap:1em'>"
        f"<span style='{_NAME_STYLE};white-space:nowrap'>{name}</span>"
        f"<span style='{style};text-align:right'>{text}</span></div>"
    )


def _bars(limits: Sequence[JointReading]) -> str:
    """Return the joints as HTML: name, bar and value; the column of names is as wide as the longest one."""
    rows = "".join(_bar(limit) for limit in limits)
    return (
        "<div style='display:grid;grid-template-columns:fit-content(9em) minmax(4em,1fr) max-content;gap:0 .8em;"
        f"align-items:center'>{rows}</div>"
    )


def _bar(limit: JointReading) -> str:
    """Return the cells of a joint, with its position between its limits; red if `_AT_LIMIT`."""
    name = f"<span style='{_NAME_STYLE};overflow-wrap:anywhere'>{escape(limit.joint)}</span>"
    text = f"{limit.value:z.3f} {limit.unit}"
    value = f"<span style='text-align:right;font-variant-numeric:tabular-nums'>{text}</span>"
    part_of_range = limit.part
    if part_of_range is None:
        return f"{name}<span></span>{value}"
    margin = min(part_of_range, 1 - part_of_range)
    color = _GOOD_COLOR
    if margin < _AT_LIMIT:
        color = _BAD_COLOR
    elif margin < _NEAR_LIMIT:
        color = _WARNING_COLOR
    percent = 100 * np.clip(part_of_range, 0, 1)
    bar = (
        f"<span title='{limit.low:g} .. {limit.high:g} {limit.unit}' style='position:relative;height:6px;"
        f"background:#8884;border-radius:3px'><span style='position:absolute;"
        f"left:calc({percent:.2f}% - 3px);top:-2px;width:6px;height:10px;border-radius:2px;"
        f"background:{color}'></span></span>"
    )
    return f"{name}{bar}{value}"
