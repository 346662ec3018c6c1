"""`twin check`: each rule bites on its seeded fault and is silent without it; files, baseline, formats for CI."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from made.repository import ARM, FAULTS, faulty, repository
from twin.checking import descriptions
from twin.checking.baseline import read_baseline, write_baseline
from twin.checking.check_finding import CheckFinding, numbered
from twin.checking.check_result import FolderCheck
from twin.checking.checker import check
from twin.checking.descriptions import patterns, walk
from twin.checking.file_verdict import JudgeJob, judge
from twin.checking.junit import junit
from twin.checking.pair_comparison import compare_two, pairs, stem
from twin.checking.places import repository_prefix, within
from twin.checking.rules import RULES
from twin.checking.sarif import sarif
from twin.cli import main
from twin.core.errors import SourceError
from twin.exchange.xacro import XacroSettings

CLEAN = Path(__file__).parents[1] / "data/checked"
XACRO = 'xmlns:xacro="http://ros.org/wiki/xacro"'


def judged(folder: Path):
    tree = walk(folder)
    return [judge(JudgeJob(description, tree, XacroSettings())) for description in tree.descriptions]


def findings(folder: Path) -> list[CheckFinding]:
    found = []
    for one in judged(folder):
        found += one.findings
    return numbered(found)


def test_a_correct_repository_has_no_findings(tmp_path):
    repository(tmp_path)
    (one,) = judged(tmp_path)
    assert one.status == "judged"
    assert one.findings == ()
    assert one.joints == ("elbow", "shoulder")


@pytest.mark.parametrize("rule", FAULTS)
def test_each_rule_finds_its_fault_on_its_line_and_no_other_rule_does(tmp_path, rule):
    text, line = faulty(rule)
    repository(tmp_path, text)
    found = findings(tmp_path)
    assert {finding.rule for finding in found} == {rule}
    (first, *_) = found
    if rule not in ("mesh/outside", "audit/fault"):  # these name no element
        assert abs(first.line - line) <= 5, first
    assert first.file == "arm_description/urdf/arm.urdf"
    assert first.advice


def test_every_rule_is_documented_and_seeded_here():
    elsewhere = {
        "file/unjudged",
        "file/incomplete",
        "file/unsupported",
        "mesh/unreadable",
        "loops/open",
        "compare/kinematics",
        "compare/property",
        "compare/variant",
        "compare/different",
        "compare/skipped",
    }
    assert set(RULES) == set(FAULTS) | elsewhere
    page = (Path(__file__).parents[2] / "docs/check.md").read_text(encoding="utf-8")
    for rule in RULES.values():
        assert f"| `{rule.id}` | {rule.level} |" in page


def test_a_damaged_mesh_is_found(tmp_path):
    repository(tmp_path)
    (tmp_path / "arm_description/meshes/fore.stl").write_bytes(b"solid nothing")
    assert [finding.rule for finding in findings(tmp_path)] == ["mesh/unreadable"]


def test_rounding_of_printed_numbers_is_not_called_impossible(tmp_path):
    for text in ("1.234e-20", "1e-17"):  # exporters print these for zero
        tensor = f'ixx="{text}" ixy="0" ixz="0" iyy="0" iyz="-{text}" izz="0"'
        folder = tmp_path / text
        repository(folder, ARM.replace(FAULTS["inertia/zero"][0], tensor))
        assert [finding.rule for finding in findings(folder)] == ["inertia/zero"]


@pytest.mark.parametrize(("lower", "upper"), [("-100", "100"), ("-1000", "1000"), ("-6.28", "6.28"), ("-1e16", "1e16")])
def test_limits_that_mean_none_are_not_degrees(tmp_path, lower, upper):
    repository(tmp_path, ARM.replace('lower="-2" upper="2"', f'lower="{lower}" upper="{upper}"'))
    assert findings(tmp_path) == []


def test_the_mass_of_a_marker_is_not_compared_with_its_size(tmp_path):
    heavy = ARM.replace('mass value="1.5"', 'mass value="1500"')
    repository(tmp_path / "a", heavy)
    assert [finding.rule for finding in findings(tmp_path / "a")] == ["inertia/density"]
    marker = ARM.replace('mass value="1.5"', 'mass value="0.1"')
    marker = marker.replace('size="0.2 0.1 0.08"', 'size="0.01 0.01 0.01"')  # 100 000 kg/m3
    tensor = 'ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"'
    repository(tmp_path / "b", marker.replace(FAULTS["inertia/zero"][0], tensor))
    assert findings(tmp_path / "b") == []


OPEN = """<mujoco model="loop">
  <worldbody>
    <body name="a"><joint name="qa" axis="0 0 1"/><geom size="0.1"/><site name="sa" pos="0.1 0 0"/></body>
    <body name="b" pos="5 0 0"><joint name="qb" axis="0 0 1" range="-20 20"/><geom size="0.1"/><site name="sb"/></body>
  </worldbody>
  <equality><connect name="far" site1="sa" site2="sb"/></equality>
