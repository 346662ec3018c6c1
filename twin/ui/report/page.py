"""Write a result as a self-contained HTML page: verdict, findings, picture, and the text of the command."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import dedent
from typing import TYPE_CHECKING, Literal

from twin.core.findings import by_severity
from twin.core.result import Line, Part, Result, TextTable
from twin.core.version import __version__
from twin.ui.report.figure_output import svg
from twin.ui.report.page_template import template

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(result: Result, name: str, figure: Figure | None = None) -> str:
    """Return the HTML page of a result; the same result always gives the same text.

    `name` is the name, without suffix, of the JSON file with the data; `figure` is the picture, None: no picture.
    """
    from markupsafe import Markup

    title = result.kind
    first, *parts = merged(result.text())
    if isinstance(first, str):
        # the first line of the text is its title
        title, _, body = first.partition("\n")
        body = body.strip("\n")
        if body.strip():
            parts.insert(0, body)
    picture = None
    if figure is not None:
        picture = Markup(svg(figure, name, title))
    return template("page.html.j2").render(
        result=result,
        title=title,
        judged=result.judges and bool(result.word),
        findings=by_severity(result.findings),
        parts=list(headed(parts)),
        picture=picture,
        version=__version__,
        name=name,
    )


def headed(parts: Sequence[str | TextTable]) -> Iterator[tuple[Literal["heading", "text", "table"], str | TextTable]]:
    """Yield tables, texts and headings as (kind, part); a heading is the last line of a text directly before a table.

    If this line is indented or belongs to a paragraph, it is not a heading.
    """
    followers = [*parts[1:], None]
    for part, follower in zip(parts, followers, strict=True):
        if isinstance(part, TextTable):
            yield "table", part
            continue
        heading = ""
        text = part
        if isinstance(follower, TextTable):
            above, _, last = part.rpartition("\n")
            _, _, line_before = above.rpartition("\n")
            in_paragraph = bool(line_before.strip())
            if last.strip() and not last.startswith(" ") and not in_paragraph:
                heading = last
                text = above
        text = dedent(text).strip("\n")
        if text.strip():
            yield "text", text
        if heading:
            yield "heading", heading


def merged(parts: Iterable[Part]) -> Iterator[str | TextTable]:
    """Yield each table, and all lines between two tables as one block of text; findings are omitted."""
    lines: list[str] = []
    for part in parts:
        if isinstance(part, TextTable):
            yield from _block(lines)
            lines = []
            yield part
        elif isinstance(part, Line):
            lines.append(part.text)
        elif isinstance(part, str):
            lines.append(part)
    yield from _block(lines)


def _block(lines: Sequence[str]) -> Iterator[str]:
    """Yield the lines as one text, if they are not all blank."""
    text = "\n".join(lines).strip("\n")
    if text.strip():
        yield text
