"""A robot of one's own with one defect each: what is wrong, where, and the way out; nothing half-written."""

from __future__ import annotations

import errno
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from made import own_robot
from twin.cli import main
from twin.core.errors import TwinError

ROOT = Path(__file__).parents[2]


@dataclass
class Robot:
    """A robot folder, and how to spoil it."""

    folder: Path

    @property
    def description(self) -> Path:
        return self.folder / "cad/sils.toml"

    @property
    def step(self) -> Path:
        return self.folder / "cad/sils.step"

    @property
    def protocol(self) -> Path:
        return self.folder / "trajectories/short.toml"

    @property
    def formula(self) -> Path:
        return self.folder / "formula.py"

    def change(self, path: Path, old: str, new: str) -> int:
        """Replace the first occurrence; return the line it stood in."""
        text = path.read_text(encoding="utf-8")
        assert old in text, f"{path} does not hold {old!r}"
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return text[: text.index(old)].count("\n") + 1


@pytest.fixture
def robot(tmp_path) -> Robot:
    return Robot(own_robot.folder(tmp_path))


@pytest.fixture
def refused(robot, capsys, tmp_path):
    """Run a command on the robot; it must end with 2, one message, and nothing written. Return the message."""

    def call(command: str = "validate", *argv: str) -> str:
        before = everything(tmp_path)
        code = main([command, str(robot.folder), "--json", "--out", str(tmp_path / "out"), *argv])
        got = capsys.readouterr()
        data = json.loads(got.out)
        assert code == 2
        assert data["verdict"] == "unchecked"
        assert data["message"] in got.err
        assert "internal error" not in data["message"]
        assert "Traceback" not in got.err
        assert everything(tmp_path) == before, "something was left behind"
        return data["message"]

    return call


def everything(folder: Path) -> set[str]:
    """Return all paths in a folder, except compiled Python and the folder of the register of unfinished folders."""
    return {str(p) for p in folder.rglob("*") if "__pycache__" not in p.parts and p.name != "unfinished"}


# ------------------------------------------------------------------------------------------------------ STEP


def test_step_is_missing(robot, refused):
    robot.step.unlink()
    message = refused()
    assert str(robot.step) in message
    assert "No such file" in message


@pytest.mark.parametrize("content", [b"solid cube\nfacet normal 0 0 1\n", bytes(range(256)) * 40])
def test_step_is_garbage(robot, refused, content):
    robot.step.write_bytes(content)
    message = refused()
    assert f"{robot.step} is not a STEP file: it does not begin with ISO-10303-21" in message


def test_step_is_empty(robot, refused):
    robot.step.write_bytes(b"")
    assert f"{robot.step} is empty: export or copy the STEP file again" in refused()


@pytest.mark.parametrize("kept", [0.01, 0.5, 0.999])
def test_step_is_truncated(robot, refused, kept):
    data = robot.step.read_bytes()
    robot.step.write_bytes(data[: int(len(data) * kept)])
    message = refused("build")
    assert f"{robot.step} is truncated: END-ISO-10303-21 is missing. Export or copy it again." in message


