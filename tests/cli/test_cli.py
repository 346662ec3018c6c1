"""Every command as a person or a script uses it: text, JSON, exit codes, files."""

from __future__ import annotations

import contextlib
import io
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

import twin
from made import own_robot
from twin import api
from twin.cli import main, option_values, scenes, show
from twin.cli.command_line import after_imports
from twin.cli.commands import HELP, doctor
from twin.cli.parser import Command, parser
from twin.core import assets

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "tests/data/short.toml"
CURRENT = {"schema": "twin/build/1", "verdict": "agree", "differing": [], "unexpected": [], "findings": []}


@dataclass
class Result:
    code: int
    out: str
    err: str

    @property
    def json(self):
        """Standard output, which must be JSON and nothing else, without NaN."""

        def refuse(word):
            raise AssertionError(f"{word} is not JSON")

        return json.loads(self.out, parse_constant=refuse)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Run `twin ...` in an empty directory."""
    monkeypatch.chdir(tmp_path)

    def call(*argv: object) -> Result:
        capsys.readouterr()
        code = main([str(a) for a in argv])
        got = capsys.readouterr()
        return Result(code, got.out, got.err)

    return call


@pytest.fixture
def no_pictures(monkeypatch):
    """Write report.json only: plots and HTML take most of a short judgement's time."""

    from twin.ui.report import report_folder

    monkeypatch.setattr(report_folder, "write_report", _json_only)


def _json_only(report, folder, **_):
    (folder / "report.json").write_text(report.to_json())


@pytest.fixture
def robot(tmp_path) -> Path:
    """A robot folder of one's own, with SILS inside and two short protocols."""
    folder, text = own_robot.folder(tmp_path), SHORT.read_text(encoding="utf-8")
    (folder / "trajectories/shorter.toml").write_text(text.replace('"short"', '"shorter"').replace("210.4", "210.9"))
    return folder


