"""The arms of the da Vinci: a remote centre that only the linkage holds, and equations that agree with it."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from made.drawing import draw
from made.lanes import nightly, one_of_a_kind
from twin.cad.build import read_mechanism
from twin.cad.lengths import measured_lengths
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.kinematics import compile_formula
from twin.kinematics.margins import Margins
from twin.reference import ReferenceModel
from twin.reference.clearance import clearance
from twin.robots import load_formula
from twin.validation import margins

ROOT = Path(__file__).parents[2]
ARMS = [n for n in twin.names() if n.startswith("davinci_")]
COUNT = int(os.environ.get("TWIN_DAVINCI_POSES", "500"))
"""Poses of the slow comparison; 20 000 for the figure in docs/davinci.md."""


@pytest.fixture(scope="module", params=one_of_a_kind(ARMS))
def robot(request):
    return twin.load(request.param)


@pytest.fixture(scope="module")
def psm():
    return twin.load("davinci_psm")


@pytest.fixture(scope="module")
def si():
    return twin.load("davinci_psm_si")


def postures(robot, count, seed=5):
    """Random joint values over the full ranges."""
    limits = np.array([j.limits for j in robot.mechanism.active])
    return np.random.default_rng(seed).uniform(limits[:, 0], limits[:, 1], (count, len(limits)))


def beyond(robot, q):
    """Return q with the wrist, or the tip of the endoscope, past the RCM: before it is another branch."""
    p = robot.kinematics().parameters
    q[:, 2] = np.maximum(q[:, 2], p["origin"] - p["shaft_long"] + 1 * MM)
    return q


def miss(model, run):
    """Distance of the shaft's axis from the RCM, and of the cannula's mark, over a run, by the poses of the links."""
    mechanism = model.mechanism
    frame = next((f for f in mechanism.frames if f.name == "roll"), mechanism.frame(mechanism.tool))
    T = model.link_poses(run.x)[frame.body] @ frame.T_body_frame
    off = np.linalg.norm(np.cross(T[:, :3, 3], T[:, :3, 2]), axis=1)
    return off, np.linalg.norm(run.points["rcm"], axis=1)


def test_the_drawing_meets_and_its_loops_are_flat(robot):
    """A pin that closes a parallelogram repeats three constraints, a slide beside two others all five."""
    assert robot.cad.findings == ()
    model = robot.reference()
    m = model.mobility(model.home().x)
    aside = len(robot.mechanism.auxiliary)
    assert (m.freedom, m.internal) == (len(robot.mechanism.active), 0)
    assert {k: v for k, v in m.redundant.items() if v} == {
        j.name: 3 if j.is_angle else 5 for j in robot.mechanism.loops
    }
    assert [j.name for j in robot.mechanism.auxiliary] == ["jaw"][:aside]


def test_the_remote_centre_is_a_consequence_of_the_linkage(robot):
    """No joint is at the RCM but those whose axis leads through it; the shaft passes it over the whole range."""
    mechanism, model = robot.mechanism, robot.reference()
    bodies = {j.child: j for j in mechanism.joints if j.name in ("q2", "pin_a", "pin_c", "pin_b2")}
    for name in bodies:
        at = mechanism.rest[name] @ bodies[name].T_child_joint
        assert np.linalg.norm(at[1:3, 3]) > 100 * MM  # pins lie across the pitch plane
    run = model.solve_many(postures(robot, 60))
    for off in miss(model, run):
        assert off.max() < 1e-9


def couplers(robot):
    """Joints at the far ends of the couplers."""
    found = [j.name for j in robot.mechanism.joints if j.name in ("pin_c", "pin_c2")]
    assert found, f"{robot.name} has no coupler"
    return found


def test_a_coupler_that_is_too_long_moves_the_shaft_off_the_remote_centre(robot):
    for coupler in couplers(robot):
        joints = []
        for j in robot.mechanism.joints:
            longer = j.T_parent_joint.copy()
            if j.name == coupler:
                longer[:3, 3] += spatial.inverse(robot.mechanism.rest[j.parent])[:3, :3] @ [0, 0.1 * MM, 0]
            joints.append(replace(j, T_parent_joint=longer))
        model = ReferenceModel(replace(robot.mechanism, joints=tuple(joints)))
        off, _ = miss(model, model.solve_many(postures(robot, 20)))
        assert off.max() > 0.05 * MM, coupler


def drawn(robot, folder, errors):
    """CAD of a robot drawn again with manufacturing errors, {body: {key: mm}}."""
    source = ROOT / "cad" / robot.name
    parts = [f"\n[part.{b}]\n" + "".join(f"{k} = {v:.9f}\n" for k, v in e.items()) for b, e in errors.items()]
    (folder / "dimensions.toml").write_text((source / "dimensions.toml").read_text() + "".join(parts))
    draw(source / "model.py", "--dimensions", folder / "dimensions.toml", "--out", folder / f"{robot.name}.step")
    (folder / f"{robot.name}.toml").write_text((source / f"{robot.name}.toml").read_text())
    return read_mechanism(folder / f"{robot.name}.toml", with_mass=False)


def wrong_lengths(robot, cad):
    """(body, name of the length) of each length that differs from the equations, with the difference in mm."""
    nominal = robot.kinematics().parameters
    off = {(x.body, x.between): (x.value - nominal[x.parameter]) / MM for x in measured_lengths(cad)}
    return {k: v for k, v in off.items() if abs(v) > 1e-6}


def arms_with(body):
    """Arms whose description has a body of this name."""
    return [n for n in ARMS if f"[body.{body}]\n" in (ROOT / "cad" / n / f"{n}.toml").read_text()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "body", "joint", "parameter"),
    nightly(
        [
            (name, *link)
            for link in (("coupler1", "pin_c", "reach"), ("coupler2", "pin_c2", "reach"), ("crank2", "pin_a3", "crank"))
            for name in arms_with(link[0])
        ],
        every=4,
    ),
)
def test_a_link_drawn_too_long_is_found_on_it(name, tmp_path, body, joint, parameter):
    robot = twin.load(name)
    cad = drawn(robot, tmp_path, {body: {"length_mm": robot.kinematics().parameters[parameter] / MM + 0.1}})
    assert [(f.where, f.code) for f in cad.findings] == [(joint, "cad.meeting")]
    assert cad.findings[0].size == pytest.approx(0.1, rel=1e-6)
    assert {b for b, _ in wrong_lengths(robot, cad)} == {body}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("link", "joint", "other"), nightly([("crank", "pin_a", "coupler"), ("coupler", "pin_c", "crank")], every=2)
)
def test_a_link_and_a_band_drawn_too_long_are_found_on_them(si, tmp_path, link, joint, other):
    """A closed band that is 0.2 mm longer spans 0.1 mm more."""
    length = si.kinematics().parameters[link] / MM + 0.1
    cad = drawn(si, tmp_path, {link: {"length_mm": length}, other: {"band_mm": 0.2}})
    assert [(f.where, f.code) for f in cad.findings] == [(joint, "cad.meeting")]
    found = wrong_lengths(si, cad)
    assert [body for body, _ in found] in ([link, other], [other, link])
    assert [pair for body, pair in found if body == other] == [
        ("band_b", "band_a") if other == "crank" else ("band_a", "band_c")
    ]
    np.testing.assert_allclose(list(found.values()), 0.1, rtol=1e-6)


@pytest.mark.parametrize(
    ("band", "wrong"), [("band1", {"pin_a", "pin_c"}), ("band2", {"pin_c"}), ("band3", {"slide1", "slide2"})]
)
def test_a_band_that_is_too_long_turns_what_it_holds(si, band, wrong):
    """One strand 0.1 mm longer: links that are held parallel stand askew, and the shaft leaves the remote centre."""
    pulley = next(p.value for p in si.cad.dimensions if p.name.endswith("pulley"))
    by = {c.name: 0.1 * MM / (pulley if c.name != "band3" else 1.0) for c in si.mechanism.couplings}[band]
    couplings = [replace(c, total=c.total + by) if c.name == band else c for c in si.mechanism.couplings]
    model, kin = ReferenceModel(replace(si.mechanism, couplings=tuple(couplings))), si.kinematics()
    run = model.solve_many(beyond(si, postures(si, 20)))
    off = {n: v - run.q_passive[n] for n, v in kin.passive_many(kin.forward_many(run.q), run.q).items()}
    assert {n for n, v in off.items() if np.abs(v).max() > 1e-9} == wrong
    away, _ = miss(model, run)
    if band == "band3":  # the slide between rail and sledge is 0.05 mm off; the instrument is not
        np.testing.assert_allclose(np.abs(off["slide1"]), 0.05 * MM, atol=1e-9)
        assert away.max() < 1e-9
    else:
        assert away.max() > 0.5 * MM


@pytest.mark.nightly
def test_no_body_of_the_si_meets_another_over_the_range(si):
    """The layers of yaw link, crank, coupler and rail, at every end of yaw, pitch and insertion and between."""
    (a, b), (c, d), (e, f) = si.mechanism.limits[:3]
    q = np.zeros((81, 7))
    q[:, :3] = list(product(np.linspace(a, b, 3), np.linspace(c, d, 9), np.linspace(e, f, 3)))
    model = si.reference()
    found = clearance(si.mechanism, model.link_poses(model.solve_many(q).x))
    assert found.distance.min() > 0
    assert not found.contacts


def test_each_telescope_goes_half_of_the_insertion(si):
    run = si.reference().solve_many(postures(si, 20))
    for name in ("slide1", "slide2"):
        np.testing.assert_allclose(run.q_passive[name], run.q[:, 2] / 2, atol=1e-12)


@pytest.mark.parametrize("count", [100, pytest.param(COUNT, marks=pytest.mark.slow)])
def test_equations_and_mechanism_agree_over_the_range(robot, count):
    kin, model = robot.kinematics(), robot.reference()
    run = model.solve_many(beyond(robot, postures(robot, count)))
    T = kin.forward_many(run.q)
    assert np.abs(T[:, :3, 3] - run.Ts_base_tool[:, :3, 3]).max() <= 1e-9
    assert np.abs(T - run.Ts_base_tool).max() <= 1e-9
    for name, values in kin.points_many(T, run.q).items():
        if name in run.points:
            assert np.abs(values - run.points[name]).max() <= 1e-9, name
    for name, values in kin.passive_many(T, run.q).items():
        assert np.abs(values - run.q_passive[name]).max() <= 1e-9, name


def test_the_inverse_is_unique_within_the_limits(robot):
    """All of 20 000; a roll beyond half a turn comes back as the turn that is less."""
    kin = robot.kinematics()
    q = beyond(robot, postures(robot, 20_000))
    off = kin.inverse_many(kin.forward_many(q)) - q
    off[:, 3] = np.angle(np.exp(1j * off[:, 3]))
    assert np.abs(off[:, ~kin.auxiliary]).max() < 1e-9


FIXTURES = [
    ((0, 0, 0.12, 0, 0, 0), (0, 0, -0.1237), [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    (
        (0.3, -0.2, 0.15, 0.5, 0.4, -0.3),
        (0.038358, 0.025254, -0.144858),
        [[0.487188, 0.859887, -0.152451], [0.869560, -0.493787, -0.006306], [-0.080700, -0.129493, -0.988291]],
    ),
]


@pytest.mark.parametrize(("q", "p", "R"), FIXTURES)
def test_the_tip_is_where_the_table_of_dvrk_has_it(q, p, R):
    kin = compile_formula(load_formula("davinci_psm"))
    T = kin.forward(np.array(q, float))
    np.testing.assert_allclose(kin.points_many(T[None], np.array([q], float))["tip"][0], p, atol=1e-6)
    np.testing.assert_allclose(T[:3, :3], R, atol=1e-6)


def test_control_point_and_tip_are_named_frames(psm):
    """Drawn back above the RCM, the yaw axis is 6.5 mm over it; the tip lies 10.2 mm further along the jaws."""
    model = psm.reference()
    q = np.zeros(7)
    at = model.solve(q)
    frames = {f.name: at.link_poses[f.body] @ f.T_body_frame for f in psm.mechanism.frames}
    np.testing.assert_allclose(frames["wrist_yaw"][:3, 3], [0, 0, 0.0065], atol=1e-12)
    np.testing.assert_allclose(frames["instrument_tip"][:3, 3], [0, 0, -0.0037], atol=1e-12)
    np.testing.assert_allclose(frames["tool"], at.T_base_tool, atol=1e-12)


def test_the_tip_of_the_endoscope_is_where_the_table_of_dvrk_has_it():
    T = compile_formula(load_formula("davinci_ecm")).forward(np.array([0.3, -0.2, 0.15, 0.5]))
    np.testing.assert_allclose(T[:3, 3], [0.043647, 0.029939, -0.141099], atol=1e-6)


def test_table_1_holds_with_the_offsets_that_it_lacks(psm):
    q = postures(psm, 2000)[:, :6]
    T = compile_formula(psm.formula).forward_many(q)
    assert np.abs(compile_formula(psm.formula, {"table1": "corrected"}).forward_many(q) - T).max() < 1e-12
    printed = compile_formula(psm.formula, {"table1": "printed"}).forward_many(q)
    assert np.linalg.norm(printed[:, :3, 3] - T[:, :3, 3], axis=1).min() > 1 * MM


def test_discs_lead_to_roll_wrist_and_jaw_as_published(psm):
    """The inverse of the published coupling, from joints to discs."""
    want = [[-0.6397, 0, 0, 0], [0, 0.9817, 0, 0], [0, 0.6696, 0.8212, -0.4106], [0, 0.6696, 0.8212, 0.4106]]
    got = np.array([psm.mechanism.motors(np.eye(7)[i])[3:] for i in range(3, 7)]).T
    np.testing.assert_allclose(got, want, atol=1e-4)


def test_each_jaw_goes_half_of_the_way(psm):
    model = psm.reference()
    q = np.zeros(7)
    q[2], q[5], q[6] = 0.12, 0.3, 40 * DEG
    poses = model.solve(q).link_poses
    for jaw, side in (("jaw_left", 1), ("jaw_right", -1)):
        before, now = ((p["hand"][:3, :3].T @ p[jaw][:3, :3]) for p in (psm.mechanism.rest, poses))
        turn = spatial.log_so3(poses["hand"][:3, :3] @ now @ before.T @ poses["hand"][:3, :3].T)
        axis = -model.solve(q).T_base_tool[:3, 0]  # the yaw axis
        np.testing.assert_allclose(turn, side * 20 * DEG * axis, atol=1e-9)


def test_an_open_jaw_leaves_the_measures_of_the_arm_judged(psm):
    """States with the jaw open are states of the equations, which know no jaw."""
    model = psm.reference()
    run = model.solve_many(beyond(psm, postures(psm, 10)))
    turns = {j.name: j.is_angle for j in psm.mechanism.joints}
    rows = Margins(psm.kinematics(), turns, tuple(run.points))
    assert np.abs(run.q[:, 6]).min() > 1 * DEG
    assert rows.valid(run, passive=True).all()
    assert rows.is_homogeneous(run, 1.25)


def test_a_passive_joint_that_follows_a_leaping_jaw_is_no_jump(psm):
    """Thin samples: the jaw opens between two of them, and the pin of one jaw follows by half; alone it may not."""
    model = psm.reference()
    q = np.tile(np.asarray(psm.mechanism.posture("home"), float), (12, 1))
    q[6:, 6] = 40 * DEG
    run = model.solve_many(q)
    clock = SimpleNamespace(times=np.arange(12.0), phases=(), when=str)
    assert margins._passive_jumps(model, run, clock) == []
    still = replace(run, q=np.tile(q[0], (12, 1)))
    assert [f.where for f in margins._passive_jumps(model, still, clock)] == ["jaw_half"]
