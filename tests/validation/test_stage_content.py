"""The stage held against the CAD thing by thing, and the motion beside it: silent when right, named when not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from twin.core import spatial
from twin.core.units import DEG, MM
from twin.model.body import Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Drive
from twin.model.mechanism import Coupling
from twin.usd.read import read_stage
from twin.validation.baked_motion import ExistingMotion, existing_motion_rows
from twin.validation.masses import solid_moments
from twin.validation.residual_rows import Tolerances
from twin.validation.stage_content import compare_content, estimated_inertia


@pytest.fixture(scope="module")
def sils():
    import twin

    robot = twin.load("sils")
    return robot.cad, read_stage(robot.files.stage)


def changed(mechanism, kind, name, **values):
    items = tuple(replace(x, **values) if x.name == name else x for x in getattr(mechanism, kind))
    return replace(mechanism, **{kind: items})


def wrong(sils, stage):
    cad, _ = sils
    return compare_content(cad.mechanism, stage, cad.description)


def test_the_stage_is_the_mechanism(sils):
    assert wrong(sils, sils[1]) == []


def _drive(m):
    d = m.joint("q1").drive
    return changed(m, "joints", "q1", drive=Drive(d.stiffness * DEG, d.damping, d.max_effort))


def _no_drive(m):
    return changed(m, "joints", "q1", drive=None)


def _limit(m):
    low, high = m.joint("q3").limits
    return changed(m, "joints", "q3", limits=(low, high * 1.001))


def _speed(m):
    return changed(m, "joints", "q3", max_speed=1.0)


def _frame(m):
    T = m.joint("r11").T_child_joint @ spatial.pose(p=[0, 0, 2e-6 * 5])
    return changed(m, "joints", "r11", T_child_joint=T)


def _turn(m):
    T = m.joint("r11").T_child_joint @ spatial.pose(spatial.exp_so3([0, 0, 0.01 * DEG]))
    return changed(m, "joints", "r11", T_child_joint=T)


def _cone(m):
    return changed(m, "joints", "s1", cone=1.0)


def _mass(m):
    b = m.body("bar1").inertia
    return changed(m, "bodies", "bar1", inertia=replace(b, mass=1.2 * b.mass))


def _centre(m):
    b = m.body("bar1").inertia
    return changed(m, "bodies", "bar1", inertia=replace(b, p_body_com=b.p_body_com + np.array([0, 0, 30 * MM])))


def _tensor(m):
    b = m.body("bar1").inertia
    return changed(m, "bodies", "bar1", inertia=replace(b, I_com=np.diag(np.diag(b.I_com)[::-1])))


def _mesh(m):
    body = m.body("bar1")
    meshes = tuple(replace(x, vertices=x.vertices * 1.01) for x in body.meshes)
    return changed(m, "bodies", "bar1", meshes=meshes)


def _inside_out(m):
    body = m.body("bar1")
    return changed(m, "bodies", "bar1", meshes=tuple(replace(x, triangles=x.triangles[:, ::-1]) for x in body.meshes))


def _point(m):
    p = m.points[0]
    return changed(m, "points", p.name, p_body=p.p_body + np.array([1e-5, 0, 0]))


def _no_joint(m):
    return replace(m, joints=tuple(j for j in m.joints if j.name != "r13"))


def _belt(m):
    return replace(m, couplings=(Coupling("belt", ("q1", "q2"), (1.0, -1.0)),))


def _light(m):
    return replace(m, gravity=(0.0, 0.0, -9.81 * 1.0001))


def _gripper(m):
    return replace(m, tool="camera", frames=tuple(replace(f, name="camera") for f in m.frames if f.name == m.tool))


@pytest.mark.parametrize(
    ("spoil", "where", "says"),
    [
        (_drive, "q1", "stiffness"),
        (_no_drive, "q1", "is missing"),
        (_limit, "q3", "upper limit"),
        (_speed, "q3", "largest speed"),
        (_frame, "r11", "mm"),
        (_turn, "r11", "°"),
        (_cone, "s1", "cone"),
        (_mass, "bar1", "mass of"),
        (_centre, "bar1", "mass centre"),
        (_tensor, "bar1", "tensor"),
        (_mesh, "bar1", "on the stage"),
        (_inside_out, "bar1", "a different mesh"),
        (_point, "", "point"),
        (_no_joint, "r13", "not on the stage"),
        (_belt, "belt", "not in the CAD"),
        (_light, "gravity", "m/s2 on the stage, but (0, 0, -9.8"),
        (_gripper, "camera", "the tool is 'camera' on the stage"),
    ],
)
def test_what_differs_is_named(sils, spoil, where, says):
    found = wrong(sils, spoil(sils[1]))
    assert found
    assert all(f.code == "stage.content" and f.severity == "disagreement" for f in found)
    assert any(f.where.startswith(where) and says in f.message for f in found)


def test_a_coupling_with_another_ratio_or_sum_is_named(sils):
    cad, stage = sils
    belt = Coupling("belt", ("q2", "q1"), (1.0, -1.0), 0.1)
    mechanism = replace(cad.mechanism, couplings=(belt,))
    for joints, ratios, total, says in (
        (("q1", "q2"), (-1.0, 1.0), 0.1, []),  # the stage stores the joints by name
        (("q1", "q2"), (-1.0, 2.0), 0.1, ["ratios"]),
        (("q1", "q3"), (-1.0, 1.0), 0.2, ["ratios", "sum 0.2"]),
    ):
        on_stage = replace(stage, couplings=(Coupling("belt", joints, ratios, total),))
        found = compare_content(mechanism, on_stage, cad.description)
        assert [f.where for f in found] == ["belt"] * len(says)
        assert all(text in f.message for text, f in zip(says, found, strict=True))


def test_the_estimate_of_a_mass_shares_nothing_with_the_scales_and_agrees(sils, sils_cad):
    """Trimesh weighs a fine mesh, the estimate sums tetrahedra over the coarse one."""
    cad, _ = sils
    for body in sils_cad.mechanism.bodies:
        guess = estimated_inertia(cad.mechanism.body(body.name), cad.description)
        assert guess is not None
        assert guess.mass == pytest.approx(body.inertia.mass, rel=0.06)
        assert guess.violations() == []


def test_moments_of_a_box_and_of_an_open_one():
    import trimesh

    box = trimesh.creation.box((0.1, 0.2, 0.4))
    T = spatial.pose(spatial.exp_so3([0.3, -0.2, 1.0]), [1.0, 2.0, -3.0])
    vertices = box.vertices @ T[:3, :3].T + T[:3, 3]
    m = solid_moments.moments(vertices, box.faces)
    assert m.volume == pytest.approx(0.008, rel=1e-12)
    assert m.first / m.volume == pytest.approx(T[:3, 3], rel=1e-12)
    about = m.second - np.outer(m.first, m.first) / m.volume
    R = T[:3, :3]
    assert R.T @ about @ R / m.volume == pytest.approx(np.diag([0.01, 0.04, 0.16]) / 12, abs=1e-12)
    assert solid_moments.moments_of_meshes([Mesh("open", vertices, box.faces[1:])]) is None
    empty = Mesh("empty", np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    assert solid_moments.moments_of_meshes([Mesh("box", vertices, box.faces), empty]) is None
    assert solid_moments.moments(vertices, box.faces[:, ::-1]).volume == pytest.approx(-0.008)
    assert Inertia(1.0, np.zeros(3), solid_moments.inertia_tensor(about)).violations() == []


class Looked:
    keys = np.arange(11) / 60


@pytest.mark.parametrize(
    ("written", "says"),
    [
        (
            ExistingMotion("x.usda", Looked.keys, np.full(11, 1e-4), np.zeros(11)),
            "differs from the motion of the protocol",
        ),
        (
            ExistingMotion("x.usda", Looked.keys, np.zeros(11), np.full(11, 1e-3)),
            "differs from the motion of the protocol",
        ),
        (
            ExistingMotion("x.usda", Looked.keys + 0.1, np.zeros(0), np.zeros(0)),
            "belongs to another protocol, or was changed",
        ),
        (ExistingMotion("x.usda", Looked.keys, np.zeros(11), np.zeros(11), ("bar1",)), "bar1 have no time codes"),
    ],
)
@pytest.mark.parametrize("due", [True, False])
def test_a_motion_beside_the_stage_is_held_against_the_protocol(written, says, due):
    _, found = existing_motion_rows(written, Looked, (), Tolerances(), due)
    assert [f.code for f in found] == ["baked.written"]
    assert found[0].severity == ("disagreement" if due else "warning")
    assert says in found[0].message


def test_a_motion_that_is_right_is_not_spoken_of():
    rows, found = existing_motion_rows(
        ExistingMotion("x", Looked.keys, np.zeros(11), np.zeros(11)), Looked, (), Tolerances(), True
    )
    assert found == []
    assert len(rows) == 2
