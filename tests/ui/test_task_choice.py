"""Tasks that a page starts: the present content ends, and the next one is shown at the same address."""

from __future__ import annotations

import argparse
import asyncio
import signal
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from twin.cli import headset_server
from twin.cli.command_line import parser
from twin.core.errors import TwinError
from twin.simulation.devices.received_hands import HandState
from twin.ui.headset import served_content
from twin.ui.headset.client_messages import RefusedError, parse_message
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session.exercise import Exercise
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.task_choice import TaskChoice, judged


@pytest.fixture(scope="module")
def davinci():
    scene = twin.load_scene("davinci")
    return LoadedScene(scene, {p.name: twin.load(p.robot) for p in scene.places}, None)


def chosen(*words):
    """Return the choice of `twin serve` with these words."""
    args = parser().parse_args(["serve", *words])
    return headset_server._choice(args, twin.load_scene(args.robot))


def begun(choice):
    stopping = asyncio.Event()
    choice.begin(stopping)
    return stopping


def test_only_tasks_that_a_page_judges_are_offered():
    tasks = twin.load_scene("davinci").tasks
    assert list(judged(tasks)) == ["pegboard", "camera"]
    assert "touch" in tasks


@pytest.mark.parametrize(
    ("words", "present"),
    [
        (["davinci"], None),
        (["davinci", "--task", "camera"], "camera"),
        (["davinci", "--task", "touch"], "touch"),
        (["raven_dome"], "ring"),
        (["vsrs"], "cholecystectomy"),
        (["sher_phantom"], "phantom"),
        (["raven_dome", "--task", "none"], None),
    ],
)
def test_the_only_task_of_a_scene_is_shown_at_once(words, present):
    choice = chosen(*words)
    assert choice is not None
    assert choice.present == present


