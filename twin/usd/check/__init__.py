"""Check a UsdPhysics stage for faults that public validators miss.

    layout       units, frame rates, transform ops, names
    structure    loops, articulation root, self collision
    timeline     poses of all bodies, at rest and at every time sample
    joint_frames coincidence of the two frames of each joint, along the whole timeline
    coordinates  limits, states, drives and speeds along the whole timeline; also finds angles in radians
    bodies       masses, inertias, nesting, meshes
    samples      time range, quaternion signs, steps
    validators   the validators that come with OpenUSD

The checker does not use the writer. It reads only two attributes of twin: `twin:active` (an active joint without a
drive is a finding) and `twin:base` (a missing mass of the base is only a note).
"""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import StageError
from twin.core.findings import Finding, Kind, by_severity
from twin.usd.check.bodies import check_bodies, check_meshes
from twin.usd.check.joint_frames import check_joints
from twin.usd.check.layout import check_names, check_ops, check_transforms, check_units
from twin.usd.check.samples import check_samples
from twin.usd.check.structure import check_structure
from twin.usd.check.timeline import timeline
from twin.usd.check.validators import run_usd_validators
from twin.usd.scan import RawStage

__all__ = ["check_stage", "run_usd_validators"]


_UNCHECKED = Kind("stage.unchecked", "error", "repair the transform ops first")


def check_stage(path: str | Path) -> list[Finding]:
    """Return the findings on a stage, the most severe first.

    A finding has a code "stage.<name>", the prim path in `where` and the time code in `when`. A finding on a measured
    value also has the value, the limit and their unit.

    Raises:
        StageError: the file is missing or not USD, or one of its layers cannot be found.
    """
    scene = RawStage(path)
    findings = [*check_units(scene), *check_ops(scene), *check_names(scene), *check_samples(scene)]
    try:
        findings += [
            *check_transforms(scene),
            *check_structure(scene),
            *check_joints(scene, timeline(scene)),
            *check_bodies(scene),
            *check_meshes(scene),
        ]
    except StageError as failed:  # a transform op that cannot be evaluated; check_ops has already reported it
        findings.append(_UNCHECKED(scene.path, f"{failed} Therefore poses, joints and bodies are not checked"))
    return by_severity(findings)