</mujoco>
"""


def test_limits_of_a_sdf_that_are_stated_are_not_called_missing(tmp_path):
    limit = "<axis><xyz>0 0 1</xyz><limit><lower>0</lower><upper>0</upper></limit></axis>"
    joint = f'<joint name="j" type="revolute"><parent>a</parent><child>b</child>{limit}</joint>'
    text = f'<sdf version="1.7"><model name="m"><link name="a"/><link name="b"/>{joint}</model></sdf>'
    (tmp_path / "a.sdf").write_text(text, encoding="utf-8")
    (finding,) = findings(tmp_path)
    assert finding.rule == "limits/fixed"
    assert finding.message == "joint 'j': lower 0 and upper 0 rad: the joint cannot move"


def test_an_open_loop_is_found(tmp_path):
    (tmp_path / "loop.xml").write_text(OPEN, encoding="utf-8")
    assert {finding.rule for finding in findings(tmp_path) if finding.level != "note"} == {"loops/open"}


SCALED = """<mujoco model="scaled">
  <worldbody>
    <body name="a"><joint name="q" axis="0 0 1" range="-90 90"/><geom size="0.1"/>
      <body name="rod" pos="0 0 1">
        <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0"/></body>
    </body>
  </worldbody>
  <actuator>
    <general name="m" joint="q" biastype="affine" gainprm="500" biasprm="0 -200 0" ctrlrange="-9 9" ctrllimited="true"/>
  </actuator>