def test_step_lost_its_middle(robot, refused, monkeypatch, tmp_path):
    """Begin and end are there; the geometry in between is not."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "cache/twin/step").mkdir(parents=True)
    text = robot.step.read_text()
    head, end = text[: text.index("DATA;")], "DATA;\nENDSEC;\nEND-ISO-10303-21;\n"
    robot.step.write_text(head + end)
    assert "states no length unit" in refused()


def test_step_is_a_folder(robot, refused):
    robot.step.unlink()
    robot.step.mkdir()
    assert "Is a directory" in refused()


def test_step_of_another_robot(robot, refused):
    shutil.copy(ROOT / "tests/data/cad/crank.step", robot.step)
    message = refused()
    assert str(robot.step) in message
    assert re.search(r"body '\w+': there is no node '\w+'.*Known: ", message)


# --------------------------------------------------------------------------------------------- description

DESCRIPTION = {
    "unknown key": (
        'tool = "tool"',
        'tool = "tool"\ndefault_protokol = "short"',
        "default_protokol: unknown key; did you mean default_protocol?",
    ),
    "text for a number": ("gross_mm = 2.0", 'gross_mm = "2.0"', 'gross_mm = "2.0": a number is expected, not text'),
    "number for text": ('base = "frame"', "base = 7", "base = 7: text in quotes is expected, not a number"),
    "NaN": ("near_mm = [0, 0, -30]", "near_mm = [nan, 0, -30]", "must be a finite number"),
    "infinite": ("meeting_um = 1.0", "meeting_um = inf", "must be a finite number"),
    "missing unit": (
        "limits_mm = [20.0, 580.0]",
        "limits = [20.0, 580.0]",
        "the unit is missing: write limits_deg or limits_mm",
    ),
    "other unit": ("limits_mm = [20.0, 580.0]", "limits_deg = [20.0, 580.0]", "is prismatic; write limits_mm"),
    "swapped limits": ("limits_mm = [20.0, 580.0]", "limits_mm = [580.0, 20.0]", "limits are swapped: write [20, 580]"),
    "zero tolerance": ("gross_mm = 2.0", "gross_mm = 0.0", "gross_mm = 0.0: out of range"),
    "joint to an unknown body": (
        'child = "limb1"',
        'child = "limb11"',
        "there is no body 'limb11'. Did you mean 'limb1'?",
    ),
    "joint on an unknown face": (
        'origin = "rail1", at',
        'origin = "rial1", at',
        "there is no feature 'rial1'. Did you mean 'rail1'?",
    ),
    "unknown joint type": ('type = "spherical"', 'type = "ball"', 'type = "ball": not known'),
    "no provenance": ('provenance = "ASSUMED"\n', "", "provenance: this key is missing"),
    "not TOML": ('base = "frame"', "base = frame", "not valid TOML"),
    "other name": ('name = "sils"', 'name = "slis"', "'slis' must be equal to the file name 'sils'"),
}


@pytest.mark.parametrize("case", DESCRIPTION)
def test_description(robot, refused, case):
    old, new, wanted = DESCRIPTION[case]
    robot.change(robot.description, old, new)
    message = refused()
    assert wanted in message
    assert re.search(rf"{re.escape(str(robot.description))}:\d+: ", message), "file and line are named"


def test_description_names_the_line(robot, refused):
    line = robot.change(robot.description, "meeting_um = 1.0", 'meeting_um = "one"')
    assert f"{robot.description}:{line}: tolerance.meeting_um" in refused()


def test_all_mistakes_are_told_at_once(robot, refused):
    robot.change(robot.description, "gross_mm = 2.0", "gross_mm = -2.0")
    robot.change(robot.description, 'base = "frame"', "base = 7")
    assert len(refused().splitlines()) == 2


def test_face_is_not_there(robot, refused):
    """The drawing has no such cylinder within the gross tolerance: which body, which face, how far, what is near."""
    robot.change(robot.description, "radius_mm = 7.02, near_mm = [0, 0, -30]", "radius_mm = 9.5, near_mm = [0, 0, -30]")
    message = refused()
    assert "frame" in message
    assert "rail1" in message
    assert "9.5" in message
    robot.change(
        robot.description, "radius_mm = 9.5, near_mm = [0, 0, -30]", "radius_mm = 7.02, near_mm = [40, 0, -30]"
    )
    message = refused()
    assert "rail1" in message
    assert re.search(r"\d mm", message)


def test_description_is_missing(robot, refused):
    robot.description.unlink()
    assert "expected one robot description" in refused()


def test_description_is_not_text(robot, refused):
    robot.description.write_bytes(b'name = "\xff\xfe"')
    assert "not UTF-8 text at byte 8" in refused()


def test_default_protocol_is_not_there(robot, refused):
    robot.change(robot.description, 'default_protocol = "short"', 'default_protocol = "shorter"')
    assert "there is no protocol 'shorter'. Did you mean 'short'? Known: short." in refused()


def test_no_protocols_at_all(robot, refused):
    shutil.rmtree(robot.folder / "trajectories")
    assert "there is no protocol in" in refused("validate", "--all-protocols")


# ------------------------------------------------------------------------------------------------- protocol

PROTOCOL = {
    "unknown key": ('start = "c"', 'start = "c"\nspeed = 3', "speed: unknown key"),
    "text for a number": ("rcm_mm = 0.1", 'rcm_mm = "0.1"', "a number is expected, not text"),
    "NaN": ("tip_speed_mm_s = 25", "tip_speed_mm_s = nan", "must be a finite number"),
    "missing unit": ("tip_speed_mm_s = 25", "tip_speed = 25", "the unit is missing: write tip_speed_mm_s"),
    "unknown waypoint": ('to = "near"', 'to = "near_by"', "there is no waypoint 'near_by'. Did you mean 'near'?"),
    "zero-length phase": (
        'to = "near"',
        'to = "c"',
        "the phase has no length: it already begins at 'c'; remove the phase",
    ),
    "other robot": ('robot = "sils"', 'robot = "slis"', "written for 'slis', not for 'sils'"),
    "other name": ('name = "short"', 'name = "brief"', "'brief' must be the file's name, 'short'"),
}


@pytest.mark.parametrize("command", ["validate", "plan", "run"])
@pytest.mark.parametrize("case", PROTOCOL)
def test_protocol(robot, refused, case, command):
    old, new, wanted = PROTOCOL[case]
    robot.change(robot.protocol, old, new)
    message = refused(command)
    assert wanted in message
    assert re.search(rf"{re.escape(str(robot.protocol))}:\d+: ", message), "file and line are named"


def test_protocol_of_no_length_in_space(robot, refused):
    """Another name for the same pose: only planning can see it."""
    robot.change(robot.protocol, "position_mm = [407.9, 306, 210.4]", "position_mm = [407.9, 306, 211.4]")
    message = refused("plan")
    assert "phase 'lower'" in message
    assert "length" in message


def test_protocol_moves_a_frame_that_is_not_there(robot, refused):
    robot.change(robot.protocol, 'frame = "tool"', 'frame = "tol"')
    assert "there is no frame 'tol'. Did you mean 'tool'?" in refused("plan")


def test_protocol_moves_a_frame_of_another_body(robot, refused):
    robot.change(robot.protocol, 'frame = "tool"', 'frame = "base"')
    assert "frame 'base' is on body 'frame', the tool is on 'platform': it moves relative" in refused("plan")


@pytest.mark.parametrize("command", ["plan", "validate"])
def test_pose_out_of_reach(robot, refused, command):
    """Which phase, by how much, from where on, and what would be reachable."""
    robot.change(robot.protocol, "position_mm = [407.9, 306, 210.4]", "position_mm = [2407.9, 306, 211.4]")
    message = refused(command)
    assert message.startswith("short: phase 'lower' (positioning) cannot be carried out: ")
    assert re.search(r"(limb \d is too short|joint q\d would go) (by )?[\d.]+ mm", message)
    assert re.search(r"from [\d.]+ % of the phase on", message)
    assert re.search(r"with tool at \([\d., ]+\) mm\.", message)
    assert re.search(r"Reachable: up to the position \([\d., ]+\) mm with the angles \([\d., ]+\) deg\.", message)


def test_start_out_of_reach(robot, refused):
    robot.change(robot.protocol, "position_mm = [407.9, 306, 211.4]", "position_mm = [1407.9, 306, 211.4]")
    assert "already at the start of the phase" in refused("plan")


def test_limit_is_broken(robot, refused):
    both = "limits_mm = [{0}, 580.0]\nsoft_limits_mm = [{0}, 580.0]"
    robot.change(robot.description, both.format("20.0"), both.format("320.0"))
    message = refused("plan")
    assert re.search(
        r"joint q1 would go [\d.]+ mm below its lower limit of 320\.00 mm, already at the start of the phase", message
    )


# --------------------------------------------------------------------------------------------------- formula


def test_formula_is_missing(robot, refused):
    robot.formula.unlink()
    assert "robot 'sils' has no equations: formula.py is missing" in refused()


def test_formula_has_a_syntax_error(robot, refused):
    line = robot.change(robot.formula, "FORMULA = Formula(", "FORMULA = = Formula(")
    assert f"{robot.formula}:{line}: SyntaxError: invalid syntax" in refused()


def test_formula_raises(robot, refused):
    line = robot.change(robot.formula, "FORMULA = Formula(", "1 / 0\nFORMULA = Formula(")
    assert f"{robot.formula}:{line}: ZeroDivisionError: division by zero" in refused()


def test_formula_imports_what_is_not_there(robot, refused):
    robot.change(
        robot.formula,
        "from twin.core.units import DEG, MM",
        "from twin.core.units import DEG, MM\nimport no_such_module",
    )
    assert re.search(rf"{re.escape(str(robot.formula))}:\d+: ModuleNotFoundError: .*no_such_module", refused())


def test_formula_is_not_defined(robot, refused):
    robot.change(robot.formula, "FORMULA = Formula(", "FORMEL = Formula(")
    assert f"{robot.formula}: it defines no FORMULA and no plain functions" in refused()


def test_formula_is_something_else(robot, refused):
    robot.formula.write_text("FORMULA = 3\n")
    message = refused()
    assert str(robot.formula) in message
    assert "FORMULA" in message


def test_formula_has_a_nan_parameter(robot, refused):
    text = robot.formula.read_text(encoding="utf-8")
    robot.formula.write_text(
        text + "\nfrom dataclasses import replace\n"
        'FORMULA = replace(FORMULA, parameters=(replace(FORMULA.parameters[0], value=float("nan")), '
        "*FORMULA.parameters[1:]))\n"
    )
    message = refused()
    name = re.search(r"parameter '(\w+)' is nan; the value must be a finite number in SI units", message)
    assert name
    assert str(robot.formula) in message


def test_formula_drives_joints_that_the_drawing_lacks(robot, refused):
    text = robot.description.read_text(encoding="utf-8")
    robot.description.write_text(re.sub(r"\bq6\b", "q7", text).replace("q6_mm", "q7_mm"), encoding="utf-8")
    message = refused("plan")
    assert "q1, q2, q3, q4, q5, q7 in the description, but q1, q2, q3, q4, q5, q6 in the equations" in message
    assert "use the same names in the same order" in message


# ---------------------------------------------------------------------------------- a loop that cannot close


@pytest.fixture
def no_pictures(monkeypatch):
    from twin.ui.report import report_folder

    def write(report, folder, **_):
        (folder / "report.json").write_text(report.to_json())

    monkeypatch.setattr(report_folder, "write_report", write)


@pytest.fixture
def judged(robot, capsys, tmp_path):
    """Run `validate --json`; return exit code and report."""

    def call(*argv: str) -> tuple[int, dict]:
        code = main(["validate", str(robot.folder), "--json", "--out", str(tmp_path / "out"), *argv])
        return code, json.loads(capsys.readouterr().out)

    return call


@pytest.mark.nightly
def test_loop_that_cannot_close(robot, judged, no_pictures):
    """The equations believe in longer bars and plan where the drawn mechanism cannot go: a finding, not an error."""
    text = robot.formula.read_text(encoding="utf-8")
    robot.formula.write_text(
        text
        + "\nfrom dataclasses import replace\n"
        + "FORMULA = replace(FORMULA, parameters=tuple(replace(p, value=3 * p.value) if p.name == 'l_2' else p "
        + "for p in FORMULA.parameters))\n"
    )
    robot.change(robot.protocol, "position_mm = [407.9, 306, 211.4]", "position_mm = [900, 306, 211.4]")
    robot.change(robot.protocol, "position_mm = [407.9, 306, 210.4]", "position_mm = [900, 306, 212.4]")
    robot.description.write_text(
        re.sub(r"limits_mm = \[.*?\]", "limits_mm = [-5000.0, 5000.0]", robot.description.read_text())
    )
    code, report = judged()
    assert (code, report["verdict"]) == (1, "disagree")
    found = next(f for f in report["findings"] if f["code"] == "mechanism.no_assembly")
    assert found["where"] == "sils"
    assert re.search(r"it moves \d+ % of the way, then loops do not close", found["message"])
    assert found["suggestion"]


# ----------------------------------------------------------------------------------------- where it is written


@pytest.mark.parametrize("command", ["plan", "build"])
@pytest.mark.parametrize("place", ["a file in the way", "a path below a file"])
def test_output_cannot_be_there(robot, capsys, tmp_path, command, place):
    blocked = tmp_path / "file"
    blocked.write_text("precious")
    out = blocked if place == "a file in the way" else blocked / "deep/below"
    before = everything(tmp_path)
    argv = [command, str(robot.folder), "--out", str(out), *(["--protocol", "short"] if command == "build" else [])]
    assert main(argv) == 2
    message = capsys.readouterr().err
    assert f"cannot write to {out}" in message
    assert "Choose another folder with --out." in message
    assert blocked.read_text() == "precious"
    assert everything(tmp_path) == before


@pytest.mark.parametrize("command", ["validate", "run"])
def test_report_cannot_be_there(robot, capsys, tmp_path, monkeypatch, command):
    """It is told before anything is computed."""
    monkeypatch.setattr("twin.api.protocol_plan.plan", lambda *_, **__: pytest.fail("too late"))
    monkeypatch.setattr("twin.api.exports.build", lambda *_, **__: pytest.fail("too late"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out/short").write_text("precious")
    assert main([command, str(robot.folder), "--out", str(tmp_path / "out")]) == 2
    assert f"cannot write to {tmp_path / 'out/short'}" in capsys.readouterr().err
    assert (tmp_path / "out/short").read_text() == "precious"
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["short"]


def test_run_writes_the_stage_with_its_reports_or_not_at_all(robot, capsys, tmp_path, monkeypatch):
    """A new stage beside an old report would be two stories."""

    def build(robot, folder, **_):
        (folder / "motion").mkdir(parents=True)
        (folder / "sils.usda").write_text("new")
        return [folder / "sils.usda"]

    def validate(*_, stage, **__):
        assert stage.read_text() == "new"
        raise TwinError("the report cannot be made")

    (tmp_path / "out/usd").mkdir(parents=True)
    (tmp_path / "out/usd/sils.usda").write_text("old")
    before = everything(tmp_path)
    monkeypatch.setattr("twin.api.exports.build", build)
    monkeypatch.setattr("twin.api.equation_checks.validate", validate)
    monkeypatch.setattr("twin.api.robot.Robot.weighed", lambda self: self)
    assert main(["run", str(robot.folder), "--out", str(tmp_path / "out")]) == 2
    assert "the report cannot be made" in capsys.readouterr().err
    assert everything(tmp_path) == before
    assert (tmp_path / "out/usd/sils.usda").read_text() == "old"


def test_read_only_output(robot, capsys, tmp_path, monkeypatch):
    """As on a read-only disk; permissions do not stop root."""
    real = Path.mkdir

    def mkdir(self, *args, **kwargs):
        if self.is_relative_to(tmp_path / "out"):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))
        real(self, *args, **kwargs)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    assert main(["plan", str(robot.folder), "--out", str(tmp_path / "out")]) == 2
    assert f"cannot write to {tmp_path / 'out'}: Read-only file system" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("argv", "most", "cache"),
    [
        (["plan"], 20_000, {}),
        (["build", "--protocol", "short"], 60_000, {"XDG_CACHE_HOME": "new"}),  # the STEP file is read anew
        pytest.param(["build", "--protocol", "short"], 300_000, {}, marks=pytest.mark.nightly),
        pytest.param(["validate"], 30_000, {}, marks=pytest.mark.nightly),
    ],
    ids=str,
)
def test_full_output(robot, tmp_path, tmp_path_factory, argv, most, cache):
    """A limit on the size of a file fails a write half-way, also those of other libraries, as a full disk does."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "old").write_text("old")
    before = everything(tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "twin", argv[0], str(robot.folder), *argv[1:], "--out", str(out)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
        # Python leaves byte code that it could write in part, and stumbles over it the next time.
        env=os.environ
        | {"TMPDIR": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        | {name: str(tmp_path_factory.mktemp(value)) for name, value in cache.items()},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stdout + done.stderr
    assert "cannot write" in done.stderr
    assert "internal error" not in done.stderr
    assert "Traceback" not in done.stderr
    assert "pxrInternal" not in done.stderr
    assert everything(tmp_path) == before


@pytest.mark.parametrize("command", ["operate sher", "operate raven", "tolerance sils", "selftest sils", "plan sils"])
def test_a_negative_seed_is_refused(command, capsys):
    assert main([*command.split(), "--seed", "-1"]) == 2
    assert "argument --seed: -1 is too small: give a whole number, at least 0" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "least"), [("sessions", 0), ("processes", 1)])
