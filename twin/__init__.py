"""twin: bring your CAD and your equations; it tells you where they disagree.

The public names are those of `__all__`; they are loaded when first used, so that `import twin` is fast.
"""

from __future__ import annotations

from twin.core.version import __version__

TYPE_CHECKING = False  # as in `typing`, whose import takes longer than that of this package
if TYPE_CHECKING:
    from typing import Any

    from twin.analysis.search import workspace
    from twin.analysis.sweep import sweep
    from twin.analysis.tolerance import Spread, tolerance
    from twin.api import (
        Robot,
        audit,
        build,
        check_plan,
        compare,
        console,
        equations_of_motion,
        explain,
        export,
        load,
        load_scene,
        masses,
        names,
        operate,
        plan,
        play,
        strokes,
        study,
        track,
        validate,
        world,
    )
    from twin.api.procedure import operate_procedure, replay_procedure
    from twin.api.session import operate_console, replay_session
    from twin.core.errors import TwinError
    from twin.core.findings import Finding
    from twin.core.result import Result
    from twin.kinematics import Joints, Pose, Tip, Trocar

_HOMES = {
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
        "strokes",
        "study",
        "track",
        "validate",
        "world",
    ),
    "twin.api.procedure": ("operate_procedure", "replay_procedure"),
    "twin.api.session": ("operate_console", "replay_session"),
    "twin.analysis.search": ("workspace",),
    "twin.analysis.sweep": ("sweep",),
    "twin.analysis.tolerance": ("Spread", "tolerance"),
    "twin.core.errors": ("TwinError",),
    "twin.core.findings": ("Finding",),
    "twin.core.result": ("Result",),
    "twin.kinematics": ("Joints", "Pose", "Tip", "Trocar"),  # tasks for `Robot.solve`
}

__all__ = [
    "Finding",
    "Joints",
    "Pose",
    "Result",
    "Robot",
    "Spread",
    "Tip",
    "Trocar",
    "TwinError",
    "__version__",
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
    "operate_console",
    "operate_procedure",
    "plan",
    "play",
    "replay_procedure",
    "replay_session",
    "strokes",
    "study",
    "sweep",
    "tolerance",
    "track",
    "validate",
    "workspace",
    "world",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    for module, held in _HOMES.items():
        if name in held:
            return getattr(import_module(module), name)
    raise AttributeError(f"module 'twin' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
