"""The documentation's commands run, and its links lead somewhere."""

from __future__ import annotations

import fnmatch
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

from made import mechanisms, transmissions, two_trocars
from twin.cli import main
from twin.model.joined import joined
from twin.model.mechanism import WORLD
from twin.reference import ReferenceModel
from twin.usd.write import write_stage

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
STORY = ROOT / "docs/ten-minutes.md"
"""A page whose commands build on one another: tests/test_docs_ten_minutes.py."""

EXIT_1 = (
    "--variant eq1=printed",
    "--variant eq2=printed",
    "--variant eq2=literal",
    "explain sils --variant printed",
    "explain davinci_psm --variant printed",
    "--protocol table2_printed",
    "tilt_inverse=drawn",
    "eq3=printed",
    "study sher",
    "study pa10",
    "study davinci",
    "info pa10 --inertia",
    "--clutch printed",
    "tolerance sher",
    "console davinci --variant paper",
    "console davinci --variant conjugate",
)
"""Commands of which the documentation says that they disagree."""


ELSEWHERE = {
    "twin console davinci --variant paper": "tests/test_console.py",
    "twin console davinci": "tests/test_console.py",
    "twin explain sils --variant eq1=printed": "tests/test_explain_repair.py, test_command",
    "twin export davinci": "tests/witness/test_scene.py",
    "twin export davinci_ecm": "twin export sils; tests/witness/bundles.py exports every robot",
    "twin export davinci_psm": "twin export sils; tests/witness/bundles.py exports every robot",
    "twin export davinci_psm_si": "twin export sils; tests/witness/bundles.py exports every robot",
    "twin follow raven_left --packets 0": "tests/test_machine_operated.py",
    "twin operate davinci --task camera": "test_the_command_writes_the_measures_of_another_seed",
    "twin operate davinci --task pegboard": "tests/test_pegboard.py; test_four_rings_by_the_command at night",
    "twin operate raven --trials 2": "tests/test_machine_operated.py",
    "twin operate raven": "tests/test_machine_operated.py",
    "twin operate raven_dome": "tests/test_dome_task.py",
    "twin operate sher phantom --clutch printed": "test_the_printed_clutch_fails_with_the_size_of_its_jump",
    "twin operate sher phantom": "test_all_five_holes_are_touched",
    "twin plan raven_left trajectories/raven_left/around/dome.toml": "tests/test_planning_bounds.py",
    "twin run davinci_psm": "twin run davinci_ecm; twin validate davinci_psm --all-protocols",
    "twin run davinci_psm_si": "twin run davinci_ecm; twin validate davinci_psm_si --all-protocols",
    "twin run sher": "twin run davinci_ecm; tests/test_sher.py, each protocol",
    "twin run sils": "make demo",
    "twin run vsrs": "test_three_robots_work_without_meeting",
    "twin selftest sils --count 10": ".ci/run seeds 59",
    "twin selftest sils --family formula,usd --count 8 --seed 7 --json": ".ci/run seeds 59 of all families",
    "twin serve davinci --packets 9870": "tests/test_headset_page_packets.py",
    "twin serve davinci --session hands.session": "tests/test_headset_page_camera.py, with a task",
    "twin serve davinci --task camera": "tests/test_headset_page_camera.py",
    "twin serve davinci --task pegboard": "tests/test_headset_page_task.py",
    "twin serve davinci": "tests/test_headset_page_console.py",
    "twin serve raven": "tests/test_headset_page_machine.py",
    "twin serve sils": "tests/test_headset_page.py",
    "twin serve vsrs": "tests/test_headset_page_by_hand.py",
    "twin study davinci": "tests/test_study_groups.py",
    "twin study pa10": "tests/test_study.py",
    "twin study sher": "tests/test_study.py",
    "twin track pa10": "twin track pa10 circle, which is its default protocol",
    "twin validate sher --all-protocols": "tests/test_sher.py, each protocol; twin validate lapbot --all-protocols",
    "twin validate sher --protocol phantom": "tests/test_sher.py, each protocol",
    "twin validate sher --variant tilt_inverse=drawn": "tests/test_sher.py, by twin.validate",
    "twin validate sils --all-protocols": "test_validate_all_protocols_of_sils",
    "twin validate sils --protocol table2_printed": "test_validate_of_the_printed_poses",
    "twin validate sils --variant eq1=printed": "test_validate_of_one_printed_equation, on a short protocol",
    "twin validate sils --variant eq2=printed": "test_bare_variant_judges_each_alone_and_all_together, likewise",
    "twin validate sils": "make demo",
    "twin workspace sils": "test_workspace_command_writes_what_others_read",
}
"""Commands of the documentation that others run, or what each of them does: who."""


