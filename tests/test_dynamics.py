"""Dynamics of the PA-10: two engines, figures computed elsewhere, and the tip under computed torque control."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import DescriptionError, MechanismError, TwinError
from twin.core.units import DEG
from twin.model.mechanism import Body, Frame, Inertia, Joint, Mechanism
from twin.simulation.dynamics import inertia, model
from twin.simulation.dynamics.model import Dynamics, links_of, placements, poses, tool_in_last
from twin.simulation.dynamics.plant import MujocoPlant
from twin.simulation.dynamics.track import (
    ENCODER,
    EXACT_LIMIT,
    TIP_LIMIT,
    Conditions,
    Motion,
    curve,
    model_of,
    run,
    torque_table,
)

FOLDER = Path(__file__).parents[1] / "cad/pa10"
LIMITS = np.array([177, 94, 174, 137, 255, 165, 255]) * DEG
RCM, CENTRE, RADIUS = np.array([0.32, 0.48, 0.10]), np.array([0.32, 0.48, 0.0]), 0.02
T_FLANGE_TIP = spatial.pose(p=[0.0, 0.0, 0.330])


@pytest.fixture(scope="module")
def table():
    return inertia.of_robot(FOLDER)


@pytest.fixture(scope="module")
def arm(table):
    """With the instrument."""
    return inertia.arm(table)


def dynamics(arm):
    return Dynamics(arm.placements, arm.links, arm.rotor, arm.friction)


def mujoco(arm, **more):
    return MujocoPlant(arm.placements, arm.links, arm.rotor, arm.friction, **more)


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
    return Motion(t, q[2:-2:4], qd[::4], qdd[::4], T_FLANGE_TIP, rcm=np.tile(RCM, (k + 1, 1)))


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
    assert by_name["inertia.q7.centre.z"].provenance == "DERIVED"  # from the wrist to the flange
    assert arm.links[6].mass == pytest.approx(1.55)


def test_the_chain_is_that_of_the_published_table(table, arm, kin):
    qs = np.array([q for q, _, _ in random_states(20)])
    assert poses(arm.placements, qs, T_FLANGE_TIP) == pytest.approx(kin.forward_many(qs), abs=1e-12)


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
    with pytest.raises(DescriptionError, match="no masses are known"):
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
    arm = inertia.arm(table, instrument=load == "instrument")
    if load == "10 kg":
        ball = Inertia(10.0, np.zeros(3), 1e-6 * np.eye(3))
        arm = replace(arm, links=(*arm.links[:6], arm.links[6] + ball))
    q = np.array([0, 90 * DEG, 0, 0, 0, 0, 0])
    half_digit = 0.05 if load == "10 kg" else 0.005
    assert np.abs(dynamics(arm).gravity(q)[[1, 3, 5]]) == pytest.approx(expected, abs=half_digit)


def test_mass_matrix_of_the_upright_arm_without_rotors(table):
    arm = inertia.arm(table, instrument=False)
    M = dynamics(arm).mass_matrix(np.zeros(7))
    assert np.diag(M) - arm.rotor == pytest.approx([0.087, 6.656, 0.016, 1.279, 0.004, 0.008, 0.000], abs=5.001e-4)


def test_mass_matrix_is_positive_definite_everywhere(table):
    bare = dynamics(inertia.arm(table, instrument=False))
    smallest = [np.linalg.eigvalsh(bare.mass_matrix(q))[0] for q, _, _ in random_states(500)]
    assert min(smallest) > 0.0057  # the wrist's rotor
    assert round(min(smallest), 3) == 0.006


# -- two engines and first principles ----------------------------------------------------------------


def test_both_engines_have_the_same_mass_matrix_motion_and_tip(arm):
    ours, theirs = dynamics(arm), mujoco(arm, p_last_tip=T_FLANGE_TIP[:3, 3])
    for q, qd, torque in random_states(50):
        assert ours.mass_matrix(q) == pytest.approx(theirs.mass_matrix(q), abs=1e-9)
        assert ours.forward(q, qd, torque) == pytest.approx(theirs.forward(q, qd, torque), rel=1e-9, abs=1e-9)
        tip = ours.tip(q, T_FLANGE_TIP[:3, 3])
        assert tip == pytest.approx(theirs.tip, abs=1e-12)
        assert tip == pytest.approx(poses(arm.placements, q[None], T_FLANGE_TIP)[0, :3, 3], abs=1e-12)


def test_engines_agree_on_tensors_with_products(arm):
    turned = replace(
        arm, links=tuple(b.seen_from(spatial.pose(spatial.exp_so3([0.3, -0.5, 0.2 + i]), [0.01, 0.02, -0.03]))
                         for i, b in enumerate(arm.links)),
    )  # fmt: skip
    for q, qd, torque in random_states(10):
        ours, theirs = dynamics(turned), mujoco(turned)
        assert ours.forward(q, qd, torque) == pytest.approx(theirs.forward(q, qd, torque), rel=1e-8, abs=1e-8)


def test_energy_gives_mass_matrix_gravity_and_coriolis(arm):
    d, h = dynamics(arm), 1e-6
    for q, qd, _ in random_states(10):
        assert d.energy(q, qd)[0] == pytest.approx(0.5 * qd @ d.mass_matrix(q) @ qd, rel=1e-12)
        slope = [(d.energy(q + e, qd)[1] - d.energy(q - e, qd)[1]) / (2 * h) for e in h * np.eye(7)]
        assert d.gravity(q) == pytest.approx(slope, abs=1e-6)
        rate = (d.mass_matrix(q + h * qd) - d.mass_matrix(q - h * qd)) / (2 * h)
        kinetic = np.array([qd @ (d.mass_matrix(q + e) - d.mass_matrix(q - e)) @ qd for e in h * np.eye(7)]) / (2 * h)
        assert d.coriolis(q, qd) == pytest.approx(rate @ qd - 0.5 * kinetic, abs=1e-6)  # Lagrange


def test_inverse_and_forward_dynamics_undo_each_other(arm):
    d = dynamics(arm)
    for q, qd, torque in random_states(10):
        assert d.inverse(q, qd, d.forward(q, qd, torque)) == pytest.approx(torque, abs=1e-9)
        by_parts = d.mass_matrix(q) @ qd + d.coriolis(q, qd) + d.gravity(q) + d.friction * qd
        assert d.inverse(q, qd, qd) == pytest.approx(by_parts, abs=1e-9)


def test_both_plants_move_alike(arm):
    plants = (mujoco(arm), model.ModelPlant(dynamics(arm)))
    for plant in plants:
        plant.reset(0.3 * np.ones(7), 0.2 * np.ones(7))
        for i in range(100):
            plant.advance(np.sin(np.arange(7) + 0.1 * i), 1e-3)
    assert plants[0].q == pytest.approx(plants[1].q, abs=1e-9)
    assert plants[0].qd == pytest.approx(plants[1].qd, abs=1e-8)
    assert np.abs(plants[0].q - 0.3).max() > 0.01


def test_a_perturbed_model_keeps_centres_and_rotors(arm):
    d = dynamics(arm)
    heavy = d.perturbed(0.05)
    assert [b.mass for b in heavy.links] == pytest.approx([1.05 * b.mass for b in d.links])
    for a, b in zip(heavy.links, d.links, strict=True):
        assert a.p_body_com == pytest.approx(b.p_body_com)
        assert pytest.approx(1.05 * b.I_com) == a.I_com
    q = 0.4 * np.ones(7)
    assert heavy.gravity(q) == pytest.approx(1.05 * d.gravity(q))
    rotors = np.diag(d.rotor)
    assert heavy.mass_matrix(q) - rotors == pytest.approx(1.05 * (d.mass_matrix(q) - rotors))
    ratios = {round(a.mass / b.mass, 12) for a, b in zip(d.perturbed(0.05, 3).links, d.links, strict=True)}
    assert ratios == {0.95, 1.05}


def test_without_mujoco_the_way_out_is_named(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(TwinError, match="--plant pinocchio"):
        mujoco(arm)


# -- the chain of a mechanism ------------------------------------------------------------------------


BESIDE = Joint("slide", "prismatic", "b7", "beside")
"""A passive joint outside the row."""


def hand_made(table, *, reverse=None, bend=0.0, last=BESIDE):
    """Return the arm as a mechanism whose joint frames slide along and turn about the axes; bodies lie askew."""
    rng = np.random.default_rng(5)
    bodies, joints, inside = ["base"], [], np.eye(4)  # inside: of the link frame before, in its body
    for j, step in enumerate(inertia.chain(table)):
        slide = spatial.pose(spatial.rotation_z(rng.uniform(-3, 3)), [0, 0, rng.uniform(-0.3, 0.3)])
        T_body_link = spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3))
        name, child = f"q{j + 1}", f"b{j + 1}"
        T = inside @ step
        if j == 4 and bend:
            T = T @ spatial.pose(spatial.exp_so3([bend, 0, 0]))
        joint = Joint(name, "revolute", bodies[-1], child, T @ slide, T_body_link @ slide, active=True)
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
    return Mechanism(
        "m", "base", tuple(Body(b) for b in (*bodies, "instrument", "beside")), (*joints, last),
        (Frame("tool", "instrument", T_FLANGE_TIP), Frame("aside", "beside", np.eye(4))),
    )  # fmt: skip


@pytest.mark.parametrize("reverse", [None, "q4"])
def test_a_mechanism_with_other_frames_on_the_same_axes_has_the_same_dynamics(table, arm, reverse):
    m = hand_made(table, reverse=reverse)
    other = inertia.arm(table, placements(m))
    assert np.abs(other.placements - arm.placements).max() > 0.1
    a, b = dynamics(arm), dynamics(other)
    T_last_tool = tool_in_last(m)
    for q, qd, torque in random_states(10):
        assert b.mass_matrix(q) == pytest.approx(a.mass_matrix(q), abs=1e-12)
        assert b.gravity(q) == pytest.approx(a.gravity(q), abs=1e-11)
        assert b.forward(q, qd, torque) == pytest.approx(a.forward(q, qd, torque), rel=1e-9)
        tool = poses(other.placements, q[None], T_last_tool)
        assert tool == pytest.approx(poses(arm.placements, q[None], T_FLANGE_TIP), abs=1e-12)


def test_links_weighed_in_the_cad_are_found_in_their_joint_frames_with_what_is_fixed_to_them(table, arm):
    m = hand_made(table)
    frames = joint_frames(m)
    bare = inertia.arm(table, placements(m), instrument=False).links
    weights = {j.child: link for j, link in zip(m.active, bare, strict=True)}
    bodies = []
    for body in m.bodies:
        if body.name in weights:
            body = replace(body, inertia=weights[body.name].seen_from(frames[body.name]))
        elif body.name == "instrument":  # its frame is that of the last link in the file
            body = replace(body, inertia=inertia._inertia(table.instrument))
        bodies.append(body)
    weighed = replace(m, bodies=tuple(bodies))
    got = dynamics(replace(arm, placements=placements(m), links=links_of(weighed)))
    for q, qd, torque in random_states(10):
        assert got.forward(q, qd, torque) == pytest.approx(dynamics(arm).forward(q, qd, torque), rel=1e-9)
    with pytest.raises(MechanismError, match="nothing that has a mass is moved by q1"):
        links_of(m)


def joint_frames(m):
    """Return T_body_joint of the joint that moves each body."""
    return {j.child: j.T_child_joint for j in m.active}


def test_axes_that_are_not_those_of_the_file_are_refused(table):
    with pytest.raises(MechanismError, match=r"joint q5: the axis of the mechanism .* deg off"):
        inertia.arm(table, placements(hand_made(table, bend=0.01)))
    with pytest.raises(MechanismError, match="6 joints in a row"):
        inertia.arm(table, inertia.chain(table)[:6])
    shifted = spatial.pose(p=[0, 0, 0.317])
    with pytest.raises(MechanismError, match=r"joint q2: .* 317 mm beside"):
        inertia.arm(table, inertia.chain(table), shifted)


def test_what_is_no_chain_is_refused(table):
    forked = Joint("q8", "revolute", "b2", "beside", active=True)
    with pytest.raises(MechanismError, match="in a row"):
        placements(hand_made(table, last=forked))
    sliding = Joint("q8", "prismatic", "b7", "beside", active=True)
    with pytest.raises(MechanismError, match=r"q8 \(prismatic\)"):
        placements(hand_made(table, last=sliding))
    with pytest.raises(MechanismError, match="not fixed to the last link"):
        tool_in_last(hand_made(table), "aside")


# -- computed torque control -------------------------------------------------------------------------


def test_with_an_exact_model_only_the_hold_of_a_tick_is_left(arm, motion):
    exact = run(arm, motion)
    assert exact.conditions.plant == "mujoco"
    assert exact.tip_max < EXACT_LIMIT / 20
    assert exact.rcm_max < EXACT_LIMIT / 20
    assert not exact.saturated.any()
    # A torque that is right when the tick begins is half a tick late: that, not the engine, is the error.
    late = run(arm, motion, Conditions(middle=False))
    assert 10 * exact.tip_max < late.tip_max < EXACT_LIMIT
    same = run(arm, motion, Conditions(plant="pinocchio"))
    assert same.tip_error == pytest.approx(exact.tip_error, abs=1e-9)


@pytest.mark.parametrize(("fraction", "seed"), [(0.05, None), (-0.05, None), (0.05, 0), (0.05, 1)])
def test_a_realistic_mismatch_stays_within_a_millimetre(arm, motion, fraction, seed):
    r = run(arm, motion, Conditions().realistic(fraction, seed))
    assert 100e-6 < r.tip_max < TIP_LIMIT
    assert r.tip_rms < r.tip_max
    assert 0 < r.rcm_max < TIP_LIMIT
    rows = torque_table(arm, r)
    assert all(0.3 < row.margin < 1 and row.rms < row.peak for row in rows)
    assert max(rows, key=lambda row: row.peak).joint == "q2"


def test_the_error_grows_with_the_mismatch_on_both_sides(arm, kin):
    quick = circle(kin, 1.0, 0.3)
    tips = [r.tip_max for r in curve(arm, quick, (-0.2, -0.1, 0.0, 0.1, 0.2))]
    assert tips[0] > 1.5 * tips[1] > 10 * tips[2]
    assert tips[4] > 1.5 * tips[3] > 10 * tips[2]


@pytest.mark.slow
def test_whole_curve_of_the_circle(arm, motion):
    fractions = np.arange(-20, 21, 5) / 100
    links = [r.tip_max for r in curve(arm, motion, fractions)]
    assert np.all(np.diff(links[:5]) < 0)
    assert np.all(np.diff(links[4:]) > 0)
    assert max(links) < 0.45e-3
    whole = [r.tip_max for r in curve(arm, motion, fractions, Conditions().realistic(0.0))]
    assert max(whole) < TIP_LIMIT


@pytest.mark.slow
def test_a_realistic_mismatch_by_chance_stays_within_a_millimetre(arm, motion):
    worst = max(run(arm, motion, Conditions().realistic(0.05, seed)).tip_max for seed in range(20))
    assert worst < 0.7e-3


def test_stiffer_control_leaves_less(arm, kin):
    quick = circle(kin, 1.0, 0.3)
    soft, stiff = (run(arm, quick, Conditions(w=w, inertia_error=0.1)).tip_max for w in (40.0, 80.0))
    assert soft / stiff == pytest.approx(4, rel=0.15)  # Kp = w^2


def test_torques_stop_at_the_limits_of_the_drives(arm, kin):
    quick = circle(kin, 0.5, 0.2)
    weak = replace(arm, torque=np.array([158, 40.0, 68, 25.0, 17, 17, 17]))
    r = run(weak, quick)
    assert (np.abs(r.torque) <= weak.torque).all()
    assert r.saturated[:, [1, 3]].all(axis=1).any()
    assert not r.saturated[:, [0, 6]].any()
    assert torque_table(weak, r)[1].margin == pytest.approx(0)
    free = run(weak, quick, Conditions(saturation=False))
    assert np.abs(free.torque[:, 1]).max() > 40
    assert not free.saturated.any()
    assert free.tip_max < EXACT_LIMIT < r.tip_max


@pytest.mark.parametrize("saturation", [True, False])
def test_a_lost_arm_is_told(arm, kin, saturation, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wild = Conditions(w=3000.0, quantisation=ENCODER, saturation=saturation)
    strong = replace(arm, torque=1e5 * np.ones(7))
    with pytest.raises(TwinError, match="w = 3000 rad/s is unstable"):
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
        ({"q": np.zeros((3, 6))}, {}, "q must be"),
        ({"qdd": np.full((3, 7), np.nan)}, {}, "qdd must be"),
        ({"t": np.array([0, 0.001, 0.003])}, {}, "not one tick of 1 ms apart"),
        ({}, {"rate": 500.0}, "not one tick of 2 ms apart"),
        ({}, {"w": 0.0}, "must be above 0"),
        ({}, {"plant": "bullet"}, "no plant 'bullet'"),
    ],
)
def test_wrong_motions_and_conditions_are_refused(arm, change, conditions, said):
    still = {n: np.zeros((3, 7)) for n in ("q", "qd", "qdd")}
    motion = Motion(**{"t": np.arange(3) / 1000, **still, "T_last_tip": T_FLANGE_TIP, **change})
    with pytest.raises(TwinError, match=said):
        run(arm, motion, Conditions(**conditions))


# -- the command -------------------------------------------------------------------------------------


@pytest.fixture
def command(table, kin, monkeypatch):
    """Return `twin track` on a hand-made mechanism and a short plan."""
    from twin import api
    from twin.cli.track import track

    quick = circle(kin, 0.3, 0.05)
    phases = (SimpleNamespace(name="arc", type="circle", start=0, stop=300, t0=0.0, t1=0.3, rcm=RCM),)
    plan = SimpleNamespace(
        t=quick.t, q=quick.q, qd=quick.qd, qdd=quick.qdd, joint_names=tuple(f"q{i}" for i in range(1, 8)),
        frame="tool", shaft_axis=np.array([0.0, 0.0, 1.0]), phases=phases, duration=0.3,
        rcm=np.tile(RCM, (len(quick.t), 1)),
    )  # fmt: skip
    protocol = SimpleNamespace(name="arc", title="An arc")
    robot = SimpleNamespace(
        name="pa10", files=SimpleNamespace(cad=FOLDER), mechanism=hand_made(table), protocol=lambda name: protocol
    )
    monkeypatch.setattr(api, "load", lambda name: robot)
    monkeypatch.setattr(api, "plan", lambda *_: plan)
    common = {
        "robot": "pa10",
        "protocol": None,
        "json": False,
        "quiet": True,
        "mismatch": 5.0,
        "plant": "mujoco",
        "inertia": "cited",
    }
    return lambda **args: track(Namespace(**{**common, "curve": False, "out": None, **args}))


def test_command_prints_and_writes(command, tmp_path, capsys):
    assert command(out=str(tmp_path)) == 0
    said = capsys.readouterr().out
    assert all(text in said for text in ("exact model", "links -5 %", "seed 1", "limit N m", "w = 80 rad/s", "ASSUMED"))
    data = json.loads((tmp_path / "track.json").read_text(encoding="utf-8"))
    assert data["verdict"] == "agree"
    assert "inertia.toml" in data["inertia"]
    assert len(data["runs"]) == 5
    assert [r["joint"] for r in data["torques"]] == [f"q{i}" for i in range(1, 8)]
    rows = np.genfromtxt(tmp_path / "track.csv", delimiter=",", names=True)
    assert len(rows) == 301
    for name, column in (("exact model", "exact_model"), ("links -5 %", "links_minus_5_percent")):
        assert rows[f"tip_error_{column}_m"].max() == pytest.approx(data["runs"][name]["tip_max_m"], rel=1e-8)
        assert rows[f"rcm_error_{column}_m"].max() == pytest.approx(data["runs"][name]["rcm_max_m"], rel=1e-8)
    assert len(rows.dtype.names) == 1 + 2 * 5 + 2 * 7
    assert (tmp_path / "track.png").stat().st_size > 20_000


def test_command_disagrees_beyond_a_millimetre(command, tmp_path, capsys, monkeypatch):
    from twin.simulation.dynamics import track as module

    monkeypatch.setattr(module, "Conditions", partial(Conditions, w=8.0))
    assert command(out=str(tmp_path), json=True, curve=True, plant="pinocchio") == 1
    data = json.loads(capsys.readouterr().out)
    assert "track.tip" in {f["code"] for f in data["findings"]}
    assert {len(points) for points in data["curves"].values()} == {9}
    assert data["runs"]["exact model"]["conditions"]["plant"] == "pinocchio"


def test_command_refuses_a_senseless_mismatch(command):
    with pytest.raises(TwinError, match="--mismatch 100"):
        command(mismatch=100.0)
