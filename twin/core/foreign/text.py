"""Read text, JSON and XML within the limits of their formats."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from twin.core.foreign.budget import BODIES, BUDGETS, over, read_bytes
from twin.core.foreign.once import Read


def read_text(path: Path, kind: str, encoding: str = "utf-8", errors: str = "strict", read: Read = read_bytes) -> str:
    """Return the text of a file, decoded from the bytes that `read` returns, with line ends as in `Path.read_text`.

    Raises:
        BudgetError: the file is too large.
        OSError, UnicodeDecodeError: the file cannot be read.
    """
    data = read(path, kind)
    if kind == "JSON":
        count_json(path, data)
    text = data.decode(encoding, errors)
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def load_json(path: Path) -> Any:
    """Return the content of a JSON file as Python objects.

    Raises:
        BudgetError: the file is too large, or has too many objects and lists.
        OSError, ValueError, RecursionError: the file cannot be read, or is not valid JSON.
    """
    return parse_json(path, read_bytes(path, "JSON"))


def parse_json(path: Path, data: bytes) -> Any:
    """Return JSON text as Python objects, with the errors of `load_json`; error messages name the file `path`."""
    count_json(path, data)
    return json.loads(data.decode())


def count_json(path: Path, data: bytes) -> None:
    """Raise `BudgetError` if JSON has too many objects and lists: these take fifty times the memory of their text."""
    count = data.count(b"{") + data.count(b"[")
    if count > BUDGETS["JSON"].count:
        over(path, "JSON", "objects and lists", count, BUDGETS["JSON"].count)


class DoctypeError(ValueError):
    """The XML declares a document type, whose entities could expand without limit."""


class _CountingBuilder(ElementTree.TreeBuilder):
    """Tree builder that counts decoded elements while parsing."""

    def __init__(self, path: Path, kind: str) -> None:
        super().__init__()
        self._path = path
        self._kind = kind
        self._budget = BUDGETS[kind]
        self._depth = 0
        self._count = 0
        self._count_of_tag = dict.fromkeys(("joint", "link", "body", "visual", "collision"), 0)

    def start(self, tag: str, attrs: dict[str, str]) -> ElementTree.Element:
        """Count an element; raise `BudgetError` if there are too many, or if it is nested too deeply."""
        self._depth += 1
        self._count += 1
        if self._depth > self._budget.depth:
            over(self._path, self._kind, "depth of the elements so far", self._depth, self._budget.depth)
        if self._count > self._budget.count:
            over(self._path, self._kind, "elements so far", self._count, self._budget.count)
        if tag in self._count_of_tag:
            self._count_of_tag[tag] += 1
            if self._count_of_tag[tag] > BODIES:
                over(self._path, self._kind, f"<{tag}> so far", self._count_of_tag[tag], BODIES)
        return super().start(tag, attrs)

    def end(self, tag: str) -> ElementTree.Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise DoctypeError("the file declares a document type or entities; expand the entities first")


def parse_xml(path: Path, data: bytes | None = None, kind: str = "XML") -> ElementTree.Element:
    """Return the root element of XML in any encoding.

    If `data` is None, the file `path` is read; error messages name this file. `kind` is the format whose limits apply.

    Raises:
        BudgetError: the file is too large, nested too deeply, or has too many elements.
        DoctypeError: the file declares a document type.
        OSError, ElementTree.ParseError, LookupError, ValueError: the file cannot be read.
    """
    parser = ElementTree.XMLParser(target=_CountingBuilder(path, kind))
    parser.feed(read_bytes(path, kind) if data is None else data)
    return parser.close()


_QUOTED_OR_COMMENT = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'(?:\\.|[^\\])*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)


def check_depth(path: Path, kind: str, text: str) -> None:
    """Raise `BudgetError` if brackets or dotted names, outside quotes and comments, are nested too deeply."""
    limit = BUDGETS[kind].depth
    text = _QUOTED_OR_COMMENT.sub("", text)
    if kind == "TOML":
        dots = [part.count(".") for part in re.split(r"[=\n,{}\[\]]", text)]
        if max(dots) > limit:
            over(path, kind, "depth of the dotted names", max(dots), limit)
    depth = 0
    deepest = 0
    for bracket in re.findall(r"[{\[(]|[}\])]", text):
        if bracket in "{[(":
            depth += 1
            deepest = max(deepest, depth)
        else:
            depth -= 1
    if deepest > limit:
        over(path, kind, "depth of the brackets", deepest, limit)