NIGHTLY = {
    "twin export vsrs": "twin export sils; tests/witness/test_scene.py, another scene",
    "twin hazards raven_left --sessions 4": "test_processes_and_a_kill_change_no_outcome, on a short campaign",
    "twin hazards raven_left --trends": "test_the_trends_of_the_paper, in short form",
    "twin operate davinci --haptics on": "twin operate davinci; tests/test_haptics_world.py",
    "twin serve raven_dome": "tests/test_headset_page_plan.py, a copy of this scene",
    "twin session twin-out/davinci/touch-operator/hands.session --out session/": "tests/test_session.py",
    "twin sweep sils --vary l_p=125..145mm --vary l_2=330..450mm --samples 24": "twin sweep sher",
    "twin tolerance sils --protocol table2": "test_the_requirement_of_a_robot_is_its_own",
    "twin track pa10 circle --inertia cad": "twin track pa10 circle",
    "twin validate davinci_psm_si --all-protocols": "twin validate davinci_psm --all-protocols, of the same kind",
    "twin validate raven_right --all-protocols": "twin validate raven_left --all-protocols, its mirror image",
    "twin view davinci": "twin view davinci --task camera",
    "twin view raven": "twin view davinci --task camera; tests/test_trainer.py",
    "twin view sher phantom": "twin view sils",
    "twin view vsrs": "twin view vsrs --protocols",
}
"""Commands that only the nightly lane runs, and what of them the other lanes run."""


