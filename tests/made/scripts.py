"""Programs of the repository that are not in the package, as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def script(file):
    """Return a program, given by its file relative to the root, as a module."""
    path = ROOT / file
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # in which its dataclasses look their types up
    sys.path.insert(0, str(path.parent))  # as for a program that is started
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    return module