def files_below(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


# --------------------------------------------------------------------------------------------------- help


@pytest.mark.parametrize("command", HELP)
def test_help_of_every_command_shows_examples(command, capsys):
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    text = capsys.readouterr().out
    assert left.value.code == 0
    examples = text[text.index("examples:") :].splitlines()[1:]
    assert examples
    assert all(line.startswith(f"  twin {command}") for line in examples)
    for option in ("--json", "--quiet", "--debug", "--no-code"):
        assert option in text


@pytest.mark.parametrize("command", HELP)
def test_examples_of_the_help_are_understood(command, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    text = capsys.readouterr().out
    for line in text[text.index("examples:") :].splitlines()[1:]:
        words = re.split(r"\s{2,}", line.strip())[0].split()[1:]
        assert parser().parse_args(words).command == command


def test_main_help_shows_examples_and_exit_codes(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out
    assert "examples:" in text
    assert "exit codes: 0 agree or done, 1 disagree, 2 could not check" in text
    for line in text[text.index("examples:") : text.index("exit codes")].strip().splitlines()[1:]:
        parser().parse_args(re.split(r"\s{2,}", line.strip())[0].split()[1:])
    for command in HELP:
        assert f"\n  {command} " in text


def test_every_command_is_the_file_of_its_name():
    assert {p.stem for p in (ROOT / "twin/cli/commands").glob("*.py")} == {"__init__", *HELP}


def test_python_m_twin():
    done = subprocess.run([sys.executable, "-m", "twin", "--version"], capture_output=True, text=True, cwd="/")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"twin {twin.__version__}\n", "")


# -------------------------------------------------------------------------------------------- list and info


def test_list(run):
    text = run("list")
    assert text.code == 0
    assert "SILS 6-DOF parallel robot" in text.out
    assert re.search(r"sils .* yes +yes +lowered_patient, table2, table2_printed", text.out)
    data = run("list", "--json").json
    assert (data["schema"], data["verdict"]) == ("twin/list/1", "agree")
    sils = next(r for r in data["robots"] if r["name"] == "sils")
    assert sils["protocols"] == ["lowered_patient", "table2", "table2_printed"]
    assert sils["equations"] is sils["stage"] is True


def test_info(run, tmp_path):
    brief = run("info", "sils")
    assert brief.code == 0
    assert len(brief.out.splitlines()) <= 30
    assert "17 bodies, 21 joints, 6 degrees of freedom, 9 redundant constraints" in brief.out
    assert "eq1=printed" in brief.out
    assert "twin info sils --all" in brief.out
    text = run("info", "sils", "--all")
    assert text.code == 0
    assert "17 bodies, 21 joints, 6 degrees of freedom, 9 redundant constraints" in text.out
    assert re.search(r"q3 +prismatic +limb2 -> carriage3 +-10 \.\. 600 mm +driven", text.out)
    assert " *eq1=corrected:" in text.out
    assert "  eq1=printed:" in text.out
    assert re.search(r"\*L_H +612 mm +ASSUMED", text.out)
    data = run("info", "sils", "--json").json
    assert data["degrees_of_freedom"] == 6
    assert [j["name"] for j in data["joints"] if j["active"]] == ["q1", "q2", "q3", "q4", "q5", "q6"]
    assert {j["name"] for j in data["joints"] if j["closes_loop"]} == {"r13", "r23", "s2", "r33", "s3"}
    assert data["chosen"] == {"eq1": "corrected", "eq2": "corrected"}
    assert {"name", "value", "unit", "shown", "provenance", "note"} == set(data["parameters"][0])
    assert next(p for p in data["parameters"] if p["name"] == "L_H")["value"] == pytest.approx(0.612)
    assert files_below(tmp_path) == set()


def test_info_of_a_robot_without_equations(run, robot):
    (robot / "formula.py").unlink()
    text = run("info", robot)
    assert text.code == 0
    assert "no equations" in text.out
    assert run("info", robot, "--json").json["variants"] == {}


@pytest.mark.slow
def test_info_of_a_stage(run):
    result = run("info", ROOT / "usd/sils/sils.usda", "--json")
    assert result.code == 0
    assert result.json["degrees_of_freedom"] == 6
    assert result.json["variants"] == {}


# ------------------------------------------------------------------------------------------------------ build


@pytest.fixture
def built(run, robot, monkeypatch) -> Path:
    """A robot folder with a built stage; further builds copy it, since they would be equal."""
    (robot / "trajectories/shorter.toml").unlink()
    text = run("build", robot)
    assert text.code == 0
    written = [Path(line.split("  (")[0].strip()) for line in text.out.splitlines()]
    assert written[0] == robot / "usd/sils.usda"
    assert sorted(written) == sorted(p for p in (robot / "usd").rglob("*") if p.is_file())
    stages = {"physics.usda", "sils.usda", "sils_sim.usda", "sils_short.usda"}
    names = {"geometry.usdc", "motion", "motion/short.usdc", *stages}
    assert files_below(robot / "usd") == names
    first = robot.parent / "first"
    shutil.copytree(robot / "usd", first)
    data = run("build", robot, "--check", "--json").json  # for once against a real build
    assert data == CURRENT

    def build(_, folder, **__):
        shutil.copytree(first, folder, dirs_exist_ok=True)
        return [p for p in Path(folder).rglob("*") if p.is_file()]

    monkeypatch.setattr("twin.api.exports.build", build)
    return robot / "usd"


@pytest.mark.slow
def test_build_check(run, built, tmp_path):
    robot, before = built.parent, files_below(built)
    assert "is current: 6 files equal a new build" in run("build", robot, "--check").out
    assert run("build", robot, "--check", "--json").json == CURRENT

    physics = built / "physics.usda"
    original = physics.read_text()
    changed = re.sub(r"(float physics:mass = )([\d.]+)", lambda m: f"{m[1]}{float(m[2]) + 1:g}", original, count=1)
    assert changed != original
    physics.write_text(changed)
    text = run("build", robot, "--check")
    assert text.code == 1
    assert f"is not current. Rebuild it with: twin build {robot}" in text.out
    assert "differs: physics.usda" in text.out
    data = run("build", robot, "--check", "--json")
    assert (data.code, data.json["verdict"], data.json["differing"]) == (1, "disagree", ["physics.usda"])

    physics.write_text("this is not a layer")
    assert run("build", robot, "--check", "--json").json["differing"] == ["physics.usda"]
    physics.unlink()
    assert run("build", robot, "--check", "--json").json["differing"] == ["physics.usda"]

    physics.write_text(original)
    shutil.copy(physics, built / "old.usda")
    data = run("build", robot, "--check", "--json")
    assert (data.code, data.json["unexpected"]) == (1, ["old.usda"])
    assert [(f["code"], f["where"]) for f in data.json["findings"]] == [("build.unexpected", "old.usda")]
    (built / "old.usda").unlink()
    assert run("build", robot, "--check").code == 0
    assert files_below(built) == before, "--check writes nothing"

    # Another processor rounds differently.
    nudged = re.sub(r"(physics:mass = )([\d.]+)", lambda m: f"{m[1]}{float(m[2]) * (1 + 1e-8):.12g}", original, count=1)
    assert nudged != original
    physics.write_text(nudged)
    assert run("build", robot, "--check").code == 0

    missing = run("build", robot, "--check", "--out", tmp_path / "nowhere", "--json")
    assert missing.code == 1
    assert len(missing.json["differing"]) == 6
    assert not (tmp_path / "nowhere").exists()


def test_build_check_compares_the_whole_stage(run):
    result = run("build", "sils", "--check", "--protocol", "table2")
    assert result.code == 2
    assert "omit --protocol" in result.err


def test_stage_cannot_be_built_again(run):
    for more in ([], ["--check"]):
        result = run("build", ROOT / "usd/sils/sils.usda", *more)
        assert result.code == 2
        assert "was loaded from a USD stage" in result.err


# ------------------------------------------------------------------------------------------------------- plan


def test_plan(run, tmp_path):
    text = run("plan", "sils")
    assert text.code == 0
    assert re.search(r"sils · table2 · [\d.]+ s, \d+ samples", text.out)
    assert re.search(r"sweep +pivot +[\d.]+ +[\d.]+ +t_prime +enforced", text.out)
    assert "twin-out/sils/table2/trajectory.csv" in text.out
    folder = tmp_path / "twin-out/sils/table2"
    assert files_below(folder) == {"trajectory.csv", "trajectory.json"}
    rows = (folder / "trajectory.csv").read_text().splitlines()
    header = rows[0].split(",")
    assert header[:3] == ["t_s", "q1_mm", "q2_mm"]
    assert header[-4:] == ["tool_qw", "tool_qx", "tool_qy", "tool_qz"]
    first = dict(zip(header, map(float, rows[1].split(",")), strict=True))
    assert first["tool_x_mm"] == pytest.approx(407.9)
    assert first["q1_mm"] == pytest.approx(312.498356767)
    assert first["q1_mm_s"] == first["q1_mm_s2"] == 0 or abs(first["q1_mm_s"]) < 1e-6


def test_plan_json(run, tmp_path):
    result = run("plan", "sils", SHORT, "--out", "plan", "--json")
    assert result.code == 0
    data = result.json
    assert data["verdict"] == "agree"
    assert data["protocol"] == "short"
    assert data["folder"] == "plan"
    assert [p["name"] for p in data["phases"]] == ["lower"]
    assert data["findings"]
    saved = json.loads((tmp_path / "plan/trajectory.json").read_text())
    assert saved["phases"] == data["phases"]
    assert len((tmp_path / "plan/trajectory.csv").read_text().splitlines()) == data["samples"] + 1


def test_plan_of_a_missed_rcm_disagrees(run):
    result = run("plan", "sils", "table2_printed", "--json")
    assert result.code == 1
    assert result.json["verdict"] == "disagree"
    missed = [f for f in result.json["findings"] if f["severity"] == "disagreement"]
    assert missed[0]["code"].startswith("rcm.")


# --------------------------------------------------------------------------------------------------- validate


@pytest.mark.nightly
def test_validate_agrees(run, tmp_path):
    result = run("validate", "sils", "--protocol", SHORT)
    assert result.code == 0
    assert "AGREE: equations, mechanism and stage agree" in result.out
    assert "report: twin-out/sils/short/report.html" in result.out
    assert result.err == ""
    written = files_below(tmp_path / "twin-out/sils/short")
    assert {"report.html", "report.json", "plots"} <= written
    assert not [n for n in written if ".twin-" in n]
    saved = json.loads((tmp_path / "twin-out/sils/short/report.json").read_text())
    assert saved["verdict"] == "agree"


@pytest.mark.nightly
def test_validate_of_the_printed_poses(run, no_pictures):
    """The RCM of the printed poses is missed: equations and mechanism agree, the protocol does not hold."""
    result = run("validate", "sils", "--protocol", "table2_printed", "--json", "--out", "here")
    assert result.code == 1
    assert result.err == ""
    data = result.json
    assert data["verdict"] == "disagree"
    assert data["schema"] == "twin/report/1"
    assert data["folder"] == "here/table2_printed"
    assert {"pair", "quantity", "name", "unit", "worst", "tolerance", "agrees", "t", "phase"} <= set(
        data["residuals"][0]
    )
    assert {r["quantity"] for r in data["residuals"]} >= {"tool", "loop", "rcm"}
    keys = {"code", "severity", "where", "when", "size", "unit", "message", "suggestion"}
    assert all(keys <= set(f) for f in data["findings"])
    gravest = data["findings"][0]
    assert gravest["severity"] == "disagreement"
    assert gravest["code"].startswith("rcm.")


@pytest.mark.nightly
def test_validate_of_one_printed_equation(run, no_pictures):
    result = run("validate", "sils", "--protocol", SHORT, "--variant", "eq1=printed", "--json")
    assert result.code == 1
    data = result.json
    assert data["verdict"] == "disagree"
    assert data["schema"] == "twin/report/1"
    keys = {"pair", "quantity", "name", "unit", "worst", "rms", "tolerance", "agrees", "t", "phase"}
    assert all(keys <= set(r) for r in data["residuals"])
    assert {r["quantity"] for r in data["residuals"]} >= {"tool", "point", "loop", "driven"}
    keys = {"code", "severity", "where", "when", "size", "unit", "limit", "message", "suggestion"}
    assert all(keys <= set(f) for f in data["findings"])
    assert data["variants"] == {"eq1": "printed", "eq2": "corrected"}
    assert data["folder"] == "twin-out/sils/short-eq1-printed"
    point = next(f for f in data["findings"] if f["severity"] == "disagreement")
    assert "eq1" in point["message"]


@pytest.mark.nightly
def test_bare_variant_judges_each_alone_and_all_together(run, no_pictures, tmp_path):
    result = run("validate", "sils", "--protocol", SHORT, "--variant", "printed", "--json")
    assert result.code == 1
    data = result.json
    assert data["verdict"] == "disagree"
    assert [r["variants"] for r in data["reports"]] == [
        {"eq1": "printed", "eq2": "corrected"},
        {"eq1": "corrected", "eq2": "printed"},
        {"eq1": "printed", "eq2": "printed"},
    ]
    folders = {"short-eq1-printed", "short-eq2-printed", "short-eq1-printed-eq2-printed"}
    assert {p.name for p in (tmp_path / "twin-out/sils").iterdir()} == folders


def test_bare_variant_that_one_equation_has_is_judged_once(monkeypatch):
    robot = api.load("sils")
    assert option_values.variants_of_each(robot, ["literal"]) == [{"eq2": "literal"}]


@pytest.mark.slow
def test_all_protocols_of_a_robot_folder(run, robot, no_pictures, tmp_path):
    result = run("validate", robot, "--all-protocols")
    assert result.code == 0
    assert re.search(r"short +eq1=corrected, eq2=corrected +agree", result.out)
    assert re.search(r"shorter +eq1=corrected, eq2=corrected +agree", result.out)
    assert {p.name for p in (tmp_path / "twin-out/sils").iterdir()} == {"short", "shorter"}
    assert not (robot / "usd").exists(), "only `build` writes into the robot's folder"


@pytest.mark.slow
def test_tolerance_widens_every_row(run, no_pictures):
    result = run("validate", "sils", "--protocol", SHORT, "--tolerance-um", "100", "--json")
    assert result.code == 0
    tools = [r for r in result.json["residuals"] if r["pair"] == "A-B" and r["quantity"] == "tool" and r["unit"] == "m"]
    assert tools
    assert all(r["tolerance"] == pytest.approx(100e-6) for r in tools)


@pytest.mark.nightly
def test_validate_all_protocols_of_sils(run, no_pictures):
    result = run("validate", "sils", "--all-protocols", "--json")
    assert result.code == 1
    verdicts = {r["protocol"]: r["verdict"] for r in result.json["reports"]}
    assert (result.json["schema"], result.json["findings"]) == ("twin/reports/1", [])
    assert verdicts == {"lowered_patient": "agree", "table2": "agree", "table2_printed": "disagree"}


# -------------------------------------------------------------------------------------------------------- run


@pytest.mark.nightly
def test_run_goes_from_cad_to_report(run, tmp_path):
    result = run("run", "sils", "--protocol", SHORT, "--out", "demo")
    assert result.code == 0
    assert "AGREE" in result.out
    assert "stage: demo/usd/sils.usda" in result.out
    written = files_below(tmp_path / "demo")
    assert {"usd/sils.usda", "usd/motion/short.usdc", "short/report.html", "short/report.json"} <= written
    texts = [p.read_bytes() for p in (tmp_path / "demo").rglob("*") if p.is_file()]
    assert not any(b".twin-" in t for t in texts), "the folder it was made in is nobody's business"


# ----------------------------------------------------------------------------------------------------- doctor


def test_doctor(run):
    text = run("doctor")
    assert text.code == 0
    assert re.search(r"casadi +\d+\.\d+[\d.]* +needed", text.out)
    assert f"data in {ROOT}" in text.out
    data = run("doctor", "--json").json
    assert data["missing"] == []
    assert data["found"]["pin"]


def test_doctor_names_what_is_missing(run, monkeypatch):
    installed = doctor._installed
    monkeypatch.setattr(doctor, "_installed", lambda n: None if n == "toppra" else installed(n))
    text = run("doctor")
    assert text.code == 2
    assert re.search(r"toppra +MISSING +needed", text.out)
    assert "missing: toppra. Reinstall twin" in text.out
    assert "NOT READY: 1 required package is missing" in text.out
    assert run("doctor", "--json").json["missing"] == ["toppra"]


def test_the_verdict_of_doctor_depends_on_states_alone():
    assert doctor._verdict([], [], [], "untested") == "  READY: everything is there"
    assert doctor._verdict([], ["cbor2"], [8080], "software") == (
        "  READY: all required packages are there; "
        "1 optional packages are absent (pip install 'twin-robotics[all]'); "
        "pages are drawn slowly or not at all: see WebGL 2; port 8080 is taken (choose another with --port)"
    )


# ------------------------------------------------------------------------------------------------ wrong usage

WRONG = {
    "misspelt command": (["valdate", "sils"], "there is no command 'valdate'. Did you mean 'validate'?"),
    "no robot": (["validate"], "required: robot"),
    "misspelt robot": (["info", "silss"], "there is no robot 'silss'. Did you mean 'sils'?"),
    "misspelt protocol": (["validate", "sils", "--protocol", "tabel2"], "Did you mean 'table2'?"),
    "misspelt protocol of run": (["run", "sils", "--protocol", "tabel2"], "Did you mean 'table2'?"),
    "misspelt protocol of build": (["build", "sils", "--out", "o", "--protocol", "tabel2"], "Did you mean 'table2'?"),
    "misspelt protocol of plan": (["plan", "sils", "tabel2"], "Did you mean 'table2'?"),
    "no such protocol file": (["plan", "sils", "gone/x.toml"], "gone/x.toml: the file does not exist"),
    "two ways to choose": (["validate", "sils", "--protocol", "table2", "--all-protocols"], "not allowed with"),
    "misspelt equation": (["validate", "sils", "--variant", "eq11=printed"], "there is no equation 'eq11'. Did you"),
    "misspelt variant": (["validate", "sils", "--variant", "eq1=printd"], "there is no variant 'printd'. Did you mean"),
    "misspelt bare variant": (["validate", "sils", "--variant", "litteral"], "Did you mean 'literal'?"),
    "bare and pair": (
        ["validate", "sils", "--variant", "printed", "--variant", "eq1=printed"],
        "alone, or only EQ=NAME",
    ),
    "equation twice": (["validate", "sils", "--variant", "eq1=printed", "--variant", "eq1=corrected"], "given twice"),
    "tolerance is text": (["validate", "sils", "--tolerance-um", "wide"], "invalid float value: 'wide'"),
    "tolerance is zero": (["validate", "sils", "--tolerance-um", "0"], "give a positive number of micrometres"),
    "tolerance is negative": (["validate", "sils", "--tolerance-um", "-3"], "--tolerance-um -3: give a positive"),
    "tolerance is NaN": (["validate", "sils", "--tolerance-um", "nan"], "give a positive number of micrometres"),
    "tolerance is infinite": (["validate", "sils", "--tolerance-um", "inf"], "give a positive number of micrometres"),
    "clearance without obstacles": (["plan", "sils", "--clearance-mm", "7"], "7 has no effect without --avoid"),
    "seed without a search": (["plan", "sils", "--seed", "7"], "--seed 7 has no effect without --avoid"),
    "time that never passes": (["machine", "raven_left", "--duration", "nan"], "--duration nan: give a number of"),
    "tilt without end": (["machine", "raven_left", "--tilt-deg", "inf"], "--tilt-deg inf: give a finite number"),
    "fewer sessions than none": (["hazards", "raven_left", "--sessions", "-1"], "--sessions: -1 is too small"),
    "no process": (["hazards", "raven_left", "--processes", "0"], "--processes: 0 is too small"),
    "too many robots": (["tolerance", "sils", "--samples", "100000000000"], "give at most 10000000"),
    "no such stage": (["info", "gone.usda"], "gone.usda: the stage does not exist"),
    "stage has no protocols": (["validate", str(ROOT / "usd/sils/sils.usda")], "neither equations nor protocols"),
}


def test_no_command_says_what_to_do_next(run):
    text = run()
    assert text.code == 2  # nothing was done
    assert "twin run sils" in text.out
    assert "twin --help" in text.out
    assert run("--json").json["verdict"] == "unchecked"


@pytest.mark.parametrize("name", [n.upper() for n in [*assets.names(), *scenes.names()]])
def test_a_name_in_another_case_is_guessed(run, name):
    assert f"Did you mean '{name.lower()}'?" in run("info", name).err


@pytest.mark.parametrize("command", ["view", "serve"])
@pytest.mark.parametrize("port", ["99999", "65536", "-1", "http", "1e3"])
def test_a_port_that_is_none_is_refused(run, command, port):
    text = run(command, "sils", "--port", port)
    assert text.code == 2
    assert f"{port} is not a port: give 0 to 65535" in text.err


@pytest.mark.parametrize(
    "argv", [("view", "sils", "--html"), ("serve", "sils", "--record"), ("serve", "davinci", "--session")]
)
def test_a_folder_in_place_of_a_recording_is_refused_at_once(run, tmp_path, argv):
    text = run(*argv, str(tmp_path), *(() if "--html" in argv else ("--port", "0")))
    assert text.code == 2
    assert f"cannot write to {tmp_path}: it is a folder; give the name of a file" in text.err


# ----------------------------------------------------------------------------------------------------- scenes


@pytest.mark.parametrize("name", scenes.names())
def test_scenes_are_listed_and_shown(run, name):
    data = run("list", "--json").json
    listed = {r["name"]: r for r in (*data["robots"], *data["scenes"])}
    assert listed[name]["kind"] == "scene"
    assert set(listed[name]["robots"]) <= {n for n, r in listed.items() if r["kind"] == "robot"}
    assert name in run("list").out
    data = run("info", name, "--json").json
    assert [r["robot"] for r in data["robots"]] == listed[name]["robots"]
    text = run("info", name)
    assert text.code == 0
    assert all(part in text.out for part in (data["title"], *listed[name]["robots"], *data["commands"]))


@pytest.mark.parametrize("name", scenes.names())
@pytest.mark.parametrize("command", ["validate", "plan", "build", "explain", "workspace", "selftest"])
def test_a_command_for_one_robot_says_what_works_with_a_scene(run, name, command):
    text = run(command, name)
    assert text.code == 2
    assert f"'{name}' is a scene" in text.err
    assert all(c in text.err for c in run("info", name, "--json").json["commands"])


@pytest.mark.parametrize("case", WRONG)
def test_wrong_usage(run, case, tmp_path):
    argv, message = WRONG[case]
    text = run(*argv)
    assert text.code == 2
    assert text.out == ""
    assert message in text.err
    assert "Traceback" not in text.err
    if argv:
        data = run(*argv, "--json")
        assert data.code == 2
        assert data.json["verdict"] == "unchecked"
        assert message in data.json["message"]
        assert data.json["residuals"] == []
        assert data.json["findings"][0]["severity"] == "error"
        assert data.json["findings"][0]["code"].startswith("error.")
    assert files_below(tmp_path) == set()


def test_debug_prints_the_traceback(run):
    text = run("info", "silss", "--debug")
    assert text.code == 2
    assert "Traceback" in text.err
    assert "no robot 'silss'" in text.err


def test_unforeseen_error_is_not_taken_for_a_disagreement(run, monkeypatch):
    def fail(args):
        raise ZeroDivisionError("oh")

    monkeypatch.setattr("twin.cli.commands.list.run", fail)
    text = run("list")
    assert text.code == 2
    assert text.err == "twin: internal error, ZeroDivisionError: oh. Please report it with the output of --debug.\n"
    assert run("list", "--json").json["error"] == "ZeroDivisionError"
    text = run("list", "--debug")
    assert text.code == 2, "not 1, which means that a check disagrees"
    assert "ZeroDivisionError: oh\n" in text.err
    assert "Traceback" in text.err


def test_interrupt(run, monkeypatch):
    def fail(args):
        raise KeyboardInterrupt

    monkeypatch.setattr("twin.cli.commands.list.run", fail)
    text = run("list")
    assert (text.code, text.err) == (130, "twin: interrupted: nothing was written\n")


def test_interrupt_before_the_command_line_is_imported():
    code = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "twin.cli.parser":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from twin.cli import main
sys.exit(main(["list"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "twin: interrupted\n")


def test_interrupt_says_how_to_go_on(run, monkeypatch):
    def fail(args):
        raise KeyboardInterrupt("3 sessions are kept")

    monkeypatch.setattr("twin.cli.commands.list.run", fail)
    assert run("list").err == "twin: interrupted: 3 sessions are kept\n"


@pytest.mark.slow
def test_interrupt_waits_for_an_import(tmp_path, monkeypatch):
    """A native module that is loaded cannot be interrupted: it crashes, or swallows the interrupt."""
    (tmp_path / "interrupted_module.py").write_text(
        "import signal\ntry:\n    signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n    swallowed = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def interrupted():
        import_module("interrupted_module")
        time.sleep(5)

    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # ignored if a shell started this in the background
    try:
        with pytest.raises(KeyboardInterrupt), after_imports():
            interrupted()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert not hasattr(sys.modules.pop("interrupted_module"), "swallowed")


@pytest.mark.slow
def test_interrupt_is_not_lost_in_casadi():
    """CasADi asks an argument for its shape, and ignores what is raised there."""
    import casadi as ca

    class Argument:
        @property
        def shape(self):
            signal.raise_signal(signal.SIGINT)
            return (1, 1)

    def interrupted():
        with contextlib.suppress(Exception):
            ca.SX.sym("x") * Argument()
        time.sleep(5)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), after_imports():
            interrupted()
    finally:
        signal.signal(signal.SIGINT, before)


def test_interrupt_while_arguments_are_parsed(run, monkeypatch):
    def fail(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(Command, "parse_known_args", fail)
    text = run("list")
    assert (text.code, text.err) == (130, "twin: interrupted: nothing was written\n")


def test_interrupt_names_the_folders_that_are_complete(run, tmp_path, monkeypatch):
    def half(args):
        for name in ("one", "two"):
            with assets.atomic_folder(tmp_path / name) as work:
                (work / "file").write_text(name)
                if name == "two":
                    raise KeyboardInterrupt

    monkeypatch.setattr("twin.cli.commands.list.run", half)
    text = run("list")
    assert (text.code, text.err) == (130, f"twin: interrupted: complete files are in {tmp_path / 'one'}\n")
    assert files_below(tmp_path) == {"one", "one/file"}


# ----------------------------------------------------------------------------------------- terminals and pipes


TABLE = "# convention: standard\njoint,theta,d [mm],a [mm],alpha [deg]\nq1,q1,10,0,90\nq2,q2,20,30,0\n"


@pytest.mark.slow
@pytest.mark.parametrize("argv", [("list",), ("compare", "a.csv", "b.csv", "--quiet")], ids=lambda argv: argv[0])
def test_reader_of_a_pipe_may_leave(argv, tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(TABLE, encoding="utf-8")
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "twin", *argv]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    os.close(writer)
    assert (done.returncode, done.stderr) == (2, "")


def test_terminal_without_our_signs(run, monkeypatch):
    plain = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", plain)
    assert main(["plan", "sils", str(SHORT)]) == 0
    plain.seek(0)
    assert "sils ? short ?" in plain.read()


def test_numbers_that_json_has_no_word_for():
    text = show.as_json({"a": [float("nan"), 1.5], "b": (float("inf"), {"c": -float("inf")}), "d": None})
    assert json.loads(text) == {"a": [None, 1.5], "b": [None, {"c": None}], "d": None}


class _Screen(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("screen", "quiet", "shown"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_progress_is_shown_on_a_terminal_only(monkeypatch, screen, quiet, shown):
    stream = _Screen() if screen else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with show.progress(quiet) as progress:
        progress("reading something", 0.0)
        progress("reading something", 0.5)
    assert ("reading something" in stream.getvalue()) is shown


@pytest.mark.slow
@pytest.mark.parametrize("as_json", [False, True])
def test_progress_goes_to_the_terminal_and_never_into_the_output(as_json):
    leader, follower = pty.openpty()
    argv = [sys.executable, "-m", "twin", "info", "sils", *(["--json"] if as_json else [])]
    seen = bytearray()

    def watch() -> None:  # meanwhile: a terminal that nobody reads is full after some seconds, and writing to it waits
        with contextlib.suppress(OSError):  # end of a pseudo-terminal
            while chunk := os.read(leader, 4096):
                seen.extend(chunk)

    watcher = threading.Thread(target=watch)
    watcher.start()
    done = subprocess.run(argv, stdout=subprocess.PIPE, stderr=follower, env=os.environ | {"TERM": "xterm"})
    os.close(follower)
    watcher.join()
    os.close(leader)
    assert done.returncode == 0
    assert (b"read CAD" in seen) is not as_json
    assert b"read CAD" not in done.stdout
    assert b"\x1b" not in done.stdout
    if as_json:
        json.loads(done.stdout)


def test_an_example_is_copied_and_no_work_overwritten(run, tmp_path):
    target = tmp_path / "mine"
    made = json.loads(run("new", str(target), "--example", "hexapod", "--json").out)
    files = {str(target / name) for name in ("cad/hexapod.toml", "cad/hexapod.step", "formula.py")}
    assert files < set(made["files"]) == {str(p) for p in target.rglob("*") if p.is_file()}
    assert not list(target.rglob("model.py"))
    (target / "formula.py").write_text("# mine\n", encoding="utf-8")
    again = run("new", str(target), "--example", "hexapod")
    assert again.code == 2
    assert "the folder is not empty" in again.err
    assert (target / "formula.py").read_text(encoding="utf-8") == "# mine\n"
    both = run("new", "mine", "arm.urdf", "--example", "hexapod")
    assert both.code == 2
    assert "--example copies a robot and reads no file" in both.err


def test_a_notice_says_whose_python_is_run(run, tmp_path, caplog):
    """Equations of a robot folder are code; a stage is not."""
    from twin import robots

    folder = tmp_path / "own"
    shutil.copytree(
        ROOT / "docs/examples/hexapod", folder, ignore=shutil.ignore_patterns("usd", "__pycache__", "*parts.py")
    )
    robots._logged_paths.clear()
    assert run("info", folder).code == 0
    assert [r.message for r in caplog.records] == [f"running the Python code in {folder / 'formula.py'}"]
    caplog.clear()
    assert run("info", folder, "--quiet").code == 0
    assert run("info", "sils").code == 0
    assert not caplog.records


@pytest.mark.slow
@pytest.mark.parametrize("name", ["äöü 日本", os.fsdecode(b"\xff\xfe")], ids=["text", "bytes"])
def test_names_of_files_that_the_locale_does_not_know(tmp_path, name):
    """LC_ALL=C is not a reason to fail; bytes that are no text are, in one line."""
    env = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    (tmp_path / name).mkdir()
    command = [Path(sys.executable).with_name("twin"), "audit", os.fsencode(tmp_path / name / "robot.usda")]
    (tmp_path / name / "robot.usda").write_text("#usda 1.0\n")
    done = subprocess.run(command, capture_output=True, text=True, env=env)
    assert done.returncode in (1, 2), done.stderr
    assert "internal error" not in done.stderr
    assert "Traceback" not in done.stderr


def test_off_a_terminal_a_long_command_says_how_far_it_is(monkeypatch, capsys):
    """A line each 15 s, from the first: no line for what is quick, or if --quiet is given."""
    now = [100.0]
    monkeypatch.setattr(show.time, "monotonic", lambda: now[0])
    with show.progress(False) as progress:
        for label, fraction in (
            ("plan", 0.5),
            ("plan", 1.0),
            ("control of 5 models", 0.1),
            ("control of 5 models", 0.3),
        ):
            progress(label, fraction)
            now[0] += 8.0
        progress("write", 0.0)
    assert capsys.readouterr().err.splitlines() == ["control of 5 models: 10 %, 16 s so far", "write: 32 s so far"]
    with show.progress(True) as progress:
        now[0] += 100.0
        progress("plan", 0.5)
    assert capsys.readouterr() == ("", "")
