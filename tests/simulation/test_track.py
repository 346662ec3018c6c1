"""Computed torque control: the PA-10 with cited masses, figures computed elsewhere, and the command."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import mujoco as engine
import numpy as np
import pytest

from made import column as made
from made.lanes import alike, nightly
from twin import api, cli
from twin.core import spatial
from twin.core.errors import DescriptionError, MechanismError, TwinError
from twin.core.units import DEG
from twin.exchange.formats.mjcf.write import mjcf_text
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import inertia
from twin.simulation.dynamics import computed_torque
from twin.simulation.dynamics.arm import arm as arm_of
from twin.simulation.dynamics.computed_torque import (
    ENCODER,
    EXACT_LIMIT,
    TIP_LIMIT,
    Conditions,
    DesiredMotion,
    curve,
    effort_table,
    model_of,
    plant_of,
    run,
)
from twin.simulation.dynamics.effort_plants import ModelPlant, MujocoPlant

FOLDER = Path(__file__).parents[2] / "cad/pa10"
LIMITS = np.array([177, 94, 174, 137, 255, 165, 255]) * DEG
RCM, CENTRE, RADIUS = np.array([0.32, 0.48, 0.10]), np.array([0.32, 0.48, 0.0]), 0.02
T_FLANGE_TIP = spatial.pose(p=[0.0, 0.0, 0.330])


@pytest.fixture(scope="module")
def table():
    return inertia.of_robot(FOLDER)


CHAIN = [(0, 0), (-90, 0), (90, 0.45), (-90, 0), (90, 0.48), (-90, 0), (90, 0.07)]
"""Of each joint alpha in deg and r in m; d is zero throughout. Frame 7 is the flange."""


def steps():
    """Return (7, 4, 4): the frame of each joint in that before, all joints at zero."""
    turned = [spatial.exp_so3([alpha * DEG, 0, 0]) for alpha, _ in CHAIN]
    return np.array([spatial.pose(R, R @ [0, 0, r]) for R, (_, r) in zip(turned, CHAIN, strict=True)])


def with_mjcf(arm):
    return replace(arm, mjcf=mjcf_text(arm.mechanism))


@pytest.fixture(scope="module")
def arm(table):
    """With the instrument."""
    return with_mjcf(arm_of(hand_made(), table))


def mujoco(arm):
    return MujocoPlant(arm.mjcf, [j.name for j in arm.mechanism.active], arm.rotor, arm.friction)


def forward(plant, q, qd, torque):
    plant.reset(q, qd)
    plant.data.qfrc_applied[:] = torque
    engine.mj_forward(plant.model, plant.data)
    return plant.data.qacc.copy()


def random_states(count, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform(-1, 1, 7) * LIMITS, rng.normal(size=7), 20 * rng.normal(size=7)


@pytest.fixture(scope="module")
def kin():
    from twin.kinematics import compile_formula
    from twin.robots.pa10 import FORMULA

    return compile_formula(FORMULA)


def circle(kin, seconds, turns=1.0):
    """Return the circle of the paper through a trocar, elbow up, from rest to rest by a quintic of the angle."""

    def joints(t):
        s = np.clip(t / seconds, 0, 1)
        angle = 2 * np.pi * turns * (10 * s**3 - 15 * s**4 + 6 * s**5)
        tip = CENTRE + RADIUS * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        z = (tip - RCM) / np.linalg.norm(tip - RCM, axis=1)[:, None]
        x = np.array([1.0, 0, 0]) - z * z[:, :1]
        x /= np.linalg.norm(x, axis=1)[:, None]
        return np.unwrap(kin.inverse_many(spatial.pose(np.stack([x, np.cross(z, x), z], -1), tip)), axis=0)

    h, k = 0.25e-3, round(seconds * 1000)
    q = joints(h * np.arange(-2, 4 * k + 3))  # differences of fourth order on four samples a tick
    qd = (q[:-4] - 8 * q[1:-3] + 8 * q[3:-1] - q[4:]) / (12 * h)
    qdd = (-q[:-4] + 16 * q[1:-3] - 30 * q[2:-2] + 16 * q[3:-1] - q[4:]) / (12 * h * h)
    t = np.arange(k + 1) / 1000
    return DesiredMotion(t, q[2:-2:4], qd[::4], qdd[::4], rcm=np.tile(RCM, (k + 1, 1)))


@pytest.fixture(scope="module")
def motion(kin):
    return circle(kin, 3.0)


# -- the file ----------------------------------------------------------------------------------------


def test_the_file_has_the_masses_of_the_facts_and_says_where_they_are_from(table, arm):
    assert sum(link.mass.value for link in table.link) == pytest.approx(27.14, abs=1e-9)
    by_name = {p.name: p for p in arm.parameters}
    assert len(by_name) == len(arm.parameters) == 7 * (1 + 3 + 3 + 1 + 1 + 1) + 7
    assert all(p.note for p in arm.parameters)
    assert {p.name.split(".")[1] for p in arm.parameters if p.provenance == "ASSUMED"} == {"instrument"}
    assert by_name["inertia.q4.tensor.yy"].provenance == "DERIVED"  # exchanged
    assert arm.masses["q7"] == pytest.approx(1.55)


def test_the_chain_is_that_of_the_published_table(table, arm, kin):
    qs = np.array([q for q, _, _ in random_states(20)])
    assert arm.dynamics().tools(qs) == pytest.approx(kin.forward_many(qs), abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("value = 9.22", "value = -9.22", r"link\[0\].mass.value"),
        ("0.122706, 0.122706, 0.0530564", "0.122706, 0.022706, 0.0530564", "triangle inequality"),
        ('value = 9.22, unit = "kg"', 'value = 9.22, unit = "g"', "unit"),
        ('joint = "q2"', 'joint = "q1"', "'q1' has two links"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(tmp_path, old, new, said):
    text = (FOLDER / "inertia.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "inertia.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError, match=rf"inertia.toml:\d+: .*{said}"):
        inertia.of_robot(tmp_path)


def test_a_robot_without_masses_is_told_so(tmp_path):
    with pytest.raises(DescriptionError, match="the file does not exist: without masses"):
        inertia.of_robot(tmp_path)


# -- figures computed elsewhere ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (None, (94.32, 28.21, 1.08)),
        ("instrument", (99.86, 31.55, 2.06)),
        ("10 kg", (192.4, 82.2, 7.9)),
    ],
)
def test_gravity_of_the_stretched_arm(table, load, expected):
    m = inertia.weighed(table, hand_made(), instrument=load == "instrument")
    if load == "10 kg":
        ball = Inertia(10.0, np.zeros(3), 1e-6 * np.eye(3))  # at the flange
        m = replace(m, bodies=tuple(replace(b, inertia=ball) if b.name == "instrument" else b for b in m.bodies))
    q = np.array([0, 90 * DEG, 0, 0, 0, 0, 0])
    half_digit = 0.05 if load == "10 kg" else 0.005
    assert np.abs(arm_of(m).dynamics().gravity(q)[[1, 3, 5]]) == pytest.approx(expected, abs=half_digit)


def test_mass_matrix_of_the_upright_arm_without_rotors(table):
    arm = arm_of(hand_made(), table, instrument=False)
    M = arm.dynamics().mass_matrix(np.zeros(7))
    assert np.diag(M) - arm.rotor == pytest.approx([0.087, 6.656, 0.016, 1.279, 0.004, 0.008, 0.000], abs=5.001e-4)


def test_mass_matrix_is_positive_definite_everywhere(table):
    bare = arm_of(hand_made(), table, instrument=False).dynamics()
    smallest = [np.linalg.eigvalsh(bare.mass_matrix(q))[0] for q, _, _ in random_states(500)]
    assert min(smallest) > 0.0057  # the wrist's rotor
    assert round(min(smallest), 3) == 0.006


# -- two engines ---------------------------------------------------------------------------------------


def test_both_engines_have_the_same_motion_and_tip(arm):
    ours, theirs = arm.dynamics(), mujoco(arm)
    for q, qd, torque in random_states(50):
        # The file has twelve decimals, and seven joints lead to the tip.
        expected = forward(theirs, q, qd, torque)
        assert ours.forward(q, qd, torque) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
        assert ours.tools(q[None])[0, :3, 3] == pytest.approx(theirs.data.site("frame_tool").xpos, abs=2e-11)


def test_engines_agree_on_tensors_with_products(arm):
    turns = [spatial.pose(spatial.exp_so3([0.3, -0.5, i - 0.8]), [0.01, 0.02, -0.03]) for i in range(20)]
    bodies = (
        replace(b, inertia=b.inertia.seen_from(T)) if b.inertia else b
        for b, T in zip(arm.mechanism.bodies, turns, strict=False)
    )
    turned = with_mjcf(replace(arm, mechanism=replace(arm.mechanism, bodies=tuple(bodies))))
    ours, theirs = turned.dynamics(), mujoco(turned)
    for q, qd, torque in random_states(10):
        assert ours.forward(q, qd, torque) == pytest.approx(forward(theirs, q, qd, torque), rel=1e-8, abs=1e-8)


def test_both_plants_move_alike(arm):
    plants = (mujoco(arm), ModelPlant(arm.dynamics()))
    for plant in plants:
        plant.reset(0.3 * np.ones(7), 0.2 * np.ones(7))
        for i in range(100):
            plant.advance(np.sin(np.arange(7) + 0.1 * i), 1e-3)
    assert plants[0].q == pytest.approx(plants[1].q, abs=1e-9)
    assert plants[0].qd == pytest.approx(plants[1].qd, abs=1e-8)
    assert np.abs(plants[0].q - 0.3).max() > 0.01


def test_a_wrong_model_keeps_centres_and_rotors(arm):
    d, heavy = arm.dynamics(), model_of(arm, Conditions(inertia_error=0.05))
    assert heavy.mechanism.body("b3").inertia.p_body_com == pytest.approx(d.mechanism.body("b3").inertia.p_body_com)
    q = 0.4 * np.ones(7)
    assert heavy.gravity(q) == pytest.approx(1.05 * d.gravity(q))
    assert heavy.mass_matrix(q) - d.rotor == pytest.approx(1.05 * (d.mass_matrix(q) - d.rotor))
    by_chance = model_of(arm, Conditions(inertia_error=0.05, signs=3)).mechanism
    pairs = [(by_chance.body(b.name).inertia, b.inertia) for b in d.mechanism.bodies if b.inertia]
    assert {round(a.mass / b.mass, 12) for a, b in pairs} == {0.95, 1.05}
    assert {round(a.I_com[0, 0] / b.I_com[0, 0], 12) for a, b in pairs} == {0.95, 1.05}


def test_without_mujoco_or_its_file_the_way_out_is_named(arm, monkeypatch):
    with pytest.raises(TwinError, match="use the plant 'pinocchio'"):
        plant_of(replace(arm, mjcf=""))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(TwinError, match="--plant pinocchio"):
        mujoco(arm)


# -- cited masses on a mechanism -------------------------------------------------------------------------


def hand_made(*, reverse=None, tilt=0.0, askew=True):
    """Return the arm as a mechanism; askew, joint frames slide along and turn about their axes, bodies lie anyhow."""
    rng = np.random.default_rng(5)
    bodies, joints, inside = ["base"], [], np.eye(4)  # inside: of the link frame before, in its body
    if tilt:
        inside = spatial.pose(spatial.exp_so3([0, tilt, 0]))
    for j, step in enumerate(steps()):
        slide = spatial.pose(spatial.rotation_z(rng.uniform(-3, 3)), [0, 0, rng.uniform(-0.3, 0.3)])
        T_body_link = spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3))
        if not askew:
            slide = T_body_link = np.eye(4)
        name, child = f"q{j + 1}", f"b{j + 1}"
        joint = Joint(name, "revolute", bodies[-1], child, inside @ step @ slide, T_body_link @ slide, active=True)
        if reverse == name:
            flip = spatial.pose(np.diag([1.0, -1.0, -1.0]))
            ends = (joint.T_child_joint @ flip, joint.T_parent_joint @ flip)
            joint = Joint(name, "revolute", child, bodies[-1], *ends, active=True)
        joints.append(joint)
        bodies.append(child)
        inside = T_body_link
        if j == 2:  # a bracket between two joints
            bracket = spatial.pose(spatial.exp_so3([0.1, 0.2, 0.3]), [0.1, 0, 0])
            joints.append(Joint("screwed", "fixed", child, "bracket", bracket))
            bodies.append("bracket")
            inside = spatial.inverse(bracket) @ inside
    joints.append(Joint("clamp", "fixed", bodies[-1], "instrument", inside, np.eye(4)))
    beside = Joint("slide", "prismatic", "b7", "beside")  # without mass, and outside the row
    names = (*bodies, "instrument", "beside")
    return Mechanism(
        "m", "base", tuple(map(Body, names)), (*joints, beside), (Frame("tool", "instrument", T_FLANGE_TIP),)
    )


@pytest.mark.parametrize("reverse", [None, "q4"])
def test_cited_masses_lie_where_the_published_frames_lie_whatever_the_frames_of_the_joints(table, arm, reverse):
    straight = hand_made(askew=False)
    solids = [inertia._inertia(link) for link in table.link]
    solids[6] = (solids[6] + inertia._inertia(table.instrument)).seen_from(spatial.pose(p=[0, 0, -0.07]))
    masses = dict(zip([f"b{i}" for i in range(1, 8)], solids, strict=True))
    by_hand = replace(straight, bodies=tuple(replace(b, inertia=masses.get(b.name)) for b in straight.bodies))
    a = replace(arm, mechanism=arm_of(by_hand).mechanism).dynamics()
    b = arm_of(hand_made(reverse=reverse), table).dynamics()
    for q, qd, torque in random_states(10):
        assert b.mass_matrix(q) == pytest.approx(a.mass_matrix(q), abs=1e-12)
        assert b.gravity(q) == pytest.approx(a.gravity(q), abs=1e-11)
        assert b.forward(q, qd, torque) == pytest.approx(a.forward(q, qd, torque), rel=1e-9)
        assert b.tools(q[None]) == pytest.approx(a.tools(q[None]), abs=1e-12)


def test_parallel_axes_and_slides_have_frames_too(table):
    """SCARA: two parallel axes, and a slide, whose frames follow from those before."""
    shifts = ([0, 0, 0.3], [0.25, 0, 0], [0.2, 0, -0.1])
    joints = tuple(
        Joint(f"q{i + 1}", kind, "base" if not i else f"b{i}", f"b{i + 1}", spatial.pose(p=p), active=True)
        for i, (kind, p) in enumerate(zip(("revolute", "revolute", "prismatic"), shifts, strict=True))
    )
    bodies = tuple(map(Body, ("base", "b1", "b2", "b3")))
    scara = Mechanism("scara", "base", bodies, joints, (Frame("tool", "b3", np.eye(4)),))
    links = [table.link[0].model_copy(update={"joint": f"q{i + 1}"}) for i in range(3)]
    slide = links[2].model_copy(update={"rotor": None, "friction": None, "torque": None})
    three = table.model_copy(update={"link": [*links[:2], slide], "instrument": None})
    at = [b.inertia.p_body_com for b in inertia.weighed(three, scara).bodies[1:]]
    # At the height of the base's origin, since parallel axes are nearest to each other everywhere.
    assert np.array(at) == pytest.approx(np.array([[0, 0, -0.31], [0, 0, -0.31], [0, 0, -0.21]]), abs=1e-12)
    with pytest.raises(MechanismError, match="rotor of q3 is in kg m2, but the joint is prismatic"):
        inertia.weighed(three.model_copy(update={"link": links}), scara)


def test_a_file_of_another_mechanism_is_refused(table):
    with pytest.raises(
        MechanismError, match=r"joint q1: its axis must be perpendicular to the x axis of the base, .* 0.573 deg"
    ):
        inertia.weighed(table, hand_made(tilt=0.01))
    link = table.link[6].model_copy(update={"joint": "q8"})
    with pytest.raises(MechanismError, match="no joint with one coordinate 'q8'"):
        inertia.weighed(table.model_copy(update={"link": [*table.link[:6], link]}), hand_made())
    six = table.model_copy(update={"link": table.link[:6]})
    with pytest.raises(MechanismError, match="no body with a mass is moved by q7"):
        arm_of(hand_made(), six)


# -- computed torque control -------------------------------------------------------------------------


@pytest.mark.slow
def test_with_an_exact_model_only_the_hold_of_a_tick_is_left(arm, motion, kin):
    exact = run(arm, motion)
    assert exact.conditions.plant == "mujoco"
    assert exact.tip_max < EXACT_LIMIT / 20
    assert exact.rcm_max < EXACT_LIMIT / 20
    assert not exact.saturated.any()
    # A torque that is right when the tick begins is half a tick late: that, not the engine, is the error.
    late = run(arm, motion, Conditions(middle=False))
    assert 10 * exact.tip_max < late.tip_max < EXACT_LIMIT
    quick = circle(kin, 0.6, 0.1)
    same, other = (run(arm, quick, Conditions(plant=plant)) for plant in ("pinocchio", "mujoco"))
    assert same.tip_error == pytest.approx(other.tip_error, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("fraction", "seed"), [(0.05, None), (-0.05, None), (0.05, 0), (0.05, 1)])
def test_a_realistic_mismatch_stays_within_a_millimetre(arm, motion, fraction, seed):
    r = run(arm, motion, Conditions().realistic(fraction, seed))
    assert 100e-6 < r.tip_max < TIP_LIMIT
    assert r.tip_rms < r.tip_max
    assert 0 < r.rcm_max < TIP_LIMIT
    rows = effort_table(arm, r)
    assert all(0.3 < row.margin < 1 and row.rms < row.peak for row in rows)
    assert max(rows, key=lambda row: row.peak).joint == "q2"


@pytest.mark.slow
def test_the_error_grows_with_the_mismatch_on_both_sides(arm, kin):
    quick = circle(kin, 1.0, 0.3)
    tips = [r.tip_max for r in curve(arm, quick, (-0.2, -0.1, 0.0, 0.1, 0.2))]
    assert tips[0] > 1.5 * tips[1] > 10 * tips[2]
    assert tips[4] > 1.5 * tips[3] > 10 * tips[2]


@pytest.mark.nightly
def test_whole_curve_of_the_circle(arm, motion):
    fractions = np.arange(-20, 21, 5) / 100
    links = [r.tip_max for r in curve(arm, motion, fractions)]
    assert np.all(np.diff(links[:5]) < 0)
    assert np.all(np.diff(links[4:]) > 0)
    assert max(links) < 0.45e-3
    whole = [r.tip_max for r in curve(arm, motion, fractions, Conditions().realistic(0.0))]
    assert max(whole) < TIP_LIMIT


@pytest.mark.nightly
def test_a_realistic_mismatch_by_chance_stays_within_a_millimetre(arm, motion):
    worst = max(run(arm, motion, Conditions().realistic(0.05, seed)).tip_max for seed in range(20))
    assert worst < 0.7e-3


def test_stiffer_control_leaves_less(arm, kin):
    quick = circle(kin, 1.0, 0.3)
    soft, stiff = (run(arm, quick, Conditions(w=w, inertia_error=0.1)).tip_max for w in (40.0, 80.0))
    assert soft / stiff == pytest.approx(4, rel=0.15)  # Kp = w^2


def test_torques_stop_at_the_limits_of_the_drives(arm, kin):
    quick = circle(kin, 0.5, 0.2)
    weak = replace(arm, limit=np.array([158, 40.0, 68, 25.0, 17, 17, 17]))
    r = run(weak, quick)
    assert (np.abs(r.effort) <= weak.limit).all()
    assert r.saturated[:, [1, 3]].all(axis=1).any()
    assert not r.saturated[:, [0, 6]].any()
    assert effort_table(weak, r)[1].margin == pytest.approx(0)
    free = run(weak, quick, Conditions(saturation=False))
    assert np.abs(free.effort[:, 1]).max() > 40
    assert not free.saturated.any()
    assert free.tip_max < EXACT_LIMIT < r.tip_max


@pytest.mark.parametrize("saturation", [True, False])
def test_a_lost_arm_is_told(arm, kin, saturation, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wild = Conditions(w=3000.0, quantisation=ENCODER, saturation=saturation)
    strong = replace(arm, limit=1e5 * np.ones(7))
    with pytest.raises(TwinError, match="w = 3000 rad/s of the controller is unstable"):
        run(strong, circle(kin, 0.5, 0.2), wild)
    assert not list(tmp_path.iterdir())  # MuJoCo would log that it gave up


def test_encoder_steps_alone_cost_little(arm, kin):
    quick = circle(kin, 1.0, 0.3)
    assert EXACT_LIMIT / 10 < run(arm, quick, Conditions(quantisation=ENCODER)).tip_max < 50e-6


def test_unknown_friction_is_wrong_in_the_model_only(arm):
    c = Conditions().realistic(0.05)
    assert model_of(arm, c).friction == pytest.approx(1.2 * arm.friction)
    drawn = model_of(arm, replace(c, signs=4)).friction / arm.friction
    assert {round(x, 9) for x in drawn} == {0.8, 1.2}


@pytest.mark.parametrize(
    ("change", "conditions", "said"),
    [
        ({"q": np.zeros((3, 6))}, {}, r"q \(3, 6\) must be 3 rows of 7"),
        ({"qdd": np.full((3, 7), np.nan)}, {}, r"qdd \(3, 7\) must be 3 rows of 7 finite numbers"),
        ({"t": np.array([0, 0.001, 0.003])}, {}, "not one tick of 1 ms"),
        ({}, {"rate": 500.0}, "not one tick of 2 ms"),
        ({}, {"w": 0.0}, "must be above 0"),
        ({}, {"plant": "bullet"}, "no plant 'bullet'"),
    ],
)
def test_wrong_motions_and_conditions_are_refused(arm, change, conditions, said):
    still = {n: np.zeros((3, 7)) for n in ("q", "qd", "qdd")}
    motion = DesiredMotion(**{"t": np.arange(3) / 1000, **still, **change})
    with pytest.raises(TwinError, match=said):
        run(arm, motion, Conditions(**conditions))


# -- the command -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def column(tmp_path_factory):
    """A robot with slides, of one's own, whose masses are those of its file."""
    return made.folder(tmp_path_factory.mktemp("column") / "column")


