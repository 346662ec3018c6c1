# ruff: noqa: I001 - several names of one module are in one statement
"""The Python API, also used by the command line: robots and scenes, and functions on them.

The names are loaded when first used: who needs a part of it, such as `twin validate`, loads nothing of a simulation.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin.api.comparison import compare as compare
    from twin.api.control import track as track
    from twin.api.equation_checks import (
        explain as explain,
        strokes as strokes,
        validate as validate,
        validate_samples as validate_samples,
    )
    from twin.api.export_audit import audit as audit
    from twin.api.exports import (
        build as build,
        export as export,
    )
    from twin.api.facts import (
        SCENE_COMMANDS as SCENE_COMMANDS,
        info as info,
        info_of_scene as info_of_scene,
        listing as listing,
    )
    from twin.api.mass_check import masses as masses
    from twin.api.multi_robot_plan import plan_together as plan_together
    from twin.api.proof import prove as prove
    from twin.api.protocol_plan import (
        check_plan as check_plan,
        plan as plan,
    )
    from twin.api.published_equations import (
        console as console,
        equations_of_motion as equations_of_motion,
    )
    from twin.api.published_tables import study as study
    from twin.api.robot import (
        Progress as Progress,
        Robot as Robot,
    )
    from twin.api.robot_folder import new as new
    from twin.api.robot_loading import (
        STAGE_SUFFIXES as STAGE_SUFFIXES,
        load as load,
        names as names,
    )
    from twin.api.scene_loading import load_scene as load_scene
    from twin.api.simulation_runs import (
        operate as operate,
        play as play,
        world as world,
    )
    from twin.api.stage_check import check_build as check_build

# No module may be called like a name that it offers: once loaded, the module would hide the name.
_NAMES_BY_MODULE = {
    "comparison": ("compare",),
    "control": ("track",),
    "equation_checks": ("explain", "strokes", "validate", "validate_samples"),
    "export_audit": ("audit",),
    "exports": ("build", "export"),
    "facts": ("SCENE_COMMANDS", "info", "info_of_scene", "listing"),
    "mass_check": ("masses",),
    "multi_robot_plan": ("plan_together",),
    "proof": ("prove",),
    "protocol_plan": ("check_plan", "plan"),
    "published_equations": ("console", "equations_of_motion"),
    "published_tables": ("study",),
    "robot": ("Progress", "Robot"),
    "robot_folder": ("new",),
    "robot_loading": ("STAGE_SUFFIXES", "load", "names"),
    "scene_loading": ("load_scene",),
    "simulation_runs": ("operate", "play", "world"),
    "stage_check": ("check_build",),
}

__all__: list[str] = []
for _names in _NAMES_BY_MODULE.values():
    __all__ += _names


def __getattr__(name: str) -> Any:
    for module, public_names in _NAMES_BY_MODULE.items():
        if name in public_names:
            return getattr(import_module(f"twin.api.{module}"), name)
    raise AttributeError(f"module 'twin.api' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
