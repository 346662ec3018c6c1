"""What a newcomer types first: twin alone, --help, doctor, open and diff."""

from __future__ import annotations

import json
import os
import pty
import select
import shutil
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from twin.api.result_difference import diff
from twin.cli import browser, main
from twin.cli.commands import GROUPS, HELP, doctor
from twin.cli.commands.open import REPORT
from twin.core.errors import TwinError
from twin.ui.report.page import render as page_of


def result(findings=(), verdict="agree", residuals=()):
    """A result of `twin validate --json`."""
    rows = [
        {"pair": "A-B", "quantity": "point", "name": name, "unit": "m", "worst": worst, "tolerance": 1e-9}
        for name, worst in residuals
    ]
    data = {"schema": "twin/report/1", "verdict": verdict, "findings": list(findings), "residuals": rows}
    return json.dumps(data)


WRONG = {"code": "point", "severity": "disagreement", "where": "s1", "when": "", "message": "point s1 differs"}


def test_twin_alone_says_what_to_do_in_ten_lines(capsys):
    assert main([]) == 2
    said = capsys.readouterr().out
    assert len(said.splitlines()) <= 10
    for command in ("twin run sils", "twin view sils", "twin new", "twin --help"):
        assert command in said


def test_every_command_has_one_job(capsys):
    listed = [name for names in GROUPS.values() for name in names]
    assert sorted(listed) == sorted(HELP)
    with pytest.raises(SystemExit):
        main(["--help"])
    said = capsys.readouterr().out
    for job, names in GROUPS.items():
        assert f"\n{job}:\n" in said
        for name in names:
            assert f"\n  {name} " in said
    assert max(map(len, said.splitlines())) <= 120


def test_doctor_ends_with_one_verdict_and_names_ports_and_graphics(capsys, monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        monkeypatch.setattr(doctor, "PORTS", {"twin view": port, "twin serve": 0})
        assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.rstrip().splitlines()
    assert lines[-1].startswith("  READY: all required packages are there")
    assert f"port {port} is taken" in lines[-1]
    table = "\n".join(lines)
    assert "WebGL 2" in table
    assert "graphics processor" in table
    assert "port 0" in table
    monkeypatch.setattr(doctor, "_installed", lambda name: None if name == "pin" else "1")
    assert main(["doctor"]) == 2
    assert capsys.readouterr().out.rstrip().splitlines()[-1] == "  NOT READY: 1 required package is missing"


@pytest.mark.parametrize(("said", "found"), [("SwiftShader", "software"), ("", "-"), ("NVIDIA RTX", "yes")])
def test_doctor_asks_chromium_what_draws(said, found, tmp_path, monkeypatch):
    program = tmp_path / "chromium"
    program.write_text(f"#!/bin/sh\necho '<body>WEBGL[{said}]</body>'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert doctor._webgl(True)[0] == found


REPORT_HEAD = '<!doctype html>\n<head><meta name="generator" content="twin">\n'


def test_doctor_takes_no_script_that_has_not_run_for_an_answer(tmp_path, monkeypatch):
    program = tmp_path / "chromium"
    program.write_text('#!/bin/sh\nfor page; do :; done\necho "$page"\n')  # the page as it was given
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    found, reason = doctor._webgl(True)
    assert found == "untested"
    assert "chromium did not answer" in reason


def test_every_report_has_the_line_by_which_it_is_found(tmp_path):
    (tmp_path / "a.json").write_text(result())
    page = page_of(diff(tmp_path / "a.json", tmp_path / "a.json"), "diff")
    templates = Path(page_of.__code__.co_filename).parent
    report = (templates / "report.html.j2").read_text(encoding="utf-8")
    head = report[report.index("<!doctype") :]
    for text in (page, head):
        assert REPORT.decode() in text[:500]


def test_open_takes_the_last_report(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["open"]) == 2
    assert "twin run sils" in capsys.readouterr().err
    for k, name in enumerate(("old", "new")):
        page = tmp_path / "twin-out" / name / "report.html"
        page.parent.mkdir(parents=True)
        page.write_text(REPORT_HEAD)
        os.utime(page, (k + 1, k + 1))
    (tmp_path / "twin-out/site").mkdir()
    (tmp_path / "twin-out/site/index.html").write_text("<html>a page of the documentation</html>")
    unfinished = tmp_path / "twin-out/new/.twin-0123abcd.tmp/new/report.html"
    unfinished.parent.mkdir(parents=True)
    unfinished.write_text(REPORT_HEAD)
    (tmp_path / "twin-out/gone.html").symlink_to(tmp_path / "twin-out/removed.html")
    opened = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(browser.webbrowser, "open", lambda address: opened.append(address) or True)
    assert main(["open"]) == 0
    assert "twin-out/new/report.html" in capsys.readouterr().out
    assert opened == [(tmp_path / "twin-out/new/report.html").as_uri()]


def test_two_verdicts_and_what_changed(tmp_path, capsys):
    before = tmp_path / "before.json"
    after = tmp_path / "after.json"
    before.write_text(result(residuals=[("s1", 2e-13), ("s2", 1e-13)]))
    after.write_text(result([WRONG], "disagree", [("s1", 3e-3), ("s2", 4e-13)]))
    assert main(["diff", str(before), str(after)]) == 1
    said = capsys.readouterr().out
    assert "AGREE: " in said
    assert "DISAGREE: " in said
    assert "point s1 differs" in said
    assert "0.003 m" in said
    assert "s2" not in said, "rounding far below the tolerance"
    assert main(["diff", str(after), str(after)]) == 0
    assert "no finding and no residual differs" in capsys.readouterr().out
    repaired = diff(after, before)
    assert repaired.gone == (WRONG,)
    assert repaired.verdicts == ("disagree", "agree")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[]", "not a result of twin"),
        (100_000 * "[", "nested too deeply"),
        ('{"schema": "twin/report/1", "verdict": "maybe", "findings": []}', "not a result of twin"),
        ('{"schema": "twin/report/1", "verdict": "agree", "findings": [1]}', "not a result of twin"),
        ('{"schema": "twin/report/1", "verdict": "agree", "findings": [{"where": [[]]}]}', "not a result of twin"),
        ('{"schema": "twin/plan/1", "verdict": "agree", "findings": []}', "give two of one kind"),
    ],
)
def test_what_is_no_result_is_refused(text, message, tmp_path):
    good = tmp_path / "good.json"
    good.write_text(result())
    bad = tmp_path / "bad.json"
    bad.write_text(text)
    with pytest.raises(TwinError, match=message):
        diff(good, bad)
    with pytest.raises(TwinError, match="does not exist"):
        diff(good, tmp_path / "gone.json")


