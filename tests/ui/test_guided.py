"""The guided run of the console's study: order of its parts, and the whole run on the page in Chromium."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections import Counter

import pytest
from playwright import sync_api as playwright

import twin
from made import headset_page as headset
from made.console_page import console
from twin.core.errors import TwinError
from twin.simulation.session.file import read_session
from twin.simulation.session.guided import PHASES, guided_parts


def test_five_phases_in_the_order_of_the_paper_with_both_runs_of_the_peg_board():
    scene = twin.load_scene("davinci")
    parts = guided_parts(scene, 7)
    assert [part.phase for part in parts] == [1, 2, 3, 3, 4, 5]
    assert PHASES == 5
    assert [part.task for part in parts] == [None, None, "pegboard", "pegboard", "camera", None]
    assert (parts[0].before, parts[-1].after) == (["ssq"], ["ssq", "ueq", "simtlx", "facevalidity"])
    assert not parts[4].condition.haptics  # the camera task is purely visual
    firsts = Counter()
    for participant in range(1, 41):
        runs = [part.condition for part in guided_parts(scene, participant) if part.task == "pegboard"]
        assert {run.haptics for run in runs} == {True, False}
        assert [run.run for run in runs] == [1, 2]
        assert [run.participant for run in runs] == [participant] * 2
        firsts[runs[0].haptics] += 1
    assert firsts == {True: 20, False: 20}
    assert guided_parts(scene, 7) == parts


def test_a_scene_without_the_tasks_and_a_wrong_participant_are_refused():
    with pytest.raises(TwinError, match="has no task 'pegboard'"):
        guided_parts(twin.load_scene("vsrs"), 1)
    with pytest.raises(TwinError, match="participant 0"):
        guided_parts(twin.load_scene("davinci"), 0)


@pytest.mark.slow
@pytest.mark.browser
def test_a_participant_goes_through_all_phases_on_one_page(browser, tmp_path):
    port = headset.free_port()
    command = [sys.executable, "-m", "twin", "serve", "davinci", "--no-browser", "--port", str(port)]
    command += ["--guided", str(tmp_path / "study"), "--participant", "7"]
    env = os.environ | {"PYTHONPATH": str(headset.ROOT)}
    process = subprocess.Popen(command, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        said = ""
        while "phase 1" not in said:
            said += process.stdout.readline()

        def listens():
            with socket.socket() as s:
                return s.connect_ex(("127.0.0.1", port)) == 0

        headset.until(listens, "the server listens")
        titles = []
        with console(browser, f"http://127.0.0.1:{port}/", size=(1000, 700), draws=False) as page:

            def waits(what, expression):
                """Wait for a state of the page, which may reload itself meanwhile."""

                def holds():
                    try:
                        return page(f"Boolean(globalThis.twin?.app.model.{expression})")
                    except playwright.Error:  # the page reloads
                        return False

                headset.until(holds, what)

            def reads(number):
                waits(f"phase {number}", f"scene?.title.startsWith('phase {number} of 5')")
                waits("the console", "console")
                titles.append(page("twin.app.model.scene.title"))

            def go_on():
                process.stdin.write("\n")
                process.stdin.flush()

            reads(1)
            page("twin.app.ask('form', {name: 'ssq', answers: Array(16).fill(1), weights: null})")
            page.until("twin.app.model.console.form === null", "no questionnaire")
            go_on()
            reads(2)
            go_on()
            reads(3)
            first = page("twin.app.model.console.haptics")
            go_on()
            waits("the other run", "scene?.title.endsWith('run 2 of 2')")
            reads(3)
            assert page("twin.app.model.console.haptics") is not first
            go_on()
            reads(4)
            go_on()
            reads(5)
            for name, count, value in (("ssq", 16, 2), ("ueq", 26, 4), ("simtlx", 9, 50), ("facevalidity", 8, 4)):
                waits(name, f"console?.form?.name === '{name}'")
                page(f"twin.app.ask('form', {{name: '{name}', answers: Array({count}).fill({value}), weights: null}})")
            page.until("twin.app.model.console.form === null", "the end")
            go_on()
            process.wait(30)
            # between two phases, nothing listens for a moment
            page.errors[:] = [error for error in page.errors if "ERR_CONNECTION" not in error]
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()
    assert process.returncode == 0
    assert titles[2:4] == ["phase 3 of 5: peg board, run 1 of 2", "phase 3 of 5: peg board, run 2 of 2"]
    head, row = [line.split(",") for line in (tmp_path / "study/questionnaires.csv").read_text().splitlines()]
    cells = dict(zip(head, row, strict=True))
    assert (cells["user"], cells["before_ssq_1"], cells["ssq_16"], cells["ueq_26"]) == ("7", "1", "2", "4")
    assert (cells["simtlx_9"], cells["facevalidity_8"]) == ("50", "4")
    sessions = [read_session(tmp_path / f"study/7-pegboard-{run}.session") for run in (1, 2)]
    assert [session.head.condition.haptics for session in sessions] == [first, not first]
    assert [session.head.condition.run for session in sessions] == [1, 2]
