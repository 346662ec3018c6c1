"""Read a USD stage: link poses at its time samples, joint values, meshes, joint gaps.

Poses are read with OpenUSD (pxr) directly, without `twin.usd`. Findings of the stage checker `twin.usd.check` are
included; the checker is also independent of the writer.

header, layers    the file before it is opened, and the layers of which it consists
stage_world, link_shapes, mechanism, joint_gaps    what the stage contains, in the form of all formats
unread_attributes    what it declares beside
shown_prims, mesh_checks, time_samples, engine_settings, odd_values    faults of single parts
declared, listed_numbers, drive_targets    what a stage of twin states twice, or by its own meaning
checks    the stage checker, and the validators of OpenUSD
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdPhysics

from twin.core.foreign.admit import admit
from twin.core.foreign.budget import check_size
from twin.core.json_types import JsonObject
from twin.exchange.audit.clip_checks import check_poses
from twin.exchange.audit.file_content import Content, FileClip
from twin.exchange.audit.ledger import Ledger, ReadError, um
from twin.exchange.audit.parameter_claims import PARAMETERS
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context
from twin.exchange.audit.value_text import quantity
from twin.exchange.formats.usd.audit.checks import check_usd, version
from twin.exchange.formats.usd.audit.declared import check_declared
from twin.exchange.formats.usd.audit.drive_targets import check_drive_targets
from twin.exchange.formats.usd.audit.header import trouble
from twin.exchange.formats.usd.audit.joint_gaps import joint_gaps, joint_values
from twin.exchange.formats.usd.audit.layers import check_default_prim, missing_physics
from twin.exchange.formats.usd.audit.link_shapes import read_shapes
from twin.exchange.formats.usd.audit.listed_numbers import assumed_numbers, check_cones, check_couplings, custom_data
from twin.exchange.formats.usd.audit.mechanism import stage_mechanism
from twin.exchange.formats.usd.audit.mesh_checks import check_primvars
from twin.exchange.formats.usd.audit.shown_prims import (
    check_colliders,
    check_materials,
    check_stray,
    colliding_links,
    has_shape,
)
from twin.exchange.formats.usd.audit.stage_world import StageWorld, all_time_codes

GAP_TOL = 1e-5
"""Maximum gap in m between the two frames of a joint; UsdPhysics stores the frames in single precision."""


def read_usd(path: Path, ledger: Ledger) -> Content:
    """Return the content of a stage, and report faults of its materials, meshes and joints.

    Raises:
        ReadError: the file is not a stage, or a layer is missing.
    """
    stage = _open(path)
    check_default_prim(stage, ledger)
    with _evaluating():
        return _read_content(stage, path, ledger)


def _read_content(stage: Usd.Stage, path: Path, ledger: Ledger) -> Content:
    """Return the content of an opened stage; the checks of its parts report their faults in this order."""
    prims = []
    bodies = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Xformable):
            prims.append(prim)
            if _is_body(prim):
                bodies.append(prim)
    body_paths = {prim.GetPath() for prim in bodies}
    world = StageWorld(stage)
    content = Content(ledger, path.suffix.lstrip(".").lower())
    content.declared = tuple(prim.GetName() for prim in bodies) or None
    content.facts = _conventions(stage, world)
    content.extra["physics"] = bool(bodies)
    # If several prims have the same name, use the prim that moves.
    displayed: dict[str, Usd.Prim] = {}
    for prim in bodies or sorted(prims, key=lambda p: not _moves(p)):
        displayed.setdefault(prim.GetName(), prim)
    for name, prim in displayed.items():
        content.rest[name] = world.poses(prim, [Usd.TimeCode.Default()])[0]
    codes = all_time_codes(displayed.values())
    if len(codes):
        links = world.along(displayed, codes)
        joints = joint_values(stage, codes, world.meters)
        clip = FileClip(path.stem, _seconds(stage, codes), links, joints)
        check_poses(ledger, clip, "usd")
        content.clips.append(clip)
    check_materials(prims, ledger)
    check_primvars(stage, ledger)
    if bodies:
        check_stray(prims, body_paths, ledger)
        check_colliders(prims, ledger)
        shown_paths = {prim.GetPath() for prim in displayed.values()}
        content.shapes, content.colors, content.finishes = read_shapes(prims, shown_paths, world, ledger)
        content.mechanism = stage_mechanism(stage, bodies, world.meters, world.up)
        hidden: dict[str, bool] = {}
        for name, prim in displayed.items():
            if name not in content.shapes and not has_shape(prim, shown_paths):
                hidden[name] = False
        content.mechanism.shown = hidden
        content.mechanism.collides = colliding_links(prims, shown_paths)
        if content.mechanism.all_motors:
            check_declared(stage, content.mechanism, codes, ledger)
        check_cones(stage, content.mechanism, ledger)
        check_couplings(stage, content.mechanism, ledger)
        check_drive_targets(stage, content.rest, content.mechanism, world.meters, ledger, moving=len(codes) > 0)
    else:
        content.shapes, content.colors, content.finishes = read_shapes(prims, None, world, ledger)
        missing = missing_physics(stage)
        if missing:
            ledger.wrong("usd.layer", missing, "subLayers", suggestion="add the layer with the physics")
    content.extra["assumed"] = assumed_numbers(stage)
    content.extra[PARAMETERS] = custom_data(stage, "twin:parameters")
    _check_gaps(stage, world, bodies, codes, ledger)
    return content


def _seconds(stage: Usd.Stage, codes: Array) -> Array:
    """Return the times (k,) in s of time codes (k,), from the start that the stage states."""
    start = 0.0
    if stage.HasAuthoredTimeCodeRange():
        start = stage.GetStartTimeCode()
    return (codes - start) / stage.GetTimeCodesPerSecond()


def _conventions(stage: Usd.Stage, world: StageWorld) -> JsonObject:
    """Return units, axes and rates of a stage, and whether the stage states them, for the report."""
    units = f"{world.meters:g} m"
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        units += " (not authored)"
    up_axis = world.up
    if not stage.HasAuthoredMetadata("upAxis"):
        up_axis += " (not authored)"
    return {
        "units": units,
        "up_axis": up_axis,
        "handedness": "right (USD)",
        "time_codes_per_second": stage.GetTimeCodesPerSecond(),
        "frames_per_second": stage.GetFramesPerSecond(),
    }


_REASON_IN_MESSAGE = re.compile(r" at line \d+ in file \S+ : '([^\n]*?)'?$", re.MULTILINE)


def _open(path: Path) -> Usd.Stage:
    try:
        stage = Usd.Stage.Open(str(path))
    except (Tf.ErrorException, RuntimeError) as error:
        raise ReadError(f"the file is not a readable USD file: {_reason(error)}") from error
    if not stage:
        raise ReadError("the file is not a readable USD file")
    with contextlib.suppress(Tf.ErrorException):
        stage.Reload()  # USD caches layers in memory, but the file may have changed
    for error in stage.GetCompositionErrors():
        raise ReadError(f"the layers of the stage cannot be composed: {str(error).strip()[:200]}")
    return stage


@contextlib.contextmanager
def _evaluating() -> Iterator[None]:
    try:
        yield
    except (Tf.ErrorException, RuntimeError) as error:
        raise ReadError(f"the stage cannot be evaluated: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """Return the first reason in the message of a USD error, without the location in USD's source code."""
    text = str(error)
    match = _REASON_IN_MESSAGE.search(text)
    if match:
        return re.sub(r"parse error matching \S*pxr\S* ", "syntax error ", match[1].strip())[:200]
    lines = text.strip().splitlines()
    if not lines:
        return "unknown format"
    return lines[-1].strip()[:200]