</mujoco>
"""


def test_a_scaled_control_and_a_rod_without_width_are_no_faults(tmp_path):
    (tmp_path / "scaled.xml").write_text(SCALED, encoding="utf-8")
    (one,) = judged(tmp_path)
    assert one.status == "judged"
    assert {finding.level for finding in one.findings} <= {"note"}


# -- files that the reader refuses ----------------------------------------------------------------


def test_a_fault_of_an_element_does_not_hide_the_error_of_the_reader(tmp_path):
    bad = ARM.replace('xyz="0.2 0 0" rpy', 'xyz="0.2 0 zero" rpy')
    repository(tmp_path / "a", bad.replace("fore.stl", "Fore.stl"))
    found = findings(tmp_path / "a")
    assert [finding.rule for finding in found] == ["mesh/missing", "file/malformed"]
    assert found[1].message == "joint 'elbow': origin xyz = '0.2 0 zero' is not 3 numbers"
    assert "0 zero" in bad.splitlines()[found[1].line + 2]
    other = ARM.replace('xyz="0 0 0.1" rpy', 'xyz="0 0 zero" rpy').replace(
        'lower="-2" upper="2"', 'lower="2" upper="-2"'
    )
    repository(tmp_path / "b", other)  # the fault of the elbow is not that of the shoulder
    assert {finding.rule for finding in findings(tmp_path / "b")} == {"limits/order", "file/malformed"}


_SDF = '<sdf version="1.7"><model name="m"><link name="a"/><link name="b"/>{}</model></sdf>'
_XACRO = '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">{}</robot>'
_PACKAGE = "<package><name>arm</name></package>"
_JOINT = '<parent link="a"/><child link="b"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'

REFUSED = {
    "a URDF without links": ({"a.urdf": '<robot name="a"/>'}, "file/malformed"),
    "a URDF without links and name, which others include": ({"a.urdf": "<robot/>"}, None),
    "a URDF with macros only": (
        {"a.urdf": _XACRO.format('<xacro:macro name="a"><link name="a"/></xacro:macro>')},
        None,
    ),
    "a USD stage with a mistake of syntax": ({"a.usda": '#usda 1.0\ndef Xform "a" {'}, "file/malformed"),
    "a joint of SDF with a link that does not exist": (
        {"a.sdf": _SDF.format('<joint name="j" type="fixed"><parent>a</parent><child>c</child></joint>')},
        "file/malformed",
    ),
    "a joint of SDF with the name of a link": (
        {"a.sdf": _SDF.format('<joint name="b" type="fixed"><parent>a</parent><child>b</child></joint>')},
        None,
    ),
    "a file of SDF 1.2": ({"a.sdf": _SDF.format("").replace("sdf", "gazebo")}, "file/unsupported"),
    "a joint of SDF without parent": (
        {"a.sdf": _SDF.format('<joint name="j" type="fixed"><child>b</child></joint>')},
        "file/malformed",
    ),
    "a joint type of SDF that exists": (
        {"a.sdf": _SDF.format('<joint name="j" type="screw"><parent>a</parent><child>b</child></joint>')},
        "file/unsupported",
    ),
    "a joint type of SDF that does not exist": (
        {"a.sdf": _SDF.format('<joint name="j" type="scrw"><parent>a</parent><child>b</child></joint>')},
        "file/malformed",
    ),
    "a URDF with joints and without links": (
        {"a.urdf": f'<robot name="a"><joint name="j" type="revolute">{_JOINT}</joint></robot>'},
        "names/unknown",
    ),
    "a table with a cell that is no number": (
        {"dh.csv": "# convention: standard\n# units: m, deg\njoint,theta,d,a,alpha\n1,q1,0.3,0.1o,90\n"},
        "file/malformed",
    ),
    "a table with a cell too few": (
        {"dh.csv": "# convention: standard\n# units: m, deg\njoint,theta,d,a,alpha\n1,q1,0.3,0.1\n"},
        "file/malformed",
    ),
    "a table that does not say its convention": (
        {"dh.csv": "joint,theta,d,a,alpha\n1,q1,0.3,0.1,90\n"},
        "file/unsupported",
    ),
    "a table of something else": ({"angles.csv": "time,theta,alpha,torque\n1,2,3,4\n1,2\n"}, None),
    "a xacro whose include does not exist": (
        {"a.xacro": _XACRO.format('<xacro:include filename="none.xacro"/><xacro:arm/>')},
        "file/malformed",
    ),
    "a xacro whose include is missing in a package that is here": (
        {
            "arm/package.xml": _PACKAGE,
            "arm/a.xacro": _XACRO.format("<xacro:include filename=\"$(find arm)/package 'x'/--arg.xacro\"/>"),
        },
        "file/malformed",
    ),
    "a xacro with an argument that is not given": (
        {"a.xacro": _XACRO.format('<link name="$(arg side)"/>')},
        "file/incomplete",
    ),
}
"""{what: (files, rule that finds it, or None)}."""


@pytest.mark.parametrize("what", REFUSED)
def test_what_a_reader_refuses_is_a_fault_of_the_file_or_a_limit_of_twin(tmp_path, what):
    files, rule = REFUSED[what]
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert {finding.rule for finding in findings(tmp_path)} == ({rule} if rule else set())


def test_an_argument_that_must_be_given_is_no_missing_file(tmp_path):
    text = '<xacro:arg name="dof" default="{}"/><xacro:include filename="arm_$(arg dof).xacro"/>'
    (tmp_path / "arm_7.xacro").write_text(_XACRO.format(""), encoding="utf-8")
    for default, rule in (("", "file/incomplete"), ("8", "file/malformed")):
        (tmp_path / "arm.xacro").write_text(_XACRO.format(text.format(default)), encoding="utf-8")
        found = [finding for finding in findings(tmp_path) if finding.file == "arm.xacro"]
        assert [finding.rule for finding in found] == [rule]


LOST = """<mujoco model="lost">
  <asset><mesh name="m" file="lost.stl"/></asset>
  <worldbody>
    <body name="a"><joint name="qa" axis="0 0 1"/><geom type="mesh" mesh="m"/>
      <body name="b"><joint name="qb" axis="0 0 1"/><geom type="mesh" mesh="m"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def test_a_missing_mesh_of_a_mjcf_is_told_once_and_the_mass_that_it_would_give_is_not(tmp_path):
    (tmp_path / "lost.xml").write_text(LOST, encoding="utf-8")
    (finding,) = findings(tmp_path)
    assert finding.rule == "mesh/missing"
    assert finding.message == "mesh 'lost.stl' does not exist"
    text = '<mujoco><compiler meshdir="meshes"/><include file="lost.xml"/></mujoco>'
    (tmp_path / "whole.xml").write_text(text, encoding="utf-8")
    assert {(finding.file, finding.rule) for finding in findings(tmp_path)} == {("whole.xml", "mesh/missing")}
    stated = LOST.replace("<asset>", '<compiler meshdir="meshes"/><asset>')
    (tmp_path / "stated.xml").write_text(stated, encoding="utf-8")
    (finding,) = [finding for finding in findings(tmp_path) if finding.file == "stated.xml"]
    assert finding.message == "mesh 'meshes/lost.stl' does not exist"  # where MuJoCo searches it


