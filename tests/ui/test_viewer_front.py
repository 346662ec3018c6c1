"""The front end without a browser: its loop stepped by hand, robots changed over, a bare stage, what is drawn where."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.timeline import Clock, Playback, prepare
from twin.ui.viewer import view_export
from twin.ui.viewer.curves_panel import curves, plotted_samples
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve


@contextmanager
def front_of(*robots, protocol=None):
    shown = [ShownRobot(r.name, r.name, MovableRobot(r), protocol=protocol) for r in robots]
    front = open_page("test", shown, None, serve("test", "127.0.0.1", 0))
    try:
        yield front
    finally:
        front.close()


@pytest.fixture(scope="module")
def two():
    with front_of(twin.load("hibou"), twin.load("lapbot")) as front:
        yield front


def test_of_each_kind_of_wish_the_last_one_counts(two):
    done = []
    two.ask("a", lambda: done.append(1))
    two.ask("a", lambda: done.append(2))
    two.ask("b", lambda: done.append(3))
    two.step()
    assert done == [2, 3]


def test_a_wish_that_fails_is_told_and_the_loop_goes_on(two, monkeypatch, caplog):
    said = []
    monkeypatch.setattr(two, "say", lambda text, bad=False: said.append((text, bad)))

    def refused():
        raise TwinError("no")

    two.ask("a", refused)
    two.ask("b", lambda: 1 / 0)
    two.step()
    assert said[0] == ("no", True)
    assert "ZeroDivisionError" in said[1][0]
    assert "a request failed" in caplog.text


def test_another_robot_becomes_active(two):
    assert len(two.panels.move.sliders) == 5
    ticks = len(two.after_frame)
    two.set_active("lapbot")
    two.step()
    assert two.active.name == "lapbot"
    assert len(two.panels.move.sliders) == 6
    assert len(two.after_frame) == ticks  # what watched the other one is gone
    assert list(two.panels.play._protocol.options) == list(twin.load("lapbot").files.protocols())
    assert not two.planning, "a list that is shown loads no protocol"
    two.set_active("hibou")
    assert list(two.panels.play._protocol.options) == list(twin.load("hibou").files.protocols())


def test_trocars_that_a_changed_design_does_not_fit_fail_the_plan_and_not_the_page(two, monkeypatch):
    a = two._robot_named("lapbot")
    playback = object.__new__(Playback)
    plan = SimpleNamespace(done=True, answer=playback, protocol="other_port", close=lambda: None)
    two._planners["lapbot"] = plan

    def refused(_: object) -> None:
        raise TwinError("the loops cannot be closed")

    monkeypatch.setattr(a.movable, "bind", refused)
    two.step()
    assert two.panels.why == "the loops cannot be closed"
    assert a.playback is None
    assert not two.planning


def test_size_and_place_are_of_the_picture_alone(two):
    a, node = two.active, two.nodes[two.active.name]
    p = a.movable.assembly.T_base_tool[:3, 3].copy()
    two.scenery._place_robot(a, np.array([0.3, -0.1, 0.2]), 0.7, 2.5)
    np.testing.assert_allclose(node.to_base(node.to_world(p)), p, atol=1e-12)
    expected = spatial.pose(spatial.rotation_z(0.7), [0.3, -0.1, 0.2]) @ np.append(2.5 * p, 1.0)
    np.testing.assert_allclose(node.to_world(p), expected[:3], atol=1e-12)
    np.testing.assert_array_equal(a.movable.assembly.T_base_tool[:3, 3], p)
    two.draw()
    np.testing.assert_allclose(two.gizmo.position, node.to_world(p), atol=1e-9)
    two.scenery._place_robot(a, np.zeros(3), 0.0, 1.0)


@pytest.mark.slow
def test_a_protocol_is_prepared_elsewhere_and_played(two):
    a = two.active
    two.load(a, None)
    end = time.monotonic() + 120
    while two.planning and time.monotonic() < end:
        two.step()
        time.sleep(0.05)
    assert a.playback is not None, two.panels.why
    two.clock.seek(3.0)
    two.move_to_clock()
    np.testing.assert_allclose(a.movable.assembly.q, a.playback.q[180], atol=1e-8)
    two.load(a, "no_such")
    while two.planning and time.monotonic() < end:
        two.step()
        time.sleep(0.05)
    assert "no_such" in two.panels.why


def test_a_protocol_in_a_folder_is_among_those_of_the_page():
    robot = twin.load("raven_left")
    with front_of(robot, protocol="around/dome") as front:
        chosen, options = front.panels.play._protocol.value, front.panels.play._protocol.options
        assert (chosen, options) == ("dome", ("about_port", "reach", "dome"))
        assert front.panels.play.chosen_protocol == "around/dome"


@pytest.mark.parametrize("visible", [True, False])
def test_a_recording_that_fails_leaves_clock_and_gizmo_as_they_were(visible):
    clock = Clock()
    clock.duration, clock.playing = 2.0, True
    clock.seek(0.7)
    stood, serializer = [], SimpleNamespace()

    def full(passed: float) -> None:
        raise TwinError("the disk is full")

    front = SimpleNamespace(
        clock=clock, gizmo=SimpleNamespace(visible=visible), move_to_clock=lambda: stood.append(clock.time),
        deform_organs=full,
        server=SimpleNamespace(get_scene_serializer=lambda: serializer),
    )  # fmt: skip
    with pytest.raises(TwinError, match="the disk is full"):
        view_export.page(front)  # type: ignore[arg-type]
    assert (clock.time, clock.playing, front.gizmo.visible, stood[-1]) == (0.7, True, visible, 0.7)


@pytest.mark.parametrize("along", [True, False])
def test_a_turntable_turns_also_from_straight_above(along, monkeypatch):
    monkeypatch.setattr(view_export, "TURNTABLE_PICTURES", 4)
    looks: list[tuple[np.ndarray, np.ndarray]] = []

    def get_render(height: int, width: int, *, wxyz, position, **_) -> np.ndarray:
        looks.append((spatial.matrix_from_quat_wxyz(wxyz), position))
        return np.zeros((height, width, 4), np.uint8)

    above = spatial.quat_from_matrix_wxyz(np.diag([1.0, -1.0, -1.0]))  # x to the right, z down
    position = np.array([0.0, 0.0 if along else 1.0, 2.0])
    camera = SimpleNamespace(
        look_at=np.zeros(3), up_direction=np.array([0.0, 0.0, 2.0]), position=position, wxyz=above, fov=1.0
    )
    client = SimpleNamespace(camera=camera, get_render=get_render, send_file_download=lambda name, data: None)
    view_export.turntable(client, "turn", lambda part: None)  # type: ignore[arg-type]
    assert len(looks) == 4
    for k, (R, eye) in enumerate(looks):
        quarters = spatial.rotation_z(k * np.pi / 2)
        np.testing.assert_allclose(eye, quarters @ position, atol=1e-12)
        np.testing.assert_allclose(R, quarters @ looks[0][0], atol=1e-9)
        np.testing.assert_allclose(R[:, 2], -eye / np.linalg.norm(eye), atol=1e-9)


def test_curves_have_names_units_and_values():
    playback = prepare("hibou", None)
    angles = [True, False, True, True, True]
    names, values = curves(playback, "speed", ["q1", "q2", "q3", "q6", "q7"], angles)
    assert names[:2] == ["q1 [°/s]", "q2 [mm/s]"]
    np.testing.assert_allclose(values[1], playback.qd[:, 1] / MM)
    assert curves(playback, "tip", [], [])[0] == ["x [mm]", "y [mm]", "z [mm]"]
    assert np.nanmax(curves(playback, "RCM error", [], [])[1]) < 0.01  # µm


def test_a_plot_has_at_most_400_points_and_none_where_a_curve_has_no_value():
    values = np.arange(2 * 799.0).reshape(2, 799)
    samples = plotted_samples(values)
    assert len(samples) == 400
    assert samples[[0, -1]].tolist() == [0, 798]
    values[1, :700] = np.nan
    assert plotted_samples(values).tolist() == list(range(700, 799))
    assert not len(plotted_samples(np.full((1, 5), np.nan)))


def test_without_a_registered_rcm_the_page_shows_a_text_and_no_curve(two):
    robot = two.active
    planned = robot.playback
    playback = prepare(robot.name, None)
    try:
        robot.playback = replace(playback, rcm_error=np.full(len(playback.t), np.nan))
        panel = two.panels.curves
        panel._chosen.value = "RCM error"
        panel.draw(force=True)
        assert panel._plot is None
        assert panel._legend.content == "no RCM is registered in this protocol"
        robot.playback = playback
        panel.draw()
        assert panel._plot is not None
        assert "shaft to RCM" in panel._legend.content
    finally:
        robot.playback = planned


def test_points_of_the_equations_are_drawn_with_their_error_enlarged():
    robot = twin.load("sils")
    with front_of(robot) as front:
        movable, node = front.active.movable, front.nodes["sils"]
        assert movable.move_tool(robot.loops.forward(robot.loops.q)).good  # as drawn
        movable.change({"eq1": "printed"})
        front.refresh()
        drawn = node._equations.points.reshape(-1, 3)
        actual = np.array([movable.assembly.points[n] for n in ("s1", "s2", "s3")])
        off = np.array([np.linalg.norm(actual - p, axis=1).min() for p in drawn]).max()
        assert off == pytest.approx(10 * 1.2745 * MM, rel=1e-3)
        assert tuple(node._equations.colors[0, 0]) == (225, 0, 0)


def test_a_bare_stage_is_shown_without_equations():
    stage = twin.load("hibou").files.stage
    with front_of(twin.load(stage)) as front:
        front.step()
        assert front.active.movable.kin is None
        assert front.panels.play._play_button.disabled
        front.ask("joint", lambda: front.active.movable.move_joint(0, front.active.movable.assembly.q[0] + 0.02))
        front.step()
        assert front.active.movable.last_move.good
