"""Every exception that twin raises on purpose.

One base class, so that a caller who wraps twin needs to know one name. The command line turns a
`TwinError` into one line and exit code 2 ("could not check").
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any


class TwinError(Exception):
    """Base of all errors that twin raises on purpose; the message names the thing and the way out."""


class DescriptionError(TwinError):
    """A TOML file (robot, dimensions, protocol) is malformed; the message gives file, line, key and value."""


class CadError(TwinError):
    """A CAD file is missing, unreadable, without unit, not watertight, or lacks a feature that is named."""


class MechanismError(TwinError):
    """Bodies, joints and loops do not form a mechanism (unknown body, second root, swapped limits, ...)."""


class SourceError(TwinError):
    """A foreign description (URDF, MJCF, SDF, closure YAML) is malformed, or holds what no mechanism here can."""


class BudgetError(TwinError):
    """Reading a file would cost more than its format may: bytes, depth, parts, memory or time."""


class StageError(TwinError):
    """A USD stage cannot be read or written as a mechanism."""


class CodeRefusedError(TwinError):
    """Equations are a Python file, and it is not to be run."""


class KinematicsError(TwinError):
    """The equations cannot answer: out of reach, on a singularity, or the solver did not converge.

    Attributes:
        best: the best iterate, in the form of the answer that was asked for (or None if there is none).
        residual: its residual, dimensionless unless the message says otherwise.
    """

    def __init__(self, message: str, best: Any = None, residual: float = float("nan")) -> None:
        super().__init__(message)
        self.best = best
        self.residual = residual


class AssemblyError(TwinError):
    """The independent model cannot close its loops.

    Attributes:
        best: the best assembly found.
        gap: its largest loop gap in metres.
    """

    def __init__(self, message: str, best: Any = None, gap: float = float("nan")) -> None:
        super().__init__(message)
        self.best = best
        self.gap = gap


class ProtocolError(TwinError):
    """A protocol cannot be carried out; the message says in which phase, where on it, by how much."""


class TimingError(TwinError):
    """There is no timing within the limits, or what was found breaks one between grid points."""


class OutputError(TwinError):
    """A result cannot be written; nothing half-written is left behind."""


def unknown(kind: str, name: str, known: Iterable[str], unread: Iterable[str] = ()) -> str:
    """Return a message for a name that does not exist: the name that is probably meant, then all of them.

    Args:
        kind: what the name is to be.
        name: the name.
        known: names that exist.
        unread: those of them that have a value and that nothing reads: one of them is meant rather than any other.
    """
    names, waiting = sorted(known), sorted(unread)
    close = get_close_matches(name, waiting, n=1, cutoff=0.3) or (waiting if len(waiting) == 1 else [])
    if close:
        hint = f" '{close[0]}' has a value and nothing reads it: is '{name}' meant to be '{close[0]}'?"
    else:
        folded = {n.casefold(): n for n in names}
        close = get_close_matches(name, names, n=1) or get_close_matches(name.casefold(), folded, n=1)
        hint = f" Did you mean '{folded.get(close[0], close[0])}'?" if close else ""
    return f"there is no {kind} '{name}'.{hint} Known: {', '.join(names) or 'none'}."


def no_inverse(rows: int, columns: int) -> str:
    """Return a message for the inverse of a matrix that is not square, with what to write instead."""
    way = "J.T @ inv(J @ J.T)" if rows < columns else "inv(J.T @ J) @ J.T"
    return (
        f"a {rows} × {columns} matrix has no inverse, only a square one has; write its least-squares inverse, "
        f"{way} (pinv), or solve for as many unknowns as there are joints"
    )
