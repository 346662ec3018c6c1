"""Read an MJCF file as MuJoCo understands it: as a specification that can be searched, and as a compiled model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco

from twin.exchange.audit.file_content import LinkShape
from twin.exchange.audit.report import Ledger, ReadError
from twin.exchange.audit.xml_root import parse_xml
from twin.exchange.formats.mjcf.audit.shapes import link_shapes


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
