"""What the tree finds by itself stands in no literal list: formats, robots, kinds of tasks."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import twin
from twin.exchange import formats as registry
from twin.model import task as tasks

ROOT = Path(__file__).parents[2]
FORMATS = ROOT / "twin/exchange/formats"
# The suffixes of the formats that several parsers share stand in one place, below all rooms.
SHARED_SUFFIXES = ROOT / "twin/core/foreign/budget.py"


@cache
def names_of() -> dict[str, set[str]]:
    """Return {kind of list: the names that the tree finds by itself}."""
    formats = {format.name for format in registry.formats()}
    suffixes = {suffix for format in registry.formats() for suffix in format.sources}
    for format in registry.formats():
        formats |= {variant.name for variant in format.variants}
        suffixes |= {variant.suffix for variant in format.variants}
    kinds = {kind.name for kind in tasks.kinds()}
    return {"formats": formats, "suffixes": suffixes, "tasks": kinds, "robots": set(twin.names())}


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def quoted(path: Path, kind: str) -> list[str]:
    """Return the names of a kind that a file has between quotation marks."""
    text = text_of(path)
    return [name for name in names_of()[kind] if f'"{name}"' in text or f"'{name}'" in text]


@cache
def collections(path: Path) -> tuple[tuple[int, bool, frozenset[str]], ...]:
    """Return (line, whether it is a dictionary, its texts or keys) of each literal collection of a file."""
    found = []
    for node in ast.walk(ast.parse(text_of(path))):
        entries: list[ast.expr | None] = []
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            entries = list(node.elts)
        elif isinstance(node, ast.Dict):
            entries = list(node.keys)
        texts = {e.value for e in entries if isinstance(e, ast.Constant) and isinstance(e.value, str)}
        if len(texts) > 1:
            found.append((node.lineno, isinstance(node, ast.Dict), frozenset(texts)))
    return tuple(found)


def literal_lists(files: list[Path], kind: str, most: float) -> list[str]:
    """Return the places of literal lists with more than `most` names of a kind."""
    found = []
    for path in files:
        if len(quoted(path, kind)) <= most:
            continue  # to parse all files takes seconds
        for line, dictionary, texts in collections(path):
            if dictionary and kind == "suffixes":
                continue  # a table of what a parser does with each suffix
            if len(texts & names_of()[kind]) > most:
                found.append(f"{path}:{line}: {sorted(texts)}")
    return found


def comparisons(path: Path, kind: str) -> Iterator[str]:
    """Yield the places where a file compares something with a name of a kind."""
    if not quoted(path, kind):
        return
    for node in ast.walk(ast.parse(text_of(path))):
        if isinstance(node, ast.Compare):
            values = [e.value for e in (node.left, *node.comparators) if isinstance(e, ast.Constant)]
            if any(isinstance(value, str) and value in names_of()[kind] for value in values):
                yield f"{path}:{node.lineno}"


def sources(*folders: str) -> list[Path]:
    """Return the Python files of folders, without data."""
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return [path for path in files if not {"_data", "data", "__pycache__"} & set(path.parts) and path != Path(__file__)]


def test_no_source_chooses_by_a_list_of_formats():
    checked = [ROOT / "tests/made/bundle.py"]
    for path in sources("twin"):
        inside = path.is_relative_to(FORMATS) and path.parent != FORMATS
        if not inside and path != SHARED_SUFFIXES:
            checked.append(path)
    assert literal_lists(checked, "formats", 1) == []
    assert literal_lists(checked, "suffixes", 1) == []
    compared = [path for path in checked if path.is_relative_to(ROOT / "twin/exchange")]
    assert [place for path in compared for place in comparisons(path, "formats")] == []


def test_no_source_chooses_by_a_list_of_tasks():
    assert literal_lists(sources("twin", "docs"), "tasks", 1) == []


@pytest.mark.parametrize("kind", ["formats", "tasks", "robots"])
def test_tests_and_documents_repeat_no_list(kind):
    """A test may choose a few for a sample; two thirds of all are a list that a new one would be missing in."""
    most = len(names_of()[kind]) * 2 / 3
    assert literal_lists(sources("twin", "tests", "docs", "cad"), kind, most) == []


@pytest.mark.parametrize("kind", ["formats", "tasks", "robots"])
def test_pages_repeat_no_list(kind):
    most = len(names_of()[kind]) * 2 / 3
    found = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
            if len(set(re.findall(r"\w+", line)) & names_of()[kind]) > most:
                found.append(f"{page.name}:{number}: {line}")
    assert found == []


def test_literal_lists_are_found(tmp_path):
    path = tmp_path / "literal.py"
    path.write_text(
        'a = ("glb", "urdf")\nb = {"usd": 1, "mjcf": 2}\nc = a == "tracks"\nd = (".usda", ".usdz")\n'
        'e = ("guide", "align")\nf = {"target": 1, "transfer": 2}\ng = ["procedure"]\n'
    )

    def lines(kind):
        return [int(place.split(":")[1]) for place in literal_lists([path], kind, 1)]

    assert lines("formats") == [1, 2]
    assert lines("suffixes") == [4]
    assert lines("tasks") == [5, 6]
    assert [place.split(":")[1] for place in comparisons(path, "formats")] == ["3"]
