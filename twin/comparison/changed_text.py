"""The text of a file with other values of some numbers, read again; and how a number of an edit is written."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from twin.comparison.file_numbers import FileNumber, numbers, text_of
from twin.comparison.side import RobotSide
from twin.core.errors import TwinError

MAX_DECIMALS = 12
"""Maximum number of decimals of a value that is rounded to as few as an inaccuracy allows."""

_MAX_REMEMBERED_TEXTS = 2000
"""Maximum number of changed texts of one file whose sides are kept."""


@dataclass(frozen=True)
class ChangeableText:
    """A text whose numbers can be changed, and that is then read again.

    Attributes:
        side: the side of the text, which has `reread`.
        data: the text.
    """

    side: RobotSide
    data: bytes

    def numbers(self, names: Collection[str], kind: str) -> list[FileNumber]:
        """Return the numbers inside elements or prims with these names; `kind` as in `file_numbers.numbers`."""
        return numbers(self.side, names, kind)

    def written(self, number: FileNumber) -> str:
        """Return a number as the text states it."""
        return self.data[number.start : number.end].decode()

    def value(self, number: FileNumber) -> float:
        """Return the value of a number in the text."""
        return float(self.written(number))

    def with_values(self, changes: Sequence[tuple[FileNumber, float]]) -> RobotSide | None:
        """Return the side with other values of some numbers; None if the text can then not be read."""
        assert self.side.reread is not None
        changed = self.data
        # from the last number, so that the places of those before it stay
        for number, value in sorted(changes, key=lambda change: -change[0].start):
            changed = changed[: number.start] + value_text(value).encode() + changed[number.end :]
        try:
            return self.side.reread(changed)
        except TwinError:
            return None


def changeable_text(side: RobotSide) -> ChangeableText | None:
    """Return the text of a side; None if it has none whose numbers can be changed."""
    data = text_of(side)
    return None if data is None else ChangeableText(side, data)


def with_memory(side: RobotSide) -> RobotSide:
    """Return the side with a `reread` that reads each text once: the edits of many items try the same ones."""
    reread = side.reread
    if reread is None:
        return side
    sides_of_texts: dict[bytes, RobotSide | TwinError] = {}

    def read_once(text: bytes) -> RobotSide:
        key = hashlib.sha256(text).digest()
        side_read_before = sides_of_texts.get(key)
        if side_read_before is None:
            try:
                side_read_before = reread(text)
            except TwinError as error:  # a text that cannot be read is not tried again either
                side_read_before = error
            if len(sides_of_texts) < _MAX_REMEMBERED_TEXTS:
                sides_of_texts[key] = side_read_before
        if isinstance(side_read_before, TwinError):
            raise side_read_before
        return side_read_before

    return replace(side, reread=read_once)


def value_text(value: float) -> str:
    """Return a value with the twelve digits that an edit states."""
    return f"{value:.12g}"


def fewest_decimals(value: float, inaccuracy: float) -> float:
    """Return a value with as few decimals as an inaccuracy allows."""
    for decimals in range(MAX_DECIMALS + 1):
        rounded = with_decimals(value, decimals)
        if abs(rounded - value) <= inaccuracy:
            return rounded
    return value


def with_decimals(value: float, decimals: int) -> float:
    """Return a value with a number of decimals, with 0.0 instead of -0.0."""
    return round(value, decimals) + 0.0
