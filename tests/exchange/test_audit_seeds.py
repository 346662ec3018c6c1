"""Seeded defects in whole exports are found without hashes, by their right cause; what is only saved again is not.

By default a few kinds on a small robot; `-m slow` some on a real one. `TWIN_SEEDS=all` seeds every kind in every one
of `TWIN_SEEDS_ROBOTS` (pa10,sher,sils), which takes half an hour.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from made.lanes import thinned
from twin.exchange.audit import audit

HERE = Path(__file__).parents[1]
from made import audit_review as review
from made import audit_seeds as seeds
from made import bundle as base

EVERY = os.environ.get("TWIN_SEEDS") == "all"
ROBOTS = os.environ.get("TWIN_SEEDS_ROBOTS", "pa10,sher,sils").split(",")
LEAST = 0.98
"""Share of the seeded defects that must be found by their right cause."""

FEW = (
    *("USD: loop joint deleted", "USD: driven joint passive", "usd_gravity_981", "usd_colour"),
    *("MJCF: loop tie deleted", "MJCF: actuator deleted", "MJCF: mass x 1000", "MJCF: gravity up"),
    *("URDF: inertia negative", "URDF: mass centre", "URDF: speed x 1000"),
    *("tracks: assumed emptied", "tracks: between_position claimed 1 um", "GLB: STEP", "OBJ: vertex 3 mm"),
)
"""Kinds that are seeded by default."""


@pytest.fixture(scope="module")
def bars(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


def of(name: str):
    return next(s for s in seeds.SEEDS if s.name == name)


@pytest.mark.parametrize("name", thinned(FEW, every=4))
def test_a_seeded_defect_is_found_by_its_cause(name, bars, tmp_path):
    one, folder = of(name), tmp_path / "spoilt"
    assert seeds.copied(bars, folder, one), "this robot has nothing of the kind"
    report = audit(folder)
    assert seeds.found(report, one), [(f.code, f.where, f.message) for f in report.findings]


def test_seeds_are_many_and_have_names_of_their_own():
    names = [s.name for s in seeds.SEEDS]
    assert len(set(names)) == len(names) >= 144
    assert set(FEW) <= set(names)


def test_each_kind_that_an_outsider_seeded_is_seeded_here():
    names = {s.name for s in seeds.SEEDS}
    kinds = {**review.PASSED, **review.FOUND}
    assert len(kinds) == len(review.PASSED) + len(review.FOUND)
    assert not {kind: lost for kind, ours in kinds.items() if (lost := set(ours) - names) or not ours}
    assert len({name for ours in kinds.values() for name in ours}) >= 84


def share_found(bundles, chosen, tmp_path) -> tuple[float, list[str]]:
    """Return the share of the seeds in bundles by robot that were found, and those that were not."""
    count, missed = 0, []
    for name, bundle in bundles.items():
        for one in chosen:
            if not seeds.copied(bundle, tmp_path / "spoilt", one):
                continue
            count += 1
            report = audit(tmp_path / "spoilt")
            if not seeds.found(report, one):
                told = [f"{f.code} {f.where}" for f in report.findings if f.severity in ("disagreement", "error")]
                missed.append(f"{name}: {one.name}: {told[:3]}")
    print(f"{count - len(missed)} of {count} seeded defects found by their cause", *missed, sep="\n  ")
    return 1 - len(missed) / count, missed


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> dict[str, Path]:
    """Return exports of real robots with one protocol and few keys: nothing else is seeded in the others."""
    return seeds.exported(ROBOTS if EVERY else ROBOTS[:1], tmp_path_factory.mktemp("real"))


@pytest.mark.slow
def test_kinds_of_defects_in_real_robots_are_found(real, tmp_path):
    chosen = seeds.SEEDS if EVERY else [s for i, s in enumerate(seeds.SEEDS) if i % 64 == 7]
    share, missed = share_found(real, chosen, tmp_path)
    assert share >= LEAST, missed


@pytest.mark.slow
def test_exports_of_real_robots_have_no_findings_without_their_proof(real, tmp_path):
    for name, bundle in real.items():
        shutil.copytree(bundle, tmp_path / name)
        (tmp_path / name / "proof.json").unlink()
        assert not base.grave(audit(tmp_path / name).findings), name


# ------------------------------------------------------------------------------------------------ saved again


def saved_by_pxr(folder: Path) -> None:
    from pxr import Sdf

    for file in [*folder.glob("usd/*.usda")]:
        layer = Sdf.Layer.OpenAsAnonymous(str(file))
        file.unlink()
        layer.Export(str(file), args={"format": "usda"})


def flattened(folder: Path) -> None:
    from pxr import Usd

    file = folder / "usd/bars_sim.usda"
    flat = Usd.Stage.Open(str(file)).Flatten()
    for other in (folder / "usd").rglob("*"):
        if other.is_file():
            other.unlink()
    flat.Export(str(file.with_suffix(".usdc")))


def saved_by_mujoco(folder: Path) -> None:
    import mujoco

    file = str(folder / "bars.xml")
    mujoco.mj_saveLastXML(file, mujoco.MjModel.from_xml_path(file))


def indented(folder: Path) -> None:
    import json

    for file in (folder / "tracks").glob("*.json"):
        file.write_text(json.dumps(json.loads(file.read_text()), indent=1))


def indented_xml(folder: Path) -> None:
    from xml.etree import ElementTree as ET

    for file in (folder / "bars.urdf", folder / "bars.xml"):
        tree = ET.ElementTree(ET.fromstring(file.read_bytes()))
        ET.indent(tree, "\t")
        tree.write(file)


def saved_by_trimesh(folder: Path) -> None:
    import trimesh

    scene = trimesh.load(folder / "bars.glb")
    scene.export(str(folder / "bars.glb"))


@pytest.mark.parametrize(
    "save",
    thinned([saved_by_pxr, saved_by_mujoco, flattened, indented, indented_xml, saved_by_trimesh], every=6),
    ids=lambda f: f.__name__,
)
def test_what_is_only_saved_again_has_no_findings(save, bars, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(bars, folder)
    (folder / "proof.json").unlink()
    save(folder)
    found = [f for f in base.grave(audit(folder).findings) if f.code not in LOST.get(save.__name__, ())]
    assert not found, [(f.code, f.where, f.message) for f in found]


LOST = {"saved_by_trimesh": ("compare.no_motion",)}
"""What a program does lose, and is told: trimesh writes no animation."""