def test_what_a_mechanism_cannot_express_of_a_mjcf_is_no_fault_also_if_a_mesh_is_missing(tmp_path):
    robots = LOST.replace("</worldbody>", '<body><joint axis="0 0 1"/><geom size="1"/></body></worldbody>')
    (tmp_path / "two.xml").write_text(robots, encoding="utf-8")
    (finding,) = findings(tmp_path)
    assert finding.rule == "file/unsupported"
    assert "2 robots" in finding.message


def test_what_only_the_audit_refuses_is_told(tmp_path, monkeypatch):
    def refuse(path, **_):
        raise SourceError(f"{path}: joint 'elbow': no reason")

    monkeypatch.setattr("twin.exchange.audit.audit", refuse)
    repository(tmp_path)
    (finding,) = findings(tmp_path)
    assert finding.rule == "audit/fault"
    assert finding.message.endswith("refuses the file: joint 'elbow': no reason")


def test_messages_name_files_as_seen_from_the_folder_and_keep_other_paths(tmp_path, monkeypatch):
    repository(tmp_path, ARM.replace("package://arm_description/meshes", "../.././meshes"))
    (finding,) = findings(tmp_path)
    monkeypatch.chdir(tmp_path)
    (same,) = findings(Path())
    assert "'../.././meshes/fore.stl'" in finding.message
    assert same.fingerprint == finding.fingerprint
    folder = Path("/a/b")
    assert within(folder, "/a/b/x.stl: see 'file:///a/b/y.stl'") == "x.stl: see 'y.stl'"
    assert within(folder, "/c/a/b/x.stl and package://a/b/x.stl") == "/c/a/b/x.stl and package://a/b/x.stl"


def test_a_mesh_is_searched_in_the_checked_folder_only(tmp_path):
    repository(tmp_path, ARM.replace("package://arm_description/meshes", "meshes"))
    assert findings(tmp_path) == []
    (finding,) = findings(tmp_path / "arm_description/urdf")  # the meshes are beside the folder
    assert finding.rule == "mesh/missing"


# -- which files are descriptions -----------------------------------------------------------------


def test_what_is_no_robot_is_left_out(tmp_path):
    file = repository(tmp_path)
    beside = file.parent
    (beside / "macros.xacro").write_text('<robot xmlns:xacro="http://ros.org/wiki/xacro"/>', encoding="utf-8")
    (beside / "launch.xml").write_text("<launch/>", encoding="utf-8")
    (beside / "notes.md").write_text("| a | b |\n|---|---|\n| 1 | 2 |\n", encoding="utf-8")
    (beside / "table.urdf").write_text('<robot name="table"><link name="top"/></robot>', encoding="utf-8")
    statuses = {one.description.path.name: one.status for one in judged(tmp_path)}
    assert statuses == {"arm.urdf": "judged", "table.urdf": "judged"}
    assert findings(tmp_path) == []


def test_a_xacro_is_judged_with_the_file_and_the_line_of_its_macro(tmp_path):
    file = repository(tmp_path)
    limits = 'lower="2" upper="-2"'
    macro = ARM.replace('lower="-2" upper="2"', limits).replace('<?xml version="1.0"?>\n', "")
    macro = macro.replace(
        '<robot name="arm">', '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="arm">'
    )
    macro = macro.replace("</robot>", "</xacro:macro></robot>")
    (file.parent / "macro.xacro").write_text(macro, encoding="utf-8")
    main = f'<robot name="arm" {XACRO}><xacro:include filename="macro.xacro"/><xacro:arm/></robot>'
    file.rename(file.with_suffix(".xacro")).write_text(main, encoding="utf-8")
    (finding,) = findings(tmp_path)
    assert finding.rule == "limits/order"
    assert finding.file == "arm_description/urdf/macro.xacro"
    assert macro.splitlines()[finding.line - 1].strip().startswith(f"<limit {limits}")