@pytest.mark.parametrize(
    "words", [["davinci", "--session", "a.session"], ["raven_dome", "--record", "a.json"], ["raven"]]
)
def test_options_and_machines_that_determine_the_exercise_leave_no_choice(words):
    assert chosen(*words) is None


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["raven_dome", "--session", "a.session"], "ring"),
        (["raven_dome", "--record", "a.json"], "ring"),
        (["raven_dome", "--ros", "9090"], "ring"),
        (["raven_dome", "--task", "none", "--ros", "9090"], None),
        (["sher_phantom", "--trials", "a.csv"], "phantom"),
        (["davinci", "--session", "a.session"], None),
    ],
)
def test_the_only_task_is_shown_with_options_that_determine_the_exercise_too(words, shown, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    args = parser().parse_args(["serve", *words])
    headset_server._require_compatible(args)
    scene = twin.load_scene(args.robot)
    exercises = []
    monkeypatch.setattr(served_content, "of_console", lambda loaded, exercise, *more: exercises.append(exercise))
    headset_server._at_console(args, LoadedScene(scene, {}, None), headset_server._choice(args, scene))()
    (exercise,) = exercises
    assert (None if exercise.task is None else exercise.task.name) == shown


def test_trials_without_a_task_are_refused():
    args = parser().parse_args(["serve", "sher_phantom", "--trials", "a.csv", "--task", "none"])
    with pytest.raises(TwinError, match="--trials requires --task NAME"):
        headset_server._at_console(args, LoadedScene(twin.load_scene("sher_phantom"), {}, None), None)


def test_an_unknown_task_is_named():
    with pytest.raises(TwinError, match="pegbord"):
        chosen("davinci", "--task", "pegbord")


def test_a_page_starts_a_task_and_nobody_else_while_hands_move_the_robots(davinci):
    choice = TaskChoice(judged(davinci.scene.tasks), None)
    stopping = begun(choice)
    stream = ConsoleStream(davinci, Exercise(choice=choice))
    try:
        about = stream.about
        assert [name for name, _ in about["choice"]["tasks"]] == ["pegboard", "camera"]
        assert about["called"] == {"psm1": "the right instrument", "psm2": "the left instrument"}
        assert about["guided"], "the page reloads itself"
        with pytest.raises(RefusedError, match="pegbord"):
            stream.ask("c1", parse_message('{"type": "task", "do": "start", "name": "pegbord"}'))
        stream.give("c2", HandState(0, False, False, 1, np.eye(4), 0.0), HandState(1, False, False, 1, np.eye(4), 0.0))
        stream.advance(0.05)
        with pytest.raises(RefusedError, match="c2 controls the hands"):
            stream.ask("c1", parse_message('{"type": "task", "do": "start", "name": "pegboard"}'))
        assert not stopping.is_set()
        assert not stream.reading["leaving"]
        stream.release("c2")
        stream.ask("c1", parse_message('{"type": "task", "do": "start", "name": "pegboard"}'))
        assert stopping.is_set()
        assert stream.reading["leaving"]
        assert choice.present == "pegboard"
        with pytest.raises(RefusedError, match="another task is being prepared"):
            stream.ask("c1", parse_message('{"type": "task", "do": "start", "name": "camera"}'))
        assert choice.present == "pegboard"
    finally:
        stream.close()
    begun(choice)
    assert not choice.asked
    assert choice.task is davinci.scene.tasks["pegboard"]


def test_a_server_of_one_exercise_refuses_another_task(davinci):
    stream = ConsoleStream(davinci)
    try:
        assert stream.about["choice"] is None
        with pytest.raises(RefusedError, match="shows only one exercise") as refused:
            stream.ask("c1", parse_message('{"type": "task", "do": "start"}'))
        for option in ("session", "trials", "participant", "guided", "record", "replay", "machine", "ros"):
            assert f"--{option}" in str(refused.value)
    finally:
        stream.close()


def test_the_next_task_is_served_and_one_that_fails_gives_way_to_the_one_before(monkeypatch, capsys):
    """The loop of the server, with content that is only named."""
    tasks = judged(twin.load_scene("davinci").tasks)
    choice = TaskChoice(tasks, None)
    requests = ["pegboard", "camera", None]
    shown = []

    async def serve(args, name, make, port, context, begin, access):
        begin(asyncio.Event())
        shown.append(make())
        if len(shown) <= len(requests):
            choice.ask(requests[len(shown) - 1])

    def make():
        if choice.present == "camera":
            raise TwinError("the camera is missing")
        return choice.present

    monkeypatch.setattr(headset_server, "serve_until_stopped", serve)
    monkeypatch.setattr(headset_server, "_access", lambda *given: SimpleNamespace())
    headset_server._serve_tasks(argparse.Namespace(no_browser=False), "davinci", make, choice, 0, None)
    assert shown == [None, "pegboard", "pegboard", None]
    assert "the camera is missing" in capsys.readouterr().err


def test_a_ctrl_c_during_a_change_ends_the_command(monkeypatch):
    choice = TaskChoice(judged(twin.load_scene("davinci").tasks), None)
    shown = []

    async def serve(args, name, make, port, context, begin, access):
        begin(asyncio.Event())
        shown.append(make())
        choice.ask("pegboard")
        return True  # Ctrl-C

    monkeypatch.setattr(headset_server, "serve_until_stopped", serve)
    monkeypatch.setattr(headset_server, "_access", lambda *given: SimpleNamespace())
    args = argparse.Namespace(no_browser=False)
    headset_server._serve_tasks(args, "davinci", lambda: choice.present, choice, 0, None)
    assert shown == [None]


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="on Windows, Ctrl-C raises an exception")
def test_a_ctrl_c_is_noted_also_after_the_server_was_stopped():
    async def press():
        stopping = asyncio.Event()
        interrupted = asyncio.Event()
        headset_server._on_ctrl_c(stopping, interrupted)
        stopping.set()
        signal.raise_signal(signal.SIGINT)
        await asyncio.wait_for(interrupted.wait(), 60)

    handler = signal.getsignal(signal.SIGINT)
    try:
        asyncio.run(press())
    finally:
        signal.signal(signal.SIGINT, handler)


def test_a_first_task_that_fails_ends_the_command(monkeypatch):
    choice = TaskChoice(judged(twin.load_scene("davinci").tasks), "camera")

    async def serve(args, name, make, port, context, begin, access):
        begin(asyncio.Event())
        make()

    def make():
        raise TwinError("the camera is missing")

    monkeypatch.setattr(headset_server, "serve_until_stopped", serve)
    monkeypatch.setattr(headset_server, "_access", lambda *given: SimpleNamespace())
    with pytest.raises(TwinError, match="the camera is missing"):
        headset_server._serve_tasks(argparse.Namespace(no_browser=False), "davinci", make, choice, 0, None)