def test_a_campaign_needs_numbers_that_are_possible(option, least, capsys):
    """A slice would take `--sessions -1` for all sessions but the last."""
    assert main(["hazards", "raven_left", f"--{option}", str(least - 1)]) == 2
    assert (
        f"argument --{option}: {least - 1} is too small: give a whole number, at least {least}"
        in capsys.readouterr().err
    )


# --------------------------------------------------------------------------------------- refused by the system


@pytest.mark.parametrize("command", ["info", "study", "audit", "check", "open", "validate", "new x", "compare pa10"])
def test_a_name_that_is_too_long_is_named(command, capsys):
    assert main([*command.split(), "a" * 300 + ".urdf"]) == 2
    said = capsys.readouterr().err
    assert "a" * 100 in said
    assert "File name too long" in said
    assert "internal error" not in said


def test_a_path_that_may_not_be_read_is_named(capsys, monkeypatch):
    def fail(args):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), "/secret/robot")

    monkeypatch.setattr("twin.cli.commands.list.run", fail)
    assert main(["list"]) == 2
    assert capsys.readouterr().err == "twin: /secret/robot: Permission denied\n"


def test_a_working_folder_that_was_removed_is_named(capsys, monkeypatch, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["list"]) == 2
    assert capsys.readouterr().err == "twin: the working folder no longer exists: change to another folder\n"