def difference(tmp_path, first, second):
    """The difference of two results that are given as text."""
    before = tmp_path / "first.json"
    after = tmp_path / "second.json"
    before.write_text(first)
    after.write_text(second)
    return diff(before, after)


def test_a_finding_that_occurs_once_more_is_new_also_if_its_numbers_differ(tmp_path):
    near = WRONG | {"when": "insert, t = 1.234 s", "message": "point s1 differs by 3 mm"}
    later = WRONG | {"when": "insert, t = 1.235 s", "message": "point s1 differs by 3.1 mm"}
    other = near | {"where": "s2"}
    moved = difference(tmp_path, result([near]), result([later]))
    assert (moved.appeared, moved.gone) == ((), ())
    again = difference(tmp_path, result([near]), result([later, near]))
    assert (again.appeared, again.gone) == ((later,), ())
    assert difference(tmp_path, result([near, near]), result([near])).gone == (near,)
    assert difference(tmp_path, result([near]), result([other])).appeared == (other,), "the digit is part of a name"


def test_a_finding_with_other_words_is_new(tmp_path):
    near = WRONG | {"message": "point s1 differs by 3 mm (tolerance 1 µm)"}
    smaller = WRONG | {"message": "point s1 differs by 45.2 µm (tolerance 1 µm)"}
    exact = WRONG | {"message": "point s1 differs by 4.1×10⁻⁵ µm (tolerance 1 µm)"}
    other = WRONG | {"message": "point s1 has no value"}
    for moved in (smaller, exact):
        same = difference(tmp_path, result([near]), result([moved]))
        assert (same.appeared, same.gone) == ((), ())
    changed = difference(tmp_path, result([near]), result([other]))
    assert (changed.appeared, changed.gone) == ((other,), (near,))


