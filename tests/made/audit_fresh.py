"""Sixty defects of several fields at once, written by hand after the campaign of `audit_every_field`, over five robots.

    python tests/made/audit_fresh.py --good FOLDER [--robot]

prints what the audit says of each, and how many it found by their cause.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from made import audit_every_field
from made.audit_every_field import Change, glb_edit, tracks, written
from made.audit_every_field_run import exported
from made.glb_apart import Glb

ROBOTS = ("sils", "sher", "davinci_psm", "raven_left", "pa10")

FRESH: list[tuple[str, str, Callable[[Path], bool | None], str, str]] = []
"""(part, name, edit, glob of the changed file, words of the cause)."""


def glb(name: str, says: str) -> Callable[[Callable[[Glb], bool | None]], None]:
    def add(change: Callable[[Glb], bool | None]) -> None:
        def edit(folder: Path) -> bool | None:
            return glb_edit(next(folder.glob("*.glb")).name, change)(folder)

        FRESH.append(("glb", name, edit, "*.glb", says))

    return add


def track(name: str, says: str) -> Callable[[Callable[[dict[str, Any]], bool | None]], None]:
    def add(change: Callable[[dict[str, Any]], bool | None]) -> None:
        def edit(folder: Path) -> bool | None:
            path = folder / tracks(folder)[0]
            data = json.loads(path.read_text("utf-8"))
            if change(data) is False:
                return False
            written(path, json.dumps(data))
            return True

        FRESH.append(("tracks", name, edit, "tracks/*.json", says))

    return add


def table(name: str, says: str) -> Callable[[Callable[[list[str], int], list[str]]], None]:
    def add(change: Callable[[list[str], int], list[str]]) -> None:
        def edit(folder: Path) -> None:
            path = folder / tracks(folder)[0].replace(".json", ".csv")
            lines = path.read_text("utf-8").splitlines()
            first = next(i for i, line in enumerate(lines) if not line.startswith("#"))
            written(path, "\n".join(change(lines, first)) + "\n")

        FRESH.append(("csv", name, edit, "tracks/*.csv", says))

    return add


def package(name: str, says: str) -> Callable[[Callable[[Path], bool | None]], None]:
    def add(edit: Callable[[Path], bool | None]) -> None:
        FRESH.append(("unity", name, edit, "unity", says))

    return add


def arrays(data: Glb, path: str) -> list[np.ndarray]:
    """Return the key values of all channels of a path, each array once."""
    seen = {sampler["output"] for _, sampler in data.channels(path)}
    return [data.numbers(accessor) for accessor in sorted(seen)]


def restated(data: Glb) -> None:
    for role, accessor in audit_every_field.roles(data):
        if role in ("mesh POSITION", "key times"):
            audit_every_field._told(data, accessor)


# ------------------------------------------------------------------------------------------------------------- GLB


@glb("link hidden by an extension", "visib|hidden|mesh|extension|shown")
def _(data):
    data.document["extensionsUsed"] = ["KHR_node_visibility"]
    data.links()[-1]["extensions"] = {"KHR_node_visibility": {"visible": False}}


@glb("part of another link attached", "mesh|bounding|surface|volume|node")
def _(data):
    meshes = [n["mesh"] for n in data.links() if "mesh" in n]
    node = data.links()[-1]
    node.setdefault("children", []).append(len(data.document["nodes"]))
    data.document["nodes"].append({"name": "stray", "mesh": meshes[0], "translation": [0.1, 0, 0]})


@glb("shifted node between root and link", "link")
def _(data):
    root = data.document["nodes"][0]
    moved = root["children"].pop()
    root["children"].append(len(data.document["nodes"]))
    data.document["nodes"].append({"name": "between", "translation": [0, 0.001, 0], "children": [moved]})


@glb("link below another link", "link")
def _(data):
    root = data.document["nodes"][0]
    moved = root["children"].pop(2)
    data.document["nodes"][root["children"][-1]].setdefault("children", []).append(moved)


@glb("a clip twice under another name", "clip")
def _(data):
    clip = json.loads(json.dumps(data.document["animations"][0]))
    data.document["animations"].append({**clip, "name": "other"})


@glb("root animated", "link|axis")
def _(data):
    animation = data.document["animations"][0]
    channel = next(c for c in animation["channels"] if c["target"]["path"] == "rotation")
    animation["channels"].append({"sampler": channel["sampler"], "target": {"node": 0, "path": "rotation"}})


@glb("scale animated", "scale")
def _(data):
    animation = data.document["animations"][0]
    channel = next(c for c in animation["channels"] if c["target"]["path"] == "translation")
    node = channel["target"]["node"]
    animation["channels"].append({"sampler": channel["sampler"], "target": {"node": node, "path": "scale"}})


@glb("morph target with a weight", "morph|target|weight|mesh")
def _(data):
    mesh = data.document["meshes"][0]
    for primitive in mesh["primitives"]:
        primitive["targets"] = [{"POSITION": primitive["attributes"]["NORMAL"]}]
    mesh["weights"] = [0.01]


@glb("vertex colours", "colo|COLOR")
def _(data):
    primitive = data.document["meshes"][0]["primitives"][0]
    primitive["attributes"]["COLOR_0"] = primitive["attributes"]["NORMAL"]


def _first_primitive(data: Glb) -> Any:
    return data.document["meshes"][0]["primitives"][0]


@glb("surface without points", "POSITION")
def _(data):
    del _first_primitive(data)["attributes"]["POSITION"]


@glb("surface twice", "twice")
def _(data):
    data.document["meshes"][0]["primitives"].append(dict(_first_primitive(data)))


@glb("one mesh has no attributes.NORMAL: gone", "NORMAL")
def _(data):
    for primitive in data.document["meshes"][0]["primitives"]:
        del primitive["attributes"]["NORMAL"]


@glb("normals 1 % too long", "normal")
def _(data):
    data.numbers(_first_primitive(data)["attributes"]["NORMAL"])[:] *= 1.01


@glb("surface without material", "colour|metallic")
def _(data):
    del _first_primitive(data)["material"]


@glb("frames outside of the scene", "frame")
def _(data):
    for node in data.links():
        node.pop("children", None)


@glb("node of a frame without name", "frame")
def _(data):
    node = next((node for node in data.document["nodes"] if "frame" in node.get("extras", {})), None)
    if node is None:
        return False
    del node["name"]
    return None


@glb("link without list of joints", "joints")
def _(data):
    del data.links()[0]["extras"]["joints"]


@glb("texture over a colour", "colo|textur|image")
def _(data):
    pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
    data.document["images"] = [{"uri": f"data:image/png;base64,{pixel}"}]
    data.document["textures"] = [{"source": 0}]
    data.document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}


@glb("a skin on a link", "skin")
def _(data):
    node = next(n for n in data.links() if "mesh" in n)
    data.document["skins"] = [{"joints": [0, 1]}]
    node["skin"] = 0


@glb("keys of a link one key late", "link")
def _(data):
    values = arrays(data, "rotation")[-1]
    values[:] = np.roll(values, 1, axis=0)


@glb("motion backwards", "link")
def _(data):
    for path in ("translation", "rotation"):
        for values in arrays(data, path):
            values[:] = values[::-1].copy()


@glb("conjugate quaternions of a link", "link")
def _(data):
    values = arrays(data, "rotation")[-1]
    values[:, :3] *= -1


@glb("translations relative to the first link that moves", "link")
def _(data):
    moving = arrays(data, "translation")
    if len(moving) < 2:
        return False
    moving[-1][:] -= moving[0]
    return None


@glb("last fifth of the keys lost", "lasts|time|key")
def _(data):
    done = set()
    for path in ("translation", "rotation"):
        for _, sampler in data.channels(path):
            for accessor in (sampler["input"], sampler["output"]):
                if accessor not in done:
                    done.add(accessor)
                    spec = data.document["accessors"][accessor]
                    spec["count"] = int(spec["count"] * 0.8)
    restated(data)


@glb("rotations with two decimals", "link|quaternion")
def _(data):
    for values in arrays(data, "rotation"):
        rounded = np.round(values, 2)
        values[:] = rounded / np.linalg.norm(rounded, axis=1, keepdims=True)


@glb("half of the triangles of a mesh", "mesh|closed|surface")
def _(data):
    spec = data.document["accessors"][data.document["meshes"][0]["primitives"][0]["indices"]]
    spec["count"] = spec["count"] // 6 * 3


@glb("mesh 0.3 mm aside", "mesh|bounding|surface")
def _(data):
    for primitive in data.document["meshes"][-1]["primitives"]:
        data.numbers(primitive["attributes"]["POSITION"])[:, 0] += 3e-4
    restated(data)


@glb("mesh mirrored with its winding", "mesh|bounding|surface|volume")
def _(data):
    for primitive in data.document["meshes"][-1]["primitives"]:
        for attribute in ("POSITION", "NORMAL"):
            data.numbers(primitive["attributes"][attribute])[:, 1] *= -1
        corners = data.numbers(primitive["indices"]).reshape(-1, 3)
        corners[:, [1, 2]] = corners[:, [2, 1]]
    restated(data)


@glb("masses of two links exchanged", "mass")
def _(data):
    a, b = [n["extras"] for n in data.links() if "mass" in n["extras"]][:2]
    a["mass"], b["mass"] = b["mass"], a["mass"]


@glb("joint lists of two links exchanged", "joint")
def _(data):
    a, b = [n["extras"] for n in data.links() if n["extras"].get("joints")][:2]
    a["joints"], b["joints"] = b["joints"], a["joints"]


@glb("frame on another link", "frame")
def _(data):
    i = next(i for i, n in enumerate(data.document["nodes"]) if "frame" in n.get("extras", {}))
    owner = next(n for n in data.document["nodes"] if i in n.get("children", []) and n is not data.document["nodes"][0])
    owner["children"].remove(i)
    other = next(n for n in data.links() if n is not owner)
    other.setdefault("children", []).append(i)


@glb("materials of two links exchanged", "colour")
def _(data):
    parts = [p for m in data.document["meshes"] for p in m["primitives"]]
    colours = [m["pbrMetallicRoughness"]["baseColorFactor"] for m in data.document["materials"]]
    for b in parts[1:]:
        a = parts[0]
        if np.abs(np.subtract(colours[a["material"]], colours[b["material"]])).max() > 0.1:
            a["material"], b["material"] = b["material"], a["material"]
            return None
    return False


@glb("default scene with half of the links", "scene")
def _(data):
    nodes = data.document["nodes"]
    children = nodes[0]["children"]
    nodes.append({"name": "half", "rotation": nodes[0]["rotation"], "children": children[len(children) // 2 :]})
    nodes[0]["children"] = children[: len(children) // 2]
    data.document["scenes"].append({"nodes": [len(nodes) - 1]})
    data.document["scene"] = 1


@glb("root 10 mm aside", "link|scene|axis")
def _(data):
    data.document["nodes"][0]["translation"] = [0.01, 0, 0]


@glb("STEP for one link", "between|jumps")
def _(data):
    _, sampler = list(data.channels("rotation"))[-1]
    sampler["interpolation"] = "STEP"


# ---------------------------------------------------------------------------------------------------------- tracks


@track("all links 5 mm up", "link")
def _(data):
    seven = np.array(data["poses"]).reshape(-1, 7)
    seven[:, 2] += 0.005
    data["poses"] = seven.ravel().tolist()


@track("names of two phases exchanged", "phase")
def _(data):
    names = data["phases"]
    if len(set(names)) < 2:
        return False
    names[0], names[-1] = names[-1], names[0]
    return None


@track("tool turned by half a degree", "tool|frame")
def _(data):
    data["tool_frame"][3:] = [0.0043633, 0, 0, 0.9999905]


@track("everything 0.1 % slower", "lasts|time|rate")
def _(data):
    for key in ("times", "phase_start", "phase_end"):
        data[key] = [1.001 * t for t in data[key]]
    data["rate"] /= 1.001


@track("a joint a turn further", "joint|limit")
def _(data):
    n = len(data["joints"])
    k = data["joint_types"].index("revolute")
    for i in range(k, len(data["positions"]), n):
        data["positions"][i] += 2 * np.pi


@track("zero of a joint 0.01 aside, limits as well", "limit|joint")
def _(data):
    n = len(data["joints"])
    for i in range(0, len(data["positions"]), n):
        data["positions"][i] -= 0.01
    for key in ("joint_lower", "joint_upper"):
        data[key][0] -= 0.01


@track("links in another order than poses", "link")
def _(data):
    data["links"] = data["links"][1:] + data["links"][:1]


@track("RCM 1 mm aside everywhere", "RCM")
def _(data):
    if not data["rcm"]:
        return False
    data["rcm"][0] += 0.001
    data["phase_rcm"] = (np.array(data["phase_rcm"]).reshape(-1, 3) + np.array([0.001, 0, 0])).ravel().tolist()
    return None


@track("last phase lost", "phase")
def _(data):
    if len(data["phases"]) < 2:
        return False
    for key in ("phases", "phase_start", "phase_end", "phase_has_rcm", "phase_rcm_enforced"):
        data[key] = data[key][:-1]
    data["phase_rcm"] = data["phase_rcm"][:-3]
    return None


@track("frames on each other's links", "frame")
def _(data):
    links = data["frame_links"]
    k = next((i for i, link in enumerate(links) if link != links[0]), None)
    if k is None:
        return False
    links[0], links[k] = links[k], links[0]
    return None


@track("every joint driven", "driven|active")
def _(data):
    if all(data["joint_active"]):
        return False
    data["joint_active"] = [1] * len(data["joint_active"])
    return None


@track("positions in whole millimetres", "link")
def _(data):
    seven = np.array(data["poses"]).reshape(-1, 7)
    seven[:, :3] = seven[:, :3].round(3)
    data["poses"] = seven.ravel().tolist()


@track("a link too many", "link")
def _(data):
    count = len(data["times"])
    seven = np.array(data["poses"]).reshape(count, -1, 7)
    extra = np.tile([0, 0, 0, 0, 0, 0, 1.0], (count, 1, 1))
    data["links"].append("ghost")
    data["poses"] = np.concatenate([seven, extra], axis=1).ravel().tolist()


@track("first key lost", "key|lasts|time")
def _(data):
    n = len(data["joints"])
    m = 7 * len(data["links"])
    data["times"] = [t - data["times"][1] for t in data["times"][1:]]
    data["positions"] = data["positions"][n:]
    data["poses"] = data["poses"][m:]
    data["frames"] -= 1


@track("RCM no longer enforced", "enforced|RCM|phase")
def _(data):
    if not any(data["phase_rcm_enforced"]):
        return False
    data["phase_rcm_enforced"] = [0] * len(data["phase_rcm_enforced"])
    return None


# ------------------------------------------------------------------------------------------------------------- CSV


@table("columns apart by semicolons", "read|column|lacks")
def _(lines, first):
    return [*lines[:first], *(line.replace(",", ";") for line in lines[first:])]


@table("x and y of a link exchanged", "link")
def _(lines, first):
    columns = lines[first].split(",")
    k = max(i for i, name in enumerate(columns) if name.endswith("_x_m"))
    for i in range(first + 1, len(lines)):
        cells = lines[i].split(",")
        cells[k], cells[k + 1] = cells[k + 1], cells[k]
        lines[i] = ",".join(cells)
    return lines


@table("rows backwards", "time|key")
def _(lines, first):
    return [*lines[: first + 1], *reversed(lines[first + 1 :])]


@table("every second row, with half the rate", "key|rate|frames|in tracks")
def _(lines, first):
    rows = lines[first + 1 :: 2]
    head = []
    for line in lines[:first]:
        if line.startswith("# rate:"):
            line = f"# rate: {float(line.split(':')[1]) / 2}"
        if line.startswith("# frames:"):
            line = f"# frames: {len(rows)}"
        head.append(line)
    return [*head, lines[first], *rows]


# ------------------------------------------------------------------------------------------------------------ Unity


def class_file(folder: Path) -> Path:
    return next((folder / "unity/Runtime/Robots").glob("*.cs"))


def renewed(folder: Path, change: Callable[[str], str]) -> bool:
    """Change a class, and state the hashes that its parts then have."""
    from twin.exchange.formats.unity.audit import kinematics

    path = class_file(folder)
    old = path.read_text("utf-8")
    text = change(old)
    parts = kinematics._parts(text)

    def hashed(match: re.Match[str]) -> str:
        return f"//   {kinematics._hash(parts[match['name']])} {match['name']}"

    written(path, kinematics._HASH.sub(hashed, text))
    return text != old


def numbers_of(text: str, name: str, change: Callable[[list[str]], None]) -> str:
    match = re.search(rf"{name} = \{{([^}}]*)\}}", text)
    assert match is not None
    entries = re.findall(r"\([^)]*\)|[^,\s]+", match[1])
    change(entries)
    return text[: match.start(1)] + " " + ", ".join(entries) + " " + text[match.end(1) :]


def more(i: int, by: float) -> Callable[[list[str]], None]:
    def change(entries: list[str]) -> None:
        entries[i] = repr(float(entries[i].strip("()")) + by)

    return change


@package("limit in the class, new hash", "limit|bound")
def _(folder):
    def first_finite(entries: list[str]) -> None:
        i = next(i for i, entry in enumerate(entries) if "Infinity" not in entry)
        more(i, 0.01)(entries)

    return renewed(folder, lambda text: numbers_of(text, "jointLimits", first_finite))


@package("limit and bound in the class, new hash", "limit")
def _(folder):
    text = class_file(folder).read_text("utf-8")
    driven = re.search(r'string\[\] joints = \{\s*"(\w+)"', text)
    every = re.search(r"string\[\] allJoints = \{([^}]*)\}", text)
    assert driven
    assert every
    i = re.findall(r'"([^"]*)"', every[1]).index(driven[1])

    def change(old: str) -> str:
        return numbers_of(numbers_of(old, "jointLimits", more(2 * i, -0.01)), "boundLeast", more(0, -0.01))

    return renewed(folder, change)


@package("masses in the class exchanged, new hash", "mass")
def _(folder):
    def exchanged(entries: list[str]) -> None:
        entries[0], entries[1] = entries[1], entries[0]

    return renewed(folder, lambda text: numbers_of(text, "linkMasses", exchanged))


@package("joint in the class 0.5 mm aside, new hash", "joint|distance|link")
def _(folder):
    return renewed(folder, lambda text: numbers_of(text, "jointFrames", more(24 + 3, 5e-4)))


@package("tool in the class 1 mm aside, new hash", "tool")
def _(folder):
    return renewed(folder, lambda text: numbers_of(text, "toolFrame", more(11, 1e-3)))


@package("a sign in a method of the class", "changed after|hash")
def _(folder):
    path = class_file(folder)
    text = path.read_text("utf-8")
    i = text.index("private void WriteEnd")
    k = text.index(" - ", i) if " - " in text[i:] else text.index(" + ", i)
    written(path, text[:k] + (" + " if text[k : k + 3] == " - " else " - ") + text[k + 3 :])
    return True


@package("class of another robot", "robot|link|joint|model")
def _(folder):
    path = class_file(folder)
    text = path.read_text("utf-8")
    others = [p for p in EXPORTS[0].glob("*/unity/Runtime/Robots/*.cs") if p.name != path.name]
    written(path, others[0].read_text("utf-8") if others else text.replace("links", "linkz"))
    return bool(others)


@package("class and its .meta removed", "Kinematics|Robots|class")
def _(folder):
    shutil.rmtree(folder / "unity/Runtime/Robots")
    (folder / "unity/Runtime/Robots.meta").unlink()
    (folder / "README.txt").unlink()  # it would say why an export has no class


@package("script in UTF-16", "Playhead")
def _(folder):
    path = folder / "unity/Runtime/Playhead.cs"
    written(path, path.read_text("utf-8").encode("utf-16"))


@package("samples removed", "Samples|sample")
def _(folder):
    shutil.rmtree(folder / "unity/Samples~")


@package("assembly and its .meta removed", "asmdef|assembly")
def _(folder):
    for name in ("Twin.Player.asmdef", "Twin.Player.asmdef.meta"):
        (folder / "unity/Runtime" / name).unlink()


@package("two golden vectors exchanged", "golden")
def _(folder):
    path = folder / "unity/Runtime/Resources/twin-golden.json"
    data = json.loads(path.read_text("utf-8"))
    data["point_gltfast"], data["point_urdf"] = data["point_urdf"], data["point_gltfast"]
    written(path, json.dumps(data))


EXPORTS: list[Path] = []
"""Folder of the exports of all robots."""


def chosen(i: int, part: str, name: str, edit: Any, file: str, says: str, work: Path) -> tuple[str, Change]:
    """Change the export of the first robot, in turn from number i, that has what a defect needs; return both."""
    for k in range(len(ROBOTS)):
        robot = ROBOTS[(i + k) % len(ROBOTS)]
        folder = exported(EXPORTS[0], robot, work)
        where = file
        if "*" in file:
            found = [path for path in folder.glob(file) if "schema" not in path.name]
            where = found[0].relative_to(folder).as_posix()
        change = Change(part, name, "", where, edit, says)
        if audit_every_field.copied(folder, work / "spoilt", change):
            return robot, change
    raise AssertionError(f"no robot has what '{name}' needs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--good", type=Path, help="folder of exports, by robot; they are written if it does not exist")
    parser.add_argument("--robot", action="store_true", help="compare with the mechanism, too")
    parser.add_argument("--only", default="", help="regular expression of names")
    given = parser.parse_args()
    import twin

    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        EXPORTS[:] = [given.good or work / "good"]
        found = run = 0
        for i, (part, name, edit, file, says) in enumerate(FRESH):
            if not re.search(given.only, name):
                continue
            robot, change = chosen(i, part, name, edit, file, says, work)
            told = audit_every_field.caused(twin.audit(work / "spoilt", robot if given.robot else None), change)
            run += 1
            found += told in ("found", "refused")
            print(f"{told[:200]:8} {robot}: {part}: {name}", flush=True)
        print(f"{found} of {run} found by their cause")


if __name__ == "__main__":
    main()