def commands():
    """Return every `twin ...` command that a page shows, in a console block or in a table."""
    found = set()
    for page in PAGES:
        if page == STORY:
            continue
        text = page.read_text(encoding="utf-8")
        found |= {line[2:].strip() for line in re.findall(r"^\$ twin .*$", text, re.MULTILINE)}
        found |= set(re.findall(r"`(twin [a-z]+ [^`]*)`", text))  # `twin serve` alone is a name, not a command line
    assert {*ELSEWHERE, *NIGHTLY} <= found
    found -= set(ELSEWHERE)
    return sorted(found, key=lambda c: (c.startswith("twin audit"), c))  # an audit reads what an export wrote


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the robot `my_robot/` that the documentation speaks of, made from SILS."""
    place = tmp_path_factory.mktemp("docs")
    own = place / "my_robot"
    (own / "cad").mkdir(parents=True)
    toml = (ROOT / "cad/sils/sils.toml").read_text(encoding="utf-8")
    toml = toml.replace('name = "sils"', 'name = "my_robot"', 1).replace("sils.step", "my_robot.step")
    (own / "cad/my_robot.toml").write_text(toml, encoding="utf-8")
    shutil.copy(ROOT / "cad/sils/sils.step", own / "cad/my_robot.step")
    (own / "trajectories").mkdir()
    for protocol in (ROOT / "trajectories/sils").glob("*.toml"):
        text = protocol.read_text(encoding="utf-8").replace('robot = "sils"', 'robot = "my_robot"', 1)
        (own / "trajectories" / protocol.name).write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "twin/robots/sils.py", own / "formula.py")
    return place


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.nightly] if c in NIGHTLY else []) for c in commands()]
)
def test_command_runs(command, folder, monkeypatch, capsys):
    """In this process: imports and drawings are read once. tests/test_cli.py starts `twin` as a program."""
    arguments = command.split()[1:]
    if command.startswith(("twin view", "twin serve")) and "--html" not in command:
        return serves_until_ctrl_c([sys.executable, "-m", "twin", *arguments], folder)
    if command == "twin build sils":
        arguments += ["--out", str(folder / "usd")]
    monkeypatch.chdir(folder)
    try:
        code = main(arguments)
    except SystemExit as end:  # --help
        code = end.code or 0
    said = capsys.readouterr()
    assert code == (1 if command.endswith(EXIT_1) else 0), said.out[-2000:] + said.err[-2000:]


def serves_until_ctrl_c(arguments, folder):
    """Begin to serve on a free port, fetch its page, end it."""
    arguments += ["--port", "0", "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(arguments, cwd=folder, **pipes) as process:
        line = process.stdout.readline()
        url = re.search(r"http://127[.]0[.]0[.]1:[0-9]+", line)
        assert url, line + process.stdout.read()
        with urllib.request.urlopen(url[0], timeout=60) as page:
            assert b"<html" in page.read()
        time.sleep(4)  # it must have loaded the robot by then
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[0]
    assert process.returncode == 0, said


@pytest.mark.slow
def test_python_examples_run(folder):
    for page in PAGES:
        for block in re.findall(r"```python\n(import twin.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            done = subprocess.run(
                [sys.executable, "-c", block], cwd=folder, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr[-2000:]
            assert "print(" not in block or done.stdout.strip()
            assert 'variants={"eq1": "printed"}' not in block or "s1 by eq1 (printed)" in done.stdout


def test_commands_are_found():
    assert "twin run davinci_ecm" in commands()
    assert len(commands()) > 8


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def named_code(page):
    """Return (name, file) of every link of a page from a name in code to the file that holds it."""
    found = re.findall(r"\[`([\w.]+)`\]\(([^)#]+[.]py)\)", page.read_text(encoding="utf-8"))
    return [(name.rpartition(".")[2], page.parent / file) for name, file in found]


@pytest.mark.parametrize("page", [p for p in PAGES if named_code(p)], ids=lambda p: p.name)
def test_named_code_is_where_the_page_says(page):
    for name, file in named_code(page):
        held = re.search(rf"^\s*(?:def|class) {name}\b|^{name}\b.* = ", file.read_text(encoding="utf-8"), re.MULTILINE)
        assert held or file.stem == name, f"{page.name}: {file.name} holds no {name}"


def test_derivations_name_their_code():
    assert len(named_code(ROOT / "docs/derivations.md")) > 60


class Used:
    """What layers hold: schemas, types and kinds, attributes and relationships, metadata, and values that are words."""

    def __init__(self, files):
        self.schemas, self.properties, self.others = set(), set(), set()
        for file in files:
            layer = Sdf.Layer.FindOrOpen(str(file))
            self.others |= set(layer.pseudoRoot.ListInfoKeys())
            layer.Traverse(Sdf.Path.absoluteRootPath, lambda path, layer=layer: self._add(layer.GetObjectAtPath(path)))

    def _add(self, spec):
        if isinstance(spec, Sdf.PrimSpec):
            applied = spec.GetInfo("apiSchemas").GetAppliedItems() if spec.HasInfo("apiSchemas") else ()
            self.schemas |= {spec.typeName, *(name.partition(":")[0] for name in applied)}
            self.others |= {spec.kind, spec.name, *(f"twin:{key}" for key in spec.customData.get("twin", ()))}
        elif isinstance(spec, Sdf.PropertySpec):
            self.properties.add(spec.name)
            if isinstance(spec, Sdf.AttributeSpec) and isinstance(spec.default, str):
                self.others.add(spec.default)

    def __contains__(self, word):
        return any(fnmatch.filter(names, word) for names in (self.schemas, self.properties, self.others))


@pytest.fixture(scope="module")
def mapped():
    """The words in code of the USD column of docs/usd-mapping.md; `<robot>_sim.usda` and the like are no names."""
    words, column = set(), 0
    for line in (ROOT / "docs/usd-mapping.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        column = cells.index("USD") if "USD" in cells else column if line.startswith("|") else 0
        words |= set(re.findall(r"`([^`]+)`", cells[column])) if column else set()
    return {word for word in words if "<" not in word}


@pytest.fixture(scope="module")
def used():
    """What the committed stages hold."""
    return Used(sorted((ROOT / "usd").rglob("*.usd[ac]")))


def test_stages_hold_what_the_mapping_names(mapped, used, tmp_path):
    slider = mechanisms.slider()  # no committed robot has a cylindrical joint
    base = slider.bodies[0]
    clear = tuple(
        replace(mesh, color_rgba=(0.5, 0.5, 0.5, 0.5)) for mesh in base.meshes
    )  # ... nor glass, nor part of a body
    slider = replace(slider, bodies=(replace(base, meshes=clear, whole=False), *slider.bodies[1:]))
    write_stage(slider, tmp_path, *mechanisms.slider_state(0.0, 0.0))
    hands = two_trocars.mechanism()  # ... nor several trocars
    write_stage(hands, tmp_path / "hands", hands.rest, {j.name: 0.0 for j in hands.joints})
    arm = transmissions.raven()  # ... nor motors apart from its joints
    model = ReferenceModel(arm)
    write_stage(arm, tmp_path / "motors", model.home().link_poses, model.home().q_full)
    afloat = joined({"slider": (slider, np.eye(4))})  # ... nor a floating base, nor the gravity of the moon
    joints = tuple(replace(j, type="free") if j.parent == WORLD else j for j in afloat.joints)
    afloat = replace(afloat, name="afloat", joints=joints, gravity=(0.0, 0.0, -1.62))
    model = ReferenceModel(afloat)
    write_stage(afloat, tmp_path / "afloat", model.home().link_poses, model.home().q_full)
    more = Used(tmp_path.rglob("*.usd[ac]"))
    assert len(mapped) > 100
    assert {word for word in mapped if word not in used and word not in more} == set()


def test_mapping_names_what_the_stages_hold(mapped, used):
    spoken = ("physics:", "drive:", "state:", "physx", "newton:", "mjc:", "twin:", "inputs:", "primvars:")
    held = {name for name in used.properties if name.startswith(spoken)} - {"primvars:normals:indices"}
    held |= used.schemas - {""} | {name for name in used.others if name.startswith("twin:")}
    assert {name for name in held if not any(fnmatch.fnmatch(name, word) for word in mapped)} == set()
