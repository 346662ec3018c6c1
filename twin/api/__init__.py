# ruff: noqa: I001 - several names of one module are in one statement
"""The Python API, also used by the command line: robots and scenes, and functions on them.

The names are loaded when first used: who needs a part of it, such as `twin validate`, loads nothing of a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin.api.about import (
        SCENE_COMMANDS as SCENE_COMMANDS,
        info as info,
        info_of_scene as info_of_scene,
        listing as listing,
    )
    from twin.api.act import (
        operate as operate,
        play as play,
        world as world,
    )
    from twin.api.comparison import compare as compare
    from twin.api.control import track as track
    from twin.api.current import check_build as check_build
    from twin.api.judge import (
        check_plan as check_plan,
        explain as explain,
        plan as plan,
        strokes as strokes,
        validate as validate,
        validate_samples as validate_samples,
    )
    from twin.api.make import (
        audit as audit,
        build as build,
        export as export,
    )
    from twin.api.new import new as new
    from twin.api.proof import prove as prove
    from twin.api.published import (
        console as console,
        equations_of_motion as equations_of_motion,
        masses as masses,
        study as study,
    )
    from twin.api.robot import (
        STAGE_SUFFIXES as STAGE_SUFFIXES,
        Progress as Progress,
        Robot as Robot,
        load as load,
        names as names,
    )
    from twin.api.scene_loading import load_scene as load_scene
    from twin.api.together import plan_together as plan_together

_HOMES = {
    "about": ("SCENE_COMMANDS", "info", "info_of_scene", "listing"),
    "act": ("operate", "play", "world"),
    "comparison": ("compare",),
    "control": ("track",),
    "current": ("check_build",),
    "judge": ("check_plan", "explain", "plan", "strokes", "validate", "validate_samples"),
    "make": ("audit", "build", "export"),
    "new": ("new",),
    "proof": ("prove",),
    "published": ("console", "equations_of_motion", "masses", "study"),
    "robot": ("STAGE_SUFFIXES", "Progress", "Robot", "load", "names"),
    "scene_loading": ("load_scene",),
    "together": ("plan_together",),
}

__all__: list[str] = []
for _names in _HOMES.values():
    __all__ += _names


def __getattr__(name: str) -> Any:
    for module, held in _HOMES.items():
        if name in held:
            return getattr(import_module(f"twin.api.{module}"), name)
    raise AttributeError(f"module 'twin.api' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
