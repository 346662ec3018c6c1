"""Packages that few commands need: not installed by default, and named with the way to get them when one is missing."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from twin.core.errors import TwinError

EXTRAS = {"distributed": "cluster", "segno": "qr", "yaml": "yaml", "pyarrow": "parquet"}
"""By module, the extra of this package that brings it."""


def require(module: str, purpose: str) -> ModuleType:
    """Return a module of an extra; `purpose` says what needs it.

    Raises:
        TwinError: it is not installed; the message says how it is.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        text = f"{purpose} needs {error.name}: pip install 'twin-robotics[{EXTRAS[module]}]'"
        raise TwinError(text) from error
