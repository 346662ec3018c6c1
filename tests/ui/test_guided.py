"""The guided run of the console's study: order of its parts, and the whole run on the page in Chromium."""

from __future__ import annotations

import asyncio
import io
import json
import os
import socket
import subprocess
import sys
from collections import Counter
from types import SimpleNamespace
from urllib import error, request

import pytest
from playwright import sync_api as playwright

import twin
from made import headset_page as headset
from made.console_page import console
from made.ports import free_port
from twin.cli import guided_study, headset_server, parser
from twin.core.errors import TwinError
from twin.simulation.session.guided_parts import PHASES, guided_parts
from twin.simulation.session.session_file import read_session


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


class Run:
    """A guided run of participant 7, in which `act(part, forms)` replaces each served part; its return continues."""

    def __init__(self, monkeypatch, folder):
        self.folder = folder
        self.forms = None
        self.headings = []
        monkeypatch.setattr(guided_study.scenes, "load", lambda scene: None)
        monkeypatch.setattr(guided_study, "_served", self.served)
        monkeypatch.setattr(guided_study.Examiner, "require_input", lambda examiner: None)
        monkeypatch.setattr(guided_study.sys, "stdin", io.StringIO())

    def served(self, args, loaded, part, folder, forms, examiner):
        self.headings.append(part.heading.removeprefix("phase ")[0])
        self.examiner = examiner
        return part, forms

    def go(self, act, *options):
        self.headings = []

        def serve_part(name, made, examiner):
            examiner.continued = bool(act(*made))

        args = ["serve", "davinci", "--guided", str(self.folder), "--participant", "7", *options]
        guided_study.guide(parser.parser().parse_args(args), serve_part)
        return "".join(self.headings)


@pytest.fixture
def run(monkeypatch, tmp_path):
    return Run(monkeypatch, tmp_path)


def answered(forms):
    """Answer all questionnaires that are due by the lowest answer."""
    while forms is not None and forms.due:
        when, key = forms.due[0]
        forms.answer(when, key.name, [key.low] * len(key.item), None)
    return True


def row_of(folder):
    head, row = [line.split(",") for line in (folder / guided_study.TABLE).read_text().splitlines()]
    return dict(zip(head, row, strict=True))


def test_answers_are_in_the_table_at_once_and_an_ended_run_is_continued(run, tmp_path, capsys):
    def act(part, forms):
        answered(forms)
        if part.task is not None:
            (tmp_path / f"7-{part.name}.session").touch()
            run.examiner.complete()
        return part.name != "pegboard-1"

    assert run.go(act) == "123"
    assert row_of(tmp_path)["before_ssq_16"] == "0"
    assert "7-pegboard-1.session is kept: to repeat this part, move the file" in capsys.readouterr().out
    with pytest.raises(TwinError, match="participant 7 is in group 'all': add --group all"):
        run.go(act, "--group", "other")
    assert run.go(act) == "345"
    assert "is continued without:\n    phase 1 of 5" in capsys.readouterr().out
    row = row_of(tmp_path)
    assert (row["user"], row["trial"], row["before_ssq_16"], row["facevalidity_8"]) == ("7", "1", "0", "1")
    with pytest.raises(TwinError, match="participant 7 has taken part already"):
        run.go(act)


def test_a_participant_without_the_last_answers_is_not_locked_out(run, tmp_path):
    def act(part, forms):
        if part.phase < 5:
            (tmp_path / f"7-{part.name}.session").touch()
        elif forms.due[0][1].name == "ssq":
            when, key = forms.due[0]
            forms.answer(when, key.name, [3] * len(key.item), None)
            return False
        return answered(forms)

    assert run.go(act) == "123345"
    assert "ueq_1" not in row_of(tmp_path)
    assert run.go(act) == "5"  # only what is not answered
    assert (row_of(tmp_path)["ssq_1"], row_of(tmp_path)["ueq_26"]) == ("3", "1")


def test_the_end_of_a_run_without_the_last_answers_is_not_called_complete(run, tmp_path, capsys):
    assert run.go(lambda part, forms: True) == "123345"
    said = capsys.readouterr().out
    assert "questionnaires are not answered: the same command asks them again" in said
    assert "complete" not in said


def test_a_part_whose_task_was_not_ended_before_ctrl_c_is_repeated(run, tmp_path, capsys):
    ended = set()

    def act(part, forms):
        if part.task is not None:
            (tmp_path / f"7-{part.name}.session").touch()
            if part.name in ended:
                run.examiner.complete()
        return part.task is None

    assert run.go(act) == "123"
    assert "7-pegboard-1.session is now unfinished-7-pegboard-1.session, and this part is repeated" in (
        capsys.readouterr().out
    )
    assert run.go(act) == "123"
    assert "is now unfinished-2-7-pegboard-1.session" in capsys.readouterr().out
    ended.add("pegboard-1")
    assert run.go(act) == "123"
    assert "7-pegboard-1.session is kept" in capsys.readouterr().out
    assert run.go(act) == "3"  # the second run of the peg board
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "7-pegboard-1.session",
        "unfinished-2-7-pegboard-1.session",
        "unfinished-7-pegboard-1.session",
        "unfinished-7-pegboard-2.session",
    ]