def test_a_xacro_without_its_package_is_incomplete_and_no_fault(tmp_path):
    text = (
        '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">'
        '<xacro:include filename="$(find not_here_description)/urdf/arm.xacro"/><xacro:arm/></robot>'
    )
    (tmp_path / "arm.urdf.xacro").write_text(text, encoding="utf-8")
    (one,) = judged(tmp_path)
    assert one.status == "incomplete"
    assert [finding.rule for finding in one.findings] == ["file/incomplete"]


def test_a_package_anywhere_in_the_folder_is_found(tmp_path):
    parts = tmp_path / "vendor/deep/down/parts_description"
    parts.mkdir(parents=True)
    links = re.sub(r"<\?xml.*?>|</?robot.*?>", "", ARM).replace('lower="-2" upper="2"', 'lower="2" upper="-2"')
    macro = _XACRO.format(f'<xacro:macro name="arm">{links}</xacro:macro>').replace(' name="arm"', "", 1)
    (parts / "arm.xacro").write_text(macro, encoding="utf-8")
    (tmp_path / "robots/arm").mkdir(parents=True)
    main = _XACRO.format('<xacro:include filename="$(find parts_description)/arm.xacro"/><xacro:arm/>')
    (tmp_path / "robots/arm/arm.xacro").write_text(main, encoding="utf-8")
    rules = {finding.rule for finding in findings(tmp_path)}
    assert rules == {"file/incomplete"}  # a folder without package.xml is a package only where its name is searched
    (parts / "package.xml").write_text("<package><name>parts_description</name></package>", encoding="utf-8")
    found = [finding for finding in findings(tmp_path) if finding.rule == "limits/order"]
    assert [finding.file for finding in found] == ["vendor/deep/down/parts_description/arm.xacro"]


def test_code_that_is_not_allowed_leaves_a_xacro_unjudged(tmp_path, monkeypatch):
    monkeypatch.setenv("TWIN_NO_CODE", "1")
    text = '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><link name="${1}"/></robot>'
    (tmp_path / "arm.xacro").write_text(text, encoding="utf-8")
    (one,) = judged(tmp_path)
    assert one.status == "unjudged"


@pytest.mark.parametrize(
    ("name", "pattern", "out"),
    [
        ("build/arm.urdf", "build", True),
        ("a/build/arm.urdf", "build/", True),
        ("builds/arm.urdf", "build", False),
        ("old/arm.urdf", "old/arm.urdf", True),
        ("new/old/arm.urdf", "old/arm.urdf", False),
        ("old/deep/arm.urdf", "old/*", True),
        ("arm_old.urdf", "*_old.urdf", True),
        ("a/b/c/arm.urdf", "a/**/arm.urdf", True),
        ("arm.urdf", "/arm.urdf", True),
        ("a/arm.urdf", "/arm.urdf", False),
        ("arm.urdf", "arm.urdf/", False),  # a pattern for folders
        ("arm.urdf", "*.urdf !arm.urdf", False),
        ("arm.urdf", "!arm.urdf *.urdf", True),  # the last pattern counts
        ("a/arm.urdf", "#a", False),
    ],
)
def test_excludes(name, pattern, out):
    assert patterns(pattern.split()).match_file(name) == out


def test_an_excluded_folder_is_not_searched_and_a_negation_keeps_a_file(tmp_path):
    file = repository(tmp_path)
    (file.parent / "old").mkdir()
    (file.parent / "old/arm.urdf").write_text(ARM, encoding="utf-8")
    names = [description.name for description in walk(tmp_path, ["old/"]).descriptions]
    assert names == ["arm_description/urdf/arm.urdf"]
    names = [description.name for description in walk(tmp_path, ["*.urdf", "!old/arm.urdf"]).descriptions]
    assert names == []  # as for git, a pattern with / is one from the folder itself
    names = [description.name for description in walk(tmp_path, ["*.urdf", "!**/old/arm.urdf"]).descriptions]
    assert names == ["arm_description/urdf/old/arm.urdf"]
    with pytest.raises(SourceError, match="--exclude '!': not a pattern"):
        walk(tmp_path, ["!"])


def test_excluded_files_do_not_count(tmp_path, monkeypatch):
    repository(tmp_path)
    for number in range(20):
        (tmp_path / f"{number}.log").touch()
    monkeypatch.setattr(descriptions, "_MAX_ENTRIES", 15)
    with pytest.raises(SourceError, match="more than 15 files"):
        walk(tmp_path)
    assert len(walk(tmp_path, ["*.log"]).descriptions) == 1


