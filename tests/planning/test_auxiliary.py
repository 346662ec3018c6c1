"""Auxiliary joints: a jaw is planned, judged, exported, read back and led, though no equation knows of it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from made import gripper
from made.mechanisms import four_bar
from twin import api, cli
from twin.core import spatial
from twin.core.errors import ProtocolError
from twin.core.units import DEG
from twin.exchange.audit import audit
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Coupling, Mechanism
from twin.ui.report.plot_data import joint_unit
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import read as instruments

JAW = 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = gripper.folder(tmp_path_factory.mktemp("jaw") / "gripper")
    gripper.protocol(made / "trajectories/first.toml")
    return made


@pytest.fixture(scope="module")
def robot(folder):
    return api.load(folder)


@pytest.fixture(scope="module")
def trajectory(robot):
    return api.plan(robot)


def chain(*joints, frames=("tool",), couplings=()):
    """A mechanism of (name, parent, child) revolute joints, all driven, the tool on the body of the first frame."""
    bodies = dict.fromkeys(b for _, parent, child in joints for b in (parent, child))
    return Mechanism(
        "made",
        "base",
        tuple(Body(b) for b in bodies),
        tuple(
            Joint(n, "revolute", p, c, spatial.pose(p=[0.1, 0, 0]), active=not n.startswith("p")) for n, p, c in joints
        ),
        frames=tuple(Frame("tool", b, np.eye(4)) for b in frames),
        couplings=tuple(Coupling(*c) for c in couplings),
    )


ARM = (("a", "base", "one"), ("b", "one", "hand"))
JAWED = (*ARM, ("jaw", "hand", "left"))


@pytest.mark.parametrize(
    ("joints", "more", "expected"),
    [
        (ARM, {}, []),
        (JAWED, {}, ["jaw"]),
        ((*ARM, ("c", "base", "other"), ("d", "other", "end")), {}, ["c", "d"]),
        # fingers that follow each other move nothing else; one that follows the arm is one with it
        ((*JAWED, ("p1", "hand", "right")), {"couplings": [("k", ("jaw", "p1"), (1, 1))]}, ["jaw"]),
        (JAWED, {"couplings": [("k", ("jaw", "b"), (1, 1))]}, []),
        # a loop beyond the hand is not in the way to the tool; one through the hand is
        ((*ARM, ("jaw", "hand", "x"), ("p1", "x", "y"), ("p2", "y", "hand")), {}, ["jaw"]),
        ((*ARM, ("c", "base", "x"), ("p1", "x", "hand")), {}, []),
    ],
)  # fmt: skip
def test_a_joint_is_auxiliary_if_no_path_loop_or_coupling_lets_it_move_the_tool(joints, more, expected):
    assert [j.name for j in chain(*joints, frames=("hand",), **more).auxiliary] == expected


def test_nothing_is_auxiliary_where_nothing_moves_the_tool():
    assert chain(*ARM, frames=("base",)).auxiliary == ()
    assert replace(four_bar(), tool="nowhere").auxiliary == ()


def test_the_equations_leave_a_joint_alone_that_they_do_not_know(robot, rng):
    kin, mechanism = robot.kinematics(), robot.mechanism
    assert np.abs(kin.forward(np.zeros(7))[:3, 3] - [0, 0, 0.85]).max() < 1e-9
    assert [j.name for j in mechanism.auxiliary] == ["jaw"]
    assert kin.joints == ("q1", "q2", "q3", "q4", "q5", "q6", "jaw")
    assert kin.auxiliary.tolist() == [False] * 6 + [True]
    assert robot.reference().freedoms == 6
    assert not robot.reference().redundant
    q = np.array([0.1, -0.2, 0.15, 0.2, 0.8, -0.4, 0.5])
    T = kin.forward(q)
    np.testing.assert_allclose(kin.inverse(T, q), q, atol=1e-9)  # the jaw stays where the seed has it
    J = kin.jacobian(q=q)
    assert not J[:, JAW].any()
    for i, step in enumerate(1e-6 * np.eye(7)):
        ahead, behind = kin.forward(q + step), kin.forward(q - step)
        np.testing.assert_allclose(J[:3, i], (ahead - behind)[:3, 3] / 2e-6, atol=1e-8)


def test_it_is_planned_the_tool_standing_still(trajectory):
    spans = {p.name: p for p in trajectory.phases}
    assert [p.type for p in trajectory.phases] == ["auxiliary", "positioning", "auxiliary", "home"]
    for name, value in (("open", 40), ("reach", 40), ("close", 5), ("away", 5)):
        assert trajectory.q[spans[name].stop, JAW] == pytest.approx(value * DEG)
    still = trajectory.Ts_base_tool[spans["open"].start : spans["open"].stop + 1]
    assert np.ptp(still, axis=0).max() == 0
    assert np.abs(trajectory.qd[:, JAW]).max() <= 3  # its limit, which goes before that of the phase
    steady = trajectory.q[spans["reach"].start : spans["reach"].stop + 1, JAW]
    np.testing.assert_allclose(steady, 40 * DEG, atol=1e-12)


@pytest.mark.slow
def test_it_agrees_and_a_wrong_row_of_the_arm_is_found_and_cured(folder, robot, trajectory, capsys):
    report = api.validate(robot, trajectory)
    assert report.verdict == "agree", report.findings
    assert joint_unit(report, "jaw") == "rad"
    assert joint_unit(report, "q1") == "m"
    assert "jaw" not in {r.name for r in report.residuals}  # nothing is compared that no equation says
    text = (folder / "formula.py").read_text()
    try:
        (folder / "formula.py").write_text(text.replace("* np.sin(yaw)", "* np.cos(yaw)"))
        assert api.validate(api.load(folder), protocol="first").verdict == "disagree"
        assert cli.main(["explain", str(folder), "--quiet", "--json"]) == 1
    finally:
        (folder / "formula.py").write_text(text)
    told = json.loads(capsys.readouterr().out)
    assert told["explained"], told
    assert "np.sin(yaw)" in json.dumps(told)


def test_a_jaw_beyond_its_limit_through_its_fellow_or_misnamed_is_refused(robot, folder, tmp_path):
    def planned(**change):
        text = gripper.PROTOCOL
        for old, new in change.values():
            assert old in text
            text = text.replace(old, new)
        return api.plan(robot, robot.protocol(gripper.protocol(tmp_path / "first.toml", text)))

    with pytest.raises(
        ProtocolError, match=r"'open' \(auxiliary\).*joint jaw would go 12.70 deg above its upper limit"
    ):
        planned(a=("jaw_deg = 40", "jaw_deg = 70"))
    with pytest.raises(ProtocolError, match=r"joint 'q3' moves the tool, .* auxiliary joints only \(this robot: jaw\)"):
        planned(a=("jaw_deg = 40", "q3_deg = 40"))
    with pytest.raises(ProtocolError, match="joint 'jaw' is in deg: write jaw_deg, not jaw_mm"):
        planned(a=("jaw_deg = 40", "jaw_mm = 40"))
    with pytest.raises(ProtocolError, match="there is no driven joint 'jow'"):
        planned(a=("jaw_deg = 40", "jow_deg = 40"))
    with pytest.raises(ProtocolError, match="the phase has no length: the joints already have these values"):
        planned(a=("jaw_deg = 5 ", "jaw_deg = 40 "))
    with pytest.raises(ProtocolError, match="the phase has no length: the joints already have these values"):
        planned(a=("jaw_deg = 40 ", " "))


@pytest.mark.nightly
def test_it_is_exported_and_every_format_moves_it(robot, tmp_path):
    out = tmp_path / "out"
    report = api.export(robot, out=out)
    assert report.verdict == "agree", report.findings
    assert audit(out, mechanism=robot.weighed().mechanism).verdict == "agree"
    for name in ("usd/gripper.usda", "gripper.urdf", "gripper.xml"):
        back = close(read(out / name)).mechanism
        assert "jaw" in {j.name for j in back.active}, name
        assert back.couplings[0].joints == ("follower", "jaw"), name
        if "urdf" not in name:  # which has no place for a frame
            assert [j.name for j in back.auxiliary] == ["jaw"], name
        for body in robot.mechanism.bodies:
            colors = [m.color_rgba for m in back.body(body.name).meshes]
            np.testing.assert_allclose(colors, [m.color_rgba for m in body.meshes], atol=1e-4)
    text = (out / "gripper.urdf").read_text()
    (out / "gripper.urdf").write_text(text.replace('multiplier="-1"', 'multiplier="-1.01"'))
    wrong = audit(out, mechanism=robot.weighed().mechanism).findings
    assert [f for f in wrong if f.severity == "disagreement" and "right" in f"{f.where} {f.message}"]
    track = json.loads((out / "tracks/first.json").read_text())
    assert "jaw" in json.dumps(track)


def test_a_hand_moves_the_arm_and_the_jaw_stays(robot):
    movable = MovableRobot(robot)
    q = np.array([0.1, -0.2, 0.15, 0.2, 0.8, -0.4, 0.5])
    assert movable.move_joints(q).good
    assert instruments(movable).agrees
    T = movable.assembly.T_base_tool.copy()
    T[:3, 3] += [0.01, -0.005, 0.004]
    assert movable.move_tool(T).good
    assert movable.assembly.q[JAW] == pytest.approx(0.5, abs=1e-12)
    assert movable.move_joint(JAW, 0.2).good
    assert movable.assembly.q[JAW] == pytest.approx(0.2)
    np.testing.assert_allclose(movable.assembly.T_base_tool, T, atol=1e-9)
    assert instruments(movable).agrees
