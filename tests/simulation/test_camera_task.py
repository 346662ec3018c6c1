"""The camera task: what the scene declares, what a simulated surgeon does, and both measures of its angle."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import twin
from made.scene_text import refused
from twin.api.console_runs import FILE, operate_console, replay_session
from twin.api.scene_parts import members_of, props_of
from twin.cli import main
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import DEG, MM
from twin.model.body import Mesh
from twin.model.movable import Movable
from twin.reference import ReferenceModel
from twin.simulation import console_scene
from twin.simulation.console_scene import PICTURE
from twin.simulation.session import session_run
from twin.simulation.setup import Setup
from twin.simulation.tasks.align import camera_surgeon, camera_task, picture, projected_side, upper_side
from twin.simulation.tasks.align import task as alignment
from twin.simulation.tasks.align.camera_referee import CameraReferee
from twin.simulation.tasks.align.camera_task import CameraView, in_picture, surfaces
from twin.simulation.tasks.align.picture import ColouredSurface
from twin.simulation.tasks.align.task import RECTANGLE
from twin.ui.session.exercise import Exercise
from twin.ui.session.live_console import LiveConsole

VIEW = 70 * DEG


@pytest.fixture(scope="module")
def davinci():
    return twin.load_scene("davinci")


@pytest.fixture(scope="module")
def goal(davinci):
    return davinci.tasks["camera"].goal


@pytest.fixture(scope="module")
def plate(goal):
    """The plate alone."""
    return surfaces("target", [goal.body()], {"target": np.eye(4)})


@pytest.fixture(scope="module")
def performed(davinci):
    return operate_console(davinci, "camera", seed=1)


# -- both measures -------------------------------------------------------------------------------------------


def looking(goal, lens, at, roll):
    """Return the frame of a picture from a point, towards a point of the plate; both in m in the plate's frame."""
    T = goal.T_world_plate
    z = np.asarray(lens, float) - at
    R = spatial.frame_from_axes(z / np.linalg.norm(z), np.array([1.0, 0.0, 0.0]))
    return T @ spatial.pose(R @ spatial.rotation_z(roll), lens)


def both(goal, seen, T_world_picture):
    """Return AlignErr in deg by projection and in the picture, and the reason if there is none."""
    projected = projected_side.angle(projected_side.seen_ends(goal, T_world_picture, VIEW))
    angle, why = in_picture(CameraView(seen, T_world_picture @ PICTURE), VIEW)
    return projected / DEG, None if angle is None else angle / DEG, why


@pytest.mark.parametrize("roll", [-40, -3, -0.2, -0.03, 0, 0.03, 0.2, 3, 40])
def test_a_picture_that_is_rolled_shows_the_rectangle_turned_the_other_way(goal, plate, roll):
    straight = looking(goal, [0, 6 * MM, 80 * MM], [0, 6 * MM, 0], roll * DEG)
    projected, seen, why = both(goal, plate, straight)
    assert projected == pytest.approx(-roll, abs=1e-9), why
    assert seen == pytest.approx(-roll, abs=0.01), why


def test_a_picture_without_smoothing_is_measured_too(goal, plate):
    """As a page draws it where a program looks at it: every pixel is green or not."""
    T = looking(goal, [0, 6 * MM, 80 * MM], [0, 6 * MM, 0], 12 * DEG)
    rgb = picture.draw(plate, RECTANGLE, T @ PICTURE, VIEW).rgb
    green = rgb[..., 1] > 0.5 * rgb[..., 1].max()
    assert upper_side.angle(green[..., None] * np.array([0.02, 0.5, 0.05])) == pytest.approx(-12 * DEG, abs=0.05 * DEG)


def random_views(goal, seen, count, seed):
    """Return the differences in deg of both measures in `count` views, and the reasons of refused ones."""
    rng, off, reasons = np.random.default_rng(seed), [], []
    while len(off) < count:
        lens = rng.uniform([-40, -40, 45], [40, 40, 150]) * MM
        at = rng.uniform([-25, -15, 0], [25, 15, 0]) * MM
        T = looking(goal, lens, at, rng.uniform(-40, 40) * DEG)
        projected, angle, why = both(goal, seen, T)
        if angle is None:
            reasons.append(why)
        else:
            off.append(angle - projected)
    return np.array(off), reasons


