"""Writing a report into a folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from twin.core.errors import OutputError, unknown
from twin.ui.report.html import render_html
from twin.validation.result import Report

FORMATS = ("html", "json", "png")
"""What `write_report` can write."""


def write_report(report: Report, folder: Path, formats: Iterable[str] = FORMATS) -> dict[str, Path]:
    """Write report.html, report.json and plots/*.png.

    Args:
        report: what to write.
        folder: an existing or new folder; the caller makes it atomic (`twin.core.assets.atomic_folder`).
        formats: any of `FORMATS`.

    Returns:
        The written files: "html", "json" and "plots/<name>".

    Raises:
        OutputError: if a format does not exist.
    """
    formats = set(formats)
    for wrong in sorted(formats - set(FORMATS)):
        raise OutputError(unknown("report format", wrong, FORMATS))
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    out: dict[str, Path] = {}
    figures = {}
    if formats & {"html", "png"}:
        from twin.ui.report import plots

        figures = plots.figures(report)
    if "html" in formats:
        out["html"] = folder / "report.html"
        out["html"].write_bytes(render_html(report, figures).encode())
    if "json" in formats:
        out["json"] = folder / "report.json"
        out["json"].write_bytes((report.to_json() + "\n").encode())
    if "png" in formats and figures:
        from twin.ui.report.style import png

        (folder / "plots").mkdir(exist_ok=True)
        for name, figure in figures.items():
            path = out[f"plots/{name}"] = folder / "plots" / f"{name}.png"
            path.write_bytes(png(figure))
    return out