def test_a_folder_with_packages_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(SourceError, match="gone: there is no such folder"):
        walk(tmp_path, packages=[tmp_path / "gone"])


def test_links_that_form_a_loop_and_lead_nowhere(tmp_path):
    file = repository(tmp_path)
    (file.parent / "again").symlink_to(tmp_path, target_is_directory=True)
    (file.parent / "gone.urdf").symlink_to(tmp_path / "nowhere.urdf")
    tree = walk(tmp_path)
    assert [description.path.name for description in tree.descriptions] == ["arm.urdf"]
    assert tree.unreadable == {"arm_description/urdf/gone.urdf": "the link points to no file"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every file")
def test_a_file_without_permission_is_told(tmp_path):
    file = repository(tmp_path)
    file.chmod(0)
    assert list(walk(tmp_path).unreadable) == ["arm_description/urdf/arm.urdf"]


def test_a_pipe_is_no_description(tmp_path):
    os.mkfifo(tmp_path / "arm.urdf")
    assert walk(tmp_path).descriptions == []


def test_no_folder(tmp_path):
    with pytest.raises(SourceError, match="does not exist"):
        walk(tmp_path / "none")
    file = repository(tmp_path)
    with pytest.raises(SourceError, match="this is a file"):
        walk(file)


@pytest.mark.slow
def test_ten_thousand_files(tmp_path):
    repository(tmp_path)
    for folder in range(100):
        place = tmp_path / f"f{folder}"
        place.mkdir()
        for file in range(100):
            (place / f"{file}.xml").write_text("<launch/>", encoding="utf-8")
    assert len(walk(tmp_path).descriptions) == 1


# -- pairs ----------------------------------------------------------------------------------------


def two(tmp_path, text: str, name: str):
    first = repository(tmp_path)
    (first.parent.parent / "other").mkdir()
    (first.parent.parent / "other" / name).write_text(text, encoding="utf-8")
    ((one, other),) = pairs(judged(tmp_path))
    return compare_two(one, other, XacroSettings())


def test_two_equal_descriptions_agree(tmp_path):
    assert two(tmp_path, ARM, "arm.urdf") == ()


def test_a_changed_length_is_named_with_its_line(tmp_path):
    (finding,) = two(tmp_path, ARM.replace('xyz="0.2 0 0" rpy', 'xyz="0.25 0 0" rpy'), "arm.urdf")
    assert finding.rule == "compare/kinematics"
    assert finding.file == "arm_description/urdf/arm.urdf"
    assert finding.line in (0, ARM[: ARM.index('xyz="0.2 0 0" rpy')].count("\n") + 1)
    assert "50" in finding.message


def test_changed_limits_are_told_and_those_of_a_variant_only_noted(tmp_path):
    text = ARM.replace('upper="2"', 'upper="1.8"')
    assert [f.rule for f in two(tmp_path / "a", text, "arm.urdf")] == ["compare/property"]
    assert [f.rule for f in two(tmp_path / "b", text, "arm_short.urdf")] == ["compare/variant"]


def test_other_joints_are_another_robot(tmp_path):
    file = repository(tmp_path)
    file.with_name("arm_2.urdf").write_text(ARM.replace("elbow", "wrist"), encoding="utf-8")
    assert pairs(judged(tmp_path)) == []


def test_pairs_that_cannot_be_compared_are_counted(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise SourceError("no joint of one is a joint of the other")

    monkeypatch.setattr("twin.api.comparison.compare", refuse)
    (finding,) = two(tmp_path, ARM, "arm.urdf")
    assert (finding.rule, finding.level) == ("compare/skipped", "note")
    text = "\n".join(str(part) for part in FolderCheck(".", (), (finding,), 3).lines(notes=False))
    assert "3 pairs compared" in text
    assert "1 pair not compared" in text


def test_stems():
    assert stem("a/b/arm.urdf.xacro") == "arm"
    assert stem("iiwa14_r820.xml") == "iiwa14_r820"


# -- baseline, SARIF, JUnit -----------------------------------------------------------------------


def test_fingerprints_survive_moved_lines_and_not_changed_values(tmp_path):
    text, _ = faulty("limits/order")
    before = findings(repository(tmp_path / "a", text).parents[2])
    moved = findings(repository(tmp_path / "b", text.replace("<robot", "\n\n<!-- moved -->\n<robot")).parents[2])
    other = findings(repository(tmp_path / "c", text.replace('lower="2"', 'lower="3"')).parents[2])
    assert [f.line for f in before] != [f.line for f in moved]
    assert [f.fingerprint for f in before] == [f.fingerprint for f in moved]
    assert [f.fingerprint for f in before] != [f.fingerprint for f in other]


def test_equal_findings_have_different_fingerprints():
    one = CheckFinding("limits/order", "a.urdf", "joint 'a'", "text", 3)
    other = CheckFinding("limits/order", "a.urdf", "joint 'a'", "text", 9)
    found = numbered([other, one, one])
    assert [finding.line for finding in found] == [3, 9]
    assert len({finding.fingerprint for finding in found}) == 2


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    found = [
        CheckFinding("limits/order", "a.urdf", "joint 'a'", "text", 3),
        CheckFinding("limits/zero", "a.urdf", "", "x"),
    ]
    file = tmp_path / "known.json"
    assert write_baseline(file, found) == 1
    assert read_baseline(file) == {found[0].fingerprint}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("{}", "not a baseline"),
        ('{"schema": "twin/check-baseline/1", "findings": [{}]}', "finding 1 of the baseline has no fingerprint"),
    ],
)
def test_a_bad_baseline(tmp_path, text, message):
    file = tmp_path / "known.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SourceError, match=message):
        read_baseline(file)
    with pytest.raises(SourceError, match="cannot be read"):
        read_baseline(tmp_path / "none.json")