@pytest.mark.slow
def test_both_measures_agree_in_random_views(goal, plate):
    off, _ = random_views(goal, plate, 12, 0)
    assert np.abs(off).max() < 0.03
    assert np.ptp(off) > 0  # two measures, not one


@pytest.mark.nightly
def test_both_measures_agree_in_200_views(goal, plate):
    off, reasons = random_views(goal, plate, 200, 1)
    assert np.abs(off).max() < 0.03
    assert any("cuts" in why for why in reasons)


@pytest.mark.nightly
def test_both_measures_agree_in_the_whole_scene(goal, davinci, performed, plate):
    """Where board, patient or instruments cover the rectangle, the picture is refused; elsewhere both agree."""
    props = props_of(davinci)
    seen = plate + surfaces("theatre", props.bodies, ReferenceModel(props).home().link_poses)
    for name in ("psm1", "psm2"):
        arm = performed.arms[name]
        poses = {link: arm.place.T_world_base @ Ts[0] for link, Ts in arm.links.items()}
        seen += surfaces(name, arm.mechanism.bodies, poses)
    off, reasons = random_views(goal, seen, 4, 2)
    assert np.abs(off).max() < 0.03
    assert any("psm" in why and "covers" in why for why in reasons)


def ball(goal, at, radius):
    """Return a ball before the plate; `at` (3,) in m in the frame of the plate."""
    mesh = Movable("ball", "ball", (radius * MM,), 1e-3, 0.5).mesh()
    vertices = (mesh.vertices + at) @ goal.T_world_plate[:3, :3].T + goal.T_world_plate[:3, 3]
    return ColouredSurface("ball", "ball", vertices, mesh.triangles, (0.9, 0.1, 0.1))


def bar(goal, low, high):
    """Return a red box before the plate between two corners in mm in the frame of the plate."""
    corners = np.array([low, high], float) * MM
    box = Movable("bar", "box", tuple((corners[1] - corners[0]) / 2), 1e-3, 0.5).mesh()
    middle = corners.mean(axis=0)
    vertices = (box.vertices + middle) @ goal.T_world_plate[:3, :3].T + goal.T_world_plate[:3, 3]
    return ColouredSurface("psm1", "bar", vertices, box.triangles, (0.9, 0.1, 0.1))


STRAIGHT = ([0, 0, 80 * MM], [0, 0, 0], 5 * DEG)


@pytest.mark.parametrize(
    ("view", "why"),
    [
        (([25 * MM, 0, 30 * MM], [25 * MM, 0, 0], 0), "left border of the picture cuts"),
        (([0, 40 * MM, 55 * MM], [0, 40 * MM, 0], 0), "lower border of the picture cuts"),
        (([0, 0, 900 * MM], [0, 0, 0], 0), "move the camera nearer"),
        (([0, 0, 80 * MM], [200 * MM, 0, 75 * MM], 0), "not in the picture"),
        (([0, 0, 80 * MM], [0, 0, 0], 60 * DEG), "more than 45 degrees"),
        (([0, 0, 80 * MM], [0, 0, 160 * MM], 0), "not in the picture"),
    ],
)
def test_a_bad_view_is_refused_with_its_reason(goal, plate, view, why):
    angle, said = in_picture(CameraView(plate, looking(goal, *view) @ PICTURE), VIEW)
    assert angle is None
    assert why in said


