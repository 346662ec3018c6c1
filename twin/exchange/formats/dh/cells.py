"""Find the table in a CSV, Markdown, LaTeX or TOML file: headings and cells, with their lines.

A table that the Robotics Toolbox prints, with lines of box characters, is read as Markdown.
"""

from __future__ import annotations

import csv
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from twin.core.errors import NoMechanismError, SourceError
from twin.core.foreign.text import check_depth, read_text

_FEWEST_COLUMNS = 3
"""Columns from which a table of a text can be one of parameters; smaller ones state something else."""

ROWS = 100
"""Maximum number of rows of a table."""

_COMMENT = re.compile(r"^\s*(?:[#%>]|//|<!--)*\s*(convention|units?)\s*[:=]\s*(.*?)\s*(?:-->)?\s*$", re.IGNORECASE)
"""A line outside the table that states the convention or the units."""


@dataclass(frozen=True)
class TableRow:
    """A row of a table: {heading: text of the cell}, and the line of the file where it is."""

    line: int
    cells: dict[str, str]


@dataclass
class Cells:
    """A table as texts.

    Attributes:
        headings: texts of the headings, in their order.
        line: line of the headings.
        rows: the rows.
        stated: what lines outside the table or keys state: "convention", "units".
        fault: fault of the rows, a sentence; "" without a fault.
    """

    headings: list[str]
    line: int
    rows: list[TableRow] = field(default_factory=list)
    stated: dict[str, str] = field(default_factory=dict)
    fault: str = ""


