"""The kinds of tasks, and a task and a device that other packages bring."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import twin
from made.foreign_task import installed
from twin.api.console_runs import operate_console, replay_session
from twin.cli import main
from twin.cli.parser import parser
from twin.core.entry_points import names
from twin.core.errors import DescriptionError, TwinError
from twin.model import scene as scenes
from twin.model import task as tasks
from twin.simulation import blocks
from twin.simulation.hazards.fault import Fault
from twin.simulation.session.task_play import Play, play_of

ROOT = Path(__file__).parents[2]
CACHES = (tasks.kinds, tasks.task_table, scenes.scene_table, parser)


@pytest.fixture
def outside(tmp_path, monkeypatch):
    """Install the packages of a task and of a device outside of the tree; return the folder on `sys.path`."""
    folder = installed(tmp_path / "site")
    monkeypatch.syspath_prepend(str(folder))
    for made_once in CACHES:
        made_once.cache_clear()
    yield folder
    for made_once in CACHES:
        made_once.cache_clear()
    for name in [n for n in sys.modules if n.split(".")[0] in ("wait_task", "pulse_device")]:
        del sys.modules[name]


def scene_file(folder, text):
    """Write the da Vinci's scene with more sections; return its file."""
    shutil.copytree(ROOT / "cad/davinci", folder)
    file = folder / "scene.toml"
    file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")
    return file


MORE = """
[task.still]
title = "keep both hands still"
wait = { rest_s = 0.4 }
provenance = "ASSUMED"
note = "a test"

[device.pulse]
use = "pulse"
settings = { every_s = 0.1 }

[hazard.loose_clutch]
use = "fault"
settings = { signal = "pedals.clutch", start = 0.1, stop = 0.2, operation = "overwrite", value = 1.0 }
"""


def test_each_folder_is_a_kind_of_task_with_its_play():
    folders = {f.name for f in (ROOT / "twin/simulation/tasks").iterdir() if (f / "__init__.py").is_file()}
    assert folders == {kind.name for kind in tasks.kinds()}
    assert sorted(folders) == names(tasks.FOLDER, tasks.GROUP)
    for kind in tasks.kinds():
        assert isinstance(play_of(tasks.ConsoleTask("t", "t", 0.0, 0.0, kind, None)), Play)


def test_a_task_of_another_package_is_in_help_and_messages(outside, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["operate", "--help"])
    kinds = sorted(kind.name for kind in tasks.kinds())
    assert "wait" in kinds
    assert ", ".join(kinds) in " ".join(capsys.readouterr().out.split())
    file = scene_file(tmp_path / "scene", MORE.replace("wait = { rest_s = 0.4 }\n", ""))
    with pytest.raises(DescriptionError, match="`guide`, `align`, `procedure` or `wait`; this task has none of them"):
        twin.load_scene(file)


def test_a_task_and_a_device_of_other_packages_are_played_and_replayed(outside, tmp_path):
    scene = twin.load_scene(scene_file(tmp_path / "scene", MORE))
    assert "task still rest" in {parameter.name for parameter in scene.parameters}
    found = operate_console(scene, "still")
    content = found.content()
    assert (found.word, found.verdict) == ("The hands were still", "agree")
    assert content["waited_s"] == pytest.approx(0.4, abs=0.05)
    assert "waited 0.4 s" in "".join(part for part in found.text() if isinstance(part, str))
    kept = found.run.recording
    clutch = kept["pedals.clutch"][:, 0]
    assert clutch[(kept.t > 0.11) & (kept.t < 0.19)].all()
    assert not clutch[kept.t > 0.21].any()
    file = tmp_path / "a.session"
    file.write_bytes(found.recorded)
    again = replay_session(file, scene)
    assert again.run.difference is None
    assert again.outcome.content() == found.outcome.content()


def test_a_device_of_another_package_beats_in_the_world(outside, tmp_path):
    from twin.api.scene_parts import members_of, robots_at
    from twin.simulation import console_scene
    from twin.simulation.session import session_run
    from twin.simulation.setup import Setup

    scene = twin.load_scene(scene_file(tmp_path / "scene", MORE))
    setup = Setup(scene, members_of(robots_at(console_scene.led_by(scene))), scene.tasks["still"])
    world = console_scene.world(setup, session_run.surgeon(setup))
    world.step(250)
    assert world.signals["pulse.phase"][0] == 2.0
    assert console_scene.identity(setup) != console_scene.identity(Setup(twin.load_scene("davinci"), setup.members))