@pytest.mark.parametrize(
    "thing",
    [
        lambda goal: bar(goal, (-4, 2, 5), (4, 12, 8)),  # over the middle of the upper side
        lambda goal: bar(goal, (-60, 3, 5), (60, 12, 8)),  # along the whole upper side: the picture alone cannot tell
        lambda goal: bar(goal, (10, -20, 5), (60, 20, 8)),  # over one end
        lambda goal: ball(goal, [0, 0, 20 * MM], 2),  # over the middle
    ],
)
def test_what_covers_the_rectangle_is_named(goal, plate, thing):
    angle, said = in_picture(CameraView([*plate, thing(goal)], looking(goal, *STRAIGHT) @ PICTURE), VIEW)
    assert angle is None
    assert "covers" in said
    assert "psm1" in said or "ball" in said


def test_what_stands_behind_or_beside_covers_nothing(goal, plate):
    more = [bar(goal, (-4, -20, -30), (4, 20, -20)), bar(goal, (-4, 12, 5), (4, 20, 8))]
    assert in_picture(CameraView([*plate, *more], looking(goal, *STRAIGHT) @ PICTURE), VIEW)[0] is not None


@pytest.mark.parametrize(
    ("hole", "why"),
    [
        (lambda y, x: (abs(x - 480) < 20) & (y < 352), "straight line|covers"),
        (lambda y, x: np.hypot(x - 480, y - 360) < 18, "covers"),
        (lambda y, x: x < 480 + (y - 360), "^$"),  # a straight cut leaves a straight upper side
    ],
)
def test_a_picture_alone_shows_that_its_rectangle_is_not_whole(hole, why):
    """As in a picture of a page, of which nobody says what covers what."""
    y, x = np.mgrid[0:720, 0:960]
    rgb = np.zeros((720, 960, 3))
    rgb[(abs(x - 480) < 200) & (abs(y - 360) < 40)] = (0.02, 0.5, 0.05)
    rgb[hole(y, x)] = (0.5, 0.1, 0.1)
    if why == "^$":
        assert upper_side.angle(rgb) == pytest.approx(0, abs=1e-3)
        return
    with pytest.raises(upper_side.UnmeasuredError, match=why):
        upper_side.angle(rgb)


def test_a_rectangle_seen_as_a_line_is_named():
    rgb = np.zeros((720, 960, 3))
    rgb[np.arange(200, 400), np.arange(300, 500)] = (0.02, 0.5, 0.05)
    with pytest.raises(upper_side.UnmeasuredError, match="only an edge of the rectangle, as a line"):
        upper_side.angle(rgb)