def read_cells(path: Path) -> Cells:
    """Return the table of a file; its `fault` is told by the reader of the headings, since other tables have others.

    Raises:
        SourceError: the file has no table.
        BudgetError: the file is too large.
    """
    suffix = path.suffix.lower()
    kind = "TOML" if suffix == ".toml" else "text"
    try:
        text = read_text(path, kind, encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except UnicodeDecodeError as error:
        raise NoMechanismError(
            f"{path}: the file is not text in UTF-8: {error.reason} at byte {error.start}"
        ) from error
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
    if suffix == ".toml":
        return _cells_of_toml(path, text)
    if suffix == ".tex":
        lines = _lines_of_latex(text)
    elif suffix == ".md":
        lines = _lines_of_markdown(text)
    else:
        lines = _lines_of_csv(path, text)
    if not lines:
        raise NoMechanismError(f"{path}: the file has no table: a line of headings, then a line for each joint")
    (line, headings), *row_lines = lines
    cells = Cells(headings, line, stated=_statements_beside_table(text))
    for line, row in row_lines:
        if len(row) != len(headings) and not cells.fault:
            cells.fault = (
                f"{path}:{line}: the row has {len(row)} cells ({' | '.join(row)[:80]}), but there are {len(headings)} "
                f"headings ({' | '.join(headings)[:120]}): write all cells"
            )
        # Not strict: the fault of the row is told only once the headings show that this is a table of parameters.
        cells.rows.append(TableRow(line, dict(zip(headings, row, strict=False))))
    return _with_checked_count(path, cells)


def _with_checked_count(path: Path, cells: Cells) -> Cells:
    if not cells.rows:
        cells.fault = f"{path}:{cells.line}: the table has no rows: write one for each joint"
    if len(cells.rows) > ROWS:
        cells.fault = f"{path}: the table has {len(cells.rows)} rows; the limit is {ROWS}"
    return cells


def _statements_beside_table(text: str) -> dict[str, str]:
    stated: dict[str, str] = {}
    for line in text.splitlines():
        match = _COMMENT.match(line)
        if match:
            key = match[1].lower().rstrip("s")
            stated[key.replace("unit", "units")] = match[2]
    return stated


def _lines_of_csv(path: Path, text: str) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of the lines that are neither empty nor comments."""
    table_lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        # "#" alone in the first cell of the first line is the heading of the joints' numbers
        numbers = not table_lines and re.match(r"\s*#\s*[,;\t]", line)
        if line.strip() and (numbers or not line.lstrip().startswith("#")):
            table_lines.append((number, line))
    if not table_lines:
        return []
    separator = _separator(table_lines[0][1])
    lines: list[tuple[int, list[str]]] = []
    for number, line in table_lines:
        if separator:
            try:
                cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
            except csv.Error as error:
                raise SourceError(f"{path}:{number}: the line is not CSV: {error}") from error
        else:
            cells = line.split()
        lines.append((number, [cell.strip() for cell in cells]))
    return lines


def _separator(headings: str) -> str:
    # A comma last: in lines with another separator, it may be the decimal sign.
    for separator in ("\t", ";", ","):
        if separator in headings:
            return separator
    return ""


_TITLE = re.compile(r"#{1,6}\s+[^|\s]")
"""The beginning of a title in Markdown: it is no row, even with signs | in it."""


def _lines_of_markdown(text: str) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of the first table with at least three columns; lines of rules and titles are left out."""
    lines: list[tuple[int, list[str]]] = []
    after_rule = False
    for number, line in enumerate(text.splitlines(), 1):
        bare = re.sub("[│┃║|]", "|", line.strip())
        if _TITLE.match(bare):
            if lines:
                break
            continue
        cells = [cell.strip() for cell in bare.strip("|").split("|")]
        # Below the headings, single dashes are the rule of the table; further down they are cells.
        has_words = re.search(r"[^\W_]", bare) is not None
        is_row_of_dashes = after_rule and len(lines) >= 1 and all(re.fullmatch("[-–—−]", cell) for cell in cells)
        if lines and "|" in bare and not has_words:
            after_rule = True
        if "|" in bare and (is_row_of_dashes or has_words):
            if lines or len(cells) >= _FEWEST_COLUMNS:
                lines.append((number, cells))
        elif lines and not re.search("[-=─━═]", bare):
            break
    return lines


_ENVIRONMENT = re.compile(r"\\begin\{(tabular\*?|tabularx|longtable|array|[bp]?matrix)\}(.*?)\\end\{\1\}", re.DOTALL)
_RULES = re.compile(
    r"\\(hline|toprule|midrule|bottomrule|endhead|endfirsthead|cline\{[^}]*\}|cmidrule(\([^)]*\))?\{[^}]*\})"
)


def _lines_of_latex(text: str) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of the rows of the first table with at least three columns."""
    # Comments of LaTeX begin with %, but \% is a sign of the text; the line ends stay, for the numbers of lines.
    text = re.sub(r"(?<!\\)%.*", "", text)
    for match in _ENVIRONMENT.finditer(text):
        line = text.count("\n", 0, match.start(2)) + 1
        rows: list[tuple[int, list[str]]] = []
        body = match[2]
        # Matrices of amsmath have no argument: braces behind their name belong to the first cell.
        if match[1] not in ("bmatrix", "pmatrix", "matrix"):
            body = _without_arguments(body)
            line += match[2].count("\n") - body.count("\n")
        for part in re.split(r"\\\\(?:\[[^\]]*\])?|\\tabularnewline", body):
            bare = _RULES.sub(" ", part)
            if "&" in bare:
                before = bare[: len(bare) - len(bare.lstrip())]
                cells = [cell.strip() for cell in bare.split("&")]
                rows.append((line + before.count("\n"), cells))
            line += part.count("\n")
        if rows and len(rows[0][1]) >= _FEWEST_COLUMNS:
            return rows
    return []


def _without_arguments(body: str) -> str:
    """Return the content of an environment without the arguments behind its name, such as {|c|c|}."""
    while True:
        bare = body.lstrip()
        if not bare.startswith(("{", "[")):
            return body
        depth = 0
        for index, character in enumerate(bare):
            if character in "{[":
                depth += 1
            elif character in "}]":
                depth -= 1
            if depth == 0:
                body = bare[index + 1 :]
                break
        else:
            return body


def _cells_of_toml(path: Path, text: str) -> Cells:
    """Return the rows `[[joint]]` of a TOML file; its other keys are `convention` and `units`."""
    check_depth(path, "TOML", text)
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise NoMechanismError(f"{path}: the file is not TOML: {error}") from error
    lines = text.splitlines()
    stated: dict[str, str] = {}
    rows = data.pop("joint", None)
    for key, value in data.items():
        if key not in ("convention", "units", "name", "source") or not isinstance(value, str):
            line = _line_of(lines, 0, key)
            raise NoMechanismError(
                f"{path}:{line}: there is no key '{key}' with the value {str(value)[:60]!r}; the keys are convention, "
                "units, name, source (texts) and [[joint]], a table for each row"
            )
        stated[key] = value
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise NoMechanismError(f"{path}: the file has no [[joint]]: write a table [[joint]] for each row")
    row_starts = [number for number, line in enumerate(lines, 1) if re.match(r"\s*\[\[\s*joint\s*\]\]", line)]
    headings: list[str] = []
    # TOML has several ways to write a table; a row whose line is not found gets the first line.
    first_line = row_starts[0] if row_starts else 1
    cells = Cells(headings, first_line, stated=stated)
    for index, row in enumerate(rows):
        line = row_starts[index] if index < len(row_starts) else 1
        for key, value in row.items():
            # bool is a kind of int in Python: `true` would be read as 1.
            if isinstance(value, bool) or not isinstance(value, str | int | float):
                where = _line_of(lines, line, key)
                raise SourceError(f"{path}:{where}: {key} = {str(value)[:60]} is not a number or a text")
            if key not in headings:
                headings.append(key)
        texts = dict(zip(row, map(str, row.values()), strict=True))
        cells.rows.append(TableRow(line, texts))
    for row in cells.rows:
        for heading in headings:
            if heading not in row.cells:
                raise SourceError(
                    f"{path}:{row.line}: this [[joint]] has no {heading}, but another has: write all keys"
                )
    return _with_checked_count(path, cells)


def _line_of(lines: list[str], after: int, key: str) -> int:
    for number, line in enumerate(lines[after:], after + 1):
        if re.match(rf"""\s*["']?{re.escape(key)}["']?\s*=""", line):
            return number
    return after or 1
