"""Errors of a table: which kind it is depends on whether the headings are those of Denavit-Hartenberg parameters."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

from twin.core.errors import NoMechanismError, SourceError, UnsupportedError


class TableErrors:
    """The errors of one file.

    Attributes:
        recognised: whether the headings are those of a table of Denavit-Hartenberg parameters. A table of something
            else is no fault: a search for robots in a folder then goes on.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.recognised = False

    def fail(self, line: int, message: str) -> NoReturn:
        """Raise an error with file and line: a `NoMechanismError` for a table of something else."""
        self.fail_with(f"{self._path}:{line}: {message}")

    def fail_with(self, message: str) -> NoReturn:
        """Raise the same error with a message that names file and line itself."""
        kind = SourceError if self.recognised else NoMechanismError
        raise kind(message)

    def refuse(self, line: int, message: str) -> NoReturn:
        """Raise an error for a table without a fault that does not say all that is needed."""
        kind = UnsupportedError if self.recognised else NoMechanismError
        raise kind(f"{self._path}:{line}: {message}")
