"""Exports of built-in robots, and lookalikes of them: one to five numbers changed, names kept or changed."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from pxr import Gf, Usd, UsdPhysics

from made.glb_apart import Glb

FORMATS = ("urdf", "mjcf", "usd", "glb")


def write(mechanism, kind: str, folder: Path) -> None:
    """Write a mechanism at rest in one format, without motion."""
    from twin.exchange.formats.glb.write import glb_bytes
    from twin.exchange.formats.mjcf.write import write_mjcf
    from twin.exchange.formats.urdf.write import write_urdf
    from twin.exchange.formats.usd.write import write_usd
    from twin.reference import ReferenceModel

    folder.mkdir(parents=True)
    if kind == "urdf":
        write_urdf(mechanism, folder)
    elif kind == "mjcf":
        write_mjcf(mechanism, folder)
    elif kind == "usd":
        (folder / "layers").mkdir()
        root = write_usd(mechanism, (), folder / "layers")[0]
        flat = Usd.Stage.Open(str(root)).Flatten()
        shutil.rmtree(folder / "layers")
        assert flat.Export(str(folder / f"{mechanism.name}.usda"))
    else:
        home = ReferenceModel(mechanism).home().link_poses
        (folder / f"{mechanism.name}.glb").write_bytes(glb_bytes(mechanism, [], home))


def change(folder: Path, kind: str, count: int, rng: np.random.Generator) -> list[str]:
    """Change `count` numbers of the robot in a folder; return what was changed."""
    by_format = {"urdf": _change_urdf, "mjcf": _change_mjcf, "usd": _change_usd, "glb": _change_glb}
    return [by_format[kind](folder, rng) for _ in range(count)]


def _moved(text: str, i: int, by: float) -> str:
    numbers = text.split()
    numbers[i] = repr(float(numbers[i]) + by)
    return " ".join(numbers)


def _one(items, rng):
    return items[rng.integers(len(items))]


def _step(rng: np.random.Generator) -> float:
    """Return a length of 0.5 to 20 mm, or an angle of 0.03 to 1.1 deg, with a sign."""
    return float(rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(5e-4), np.log(2e-2))))


def _change_urdf(folder: Path, rng: np.random.Generator) -> str:
    (file,) = folder.glob("*.urdf")
    tree = ET.parse(file)
    joints = [j for j in tree.getroot().findall("joint") if j.find("origin") is not None]
    singles = [j for j in joints if j.get("type") in ("revolute", "prismatic")]
    limited = [j for j in singles if abs(float(j.find("limit").get("upper"))) < 1e3]
    masses = [e for e in tree.getroot().findall("link") if e.find("inertial/mass") is not None]
    masses = [e for e in masses if float(e.find("inertial/mass").get("value")) > 1e-4]
    what = rng.choice(["xyz", "rpy", "limit", "mass"], p=[0.4, 0.3, 0.15, 0.15])
    if what in ("xyz", "rpy"):
        joint = _one(joints, rng)
        origin = joint.find("origin")
        axis = int(rng.integers(3))
        origin.set(what, _moved(origin.get(what) or "0 0 0", axis, _step(rng)))
        done = f"{what}[{axis}] of {joint.get('name')}"
    elif what == "limit":
        joint = _one(limited, rng)
        limit = joint.find("limit")
        limit.set("upper", repr(float(limit.get("upper")) + abs(_step(rng))))
        done = f"limit of {joint.get('name')}"
    else:
        link = _one(masses, rng)
        mass = link.find("inertial/mass")
        mass.set("value", repr(float(mass.get("value")) * 1.07))
        done = f"mass of {link.get('name')}"
    tree.write(file)
    return done


def _change_mjcf(folder: Path, rng: np.random.Generator) -> str:
    (file,) = folder.glob("*.xml")
    tree = ET.parse(file)
    bodies = [b for b in tree.getroot().iter("body") if b.get("pos") is not None and b.find("joint") is not None]
    joints = [j for b in bodies for j in b.findall("joint")]
    masses = [b for b in bodies if b.find("inertial") is not None and float(b.find("inertial").get("mass")) > 2e-3]
    what = rng.choice(["body", "anchor", "range", "mass"], p=[0.4, 0.3, 0.15, 0.15])
    if what == "body":
        body = _one(bodies, rng)
        axis = int(rng.integers(3))
        body.set("pos", _moved(body.get("pos"), axis, _step(rng)))
        done = f"pos[{axis}] of body {body.get('name')}"
    elif what == "anchor":
        hinges = [j for j in joints if j.get("type", "hinge") == "hinge"]
        joint = _one(hinges, rng)
        along = np.array(joint.get("axis", "0 0 1").split(), float)
        axis = int(np.argmin(np.abs(along)))
        joint.set("pos", _moved(joint.get("pos", "0 0 0"), axis, _step(rng)))
        done = f"pos[{axis}] of joint {joint.get('name')}"
    elif what == "range":
        joint = _one([j for j in joints if j.get("range")], rng)
        joint.set("range", _moved(joint.get("range"), 1, abs(_step(rng))))
        done = f"range of {joint.get('name')}"
    else:
        body = _one(masses, rng)
        inertial = body.find("inertial")
        inertial.set("mass", repr(float(inertial.get("mass")) * 1.07))
        done = f"mass of {body.get('name')}"
    tree.write(file)
    return done


def _change_usd(folder: Path, rng: np.random.Generator) -> str:
    (file,) = folder.glob("*.usda")
    stage = Usd.Stage.Open(str(file))
    stage.Reload()
    joints = [UsdPhysics.Joint(p) for p in stage.Traverse() if p.IsA(UsdPhysics.Joint)]
    joints = [j for j in joints if j.GetBody0Rel().GetTargets() and j.GetBody1Rel().GetTargets()]
    what = rng.choice(["place", "turn", "limit"], p=[0.4, 0.4, 0.2])
    if what == "limit":
        joint = _one([j for j in joints if j.GetPrim().HasAttribute("physics:upperLimit")], rng)
        attribute = joint.GetPrim().GetAttribute("physics:upperLimit")
        attribute.Set(attribute.Get() + 1.0)
    elif what == "place":
        joint = _one([j for j in joints if not j.GetPrim().IsA(UsdPhysics.PrismaticJoint)], rng)
        token = str(joint.GetPrim().GetAttribute("physics:axis").Get() or "")
        across = Gf.Vec3d(0, 0, 1) if token == "X" else Gf.Vec3d(1, 0, 0)
        step = Gf.Rotation(Gf.Quatd(joint.GetLocalRot0Attr().Get())).TransformDir(across * _step(rng))
        joint.GetLocalPos0Attr().Set(joint.GetLocalPos0Attr().Get() + Gf.Vec3f(step))
    else:
        joint = _one([j for j in joints if not j.GetPrim().IsA(UsdPhysics.SphericalJoint)], rng)
        turn = Gf.Rotation(Gf.Vec3d(*rng.normal(size=3)), float(np.degrees(_step(rng))))
        joint.GetLocalRot0Attr().Set(Gf.Quatf(turn.GetQuat()) * joint.GetLocalRot0Attr().Get())
    stage.GetRootLayer().Save()
    return f"{what} of {joint.GetPrim().GetName()}"


def _change_glb(folder: Path, rng: np.random.Generator) -> str:
    (file,) = folder.glob("*.glb")
    glb = Glb(file.read_bytes())
    nodes = [n for n in glb.links() if n.get("translation")]
    node = _one(nodes, rng)
    axis = int(rng.integers(3))
    node["translation"][axis] += _step(rng)
    file.write_bytes(glb.bytes())
    return f"translation[{axis}] of {node['name']}"


def rename(folder: Path, kind: str) -> None:
    """Give all links and joints other names."""
    if kind in ("urdf", "mjcf"):
        for file in (*folder.glob("*.urdf"), *folder.glob("*.xml")):
            _rename_xml(file)
    elif kind == "glb":
        (file,) = folder.glob("*.glb")
        glb = Glb(file.read_bytes())
        for i, node in enumerate(glb.document["nodes"]):
            node["name"] = f"node{i}"
            node.pop("extras", None)
        glb.document.get("scenes", [{}])[0].pop("extras", None)
        file.write_bytes(glb.bytes())
    else:
        _rename_usd(folder)


def _rename_xml(file: Path) -> None:
    text = file.read_text()
    root = ET.fromstring(text)
    names = {e.get("name") for tag in ("link", "joint", "body", "freejoint") for e in root.iter(tag) if e.get("name")}
    order = {n: f"p{i}x" for i, n in enumerate(sorted(names))}

    def other(match: re.Match) -> str:
        return f'{match[1]}="{order.get(match[2], match[2])}"'

    keys = "name|link|joint|joint1|joint2|body1|body2|objname"
    file.write_text(re.sub(rf'\b({keys})="([^"]+)"', other, text))
    closures = file.with_suffix(".yaml")  # the loops of a URDF, whose joints and links have the names of the URDF
    if closures.is_file():
        names_of_loops = re.sub(r'"([^"]+)"', lambda m: f'"{order.get(m[1], m[1])}"', closures.read_text())
        closures.write_text(names_of_loops)


def _rename_usd(folder: Path) -> None:
    (file,) = folder.glob("*.usda")
    stage = Usd.Stage.Open(str(file))
    stage.Reload()
    named = {p.GetName() for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI) or p.IsA(UsdPhysics.Joint)}
    text = file.read_text()
    for i, name in enumerate(sorted(named)):
        text = re.sub(rf'(def \w+ )"{name}"', rf'\1"p{i}x"', text)
        text = re.sub(rf"(?<=/){name}(?=[/>.])", f"p{i}x", text)
        text = re.sub(rf'(twin:base = )"{name}"', rf'\1"p{i}x"', text)
    file.write_text(text)
