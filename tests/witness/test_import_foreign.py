"""`twin new` on what others made: stages of urdf-usd-converter, and grippers of robosuite with loop equalities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin.exchange.read import read
from twin.reference import ReferenceModel

TESTS = Path(__file__).parents[1]
MODELS = TESTS / "data/importing/models"
from made import importing_same as same

GRIPPERS = {
    "xarm7_gripper": (2, 1),
    "robotiq_gripper_140": (0, 4),
    "robotiq_gripper_s": (0, 7),
    "jaco_three_finger_gripper": (0, 3),
}
"""Loops and couplings of each."""


def gripper(foreign, name, folder):
    """Return the MJCF of a gripper; one of them has an attribute that MuJoCo 4 refuses, and is copied without it."""
    site = next(foreign.need("robosuite").folder.glob("lib/python3*/site-packages/robosuite/models/assets/grippers"))
    if name != "xarm7_gripper":
        return site / f"{name}.xml"
    text = (site / f"{name}.xml").read_text().replace('class="xarm7_hand" group="1">', 'class="xarm7_hand">')
    mended = folder / f"{name}.xml"
    mended.write_text(text.replace('file="meshes/', f'file="{site}/meshes/'))
    return mended


@pytest.mark.witness("usdconv")
@pytest.mark.parametrize("name", ["fourbar", "slider"])
def test_a_stage_of_a_foreign_converter_is_the_robot_that_it_was_made_from(name, foreign, figures, tmp_path, rng):
    source = tmp_path / f"{name}.urdf"
    source.write_text((MODELS / f"{name}.urdf").read_text())  # without its closures: the converter takes none
    told = foreign.read("usdconv", "convert_urdf.py", source, tmp_path / "usd")
    theirs = read(Path(told["file"]), root=f"/{name}").mechanism
    ours = read(source).mechanism
    assert {j.name for j in ours.joints} == {j.name for j in theirs.joints}
    assert {b.name for b in ours.bodies} == {b.name for b in theirs.bodies}
    order = [b.name for b in ours.bodies]
    ours_model, their_model = ReferenceModel(ours), ReferenceModel(theirs)
    worst = 0.0
    for _ in range(20):
        values = dict(zip(order, rng.uniform(-0.5, 0.5, len(order)), strict=True))  # one a body, by name
        q, p = (np.array([values[_child(m, j)] for j in m.active]) * 0.2 for m in (ours, theirs))
        a, b = ours_model.solve(q).link_poses, their_model.solve(p).link_poses
        worst = max(worst, *(float(np.abs(a[n] - b[n]).max()) for n in order))
    figures.add(told["version"], name, "USD", worst, worst, f"{len(order)} bodies, 20 states")
    assert worst < 1e-6
    for body in ours.bodies:
        other = theirs.body(body.name)
        if body.inertia is not None:
            assert other.inertia is not None
            assert other.inertia.mass == pytest.approx(body.inertia.mass, rel=1e-6)
            np.testing.assert_allclose(other.inertia.I_com, body.inertia.I_com, rtol=1e-5, atol=1e-9)
    for joint in ours.joints:
        limits = theirs.joint(joint.name).limits
        assert limits == pytest.approx(joint.limits, rel=1e-6) if joint.limits else limits is None


def _child(m, joint):
    return next(j.child for j in m.tree if j.name == joint.name)


@pytest.mark.witness("usdconv")
def test_a_converted_stage_goes_to_a_folder_and_comes_back(foreign, figures, tmp_path, rng):
    source = tmp_path / "gripper.urdf"
    source.write_text((MODELS / "slider.urdf").read_text().replace('name="slider"', 'name="gripper"'))
    told = foreign.read("usdconv", "convert_urdf.py", source, tmp_path / "usd")
    imported, folder, stage = same.made(Path(told["file"]), "own", tmp_path / "own", root="/gripper")
    same.assert_same(imported.mechanism, folder, 1e-12)
    same.assert_same(folder, stage, 5e-7)
    worst, _ = same.worst_apart([imported.mechanism, folder, stage], rng)
    figures.add(told["version"], "slider", "folder, USD and back", worst, worst, "10 states")
    assert worst < 2e-6


@pytest.mark.witness("robosuite")
@pytest.mark.parametrize("name", sorted(GRIPPERS))
def test_a_gripper_with_loop_equalities_closes_and_comes_back(name, foreign, figures, tmp_path, rng):
    source = gripper(foreign, name, tmp_path)
    imported, folder, stage = same.made(source, "gripper", tmp_path / "gripper")
    m = imported.mechanism
    assert (len(m.loops), len(m.couplings)) == GRIPPERS[name]
    home = ReferenceModel(folder).home()
    assert max(g[0] for g in home.gap.values()) <= 1e-9
    assert max(g[1] for g in home.gap.values()) <= 1e-8
    same.assert_same(m, folder, 1e-11)
    same.assert_same(folder, stage, 1e-6)
    worst, gap = same.worst_apart([m, folder], rng)
    assert worst < 1e-9
    assert gap <= 1e-9
    back, _ = same.worst_apart([m, stage], rng)
    figures.add("robosuite 1.5.2 MJCF", name, "folder, USD and back", back, back, f"gap {gap:.1g} m")
    assert back < 2e-6


@pytest.mark.witness("robosuite")
def test_mujoco_itself_finds_the_loop_of_the_gripper_where_we_close_it(foreign, tmp_path):
    """At our joint values MuJoCo's own constraint residual is zero: the loop is the one that the file means."""
    import mujoco

    source = gripper(foreign, "xarm7_gripper", tmp_path)
    imported, _, _ = same.made(source, "gripper", tmp_path / "gripper")
    model = mujoco.MjModel.from_xml_path(str(source))
    data = mujoco.MjData(model)
    reference = ReferenceModel(imported.mechanism)
    state = reference.solve(reference.home().q + 0.3)
    for name, value in state.q_full.items():
        data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_makeConstraint(model, data)
    equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert equality.sum() == 7  # two connects, one joint
    assert np.abs(data.efc_pos[equality]).max() < 1e-9
