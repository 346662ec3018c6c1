"""Convert figures to PNG and SVG without timestamps, and to data for the values that a page shows under the pointer."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import numpy as np

from twin.core.json_types import JsonObject
from twin.ui.report.style import BAND, FIT, GRID, INK, NEAR, UNFIT, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PNG_DPI = 120


def png(figure: Figure) -> bytes:
    """Return a figure as PNG with white background; the same figure always gives the same bytes."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(
            buffer,
            format="png",
            dpi=_PNG_DPI,
            facecolor="white",
            metadata={"Software": None},
            pil_kwargs={"compress_level": 2},
        )
    return buffer.getvalue()


def hover_data(figure: Figure, name: str) -> list[JsonObject]:
    """Return the places and scales of a figure's time plots, for the script that shows values under the pointer.

    Call it before `svg` with the same name: it names the curves. Each entry has the box in units of the SVG (left, top,
    right, bottom), the limits of x and y, whether y is logarithmic, and the curves with their ids.
    """
    wide, tall = (72.0 * float(inches) for inches in figure.get_size_inches())
    if not any(ax.get_xlabel() == "time [s]" for ax in figure.axes):
        return []
    entries: list[JsonObject] = []
    number = 0
    for ax in figure.axes:
        curves: list[JsonObject] = []
        for line in ax.lines:
            label = str(line.get_label())
            if label.startswith("_") or np.size(line.get_xdata()) < 3:
                continue
            line.set_gid(f"curve{number}")
            curves.append({"id": f"{name}-curve{number}", "name": label})
            number += 1
        if not curves:
            continue
        place = ax.get_position()
        box = [place.x0 * wide, (1 - place.y1) * tall, place.x1 * wide, (1 - place.y0) * tall]
        entry: JsonObject = {
            "box": [round(v, 2) for v in box],
            "x": [float(v) for v in ax.get_xlim()],
            "y": [float(v) for v in ax.get_ylim()],
            "log": ax.get_yscale() == "log",
            "curves": curves,
        }
        entries.append(entry)
    return entries


def svg(figure: Figure, name: str, label: str) -> str:
    """Return a figure as an SVG element for a page, without size and timestamps, in the colours of the page.

    `name` is the prefix of the ids in the element and must be unique in the page; `label` is the alternative text.
    """
    from markupsafe import escape

    buffer = io.StringIO()
    no_metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    with styled(name):
        figure.savefig(buffer, format="svg", metadata=no_metadata)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    # of the element, only its view box is kept: width and height are those of the page
    view_box = re.search(r'viewBox="[^"]*"', text)
    box = view_box[0] if view_box else ""
    text = text[text.index(">") + 1 :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    text = text.replace("xlink:href", "href")
    text = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", text)
    for color, variable in ((INK, "--ink"), (GRID, "--grid"), (BAND, "--band")):
        text = text.replace(color, f"var({variable})")
    # words in the colours of a verdict, which are too dark for a dark page; surfaces with such colours have white text
    for color, variable in ((FIT, "--good"), (UNFIT, "--bad"), (NEAR, "--near")):
        text = re.sub(rf'(<text style="[^"]*fill: ){color}', rf"\g<1>var({variable})", text)
    return f'<svg {box} role="img" aria-label="{escape(label)}">{text}'
