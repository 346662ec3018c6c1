"""Whole mechanisms through `twin new`: our own in four formats against closed forms, others if they are there.

Every one goes file -> folder -> USD -> mechanism and must come back the same, at rest and moved.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from made.lanes import thinned
from twin.cad.build import read_mechanism
from twin.core import assets
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.reference import ReferenceModel
from twin.usd.read import read_stage

HERE = Path(__file__).parents[1]
MODELS = HERE / "data/importing/models"
OWN = sorted(p.name for p in MODELS.iterdir() if p.suffix != ".yaml")
from made import importing_same as same

PARALLEL = ("5bar_linkage", "5bar_linkage_iso6d", "cassie_like", "digit_like", "disney_like", "robot_delta")


def about_y(angle, p=(0.0, 0.0, 0.0)):
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]], p
    return T


def fourbar(q):
    """Closed form: crank turned by q about y, coupler and rocker by two circles that meet above."""
    B, D = 0.1 * np.array([np.sin(q), np.cos(q)]), np.array([0.2, 0.0])
    r, s, d = np.hypot(0.2, 0.06), 0.16, np.linalg.norm(D - B)
    a = (r**2 - s**2 + d**2) / (2 * d)
    e = (D - B) / d
    C = B + a * e + np.sqrt(r**2 - a**2) * np.array([-e[1], e[0]])
    coupler = np.arctan2(0.06, 0.2) - np.arctan2(C[1] - B[1], C[0] - B[0])
    rocker = np.arctan2(C[0] - D[0], C[1] - D[1])
    return {
        "crank": about_y(q),
        "coupler": about_y(coupler, (B[0], 0, B[1])),
        "rocker": about_y(rocker, (D[0], 0, D[1])),
    }


def slider(q):
    """Closed form: the crank's tip is at 50 mm, the rod is 150 mm long, the block stays on x."""
    x, z = 0.05 * np.cos(q), -0.05 * np.sin(q)
    block = x + np.sqrt(0.15**2 - z**2)
    return {
        "crank": about_y(q),
        "rod": about_y(np.arctan2(z, block - x), (x, 0, z)),
        "block": about_y(0, (block, 0, 0)),
    }


@pytest.mark.parametrize("name", OWN)
def test_every_format_gives_the_mechanism_of_the_closed_form(name):
    m = close(read(MODELS / name, guarded=False)).mechanism
    model, closed_form = ReferenceModel(m), {"fourbar": fourbar, "slider": slider}[Path(name).stem]
    drawn = closed_form(0.0)  # a stage may draw its bodies in any frame: how far they move is compared
    exact = 1e-9 if Path(name).suffix not in (".usda",) else 2e-7  # UsdPhysics joint frames are single precision
    assert model.home().worst_gap <= exact
    assert model.mobility(model.home().x).freedom == 1
    for q in (-0.9, -0.3, 0.0, 0.4, 0.95):
        state = model.solve(np.array([q]))
        assert state.worst_gap <= exact
        moved = same.moved_from_rest(m, state)
        for body, T in closed_form(q).items():
            np.testing.assert_allclose(moved[body], T @ np.linalg.inv(drawn[body]), atol=exact)


@pytest.mark.parametrize("name", OWN)
def test_own_models_go_to_a_folder_and_usd_and_come_back(name, tmp_path, rng):
    imported, folder, stage = same.made(MODELS / name, "own", tmp_path / "own")
    m = imported.mechanism
    assert len(m.loops) == 1
    (driven,) = m.active
    assert driven.limits == pytest.approx((-1, 1) if "fourbar" in name else (-2, 2), rel=1e-6)
    masses = {b.name: b.inertia.mass for b in folder.bodies if b.inertia and b.name != "pin"}
    wanted = (
        {"crank": 0.1, "coupler": 0.2, "rocker": 0.15}
        if "fourbar" in name
        else {"crank": 0.1, "rod": 0.2, "block": 0.3}
    )
    assert masses == pytest.approx(wanted)
    same.assert_same(m, folder, 1e-12)
    same.assert_same(folder, stage, 5e-7)
    worst, _ = same.worst_apart([m, folder], rng)
    assert worst < 1e-9
    worst, _ = same.worst_apart([m, stage], rng)
    assert worst < 2e-6


def test_a_loop_of_the_stage_that_is_moved_a_micrometre_is_seen(tmp_path, rng):
    _, folder, _ = same.made(MODELS / "fourbar.urdf", "own", tmp_path / "own")
    text = (MODELS / "fourbar.urdf").read_text().replace('xyz="0.2 0 0.06"', 'xyz="0.200001 0 0.06"')
    (tmp_path / "fourbar.urdf").write_text(text)
    (tmp_path / "fourbar.yaml").write_text((MODELS / "fourbar.yaml").read_text())
    other = close(read(tmp_path / "fourbar.urdf")).mechanism
    with pytest.raises(AssertionError):
        same.assert_same(folder, other, 1e-7)
    assert same.worst_apart([folder, other], rng)[0] > 1e-7


