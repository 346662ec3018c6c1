"""twin: bring your CAD and your equations; it tells you where they disagree.

The public names are those of `__all__`; they are loaded when first used, so that `import twin` is light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from twin.core.version import __version__

if TYPE_CHECKING:
    from twin.api import Robot, build, export, load, names, plan, validate

__all__ = ["Robot", "__version__", "build", "export", "load", "names", "plan", "validate"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from twin import api

        return getattr(api, name)
    raise AttributeError(f"module 'twin' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