def everything() -> list[CheckFinding]:
    found = []
    for i, rule in enumerate(RULES):
        found.append(CheckFinding(rule, "a b/ä.urdf", "joint 'a'", 'text <&"> \x00 ü', i))
    return numbered(found)


def test_the_addresses_of_sarif_are_those_in_the_repository(tmp_path, monkeypatch):
    (tmp_path / "repository/.git").mkdir(parents=True)
    folder = tmp_path / "repository/robots/my arms"
    folder.mkdir(parents=True)
    assert repository_prefix(folder) == "robots/my arms/"
    assert repository_prefix(tmp_path / "repository") == ""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bare").mkdir()
    assert repository_prefix(Path("bare")) == "bare/"  # no repository: seen from the current folder
    finding = CheckFinding("mesh/missing", "a {0}:\udcff.urdf", "", "mesh '{0}.stl' does not exist \udcff", 3)
    (result,) = sarif([finding], "robots/my arms/")["runs"][0]["results"]
    (location,) = result["locations"]
    address = location["physicalLocation"]["artifactLocation"]["uri"]
    assert address == "robots/my%20arms/a%20%7B0%7D%3A%FF.urdf"
    assert result["message"]["text"].startswith("mesh '{{0}}.stl' does not exist \ufffd")


def test_sarif_has_what_the_standard_requires():
    """Sections of SARIF 2.1.0 (OASIS, 2020): 3.13.2, 3.14.6, 3.19.2, 3.27.5, 3.27.6, 3.27.11, 3.30.5, 3.49.3."""
    log = json.loads(json.dumps(sarif(everything())))
    assert log["version"] == "2.1.0"
    (run,) = log["runs"]
    driver = run["tool"]["driver"]
    assert driver["name"]
    ids = [rule["id"] for rule in driver["rules"]]
    assert len(set(ids)) == len(ids)
    assert len(run["results"]) == len(RULES)
    for result in run["results"]:
        assert ids[result["ruleIndex"]] == result["ruleId"]
        assert result["level"] in ("none", "note", "warning", "error")
        assert result["message"]["text"]
        (location,) = result["locations"]
        physical = location["physicalLocation"]
        assert physical["region"]["startLine"] >= 1
        assert re.fullmatch(r"[A-Za-z0-9._~%/-]+", physical["artifactLocation"]["uri"])
        assert all(isinstance(value, str) for value in result["partialFingerprints"].values())
        assert result["baselineState"] in ("new", "unchanged", "updated", "absent")
    assert run["invocations"][0]["executionSuccessful"] is False


def test_junit_is_xml_with_a_failure_for_each_file_that_fails(tmp_path):
    text, _ = faulty("limits/order")
    repository(tmp_path, text)
    one = judged(tmp_path)
    root = ElementTree.fromstring(junit(one, numbered([*one[0].findings, *everything()]), "error"))
    (suite,) = root
    assert root.tag == "testsuites"
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "1", "1")
    assert [case.get("name") for case in suite.findall("testcase")] == ["a b/ä.urdf", "arm_description/urdf/arm.urdf"]
    assert suite[1][0].get("type") == "limits/order"


