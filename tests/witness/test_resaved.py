"""Exports that other programs only saved again: the audit has nothing to say, but for what the program itself loses.

Of each robot one format is saved again, and audited without proof.json beside its tracks and, where it tells of joints
and masses, beside the other formats that do.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from math import inf
from pathlib import Path

import pytest

import twin
from twin.exchange.audit import audit

pytestmark = pytest.mark.witness

SEVERE = ("error", "disagreement")


def by_pxr(foreign, folder: Path) -> None:
    """Every layer as the text that it stands for."""
    from pxr import Sdf

    for file in sorted((folder / "usd").rglob("*.usd*")):
        layer = Sdf.Layer.OpenAsAnonymous(str(file))
        file.unlink()
        layer.Export(str(file), args={"format": "usda"} if file.suffix == ".usda" else {})


def flattened_by_pxr(foreign, folder: Path) -> None:
    from pxr import Usd

    file = next((folder / "usd").glob("*_sim.usda"))
    flat = Usd.Stage.Open(str(file)).Flatten()
    shutil.rmtree(folder / "usd")
    (folder / "usd").mkdir()
    flat.Export(str(file.with_suffix(".usdc")))


def by_mujoco(foreign, folder: Path) -> None:
    import mujoco

    for file in map(str, folder.glob("*.xml")):
        mujoco.mj_saveLastXML(file, mujoco.MjModel.from_xml_path(file))


def by_yourdfpy(foreign, folder: Path) -> None:
    file = next(folder.glob("*.urdf"))
    foreign.read("yourdfpy", "resave_yourdfpy.py", file, file)


def by_gltf_transform(*steps: str) -> Callable[..., None]:
    def save(foreign, folder: Path) -> None:
        file = next(folder.glob("*.glb"))
        aside = file.with_name("again.glb")
        assert foreign.read("gltf", "resave_gltf.mjs", file, aside, *steps)["steps"] == list(steps)
        aside.replace(file)

    return save


def by_trimesh(foreign, folder: Path) -> None:
    import trimesh

    file = next(folder.glob("*.glb"))
    trimesh.load(file).export(str(file))


def by_blender(foreign, folder: Path) -> None:
    file = next(folder.glob("*.glb"))
    rates = {json.loads(p.read_text("utf-8"))["rate"] for p in tracks(folder)}
    aside = file.with_name("again.glb")
    foreign.read("bpy", "resave_blender.py", file, aside, max(rates))
    aside.replace(file)


def tracks(folder: Path) -> list[Path]:
    return sorted(p for p in (folder / "tracks").glob("*.json") if not p.name.endswith(".schema.json"))


PHYSICS, SHAPES = ("tracks", "usd", "meshes", "*.xml", "*.urdf"), ("tracks", "*.glb")
SAVES: dict[str, tuple[Callable[..., None], tuple[str, ...], dict[str, float]]] = {
    "pxr": (by_pxr, PHYSICS, {}),
    "pxr, flattened": (flattened_by_pxr, PHYSICS, {}),
    "MuJoCo": (by_mujoco, PHYSICS, {"mjcf.loop": 3.0, "compare.pose": 3.0, "physics.row": 5e-6, "physics.sum": 3e-6}),
    "yourdfpy": (by_yourdfpy, PHYSICS, {"urdf.transmission": inf, "physics.existence": 1.0}),
    "gltf-transform": (by_gltf_transform(), SHAPES, {}),
    "gltf-transform, dedup": (by_gltf_transform("dedup"), SHAPES, {}),
    "gltf-transform, weld": (by_gltf_transform("weld"), SHAPES, {}),
    "gltf-transform, prune": (by_gltf_transform("prune"), SHAPES, {}),
    "trimesh": (by_trimesh, SHAPES, {"compare.no_motion": inf}),
    "Blender": (by_blender, SHAPES, {"compare.times": inf, "compare.pose": inf}),
}
"""Who saves: how, what of the export is there, and what the program itself loses: codes, and the largest size.

MuJoCo writes six digits: loops of HIBOU are 1.6 um open, belts of LAPBOT 2.1 um, and 1 um is what an export may have.
Half of the sixth digit of a factor is at most 5e-6 of it.
yourdfpy writes no transmissions, so that the file no longer says which joints are driven, and no mimic, so that it
lacks the coupling of the Raven's jaws; the audit must say so.
trimesh writes no motion. Blender has keys at whole frames only, begins a frame late and moves the last key: links are
up to 0.3 mm off at 120 Hz.
"""


ROBOTS = twin.names()
PAIRS = [
    (name, ROBOTS[(2 * i + k) % len(ROBOTS)])
    for i, name in enumerate(SAVES)
    for k in range(len(ROBOTS) if os.environ.get("TWIN_ALL_PROTOCOLS") else 2)
]
"""Each program saves two robots, so that every robot meets several programs; `TWIN_ALL_PROTOCOLS=1`: all of them."""


def saved_again(name: str, foreign, case, folder: Path) -> Path:
    """Copy the part of an export that a program saves again, and let it."""
    save, kept, _ = SAVES[name]
    folder.mkdir()
    for path in (p for pattern in kept for p in case.folder.glob(pattern)):
        (shutil.copytree if path.is_dir() else shutil.copy)(path, folder / path.name)
    save(foreign, folder)
    return folder


@pytest.mark.parametrize(("name", "case"), PAIRS, indirect=["case"])
def test_what_was_only_saved_again_has_no_findings(foreign, figures, case, tmp_path, name):
    lost = SAVES[name][2]
    report = audit(saved_again(name, foreign, case, tmp_path / case.robot))
    found = [f for f in report.findings if f.severity in SEVERE and (f.size or 0.0) > lost.get(f.code, -1.0)]
    figures.add(f"saved again: {name}", case.robot, "audit", float("nan"), float("nan"), f"{len(found)} findings")
    assert report.checks
    assert not found, [(f.code, f.where, f.size, f.message) for f in found]


FIELDS_LOST = {"yourdfpy": ("transmission ", "mimic "), "gltf-transform, prune": ("node ",)}
"""Who drops what of an export: transmissions and couplings; nodes without a mesh, which are the named frames."""


@pytest.mark.parametrize(("name", "case"), PAIRS[:: len(PAIRS) // len(SAVES)], indirect=["case"])
def test_the_fields_of_what_was_only_saved_again_are_those_of_a_new_export(foreign, case, tmp_path, name):
    """MuJoCo, trimesh and Blender structure a file in their own way: it is not compared, and a note says so."""
    report = twin.audit(saved_again(name, foreign, case, tmp_path / case.robot))
    found = [f for f in report.findings if f.code.startswith("export.") and f.code != "export.rewritten"]
    compared = "a new export" in {check.against for check in report.checks}
    assert compared or name == "Blender"  # whose motion has another number of keys
    assert all(f.message.startswith(FIELDS_LOST.get(name, ())) for f in found), found
    notes = [f.code for f in report.findings if f.code == "export.rewritten"]
    assert bool(notes) == (compared and name in ("MuJoCo", "trimesh", "Blender"))
