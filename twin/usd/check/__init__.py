"""Check a UsdPhysics stage for what public validators miss.

    layout       units, frame rates, transform ops, names
    structure    loops, articulation root, self collision
    timeline     where all bodies are, at rest and at every time sample
    joints       frames that meet and axes that agree, along the whole timeline
    coordinates  limits, states, drives and speeds, along the whole timeline; radians taken for degrees
    bodies       masses, inertias, nesting, meshes
    samples      time range, quaternion signs, steps
    validators   the validators and the physics parser that come with OpenUSD

The checker reads the stage itself and trusts no attribute of twin's own, except `twin:active`, which can only
add a finding. Nothing here imports the writer.
"""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import StageError
from twin.core.findings import Finding, by_severity
from twin.usd.check.bodies import check_bodies, check_meshes
from twin.usd.check.joints import check_joints
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.check.structure import check_structure
from twin.usd.check.timeline import timeline
from twin.usd.check.validators import parse_with_usdphysics, run_usd_validators
from twin.usd.scan import Scene

__all__ = ["check_stage", "parse_with_usdphysics", "run_usd_validators"]


def check_stage(path: str | Path) -> list[Finding]:
    """Return what is wrong with a stage, the gravest first; an empty list if nothing is.

    Each finding has a code stage.<something>, the prim path in `where`, the time code in `when`, and size,
    unit and limit where there is a number.

    Raises:
        StageError: if the file is missing, no USD, or a layer that it names cannot be found.

    """
    scene = Scene(path)
    findings = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    try:
        findings += [
            *check_transforms(scene),
            *check_structure(scene),
            *check_joints(scene, timeline(scene)),
            *check_bodies(scene),
            *check_meshes(scene),
        ]
    except StageError as error:  # a transform op that cannot be evaluated; check_ops has named it
        findings.append(
            Finding(
                "stage.unchecked",
                "error",
                f"{error} Poses, joints and bodies are not checked.",
                where=scene.path,
                suggestion="repair the transform ops first",
            )
        )
    return by_severity(findings)
