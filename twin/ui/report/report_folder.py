"""Write a report into a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

from twin.core.errors import OutputError, unknown
from twin.core.result import Result
from twin.ui.report.figure_output import png
from twin.ui.report.html import render_html
from twin.ui.report.robot_picture import RobotPicture
from twin.ui.report.style import drawable
from twin.validation.result import Report

FORMATS = ("html", "json", "png")
"""Formats that `write_report` can write."""


def _picture(robot: Callable[[], RobotPicture | None] | None) -> tuple[RobotPicture | None, str]:
    """Return (picture of the robot, why there is none); the verdict is written also if the picture cannot be drawn."""
    if robot is None:
        return None, ""
    try:
        picture = robot()
        if picture is not None:
            # the page uses both; they are drawn here, so that an error is one of the picture
            _ = picture.data, picture.png
    except Exception as error:  # meshes of a user can be anything
        return None, f"{type(error).__name__}: {error}"
    return picture, ""


def write_report(
    report: Report,
    folder: Path,
    formats: Iterable[str] = FORMATS,
    robot: Callable[[], RobotPicture | None] | None = None,
) -> dict[str, Path]:
    """Write a report into a folder in the given formats: report.html, report.json and plots/*.png.

    Without matplotlib, there are no plots, and the page says so.
    For an atomic write, use `twin.core.assets.atomic_folder`.

    Args:
        report: the report.
        folder: folder of the files.
        formats: names out of `FORMATS`.
        robot: function that returns the picture of the robot for the top of the page; None: no picture.

    Returns:
        Paths of the written files, with the keys "html", "json" and "plots/<name>".

    Raises:
        OutputError: an entry of `formats` is not one of `FORMATS`.
    """
    formats = set(formats)
    for wrong in sorted(formats - set(FORMATS)):
        raise OutputError(unknown("report format", wrong, FORMATS))
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: dict[str, Path] = {}
    figures = {}
    if formats & {"html", "png"} and drawable():
        from twin.ui.report import plots

        figures = plots.figures(report)
    # bytes, because text would get other line ends on Windows
    if "html" in formats:
        picture, missing = _picture(robot)
        page = render_html(report, figures, picture, missing)
        path = folder / "report.html"
        path.write_bytes(page.encode())
        written["html"] = path
    if "json" in formats:
        text = report.to_json() + "\n"
        path = folder / "report.json"
        path.write_bytes(text.encode())
        written["json"] = path
    if "png" in formats and figures:
        plots_folder = folder / "plots"
        plots_folder.mkdir(exist_ok=True)
        for name, figure in figures.items():
            path = plots_folder / f"{name}.png"
            path.write_bytes(png(figure))
            written[f"plots/{name}"] = path
    return written


_KINDS_WITH_PICTURE = (
    "compare",
    "console",
    "hazards",
    "operate",
    "procedure",
    "prove",
    "prove-workspace",
    "scene",
    "session",
    "stroke",
    "study",
    "sweep",
    "tolerance",
    "track",
    "trends",
    "workspace",
)
"""Kinds of results with a picture; the picture is drawn by `figure(result)` of the module <kind>_figures."""


def write_result(result: Result, folder: Path, name: str = "") -> list[str]:
    """Write a result into a folder: <name>.json, <name>.html, the result's data files, and for some kinds <name>.png.

    `name` is the file name without suffix; "": the kind of the result. For an atomic write, use
    `twin.core.assets.atomic_folder`.

    Returns:
        Names of the page and, if there is one, of the picture.
    """
    from twin.ui.report.page import render

    name = name or result.kind
    data = folder / f"{name}.json"
    data.write_text(result.to_json() + "\n", encoding="utf-8")
    result.write(folder)
    page = folder / f"{name}.html"
    written = [page.name]
    figure = None
    if result.kind in _KINDS_WITH_PICTURE and drawable():
        module = import_module(f"twin.ui.report.{result.kind.replace('-', '_')}_figures")
        figure = module.figure(result)  # None if there is nothing to draw
    if figure is not None:
        picture = folder / f"{name}.png"
        picture.write_bytes(png(figure))
        written.append(picture.name)
    page.write_text(render(result, name, figure), encoding="utf-8")
    return written