@pytest.mark.slow
def test_command_prints_and_writes(column, tmp_path, capsys):
    assert cli.main(["track", str(column), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    said = capsys.readouterr().out
    assert all(text in said for text in ("exact model", "links -5 %", "seed 1", "limit", "w = 80 rad/s", "ASSUMED"))
    data = json.loads((tmp_path / "out/track.json").read_text(encoding="utf-8"))
    assert data["verdict"] == "agree"
    assert data["schema"] == "twin/track/1"
    assert "densities" in data["inertia"]
    assert data["masses_kg"] == {j[0]: made.LINKS[j[3]][0] for j in made.JOINTS}
    assert len(data["runs"]) == 5
    assert data["runs"]["exact model"]["tip_max_m"] < EXACT_LIMIT
    assert [(r["joint"], r["unit"], r["limit"]) for r in data["torques"]] == [
        (j[0], "N" if j[1] == "prismatic" else "N m", j[-1]) for j in made.JOINTS
    ]
    rows = np.genfromtxt(tmp_path / "out/track.csv", delimiter=",", names=True)
    for name, column_name in (("exact model", "exact_model"), ("links -5 %", "links_minus_5_percent")):
        assert rows[f"tip_error_{column_name}_m"].max() == pytest.approx(data["runs"][name]["tip_max_m"], rel=1e-8)
    assert {"torque_q1_n_m", "force_q2_n", "error_q2_m", "error_q4_rad"} <= set(rows.dtype.names)
    assert len(rows.dtype.names) == 1 + 2 * 5 + 2 * 6
    assert "The tip error stays within 1 mm" in (tmp_path / "out/track.html").read_text(encoding="utf-8")
    assert (tmp_path / "out/track.png").stat().st_size > 20_000


@pytest.mark.slow
def test_command_disagrees_beyond_a_millimetre(column, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(computed_torque, "Conditions", partial(Conditions, w=8.0))
    arguments = ["track", str(column), "--out", str(tmp_path / "out"), "--json"]
    assert cli.main(arguments) == 1
    data = json.loads(capsys.readouterr().out)
    assert "track.tip" in {f["code"] for f in data["findings"]}


def test_wrong_questions_are_refused(column, tmp_path):
    robot = api.load(column)
    with pytest.raises(TwinError, match="mismatch 100 %: give at least 0 % and less than 100 %"):
        api.track(robot, mismatch=1.0)
    with pytest.raises(DescriptionError, match="the file does not exist: without masses"):
        api.track(robot, inertia="cited")


KINDS = set(api.names()) - alike(api.names())
"""One robot of each kind."""


@pytest.mark.slow
@pytest.mark.parametrize("name", nightly(["sher", *sorted(KINDS - {"sher"})], every=99))
def test_every_kind_of_robot_is_tracked_whatever_closes_its_loops(name, monkeypatch):
    """A fifth of a second from rest, along the protocol; with TWIN_TRACK=long all of it."""
    planned = api.plan

    def cut(robot, protocol, progress):
        t, ticks = planned(robot, protocol, progress), 200
        short = {n: getattr(t, n)[:ticks] for n in ("t", "q", "qd", "qdd")}
        rcm = None if t.rcm is None else t.rcm[:ticks]
        return SimpleNamespace(**short, rcm=rcm, frame=t.frame, shaft_axis=t.shaft_axis, phases=())

    if os.environ.get("TWIN_TRACK") != "long":
        monkeypatch.setattr("twin.api.control.plan", cut)
    result = api.track(api.load(name))
    assert result.runs["exact model"].tip_max < EXACT_LIMIT
    assert result.runs["exact model"].tip_max < result.runs[result.worst].tip_max
