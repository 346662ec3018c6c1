"""The view-model without a browser: moving by tool, joint and point, instruments, clock, shapes, the command."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import twin
from made.lanes import one_of_a_kind
from made.ways import leads
from twin.cli import main
from twin.core import spatial
from twin.core.errors import KinematicsError, MechanismError, TwinError
from twin.core.units import MM
from twin.model.joint_distance import kinematic_distances, with_distance
from twin.ui.headset.state_document import reading_entries
from twin.ui.session.display_meshes import CREASE_ANGLE, behind, creased, display_meshes
from twin.ui.session.movable_robot import MovableRobot, MoveResult
from twin.ui.session.readings import read
from twin.ui.session.timeline import Clock, Playback, protocols_of
from twin.ui.viewer import readout
from twin.ui.viewer.curves_panel import MIN_SPAN, curves
from twin.ui.viewer.design_panel import MAX_SHOWN_POINTS, point_step, refusal_html, residual_html

ROBOTS = one_of_a_kind()


@pytest.fixture(scope="module", params=ROBOTS)
def any_movable(request):
    return MovableRobot(twin.load(request.param))


@pytest.fixture
def sils():
    return MovableRobot(twin.load("sils"))


def home(movable):
    movable.go_to_posture("home")
    return movable


def to_the_end(move):
    """Ask for a move until it is there or stopped: what takes long goes on when it is asked for again."""
    for _ in range(200):
        if not (moved := move()).more:
            return moved
    pytest.fail("the move does not end")


# -- moving -------------------------------------------------------------------------------------------


def test_the_tool_goes_where_it_is_dragged(any_movable, rng):
    movable = home(any_movable)
    six = len(movable.joints) >= 6 or movable.robot.name == "sher"  # SHER keeps its attitude with five
    ways = leads(movable.robot)
    for _ in range(20):
        T = movable.assembly.T_base_tool.copy()
        T[:3, 3] += ways @ rng.normal(0, 0.4 * MM, ways.shape[1])
        moved = to_the_end(lambda: movable.move_tool(T))  # noqa: B023
        assert moved.good, moved.reason
        reached = movable.assembly.T_base_tool
        assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) < 1e-7
        if six:
            assert spatial.rotation_angle(reached[:3, :3].T @ T[:3, :3]) < 1e-7
        assert movable.assembly.worst_gap < 1e-9


@pytest.mark.slow
def test_out_of_reach_keeps_the_last_good_pose_and_says_why(any_movable):
    movable = home(any_movable)
    before = movable.assembly
    T = before.T_base_tool.copy()
    T[:3, 3] += [3.0, 0, 0]
    moved = to_the_end(lambda: movable.move_tool(T))
    assert not moved.good
    assert moved.reason
    assert read(movable).reason == moved.reason
    if movable.robot.name in ("sils", "pa10"):  # the others follow the hand as far as they can
        assert movable.assembly is before
    assert movable.assembly.worst_gap < 1e-9


def test_a_joint_stops_at_its_limit_and_names_it(sils):
    high = sils.mechanism.limits[1, 1]
    moved = to_the_end(lambda: sils.move_joint(1, high + 0.02))
    assert "q2 = 600.000 mm is beyond its limit of 580.000 mm" in moved.reason
    assert sils.assembly.q[1] <= high
    assert "nearest limit: q2, 0.0 mm left" in readout.headline(read(sils))
    assert sils.assembly.worst_gap < 1e-9
    assert sils.move_joint(0, sils.assembly.q[0] + 2 * MM).good


def test_a_limit_that_can_be_reached_is_reached():
    movable = MovableRobot(twin.load("pa10"))
    moved = to_the_end(lambda: movable.move_joint(0, 99.0))
    assert "q1 = 5672" in moved.reason
    assert "limit of 177.000°" in moved.reason
    assert movable.assembly.q[0] == pytest.approx(movable.mechanism.limits[0, 1])


def test_any_point_of_a_link_can_be_led_and_the_loops_follow(any_movable):
    movable = home(any_movable)
    tool = movable.mechanism.frame(movable.mechanism.tool)
    p = tool.T_body_frame[:3, 3]
    ways = leads(movable.robot)
    step = ways @ ways.T @ np.array([2, 1, -1]) * MM
    target = (movable.assembly.link_poses[tool.body] @ np.append(p, 1.0))[:3] + step
    for _ in range(3):
        movable.move_point(tool.body, p, target)
    left = np.linalg.norm((movable.assembly.link_poses[tool.body] @ np.append(p, 1.0))[:3] - target)
    assert left < 1e-8
    assert movable.assembly.worst_gap < 1e-9


def test_a_passive_link_moves_its_loop(sils):
    body, p = "strut1", np.zeros(3)
    before = sils.assembly.link_poses[body][:3, 3].copy()
    vertices = next(m.vertices for m in sils.mechanism.body(body).meshes)
    p = vertices[np.argmax(np.linalg.norm(vertices, axis=1))]
    start = (sils.assembly.link_poses[body] @ np.append(p, 1.0))[:3]
    for k in range(1, 6):
        sils.move_point(body, p, start - np.array([0, 0, k * MM]))
    end = (sils.assembly.link_poses[body] @ np.append(p, 1.0))[:3]
    assert end[2] - start[2] == pytest.approx(-5 * MM, abs=0.5 * MM)
    assert not np.allclose(before, sils.assembly.link_poses[body][:3, 3]) or not np.allclose(start, end)
    assert sils.assembly.worst_gap < 1e-9


def test_a_point_that_nothing_moves_stays(sils):
    before = sils.assembly
    moved = to_the_end(lambda: sils.move_point(sils.mechanism.base, np.zeros(3), np.array([0.5, 0.0, 0.0])))
    assert "no joint motion brings the point nearer" in moved.reason
    assert sils.assembly is before


def test_postures_are_kept_and_found_again(sils):
    sils.go_to_posture("insertion")
    q = sils.assembly.q.copy()
    sils.keep("mine")
    sils.go_to_posture("home")
    assert not np.allclose(sils.assembly.q, q)
    assert sils.go_to_posture("mine").good
    np.testing.assert_allclose(sils.assembly.q, q, atol=1e-12)
    assert "mine" in sils.postures
    with pytest.raises(TwinError, match="Did you mean 'home'"):
        sils.go_to_posture("hom")


# -- instruments --------------------------------------------------------------------------------------


def test_equations_and_mechanism_agree_where_they_should(any_movable):
    reading = read(home(any_movable))
    assert reading.agrees
    assert reading.residual[0] < 1e-8
    assert len(reading.limits) == len(any_movable.joints)
    assert all(part is None or 0 <= part <= 1 for part in (limit.part for limit in reading.limits))
    assert "agree" in readout.table(reading)
    assert "DISAGREE" not in readout.table(reading)


def test_the_printed_formula_stretches_the_platform_and_the_readout_turns_red(sils):
    from itertools import combinations

    sils.go_to_posture("home")  # roll and pitch differ here, and so the misprint shows
    good = read(sils)
    sides = [np.linalg.norm(good.points[a] - good.points[b]) for a, b in combinations(("s1", "s2", "s3"), 2)]
    sils.change({"eq1": "printed"})
    bad = read(sils)
    stretched = [np.linalg.norm(bad.points[a] - bad.points[b]) for a, b in combinations(("s1", "s2", "s3"), 2)]
    assert max(abs(a - b) for a, b in zip(sides, stretched, strict=True)) > 0.5 * MM
    assert not bad.agrees
    assert bad.residual[0] > 0.5 * MM
    assert "DISAGREE" in readout.table(bad)
    assert "data-agrees='no'" in readout.table(bad)
    assert "equations DISAGREE" in readout.headline(bad)
    sils.change({"eq1": "corrected"})
    assert "equations agree: exact" in readout.headline(read(sils))
    assert read(sils).agrees


def test_a_parameter_that_is_wrong_shows(sils):
    name = "l_p"
    value = sils.kin.parameters[name]
    sils.change(parameters={name: value + 0.6 * MM})
    reading = read(sils)
    assert not reading.agrees
    assert 0.1 * MM < reading.residual[0] < 2 * MM
    with pytest.raises(KinematicsError):
        sils.change(parameters={"no_such": 1.0})
    assert sils.kin.parameters[name] == pytest.approx(value + 0.6 * MM)


def test_a_parameter_is_reset_or_stays_changed_where_that_fails(sils, monkeypatch):
    published = sils.kin.parameters["l_p"]
    sils.change(parameters={"l_p": published + 0.6 * MM})
    with monkeypatch.context() as broken:
        broken.setattr(sils, "_compiled_equations", raised)
        with pytest.raises(KinematicsError, match="no compiler"):
            sils.reset_parameter("l_p")
    assert sils.parameters == {"l_p": pytest.approx(published + 0.6 * MM)}
    sils.reset_parameter("l_p")
    assert (sils.parameters, sils.kin.parameters["l_p"]) == ({}, published)
    with pytest.raises(KinematicsError, match="no_such"):
        sils.reset_parameter("no_such")


def raised(robot):
    raise KinematicsError("no compiler")


@pytest.mark.parametrize("count", [0, 1, MAX_SHOWN_POINTS, MAX_SHOWN_POINTS + 1, 2 * MAX_SHOWN_POINTS - 1])
def test_no_more_workspace_points_are_shown_than_stated(count):
    assert len(range(0, count, point_step(count))) <= MAX_SHOWN_POINTS


def test_a_mechanism_that_is_redesigned_leaves_its_equations(sils):
    drawn = sils.mechanism
    body = next(b for b in drawn.bodies if b.name == "strut1")
    a, b = (j.name for j in drawn.joints if body.name in (j.parent, j.child))
    Ts = [j.T_parent_joint if j.parent == body.name else j.T_child_joint for j in (drawn.joint(a), drawn.joint(b))]
    length = float(np.linalg.norm(Ts[0][:3, 3] - Ts[1][:3, 3]))
    sils.redesign(with_distance(drawn, b, a, length + 0.5 * MM))
    assert sils.edited
    assert not read(sils).agrees
    sils.redesign(drawn)
    assert read(sils).agrees
    with pytest.raises(MechanismError):
        sils.redesign(with_distance(drawn, b, a, -1.0))


def test_a_stage_without_equations_can_be_moved(tmp_path):
    movable = MovableRobot(twin.load(twin.load("hibou").files.stage))
    assert movable.kin is None
    T = movable.assembly.T_base_tool.copy()
    reading = read(movable)
    assert [c[0] for c in reading.coordinates] == ["x", "y", "z", "rx", "ry", "rz"]
    assert reading.residual is None
    T[:3, 3] += [0, 0, 1 * MM]
    movable.move_tool(T)
    assert movable.assembly.T_base_tool[2, 3] == pytest.approx(T[2, 3], abs=1e-6)


# -- the clock ----------------------------------------------------------------------------------------


def test_the_clock_plays_holds_loops_and_ends():
    clock = Clock()
    clock.play()
    assert not clock.playing  # nothing to play
    clock.duration = 2.0
    clock.play()
    assert clock.advance(0.5)
    assert clock.time == 0.5
    clock.speed = 4.0
    assert clock.advance(0.5)
    assert clock.time == pytest.approx(0.5)  # once round
    clock.loop = False
    clock.advance(1.0)
    assert (clock.time, clock.playing) == (2.0, False)
    clock.play()
    assert clock.time == 0.0
    clock.seek(-3)
    assert clock.time == 0.0


# -- shapes -------------------------------------------------------------------------------------------


def area(vertices, triangles):
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_edges_are_sharp_where_trimesh_has_them_sharp():
    import trimesh

    for body in twin.load("hibou").mechanism.bodies:
        for mesh in body.meshes:
            theirs = trimesh.graph.smooth_shade(
                trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False), angle=CREASE_ANGLE, facet_minarea=None
            )
            vertices, triangles = creased(mesh.vertices, mesh.triangles)
            assert len(vertices) == len(theirs.vertices)
            np.testing.assert_array_equal(vertices[triangles], mesh.vertices[mesh.triangles])


@given(part=st.floats(0.05, 0.95), normal=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1))
def test_both_sides_of_a_cut_make_the_whole(part, normal):
    vertices, triangles = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1.0)]), np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
         [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    n = np.array(normal) / np.linalg.norm(normal)
    sides = [behind(vertices, triangles, np.full(3, part), s * n) for s in (1, -1)]
    assert sum(area(*s) for s in sides) == pytest.approx(6.0, abs=1e-9)
    for sign, (v, f) in zip((1, -1), sides, strict=True):
        assert (((v - part) @ n)[f] * sign <= 1e-9).all()


def test_a_body_has_one_node_for_each_colour():
    mechanism = twin.load("sils").mechanism
    for body in mechanism.bodies:
        colors = {m.color_rgba for m in body.meshes}
        assert len(display_meshes(body)) == len(colors)


# -- the command --------------------------------------------------------------------------------------


def test_a_port_that_is_taken_is_told_with_a_free_one(capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert main(["view", "hibou", "--port", str(port), "--no-browser"]) == 2
    assert f"port {port} is in use" in (said := capsys.readouterr().err)
    assert re.search(r"use the free port (\d+) \(--port \1\)", said)


def test_what_cannot_be_shown_is_told_before_anything_opens(capsys):
    assert main(["view", "sil", "--no-browser", "--port", "0"]) == 2
    assert "Did you mean 'sils'" in capsys.readouterr().err
    assert main(["view", "hibou", "cavitty", "--no-browser", "--port", "0"]) == 2
    assert "cavity" in capsys.readouterr().err
    assert main(["view", "vsrs", "cavity", "--no-browser", "--port", "0"]) == 2
    assert "is a scene" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals and process groups of POSIX")
def test_ctrl_c_leaves_nothing_behind():
    command = [sys.executable, "-m", "twin", "view", "hibou", "--port", "0", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, **pipes, text=True, start_new_session=True)
    line = process.stdout.readline()
    assert "http://127.0.0.1:" in line
    time.sleep(2.5)  # the planning process has begun by now
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "Traceback" not in err + out
    for _ in range(600):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return  # no child lives on in its session
        time.sleep(0.1)
    pytest.fail("a process outlives the viewer")


def test_the_desk_of_a_robot_with_its_trocar_elsewhere():
    movable = MovableRobot(twin.load("lapbot"))
    robot = movable.robot.bound(movable.robot.protocol("other_port"))
    movable.bind(robot)
    np.testing.assert_allclose(movable.mechanism.trocar_at(), robot.protocol("other_port").trocars[""], atol=1e-12)
    assert read(movable).agrees
    assert not movable.edited
    movable.mechanism = replace(movable.mechanism)
    assert movable.edited


def test_new_trocars_keep_a_changed_design_and_forget_the_last_request():
    movable = MovableRobot(twin.load("lapbot"))
    assert movable.move_tool(movable.assembly.T_base_tool).good
    distance = kinematic_distances(movable.mechanism)[0]
    ends = (distance.joint, distance.other)
    length = distance.distance + 1 * MM
    movable.redesign(with_distance(movable.mechanism, *ends, length))
    movable.last_move = MoveResult(False, "of the old trocar")
    robot = movable.robot.bound(movable.robot.protocol("other_port"))
    movable.bind(robot)
    assert movable.requested_pose is None
    assert movable.last_move.good
    assert movable.edited
    np.testing.assert_allclose(movable.mechanism.trocar_at(), robot.protocol("other_port").trocars[""], atol=1e-12)
    now = [each.distance for each in kinematic_distances(movable.mechanism) if (each.joint, each.other) == ends]
    assert now == [pytest.approx(length)]


def test_texts_in_the_readout_are_escaped_and_no_phases_are_an_empty_bar(sils):
    assert "a &lt; b" in readout.table(read(sils), "a < b")
    assert "<span" not in readout.phase_bar([], "")


def test_a_coordinate_that_rounds_to_zero_has_no_sign_and_a_small_one_keeps_its_sign():
    shown = [readout._number("x", value, unit) for value in (-0.0005, -0.00004, -0.0) for unit in ("°", "mm")]
    texts = [text.rpartition("</span> ")[2].removesuffix("</span>") for text in shown]
    assert texts == ["-0.0005 °", "-0.001 mm", "0.0000 °", "0.000 mm", "0.0000 °", "0.000 mm"]


def test_a_protocol_file_with_the_name_of_another_protocol_is_refused(tmp_path, capsys, monkeypatch):
    for opens in ("browser_viewer._show_page", "headset_server.serve_until_stopped"):
        monkeypatch.setattr(f"twin.cli.{opens}", lambda *_: pytest.fail("a page opens"))
    own = twin.load("hibou").files.protocols()["cavity"]
    other = tmp_path / "other.toml"
    shutil.copy(own, other)
    for command in ("view", "serve"):
        assert main([command, "hibou", str(other), "--no-browser", "--port", "0"]) == 2
        assert "the robot already has a protocol named 'cavity': rename" in capsys.readouterr().err
    assert protocols_of(twin.load("hibou"), str(own)) == {"cavity": str(own)}
    assert protocols_of(twin.load("raven_left"), "around/dome")["dome"] == "around/dome"


@pytest.mark.parametrize("failing", ["kinematics", "assembly", "hand"])
def test_a_robot_that_cannot_be_bound_leaves_the_desk_as_it_was(monkeypatch, failing):
    movable = MovableRobot(twin.load("hibou"))
    before = dict(vars(movable))

    def fail(*_: object) -> None:
        raise TwinError("no")

    robot = twin.load("hibou")
    where = {"kinematics": "api.Robot.kinematics", "assembly": "reference.ReferenceModel.solve"}
    monkeypatch.setattr(f"twin.{where.get(failing, 'ui.session.movable_robot.DragSolver')}", fail)
    with pytest.raises(TwinError, match="no"):
        movable.bind(robot)
    assert all(vars(movable)[name] is value for name, value in before.items())


@pytest.mark.parametrize("worst", [0.0, 1e-16, 3e-13, 2e-11, 4e-9, 7e-7, 5e-5, 2e-3, 0.12])
def test_the_axis_of_an_rcm_error_has_labels_that_differ(worst):
    """The page labels an axis with three decimals: the unit is chosen so that ten labels of the range differ."""
    error = np.append(worst * np.linspace(0, 1, 9), np.nan)
    blank = np.zeros((10, 3))
    playback = Playback("p", "p", np.arange(10.0), *[blank] * 4, blank, blank, blank, blank, error, error, ())
    (name,), values = curves(playback, "RCM error", [], [])
    unit = {"[mm]": 1e-3, "[µm]": 1e-6, "[nm]": 1e-9, "[pm]": 1e-12}[name.split()[-1]]
    np.testing.assert_allclose(values[0] * unit, error)
    shown = np.linspace(0, max(np.nanmax(values), MIN_SPAN), 8)
    assert len({f"{v:.3f}" for v in shown}) == 8
    assert worst < 1e-12 or 1 <= np.nanmax(values) < 1000


# -- no disagreement on a correct robot ---------------------------------------------------------------


def turning(movable):
    """Return the active angles that have more than half a turn, with both ends of their way."""
    for i, (joint, (low, high)) in enumerate(zip(movable.joints, movable.mechanism.limits, strict=True)):
        if joint.is_angle and high - low > np.pi:
            yield i, low, high


def test_a_joint_is_the_same_after_a_whole_turn(any_movable):
    """Also beyond half a turn equations and mechanism agree; what differs by an angle is told in degrees."""
    movable = home(any_movable)
    for i, low, high in turning(movable):
        for value in (0.97 * low, 0.97 * high):
            home(movable)
            to_the_end(lambda: movable.move_joint(i, value))  # noqa: B023
            reading = read(movable)
            assert reading.agrees, (movable.joints[i].name, value, reading.residual)
            assert "DISAGREE" not in readout.table(reading)


def test_every_residual_is_told_in_its_own_unit(any_movable):
    """Joint by joint, equations that are off by a known amount: millimetres of a slide, degrees of a turn."""
    from types import SimpleNamespace

    from twin.ui.session.readings import _joint_error

    q = any_movable.assembly.q
    for i, joint in enumerate(any_movable.joints):
        off = q.copy()
        off[i] += 0.25
        found = _joint_error(any_movable, off, q)
        assert (found.what, found.is_angle) == (f"joint {joint.name}", joint.is_angle)
        assert readout.residual_text(found) == ("14.324°" if joint.is_angle else "250.000 mm")
        reading = replace(read(any_movable), residual=found, incomparable="")
        assert readout.residual_text(found) in readout.table(reading)
        assert readout.residual_text(found) in residual_html(reading)
        state = reading_entries(reading, None)
        assert (state["residual_m"] is None, state["residual_rad"] is None) == (joint.is_angle, not joint.is_angle)
    assert reading_entries(SimpleNamespace(gap=0.0, residual=found, incomparable="", rcm_error=None, depth=None), 0.5)[
        "residual_m"
    ] == pytest.approx(0.5)


def mirrored_assembly(movable, rng):
    """Return another assembly with the tool where it is: by Newton's method on the pose from elsewhere, or None."""
    T, now = movable.assembly.T_base_tool, movable.assembly
    for _ in range(60):
        x = movable.model.tree.integrate(now.x[None], rng.normal(0, 0.6, (1, movable.model.tree.model.nv)))[0]
        found = movable.model.near_pose(x[None], T)
        if not len(found):
            continue
        state = movable.model.state(found[0])
        closed = state.worst_gap < 1e-9 and max(g[1] for g in state.gap.values()) < 1e-8
        inside = all(low <= v <= high for v, (low, high) in zip(state.q, movable.mechanism.limits, strict=True))
        if closed and inside and np.abs(state.T_base_tool - T).max() < 1e-9 and np.abs(state.q - now.q).max() > 0.02:
            return state
    return None


