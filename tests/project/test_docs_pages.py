"""Every page of the documentation, followed by a new user in an empty folder, from top to bottom."""

from __future__ import annotations

import re
from functools import cache

import pytest

from made.pages import ACTIVATE, PAGES, ROOT, TUTORIALS, NewUser, all_steps, figures, says, squeezed, steps_of

HEXAPOD = ROOT / "docs/examples/hexapod"

NIGHTLY = {
    "api.md Python": "tests/api/test_mechanism_kinematics.py; twin validate sils --variant eq1=printed",
    "twin audit twin-out/sils/export/ --robot sils": "tests/exchange/test_audit_bundle.py",
    "twin audit twin-out/sils/export/": "tests/exchange/test_audit_bundle.py",
    "twin build my_robot/": "twin build my_hexapod",
    "twin build sils --out stage/": "make usd-check",
    "twin explain davinci_psm --variant printed": "tests/explain/test_explain_joint_offsets.py",
    "twin explain sils --variant eq1=printed": "tests/explain/test_explain_repair_search.py, test_command",
    "twin explain sils --variant eq2=printed": "tests/explain/test_explain_repair_search.py",
    "twin explain sils --variant printed": "tests/explain/test_explain_repair_search.py",
    "twin explain sils": "tests/explain/test_explain_repair_search.py",
    "twin export davinci": "tests/witness/test_scene.py",
    "twin export davinci_ecm": "tests/witness/bundles.py exports every robot",
    "twin export davinci_psm": "tests/witness/bundles.py exports every robot",
    "twin export davinci_psm_si": "tests/witness/bundles.py exports every robot",
    "twin export docs/examples/hexapod --to mjcf": "tests/exchange/test_export_subsets.py",
    "twin export sils": "twin export my_hexapod; tests/witness/bundles.py exports every robot",
    "twin export twin-out/davinci/davinci_psm_psm2": "tests/api/test_multi_robot_plan.py",
    "twin export vsrs": "tests/witness/test_scene.py, another scene",
    "twin follow raven_left --packets 0": "tests/simulation/test_machine_operated.py",
    "twin hazards raven_left --sessions 4": "test_processes_and_a_kill_change_no_outcome, on a short campaign",
    "twin hazards raven_left --trends": "test_the_trends_of_the_paper, in short form",
    "twin info pa10 --inertia": "tests/validation/test_physical_limits.py",
    "twin info raven_left --inertia": "tests/validation/test_physical_limits.py",
    "twin info raven_left --motion": "tests/simulation/test_raven_motion.py",
    "twin machine raven_left --start --duration 3": "tests/simulation/test_machine_process.py",
    "twin machine sils --start --duration 3": "tests/simulation/test_machine_loops.py",
    "twin machine sils --start --ros 9091 --duration 3": "tests/ui/test_ros_machine.py",
    "twin new again --from twin-out/hexapod/export/hexapod.xml": "tests/exchange/test_importing_models.py",
    "twin operate davinci --haptics on": "tests/simulation/test_haptics_world.py",
    "twin operate davinci --task camera": "test_the_command_writes_the_measures_of_another_seed",
    "twin operate davinci --task pegboard": "tests/simulation/test_pegboard.py",
    "twin operate davinci": "tests/simulation/test_session.py",
    "twin operate raven --trials 2": "tests/simulation/test_machine_operated.py",
    "twin operate raven": "tests/simulation/test_machine_operated.py",
    "twin operate raven_dome": "tests/simulation/test_dome_task.py",
    "twin operate sher phantom --clutch printed": "test_the_printed_clutch_fails_with_the_size_of_its_jump",
    "twin operate sher phantom": "test_all_five_holes_are_touched",
    "twin operate vsrs --task cholecystectomy --mistake cut_outside": "tests/simulation/test_procedure.py",
    "twin operate vsrs --task cholecystectomy --seed 1": "tests/simulation/test_procedure.py",
    "twin plan davinci_psm around/withdraw --avoid davinci --with psm2=around/across --clearance-mm 2":
        "test_two_arms_of_a_scene_pass_each_other_and_one_stays_where_its_phases_end",
    "twin plan pa10 --inverse points": "tests/kinematics/test_point_search.py",
    "twin plan raven_left around/dome": "test_the_way_out_of_the_dome_is_free_by_exact_geometry",
    "twin run davinci_ecm":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin run davinci_psm":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin run davinci_psm_si":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin run sher": "tests/robots/test_sher.py, each protocol",
    "twin run sils": "make demo",
    "twin run vsrs": "test_three_robots_work_without_meeting",
    "twin selftest sils --count 10": ".ci/run seeds 59",
    "twin selftest sils --family formula,usd --count 8 --seed 7 --json": ".ci/run seeds 59 of all families",
    "twin serve davinci --haptics on": "tests/ui/test_headset_page_haptics.py",
    "twin serve davinci --packets 9870": "tests/ui/test_headset_page_packets.py",
    "twin serve davinci --ros 9090": "tests/witness/test_ros.py",
    "twin serve davinci --session hands.session": "tests/ui/test_headset_page_camera.py, with a task",
    "twin serve davinci --session p7-1.session --participant 7 --run 1": "tests/simulation/test_haptics_world.py",
    "twin serve davinci --session p7-2.session --participant 7 --run 2": "tests/simulation/test_haptics_world.py",
    "twin serve davinci --task camera": "tests/ui/test_headset_page_camera.py",
    "twin serve davinci --task pegboard": "tests/ui/test_headset_page_task.py",
    "twin serve davinci": "tests/ui/test_headset_page_console.py",
    "twin serve raven": "tests/ui/test_headset_page_machine.py",
    "twin serve raven_dome": "tests/ui/test_headset_page_plan.py, a copy of this scene",
    "twin serve sils --record session.json": "tests/ui/test_headset_server.py",
    "twin serve sils --replay session.json": "tests/ui/test_headset_server.py",
    "twin serve sils": "tests/ui/test_headset_page.py",
    "twin serve twin-out/davinci/davinci_psm_psm2": "tests/api/test_multi_robot_plan.py",
    "twin serve vsrs --protocols": "tests/ui/test_headset_page_scene.py",
    "twin serve vsrs --task cholecystectomy": "tests/ui/test_headset_page_procedure.py",
    "twin serve vsrs": "tests/ui/test_headset_page_by_hand.py",
    "twin session twin-out/davinci/touch-operator/hands.session --out session/": "tests/simulation/test_session.py",
    "twin session twin-out/davinci/touch-operator/hands.session": "tests/simulation/test_session.py",
    "twin session twin-out/vsrs/cholecystectomy-operator/hands.session": "tests/simulation/test_procedure.py",
    "twin sweep sher --vary l4:e_a-e_d=72..75mm --grid 2": "tests/analysis/test_sweeps.py",
    "twin sweep sils --vary l_p=125..145mm --vary l_2=330..450mm --samples 24": "tests/analysis/test_sweeps.py",
    "twin tolerance sher": "tests/analysis/test_sweeps.py",
    "twin tolerance sils --protocol table2": "test_the_requirement_of_a_robot_is_its_own",
    "twin track pa10 circle --inertia cad": "tests/simulation/test_track.py, of a column",
    "twin track pa10 circle": "tests/simulation/test_track.py, of a column",
    "twin track pa10": "tests/simulation/test_track.py, of a column",
    "twin track raven_left reach": "test_every_kind_of_robot_is_tracked_whatever_closes_its_loops",
    "twin validate again": "tests/exchange/test_importing_folder.py",
    "twin validate davinci_psm --all-protocols":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin validate davinci_psm_si --all-protocols":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin validate hibou":
        "test_an_edited_key_of_a_stage_is_found_and_the_report_names_driver_and_judge, with an edited stage",
    "twin validate lapbot --all-protocols":
        "test_toppra_confirms_every_phase_of_every_protocol; tests/cad/test_cad_lapbot_hibou.py",
    "twin validate my_robot/": "twin validate my_hexapod, the same robot",
    "twin validate pa10 --all-protocols":
        "test_toppra_confirms_every_phase_of_every_protocol; tests/kinematics/test_point_search.py",
    "twin validate pa10": "test_validation_compares_the_three_methods_and_counts_failures",
    "twin validate raven_left --all-protocols":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin validate raven_right --all-protocols":
        "test_equations_and_mechanism_agree_over_the_range; test_toppra_confirms_every_phase_of_every_protocol",
    "twin validate sher --all-protocols": "tests/robots/test_sher.py, each protocol",
    "twin validate sher --protocol phantom": "tests/robots/test_sher.py, each protocol",
    "twin validate sher --sweep --compare serial,mimic": "tests/validation/test_stroke.py",
    "twin validate sher --sweep q5 --compare serial,mimic": "tests/validation/test_stroke.py",
    "twin validate sher --variant eq3=printed": "tests/robots/test_sher.py",
    "twin validate sher --variant tilt_inverse=drawn": "tests/robots/test_sher.py, by twin.validate",
    "twin validate sils --all-protocols": "test_all_protocols_of_a_robot_folder",
    "twin validate sils --protocol table2_printed": "twin validate sils --variant eq1=printed",
    "twin validate sils --variant eq2=literal": "twin validate sils --variant eq1=printed; test_command",
    "twin validate sils --variant eq2=printed": "twin validate sils --variant eq1=printed; test_command",
    "twin validate sils": "make demo",
    "twin validate sils_instruments": "tests/robots/test_sils_instruments.py; tests/validation/test_joint_range.py",
    "twin view davinci": "twin serve davinci of the tutorial",
    "twin view docs/examples/hexapod --port 8090": "twin view my_hexapod",
    "twin view hibou --html twin-out/hibou.html": "tests/ui/test_movable_robot.py",
    "twin view sher phantom": "twin view my_hexapod",
    "twin view sils": "twin view my_hexapod",
    "twin view twin-out/davinci/davinci_psm_psm2": "tests/api/test_multi_robot_plan.py",
    "twin workspace sils": "test_workspace_command_writes_what_others_read",
}  # fmt: skip
"""Commands that only the nightly lane runs, and what of them the other lanes run."""


