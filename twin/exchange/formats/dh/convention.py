"""Find which of the four conventions a table of Denavit-Hartenberg parameters has, and require its columns."""

from __future__ import annotations

import re

from twin.exchange.formats.dh.cells import Cells
from twin.exchange.formats.dh.headings import TableColumns
from twin.exchange.formats.dh.table_errors import TableErrors

CONVENTIONS = ("standard", "modified", "khalil", "hayati")

_CONVENTION_WORDS = {
    "standard": "standard",
    "classic": "standard",
    "classical": "standard",
    "distal": "standard",
    "dh": "standard",
    "sdh": "standard",
    "modified": "modified",
    "craig": "modified",
    "proximal": "modified",
    "mdh": "modified",
    "khalil": "khalil",
    "khalil-kleinfinger": "khalil",
    "hayati": "hayati",
}
"""{name of a convention: convention}; "dh" and "mdh" are those of MATLAB."""

_NEGATIONS = frozenset({"not", "no", "non", "never", "neither", "nor", "without", "unlike", "isn"})
"""Words that turn a statement of the convention into its contrary: "not modified" says nothing definite."""


def find_convention(cells: Cells, columns: TableColumns, option: str | None, errors: TableErrors) -> str:
    """Return the convention that the user (`option`), a key or the headings state; none is assumed.

    Raises:
        SourceError: none or several are stated, or an unknown one.
    """
    statements: dict[str, str] = {}
    if option:
        statements["--dh"] = option
    if stated := cells.stated.get("convention"):
        words = re.sub(r"[^a-z-]+", " ", stated.lower()).split()
        names: set[str] = set()
        for word in words:
            if word in _CONVENTION_WORDS:
                names.add(_CONVENTION_WORDS[word])
        if not _NEGATIONS.isdisjoint(words):
            names = set()
        # "modified DH": the word beside "DH" says which
        if len(names) > 1 and "standard" not in words:
            names.discard("standard")
        if len(names) != 1:
            choice = ", ".join(CONVENTIONS)
            errors.fail(cells.line, f"there is no convention '{stated}'; use one of {choice}")
        statements["the key `convention`"] = names.pop()
    if {"a", "alpha"} <= columns.previous_index:
        statements["the index i-1 of a and alpha"] = "modified"
    if {"gamma", "b", "r"} <= set(columns.headings):
        statements["the columns gamma, b and r"] = "khalil"
    if "beta" in columns.headings:
        statements["the column beta"] = "hayati"
    headings = " ".join(filter(None, cells.headings))
    if re.fullmatch("θⱼ dⱼ aⱼ [⍺α]ⱼ.*", headings):
        statements["the headings of the Robotics Toolbox"] = "standard"
    if "kind" in columns.headings:
        for row in cells.rows:
            name = row.cells[columns.headings["kind"]].lower()
            if name.endswith("mdh"):
                statements[f"the kind '{name}'"] = "modified"
            elif name.endswith("dh"):
                statements[f"the kind '{name}'"] = "standard"
    if len(set(statements.values())) > 1:
        contradiction = " and ".join(f"{place} says {convention}" for place, convention in statements.items())
        errors.fail(cells.line, f"the convention is contradictory: {contradiction}")
    if not statements:
        headings = " | ".join(cells.headings)
        text = (
            f"the headings ({headings}) do not say which convention the table has, and the robots would differ: "
            "state it by --dh standard (distal, Denavit-Hartenberg), --dh modified (proximal, Craig), --dh khalil "
            "or --dh hayati"
        )
        errors.refuse(cells.line, text)
    return next(iter(statements.values()))


def require_columns(cells: Cells, columns: TableColumns, convention: str, errors: TableErrors) -> None:
    """Require the columns of a convention, and no others. The column r of a table without a is renamed a.

    Raises:
        SourceError: a column is missing, or is none of the convention.
    """
    needed = {"a", "alpha", "theta", "d"}
    optional = {"joint", "offset", "kind", "lower", "upper"}
    if convention == "khalil":
        needed = {"alpha", "theta", "d", "r"}
        optional |= {"gamma", "b", "antecedent", "mu"}
    elif convention == "hayati":
        optional.add("beta")
    if convention != "khalil" and "a" not in columns.headings and "r" in columns.headings:
        columns.headings["a"] = columns.headings.pop("r")  # some texts call the length r
        if "r" in columns.units:
            columns.units["a"] = columns.units.pop("r")
    missing = sorted(needed - set(columns.headings))
    if missing:
        headings = " | ".join(cells.headings)
        text = f"the {convention} convention needs the columns {', '.join(missing)}, but the headings are {headings}"
        errors.fail(cells.line, text)
    for column in columns.headings:
        if column not in needed | optional:
            text = f"the {convention} convention has no column '{columns.headings[column]}': remove it"
            errors.fail(cells.line, text)
