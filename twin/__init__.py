# ruff: noqa: I001 - several names of one module are in one statement
"""twin: bring your CAD and your equations; it tells you where they disagree.

The public names are those of `__all__`; they are loaded when first used, so that `import twin` is fast.
"""

from __future__ import annotations

from twin.core.version import __version__

TYPE_CHECKING = False  # as in `typing`, whose import takes longer than that of this package
if TYPE_CHECKING:
    from typing import Any

    from twin.analysis.error_propagation import Spread as Spread
    from twin.analysis.workspace import workspace as workspace
    from twin.analysis.sweep import sweep as sweep
    from twin.analysis.tolerance import tolerance as tolerance
    from twin.api import (
        Robot as Robot,
        audit as audit,
        build as build,
        check_plan as check_plan,
        compare as compare,
        console as console,
        equations_of_motion as equations_of_motion,
        explain as explain,
        export as export,
        load as load,
        load_scene as load_scene,
        masses as masses,
        names as names,
        operate as operate,
        plan as plan,
        play as play,
        prove as prove,
        strokes as strokes,
        study as study,
        track as track,
        validate as validate,
        validate_samples as validate_samples,
        world as world,
    )
    from twin.checking.checker import check as check
    from twin.api.result_difference import diff as diff
    from twin.api.robot_folder import new as new
    from twin.api.procedure import (
        operate_procedure as operate_procedure,
        replay_procedure as replay_procedure,
    )
    from twin.api.console_runs import (
        operate_console as operate_console,
        replay_session as replay_session,
    )
    from twin.core.compute_device import computing_on as computing_on
    from twin.core.errors import TwinError as TwinError
    from twin.core.findings import Finding as Finding
    from twin.core.result import Result as Result
    from twin.kinematics import (
        Joints as Joints,
        Pose as Pose,
        Tip as Tip,
        Trocar as Trocar,
    )

_NAMES_BY_MODULE = {
    "twin.api": (
        "Robot",
        "audit",
        "build",
        "check_plan",
        "compare",
        "console",
        "equations_of_motion",
        "explain",
        "export",
        "load",
        "load_scene",
        "masses",
        "names",
        "operate",
        "plan",
        "play",
        "prove",
        "strokes",
        "study",
        "track",
        "validate",
        "validate_samples",
        "world",
    ),
    "twin.api.result_difference": ("diff",),
    "twin.api.robot_folder": ("new",),
    "twin.api.procedure": ("operate_procedure", "replay_procedure"),
    "twin.api.console_runs": ("operate_console", "replay_session"),
    "twin.analysis.error_propagation": ("Spread",),
    "twin.analysis.workspace": ("workspace",),
    "twin.analysis.sweep": ("sweep",),
    "twin.analysis.tolerance": ("tolerance",),
    "twin.checking.checker": ("check",),
    "twin.core.compute_device": ("computing_on",),
    "twin.core.errors": ("TwinError",),
    "twin.core.findings": ("Finding",),
    "twin.core.result": ("Result",),
    "twin.kinematics": ("Joints", "Pose", "Tip", "Trocar"),  # tasks for `Robot.solve`
}

__all__ = ["__version__"]
for _names in _NAMES_BY_MODULE.values():
    __all__ += _names


def __getattr__(name: str) -> Any:
    from importlib import import_module

    for module, public_names in _NAMES_BY_MODULE.items():
        if name in public_names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module 'twin' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