def test_another_assembly_is_not_a_disagreement(sils, rng):
    """The same tool pose with other joints: the equations are not written for it; no disagreement is shown."""
    home(sils)
    other = mirrored_assembly(sils, rng)
    assert other is not None
    sils.show(other)
    reading = read(sils)
    assert not reading.comparable
    assert reading.agrees
    table = readout.table(reading)
    assert "white-space:nowrap" in table, "a value and its unit are on one line"
    assert "not comparable: different assembly modes" in table
    assert "DISAGREE" not in table
    assert residual_html(reading).startswith("not comparable")
    assert reading_entries(reading, None)["scope"] == reading.incomparable
    sils.change(parameters={"l_p": sils.kin.parameters["l_p"] + 0.6 * MM})  # what is wrong stays wrong there
    assert not read(sils).agrees
    assert "DISAGREE" in readout.table(read(sils))


def test_design_b_that_cannot_take_the_pose_says_so(sils):
    T = home(sils).assembly.T_base_tool.copy()
    assert refusal_html(sils.move_tool(T)) == ""
    T[0, 3] += 2.0
    text = refusal_html(sils.move_tool(T))
    assert "Design B cannot reach the pose of design A" in text
    assert "out of reach" in text


def test_what_was_refused_is_forgotten_when_the_hand_lets_go(sils):
    home(sils)
    T = sils.assembly.T_base_tool.copy()
    T[0, 3] += 2.0
    assert not sils.move_tool(T).good
    assert "data-reason" in readout.table(read(sils))
    assert sils.last_move.reason in readout.headline(read(sils))
    sils.clear_message()
    assert "data-reason" not in readout.table(read(sils))
    assert read(sils).agrees


