"""Write a result as a self-contained HTML page: verdict, findings, picture, and the text of the command."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import dedent
from typing import TYPE_CHECKING, Literal

from twin.core.findings import Finding, by_severity
from twin.core.result import Line, Part, Result, Table
from twin.core.version import __version__
from twin.ui.report import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render(result: Result, name: str, figure: Figure | None = None) -> str:
    """Return the HTML page of a result; the same result always gives the same text.

    `name` is the name, without suffix, of the JSON file with the data; `figure` is the picture, None: no picture.
    """
    from markupsafe import Markup

    title, *parts = merged(result.text())
    title, _, rest = title.partition("\n") if isinstance(title, str) else (result.kind, "", "")
    return style.template("page.html.j2").render(
        result=result,
        title=title,
        judged=result.judges and bool(result.word),
        findings=by_severity(result.findings),
        parts=list(headed([*([rest.strip("\n")] if rest.strip() else []), *parts])),
        picture=None if figure is None else Markup(style.svg(figure, name, title)),
        version=__version__,
        name=name,
    )


def headed(parts: Sequence[str | Table]) -> Iterator[tuple[Literal["heading", "text", "table"], str | Table]]:
    """Yield tables, texts and headings as (kind, part); a heading is the last line of a text directly before a table.

    If this line is indented or belongs to a paragraph, it is not a heading.
    """
    for part, after in zip(parts, [*parts[1:], None], strict=True):
        if isinstance(part, Table):
            yield "table", part
            continue
        above, _, last = part.rpartition("\n")
        titles = isinstance(after, Table) and bool(last.strip()) and not last.startswith(" ")
        titles = titles and not above.rpartition("\n")[2].strip()  # else the line belongs to a paragraph
        text = dedent(above if titles else part).strip("\n")
        if text.strip():
            yield "text", text
        if titles:
            yield "heading", last


def merged(parts: Iterable[Part]) -> Iterator[str | Table]:
    """Yield each table, and all lines between two tables as one block of text; findings are omitted."""
    block: list[str] = []
    for part in parts:
        if isinstance(part, Table):
            if "\n".join(block).strip():
                yield "\n".join(block).strip("\n")
            block = []
            yield part
        elif not isinstance(part, Finding):
            block.append(part.text if isinstance(part, Line) else part)
    if "\n".join(block).strip():
        yield "\n".join(block).strip("\n")