def test_the_nearer_of_two_triangles_is_seen_and_a_mesh_behind_the_lens_is_not(goal):
    """The lens is in the World's origin and looks along z; a large triangle reaches from before it to behind it."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2]])  # they face the lens

    def at(name, z, size, rgb):
        return ColouredSurface(name, name, square * size + (0, 0, z), faces, rgb)

    far, near = at("far", 0.2, 0.05, (0, 1, 0)), at("near", 0.1, 0.01, (1, 0, 0))
    slope = ColouredSurface(
        "slope", "slope", np.array([[0, 3, 3], [0, -3, -3], [1, -3, -3]], float), faces[:1], (0, 0, 1)
    )
    drawn = picture.draw([far, near, slope, at("back", -0.1, 1, (1, 1, 1))], "far", np.eye(4), VIEW)
    covered = 4 * 0.01**2 / 0.1**2 / (4 * 0.05**2 / 0.2**2)
    assert drawn.covered["near"] == pytest.approx(covered, rel=0.02)
    assert set(drawn.covered) <= {"near", "slope"}
    middle = drawn.rgb[360, 470]
    assert middle.argmax() == 0
    assert drawn.rgb[360, 370].argmax() == 1


# -- the surgeon ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_simulated_surgeon_aligns_the_endoscope_with_both_hands(performed):
    at = performed.run.recording["ecm.at"]
    a, start, end = performed.outcome.aligned, at[0], at[-1]
    assert performed.verdict == "agree"
    assert abs(a.angle) < 0.2 * DEG
    assert abs(a.seen) < 0.2 * DEG
    assert abs(a.seen - a.angle) < 0.05 * DEG
    assert a.seen != a.angle
    assert a.off < 0.05
    assert (np.abs(end - start) > [2 * DEG, 2 * DEG, 10 * MM, 5 * DEG]).all()  # pan, tilt, depth, roll
    assert performed.console.camera_moves >= 1
    assert 3 < a.time < 60
    assert a.path > 10 * MM
    assert min(a.hands.values()) > 20 * MM


@pytest.mark.nightly
def test_more_seeds_align(davinci):
    for seed in range(10, 13):
        a = operate_console(davinci, "camera", seed=seed).outcome.aligned
        assert max(abs(a.angle), abs(a.seen)) < 0.2 * DEG, seed
        assert abs(a.seen - a.angle) < 0.05 * DEG, seed


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_bytes_and_the_replay_too(davinci, performed, tmp_path):
    path = tmp_path / FILE
    path.write_bytes(performed.recorded)
    assert operate_console(davinci, "camera", seed=1).recorded == performed.recorded
    again = replay_session(path)
    assert again.run.difference is None
    assert again.outcome.aligned == performed.outcome.aligned
    moved = replace(davinci.tasks["camera"].goal, line=0.6)
    changed = replace(davinci, tasks={"camera": replace(davinci.tasks["camera"], goal=moved)})
    with pytest.raises(TwinError, match="has changed"):
        replay_session(path, changed)


@pytest.mark.slow
def test_a_surgeon_who_gives_up_has_missed_the_task(davinci, monkeypatch):
    monkeypatch.setattr(camera_surgeon, "_LARGEST_PRESSES", 1)
    monkeypatch.setattr(camera_surgeon, "_LARGEST_STROKES", 1)
    found = operate_console(davinci, "camera")
    assert found.verdict == "disagree"
    assert [f.code for f in found.findings if f.severity == "disagreement"] == ["task.missed"]
    assert found.word == "The endoscope is not aligned"
    assert found.run.missed == ("camera",)
    assert abs(found.outcome.aligned.seen - found.outcome.aligned.angle) < 0.05 * DEG  # 10 degrees askew, and measured


@pytest.mark.slow
def test_two_angles_that_differ_are_a_finding(performed):
    outcome, aligned = performed.outcome, performed.outcome.aligned
    differing = replace(outcome, aligned=replace(aligned, seen=aligned.angle + 0.06 * DEG))
    wrong = replace(performed, outcome=differing)
    assert [f.code for f in wrong.findings if f.severity == "disagreement"] == ["task.angles"]
    covered = replace(outcome, aligned=replace(aligned, seen=None, refusal="psm1 covers 9 %"))
    unseen = replace(performed, outcome=covered)
    assert [f.code for f in unseen.findings if f.severity == "warning"] == ["task.unseen"]


@pytest.mark.slow
def test_a_mechanism_that_differs_from_the_equations_shows_in_the_angles(goal, plate, performed):
    """A lens that is 0.1 degrees askew in its tube: the picture shows it, the projection by the equations does not."""
    T = looking(goal, [0, 6 * MM, 80 * MM], [0, 6 * MM, 0], 0)
    projected = projected_side.angle(projected_side.seen_ends(goal, T, VIEW))
    angle, _ = in_picture(CameraView(plate, T @ PICTURE @ spatial.pose(spatial.rotation_z(0.1 * DEG))), VIEW)
    assert abs(angle - projected) > camera_task.ANGLE_AGREEMENT


@pytest.mark.slow
def test_the_scoreboard_counts_what_the_report_measures(davinci, bare_theatre, performed):
    setup = Setup(davinci, members_of(bare_theatre.robots), davinci.tasks["camera"])
    referee = CameraReferee("ecm", session_run.SAMPLE)
    world = console_scene.world(setup, session_run.surgeon(setup, seed=1), records=False, watch=[referee])
    while not world.ended:
        world.step(1000)
    assert referee.time == pytest.approx(performed.outcome.aligned.time, abs=2 * session_run.SAMPLE)
    assert referee.moves == performed.console.camera_moves


def test_by_hand_the_task_is_ended_and_begun_again(bare_theatre):
    live = LiveConsole(bare_theatre, Exercise(bare_theatre.scene.tasks["camera"]))
    live.advance(0.05)
    task = live.reading["task"]
    assert (task["over"], task["rings"]) == (None, [])
    assert task["rows"] == [["Time", "0.0 s"], ["Camera moves", "0"]]
    live.end("page")
    assert live.advance(0.05) == []
    assert live.reading["task"]["over"] == "The task was ended."
    live.restart("page")
    assert live.reading["task"]["attempt"] == 2
    live.close()


# -- the command and the scene -------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_writes_the_measures_of_another_seed(performed, tmp_path, capsys):
    assert main(["operate", "davinci", "--task", "camera", "--seed", "4", "--out", str(tmp_path / "out")]) == 0
    assert "AlignErr in the picture" in capsys.readouterr().out
    told = json.loads((tmp_path / "out" / "session.json").read_text())["alignment"]
    assert abs(told["align_err_deg"]) < 0.2
    assert abs(told["align_err_deg"] - told["align_err_in_picture_deg"]) < 0.05
    assert told["lens_path_mm"] > 10
    assert told["lens_path_mm"] != pytest.approx(performed.outcome.aligned.path / MM)


def test_the_plate_stands_clear_of_the_board_and_its_pegs(davinci, goal):
    """No corner of the board's parts is in the plate, and no corner of the plate in the boxes around the parts."""
    own = np.concatenate([m.vertices for m in goal.body().meshes])
    T = spatial.inverse(goal.T_world_plate)
    low, high = ((own @ T[:3, :3].T + T[:3, 3]).min(axis=0), (own @ T[:3, :3].T + T[:3, 3]).max(axis=0))
    for part in props_of(davinci).body("board").meshes:
        p = part.vertices @ T[:3, :3].T + T[:3, 3]
        inside = ((p > low) & (p < high)).all(axis=1)
        assert not inside.any(), part.name
        around = ((own > part.vertices.min(axis=0)) & (own < part.vertices.max(axis=0))).all(axis=1)
        assert not around.any(), part.name


