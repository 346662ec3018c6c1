"""`twin view --watch`: the robot is rebuilt when its files change; a broken file leaves the last one."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.ui.session import file_watch
from twin.ui.session.file_watch import RobotFileWatch
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve

ROOT = Path(__file__).parents[2]
LIMITS = "limits_mm = [232.0, 292.0]"


@pytest.fixture
def watched(tmp_path):
    """Return (front, folder) of a page that watches a copy of the example robot; it is stepped by hand."""
    folder = tmp_path / "hexapod"
    shutil.copytree(ROOT / "docs/examples/hexapod", folder)
    robot = twin.load(folder)
    front = open_page(
        "test", [ShownRobot("hexapod", str(folder), MovableRobot(robot))], None, serve("test", "127.0.0.1", 0)
    )
    said = []
    front.say = lambda text, bad=False: said.append((text, bad))
    front.load = lambda a, protocol: None  # planning takes longer than all else, and is tested elsewhere
    front.follow_files(RobotFileWatch(robot, str(folder)))
    yield front, folder, said
    front.close()


def until(front, done, what):
    end = time.monotonic() + 60
    while not done():
        assert time.monotonic() < end, what
        front.step()
        time.sleep(0.02)


def edit(path, old, new):
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")


def upper(front):
    return front.active.movable.mechanism.limits[0, 1] / MM


def test_a_change_rebuilds_the_robot_in_its_posture_and_a_broken_file_leaves_it(watched):
    front, folder, said = watched
    description = folder / "cad/hexapod.toml"
    T = front.active.movable.assembly.T_base_tool.copy()
    T[:3, 3] += [4 * MM, 3 * MM, 5 * MM]
    assert front.active.movable.move_tool(T).good
    q = front.active.movable.assembly.q.copy()

    edit(description, LIMITS, "limits_mm = [232.0, 290.0]")
    until(front, lambda: upper(front) == pytest.approx(290.0), "the new limit")
    assert np.abs(front.active.movable.assembly.q - q).max() < 1e-9
    assert said[-1] == ("hexapod.toml changed: hexapod is rebuilt", False)
    assert set(front.nodes["hexapod"].bodies) == {b.name for b in front.active.movable.mechanism.bodies}

    kept = front.active.movable
    edit(description, "limits_mm = [232.0, 290.0]", "limits_mm = [232.0, 290.0")
    until(front, lambda: said[-1][1], "the error")
    assert "hexapod.toml" in said[-1][0]
    assert front.active.movable is kept
    assert front.panels.why
    assert front.active.movable.move_tool(T).good  # the last good robot still moves


def test_another_build_has_its_own_protocols_and_no_playback_of_the_build_before(watched):
    front, folder, _ = watched
    a = front.active
    trajectories = folder / "trajectories"
    name = next(iter(front.panels.play._protocols[a.name]))
    shutil.move(trajectories / f"{name}.toml", trajectories / "renamed.toml")
    a.protocol = name
    a.playback = SimpleNamespace(t=[0.0])
    front.scenery._labels(True)
    front.scenery._frames(True)
    loaded = []
    front.load = lambda a, protocol: loaded.append(protocol)

    note = front.replace(a, a.movable)
    assert "renamed" in front.panels.play._protocol.options
    assert name not in front.panels.play._protocol.options
    assert a.playback is None
    assert front.panels.play._play_button.disabled
    assert f"protocol {name} has gone" in note
    assert loaded == [None]
    nodes = front.nodes[a.name]
    assert len(nodes._extras["labels"]) > 0
    assert all(handle.show_axes for handle in nodes.bodies.values())
    assert "axes" not in nodes._extras


def test_code_that_ends_the_program_is_an_error_and_no_earlier_build_is_shown(watched, monkeypatch):
    front, folder, _ = watched
    watch = RobotFileWatch(front.active.movable.robot, str(folder))
    watch._load(("hexapod.toml",))
    assert watch._reloaded is not None
    assert watch._reloaded.movable is not None

    def ends(robot):
        raise SystemExit(3)

    monkeypatch.setattr(file_watch, "MovableRobot", ends)
    edit(folder / "formula.py", "import", "# changed\nimport")
    results = []

    def found():
        watch._look_time = -file_watch.POLL_PERIOD
        results.append(watch.poll(0.0))
        return results[-1] is not None

    until(front, found, "the result")
    assert results[-1].movable is None
    assert "ends the program by SystemExit(3)" in results[-1].error


@pytest.mark.slow
def test_ten_changes_in_a_row_of_three_files(watched, tmp_path):
    front, folder, said = watched
    description = folder / "cad/hexapod.toml"
    formula = folder / "formula.py"
    step = folder / "cad/hexapod.step"
    q = front.active.movable.assembly.q.copy()
    limit = LIMITS
    for k in range(10):
        said.clear()
        if k == 4:  # a broken file in between
            text = formula.read_text("utf-8")
            formula.write_text("def inverse(:\n", "utf-8")
            until(front, lambda: said and said[-1][1], "the error")
            formula.write_text(text, "utf-8")
        elif k % 3 == 0:
            new = f"limits_mm = [232.0, {291.0 - k}]"
            edit(description, limit, new)
            limit = new
        elif k % 3 == 1:
            text = formula.read_text("utf-8")
            formula.write_text(f"{text}# {k}\n", "utf-8")
        else:
            step.write_bytes(step.read_bytes() + b"\n")
        until(front, lambda: said and not said[-1][1], f"change {k}")
        assert np.abs(front.active.movable.assembly.q - q).max() < 1e-9
    # a file that is read while it is written is read once more
    until(front, lambda: upper(front) == pytest.approx(282.0), "the last limit")


def test_a_robot_without_a_folder_cannot_be_watched():
    robot = twin.load(ROOT / "usd/hibou/hibou.usda")
    with pytest.raises(TwinError, match="--watch needs a robot folder"):
        RobotFileWatch(robot, str(ROOT / "usd/hibou/hibou.usda"))