def named(step):
    """Return the name by which `NIGHTLY` has a step: the command, or the page of a program."""
    return f"{step.page} Python" if step.kind == "program" else step.text


def lanes():
    """Return the steps of all pages for `parametrize`; what a page above runs already is nightly, but for tutorials."""
    found = []
    seen: dict[str, str] = {}
    tutorials = {page.name for page in TUTORIALS}
    for step in all_steps():
        twin = step.kind == "command" and step.text.startswith("twin ")
        again = twin and seen.setdefault(step.text, step.page) != step.page
        nightly = (again or named(step) in NIGHTLY) and step.page not in tutorials
        found.append(pytest.param(step, id=str(step), marks=[pytest.mark.nightly] if nightly else []))
    return found


@pytest.fixture(scope="module")
def user_of(tmp_path_factory):
    """The new user who reads a page."""
    return cache(lambda page: NewUser(tmp_path_factory.mktemp("page")))


@pytest.mark.slow
@pytest.mark.parametrize("step", lanes())
def test_step(step, user_of):
    user_of(step.page).take(step)


def test_every_command_of_the_nightly_lane_is_on_a_page():
    assert set(NIGHTLY) <= {named(step) for step in all_steps()}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_twin_is_there_when_a_page_types_it(page):
    typed = [step.text for step in steps_of(page) if step.typed and step.kind == "command"]
    assert not typed or ACTIVATE in typed[: [text.startswith("twin ") for text in typed].index(True)]