def test_the_plate_is_drawn_beside_the_props(davinci, goal):
    props = props_of(davinci)
    shown = alignment.beside(props, goal)
    poses = ReferenceModel(shown).home().link_poses
    np.testing.assert_allclose(poses[alignment.BODY], np.eye(4), atol=1e-9)
    assert RECTANGLE in [m.name for m in shown.body(alignment.BODY).meshes]
    alone = alignment.beside(None, goal)
    assert isinstance(alone.body(alignment.BODY).meshes[0], Mesh)
    assert alignment.beside(props, None) is props


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("[task.camera.align]", "[task.camera.other]", "other"),
        ("facing = [0, -0.8, 0.6]", "facing = [0, 0, 1]", "no upper side"),
        ("facing = [0, -0.8, 0.6]", "facing = [0, 1e200, 0.6]", r"has the length 1e\+200; it must be 1e-6 to 1e6"),
        ("size_mm = [60, 12]", "size_mm = [60, 0]", "above 0 mm"),
        ("plate_mm = [96, 52]", "plate_mm = [50, 52]", "larger than the rectangle"),
        ('color = "#1fa045"', 'color = "#9fa045"', "not green enough"),
        ("roll_deg = 14", "roll_deg = 50", "roll_deg"),
        ("line = 0.7", "line = 1.2", "line"),
        ("tolerance_deg = 0.5\n", "", "tolerance_deg"),
        ('[task.camera]\n', '[task.camera]\ntarget = [{ name = "a", right_mm = [0, 0, 0] }]\n', "`target` and `align`"),
        ('[task.camera]\n', '[task.empty]\ntitle = "x"\nprovenance = "ASSUMED"\nnote = "x"\n[task.camera]\n',
         "this task has none of them"),
        ('[task.camera]\n', '[task.camera]\nhold_s = 1\n', "takes no `hold_s`"),
    ],
)  # fmt: skip
def test_a_wrong_task_is_refused_with_its_place(davinci, tmp_path, old, new, why):
    assert re.search(why, refused(davinci, tmp_path, old, new))
