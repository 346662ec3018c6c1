"""An arm that turns and slides: planned, judged, exported, read back, shown, and controlled by its efforts."""

from __future__ import annotations

import numpy as np
import pytest

from made import column
from twin import api
from twin.exchange.audit import audit
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.reference.dynamics import Dynamics
from twin.simulation.dynamics.computed_torque import EXACT_LIMIT, TIP_LIMIT
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.readings import read as instruments


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return api.load(column.folder(tmp_path_factory.mktemp("column") / "column"))


@pytest.fixture(scope="module")
def trajectory(robot):
    return api.plan(robot)


def test_it_is_planned_and_judged(robot, trajectory):
    assert [j.type for j in robot.mechanism.active] == [j[1] for j in column.JOINTS]
    moved = np.ptp(trajectory.q, axis=0)
    assert (moved[[0, 2]] > [0.3, 0.05]).all()  # it turns and reaches at once: centrifugal and Coriolis forces
    report = api.validate(robot, trajectory)
    assert report.verdict == "agree", report.findings


@pytest.mark.slow
def test_it_is_exported_and_read_back_with_the_same_dynamics(robot, tmp_path):
    out = tmp_path / "out"
    report = api.export(robot, out=out, to=("usd", "mjcf", "urdf"))
    assert report.verdict == "agree", report.findings
    mechanism = robot.weighed().mechanism
    assert audit(out, mechanism=mechanism).verdict == "agree"
    own = Dynamics(mechanism)
    q, qd, qdd = np.array([[0.4, 0.1, 0.15, -0.5, 0.7, 0.2], [1, 0.3, -0.4, 2, -1, 1], [3, 1, 2, -4, 5, 6]])
    for name in ("usd/column.usda", "column.urdf", "column.xml"):
        back = Dynamics(close(read(out / name)).mechanism)
        assert back.inverse(q, qd, qdd) == pytest.approx(own.inverse(q, qd, qdd), rel=1e-4), name
    assert robot.dynamics().inverse(q, qd, qdd) == pytest.approx(own.inverse(q, qd, qdd))


def test_it_is_shown_and_follows_a_hand(robot):
    movable = MovableRobot(robot)
    assert movable.move_joints(np.array([0.4, 0.1, 0.15, -0.5, 0.7, 0.2])).good
    assert instruments(movable).agrees
    T = movable.assembly.T_base_tool.copy()
    T[:3, 3] += [0.01, -0.005, 0.004]
    assert movable.move_tool(T).good
    np.testing.assert_allclose(movable.assembly.T_base_tool, T, atol=1e-9)


@pytest.mark.nightly
def test_it_is_controlled_by_its_efforts(robot, trajectory):
    result = api.track(robot)
    assert result.verdict == "agree", result.findings
    exact = result.runs["exact model"]
    assert exact.tip_max < EXACT_LIMIT
    assert 10 * exact.tip_max < result.runs[result.worst].tip_max < TIP_LIMIT
    assert {row.unit for row in result.efforts} == {"N", "N m"}
    assert all(row.margin is not None and 0 < row.margin < 1 for row in result.efforts)
    lift = next(row for row in result.efforts if row.joint == "q2")
    carried = sum(mass for joint, mass in result.arm.masses.items() if joint != "q1")
    assert lift.rms == pytest.approx(9.81 * carried, rel=0.05)


@pytest.mark.slow
def test_motors_on_cables_are_asked_for_what_does_the_same_work(robot, tmp_path):
    geared = api.load(column.with_motors(column.folder(tmp_path / "column")))
    result, direct = (api.track(r, mismatch=0.0) for r in (geared, robot))
    assert result.verdict == "agree", result.findings
    assert [row.joint for row in result.efforts] == ["q1", "m1", "m2", "q4", "q5", "q6"]
    assert {row.joint: row.limit for row in result.efforts}["m1"] == 3.0
    exact, without = (r.runs["exact model"] for r in (result, direct))
    assert exact.tip_max < EXACT_LIMIT
    # Cables lead the weight to the motors, and their rotors to the joints.
    outward = np.array(column.MATRIX)
    rotors = np.diag([2e-4, 1e-4])
    felt = np.linalg.inv(outward).T @ rotors @ np.linalg.inv(outward) @ result.motion.qdd[:, 1:3, None]
    expected = (without.effort[:, 1:3] + felt[..., 0]) @ outward
    steady = slice(50, -50)
    assert exact.effort[steady, 1:3] == pytest.approx(expected[steady], abs=0.02 * np.abs(expected).max())
    assert "torque_m1_n_m" in _columns(result, tmp_path)


def _columns(result, folder):
    result.write(folder)
    return (folder / "track.csv").read_text().splitlines()[0].split(",")