def test_the_pages_have_their_steps():
    """A page that is not written as the reader of pages expects would have none, and pass."""
    steps = all_steps()
    assert len([s for s in steps if s.kind == "command"]) >= 130
    assert len([s for s in steps if s.kind == "program"]) >= 4
    assert len([s for s in steps if s.kind == "file"]) >= 1
    assert sum(s.disagrees for s in steps) >= 10
    assert sum(len(figures(claim)) for s in steps for claim in s.claims) >= 15


PAGE = """
The command `twin` is there after `. .venv/bin/activate`.

```console
$ . .venv/bin/activate   # once
$ mkdir made
```

Write the file `made/a.py`:

```python
a = 1
```

```console
$ twin list --quiet
  sils
```

| command | verdict |
|---|---|
| `twin list --quiet` | **agree**: 6 degrees of freedom |
"""


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("", "", None),
        ("$ . .venv/bin/activate   # once\n", "", "twin is not found"),
        ("$ mkdir made\n", "", "No such file"),
        ("$ mkdir made\n", "$ mkdir made; echo a > made/a.py\n", "is there already"),
        ("  sils\n", "  no such robot\n", "no such robot"),
        ("**agree**", "**disagree**", "exit code 0"),
        ("6 degrees", "6.25 degrees", "6.25"),
        ("$ twin list --quiet\n", "$ twin list no\n", "exit code 2"),
        ("$ mkdir made\n", "$ mkdir made; false\n", "false"),
    ],
)  # fmt: skip
def test_a_false_page_fails(old, new, complaint, tmp_path):
    (tmp_path / "page.md").write_text(PAGE.replace(old, new, 1), encoding="utf-8")
    if complaint is None:
        follow(tmp_path)
        assert (tmp_path / "made/a.py").read_text() == "a = 1\n"
        return
    with pytest.raises((AssertionError, OSError), match=complaint):
        follow(tmp_path)


def follow(folder):
    """Follow `page.md` of a folder in this folder."""
    user = NewUser(folder)
    for step in all_steps([folder / "page.md"]):
        user.take(step)


def test_figures_are_compared_to_their_last_digit():
    assert figures("wrong by 3.045 mm, less than 0.5 mm; 17 s at q1.2") == ["3.045 mm"]
    assert says("3.045", "worst 3.0449 mm")
    assert not says("3.045", "worst 3.0456 mm, 13.045 mm")
    assert says("0.42 mm", "0.4178 mm")
    assert says("7.5 mm", "7.45e+03 µm")
    assert not says("7.5 mm", "7.5 µm")


def test_the_page_differs_from_the_example_by_its_mistake_alone():
    written = {
        step.file: step.text for step in steps_of(ROOT / "docs/tutorials/judge-equations.md") if step.kind == "file"
    }
    text = written["my_hexapod/formula.py"]
    assert text.replace("R.T @ b", "R @ b") == (HEXAPOD / "formula.py").read_text(encoding="utf-8")
    body = text[text.index("def on_circle") :].splitlines()
    assert len([line for line in body if line]) <= 15


def test_excerpts_are_those_of_the_files():
    files = (HEXAPOD / "cad/hexapod.toml").read_text() + (HEXAPOD / "trajectories/tour.toml").read_text()
    known = {squeezed(line) for line in files.splitlines()}
    page = (ROOT / "docs/tutorials/judge-equations.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 3
    for line in "\n".join(blocks).splitlines():
        assert squeezed(line) in known
