"""Robots with fewer than six freedoms: led by their joints, or in the directions that they have."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from made import linkages
from made.lanes import nightly
from made.loops import mechanism
from twin import api, cli
from twin.core import spatial
from twin.core.errors import ProtocolError
from twin.exchange.read.imported_robot import Imported
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.kinematics.closed_loops import LoopSolver
from twin.model.joint import Joint
from twin.planning.protocol import load_protocol
from twin.reference import ReferenceModel

pytestmark = pytest.mark.usefixtures("no_plots")

NAMES = tuple(linkages.LINKAGES)


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """A function that writes the robot folder of a linkage, without CAD, as `twin new` would."""

    def write(name):
        folder = tmp_path_factory.mktemp("freedoms") / name
        imported = close(Imported(linkages.mechanism(linkages.LINKAGES[name](), name)))
        write_folder(imported, name, folder, folder / f"{name}.py")
        return folder

    return write


@pytest.fixture(scope="module")
def five_bar(folder_of):
    folder = folder_of("five_bar")
    (folder / "formula.py").write_text(linkages.LINKAGES["five_bar"]().formula)
    return folder


def waypoint(name, position, angles=(0, 0, 0)):
    pose = f"position_mm = {[float(v) for v in position]}\nangles_deg = {[float(v) for v in angles]}"
    return f'[waypoints.{name}]\n{pose}\nprovenance = "ASSUMED"\nnote = "test"\n'


def by_poses(folder, goal, top=""):
    """Return a protocol that goes straight from home to a waypoint (text of its table)."""
    text = (folder / "trajectories/first.toml").read_text()
    text = text[: text.index("[waypoints.near]")].replace("limits.joints", "limits.positioning")
    path = folder / "trajectories/straight.toml"
    text = text.replace('name = "first"', f'name = "straight"\n{top}', 1) + goal
    path.write_text(text + '[[phases]]\ntype = "positioning"\nname = "go"\nto = "goal"\n')
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_first_protocol_can_be_followed_whatever_the_freedoms(name, folder_of):
    robot = api.load(folder_of(name))
    assert robot.reference().freedoms == linkages.LINKAGES[name]().freedoms
    trajectory = api.plan(robot)
    assert trajectory.followed
    assert not [f for f in trajectory.findings if f.severity in ("error", "disagreement")]
    model = robot.reference()
    for k in np.linspace(0, len(trajectory.t) - 1, 7).astype(int):
        state = model.solve(trajectory.q[k])
        np.testing.assert_allclose(state.T_base_tool, trajectory.Ts_base_tool[k], atol=1e-10)
    # speeds and accelerations are those of the poses
    dt = trajectory.step
    v = np.gradient(trajectory.Ts_base_frame[:, :3, 3], dt, axis=0)
    scale = max(np.abs(trajectory.tip_acceleration).max(), 1e-3)
    assert np.abs(v - trajectory.tip_velocity)[1:-1].max() < scale * dt
    slope = np.gradient(trajectory.q, dt, axis=0)[1:-1]
    assert np.abs(slope - trajectory.qd[1:-1]).max() < max(np.abs(trajectory.qdd).max(), 1e-3) * dt


def test_a_line_is_led_in_the_directions_that_there_are(five_bar):
    robot = api.load(five_bar)
    turned = np.degrees(five_bar_turn(robot, [0.03, 0.12]))
    path = by_poses(five_bar, waypoint("goal", (30, 120, 0), (turned, 0, 0)))
    trajectory = api.plan(robot, path)
    p = trajectory.Ts_base_tool[:, :3, 3]
    along = (p - p[0]) @ (p[-1] - p[0]) / np.sum((p[-1] - p[0]) ** 2)
    assert np.abs(p - p[0] - along[:, None] * (p[-1] - p[0])).max() < 1e-9  # a straight line of the tool
    np.testing.assert_allclose(trajectory.q, robot.kinematics().inverse_many(trajectory.Ts_base_tool), atol=1e-9)
    assert not [f for f in trajectory.findings if f.severity in ("error", "disagreement")]


def five_bar_turn(robot, xy):
    """Return the turn in rad about z of the rod that carries the tool, from where it is drawn."""
    T = np.eye(4)
    T[:2, 3] = xy
    q = robot.kinematics().inverse(T)
    return np.arctan2(*robot.reference().solve(q).T_base_tool[[1, 0], 0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("position", "angles", "said"),
    [
        ((30, 120, 3.25), None, r"3\.25 mm in z"),
        ((30, 120, 0), (0, 5, 0), r"4\.9\d* deg about y"),
        ((30, 120, 0), (40, 0, 0), r"deg about z"),
    ],
)
def test_a_pose_outside_the_freedoms_is_a_mistake_of_the_protocol_and_its_advice_is_true(
    five_bar, position, angles, said, capsys
):
    robot = api.load(five_bar)
    turned = np.degrees(five_bar_turn(robot, [0.03, 0.12]))
    angles = (turned, 0, 0) if angles is None else angles if angles[0] else (turned, angles[1], 0)
    path = by_poses(five_bar, waypoint("goal", position, angles))
    with pytest.raises(ProtocolError, match=said) as caught:
        api.plan(robot, path)
    message = str(caught.value)
    assert cli.main(["validate", str(five_bar), "--protocol", "straight", "--quiet"]) == 2
    assert re.search(said, capsys.readouterr().err)
    wrong = path.read_text()
    pose = re.search(r"position_mm = (\[.*?\]), angles_deg = (\[.*?\])", message)
    by_poses(five_bar, waypoint("goal", json.loads(pose[1]), json.loads(pose[2])))
    assert api.plan(robot, path).followed
    free = re.search(r"free = \[.*?\]", message)[0]
    path.write_text(wrong.replace('name = "straight"\n', f'name = "straight"\n{free}\n', 1))
    assert load_protocol(path).free
    end = api.plan(robot, path)
    assert not [f for f in end.findings if f.severity in ("error", "disagreement")]
    np.testing.assert_allclose(end.Ts_base_tool[-1, :2, 3], [0.03, 0.12], atol=1e-9)


def test_wrong_joint_values_are_told_with_the_way_out(five_bar):
    robot = api.load(five_bar)
    protocol = robot.protocol()
    near = protocol.waypoints["near"]
    for values, angle, said in (
        ({"j9": 0.1}, True, "no driven joint 'j9'"),
        ({"j1": 0.1}, False, "joint 'j1' is in deg: write j1_deg, not j1_mm"),
        ({}, True, "the phase has no length"),
        ({"j1": 3.0}, True, r"cannot be carried out: .*% of the way|limit|opens?"),
    ):
        given = replace(near, joints=values, angle_joints=frozenset(values if angle else ()))
        wrong = replace(protocol, waypoints={**protocol.waypoints, "near": given})
        with pytest.raises(ProtocolError, match=said):
            api.plan(robot, wrong)


@pytest.fixture(scope="module")
def rolled_and_pitched(tmp_path_factory):
    """A folder of an arm with a remote centre at the origin: roll about x, pitch about y, insertion along z."""
    axes = {"roll": np.eye(3)[0], "pitch": np.eye(3)[1], "insertion": np.eye(3)[2]}
    bodies = ["base", "frame", "arm", "instrument"]
    joints = []
    for i, (name, axis) in enumerate(axes.items()):
        T = spatial.pose(spatial.frame_from_axes(axis, np.roll(axis, 1)))
        kind = "prismatic" if name == "insertion" else "revolute"
        joints.append(Joint(name, kind, bodies[i], bodies[i + 1], T, T, active=True))
    tool = spatial.pose(spatial.exp_so3(np.array([np.pi, 0, 0])))
    folder = tmp_path_factory.mktemp("rcm") / "rcm"
    made = mechanism(*joints, tool="instrument", T_tool=tool, rest={b: np.eye(4) for b in bodies})
    write_folder(close(Imported(made)), "rcm", folder, folder / "rcm.py")
    return folder


def pivoting(folder, free):
    """Return a protocol of an insertion and a pivot about both axes at once."""
    text = (folder / "trajectories/first.toml").read_text()
    start, waypoints = text.index("[limits.joints]"), text.index("[waypoints.home]")
    limits = text[start : text.index("[limits.home]")]
    near = text.index("[waypoints.near]")
    roll, pitch, flip = (spatial.exp_so3(np.array(v)) for v in ([0.26, 0, 0], [0, 0.35, 0], [np.pi, 0, 0]))
    turned = roll @ pitch @ flip
    psi, theta, phi = np.degrees(spatial.euler_angles(turned, "zyx"))
    goal = f"[waypoints.aside]\nangles_deg = {[float(psi), float(theta), float(phi % 360)]}\ndepth_mm = 50\n"
    path = folder / "trajectories/look.toml"
    path.write_text(
        text[:start].replace('name = "first"', f'name = "look"\nfree = {json.dumps(free)}', 1)
        + limits.replace("joints", "insertion", 1)
        + limits.replace("joints", "pivot", 1)
        + text[waypoints:near]
        + goal
        + 'provenance = "ASSUMED"\nnote = "test"\n'
        + '[[phases]]\ntype = "insertion"\nname = "in"\ndepth_mm = 50\n'
        + '[[phases]]\ntype = "pivot"\nname = "look"\nto = "aside"\nrcm = "enforced"\n'
    )
    return path


def test_a_pivot_of_an_arm_without_roll_of_its_shaft_leaves_free_directions_to_the_arm(rolled_and_pitched):
    robot = api.load(rolled_and_pitched)
    with pytest.raises(ProtocolError, match="prescribes 6 directions, but the robot has 3 driven joints") as caught:
        api.plan(robot, pivoting(rolled_and_pitched, []))
    free = json.loads(re.search(r"free = (\[.*?\])", str(caught.value))[1])
    trajectory = api.plan(robot, pivoting(rolled_and_pitched, free))
    np.testing.assert_allclose(trajectory.q[-1], [0.26, 0.35, -0.05], atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("", "", 0),
        pytest.param("- lift_2", "+ lift_2", 1, marks=pytest.mark.slow),
        pytest.param("mm(80,", "mm(80.1,", 1, marks=pytest.mark.nightly),
    ],
)
def test_the_equations_of_a_planar_robot_agree_and_a_fault_in_them_disagrees(five_bar, old, new, code, tmp_path):
    formula = five_bar / "formula.py"
    right = formula.read_text()
    try:
        formula.write_text(right.replace(old, new, 1))
        assert cli.main(["validate", str(five_bar), "--protocol", "first", "--quiet", "--out", str(tmp_path)]) == code
    finally:
        formula.write_text(right)


@pytest.mark.nightly
def test_a_full_turn_in_the_equations_is_stated_and_is_no_disagreement(five_bar, tmp_path, capsys):
    formula = five_bar / "formula.py"
    right = formula.read_text()
    try:
        formula.write_text(right.replace("+ lift_1 - zero_1", "+ lift_1 - zero_1 - 2 * np.pi", 1))
        assert cli.main(["validate", str(five_bar), "--protocol", "first", "--json", "--out", str(tmp_path)]) == 0
    finally:
        formula.write_text(right)
    findings = {f["code"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert "is 1 full turn below the mechanism's" in findings["driven.turns"]["message"]


@pytest.mark.slow
def test_a_workspace_says_which_joints_have_no_limits(five_bar, tmp_path, capsys):
    arguments = ["workspace", str(five_bar), "--count", "1000", "--out", str(tmp_path)]
    assert cli.main(arguments) == 0
    said = capsys.readouterr().out
    names = [j.name for j in api.load(five_bar).mechanism.active]
    assert f"{', '.join(names)}: no limits are stated; -180° to 180° is assumed" in said
    assert json.loads((tmp_path / "workspace.json").read_text())["without_limits"] == names


@pytest.mark.slow
def test_texts_of_a_first_robot_have_no_empty_parts(folder_of, tmp_path, capsys):
    """Without equations there are no variants, and small files have a size."""
    folder = folder_of("sarrus")
    assert cli.main(["validate", str(folder), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "sarrus · first"
    assert cli.main(["build", str(folder), "--out", str(tmp_path / "usd")]) == 0
    assert "(0 kB)" not in capsys.readouterr().out


def test_a_sweep_of_a_planar_robot_proposes_only_what_sweep_can_do(five_bar, tmp_path, capsys):
    assert cli.main(["sweep", str(five_bar), "--vary", "b=79..81mm", "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert "vary a distance of the mechanism (body:joint-joint)" in message
    assert "--tilt-deg" not in message
    assert "--joints" not in message


def test_the_mechanism_is_driven_from_its_drawing_to_joint_values_a_full_turn_away(five_bar):
    robot = api.load(five_bar)
    model, q = robot.reference(), robot.reference().home().q + 0.1
    T = model.solve(q).T_base_tool
    away = q + 2 * np.pi * np.array([1, -1])
    np.testing.assert_allclose(model.solve(away).T_base_tool, T, atol=1e-10)
    np.testing.assert_allclose(model.solve_many(np.array([q, away])).Ts_base_tool, [T, T], atol=1e-10)
    run = model.run(np.linspace(away, away + 0.05, 5))
    np.testing.assert_allclose(run.q, np.linspace(away, away + 0.05, 5))
    np.testing.assert_allclose(run.Ts_base_tool[0], T, atol=1e-10)


def test_the_drawn_value_of_a_joint_is_in_the_turn_that_its_limits_allow(five_bar):
    mechanism = api.load(five_bar).mechanism
    cases = (((-1.0, 1.0), 0), ((5.0, 7.0), 1), ((-8.0, -5.0), -1), ((-7.0, 7.0), 0), ((1e-13, 6.2), 0))
    for limits, turn in cases:
        joints = tuple(replace(j, limits=limits) if j.active else j for j in mechanism.joints)
        limited = replace(mechanism, joints=joints)
        drawn = ReferenceModel(limited).home().q
        np.testing.assert_allclose(drawn, 2 * np.pi * turn, atol=1e-9)
        np.testing.assert_allclose(LoopSolver(limited).q, drawn, atol=1e-9)


@pytest.mark.slow
def test_equations_that_lead_only_forward_are_judged_by_where_they_put_the_tool(folder_of, capsys):
    folder = folder_of("slider_crank")
    right = linkages.LINKAGES["slider_crank"]().formula
    for text, code in ((right, 0), (right.replace("l**2 -", "l**2 +"), 1)):
        (folder / "formula.py").write_text(text)
        assert cli.main(["validate", str(folder), "--quiet"]) == code
    assert "at the same joint values, the forward equations (" in capsys.readouterr().out


def test_six_freedoms_are_planned_by_the_equations_and_joints_by_the_mechanism():
    robot = api.load("sils")
    protocol = robot.protocol()
    assert not api.plan(robot, protocol).followed
    home = robot.reference().home().q
    start = replace(protocol.waypoints[protocol.start], position=None, joints={}, name="drawn")
    joints = dict(zip(robot.joints, home + 0.004 * np.array([1, -1, 1, 1, -1, 1]), strict=True))
    goal = replace(start, joints=joints, name="moved")
    from twin.planning.protocol import Joints

    limits = {**protocol.limits, "joints": protocol.limits["positioning"]}
    mixed = replace(
        protocol,
        start="drawn",
        waypoints={"drawn": start, "moved": goal},
        phases=(Joints("shift", "moved"),),
        limits=limits,
        rcm=None,
    )
    trajectory = api.plan(robot, mixed)
    np.testing.assert_allclose(trajectory.q[-1], list(joints.values()), atol=1e-12)
    np.testing.assert_allclose(robot.kinematics().inverse_many(trajectory.Ts_base_tool), trajectory.q, atol=1e-9)


# -- drawn, and from end to end -------------------------------------------------------------------------


@pytest.fixture(scope="session")
def drawn(tmp_path_factory):
    """A function that draws a linkage once."""
    folder = tmp_path_factory.mktemp("drawn")

    def of(name):
        path = folder / f"{name}.step"
        if not path.is_file():
            linkages.draw(linkages.LINKAGES[name](), path)
        return path

    return of


@pytest.mark.slow
@pytest.mark.parametrize("name", nightly(["bennett", *(n for n in NAMES if n != "bennett")], every=len(NAMES)))
def test_a_drawn_linkage_passes_every_command(name, drawn, tmp_path, capsys):
    from twin.ui.session.movable_robot import MovableRobot

    linkage, folder = linkages.LINKAGES[name](), tmp_path / name
    assert cli.main(["new", name, "--from", str(drawn(name)), "--out", str(folder), "--quiet"]) == 0
    linkages.finish(folder / f"cad/{name}.toml", linkage)
    capsys.readouterr()
    assert cli.main(["info", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["degrees_of_freedom"] == linkage.freedoms
    # nothing moves yet: the protocol is wrong, and says how to write it
    assert cli.main(["validate", str(folder), "--quiet"]) == 2
    advice = re.search(r"joints = \{.*?\}", capsys.readouterr().err)[0]
    path = folder / "trajectories/first.toml"
    before, after = path.read_text().split("[waypoints.near]")
    path.write_text(before + "[waypoints.near]" + re.sub(r"joints = \{.*?\}", advice, after, count=1))
    assert cli.main(["validate", str(folder), "--quiet"]) == 0
    if linkage.formula:
        (folder / "formula.py").write_text(linkage.formula)
        assert cli.main(["validate", str(folder), "--quiet"]) == 0
        assert cli.main(["explain", str(folder), "--quiet"]) == 0
    else:
        assert cli.main(["explain", str(folder), "--quiet"]) == 2  # there is nothing to explain
    assert cli.main(["build", str(folder), "--quiet"]) == 0
    assert cli.main(["export", str(folder), "--out", str(tmp_path / "export"), "--quiet"]) == 0
    movable = MovableRobot(api.load(folder))
    assert movable.move_joint(0, movable.assembly.q[0] + 0.02).good
