"""The first screen of a report: five questions answered for five faults, the place marked; contrast and length."""

from __future__ import annotations

import base64
import json
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import twin
from made import reports
from twin.cli.fix_search import FixSearch
from twin.ui.report import render_html
from twin.ui.report.first_screen import answers
from twin.ui.report.robot_picture import MAX_TRIANGLES, picture_of

ROOT = Path(__file__).parents[2]
CSS = (ROOT / "twin/ui/report/report.css").read_text("utf-8")


def hexapod(folder, old, new, file="formula.py"):
    """Return the example hexapod with one text replaced in one file."""
    robot = folder / "my_hexapod"
    shutil.copytree(ROOT / "docs/examples/hexapod", robot)
    text = (robot / file).read_text("utf-8")
    assert old in text
    (robot / file).write_text(text.replace(old, new), "utf-8")
    return twin.load(robot)


FAULTS = {
    # which, how much, which line, what now
    "row": ("s1, by eq1", "3.045 mm", "sils.py:76, 77, 78, 79", "replace c_theta by c_phi"),
    "sum": ("q5, by eq2", "252.7 mm", "sils.py:117, 118, 119", "replace l_1 + l_2 by l_2 - l_1"),
    "rotation": ("q3, by inverse", "27.84 mm", "formula.py:28", "replace R.T by R"),
    "number": ("q5, by inverse", "0.3972 mm", "formula.py:12", "set h_b = 34 mm instead of 34.4 mm"),
    "protocol": ("RCM at", "45.78 mm", "table2_printed.toml:89", 'use rcm = "enforced"'),
}
RED = {"row": "platform", "sum": "carriage5", "rotation": "rod3", "number": "rod5", "protocol": "platform"}


def judged(fault, folder):
    """Return (robot, report) with a fault; the fix is searched for as the command does."""
    variants = None
    protocol = None
    if fault == "row":
        robot, variants = twin.load("sils"), {"eq1": "printed"}
    elif fault == "sum":
        robot, variants = twin.load("sils"), {"eq2": "printed"}
    elif fault == "protocol":
        robot, protocol = twin.load("sils"), "table2_printed"
    elif fault == "rotation":
        robot = hexapod(folder, "R @ b", "R.T @ b")
    else:
        robot = hexapod(folder, '"h_b": mm(34.0', '"h_b": mm(34.4')
    report = twin.validate(robot, protocol=protocol, variants=variants)
    return robot, FixSearch(robot, 60.0).with_fix(report, protocol, lambda label, part: None)


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_the_first_screen_answers_five_questions(fault, tmp_path):
    robot, report = judged(fault, tmp_path)
    picture = picture_of(robot, report)
    assert picture is not None
    page = render_html(report, {}, picture)
    first = unescape(re.sub(r"<[^>]+>", " ", page[page.index("<body>") : page.index('<dl class="strip"')]))
    which, much, line, now = FAULTS[fault]
    for text in (which, much, line, now):
        assert text in re.sub(r"\s+", " ", first)
    said = {answer.question: answer for answer in answers(report, picture)}
    assert said["Which joint or link?"].text.startswith(which)
    assert said["How much?"].text.startswith(much)
    assert said["Which line?"].code.endswith(line)
    assert len(said["What was not judged?"].text) > 20
    assert RED[fault] in picture.marked
    assert len(page) < 3e6


@pytest.mark.slow
def test_an_agreement_says_what_was_not_judged():
    robot = twin.load("sils")
    report = twin.validate(robot)
    page = render_html(report, {}, picture_of(robot, report))
    todo = re.search(r'<p class="todo">(.*?)</p>', page, re.DOTALL)
    assert todo is not None
    assert "nothing to fix. Not judged:" in todo[1]
    assert "assumed values" in todo[1]
    assert "100 % of the joint range" in page


def test_the_picture_shows_the_mechanism_where_it_is():
    """The vertices that a page gets are those of the meshes at home, to the resolution of the page."""
    robot = twin.load("lapbot")
    report = replace(reports.make_report("agree", 50), protocol=robot.source.description.default_protocol)
    picture = picture_of(robot, report)
    assert picture is not None
    assert len(picture.triangles) <= MAX_TRIANGLES
    data = json.loads(picture.data)
    stored = np.frombuffer(base64.b64decode(data["vertices"]), "<i2").reshape(-1, 3)
    got = np.array(data["low"]) + data["step"] * stored
    bound = robot.bound(robot.protocol(report.protocol))
    assembly = bound.reference().solve(bound.mechanism.home)
    wanted = []
    for body in bound.mechanism.bodies:
        T = assembly.link_poses[body.name]
        for mesh in body.meshes:
            wanted.append(mesh.vertices @ T[:3, :3].T + T[:3, 3])
    assert np.abs(got - np.concatenate(wanted)).max() < 1.1 * data["step"]
    assert sum(run[0] for run in data["colors"]) == len(picture.triangles)
    png = base64.b64decode(picture.png)
    assert png.startswith(b"\x89PNG")
    assert len(png) > 3000


def luminance(color):
    value = color.lstrip("#")
    if len(value) == 3:
        value = "".join(2 * digit for digit in value)
    channels = []
    for k in (0, 2, 4):
        c = int(value[k : k + 2], 16) / 255
        channels.append(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4)
    return 0.2126 * channels[0] + 0.7152 * channels[1] + 0.0722 * channels[2]


def contrast(first, second):
    """Return the contrast of two colours as WCAG 2 defines it."""
    bright, dark = sorted((luminance(first), luminance(second)), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_text_has_the_contrast_of_wcag_aa(scheme):
    blocks = re.findall(r":root \{(.*?)\}", CSS, re.DOTALL)
    colors = dict(re.findall(r"--([\w-]+): (#\w+);", blocks[scheme]))
    for text, papers in {
        "ink": ("paper", "page", "band", "bad-soft", "near-soft", "good-soft"),
        "soft": ("paper", "page", "none-soft", "bad-soft", "near-soft"),
        "bad": ("paper", "bad-soft"),
        "near": ("paper", "near-soft"),
        "good": ("paper", "good-soft"),
        "none": ("paper", "none-soft"),
        "link": ("paper", "page", "bad-soft"),
    }.items():
        for paper in papers:
            assert contrast(colors[text], colors[paper]) >= 4.5, (text, paper)
