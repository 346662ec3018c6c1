"""Check a USD stage of an exported scene: public validators, collisions, and poses compared with the robots' files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdPhysics

from twin.core.foreign.admit import admit
from twin.exchange.audit.folder_files import SCENE
from twin.exchange.audit.ledger import Ledger, Measured, ReadError, guarded
from twin.exchange.audit.pose_deviation import POSITION_TOL, ROTATION_TOL
from twin.exchange.audit.poses import Array, angle
from twin.exchange.audit.value_text import quantity
from twin.exchange.formats.usd.audit.checks import version
from twin.exchange.formats.usd.audit.stage_world import StageWorld
from twin.usd.check import run_usd_validators

REACH = 0.1
"""Distance in m between a link's origin and the other points at which deviations are measured, to include rotations."""

_POINTS = np.vstack([np.zeros(3), REACH * np.eye(3)])
"""Points (4, 3) in m of a link at which deviations are measured."""


@dataclass(frozen=True)
class SceneMotion:
    """Motion of the links of a robot in a scene, or of the movable objects, as the files beside the stage state it.

    Attributes:
        T_world_base: (4, 4) base pose of the robot in scene.json.
        times: (k,) times in s.
        links: {link: its poses T_base_link (k, 4, 4) at these times}.
    """

    T_world_base: Array
    times: Array
    links: Mapping[str, Array]


@dataclass(frozen=True)
class LinkDeviation:
    """Largest deviation of the links in a stage from the robots' files.

    Attributes:
        size: in m; infinite if a link or its poses are missing; NaN if a pose is not finite.
        where: robot and link, or what is missing.
        when: time; "" if something is missing.
    """

    size: float
    where: str
    when: str


def audit_stage(path: Path, motions: Mapping[str, SceneMotion]) -> Ledger:
    """Return the ledger of a stage of a scene; `motions` are those of its robots and objects, by name of their prim."""
    ledger = Ledger(f"usd/{path.name}", "pxr", version())
    guarded(partial(_check_stage, motions), path, ledger)
    return ledger


def largest_deviation(path: Path, motions: Mapping[str, SceneMotion]) -> LinkDeviation:
    """Return the largest deviation of the links in a scene's stage from the motions of its robots and objects.

    Deviations are measured at the first, middle and last key, at each link's origin and at points `REACH` from the
    origin.
    """
    return _largest_deviation(_opened(path), motions)


def _check_stage(motions: Mapping[str, SceneMotion], path: Path, ledger: Ledger) -> None:
    """Add rows and findings on a stage.

    Raises:
        ReadError: OpenUSD cannot read the stage.
    """
    admit(path)
    try:
        public_findings = []
        for finding in run_usd_validators(path):
            if finding.severity != "info":
                public_findings.append(finding)
        stage = _opened(path)
        _check_bases(stage, motions, ledger)
        _check_filters(stage, ledger)
        worst = _largest_deviation(stage, motions)
    except (Tf.ErrorException, RuntimeError) as error:
        reason = str(error).strip().splitlines()[-1]
        text = f"OpenUSD cannot read the stage: {reason[:200]}"
        raise ReadError(text, "usd.unreadable") from error
    for public_finding in public_findings:
        ledger.add(public_finding.code, public_finding.severity, public_finding.message, public_finding.where)
    ledger.row("public validators", float(len(public_findings)), "found", 0.0)
    check = "links in the world frame, compared with the robots' files"
    ledger.row(check, worst.size, "m", POSITION_TOL, where=worst.where, when=worst.when)
    if not worst.size <= POSITION_TOL:
        text = f"{worst.where}: missing."
        if np.isnan(worst.size):
            text = f"{worst.where}: its pose in the stage or in the robot's files is not finite."
        elif np.isfinite(worst.size):
            text = f"{worst.where}: the pose differs from the robot's files by {quantity(worst.size, 'm')}."
        size = Measured(worst.size, POSITION_TOL, "m")
        ledger.wrong("scene.link", text, worst.where, size=size, when=worst.when)


def _opened(path: Path) -> Usd.Stage:
    """Return a stage as it is on disk."""
    stage = Usd.Stage.Open(str(path))
    stage.Reload()  # USD keeps layers in memory, but the file may have changed
    return stage


