"""The Python API, also used by the command line: robots and scenes, and functions on them.

The names are loaded when first used: who needs a part of it, such as `twin validate`, loads nothing of a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin.api.about import SCENE_COMMANDS, info, info_of_scene, listing
    from twin.api.act import operate, play, world
    from twin.api.comparison import compare
    from twin.api.control import track
    from twin.api.current import check_build
    from twin.api.judge import check_plan, explain, plan, strokes, validate
    from twin.api.make import audit, build, export
    from twin.api.published import console, equations_of_motion, masses, study
    from twin.api.robot import STAGE_SUFFIXES, Progress, Robot, load, names
    from twin.api.standing import load_scene
    from twin.api.together import plan_together

_HOMES = {
    "about": ("SCENE_COMMANDS", "info", "info_of_scene", "listing"),
    "act": ("operate", "play", "world"),
    "comparison": ("compare",),
    "control": ("track",),
    "current": ("check_build",),
    "judge": ("check_plan", "explain", "plan", "strokes", "validate"),
    "make": ("audit", "build", "export"),
    "published": ("console", "equations_of_motion", "masses", "study"),
    "robot": ("STAGE_SUFFIXES", "Progress", "Robot", "load", "names"),
    "standing": ("load_scene",),
    "together": ("plan_together",),
}

__all__ = [
    "SCENE_COMMANDS",
    "STAGE_SUFFIXES",
    "Progress",
    "Robot",
    "audit",
    "build",
    "check_build",
    "check_plan",
    "compare",
    "console",
    "equations_of_motion",
    "explain",
    "export",
    "info",
    "info_of_scene",
    "listing",
    "load",
    "load_scene",
    "masses",
    "names",
    "operate",
    "plan",
    "plan_together",
    "play",
    "strokes",
    "study",
    "track",
    "validate",
    "world",
]


def __getattr__(name: str) -> Any:
    for module, held in _HOMES.items():
        if name in held:
            return getattr(import_module(f"twin.api.{module}"), name)
    raise AttributeError(f"module 'twin.api' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
