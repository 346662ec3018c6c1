"""One fault, one headline: findings by cause, the way out of each, and the command lines that are printed."""

from __future__ import annotations

import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from twin.cli import show
from twin.cli.fix_search import FixSearch, _words
from twin.cli.parser import parser
from twin.core.findings import SEVERITIES, Finding
from twin.core.units import MM
from twin.validation.cause import SIDES, causes, side_of
from twin.validation.residual_rows import Tolerances
from twin.validation.result import Report, Residual, headline

ROOT = Path(__file__).parents[2]
PROTOCOL = ROOT / "tests/data/short.toml"
EMPTY = Report("x", "", "", "p", "", {}, {}, (), (), (), (), {}, {}, ())
COMMANDS = {"validate": "twin validate x --protocol p", "explain": "twin explain x --seconds 60"}


def off(code, where, size=None, cause="", severity="disagreement", unit="mm", suggestion=""):
    return Finding(code, severity, f"{where} is off", where, "", size, unit, 1e-6, suggestion, cause)


def report(*findings, **more):
    return replace(EMPTY, findings=findings, commands=COMMANDS, **more)


# ------------------------------------------------------------------------------------------------------- grouping


def test_what_one_equation_gets_wrong_is_one_cause():
    found = causes(
        [
            off("point.differs", "s1", 2.0, "eq1"),
            off("point.differs", "s3", 3.0, "eq1"),
            off("points.not_rigid", "s1, s3", 6.0, "eq1"),
            off("driven.differs", "q1", 9.0, "eq1", "info"),
            off("limit.soft", "q4", 1.0, severity="warning"),
        ]
    )
    assert [c.name for c in found] == ["eq1"]
    assert found[0].head.where == "s3", "the largest of the kind that comes first, not the largest of all"
    assert [f.where for f in found[0].also] == ["s1"]
    assert [f.where for f in found[0].follows] == ["s1, s3", "q1"]


def test_equal_sizes_are_told_by_the_first():
    found = causes([off("point.differs", n, 3.0 + k * 1e-13, "eq1") for k, n in enumerate(("s1", "s3"))])
    assert found[0].head.where == "s1"


def test_two_equations_are_two_causes():
    found = causes([off("point.differs", "s1", 3.0, "eq1"), off("driven.differs", "q1", 250.0, "eq2")])
    assert [(c.name, c.head.size) for c in found] == [("eq1", 3.0), ("eq2", 250.0)]


def test_a_cad_that_contradicts_itself_comes_before_what_was_judged_against_it():
    faults = [
        off("point.differs", "s1", 3.0, "eq1"),
        off("cad.meeting", "U1", 0.2),
        off("cad.tilt", "U1", 0.1, unit="deg"),
    ]
    rcm = off("rcm.missed", "RCM", 45.0)
    cad, protocol = causes([rcm, *faults])
    assert (cad.side, cad.head.code, cad.head.where) == ("CAD", "cad.meeting", "U1")
    assert [f.code for f in cad.follows] == ["cad.tilt"]
    assert [f.where for f in cad.perhaps] == ["s1"]
    assert protocol.head is rcm


def test_what_could_not_be_checked_comes_first():
    assert (
        causes([off("cad.meeting", "U1", 0.2), off("branch.changed", "x", severity="error")])[0].head.severity
        == "error"
    )


CODES = ("cad.meeting", "point.differs", "driven.differs", "loop.differs", "stage.content", "baked.times", "rcm.missed")


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.lists(
        st.builds(
            off,
            st.sampled_from(CODES),
            st.sampled_from("abc"),
            st.none() | st.floats(0, 1e3) | st.just(float("nan")),
            st.sampled_from(("", "eq1", "eq2")),
            st.sampled_from(SEVERITIES),
            st.sampled_from(("mm", "deg")),
        ),
        max_size=12,
    )
)
def test_every_fault_is_told_once(findings):
    told = [id(f) for c in causes(findings) for f in c.findings]
    assert len(told) == len(set(told))
    assert {id(f) for f in findings if f.severity in ("error", "disagreement")} <= set(told)
    for c in causes(findings):
        assert c.head.severity in ("error", "disagreement")
        assert c.as_dict()["between"] == SIDES[c.side]
    verdict = report(*findings)
    assert bool(verdict.what_to_do) == (verdict.verdict != "agree")
    assert list(verdict.text())


