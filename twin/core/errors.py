"""All exceptions that twin raises deliberately.

Their base class is `TwinError`, so that calling programs need to catch only this class. The command line prints a
`TwinError` as one line and ends with exit code 2 ("could not check").
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

_UNREAD_SIMILARITY = 0.3
"""Smallest similarity, 0 to 1, of a name and an unread one that it may misspell: hardly any other name is meant."""


class TwinError(Exception):
    """Base class of all errors that twin raises deliberately; the message states the cause and a fix."""


class DescriptionError(TwinError):
    """A TOML file (robot, dimensions, protocol) is malformed; the message gives file, line, key and value."""


class CadError(TwinError):
    """A CAD file is missing, unreadable, without unit or not watertight, or a named feature is missing."""


class MechanismError(TwinError):
    """Bodies, joints and loops do not form a mechanism (unknown body, second root, swapped limits, ...)."""


class SourceError(TwinError):
    """A file in another format (URDF, MJCF, SDF, closure YAML) is malformed, or cannot be converted to a mechanism."""


class BudgetError(TwinError):
    """Reading a file would exceed a limit of its format: bytes, depth, parts, memory or time."""


class StageError(TwinError):
    """A USD stage cannot be read or written as a mechanism."""


class NoMechanismError(SourceError, StageError):
    """A file in another format can be read, but describes no robot: it has no bodies, or no joints."""


class UnsupportedError(SourceError, StageError):
    """A file in another format is valid, but has something that a mechanism cannot express, or describes a choice."""


class IncompleteError(SourceError):
    """A file in another format needs arguments or packages that were not given and not found."""


class CodeRefusedError(TwinError):
    """The equations are in a Python file, and executing Python files is disabled."""


class KinematicsError(TwinError):
    """The equations are malformed or have no solution (out of reach, singular), or the solver did not converge.

    Attributes:
        best: the best iterate, in the form of the expected result; None if there is none.
        residual: residual of `best`, dimensionless unless the message states a unit.
    """

    def __init__(self, message: str, best: Any = None, residual: float = float("nan")) -> None:
        super().__init__(message)
        self.best = best
        self.residual = residual


class AssemblyError(TwinError):
    """The loops of a mechanism cannot be closed.

    Attributes:
        best: the best assembly found.
        gap: maximum loop gap of the assembly `best` in m; NaN if unknown.
    """

    def __init__(self, message: str, best: Any = None, gap: float = float("nan")) -> None:
        super().__init__(message)
        self.best = best
        self.gap = gap


class ProtocolError(TwinError):
    """A protocol cannot be carried out; the message names phase, path position and exceeded limit."""


class CancelledError(TwinError):
    """A computation was cancelled on request; no data were changed."""


class TimingError(TwinError):
    """No timing satisfies the limits, or the computed timing exceeds a limit between grid points."""


class WorldError(TwinError):
    """Blocks of a World (simulation) are incompatible, a signal is not finite, or a recording is from another World."""


class DeviceError(TwinError):
    """A packet of an input device is malformed; the message names the field, its value and its limit."""


class GpuError(TwinError):
    """No graphics processor can compute a kernel: none is there, its driver refuses, or it has too little memory."""


class OutputError(TwinError):
    """A result cannot be written; no partial result remains."""


def unknown(kind: str, name: str, known: Iterable[str], unread: Iterable[str] = ()) -> str:
    """Return a message for an unknown name: the most similar name, then all known names.

    `kind` is the kind of object, for instance "joint". `unread` are the names that have a value but are never used;
    such a name is suggested first, because `name` may be a misspelling of it.
    """
    names = sorted(known)
    misspelt = _misspelt(name, sorted(unread))
    similar = _similar(name, names)
    hint = ""
    if misspelt is not None:
        hint = f" '{misspelt}' has a value but is never used: is '{name}' a misspelling of '{misspelt}'?"
    elif similar is not None:
        hint = f" Did you mean '{similar}'?"
    return f"there is no {kind} '{name}'.{hint} Known: {', '.join(names) or 'none'}."


def _misspelt(name: str, unread: Sequence[str]) -> str | None:
    """Return the unread name that is most like a name, or the only one there is; None if there is none."""
    close = get_close_matches(name, unread, n=1, cutoff=_UNREAD_SIMILARITY)
    if close:
        return close[0]
    if len(unread) == 1:
        return unread[0]
    return None


def _similar(name: str, names: Sequence[str]) -> str | None:
    """Return the name that is most like another one, also if only upper and lower case differ; None if none is."""
    close = get_close_matches(name, names, n=1)
    if close:
        return close[0]
    folded = {known.casefold(): known for known in names}
    close = get_close_matches(name.casefold(), folded, n=1)
    if close:
        return folded[close[0]]
    return None


def no_inverse(rows: int, columns: int) -> str:
    """Return an error message for the inverse of a non-square matrix; the message suggests the pseudo-inverse."""
    way_out = "J.T @ inv(J @ J.T)" if rows < columns else "inv(J.T @ J) @ J.T"
    return (
        f"a {rows} × {columns} matrix has no inverse, because it is not square; use the pseudo-inverse {way_out} "
        "(pinv), or solve for as many unknowns as there are joints"
    )