def test_deviations_on_both_sides_of_rounding_are_one_and_json_tells_the_missing_from_the_infinite(tmp_path):
    below = result(residuals=[("s1", 0.99e-11), ("s2", 0.0), ("s3", 0.0)])
    above = result(residuals=[("s1", 1.01e-11), ("s2", 0.125)]).replace("0.125", "NaN")
    said = difference(tmp_path, below, above)
    rows = said.as_dict()["residuals"]
    assert sorted((row["name"].split()[-2], row["in_first"], row["in_second"]) for row in rows) == [
        ("s2", True, True),
        ("s3", True, False),
    ]
    assert said.as_dict()["protocols"] == ["", ""]
    # the tolerance of the second result is 1000 times as large
    loose = result(residuals=[("s1", 1e-9)]).replace("1e-09}", "1e-06}")
    assert len(difference(tmp_path, result(residuals=[("s1", 1e-13)]), loose).residuals) == 1


@pytest.mark.parametrize("lost", ["NaN", "null", "Infinity", "1" + 400 * "0"])
def test_a_residual_that_is_no_longer_finite_is_worse(lost, tmp_path):
    for before in (1e-10, 1e-3):
        after = result(residuals=[("s1", 0.125)]).replace("0.125", lost)
        worse = difference(tmp_path, result(residuals=[("s1", before)]), after)
        assert worse.verdict == "disagree"
        assert worse.findings[0].code == "diff.residual"
        assert "is not finite" in worse.findings[0].message
        assert difference(tmp_path, after, after).residuals == ()


def test_of_rows_with_one_name_the_largest_counts(tmp_path):
    one = result(residuals=[("s1", 3e-3), ("s1", 1e-10)])
    assert difference(tmp_path, one, result(residuals=[("s1", 1e-10), ("s1", 3e-3)])).residuals == ()
    (row,) = difference(tmp_path, one, result(residuals=[("s1", 1e-10)])).residuals
    assert (row.before, row.after) == (3e-3, 1e-10)


def test_robots_are_not_compared_with_each_other_and_other_protocols_are_named(tmp_path):
    def of(robot, protocol):
        return result().replace('"verdict"', f'"robot": "{robot}", "protocol": "{protocol}", "verdict"')

    with pytest.raises(TwinError, match=r"is of the robot 'sils', and .* of 'sher'"):
        difference(tmp_path, of("sils", "table2"), of("sher", "phantom"))
    said = difference(tmp_path, of("sils", "table2"), of("sils", "lowered"))
    assert said.verdict == "agree"
    assert [finding.code for finding in said.findings] == ["diff.protocol"]


def test_a_folder_with_a_certificate_is_compared_by_its_result(tmp_path):
    folder = tmp_path / "prove"
    folder.mkdir()
    (folder / "prove.json").write_text(result().replace("twin/report/1", "twin/prove/1"))
    (folder / "certificate.json").write_text('{"schema": "twin/certificate/1", "claims": []}')
    assert diff(folder, folder).verdicts == ("agree", "agree")
    (folder / "report.json").write_text(result())
    with pytest.raises(TwinError, match="2 results are in the folder"):
        diff(folder, folder)


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [("twin val", "validate"), ("twin view si", "sils"), ("twin export --t", "--to"), ("twin info vs", "vsrs")],
)
def test_bash_completes_commands_robots_and_options(typed, offered, capsys, tmp_path):
    assert main(["completion", "bash"]) == 0
    script = tmp_path / "twin.bash"
    script.write_text(capsys.readouterr().out)
    words = typed.split()
    ask = f"source {script}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _twin; echo ${{COMPREPLY[@]}}"
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert offered in done.stdout.split(), done.stderr


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_every_command(shell, capsys):
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    for command in HELP:
        assert command in said
    assert "--to" in said or "-l to" in said


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_completes_at_the_first_tab(capsys, tmp_path):
    assert main(["completion", "zsh"]) == 0
    (tmp_path / "_twin").write_text(capsys.readouterr().out)
    (tmp_path / ".zshrc").write_text(f"fpath+={tmp_path}\nautoload -Uz compinit\ncompinit -u -D\nPS1=ready\n")
    process, terminal = pty.fork()
    if process == 0:
        os.environ.update(ZDOTDIR=str(tmp_path), TERM="dumb")
        os.execvp("zsh", ["zsh", "-i"])
    try:
        _until(terminal, b"ready")
        os.write(terminal, b"twin vali\t")
        _until(terminal, b"twin validate")
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        os.close(terminal)


def _until(terminal, text):
    """Read from a terminal until a text has come."""
    seen = b""
    while text not in seen:
        ready, _, _ = select.select([terminal], [], [], 60.0)
        assert ready, seen
        seen += os.read(terminal, 65536)