def test_a_joint_that_would_pass_another_on_its_rail_says_which(sils):
    for lower, upper, least in sils.robot.cad.gaps:
        names = [j.name for j in sils.joints]
        i, k = names.index(lower), names.index(upper)
        home(sils)
        other = sils.assembly.q[k]
        moved = to_the_end(lambda i=i, at=other: sils.move_joint(i, at + 5 * MM))
        assert not moved.good
        assert f"must stay at least {least / MM:.3f} mm below {upper}" in moved.reason
        assert "open" not in moved.reason
        assert sils.assembly.q[k] == other
        assert sils.assembly.q[k] - sils.assembly.q[i] >= least - 1e-9


@pytest.mark.slow
def test_a_slider_ends_where_the_loops_end_whatever_its_speed(any_movable):
    """Each joint towards its limits, in one step and in eight: the same end, and closed."""
    for i, (low, high) in enumerate(any_movable.mechanism.limits):
        for value in (low, high):
            ends = []
            for count in (1, 8):
                q = home(any_movable).assembly.q[i]
                for k in range(1, count + 1):
                    moved = to_the_end(lambda k=k, q=q: any_movable.move_joint(i, q + (value - q) * k / count))  # noqa: B023
                ends.append((any_movable.assembly.q[i], moved.reason.partition(" mm: ")[2]))
                assert any_movable.assembly.worst_gap < 1e-9
                assert moved.good == (abs(any_movable.assembly.q[i] - value) < 1e-12)
            assert ends[0][0] == pytest.approx(ends[1][0], abs=0.1 * MM)
            assert ends[0][1] == ends[1][1]


def test_a_rounding_error_is_shown_without_digits():
    lengths = [readout.length_text(metres) for metres in (0.0, -3e-13, 3e-11, 2e-10, 5e-6, 0.04, np.nan)]
    assert lengths == ["0 mm", "< 1 pm", "30 pm", "0.200 nm", "5.000 µm", "40.000 mm", "-"]


def test_rounding_errors_are_exact_and_a_picometre_is_no_news():
    assert [readout.difference_text(metres) for metres in (0.0, -9e-10, 2e-9, 3e-3)] == [
        "exact",
        "exact",
        "2.000 nm",
        "3.000 mm",
    ]
    assert readout.difference_text(np.nan) == "-"