def test_the_shown_row_differs_by_itself_if_one_does():
    def make(name, worst, because=""):
        return Residual("A-B", "point", name, "m", worst, worst, 1e-9, 0.0, "", consequence_of=because)

    fine, follows, own, equal = make("d", 1e-12), make("c", 6e-3, "a"), make("a", 3e-3), make("b", 3e-3 * (1 + 1e-12))
    assert headline([fine, follows, own, equal]) is own
    assert headline([fine, follows]) is follows
    assert headline([fine, replace(fine, worst=float("nan"))]).worst != 0  # no number is not an agreement


# ------------------------------------------------------------------------------------------------------ what to do


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        (off("cad.meeting", "U1", 0.2, suggestion="look"), "fix U1 in the CAD, 0.2 mm off: look; then twin validate"),
        (off("cad.apart", "U1", 0.2), "fix U1 in the CAD, 0.2 mm off; then twin validate"),
        (off("point.differs", "s1", 3.0, "eq1"), "twin explain x"),
        (off("length.differs", "l_p", 3.0, suggestion="fix 'platform'"), "fix 'platform'"),
        (off("stage.differs", "x.usda", 3.0, suggestion="rebuild the stage"), "rebuild the stage; then twin validate"),
        (off("rcm.missed", "RCM", 45.0, suggestion="pivot"), "in the protocol, RCM: pivot; then twin validate"),
        (off("limit.passive", "r11", 45.0), "in the protocol, r11"),
    ],
)  # fmt: skip
def test_each_kind_has_a_way_out(finding, words):
    judged = report(finding)
    assert words in judged.what_to_do
    assert judged.what_to_do.count("\n") == 0
    assert SIDES[side_of(finding)] in judged.verdict_line


def test_a_cure_takes_the_place_of_the_command():
    assert report(off("point.differs", "s1", 3.0, "eq1"), cure="replace a by b").what_to_do == "replace a by b"
    assert "replace" not in report(off("cad.meeting", "s1", 3.0), cure="replace a by b").what_to_do, (
        "the CAD comes first"
    )


# --------------------------------------------------------------------------------------- a real robot, a real fault


@pytest.fixture(scope="module")
def short():
    robot = twin.load("sils")
    return robot, twin.plan(robot, PROTOCOL)


@pytest.fixture(scope="module")
def printed(short):
    return twin.validate(*short, protocol=PROTOCOL, variants={"eq1": "printed"})


@pytest.mark.slow
def test_one_fault_has_one_number_everywhere(printed):
    from twin.ui.report.html import key_figures, verdict_reason, verdict_word

    (cause,) = printed.causes
    assert cause.name == "eq1 (printed)"
    assert {f.where for f in (cause.head, *cause.also)} == {"s1", "s3"}
    number = f"{cause.head.size:.4g} mm"
    assert verdict_word(printed) == "Equations (A) and CAD (B) differ"
    assert number in verdict_reason(printed)
    tiles = key_figures(printed)
    assert number == tiles[0]["value"]
    assert [t["label"] for t in tiles if t["state"] == "bad"] == ["eq1 (printed)"]
    text = "\n".join(map(show.plain, printed.text()))
    assert number in text
    assert [line.split()[:4] for line in text.splitlines() if "DIFFERS" in line] == [["A-B", "point", *number.split()]]
    data = printed.as_dict()
    assert [c["size"] for c in data["causes"]] == [cause.head.size]
    assert data["what_to_do"] == printed.what_to_do
    assert {f["cause"] for f in data["findings"] if f["severity"] == "disagreement"} == {"eq1 (printed)"}


@pytest.mark.slow
def test_what_to_do_is_under_the_verdict_on_the_terminal_and_on_the_first_screen_of_the_page(printed, capsys):
    from twin.cli import reports
    from twin.ui.report import render_html

    assert reports.print_reports([(printed, Path("here"))], SimpleNamespace(json=False)) == 1
    said = capsys.readouterr().out
    assert "DISAGREE: equations (A) and CAD (B) differ" in said
    lines = [line.strip() for line in said.splitlines()]
    assert lines[lines.index("DISAGREE: equations (A) and CAD (B) differ") + 1] == f"WHAT TO DO: {printed.what_to_do}"
    assert f"find the edit that corrects the equations: {printed.commands['explain']}" == printed.what_to_do
    page = render_html(printed, {})
    first_screen = page[page.index('<div class="verdict') : page.index('<dl class="strip"')]
    assert f"<code>{printed.commands['explain']}</code>" in first_screen


def test_an_edit_is_an_order():
    changes = [SimpleNamespace(edit=edit) for edit in ("insert `+ a`", "delete `2 *`", "b -> c")]
    assert _words(SimpleNamespace(changes=changes)) == "insert `+ a` and delete `2 *` and replace b by c"