def _check_bases(stage: Usd.Stage, motions: Mapping[str, SceneMotion], ledger: Ledger) -> None:
    """Report robots whose base has another pose in the stage than in scene.json."""
    world = StageWorld(stage)
    root = stage.GetDefaultPrim().GetPath()
    for name, motion in motions.items():
        prim = stage.GetPrimAtPath(root.AppendChild(name))
        if not prim:
            continue  # its links are missing, which is reported
        T = world.poses(prim, [Usd.TimeCode.Default()])[0]
        distance = float(np.linalg.norm(T[:3, 3] - motion.T_world_base[:3, 3]))
        turn = float(angle(T[:3, :3], motion.T_world_base[:3, :3]))
        if distance <= POSITION_TOL and turn <= ROTATION_TOL:
            continue
        text = (
            f"robot '{name}': its base in {SCENE} differs by {quantity(distance, 'm')} and "
            f"{np.degrees(turn):.4g} deg from that in the stage."
        )
        size = Measured(distance, POSITION_TOL, "m")
        if distance <= POSITION_TOL:  # only the rotation is wrong
            size = Measured(float(np.degrees(turn)), float(np.degrees(ROTATION_TOL)), "deg")
        advice = f"correct T_world_base in {SCENE}, or the transform of the robot in the stage"
        ledger.wrong("scene.base", text, name, size=size, suggestion=advice)


def _check_filters(stage: Usd.Stage, ledger: Ledger) -> None:
    """Report links that collide with some of the shapes of a prop, and not with the others.

    Links touch or enter a prop as a whole by design: its shapes are left out of collisions together.
    """
    for prim in stage.Traverse():
        if not prim.HasAPI(UsdPhysics.FilteredPairsAPI):
            continue
        filtered = set(UsdPhysics.FilteredPairsAPI(prim).GetFilteredPairsRel().GetForwardedTargets())
        for prop in sorted({target.GetParentPath() for target in filtered}):
            shapes = _colliders(stage.GetPrimAtPath(prop))
            unfiltered = []
            for shape in shapes:
                if shape not in filtered:
                    unfiltered.append(shape)
            if unfiltered and len(unfiltered) < len(shapes):
                place = str(prim.GetPath())
                text = (
                    f"{place} collides with {unfiltered[0].name}, but not with the other shapes of {prop.name}: "
                    "they are left out of collisions together, as the two touch by design."
                )
                advice = "add the shape to physics:filteredPairs"
                ledger.add("scene.filter", "warning", text, place, suggestion=advice)


def _colliders(prop: Usd.Prim) -> list[Sdf.Path]:
    """Return the paths of the shapes directly below a prim that can collide; none for a link, which is no prop."""
    if not prop or prop.HasAPI(UsdPhysics.RigidBodyAPI):
        return []
    shapes = []
    for prim in prop.GetChildren():
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            shapes.append(prim.GetPath())
    return shapes


def _largest_deviation(stage: Usd.Stage, motions: Mapping[str, SceneMotion]) -> LinkDeviation:
    """Return the largest deviation of the links in an open stage; see `largest_deviation`."""
    world = StageWorld(stage)
    rate = stage.GetTimeCodesPerSecond()
    root = stage.GetDefaultPrim().GetPath()
    worst = LinkDeviation(0.0, "", "")
    for name, motion in motions.items():
        if not motion.links:
            return LinkDeviation(np.inf, f"link poses in the files of {name}", "")
        last = len(motion.times) - 1
        keys = sorted({0, len(motion.times) // 2, last})
        codes = []
        for key in keys:
            codes.append(Usd.TimeCode(float(motion.times[key] * rate)))
        for link, Ts_base_link in motion.links.items():
            where = f"{name}/{link}"
            prim = stage.GetPrimAtPath(root.AppendChild(name).AppendChild(link))
            if not prim:
                return LinkDeviation(np.inf, where, "")
            for key, T_world_link in zip(keys, world.poses(prim, codes), strict=True):
                size = _displacement(T_world_link, motion.T_world_base @ Ts_base_link[key])
                when = f"t = {motion.times[key]:.3f} s"
                if not np.isfinite(size):  # no later deviation may replace it
                    return LinkDeviation(np.nan, where, when)
                if size >= worst.size:  # also if it is zero: the row names a link
                    worst = LinkDeviation(size, where, when)
    return worst


def _displacement(T: Array, other: Array) -> float:
    """Return the largest distance in m of the points of a link between two poses (4, 4) of it."""
    difference = T - other
    shift = _POINTS @ difference[:3, :3].T + difference[:3, 3]
    return float(np.linalg.norm(shift, axis=1).max())
