"""Find the line of each table, key and list element in TOML text.

tomllib does not report positions. The scanner parses only the grammar needed for positions.
"""

from __future__ import annotations

import bisect
import contextlib
import re
import tomllib

Key = str | int
Keys = tuple[Key, ...]
"""Path to a value: table keys and list indices."""


def spell(keys: Keys) -> str:
    """Return keys in TOML-like notation, such as phases[2].depth_mm."""
    text = ""
    for key in keys:
        if isinstance(key, int):
            text += f"[{key}]"
        elif text:
            text += f".{key}"
        else:
            text = key
    return text or "the file"


def nearest_line(lines: dict[Keys, int], keys: Keys) -> int:
    """Return the line number of the value at `keys` or, if there is none, of the innermost table or list around it."""
    while keys and keys not in lines:
        keys = keys[:-1]
    return lines.get(keys, 1)


def key_lines(text: str) -> dict[Keys, int]:
    """Return {keys: line number, from 1} of each table, key and list element in valid TOML text."""
    return _Scanner(text).lines


class _Lost(Exception):  # noqa: N818 - not used outside this file
    pass


class _Scanner:
    """A scan of a text from its begin to its end.

    Attributes:
        text: the text.
        i: index of the character that is read next.
        lines: the lines found so far, see `key_lines`.
        ends: indices of the ends of lines.
    """

    _SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
    _NAME = re.compile(r"""\s*("(?:\\.|[^"\\])*"|'[^']*'|[A-Za-z0-9_-]+)\s*""")
    _TEXT = re.compile(r'''"""(?:\\.|[^\\])*?"{3,5}|\'{3}.*?\'{3,5}|"(?:\\.|[^"\\])*"|'[^']*\'''', re.DOTALL)
    _BARE = re.compile(r"[^,\]}#\n]*")

    def __init__(self, text: str) -> None:
        self.text = text
        self.i = 0
        self.lines: dict[Keys, int] = {}
        self.ends = [newline.start() for newline in re.finditer("\n", text)]
        self.sizes: dict[Keys, int] = {}  # number of elements found in each [[list of tables]]
        table: Keys = ()
        with contextlib.suppress(_Lost):
            while self.skip() < len(text):
                if text[self.i] == "[":
                    table = self.header()
                else:
                    self.pair(table)

    def skip(self) -> int:
        """Skip spaces and comments; return the index behind them."""
        self.i = self.match(self._SPACE).end()
        return self.i

    def match(self, pattern: re.Pattern[str]) -> re.Match[str]:
        """Return the match of a pattern at the present place."""
        match = pattern.match(self.text, self.i)
        if match is None:  # cannot happen for valid TOML; the positions found so far are used
            raise _Lost
        return match

    def note(self, keys: Keys) -> None:
        """Take the present line for some keys, if they have none yet."""
        self.lines.setdefault(keys, bisect.bisect_left(self.ends, self.i) + 1)

    def name(self) -> Keys:
        """Read the keys of a name with dots."""
        names: list[Key] = []
        while True:
            match = self.match(self._NAME)
            self.i = match.end()
            raw = match[1]
            if raw[0] == '"':  # with escapes, which tomllib resolves
                (name,) = tomllib.loads(f"{raw}=0")
            else:
                name = raw.strip("'")
            names.append(name)
            if self.text[self.i : self.i + 1] != ".":
                return tuple(names)
            self.i += 1

    def header(self) -> Keys:
        """Read the header of a table or of an element of a list of tables; return its keys."""
        start = self.i
        is_list = self.text.startswith("[[", start)
        brackets = 2 if is_list else 1
        self.i += brackets
        table: Keys = ()
        names = self.name()
        for depth, key in enumerate(names):
            table = (*table, key)
            # only the last name of [[a.b]] begins a new element; `a` means the newest one
            if is_list and depth == len(names) - 1:
                self.sizes[table] = self.sizes.get(table, 0) + 1
            if table in self.sizes:
                table = (*table, self.sizes[table] - 1)
        end = self.i
        self.i = start  # `note` takes the line at this place
        for depth in range(len(table)):
            self.note(table[: depth + 1])
        self.i = end + brackets
        return table

    def pair(self, table: Keys) -> None:
        """Read a key of a table, and its value."""
        start = self.i
        names = self.name()
        end = self.i
        self.i = start  # `note` takes the line at this place
        for depth in range(len(names)):
            self.note((*table, *names[: depth + 1]))
        self.i = end + 1  # past the equals sign
        self.value((*table, *names))

    def value(self, keys: Keys) -> None:
        """Read a value, and those inside it."""
        self.skip()
        opening = self.text[self.i : self.i + 1]
        if opening in ("[", "{"):
            self.i += 1
            count = 0
            while self.skip() < len(self.text) and self.text[self.i] not in "]}":
                if opening == "[":
                    self.note((*keys, count))
                    self.value((*keys, count))
                else:
                    self.pair(keys)
                count += 1
                if self.text[self.skip() : self.i + 1] == ",":
                    self.i += 1
            self.i += 1
        else:
            pattern = self._TEXT if opening in ("'", '"') else self._BARE
            self.i = self.match(pattern).end()