@pytest.mark.parametrize(
    ("edit", "old", "new", "words"),
    [
        ("insert `-`", "return a, atan2(zz, r)", "return a, atan2(-zz, r)", "replace atan2(zz, r) by atan2(-zz, r)"),
        ("0 -> 1", "T = row(0, q) @ row(0, 2)", "T = row(0, q) @ row(1, 2)", "replace row(0, 2) by row(1, 2)"),
        ("R.T -> R", "u = f(R.T @ b)", "u = f(R @ b)", "replace R.T by R"),
        ("insert `-`", "x = zz", "x = -zz", "insert `-`"),
    ],
)
def test_an_edit_whose_place_is_not_clear_is_given_with_its_call(edit, old, new, words):
    diff = f"--- a/f.py\n+++ b/f.py\n@@ -1 +1 @@\n-    {old}\n+    {new}\n"
    assert _words(SimpleNamespace(changes=[SimpleNamespace(edit=edit)], diff=diff)) == words


@pytest.mark.nightly
def test_the_cure_is_found_in_seconds_or_the_command_is_given(short, printed):
    seen = []
    cures = FixSearch(short[0], 60)
    judged = cures.with_fix(printed, PROTOCOL, lambda label, fraction: seen.append(label))
    assert "replace c_theta by c_phi" in judged.cure
    assert "X_S1, Y_S1, X_S3, Y_S3" in judged.cure
    assert judged.cure.endswith("every row then agrees")
    assert judged.what_to_do == judged.cure
    assert seen
    seen.clear()
    assert cures.with_fix(printed, PROTOCOL, lambda label, fraction: seen.append(label)).cure == judged.cure
    assert not seen, "the same equations are not searched twice"
    late = FixSearch(short[0], 0.0).with_fix(printed, PROTOCOL, lambda label, fraction: None)
    assert late.cure == ""
    assert late.commands["explain"] in late.what_to_do


@pytest.mark.slow
def test_nothing_is_searched_for_what_is_not_in_the_equations(short):
    untouched = SimpleNamespace()  # whatever is asked of it fails
    for judged in (EMPTY, report(off("cad.meeting", "U1", 0.2)), report(off("rcm.missed", "RCM", 45.0))):
        assert FixSearch(untouched).with_fix(judged, None, lambda label, fraction: None) is judged


@pytest.mark.slow
def test_the_printed_commands_work(printed, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    line = shlex.split(printed.commands["explain"])
    assert line[0] == "twin"
    from twin.cli import main

    assert main([*line[1:], "--json"]) == 1
    assert '"eq1"' in capsys.readouterr().out
    args = parser().parse_args(shlex.split(printed.commands["validate"])[1:])
    assert (args.command, args.robot, args.variant) == ("validate", "sils", ["eq1=printed"])
    assert Path(args.protocol) == PROTOCOL


def test_commands_name_robots_of_ones_own_by_their_folder(tmp_path, monkeypatch):
    from twin.validation.repeat_commands import commands

    folder = tmp_path / "my robot"
    shutil.copytree(ROOT / "cad/sils", folder / "cad", ignore=shutil.ignore_patterns("*.py", "*.step", "__pycache__"))
    shutil.copy(ROOT / "twin/robots/sils.py", folder / "formula.py")
    robot = twin.load(folder)
    kin = twin.load("sils").kinematics()
    for here in (tmp_path, ROOT):
        monkeypatch.chdir(here)
        lines = commands(robot.files, kin, "table2", Tolerances().widened(5e-6, None))
        for name, line in lines.items():
            args = parser().parse_args(shlex.split(line)[1:])
            assert args.command == name
            assert twin.load(args.robot).files == robot.files
            assert args.tolerance_um == 5
            assert args.variant == [], "the default needs no word"


@pytest.mark.slow
def test_a_length_that_differs_is_the_cause_of_what_reads_it(short):
    from twin.validation.lengths import check_lengths, with_length_causes
    from twin.validation.residual_rows import SampleClock

    robot = twin.load("sils", parameters={"l_p": 135.4 * MM})
    _, found = check_lengths(robot.kinematics(), robot.cad, SampleClock(short[1].t, ()), Tolerances())
    others = [off("point.differs", "s1", 0.2, "eq1 (corrected)"), off("driven.differs", "q1", 0.2, "eq2 (corrected)")]
    judged = report(*found, *with_length_causes(robot.kinematics(), found, others))
    assert [c.name for c in judged.causes] == ["length l_p", "eq2 (corrected)"], "equation (2) does not read it"
    assert judged.causes[0].head.code == "length.differs"
    assert [f.where for f in judged.causes[0].follows] == ["s1"]
    assert judged.what_to_do.startswith("fix 'platform' in the CAD, or l_p in the equations")