def _is_body(prim: Usd.Prim) -> bool:
    if not prim.HasAPI(UsdPhysics.RigidBodyAPI):
        return False
    return UsdPhysics.RigidBodyAPI(prim).GetRigidBodyEnabledAttr().Get() is not False


def _moves(prim: Usd.Prim) -> bool:
    return UsdGeom.Xformable(prim).TransformMightBeTimeVarying()


def _check_gaps(stage: Usd.Stage, world: StageWorld, bodies: list[Usd.Prim], codes: Array, ledger: Ledger) -> None:
    """Measure the gap between the two frames of every joint, at rest and along the motion."""
    if not bodies:
        return
    moments = ["at rest"]
    times = [Usd.TimeCode.Default()]
    for code, seconds in zip(codes.tolist(), _seconds(stage, codes).tolist(), strict=True):
        moments.append(f"t = {seconds:.4g} s")
        times.append(Usd.TimeCode(code))
    paths = [str(body.GetPath()) for body in bodies]
    placed = dict(zip(paths, world.placed(world.maps(bodies, times)), strict=True))
    worst = 0.0
    where = ""
    when = ""
    for path, gap in joint_gaps(stage, placed, world):
        worst_sample = int(np.argmax(gap))
        if gap[worst_sample] > worst:
            worst = float(gap[worst_sample])
            where = path
            when = moments[worst_sample]
    ledger.row("joint gap along the motion", worst, "m", GAP_TOL, where=where, when=when)
    if worst > GAP_TOL:
        ends = _ends_of_joint(stage.GetPrimAtPath(where))
        text = f"joint {where}: the joint frames on {ends} are {quantity(worst, 'm')} apart."
        ledger.wrong("usd.joint_gap", text, where, size=um(worst, GAP_TOL), when=when)


def _ends_of_joint(joint: Usd.Prim) -> str:
    """Return the names of the two bodies of a joint as text."""
    names = []
    for relationship in (UsdPhysics.Joint(joint).GetBody0Rel(), UsdPhysics.Joint(joint).GetBody1Rel()):
        targets = relationship.GetTargets()
        name = "the world"
        if targets:
            name = f"'{targets[0].name}'"
        names.append(name)
    return " and ".join(names)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage, and report its faults; the size and the header are checked first.

    Raises:
        ReadError: the header is wrong, or OpenUSD cannot read the stage.
    """
    ledger.tool = "twin.exchange.audit on usd-core"
    ledger.version = version()
    check_size(path, "USD")
    return read_layer(path, ledger, context)


def read_layer(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of a stage or archive whose size has been checked; see `read`."""
    broken = trouble(path.read_bytes())
    if broken:
        raise ReadError(broken, "usd.header")
    if path not in context.admitted:
        admit(path)
    try:
        content = read_usd(path, ledger)
        check_usd(path, bool(content.extra["physics"]), ledger)
    except Tf.ErrorException as error:  # OpenUSD detects some faults only when it reads the data
        reason = str(error).strip().splitlines()[-1].strip()[:200]
        raise ReadError(f"OpenUSD cannot read the stage: {reason}") from error
    return content
