"""The report as page, files and plots, of a made-up judgement (test_report_example.py)."""

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from made import reports as made
from twin.core import errors
from twin.core.findings import Finding
from twin.core.provenance import Parameter
from twin.ui.report import render_html, write_report
from twin.ui.report.html import _with_commands, command, key_figures, verdict_reason
from twin.ui.report.plots import residuals
from twin.ui.report.residual_matrix import residual_matrix
from twin.validation.result import Report, Residual

make_report, PHASES, JOINTS = made.make_report, made.PHASES, made.JOINTS
NASTY = '<script>alert("x")</script> & $\\frac$'


class Page(HTMLParser):
    """Collects what a page loads, and checks that its elements nest."""

    VOID = ("meta", "link", "br", "img", "col", "hr", "input")

    def __init__(self, text: str):
        super().__init__()
        self.loads, self.ids, self.tags, self.open, self.text = [], [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.ids += [v for k, v in attrs if k == "id"]
        self.loads += [v for k, v in attrs if k in ("src", "href", "xlink:href", "srcset", "data", "action")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def agree() -> Report:
    return make_report("agree", 250)


@pytest.fixture(scope="module")
def disagree() -> Report:
    return make_report("disagree", 250)


@pytest.fixture(scope="module")
def written(disagree, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    return folder, write_report(disagree, folder)


# ------------------------------------------------------------------------------------------ page


def test_page_is_whole_and_loads_nothing(written):
    text = written[1]["html"].read_text("utf-8")
    page = Page(text)
    assert all(load.startswith("#") for load in page.loads)
    assert {load[1:] for load in page.loads} <= set(page.ids)
    assert all(u.startswith("#") for u in re.findall(r"url\(['\"]?([^)'\"]*)", text))
    assert "@import" not in text
    assert page.tags.count("script") == 1, "the script of the plots; without a robot, there is none of the robot"
    assert "http" not in text
    assert len(page.ids) == len(set(page.ids)), "the ids of one figure must not be those of another"
    assert page.tags.count("svg") == 8
    assert text.count('role="img"') == 8


def test_page_says_everything(disagree, written):
    text = "".join(Page(written[1]["html"].read_text("utf-8")).text)
    for finding in disagree.findings:
        assert finding.message in text
        assert finding.suggestion in text
    for parameter in disagree.parameters:
        assert parameter.name in text
        assert parameter.note in text
    assert "2 of 9 values are assumed" in text
    assert text.index("joint.q1.max_speed") < text.index("l_0")
    for phase in disagree.phases:
        assert phase.name in text
    assert "caused by point s1" in text
    assert "Equations (A) and CAD (B) differ" in text
    assert "twin validate sils --protocol table2 --variant eq1=printed" in text
    for pair in ("A–B", "B–C", "B–D"):
        assert pair in text


def test_a_row_within_its_tolerance_has_no_cause(agree):
    first, *others = agree.residuals
    assert first.agrees
    blamed = replace(first, consequence_of="point s9")
    page = render_html(replace(agree, residuals=(blamed, *others), series={}))
    assert "caused by point s9" not in page


def test_a_single_driven_joint_is_named_beside_its_residual(agree):
    series = {"t_coarse": agree.series["t_coarse"], "residual_driven.q4": agree.series["residual_driven.q4"]}
    (ax,) = residuals(replace(agree, series=series)).axes
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["q4"]


def test_findings_come_gravest_first(written):
    text = written[1]["html"].read_text("utf-8")
    order = [text.index(f"<code>{code}</code>") for code in ("point.differs", "rcm.missed", "limit.soft")]
    assert order == sorted(order)


@pytest.mark.slow
def test_same_bytes_every_time(disagree, written):
    assert render_html(disagree).encode() == written[1]["html"].read_bytes()


@pytest.mark.slow
def test_users_matplotlib_settings_do_not_matter(written):
    import matplotlib

    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "svg.fonttype": "path"}):
        assert render_html(make_report("disagree", 250)).encode() == written[1]["html"].read_bytes()


def test_malicious_names_are_text(agree):
    bad = replace(
        agree,
        robot=NASTY,
        title=NASTY,
        protocol=NASTY,
        source=NASTY,
        joint_names=(NASTY, *JOINTS[1:]),
        phases=tuple(replace(p, name=NASTY) for p in PHASES),
        residuals=tuple(replace(r, name=NASTY, note=NASTY, phase=NASTY) for r in agree.residuals),
        findings=(Finding("x.y", "warning", NASTY, NASTY, NASTY, 1.0, NASTY, 2.0, NASTY),),
        parameters=(Parameter(NASTY, 1.0, "mm", 1.0, "ASSUMED", NASTY),),
        facts={NASTY: {NASTY: NASTY}},
        environment={NASTY: NASTY},
        series={k: agree.series[k] for k in ("t", "q", "qd", "qdd")},
        variants={NASTY: NASTY},
        reasons={NASTY: NASTY},
    )
    text = render_html(bad)
    page = Page(text)
    assert page.tags.count("script") == 1
    assert text.count("<script") == 1
    assert text.index("<script") > text.index("</footer>")
    assert NASTY in "".join(page.text)


def test_a_variant_that_is_compared_has_its_reason_in_its_row(agree):
    reasons = {"eq1, printed": "as printed.", "eq1, corrected": "one factor is another."}
    text = render_html(replace(agree, variants={"eq1": "printed"}, reasons=reasons))
    table = text.partition('id="variants"')[2].partition("</table>")[0]
    compared, other = re.findall(r"<tr>(<th.*?)</tr>", table)[-2:]
    assert "compared here" in compared
    assert "as printed." in compared
    assert "corrected" in other
    assert "one factor is another." in other


# ----------------------------------------------------------------------------------- verdict


def test_reason_of_each_verdict(agree, disagree):
    assert verdict_reason(agree).startswith(
        f"All {sum(r.tolerance is not None for r in agree.residuals)} residuals with a"
    )
    first = next(f for f in disagree.findings if f.severity == "disagreement")
    assert first.message[1:].rstrip(".") in verdict_reason(disagree)  # the gravest finding, in its own words
    unchecked = replace(make_report("unchecked", 50), series={})
    assert verdict_reason(unchecked).startswith("limb1.shaft: cylinder of radius 8 mm")
    text = render_html(unchecked)
    assert "Could not check" in text
    assert "check near_mm" in text


def test_reason_when_only_a_finding_disagrees(agree):
    missed = Finding("rcm.missed", "disagreement", "the shaft misses the RCM by 45.78 mm", size=45.78, unit="mm")
    assert verdict_reason(replace(agree, findings=(missed,))) == "The shaft misses the RCM by 45.78 mm."


def test_key_figures(disagree):
    found = {f["label"]: f for f in key_figures(disagree)}
    assert next(iter(found)) == "eq1 (printed)"
    assert found["eq1 (printed)"]["value"] in verdict_reason(disagree), "tile and sentence show one number"
    assert found["eq1 (printed)"]["state"] == "bad"
    assert found["Tool position, A–B"]["note"] == "follows from point s1"
    assert found["RCM error"]["state"] == "good"
    assert found["Minimum clearance"]["value"] == "5.5 mm"
    assert found["Duration"]["value"] == "12 s"
    assert found["Assumed"]["value"] == "2"


def test_command_quotes_and_may_be_given(agree):
    bare = replace(agree, robot="my robot", variants={"eq1": "printed"})
    assert command(bare) == "twin validate 'my robot' --protocol table2 --variant eq1=printed"
    assert command(replace(bare, commands={"validate": "twin validate ./mine"})) == "twin validate ./mine"
    assert command(replace(agree, environment={"command": "twin validate x"})) == "twin validate x"


@pytest.mark.parametrize(
    ("commands", "shown"),
    [
        (("twin", "twin explain"), "<code>twin explain</code>"),
        (("twin explain", "twin"), "<code>twin explain</code>"),
        (("-", "twin"), "<code>twin</code> explain"),
        ((), "twin explain"),
    ],
)
def test_a_command_in_the_suggestion_is_marked_once(disagree, commands, shown):
    report = replace(disagree, cure="see twin explain & <b>", commands=dict(enumerate(commands)))
    assert str(_with_commands(report)) == f"see {shown} &amp; &lt;b&gt;"


# ------------------------------------------------------------------------------ files and plots


def test_pictures_exist_and_show_something(written):
    from PIL import Image

    names = {k[6:] for k in written[1] if k.startswith("plots/")}
    assert names == {
        "residual_matrix", "active_joints", "tool_motion", "residuals", "rcm", "fulcrum", "margins", "clearance",
    }  # fmt: skip
    for name in names:
        with Image.open(written[0] / "plots" / f"{name}.png") as image:
            assert image.width >= 900
            pixels = np.asarray(image.convert("RGB"))
        assert 0.01 < np.mean(np.any(pixels < 230, axis=-1)) < 0.6
        colors = pixels.astype(int) @ (65536, 256, 1)
        assert len(np.unique(colors)) > 20


@pytest.mark.parametrize("worst", [math.nan, math.inf])
def test_values_that_are_not_finite_stay_in_a_long_residual_matrix(disagree, worst):
    rows = []
    for number in range(60):
        rows.append(Residual("A-B", "point", f"p{number}", "m", 1e-12, 1e-12, 1e-6, 0.0, ""))
    rows.append(Residual("A-B", "point", "broken", "m", worst, worst, 1e-6, 0.0, ""))
    rows.append(replace(rows[-1], worst=1e-12))
    figure = residual_matrix(replace(disagree, residuals=tuple(rows)))
    assert figure is not None
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert len(names) == 48
    assert "point broken" in names
    assert sum(text.get_text().startswith("✗") for text in figure.axes[0].texts) == 1


def test_json_round_trip(disagree, written):
    read = json.loads(written[1]["json"].read_text("utf-8"))
    assert read == disagree.as_dict() | {"phases": read["phases"]}
    assert read["verdict"] == "disagree"
    assert [p["name"] for p in read["phases"]] == [p.name for p in PHASES]


def test_only_the_formats_asked_for(agree, tmp_path):
    assert set(write_report(agree, tmp_path / "a", ("json",))) == {"json"}
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["report.json"]
    with pytest.raises(errors.OutputError, match=r"report format 'htm'.*'html'"):
        write_report(agree, tmp_path / "b", ("htm",))
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize("series", ["none", "empty", "nan", "short"])
def test_missing_series_are_left_out(agree, series, tmp_path):
    make = {
        "none": lambda y: None,
        "empty": lambda y: y[:0],
        "nan": lambda y: np.full_like(y, np.nan),
        "short": lambda y: y[:-3],
    }[series]
    keep = ("t", "t_coarse", "clearance_t") if series in ("nan", "short") else ()
    found = {k: y if k in keep else make(y) for k, y in agree.series.items()}
    bare = replace(agree, residuals=agree.residuals[:3], series={k: y for k, y in found.items() if y is not None})
    out = write_report(bare, tmp_path)
    assert {k for k in out if k.startswith("plots/")} == {"plots/residual_matrix"}
    assert "Equations (A), CAD (B) and USD (C) agree" in out["html"].read_text("utf-8")


def test_a_report_of_nothing(tmp_path):
    nothing = Report("x", "", "", "p", "", {}, {}, (), (), (), (), {}, {}, ())
    out = write_report(nothing, tmp_path)
    assert set(out) == {"html", "json"}
    assert "Nothing was compared" in out["html"].read_text("utf-8")


@pytest.mark.slow
def test_numbers_that_are_none(agree):
    rows = tuple(replace(r, worst=math.nan, rms=math.inf, t=math.nan) for r in agree.residuals)
    series = {k: np.where(np.arange(len(y)) % 5 == 0, np.nan, y.T).T for k, y in agree.series.items() if "t" not in k}
    text = render_html(replace(agree, residuals=rows, series=dict(agree.series) | series))
    assert ">nan<" not in text.lower()
    assert "nan mm" not in text
    assert "∞" in text


def test_revolute_joints_are_in_degrees(agree):
    from twin.ui.report.plots import active_joints
    from twin.ui.report.style import styled

    with styled():
        figure = active_joints(replace(agree, angles=frozenset(JOINTS[:3])))
    assert [ax.get_ylabel() for ax in figure.axes[:2]] == ["displacement [mm]", "displacement [°]"]
    mm, deg = (ax.get_legend_handles_labels()[1] for ax in figure.axes[:2])
    assert (mm, deg) == (["q4", "q5", "q6"], ["q1", "q2", "q3"])
