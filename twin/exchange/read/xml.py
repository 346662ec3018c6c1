"""Read XML, with errors that name the file and the element."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree

import numpy as np

from twin.core.errors import SourceError
from twin.core.foreign.text import DoctypeError, parse_xml
from twin.core.spatial import Array


class Xml:
    """An XML file. Errors of its methods name the file, the element (`where`) and the value (`what`)."""

    def __init__(self, path: Path, root: str) -> None:
        self.path = path
        try:
            self.root = parse_xml(path)
        except DoctypeError as error:
            raise SourceError(f"{path}: {error}") from error
        except OSError as error:
            raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise SourceError(f"{path}: the file is not XML: {error}") from error
        if self.root.tag != root:
            hint = "Expand a xacro first; a file of another format needs the suffix of its format."
            raise SourceError(f"{path}: the root element is <{self.root.tag}>, expected <{root}>. {hint}")

    def fail(self, where: str, message: str) -> NoReturn:
        """Raise `SourceError` with the file and the element in its message."""
        raise SourceError(f"{self.path}: {where}: {message}")

    def name(self, element: ElementTree.Element, kind: str) -> str:
        """Return the name of an element; raise `SourceError` if the name is missing."""
        name = (element.get("name") or "").strip()
        if not name:
            self.fail(f"<{kind}>", "the name is missing")
        return name

    def named(self, parent: ElementTree.Element, kind: str) -> dict[str, ElementTree.Element]:
        """Return the children of one kind as {name: element}; raise `SourceError` if a name is missing or repeated."""
        out: dict[str, ElementTree.Element] = {}
        for element in parent.findall(kind):
            name = self.name(element, kind)
            if name in out:
                self.fail(f"{kind} '{name}'", "the name is used twice")
            out[name] = element
        return out

    def numbers(self, where: str, what: str, text: str | None, count: int, default: Sequence[float] | None) -> Array:
        """Return `count` finite numbers parsed from a text; the default if the text is None."""
        if text is None:
            if default is None:
                self.fail(where, f"{what} is missing")
            return np.array(default, float)
        try:
            values = np.array([float(t) for t in text.split()])
        except ValueError:
            self.fail(where, f"{what} = '{text[:80]}' is not {count} numbers")
        if len(values) != count or not np.all(np.isfinite(values)):
            self.fail(where, f"{what} = '{text[:80]}' is not {count} finite numbers")
        return values

    def number(self, where: str, what: str, text: str | None, default: float | None = None) -> float:
        """Return one finite number parsed from a text; the default if the text is None."""
        return float(self.numbers(where, what, text, 1, None if default is None else (default,))[0])

    def axis(self, where: str, what: str, text: str | None, default: Sequence[float]) -> Array:
        """Return a direction (3,) parsed from a text; raise `SourceError` if the direction is a zero vector."""
        axis = self.numbers(where, what, text, 3, default)
        if not np.abs(axis).max() > 1e-9:
            self.fail(where, f"{what}: the axis has length 0")
        return axis

    def tensor(self, where: str, text: Callable[[str], str | None], default: Array | None = None) -> Array:
        """Return the inertia tensor (3, 3).

        `text` is a function that returns the text of an entry `ixx`, `ixy`, ..., or None if the entry is missing. A
        missing entry has the value in `default`.
        """
        out = np.zeros((3, 3))
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            key = f"i{'xyz'[i]}{'xyz'[j]}"
            out[i, j] = out[j, i] = self.number(where, key, text(key), None if default is None else default[i, j])
        return out
