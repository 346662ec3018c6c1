"""Sweeps: workspaces against the equations asked pose by pose, tolerances against Pinocchio and chance, designs."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as stn

import twin
from made import own_robot
from made.lanes import contrasting, nightly
from twin import cli
from twin.analysis import cloud, cluster, design, joint_samples, table
from twin.analysis import grid_workspace as reach
from twin.analysis.error_propagation import ErrorPropagation, Spread
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.workspace_result import Workspace, volume_error
from twin.api.imported_file import imported_file
from twin.api.name_or_path import name_or_path
from twin.api.robot import Robot
from twin.api.robot_source import RobotSource
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.provenance import Parameter
from twin.core.units import DEG, MM, UM
from twin.exchange.xacro import XacroSettings
from twin.model.body import Body as MechanismBody
from twin.model.body import Frame
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel
from twin.ui.report import workspace_figures as drawn

ROBOTS = twin.names()


@pytest.fixture(scope="module")
def robots():
    out = {n: twin.load(n) for n in ROBOTS}
    return {n: r.bound(r.protocol()) if r.mechanism.trocars else r for n, r in out.items()}


def grid_around(robot, count=(9, 8, 7), step=0.01, **more):
    T = reach.centre(robot)
    low = T[:3, 3] - step * (np.array(count) - 1) / 2
    return PoseGrid(low, step, count, T[:3, :3], **more)


def poses(grid):
    """The poses of a grid by numpy."""
    import casadi as ca

    i = ca.SX.sym("i")
    f = ca.Function("f", [i], [grid.pose(i)])
    return np.array([f(k).full() for k in range(grid.poses)])


def gaps_of(robot):
    """Return (lower joint index, upper joint index, minimum distance in m) of each pair of joints on one rail."""
    return [(robot.joints.index(lower), robot.joints.index(upper), least) for lower, upper, least in robot.gaps]


# -- workspace -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting())
def test_positions_are_judged_as_the_equations_say(robots, name, monkeypatch):
    """Without limits of passive joints, which the equations do not contain."""
    robot = robots[name]
    monkeypatch.setattr(reach, "passive_check", lambda robot: None)
    # the middle is in the grid: at one orientation an endoscope about its RCM has no other positions than one line
    kin, grid = robot.kinematics(), grid_around(robot, (9, 9, 7))
    values = reach.evaluate(reach.judge(robot, grid), grid, 0, grid.positions)
    Ts = spatial.pose(grid.R_base_tool, grid.position(np.arange(grid.positions)))
    with np.errstate(all="ignore"):
        q, limits = kin.inverse_many(Ts), robot.mechanism.limits
        good = ((q >= limits[:, 0]) & (q <= limits[:, 1])).all(axis=1)
        for i, j, least in gaps_of(robot):
            good &= q[:, j] - q[:, i] >= least
        if kin.formula.aspects:
            good &= (kin.aspect_signs(Ts, q) == [a.preferred for a in kin.formula.aspects]).all(axis=1)
    assert good.any()
    assert np.array_equal(values[:, 0] > 0, good)
    condition = kin.condition_many(Ts[good], q[good])
    np.testing.assert_allclose(values[good, 1], 1 / condition, rtol=2e-6, atol=1e-7)
    span = limits[:, 1] - limits[:, 0]
    margin = np.where(np.isfinite(span), 2 * np.minimum(q - limits[:, 0], limits[:, 1] - q) / span, 1)[good].min(axis=1)
    np.testing.assert_allclose(values[good, 2], margin, rtol=1e-5, atol=1e-6)
    measures = kin.singularity(Ts[good], q[good])
    if measures:
        least = np.min([np.abs(m) for m in measures.values()], axis=0)
        np.testing.assert_allclose(values[good, 3], least, rtol=1e-5, atol=1e-7)
    assert not values[~good, :2].any()


def test_numbers_of_a_grid_are_positions_and_turns(robots):
    grid = grid_around(robots["sils"], (4, 3, 2), tilt=0.2, turns=5)
    Ts = poses(grid)
    assert len(Ts) == 4 * 3 * 2 * 5 == grid.poses
    places = grid.position(np.arange(grid.positions))
    assert np.abs(Ts[:, :3, 3] - np.repeat(places, 5, axis=0)).max() < 1e-12
    assert np.abs(Ts[::5, :3, :3] - grid.R_base_tool).max() < 1e-14, "the first orientation is not turned"
    turn = spatial.log_so3(Ts[:, :3, :3] @ grid.R_base_tool.T)
    assert np.abs(turn).max() <= 0.2 + 1e-12
    assert np.abs(turn[1:5] - turn[6:10]).max() < 1e-12, "every position has the same orientations"
    assert np.abs(Ts[:, :3, :3] @ np.swapaxes(Ts[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-14


def test_orientations_are_counted_at_each_position(robots, monkeypatch):
    """Without limits of passive joints, which the equations do not contain."""
    robot = robots["sils"]
    monkeypatch.setattr(reach, "passive_check", lambda robot: None)
    grid = grid_around(robot, (5, 4, 3), 0.03, tilt=20 * DEG, turns=8)
    values = reach.evaluate(reach.judge(robot, grid), grid, 0, grid.positions)
    one = PoseGrid(grid.low, grid.step, grid.shape, grid.R_base_tool)
    Ts = poses(grid)
    kin, limits = robot.kinematics(), robot.mechanism.limits
    with np.errstate(all="ignore"):
        q = kin.inverse_many(Ts)
        good = ((q >= limits[:, 0]) & (q <= limits[:, 1])).all(axis=1)
        for i, j, least in gaps_of(robot):
            good &= q[:, j] - q[:, i] >= least
        good &= (kin.aspect_signs(Ts, q) == [a.preferred for a in kin.formula.aspects]).all(axis=1)
    assert np.allclose(values[:, 0], good.reshape(-1, 8).mean(axis=1))
    assert 0 < good.mean() < 1
    assert one.positions == grid.positions


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sils", pytest.param("sher", marks=pytest.mark.slow)])
def test_the_box_holds_all_that_is_reached(robots, name):
    robot = robots[name]
    T = reach.centre(robot)
    low, high = reach.box(robot, T)
    step = float((high - low).max() / 40)
    wide = np.floor((high - low) * 1.4 / step).astype(int) + 1
    grid = PoseGrid(low - 0.2 * (high - low), step, (int(wide[0]), int(wide[1]), int(wide[2])), T[:3, :3])
    found = reach.over_grid(robot, grid)
    p = grid.position(np.flatnonzero(found.reached))
    assert (p >= low).all()
    assert (p <= high).all()
    finer = PoseGrid(grid.low, step / 2, tuple(2 * int(n) for n in wide), T[:3, :3])  # type: ignore[arg-type]
    volume = reach.over_grid(robot, finer).content()["volume_dm3"]
    assert found.content()["volume_dm3"] == pytest.approx(volume, rel=0.05)


def test_sils_reaches_the_volume_that_was_derived_for_it(robots):
    """14.6 dm3 with level tool (1 to 2 %), for wider limits, and with every ball in front of the frame."""
    from twin.analysis import measure

    robot = robots["sils"]
    kin = robot.kinematics()
    limits = np.array([[0, 0.657], [0, 0.657], [-0.01, 0.612], [-0.01, 0.612], [0, 0.657], [0, 0.657]])
    grid = PoseGrid(np.zeros(3), 0.01, (60, 72, 48), np.eye(3))
    kernel = measure.kernel(kin, limits, grid.pose, bounds=reach.shared_bounds(robot))
    values = reach.evaluate(kernel, grid, 0, grid.positions)
    reached = np.flatnonzero(values[:, 0] > 0)
    Ts = spatial.pose(np.eye(3), grid.position(reached))
    points = kin.points_many(Ts)
    front = np.min([points[n][:, 0] for n in points if re.fullmatch("s[123]", n)], axis=0) > 0
    assert 0.001 * front.sum() == pytest.approx(14.6, rel=0.03)


@pytest.mark.slow
def test_joints_and_poses_reach_the_same_places(robots):
    """Whatever position is reached in the home orientation is a cell that the joints reach too."""
    robot = robots["pa10"]
    by_joints = joint_samples.by_joints(robot, 200_000, 0.15)
    T = reach.centre(robot)
    low, high = reach.box(robot, T)
    nx, ny, nz = (int(n) for n in np.floor((high - low) / 0.1))
    by_poses = reach.over_grid(robot, PoseGrid(low, 0.1, (nx, ny, nz), T[:3, :3]))
    p = by_poses.grid.position(np.flatnonzero(by_poses.reached))
    grid = by_joints.grid
    index = np.round((p - grid.low) / grid.step).astype(int)
    inside = ((index >= 0) & (index < grid.shape)).all(axis=1)
    hit = by_joints.cube[tuple(index[inside].T)][:, 0] > 0
    assert inside.mean() > 0.99
    assert hit.mean() > 0.98


def planar_arm(limits=(-2.0, 2.0)) -> Mechanism:
    joints_ = (
        Joint("a", "revolute", "base", "upper", active=True, limits=limits),
        Joint("b", "revolute", "upper", "fore", spatial.pose(p=[0.3, 0, 0]), active=True, limits=limits),
    )
    frames = (Frame("tool", "fore", spatial.pose(p=[0.2, 0, 0])),)
    return Mechanism("arm", "base", tuple(map(MechanismBody, ("base", "upper", "fore"))), joints_, frames)


def bare(mechanism: Mechanism) -> twin.Robot:
    return Robot(RobotSource(stage=Path("arm.usda")), given_mechanism=mechanism)


def test_a_mechanism_without_equations_goes_through_its_joints(robots):
    robot = bare(planar_arm())
    found = joint_samples.by_joints(robot, 50_000, 0.01)
    p = found.grid.position(np.flatnonzero(found.reached))
    assert np.abs(p[:, 2]).max() < 0.02
    radius = np.linalg.norm(p[:, :2], axis=1)
    assert radius.max() == pytest.approx(0.5, abs=0.02)
    nearest = np.sqrt(0.3**2 + 0.2**2 + 2 * 0.3 * 0.2 * np.cos(2.0))
    assert radius.min() == pytest.approx(nearest, abs=0.02)
    assert found.facts["assembled"] == 1.0


def test_the_workspace_of_a_planar_arm_is_an_area():
    """The tool of this arm reaches a ring with the radii 0.1 and 0.5 m."""
    found = joint_samples.by_joints(bare(planar_arm((-np.pi, np.pi))), 100_000, 0.01)
    said = found.content()
    assert found.grid.shape[2] == 1
    assert (said["dimension"], said["volume_dm3"]) == (2, None)
    assert abs(said["area_cm2"] - 1e4 * np.pi * (0.5**2 - 0.1**2)) < said["area_error_cm2"] < 0.05 * said["area_cm2"]
    assert "cm² (error of counting cells) of a plane" in "\n".join(found.text())


@pytest.mark.parametrize(("turned", "dimension", "said"), [(True, 2, "a surface, whose size"), (False, 1, "a curve")])
def test_a_curved_surface_or_a_curve_has_no_volume(turned, dimension, said):
    m = planar_arm()
    a, b = m.joints
    if turned:  # the second axis is perpendicular to the first: the tool moves on a torus
        b = replace(b, T_parent_joint=spatial.pose(np.eye(3)[[0, 2, 1]] * [1, -1, 1], [0.3, 0, 0]))
    else:
        b = replace(b, type="fixed", active=False, limits=None)
    found = joint_samples.by_joints(bare(replace(m, joints=(a, b))), 5_000)
    assert found.content()["dimension"] == dimension
    assert found.content()["volume_dm3"] is None
    assert said in "\n".join(found.text())
    assert drawn.figure(found).axes


@pytest.mark.parametrize(("option", "most"), [("--sigma-um", "10000"), ("--encoder-deg", "10")])
def test_an_error_that_is_not_small_is_refused(option, most, capsys):
    assert cli.main(["tolerance", "sher", option, "1e9"]) == 2
    assert f"give at most {most}; errors are propagated to first order" in capsys.readouterr().err


def test_a_slide_without_limits_is_named(robots):
    m = planar_arm()
    robot = bare(replace(m, joints=(replace(m.joints[0], type="prismatic", limits=None), m.joints[1])))
    with pytest.raises(TwinError, match="joint 'a' is prismatic and has no limits"):
        joint_samples.by_joints(robot, 1000)


@pytest.mark.slow
def test_workspace_command_writes_what_others_read(tmp_path, capsys):
    import trimesh
    from pxr import Usd, UsdGeom

    assert cli.main(["workspace", "sils", "--count", "20000", "--out", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == {**json.loads((tmp_path / "workspace.json").read_text()), "folder": str(tmp_path)}
    assert 6 < said["volume_dm3"] < 9
    points_of_ply = trimesh.load(tmp_path / "workspace.ply")
    stage = Usd.Stage.Open(str(tmp_path / "workspace.usdc"))
    prim = UsdGeom.Points(stage.GetDefaultPrim())
    points = np.array(prim.GetPointsAttr().Get())
    assert len(points) == len(points_of_ply.vertices)
    assert np.abs(points - points_of_ply.vertices).max() < 1e-6
    cell = (said["step_mm"] / 100) ** 3
    assert len(points) * cell == pytest.approx(said["volume_dm3"], rel=1e-6)
    known = UsdGeom.PrimvarsAPI(prim.GetPrim()).GetPrimvar("inverse_condition").Get()
    assert 0 < min(known) < max(known) <= 1
    assert (tmp_path / "workspace.png").stat().st_size > 10_000
    assert np.load(tmp_path / "workspace.npy", mmap_mode="r").shape == (said["positions"], 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--count", "10"], "--count 10: give at least 1000"),
        (["--step-mm", "-1"], "--step-mm -1: give a positive number of millimetres"),
        (["--tilt-deg", "200"], "--tilt-deg 200: give degrees from 0 to 180"),
        (["--turns", "0"], "--turns 0: give at least 1"),
        (["--step-mm", "0.01"], "positions; the limit is 5e+07. Increase --step-mm"),
        (["--step-mm", "1e-20"], "positions; the limit is 5e+07. Increase --step-mm"),
        (["--count", "1e30"], "positions; the limit is 5e+07. Increase --step-mm or reduce --count"),
        (["--step-mm", "5000"], "none of 1 positions, 5e+03 mm apart, is reached in a box of 567 x 628 x 344 mm"),
        (["--joints", "--scheduler", "local"], "--scheduler: joint samples run on this machine"),
        (["--count", "1.5"], "argument --count: 1.5 is not a whole number"),
        pytest.param(
            ["--scheduler", "tcp://127.0.0.1:1", "--count", "1000"],
            "no Dask scheduler answers at this address",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_workspace_refuses(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECTION_TIMEOUT", "1s")
    assert cli.main(["workspace", "sils", "--out", str(tmp_path / "o"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


# -- tolerance -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["lapbot", *(pytest.param(n, marks=pytest.mark.slow) for n in ("sils", "pa10", "sher"))]
)
def test_sensitivities_are_what_a_moved_frame_does_to_the_reference(robots, name, rng):
    """Frames of the mechanism are moved, and Pinocchio closes its loops."""
    mechanism = robots[name].mechanism
    spread = Spread(10 * UM, 10 * UM, 10 * UM, 10 * UM)
    tolerances = ErrorPropagation(mechanism, spread)
    model = ReferenceModel(mechanism)
    start = model.home()
    S = tolerances.budget("drawn", start.q).sensitivity
    frames = list(tolerances.equations.errors)
    for k in rng.choice(len(frames), 4, replace=False):
        joint, side = frames[k]
        e = rng.uniform(-1, 1, 6) * 1e-6
        key = f"T_{side}_joint"
        moved = getattr(mechanism.joint(joint), key) @ spatial.pose(spatial.exp_so3(e[3:]), e[:3])
        changed = tuple(replace(j, **{key: moved}) if j.name == joint else j for j in mechanism.joints)
        T = ReferenceModel(replace(mechanism, joints=changed)).solve(start.q).T_base_tool
        got = np.concatenate(
            [T[:3, 3] - start.T_base_tool[:3, 3], spatial.log_so3(T[:3, :3] @ start.T_base_tool[:3, :3].T)]
        )
        want = S[:, 6 * k : 6 * k + 6] @ e
        np.testing.assert_allclose(got, want, atol=2e-3 * np.abs(want).max() + 2e-11, err_msg=f"{joint} {side}")


@pytest.mark.parametrize(
    "name",
    ["hibou", pytest.param("sils", marks=pytest.mark.slow), pytest.param("sher", marks=pytest.mark.nightly)],
)
def test_chance_agrees_to_two_percent(robots, name):
    mechanism = robots[name].mechanism
    tolerances = ErrorPropagation(mechanism, Spread(10 * UM, 0.001 * DEG, 1 * UM, 0.001 * DEG))
    budget = tolerances.budget("home", mechanism.posture("home"), 100_000)
    assert budget.difference is not None
    assert budget.difference < 0.02
    assert budget.sampled_within is not None
    assert budget.sampled_within[0] == pytest.approx(budget.within[0], rel=0.02)
    assert budget.sampled_within[1] == pytest.approx(budget.within[1], rel=0.02)


def test_an_encoder_error_costs_what_the_jacobian_says(robots):
    robot = robots["pa10"]
    q = robot.mechanism.posture("home")
    budget = ErrorPropagation(robot.mechanism, Spread(0, 0, 0, 1e-4)).budget("home", q)
    J = robot.jacobian(q)
    np.testing.assert_allclose(budget.covariance, 1e-8 * J @ J.T, atol=1e-15)
    assert next(n for n, share, _ in budget.contributors if share > 1e-12).startswith("encoder")
    assert sum(share for _, share, _ in budget.contributors) == pytest.approx(1)


@pytest.mark.nightly
def test_tolerances_scale_and_add_up(robots):
    mechanism = robots["hibou"].mechanism
    q = mechanism.posture("home")
    one = ErrorPropagation(mechanism, Spread(10 * UM, 0, 0, 0)).budget("home", q)
    two = ErrorPropagation(mechanism, Spread(20 * UM, 0, 0, 0)).budget("home", q)
    encoder = ErrorPropagation(mechanism, Spread(0, 0, 0, 5e-5)).budget("home", q)
    both = ErrorPropagation(mechanism, Spread(10 * UM, 0, 0, 5e-5)).budget("home", q)
    assert two.within[0] == pytest.approx(2 * one.within[0])
    np.testing.assert_allclose(both.covariance, one.covariance + encoder.covariance, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize("spread", [Spread(0, 0, 0, 0), Spread(-1, 0, 0, 1), Spread(np.nan, 0, 0, 0)])
def test_tolerances_that_are_none_are_refused(robots, spread):
    with pytest.raises(TwinError, match="must be finite and not negative, and at least one must be positive"):
        ErrorPropagation(robots["pa10"].mechanism, spread)


def test_errors_that_do_not_move_the_tool_meet_every_requirement(robots):
    budget = twin.tolerance(robots["sils"], Spread(0, 0, 0, 1e-3), required=1e-5)  # sils has no rotary encoder
    assert budget.verdict == "agree"
    assert budget.factor == np.inf
    assert "met" in "\n".join(map(str, budget.text()))


@pytest.mark.parametrize(("required", "samples"), [(0.0, 0), (-1e-5, 0), (np.nan, 0), (np.inf, 0), (1e-5, -1)])
def test_a_tolerance_of_numbers_that_cannot_be_is_refused(robots, required, samples):
    with pytest.raises(TwinError, match=r"= .* give "):
        twin.tolerance(robots["sils"], Spread(1e-5, 0, 0, 0), required=required, samples=samples)


@pytest.mark.slow
def test_tolerance_command_tells_whether_a_requirement_is_met(tmp_path, capsys):
    coarse = ["tolerance", "hibou", "--samples", "2000", "--out", str(tmp_path), "--json", "--require-um", "50"]
    assert cli.main(coarse) == 1
    said = json.loads(capsys.readouterr().out)
    assert (said["verdict"], said["required_um"], said["requirement"]) == ("disagree", 50.0, "")
    assert said["factor"] < 1
    (chance,) = [s["monte_carlo"] for s in said["states"] if "monte_carlo" in s]
    assert chance["difference"] < 0.1
    finer = [*coarse, "--sigma-um", str(10 * said["factor"] * 0.9), "--sigma-deg", "0", "--encoder-um", "0"]
    assert cli.main([*finer, "--encoder-deg", "0"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "agree"
    assert (tmp_path / "tolerance.png").stat().st_size > 10_000
    assert cli.main(["tolerance", "sher", "--samples", "10", "--out", str(tmp_path)]) == 2
    assert "--samples 10: give at least 1000" in capsys.readouterr().err
    assert cli.main(["tolerance", "sher", "--require-um", "0", "--out", str(tmp_path)]) == 2


@pytest.mark.slow
def test_the_requirement_of_a_robot_is_its_own(tmp_path, capsys):
    assert cli.main(["tolerance", "sher", "--samples", "0", "--out", str(tmp_path), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["required_um"] == 25.0
    assert "PUBLISHED" in said["requirement"]


# -- designs -------------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(stn.arrays(float, st.tuples(st.integers(1, 25), st.integers(1, 3)), elements=st.floats(-3, 3).map(round)))
def test_a_design_is_on_the_front_if_none_beats_it(rows):
    rows = np.asarray(rows, float)
    directions = [1, -1, 1][: rows.shape[1]]
    best = design.pareto(rows, directions)
    for i, mine in enumerate(rows * directions):
        beaten = any((o >= mine).all() and (o > mine).any() for o in rows * directions)
        assert best[i] == (not beaten)


def test_a_stretched_part_has_its_length_and_the_mechanism_follows(robots):
    from twin.kinematics.closed_loops import LoopSolver

    m = robots["sher"].mechanism
    assert design.distance(m, "l4:e_a-e_d") == pytest.approx(73.5 * MM)
    longer = design.stretched(m, "l4:e_a-e_d", 74 * MM)
    assert design.distance(longer, "l4:e_a-e_d") == pytest.approx(74 * MM)
    kin = twin.load("sher").kinematics(parameters={"DA": 74 * MM})
    q = m.posture("home")
    assert np.abs(LoopSolver(longer).forward(q) - kin.forward(q)).max() < 1e-9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("l_p", "write NAME=LOW..HIGH"),
        ("l_p=1..2furlong", "unit 'furlong'"),
        ("l_p=2..1mm", "the lower value 2 must be below the upper value 1"),
        ("l_q=1..2mm", "parameter 'l_q'"),
        ("bar1:r12-s9=1..2mm", "joint 's9'"),
        ("bar1:r12-s2=1..2mm", "joint 's2' is not on body 'bar1'"),
        ("bar1:r12=1..2mm", "give BODY:JOINT-JOINT"),
        ("l_p=nan..2mm", "write NAME=LOW..HIGH"),
        ("l_p=120..150deg", "l_p is given in mm; 'deg' is not a unit of length"),
        ("bar1:r12-r13=1..2deg", "bar1:r12-r13 is given in mm; 'deg' is not a unit of length"),
    ],
)
def test_a_factor_that_cannot_be_is_named(robots, text, message):
    with pytest.raises(TwinError, match=re.escape(message)):
        design.parse_factor(robots["sils"], text)


@pytest.mark.parametrize("unit", ["mm", "deg"])
def test_a_number_without_a_unit_is_given_none(unit):
    robot = SimpleNamespace(formula=SimpleNamespace(parameters=[Parameter("ratio", 2.0, "1", 2.0, "ASSUMED", "")]))
    with pytest.raises(TwinError, match=f"ratio is neither a length nor an angle; leave out '{unit}'"):
        design.parse_factor(robot, f"ratio=1..3{unit}")
    factor = design.parse_factor(robot, "ratio=1..3")
    assert (factor.low, factor.high, factor.unit) == (1, 3, "")


def test_designs_fill_their_ranges(robots):
    factors = [design.parse_factor(robots["sils"], t) for t in ("l_p=120..150mm", "l_1=170..190")]
    assert factors[1].unit == "mm"
    lhs = design.sample_designs(factors, 50, None, 3)
    assert lhs.shape == (51, 2)
    assert lhs[0] == pytest.approx([0.135, 0.182])
    strata = np.floor((lhs[1:] - [0.12, 0.17]) / [0.03, 0.02] * 50).astype(int)
    assert all(sorted(s) == list(range(50)) for s in strata.T), "one sample in each fiftieth"
    grid = design.sample_designs(factors, 0, 3, 0)
    assert grid.shape == (10, 2)
    assert sorted(set(grid[1:, 0].round(6))) == [0.12, 0.135, 0.15]
    assert np.array_equal(design.sample_designs(factors, 5, None, 3), design.sample_designs(factors, 5, None, 3))
    with pytest.raises(TwinError, match="--samples: 100000000 designs; the limit is 10000000"):
        design.sample_designs(factors, 100_000_000, None, 3)
    with pytest.raises(TwinError, match=r"--grid: .* designs; the limit is 10000000"):
        design.sample_designs(factors, 0, 10**9, 0)


def judged(folder):
    return [line.split(",")[0] for line in (folder / "rows.csv").read_text().splitlines()]


SWEEP = ["sweep", "sils", "--vary", "l_p=125..145mm", "--samples", "4", "--workers", "1", "--quiet"]


@pytest.mark.slow
def test_a_sweep_stops_and_goes_on(tmp_path, capsys):
    """Killed outright while it works; what was judged is not judged again, and the result is that of one go."""
    code = "import sys; from twin.cli import main; sys.exit(main(sys.argv[1:]))"
    rows = tmp_path / "a/rows.csv"
    first = []
    for _ in range(10):  # this program may be too late to kill it
        shutil.rmtree(tmp_path / "a", ignore_errors=True)
        process = subprocess.Popen(
            [sys.executable, "-c", code, *SWEEP, "--out", str(tmp_path / "a")], start_new_session=True
        )
        while process.poll() is None and not (rows.is_file() and len(rows.read_bytes().splitlines()) >= 2):
            time.sleep(0.05)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        first = judged(tmp_path / "a")
        if len(first) < 5:
            break
    assert 2 <= len(first) < 5
    with rows.open("a") as file:
        file.write("4,0.1")  # a line that was cut off
    assert cli.main([*SWEEP, "--out", str(tmp_path / "a"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["judged_before"] == len(first)
    assert sorted(map(int, judged(tmp_path / "a"))) == list(range(5))
    assert judged(tmp_path / "a")[: len(first)] == first
    assert cli.main([*SWEEP, "--out", str(tmp_path / "b"), "--parquet"]) == 0
    capsys.readouterr()
    assert (tmp_path / "a/sweep.csv").read_text() == (tmp_path / "b/sweep.csv").read_text()
    _, pq = table.arrow()
    rows_ = pq.read_table(tmp_path / "b/sweep.parquet").to_pylist()
    with (tmp_path / "b/sweep.csv").open() as file:
        text = list(csv.DictReader(file))
    assert [list(r) for r in rows_] == [list(r) for r in text]
    assert [float(r["volume [dm³]"]) for r in text] == [r["volume [dm³]"] for r in rows_]
    assert (tmp_path / "b/sweep.png").stat().st_size > 10_000
    # another job in that folder is not mixed with it
    assert cli.main([*SWEEP, "--seed", "5", "--out", str(tmp_path / "b")]) == 2
    assert "the folder contains another sweep" in capsys.readouterr().err
    assert len(judged(tmp_path / "b")) == 5


def test_a_sweep_of_a_robot_that_was_edited_is_another_one(tmp_path):
    """Its results must not be those of the robot before: the grid and the design of the CAD may be the same."""
    folder = own_robot.folder(tmp_path)
    keys = []
    for length in ("l_p / 3**0.5", "l_p"):
        formula = folder / "formula.py"
        formula.write_text(formula.read_text().replace("l_p / 3**0.5", length))
        robot = twin.load(folder)
        factors = [design.parse_factor(robot, "bar1:r12-s1=570..580mm")]
        job = design.design_job(robot, str(folder), None, factors, ("tolerance",))
        keys.append(table.key_of(job, design.sample_designs(factors, 0, 2, 0)))
    assert keys[0] != keys[1]


def test_a_sweep_runs_in_a_thread_too(tmp_path, monkeypatch):
    """Only the main thread can set how signals are handled; results that are stored already need no workers."""
    seen = []

    def computed(client, function, tasks):
        for i, task in enumerate(tasks):
            yield i, function(*task)

    monkeypatch.setattr("twin.analysis.sweep.cluster", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr("twin.analysis.sweep.each", computed)
    monkeypatch.setattr("twin.analysis.design.evaluate_on", lambda *_: ({"tolerance": 1.0}, "processor"))

    def run():
        seen.append(twin.sweep("sher", "l4:e_a-e_d=72..75mm", tmp_path, grid=2, workers=1))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert len(seen[0].designs) == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--vary is required"),
        (["--vary", "l_p=1..2mm", "--vary", "l_p=3..4mm"], "the same factor is given twice"),
        (["--vary", "l_p=120..150mm", "--objective", "beauty"], "objective 'beauty'"),
        (["--vary", "l_p=120..150mm", "--objective", "tolerance"], "depends on the mechanism only"),
        (["--vary", "bar1:r12-s1=570..580mm", "--objective", "volume"], "a distance of the mechanism"),
        (["--vary", "l_p=120..150mm", "--grid", "1"], "--grid 1: give at least 2"),
        (["--vary", "l_p=120..150mm", "--workers", "0"], "--workers 0: give at least 1"),
    ],
)
def test_sweep_refuses(arguments, message, tmp_path, capsys):
    assert cli.main(["sweep", "sils", "--out", str(tmp_path / "o"), *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changed", "difference"),
    [
        (lambda: twin.load("sils", variants="printed"), "the variants of the equations"),
        (lambda: twin.load("sils", parameters={"l_p": 0.13}), "the parameters l_p"),
        (lambda: twin.load("sils").with_timing("toppra"), "the timing 'toppra'"),
        (lambda: replace(twin.load("pa10"), inverse_by="points"), "the inverse by points"),
        (lambda: Robot(RobotSource(stage=Path("arm.usda"), tool="wrist")), "the option tool of twin.load"),
        (lambda: _table(dh="modified", units="m,rad"), "the option dh of twin.load, the option units of twin.load"),
        (lambda: _table(tool="wrist"), "the option tool of twin.load"),
        (lambda: _table(xacro=XacroSettings({"prefix": "left_"})), "the option xacro of twin.load"),
    ],
)
def test_a_sweep_refuses_a_robot_that_other_processes_cannot_load(changed, difference):
    with pytest.raises(TwinError, match="Write it as a robot folder") as refused:
        twin.sweep(changed(), "l_p=120..150mm")
    assert f"in: {difference}. " in str(refused.value)


def test_a_workspace_that_a_cluster_computes_needs_a_robot_that_workers_can_load():
    with pytest.raises(TwinError, match="Write it as a robot folder"):
        twin.workspace(twin.load("sils", parameters={"l_p": 0.13}), scheduler="tcp://127.0.0.1:1")


def test_a_keyword_that_does_not_exist_is_named():
    with pytest.raises(TypeError, match=r"workspace\(\) got an unexpected .* 'workers'.*scheduler, source"):
        twin.workspace("sils", workers=1)
    with pytest.raises(TypeError, match=r"sweep\(\) got an unexpected .* 'worker'.*scheduler, source, workers, device"):
        twin.sweep("sils", "l_p=120..150mm", worker=1)


def _table(tool=None, xacro=None, dh=None, units=None):
    """Return a robot of a table whose content is not read: only its options are."""
    table = Path(__file__).parents[1] / "data/dh/error_empty.csv"
    described = imported_file(table, tool, xacro, dh, units)
    return Robot(RobotSource(described=described))


def test_processes_load_the_folder_and_not_the_built_in_robot_of_its_name(tmp_path):
    (tmp_path / "cad").mkdir()
    (tmp_path / "cad/sils.toml").write_text("")
    assert name_or_path(twin.load(tmp_path)) == str(tmp_path)
    assert name_or_path(twin.load("sils")) == "sils"


def test_parquet_without_pyarrow_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(TwinError, match="pip install 'twin-robotics\\[parquet\\]'"):
        table.arrow()


# -- other processors ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    """A scheduler and two workers, each a process of its own; yields the address and the workers."""
    folder = tmp_path_factory.mktemp("dask")
    python = [sys.executable, "-m", "dask"]
    said = (folder / "scheduler.log").open("w+")
    options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(folder / "s.json")]
    processes = [subprocess.Popen([*python, "scheduler", *options], stdout=said, stderr=said, cwd=folder)]
    end = time.monotonic() + 300
    while not (folder / "s.json").is_file() and time.monotonic() < end:
        time.sleep(0.1)
    address = json.loads((folder / "s.json").read_text())["address"]
    more = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--host", "127.0.0.1"]
    workers = [
        subprocess.Popen([*python, "worker", address, *more, "--name", f"w{i}"], stdout=said, stderr=said, cwd=folder)
        for i in range(2)
    ]
    processes += workers
    from distributed import Client

    with Client(address, timeout="300s") as client:
        client.wait_for_workers(2, timeout=300)
    yield address, workers
    for p in processes:
        p.kill()
    for p in processes:
        p.wait(60)
    said.close()


def slow(folder: str, number: int) -> int:
    time.sleep(0.3)
    Path(folder, f"{number}-{os.getpid()}").write_text("")
    return number * number


@pytest.mark.slow
def test_a_cluster_gives_the_same_workspace(robots, two_workers):
    robot = robots["sher"]
    grid = grid_around(robot, (40, 40, 30), 0.003)
    here = reach.over_grid(robot, grid)
    chunk, reach.CHUNK = reach.CHUNK, 10_000
    try:
        with cluster.cluster(two_workers[0]) as client:
            there = reach.over_grid(robot, grid, client=client, source="sher")
    finally:
        reach.CHUNK = chunk
    assert here.reached.any()
    assert np.array_equal(here.values, there.values, equal_nan=True)


@pytest.mark.slow
def test_workers_of_a_cluster_load_the_robot_by_its_name(two_workers):
    here = twin.workspace("sher", 5000)
    there = twin.workspace("sher", 5000, scheduler=two_workers[0])
    assert np.array_equal(here.values, there.values, equal_nan=True)


@pytest.mark.slow
def test_a_lost_worker_loses_no_result(two_workers, tmp_path):
    address, workers = two_workers
    with cluster.cluster(address) as client:
        found = {}
        for number, result in cluster.each(client, _task(), [(str(tmp_path), i) for i in range(16)]):
            found[number] = result
            if len(found) >= 4 and list(tmp_path.glob(f"*-{workers[1].pid}")):
                workers[1].kill()
    assert workers[1].poll() is not None
    assert found == {i: i * i for i in range(16)}
    pids = {p.name.split("-")[1] for p in tmp_path.iterdir()}
    assert len(pids) == 2, "both workers had a share"


def _task():
    """A function that workers can be sent without having this file."""
    import types

    return types.FunctionType(slow.__code__, {"time": time, "Path": Path, "os": os, "__builtins__": __builtins__})


@pytest.mark.slow
def test_workers_of_its_own_are_on_this_machine_alone():
    with cluster.cluster(workers=2) as client:
        assert len(client.scheduler_info()["workers"]) == 2
        assert client.scheduler.address.startswith("tcp://127.0.0.1:")
        assert dict(cluster.each(client, pow, [(2, 3), (3, 2)])) == {0: 8, 1: 9}


@pytest.mark.slow
@pytest.mark.parametrize("step", nightly([0.04, 0.02, 0.01], every=3))
@pytest.mark.parametrize("thick", [0.03, 0.2])
def test_the_stated_error_of_a_volume_holds_for_known_bodies(step, thick):
    """Slanted slabs and balls, on a grid shifted at random: nearly all are within two stated errors."""
    rng = np.random.default_rng(7)
    held = []
    for _ in range(12):
        axes = [np.arange(-0.5, 0.5, step) + step * rng.random() for _ in range(3)]
        p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        n = rng.normal(size=3)
        shell = np.linalg.norm(p, axis=-1)
        inside = (shell < 0.4) & (shell > 0.4 - thick) & (p @ n > 0)
        true = 2 * np.pi / 3 * (0.4**3 - (0.4 - thick) ** 3)
        cell = step**3
        held.append(abs(cell * inside.sum() - true) <= 2 * volume_error(inside, cell))
    assert np.mean(held) >= 0.75
    assert volume_error(inside, cell) < 0.5 * true


@pytest.mark.nightly
def test_workspace_and_sweep_agree_within_the_errors_that_they_state(monkeypatch):
    """Without limits of passive joints, which a sweep names as not checked."""
    robot = twin.load("sils")
    monkeypatch.setattr(reach, "passive_check", lambda robot: None)
    T = reach.centre(robot)
    low, high = reach.box(robot, T)
    step = float(np.prod(high - low) / 150_000) ** (1 / 3)
    nx, ny, nz = (int(n) for n in np.floor((high - low) / step) + 1)
    fine = reach.over_grid(robot, PoseGrid(low, step, (nx, ny, nz), T[:3, :3])).content()
    work = design.design_job(robot, "sils", None, [design.parse_factor(robot, "l_p=120..150mm")], ("volume",))
    coarse = design.evaluate(work, [robot.kinematics().parameters["l_p"]])["volume"]
    apart, stated = abs(coarse - fine["volume_dm3"]), design.grid_error(work) + fine["volume_error_dm3"]
    assert apart < stated < 0.2 * fine["volume_dm3"]


def test_a_workspace_without_positions_is_an_empty_cloud(tmp_path):
    from pxr import Usd, UsdGeom

    grid = PoseGrid(np.zeros(3), 0.01, (2, 2, 2), np.eye(3))
    space = Workspace("arm", grid, np.zeros((8, 4)))
    cloud.write_usd(space, tmp_path / "workspace.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "workspace.usdc"))
    assert not UsdGeom.Points(stage.GetDefaultPrim()).GetPointsAttr().Get()
