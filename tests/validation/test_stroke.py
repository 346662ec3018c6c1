"""Whole strokes: equations against mechanism, and what stand-ins for the loops would have cost."""

from __future__ import annotations

import json

import numpy as np
import pytest

import twin
from made.arm import LINK, arm
from twin.cli import main
from twin.core.units import DEG, UM
from twin.kinematics import compile_formula
from twin.reference import ReferenceModel
from twin.robots import load_formula
from twin.validation.stroke import SIMPLIFIED_MODELS, sweep


@pytest.fixture(scope="module")
def sher():
    robot = twin.load("sher")
    return robot, robot.reference(), robot.mechanism.posture("home")


def test_tilt_over_its_whole_stroke(sher):
    robot, model, home = sher
    one = sweep(robot.kinematics(), model, "q5", home, SIMPLIFIED_MODELS)
    assert (one.q[0], one.q[-1]) == pytest.approx((0, 0.05))
    assert one.agrees
    assert one.gap < 1e-11
    assert one.equations.distance.max() < 1e-10  # the paper reports -2.77 um against its own simulation
    serial, mimic = one.standins["serial"], one.standins["mimic"]
    # P moves by 16.5 x 19.2 mm: no fixed pivot, and no straight line for the angles, comes near 25 um
    assert 1e-3 < serial.distance.mean() < serial.distance.max() < 0.02
    assert 1e-3 < mimic.distance.mean() < mimic.distance.max() < 0.02
    assert mimic.turn.max() > 1 * DEG
    assert "e_a = " in mimic.note
    assert "e_d = " in mimic.note


def test_mimic_is_the_best_line_and_serial_the_best_pivot(sher):
    """Neither fit can be improved by a small change of what was fitted."""
    robot, model, home = sher
    one = sweep(robot.kinematics(), model, "q5", home, ("serial",), samples=51)
    best = float((one.standins["serial"].offset ** 2).sum())
    run = model.run(np.column_stack([np.tile(home[:4], (51, 1)), one.q]))
    p, R = run.Ts_base_tool[:, :3, 3], run.Ts_base_tool[:, :3, :3]
    fitted = p + one.standins["serial"].offset
    for axis in np.eye(3):
        for nudge in (1e-4, -1e-4):
            assert ((fitted + nudge * axis - p) ** 2).sum() >= best
            assert ((fitted + nudge * (R @ axis) - p) ** 2).sum() >= best


def test_a_delta_leg_has_no_mimic(sher):
    robot, model, home = sher
    one = sweep(robot.kinematics(), model, "q1", home, SIMPLIFIED_MODELS, samples=101)
    assert one.agrees
    assert one.q[0] > one.limits[0]  # with the others at home a rod nears the level: the stroke ends before its limit
    assert not len(one.standins["mimic"].offset)
    assert "'s1a'" in one.standins["mimic"].note
    assert one.standins["serial"].note.startswith("a straight line")


def test_roll_needs_no_loop(sher):
    robot, model, home = sher
    one = sweep(robot.kinematics(), model, "q4", home, SIMPLIFIED_MODELS, samples=51)
    assert max(c.distance.max() for c in one.standins.values()) < 1e-12


def test_a_robot_without_forward_equations_is_walked_from_home():
    robot = twin.load("sils")
    one = sweep(robot.kinematics(), robot.reference(), "q2", robot.mechanism.posture("home"), ("mimic",), samples=61)
    assert one.agrees
    assert one.equations.distance.max() < 1e-9


def test_a_wrong_equation_shows(sher):
    robot, model, home = sher
    one = sweep(robot.kinematics({"tilt_forward": "drawn"}), model, "q5", home, samples=51)
    assert not one.agrees
    assert one.equations.distance.max() > 1e-3


def test_command_writes_table_picture_and_numbers(tmp_path, capsys):
    arguments = ["validate", "sher", "--sweep", "q5", "--compare", "serial,mimic", "--out", str(tmp_path)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "over 25 µm" in printed
    assert "3.777 mm" in printed
    assert "< 10⁻⁹\u202f°" in printed  # not 2.5e-14°
    assert "-2.77 um" in printed
    assert (tmp_path / "sweep/sweep.png").stat().st_size > 10_000
    rows = np.genfromtxt(tmp_path / "sweep/q5.csv", delimiter=",", names=True)
    assert rows.dtype.names[:2] == ("q5_mm", "equations_x_um")
    assert len(rows) == 501
    assert main([*arguments, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["verdict"] == "agree"
    assert data["sweeps"][0]["mimic"]["position_max"] > 25 * UM
    assert data["requirement"]["tool_um"] == 25
    assert main([*arguments, "--variant", "tilt_forward=drawn"]) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sweep", "q9"], "--sweep: there is no active joint 'q9'"),
        (["--compare", "serail"], "--compare: there is no simplified loop model 'serail'"),
        (["--sweep", "--variant", "printed"], "with --sweep, give EQ=NAME"),
    ],
)
def test_wrong_options_are_named(options, message, capsys):
    assert main(["validate", "sher", *options]) == 2
    assert message in capsys.readouterr().err


def test_wrong_arguments_are_named():
    with pytest.raises(twin.TwinError, match=r"^joints: there is no active joint 'q9'"):
        twin.strokes("sher", ["q9"])
    with pytest.raises(twin.TwinError, match=r"^standins: there is no simplified loop model 'serail'"):
        twin.strokes("sher", standins=["serail"])


INVERSE = """
from casadi import atan, atan2, cos, sin

def inverse(pose):
    c = atan2(pose[1, 0], pose[0, 0])
    x = pose[0, 3] - {link} * cos(c)
    y = pose[1, 3] - {link} * sin(c)
    q = {first}
    return q, c - q
"""


@pytest.mark.parametrize(("first", "wrong"), [("atan2(y, x)", ()), ("atan(y / x)", ("q0",)), ("-atan2(y, x)", ("q0",))])
def test_an_inverse_alone_is_compared_over_the_stroke(tmp_path, first, wrong):
    """Two joints do not determine a pose: the mechanism is driven to the joint values that the inverse gives."""
    model = ReferenceModel(arm(2))
    path = tmp_path / "formula.py"
    path.write_text(INVERSE.format(link=LINK, first=first))
    home = np.zeros(2)
    driven = [("q0", True), ("q1", True)]
    formula = load_formula(path, "arm", driven=lambda: (driven, model.solve(home).T_base_tool, home))
    found = {}
    for joint in ("q0", "q1"):
        one = sweep(compile_formula(formula), model, joint, home, samples=101)
        assert (one.q[0], one.q[-1]) == pytest.approx((-2.6, 2.6))
        found[joint] = one
        assert one.agrees == (joint not in wrong)
    if "atan(" in first:  # beyond 90 deg, the arm points to the opposite side
        beyond = np.abs(found["q0"].q) > np.pi / 2
        assert found["q0"].equations.distance[beyond] == pytest.approx(2 * LINK)
        assert found["q0"].equations.distance[~beyond] == pytest.approx(0, abs=1e-12)