# -- the command ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_ends_with_zero_one_and_two(tmp_path, capsys):
    assert main(["check", str(CLEAN), "--quiet"]) == 0
    assert "1 description (1 urdf)" in capsys.readouterr().out
    text, _ = faulty("limits/order")
    repository(tmp_path / "robots", text)
    robots = str(tmp_path / "robots")
    sarif_file = tmp_path / "twin.sarif"
    junit_file = tmp_path / "twin.xml"
    options = ["--quiet", "--json", "--sarif", str(sarif_file), "--junit", str(junit_file)]
    assert main(["check", robots, *options]) == 1
    data = json.loads(capsys.readouterr().out)
    assert [row["rule"] for row in data["results"]] == ["limits/order"]
    (result,) = json.loads(sarif_file.read_text(encoding="utf-8"))["runs"][0]["results"]
    assert result["ruleId"] == "limits/order"
    assert ElementTree.parse(junit_file).getroot().get("failures") == "1"
    baseline = ["--quiet", "--baseline", str(tmp_path / "known.json")]
    assert main(["check", robots, *baseline, "--write-baseline"]) == 0
    assert main(["check", robots, *baseline]) == 0
    assert "1 known" in capsys.readouterr().out
    assert main(["check", robots, "--exclude", "arm_description"]) == 2  # no robot is left


@pytest.mark.parametrize("option", ["--sarif", "--junit"])
def test_a_description_is_not_replaced_by_what_was_found_in_it(option, tmp_path, capsys):
    text, _ = faulty("limits/order")
    repository(tmp_path, text)
    (urdf,) = tmp_path.rglob("*.urdf")
    assert main(["check", str(tmp_path), "--quiet", option, str(urdf)]) == 2
    said = capsys.readouterr()
    assert "is a description that was checked: name another file" in said.out + said.err
    assert urdf.read_text(encoding="utf-8") == text


def test_bad_usage(tmp_path, capsys):
    assert main(["check", str(tmp_path / "none")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert main(["check", str(CLEAN), "--write-baseline"]) == 2
    assert "--baseline FILE" in capsys.readouterr().err


@pytest.mark.slow
def test_warnings_fail_only_if_asked(tmp_path):
    text, _ = faulty("limits/velocity")
    repository(tmp_path, text)
    assert check(tmp_path).exit_code == 0
    assert check(tmp_path, fail_on="warning").exit_code == 1


@pytest.mark.slow
def test_a_file_that_takes_too_long_is_not_judged_and_the_others_are(tmp_path):
    repository(tmp_path)
    result = check(tmp_path, seconds=1e-6)
    assert result.exit_code == 2
    (finding,) = result.found
    assert finding.rule == "file/unjudged"
    assert "(--seconds)" in finding.message


SHELL = re.compile(r"^ +run: (twin check .*)$", re.MULTILINE)


@pytest.mark.slow
def test_the_shell_line_of_the_action_runs(tmp_path):
    page = (Path(__file__).parents[2] / "docs/check.md").read_text(encoding="utf-8")
    (line,) = SHELL.findall(page)
    line = line.replace("twin check", f"{shlex.quote(sys.executable)} -m twin check")
    env = os.environ | {"FOLDER": str(CLEAN), "OPTIONS": "--fail-on warning --no-compare"}
    subprocess.run(["bash", "-eo", "pipefail", "-c", line], cwd=tmp_path, env=env, check=True, capture_output=True)
    assert (tmp_path / "twin.sarif").is_file()
    assert (tmp_path / "twin.xml").is_file()


def test_the_action_and_the_hook_are_yaml_with_what_their_programs_need():
    root = Path(__file__).parents[2]
    blocks = re.findall(r"```yaml\n(.*?)```", (root / "docs/check.md").read_text(encoding="utf-8"), re.DOTALL)
    hooks, action, workflow = (yaml.safe_load(block) for block in blocks)
    (hook,) = hooks["repos"][0]["hooks"]
    assert hook["id"] == "twin-check"
    assert {"name", "entry", "language", "additional_dependencies"} <= set(hook)
    assert re.search(hook["files"], "urdf/arm.urdf.xacro")
    assert action["runs"]["using"] == "composite"
    for step in action["runs"]["steps"]:
        assert "uses" in step or "shell" in step
    assert workflow["permissions"]["security-events"] == "write"
