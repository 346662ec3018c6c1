"""`--json` of every command: one JSON text that fits docs/schemas/result.schema.json, on success and on errors."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from made import column
from made.json_schema import misfits
from twin.cli import main
from twin.cli.commands import HELP, doctor
from twin.core.findings import EXIT_CODES
from twin.ui.report import report_folder

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "docs/schemas/result.schema.json").read_text(encoding="utf-8"))
SHORT = ROOT / "tests/data/short.toml"
SERVERS = {"view", "serve", "follow"}
"""They print nothing on success: they run until Ctrl-C."""

DONE = {
    "list": ("list", ["list"]),
    "info": ("info", ["info", "hibou"]),
    "info of a scene": ("info", ["info", "vsrs"]),
    "info of masses": ("inertia", ["info", "{column}", "--inertia"]),
    "info of cited masses": ("inertia", ["info", "pa10", "--inertia"]),
    "info of motion": ("motion", ["info", "raven_left", "--motion"]),
    "doctor": ("doctor", ["doctor"]),
    "open": ("open", ["open", "{page}"]),
    "completion": ("completion", ["completion", "bash"]),
    "diff": ("diff", ["diff", "{json}", "{json}"]),
    "build": ("build", ["build", "hibou", "--out", "stage"]),
    "build that is not current": ("build", ["build", "hibou", "--check", "--out", "nowhere"]),
    "plan": ("plan", ["plan", "sils", str(SHORT)]),
    "validate": ("report", ["validate", "hibou"]),
    "validate over the strokes": ("stroke", ["validate", "sher", "--sweep", "q5"]),
    "validate at many states": ("samples", ["validate", "hibou", "--samples", "300"]),
    "run": ("report", ["run", "hibou"]),
    "export": ("export", ["export", "hibou", "--to", "tracks", "--out", "made"]),
    "audit": ("audit", ["audit", str(ROOT / "usd/hibou/hibou.usda")]),
    "study": ("study", ["study", "davinci"]),
    "console": ("console", ["console", "davinci", "--variant", "paper"]),
    "new": ("new", ["new", "made", "--from", str(ROOT / "cad/hibou/hibou.step")]),
    "machine": ("machine", ["machine", "raven_left", "--duration", "0.1"]),
    "hazards": ("hazards", ["hazards", "raven_left", "--sessions", "1", "--processes", "1"]),
    "operate": ("operate", ["operate", "sher"]),
    "track": ("track", ["track", "{column}"]),
    "prove": ("prove", ["prove", "sils", "--states", "64"]),
    "check": ("check", ["check", str(ROOT / "tests/data/checked")]),
    "compare": ("compare", ["compare", "hibou", "hibou"]),
    "explain": ("explain", ["explain", "hibou", "--seconds", "0"]),
    "selftest": ("selftest", ["selftest", "hibou", "--count", "1"]),
    "tolerance": ("tolerance", ["tolerance", "hibou", "--samples", "0"]),
    "sweep": ("sweep", ["sweep", "sils", "--vary", "l_p=120..150mm", "--samples", "1", "--workers", "1"]),
    "workspace": ("workspace", ["workspace", "hibou", "--count", "1000"]),
}


def _filled(argument, folder):
    """Return an argument with the path of what it stands for."""
    if argument == "{column}":
        return str(column.folder(folder / "column"))
    if argument == "{page}":
        page = folder / "report.html"
        page.write_text("")
        return str(page)
    if argument == "{json}":
        file = folder / "result.json"
        file.write_text(json.dumps({"schema": "twin/list/1", "verdict": "agree", "findings": []}))
        return str(file)
    return argument


LONG = {
    "sweep", "export", "validate", "hazards", "track", "workspace", "build", "build that is not current", "tolerance",
    "explain",
}  # fmt: skip
"""They take a second or more each; the default suite leaves them out."""

LONGEST = {"selftest", "operate", "run", "sweep", "info of cited masses"}


def marks(case):
    """Return the marks of the lane of a case."""
    if case in LONGEST:
        return [pytest.mark.nightly]
    return [pytest.mark.slow] if case in LONG else []


@pytest.fixture
def printed(capsys, tmp_path, monkeypatch):
    """Run a command with --json in an empty folder; return (exit code, its JSON, after the check of its schema)."""
    monkeypatch.chdir(tmp_path)

    def call(*argv: str) -> tuple[int, dict]:
        capsys.readouterr()
        code = main([*argv, "--json"])
        data = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
        assert list(misfits(data, SCHEMA, SCHEMA, argv[0])) == []
        return code, data

    return call


def test_every_command_is_here():
    assert {argv[0] for _, argv in DONE.values()} | SERVERS | {"session"} == set(HELP)


@pytest.mark.parametrize("case", [pytest.param(c, marks=marks(c)) for c in DONE])
def test_a_result_fits_its_schema(printed, no_plots, tmp_path, monkeypatch, case):
    kind, argv = DONE[case]
    monkeypatch.setattr(report_folder, "write_report", lambda report, folder, **_: None)  # plots take most of the time
    code, data = printed(*(_filled(a, tmp_path) for a in argv))
    assert data["schema"] == f"twin/{kind}/1"
    assert code == EXIT_CODES[data["verdict"]] or (kind, code) == ("tolerance", 0)


@pytest.mark.parametrize("command", HELP)
def test_an_error_fits_its_schema(printed, command):
    for argv in ([command, "--nonsense"], *([] if command in ("list", "doctor") else [[command, "nothing_here"]])):
        code, data = printed(*argv)
        assert (code, data["schema"], data["verdict"]) == (2, "twin/error/1", "unchecked")
        assert data["findings"][0]["message"] == data["message"]


def test_a_missing_package_is_a_finding(printed, monkeypatch):
    installed = doctor._installed
    monkeypatch.setattr(doctor, "_installed", lambda n: None if n == "toppra" else installed(n))
    code, data = printed("doctor")
    assert (code, data["verdict"], data["missing"]) == (2, "unchecked", ["toppra"])
    assert [(f["code"], f["where"]) for f in data["findings"]] == [("doctor.missing", "toppra")]


def test_every_kind_of_result_is_in_the_schema():
    """Also those that take too long here: several reports, sessions, procedures, trends, scenes."""
    known = set(SCHEMA["properties"]["schema"]["enum"])
    kinds = {"build", "completion", "doctor", "error", "machine", "open", "reports"}
    for file in (ROOT / "twin").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        for body in re.split(r"^class \w+\(Result\):$", text, flags=re.MULTILINE)[1:]:
            kinds |= set(re.findall(r'^    kind(?:: ClassVar\[str\])? = "(.+)"$', body, re.MULTILINE)[:1])
    assert known == {f"twin/{kind}/1" for kind in kinds}
