"""What a newcomer types first: twin alone, --help, doctor, open and diff."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess

import pytest

from twin.api.difference import diff
from twin.cli import browser, main
from twin.cli.commands import GROUPS, HELP, doctor
from twin.core.errors import TwinError


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
    assert capsys.readouterr().out.rstrip().splitlines()[-1] == "  NOT READY: 1 required packages are missing"


@pytest.mark.parametrize(("said", "found"), [("SwiftShader", "software"), ("", "-"), ("NVIDIA RTX", "yes")])
def test_doctor_asks_chromium_what_draws(said, found, tmp_path, monkeypatch):
    program = tmp_path / "chromium"
    program.write_text(f"#!/bin/sh\necho '<body>WEBGL[{said}]</body>'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert doctor._webgl(True)[0] == found


def test_open_takes_the_last_report(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["open"]) == 2
    assert "twin run sils" in capsys.readouterr().err
    for k, name in enumerate(("old", "new")):
        page = tmp_path / "twin-out" / name / "report.html"
        page.parent.mkdir(parents=True)
        page.write_text(name)
        os.utime(page, (k + 1, k + 1))
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
        ('{"schema": "twin/report/1", "verdict": "maybe", "findings": []}', "not a result of twin"),
        ('{"schema": "twin/report/1", "verdict": "agree", "findings": [1]}', "not a result of twin"),
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
