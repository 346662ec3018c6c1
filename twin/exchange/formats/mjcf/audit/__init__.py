"""Audit an MJCF file: its content is compared with other files, and what it says is checked.

MuJoCo reads the file, as a specification that can be searched, and as a compiled model.

shapes, mechanism, drives, equalities, declared_fields    what the file contains, in the form of all formats
track_poses, loop_gaps    the poses of its bodies along a track, and gaps of its loops
model_checks, keyframe_checks, claims, statics    faults that one file shows by itself
mujoco_conventions    numbers and poses as MuJoCo states them
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco

from twin.core.foreign.admit import admit
from twin.exchange.audit import poses
from twin.exchange.audit.comment_statements import assumed_masses, partly_shown
from twin.exchange.audit.file_content import Content, FileClip, LinkShape
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.poses import Array
from twin.exchange.audit.reader_context import Context, played
from twin.exchange.audit.xml_root import parse_xml
from twin.exchange.formats.mjcf.audit.claims import check_claims, counts_from_home, home_coordinates
from twin.exchange.formats.mjcf.audit.declared_fields import further_declarations
from twin.exchange.formats.mjcf.audit.mechanism import compiled_mechanism
from twin.exchange.formats.mjcf.audit.model_checks import check_limits, check_model
from twin.exchange.formats.mjcf.audit.shapes import link_shapes, surface_colors
from twin.exchange.formats.mjcf.audit.statics import balance_at_keyframe
from twin.exchange.formats.mjcf.audit.track_poses import play_track


class MjcfTree:
    """The joint tree of an MJCF file, which gives its poses along tracks (see `reader_context.JointTree`)."""

    def __init__(self, file: MujocoFile, content: Content, ledger: Ledger) -> None:
        self.content = content
        self._file = file
        self._ledger = ledger

    def play(self, clip: FileClip) -> FileClip:
        """Return the clip of poses T_world_link (k, 4, 4) that MuJoCo computes from a track; report open loops."""
        return play_track(self._file.model, self._file.bodies, clip, self._ledger)

    def check_limits(self, name: str, low: Mapping[str, float], high: Mapping[str, float]) -> None:
        """Compare the joint ranges of the file with the joint limits in the track `name`, in m or rad."""
        check_limits(self._file.model, name, low, high, self._ledger)


def read(path: Path, ledger: Ledger, context: Context) -> Content:
    """Return the content of an MJCF file with its poses along the tracks, and report its faults.

    Raises:
        ReadError: the file is no MJCF, or MuJoCo rejects it.
    """
    admit(path)
    ledger.tool = "mujoco"
    ledger.version = mujoco.__version__
    file = read_mujoco(path, ledger)
    content = content_of(file, ledger)
    check_file(file, content, ledger)
    return played(MjcfTree(file, content, ledger), path, ledger, context)


def content_of(file: MujocoFile, ledger: Ledger) -> Content:
    """Return what an MJCF file contains, without motions, in the form of all formats."""
    model = file.model
    content = Content(ledger, "mjcf")
    content.facts = {
        "units": "m (MuJoCo)",
        "up_axis": "Z" if model.opt.gravity[2] < 0 else "?",
        "handedness": "right (MuJoCo)",
    }
    content.rest = _rest_poses(file)
    content.shapes = file.shapes
    content.colors, content.finishes = surface_colors(model)
    mechanism = compiled_mechanism(model, file.bodies)
    mechanism.motion_declarations, mechanism.contact_declarations = further_declarations(file.spec)
    mechanism.collides = _colliding(model)
    mechanism.robot = _robot_name(file.spec)
    mechanism.home = home_coordinates(file.path.read_text("utf-8", errors="replace"), model)
    mechanism.assumed = assumed_masses(file.path)
    mechanism.partly_shown = partly_shown(file.path) | _partly_read(model)
    content.mechanism = mechanism
    return content


def check_file(file: MujocoFile, content: Content, ledger: Ledger) -> None:
    """Report the faults that an MJCF file shows by itself: in its model, and against the claims of its comments."""
    text = file.path.read_text("utf-8", errors="replace")
    check_model(file.model, ledger, counts_from_home(text))
    # The controls at home hold the weights that the robot states. The weight of a mass that the file only assumes is
    # not among them, so that nothing can be said about controls that hold the robot.
    is_weighed = content.mechanism is None or not content.mechanism.assumed
    check_claims(text, file.model, balance_at_keyframe(file.model), is_weighed, ledger)


def _rest_poses(file: MujocoFile) -> dict[str, Array]:
    """Return {link: pose T_world_link (4, 4)} at home."""
    data = mujoco.MjData(file.model)
    mujoco.mj_kinematics(file.model, data)
    rest: dict[str, Array] = {}
    for name, body in file.bodies.items():
        w, x, y, z = data.xquat[body].tolist()
        rest[name] = poses.pose(poses.rotation([x, y, z, w]), data.xpos[body].copy())
    return rest


def _robot_name(spec: mujoco.MjSpec) -> str:
    """Return the name of the model; "" if the file states none, for which MuJoCo has a name of its own."""
    name = str(spec.modelname)
    return "" if name == mujoco.MjSpec().modelname else name


def _colliding(model: mujoco.MjModel) -> dict[str, bool]:
    """Return {body: True} of the bodies with a shape that can collide."""
    colliding = {}
    for geom in range(model.ngeom):
        if model.geom_contype[geom] or model.geom_conaffinity[geom]:
            colliding[model.body(int(model.geom_bodyid[geom])).name] = True
    return colliding


def _partly_read(model: mujoco.MjModel) -> frozenset[str]:
    """Return the names of bodies without a shape that collides, or with a shape that is not a mesh and is not read."""
    names: set[str] = set()
    for body in range(model.nbody):
        first = model.body_geomadr[body]
        end = first + model.body_geomnum[body]
        collides = model.geom_contype[first:end].any() or model.geom_conaffinity[first:end].any()
        has_only_meshes = (model.geom_type[first:end] == mujoco.mjtGeom.mjGEOM_MESH).all()
        if not collides or not has_only_meshes:
            names.add(model.body(body).name)
    return frozenset(names)


@dataclass(frozen=True)
class MujocoFile:
    """An MJCF file that MuJoCo accepts.

    Attributes:
        path: the file.
        spec: what the file declares, after default classes.
        model: what MuJoCo compiles of it, without contacts.
        bodies: {name of a link: MuJoCo's number of its body}; the world is among them if it is the robot's base.
        shapes: {body: shape of its meshes in the body's frame}.
    """

    path: Path
    spec: mujoco.MjSpec
    model: mujoco.MjModel
    bodies: dict[str, int]
    shapes: dict[str, LinkShape]


def read_mujoco(path: Path, ledger: Ledger) -> MujocoFile:
    """Return an MJCF file as MuJoCo reads it; `ledger` gets the faults of its mesh files.

    Raises:
        ReadError: the file is no MJCF, or MuJoCo rejects it.
    """
    root = parse_xml(path)
    if root.tag != "mujoco":
        raise ReadError(f"the root element is <{root.tag}>, expected <mujoco>")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        shapes = link_shapes(spec, path, ledger)
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ReadError(f"MuJoCo rejects the file: {str(error).strip()[:200]}") from error
    # The audit puts links where a track has them, also where they touch: contacts would only take time.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return MujocoFile(path, spec, model, _links(model, root), shapes)


def _links(model: mujoco.MjModel, root: ET.Element) -> dict[str, int]:
    """Return {name: number} of the bodies that are links of the robot."""
    first = 0 if _is_world_the_base(root) else 1
    links: dict[str, int] = {}
    for i in range(first, model.nbody):
        if model.body(i).name:
            links[model.body(i).name] = i
    return links


def _is_world_the_base(root: ET.Element) -> bool:
    """Return whether the world is the base of the robot: a joint connects a top-level body to the world."""
    return any(world.find("body/joint") is not None for world in root.iter("worldbody"))
