"""Paths of the compared files as they are told."""

from __future__ import annotations

from pathlib import Path


def relative_path(file: str) -> str:
    """Return a path relative to the working folder, if it is below it."""
    try:
        return str(Path(file).resolve().relative_to(Path.cwd()))
    except ValueError:
        return file