def test_an_interrupted_session_is_named_before_the_run(run, tmp_path):
    (tmp_path / "7-pegboard-2.session.part").touch()
    with pytest.raises(TwinError, match=r"7-pegboard-2\.session\.part is left .* move it to another folder"):
        run.go(lambda part, forms: True)
    assert not run.headings


def test_enter_warns_once_while_questionnaires_are_due_and_the_end_of_the_input_is_said(monkeypatch, capsys):
    source, sink = os.pipe()

    async def part(examiner):
        stopping = asyncio.Event()
        examiner.begin(stopping)
        os.write(sink, b"\n\n")
        await asyncio.wait_for(stopping.wait(), 60)

    with os.fdopen(source) as lines:
        monkeypatch.setattr(guided_study.sys, "stdin", lines)
        examiner = guided_study.Examiner()
        examiner.require_input()
        examiner.due = lambda: 3
        asyncio.run(part(examiner))
        assert examiner.continued
        assert capsys.readouterr().out.count("3 questionnaires are not answered yet; press Enter again") == 1
        os.close(sink)
        examiner._reader.join(60)
        with pytest.raises(TwinError, match="the input of this command has ended: use a terminal"):
            examiner.require_input()


def test_all_parts_have_the_same_access_rules(monkeypatch):
    seen = []

    async def served(args, name, make, port, context, begun, access):
        seen.append(access[1])

    monkeypatch.setattr(headset_server, "serve_until_stopped", served)
    args = parser.parser().parse_args(["serve", "davinci", "--host", "0.0.0.0"])
    serve_part = headset_server._part_server(args, 1, None)
    for _ in range(2):
        serve_part("davinci", lambda: None, SimpleNamespace(begin=None))
    assert seen[0].needs_token
    assert seen[0] is seen[1]


def test_a_ctrl_c_after_enter_ends_the_run(monkeypatch):
    async def served(*given):
        return True  # Ctrl-C

    monkeypatch.setattr(headset_server, "serve_until_stopped", served)
    monkeypatch.setattr(headset_server, "_access", lambda *given: SimpleNamespace())
    serve_part = headset_server._part_server(parser.parser().parse_args(["serve", "davinci"]), 1, None)
    examiner = SimpleNamespace(begin=None, continued=True)
    serve_part("davinci", lambda: None, examiner)
    assert not examiner.continued


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--machine", "raven=127.0.0.1:1:2"], "--machine and --guided cannot be combined"),
        (["--protocols"], "--protocols and --guided cannot be combined"),
        (["insert"], "--guided plays no protocol: omit 'insert'"),
    ],
)
def test_options_that_a_guided_run_would_ignore_are_refused(options, said):
    args = parser.parser().parse_args(["serve", "davinci", *options, "--guided", "x", "--participant", "7"])
    with pytest.raises(TwinError, match=said):
        headset_server._require_compatible(args)


@pytest.mark.slow
def test_a_client_that_one_part_has_admitted_is_admitted_in_the_next_one(tmp_path):
    port = free_port()
    command = [sys.executable, "-m", "twin", "serve", "davinci", "--no-browser", "--port", str(port)]
    command += ["--host", "0.0.0.0", "--guided", str(tmp_path / "study"), "--participant", "7"]
    env = os.environ | {"PYTHONPATH": str(headset.ROOT)}
    process = subprocess.Popen(command, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    opener = request.build_opener(request.HTTPCookieProcessor())
    url = f"http://127.0.0.1:{port}/"

    def title():
        try:
            return json.load(opener.open(f"{url}scene.json", timeout=10))["title"]
        except (error.URLError, ConnectionError):  # between two parts, nothing listens for a moment
            return ""

    try:
        said = ""
        while "?token=" not in said:
            said = process.stdout.readline()
        token = said.strip().partition("?token=")[2]

        def admitted():
            try:
                return opener.open(f"{url}?token={token}", timeout=10).status == 200
            except (error.URLError, ConnectionError):
                return False

        headset.until(admitted, "the page")
        assert title().startswith("phase 1 of 5")
        process.stdin.write("\n\n")
        process.stdin.flush()
        headset.until(lambda: title().startswith("phase 2 of 5"), "the next part, without another token")
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


@pytest.mark.slow
@pytest.mark.browser
def test_a_participant_goes_through_all_phases_on_one_page(browser, tmp_path):
    port = free_port()
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
            page("twin.app.ask('form', {when: 'before', name: 'ssq', answers: Array(16).fill(1), weights: null})")
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
                answers = f"answers: Array({count}).fill({value}), weights: null"
                page(f"twin.app.ask('form', {{when: 'after', name: '{name}', {answers}}})")
            page.until("twin.app.model.console.form === null", "the end")
            go_on()
            process.wait(60)
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