def test_a_seed_of_many_digits_is_named(capsys):
    assert main(["plan", "sils", "--seed", "1" * 400]) == 2
    assert "has no effect without --avoid" in capsys.readouterr().err


def test_a_lack_of_memory_is_said(capsys, monkeypatch):
    def fail(args):
        raise MemoryError("Unable to allocate 238. TiB")

    monkeypatch.setattr("twin.cli.commands.list.run", fail)
    assert main(["list"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("twin: the memory of this computer does not suffice (Unable to allocate 238. TiB)")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--step-mm=1e-320"], "mm is too small: increase --step-mm, or reduce --count"),
        (["--step-mm=1e-300"], "mm is too small: increase --step-mm, or reduce --count"),
        (["--turns=99999999999999999999", "--tilt-deg=1"], "(--turns): give at most 1000000"),
    ],
)
def test_a_grid_without_end_is_refused(options, said, capsys, tmp_path):
    assert main(["workspace", "sils", *options, "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err


def test_the_score_of_a_renamed_folder_is_where_reports_look_for_it(robot, capsys, monkeypatch, tmp_path):
    def stop(args, *names):
        raise TwinError("/".join(names))

    monkeypatch.setattr("twin.cli.show.folder", stop)
    renamed = robot.folder.rename(tmp_path / "another name")
    assert main(["selftest", str(renamed)]) == 2
    assert capsys.readouterr().err == "twin: sils\n"