def test_alpha_survives_from_every_format_that_has_it():
    for name in ("fourbar.urdf", "fourbar.xml", "fourbar.sdf", "fourbar.usda"):
        mesh = read(MODELS / name, guarded=False).mechanism.body("crank").meshes[0]
        assert mesh.color_rgba[3] == pytest.approx(0.5), name


@pytest.mark.slow
def test_our_own_stage_comes_back_with_points_frames_and_trocar(tmp_path):
    source = assets.files("sils").stage
    before = read_stage(source)
    imported = close(read(source, guarded=False))
    write_folder(imported, "again", tmp_path / "again", source)
    after = read_mechanism(tmp_path / "again/cad/again.toml").mechanism
    assert after.points
    same.assert_same(imported.mechanism, after, 1e-11)
    assert {p.name for p in before.points} == {p.name for p in after.points}
    assert set(before.postures) <= set(after.postures)
    assert (before.tool, before.trocars, before.base) == (after.tool, after.trocars, after.base)


# -- models of others, used where they lie ------------------------------------------------------------


def third_party(name):
    """Return a model of example-parallel-robots: where the variable says, or in shared/models beside the checkout."""
    beside = HERE.parents[1] / "shared/models/example-parallel-robots"
    folder = Path(os.environ.get("TWIN_PARALLEL_ROBOTS") or beside)
    if not folder.is_dir():
        pytest.skip("NO THIRD-PARTY MODELS: set TWIN_PARALLEL_ROBOTS to a checkout of example-parallel-robots")
    return folder / name / "robot.urdf"


@pytest.mark.slow
@pytest.mark.parametrize("name", thinned(PARALLEL, every=3))
def test_third_party_loops_close_and_come_back_from_usd(name, tmp_path, rng):
    imported, folder, stage = same.made(third_party(name), "robot", tmp_path / "robot")
    assert imported.mechanism.loops
    home = ReferenceModel(folder).home()
    assert max(g[0] for g in home.gap.values()) <= 1e-9
    assert max(g[1] for g in home.gap.values()) <= 1e-8
    assert not [f for f in imported.findings if f.code == "import.gap"]
    same.assert_same(imported.mechanism, folder, 1e-11)
    same.assert_same(folder, stage, 1e-6)
    assert ReferenceModel(stage).home().worst_gap < 1e-6  # joint frames are single precision
    worst, gap = same.worst_apart([imported.mechanism, folder], rng, reach=0.05)
    assert worst < 1e-9
    assert gap <= 1e-9
    assert same.worst_apart([imported.mechanism, stage], rng, reach=0.05)[0] < 5e-6


@pytest.mark.slow
def test_third_party_model_that_cannot_close_says_which_loops_and_that_it_is_its_own_gap():
    """Pinocchio's own URDF reader and a minimisation of log6 over all joints find the same gaps; see docs/import.md."""
    found = [f for f in close(read(third_party("kangaroo_like"))).findings if f.code == "import.gap"]
    own = {f.where: f.size for f in found if "a defect of the model" in f.message}
    assert set(own) == {"closedloop2", "closedloop7", "closedloop8", "closedloop9", "closedloop10"}
    assert max(own.values()) == pytest.approx(0.056, abs=0.005)


@pytest.mark.nightly
def test_third_party_model_that_stays_open_goes_to_usd_and_comes_back_as_well(tmp_path):
    imported, folder, stage = same.made(third_party("kangaroo_like"), "robot", tmp_path / "robot")
    assert len(imported.mechanism.loops) == 11
    same.assert_same(imported.mechanism, folder, 1e-11)
    same.assert_same(folder, stage, 1e-6)


def test_a_mechanism_with_more_drives_than_freedoms_is_built_too(tmp_path):
    text = (MODELS / "fourbar.sdf").read_text()
    (tmp_path / "all.sdf").write_text(text.replace("<joint_name>crank_joint</joint_name>", ""))
    imported, folder, stage = same.made(tmp_path / "all.sdf", "own", tmp_path / "own")
    assert len(imported.mechanism.active) == 3
    assert {"import.driven"} <= {f.code for f in imported.findings}
    same.assert_same(folder, stage, 5e-7)


def test_third_party_meshes_that_are_missing_are_named_warnings():
    found = read(third_party("cassie_like")).findings
    missing = [f for f in found if f.code == "import.mesh"]
    assert missing
    assert all(f.severity == "warning" and f.where in f.message for f in missing)
    assert not [f for f in read(third_party("robot_delta")).findings if f.code == "import.mesh"]