def test_a_setting_that_is_missing_is_named(outside, tmp_path):
    from twin.simulation.setup import Setup

    scene = twin.load_scene(scene_file(tmp_path / "scene", MORE.replace("settings = { every_s = 0.1 }", "")))
    with pytest.raises(TwinError, match=r"scene\.toml: devices: 'pulse': the setting 'every_s' is missing"):
        blocks.blocks(Setup(scene, {}), "devices")


HAZARD = """
[hazard.slip]
use = "fault"
settings = { signal = "hand.pose", start = 0.1, stop = 0.2, operation = "add", value = 0.1 }
"""
WRONG_HAZARDS = {
    "overwrit": "fault of hand.pose: there is no operation 'overwrit'. Did you mean 'overwrite'",
    "skip": "fault of hand.pose: acts on the packets of a machine",
}


@pytest.mark.parametrize("operation", WRONG_HAZARDS)
def test_a_fault_that_cannot_act_in_a_scene_is_named(tmp_path, operation):
    from twin.simulation.setup import Setup

    scene = twin.load_scene(scene_file(tmp_path / "scene", HAZARD.replace('"add"', f'"{operation}"')))
    with pytest.raises(TwinError, match=WRONG_HAZARDS[operation]):
        blocks.hazards(Setup(scene, {}))


@pytest.mark.parametrize(("target", "value"), [(3, 1.0), (None, [1.0, 2.0])])
def test_a_fault_that_does_not_suit_its_signal_is_named(target, value):
    fault = Fault("x", 0.1, 0.2, "add", value, target)
    with pytest.raises(TwinError, match=r"fault of x: .* a signal of 1 numbers"):
        fault.change(0.15, np.zeros(1))


def test_blocks_of_a_scene_without_a_console_are_refused(tmp_path):
    shutil.copytree(ROOT / "cad/dome", tmp_path / "dome")
    file = tmp_path / "dome/scene.toml"
    file.write_text(file.read_text(encoding="utf-8") + HAZARD, encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"hazard\.slip: blocks belong to the World of a console"):
        twin.load_scene(file)


UNUSABLE = {"puls": "there is no device 'puls'. Did you mean 'pulse'", "hand": "it has no function from_scene"}


@pytest.mark.parametrize("use", UNUSABLE)
def test_a_device_that_cannot_be_used_is_named(outside, tmp_path, use):
    from twin.simulation.setup import Setup

    scene = twin.load_scene(scene_file(tmp_path / "scene", MORE.replace('use = "pulse"', f'use = "{use}"')))
    with pytest.raises(TwinError, match=UNUSABLE[use]):
        blocks.blocks(Setup(scene, {}), "devices")


OFFERED = {
    "device": r"there is no device 'nothing'\. Known: pulse\.$",
    "controller": r"there is no controller 'nothing'\. Known: none\.$",
    "plant": r"there is no plant 'nothing'\. Known: none\.$",
    "hazard": r"there is no hazard 'nothing'\. Known: fault\.$",
}


@pytest.mark.parametrize("kind", OFFERED)
def test_only_what_a_scene_can_name_is_offered_for_an_unknown_name(outside, tmp_path, kind):
    """The folders also have modules that the World builds by itself, and helpers."""
    from twin.simulation.setup import Setup

    scene = twin.load_scene(scene_file(tmp_path / "scene", f'[{kind}.a]\nuse = "nothing"\n'))
    with pytest.raises(TwinError, match=OFFERED[kind]):
        blocks.hazards(Setup(scene, {})) if kind == "hazard" else blocks.blocks(Setup(scene, {}), f"{kind}s")


BROKEN = {
    "wait = wait_task.task:NOTHING": "cannot be imported",
    "wait = json:dumps": "not a twin.model.task.TaskKind",
    "rest = wait_task.task:KIND": "give both one name",
}


@pytest.mark.parametrize("line", BROKEN)
def test_a_kind_of_task_that_cannot_be_used_is_named(line, outside):
    (outside / "wait_task-1.0.dist-info/entry_points.txt").write_text(f"[twin.tasks]\n{line}\n", encoding="utf-8")
    with pytest.raises(TwinError, match=BROKEN[line]):
        tasks.kinds()


@pytest.mark.parametrize("key", ["guide", "title", "value", "model_dump"])
def test_a_key_that_has_a_meaning_already_is_refused(outside, key):
    file = outside / "wait_task/task.py"
    file.write_text(file.read_text().replace('name="wait"', f'name="{key}"'), encoding="utf-8")
    metadata = outside / "wait_task-1.0.dist-info/entry_points.txt"
    metadata.write_text(f"[twin.tasks]\n{key} = wait_task.task:KIND\n", encoding="utf-8")
    with pytest.raises(TwinError, match=f"the key '{key}' of a task has a meaning already"):
        tasks.kinds()
