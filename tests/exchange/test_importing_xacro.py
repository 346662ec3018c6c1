"""Xacro is expanded in a process with limits, without ROS; poses are those of other readers of the expanded text."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from made import errata
from twin import cli
from twin.core.errors import BudgetError, CodeRefusedError, SourceError, TwinError
from twin.core.foreign import budget, consent
from twin.core.foreign.budget import Budget
from twin.exchange.audit import audit
from twin.exchange.formats.urdf.format import robots
from twin.exchange.read import read
from twin.exchange.read.imported_robot import rest_poses
from twin.exchange.xacro import XacroSettings, expand, is_xacro, settings

HERE = Path(__file__).parents[1]

MACRO = """<robot xmlns:xacro="http://ros.org/wiki/xacro">
<xacro:include filename="$(find arm_parts)/urdf/constants.xacro"/>
<xacro:macro name="arm" params="prefix parent lengths:='0.3 0.2 0.1' *place">
<joint name="${prefix}mount" type="fixed"><xacro:insert_block name="place"/>
<parent link="${parent}"/><child link="${prefix}l0"/></joint>
<link name="${prefix}l0"/>
<xacro:chain prefix="${prefix}" n="1" left="${lengths.split()}"/>
</xacro:macro>
<xacro:macro name="chain" params="prefix n left">
<link name="${prefix}l${n}"><inertial><mass value="${1/n}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="${prefix}q${n}" type="revolute"><parent link="${prefix}l${n-1}"/><child link="${prefix}l${n}"/>
<origin xyz="0.01 0 ${left[0]}" rpy="${quarter*(n%2)} 0 ${radians(10)}"/><axis xyz="0 ${n%2} ${1-n%2}"/>
<limit lower="${-quarter}" upper="${quarter}" velocity="2" effort="10"/></joint>
<xacro:if value="${len(left) > 1}"><xacro:chain prefix="${prefix}" n="${n+1}" left="${left[1:]}"/></xacro:if>
</xacro:macro>
</robot>
"""
MAIN = """<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="height" default="0"/>
<xacro:arg name="reach" default="0.3"/>
<xacro:include filename="arm.xacro"/>
<link name="table"/>
<xacro:arm prefix="left_" parent="table"><origin xyz="0 0.4 $(arg height)"/></xacro:arm>
<xacro:unless value="$(eval reach == 0)"><xacro:arm prefix="right_" parent="table" lengths="$(arg reach) 0.2">
<origin xyz="0 -0.4 0" rpy="0 0 ${pi}"/></xacro:arm></xacro:unless>
</robot>
"""
CONSTANTS = """<robot xmlns:xacro="http://ros.org/wiki/xacro">
<xacro:property name="quarter" value="${pi/2}"/></robot>
"""


@pytest.fixture
def two_arms(tmp_path):
    """Return a xacro in a package that needs a file of another package, which is beside it."""
    for package, files in {
        "arm_robot": {"urdf/two.xacro": MAIN, "urdf/arm.xacro": MACRO},
        "parts_in_a_folder_of_another_name": {"urdf/constants.xacro": CONSTANTS},
    }.items():
        folder = tmp_path / "src" / package
        (folder / "urdf").mkdir(parents=True)
        name = "arm_parts" if package.startswith("parts") else package
        (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
        for file, text in files.items():
            (folder / file).write_text(text)
    return tmp_path / "src/arm_robot/urdf/two.xacro"


def assert_poses_of_pinocchio(mechanism, text, rng, renamed=()):
    """Compare all bodies at random joint values with Pinocchio's own reader of the expanded text."""
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    names = {body: body for body in (b.name for b in mechanism.bodies)} | dict(renamed)
    for _ in range(20):
        q = pinocchio.neutral(model)
        values = {}
        for name, index, size in zip(model.names[1:], model.idx_qs[1:], model.nqs[1:], strict=False):
            assert size == 1
            values[name.replace("-", "_")] = q[index] = rng.uniform(-2, 2)
        pinocchio.framesForwardKinematics(model, data, q)
        for body, T in rest_poses(mechanism, values).items():
            frame = model.getFrameId(names[body])
            assert frame < model.nframes, body
            np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-9)


def test_macros_blocks_conditions_and_recursion_are_expanded(two_arms, rng):
    assert is_xacro(two_arms)
    found = read(two_arms)
    assert [j.name for j in found.mechanism.active] == ["left_q1", "left_q2", "left_q3", "right_q1", "right_q2"]
    assert found.mechanism.name == "two"
    assert_poses_of_pinocchio(found.mechanism, expand(two_arms, XacroSettings()).data.decode(), rng)


def test_arguments_are_texts_of_the_user(two_arms):
    given = settings(["height:=0.7", "reach:=0"], [])
    found = read(two_arms, xacro=given)
    assert found.mechanism.rest["left_l1"][2, 3] == pytest.approx(0.7 + 0.3)
    assert [j.name for j in found.mechanism.active] == ["left_q1", "left_q2", "left_q3"]
    with pytest.raises(SourceError, match=r"--arg reach=0: expected name:=value"):
        settings(["reach=0"], [])
    with pytest.raises(SourceError, match=r"--packages nowhere: the folder does not exist"):
        settings([], ["nowhere"])


def test_each_number_has_the_file_and_line_where_it_was_written(two_arms):
    places = read(two_arms).places
    file, line = places["joint/right_q2/origin"]
    assert (Path(file).name, "<origin" in MACRO.splitlines()[line - 1]) == ("arm.xacro", True)
    file, line = places["joint/right_mount/origin"]
    assert (Path(file).name, MAIN.splitlines()[line - 1]) == ("two.xacro", MAIN.splitlines()[7])


@pytest.mark.parametrize("way", ["packages", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "the package itself"])
def test_packages_are_found_without_ros(two_arms, tmp_path, monkeypatch, way):
    parts = two_arms.parents[2] / "parts_in_a_folder_of_another_name"
    elsewhere = tmp_path / "elsewhere"
    target = elsewhere / ("share/arm_parts" if way == "AMENT_PREFIX_PATH" else "deep/parts")
    target.parent.mkdir(parents=True)
    parts.rename(target)
    with pytest.raises(SourceError, match=r"arm\.xacro:13: name 'quarter' is not defined .* \(arm_parts\): give its"):
        read(two_arms)
    given = XacroSettings()
    if way == "packages":
        given = settings([], [str(elsewhere)])
    elif way == "the package itself":
        given = settings([], [str(target)])
    else:
        monkeypatch.setenv(way, f"/nowhere{os.pathsep}{elsewhere}")
    assert len(read(two_arms, xacro=given).mechanism.active) == 5


OWN = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm">
<xacro:include filename="$(find own_parts)/length.xacro"/>
<link name="base"/><link name="tip"/>
<joint name="q1" type="prismatic"><parent link="base"/><child link="tip"/><origin xyz="${length} 0 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_two_versions_of_a_package_are_not_mixed(tmp_path):
    """A file finds its own package there, also if another version of it is in the folders of packages."""
    for version, length in (("before", 0.1), ("after", 0.2)):
        folder = tmp_path / version / "own_parts"
        folder.mkdir(parents=True)
        (folder / "package.xml").write_text("<package><name>own_parts</name></package>")
        text = f'<robot xmlns:xacro="x"><xacro:property name="length" value="{length}"/></robot>'
        (folder / "length.xacro").write_text(text.replace('"x"', '"http://www.ros.org/wiki/xacro"'))
        (folder / "arm.xacro").write_text(OWN)
    given = settings([], [str(tmp_path / "before"), str(tmp_path / "after")])
    for version, length in (("before", 0.1), ("after", 0.2)):
        mechanism = read(tmp_path / version / "own_parts/arm.xacro", xacro=given).mechanism
        assert mechanism.joint("q1").T_parent_joint[0, 3] == length


def test_what_only_a_missing_package_can_draw_is_left_out_with_a_warning(tmp_path):
    path = tmp_path / "arm.urdf"  # recognised by its content
    text = (HERE / "data/importing/error_macro_undefined.xacro").read_text().replace('"slide"', '"hinge"')
    text = text.replace("0.1 * 3", "m_pi_2").replace(
        '<link name="base"/>',
        '<xacro:include filename="$(find looks)/colours.xacro"/><link name="base"><visual><geometry>'
        '<box size="1 1 1"/></geometry><xacro:blue/></visual></link>',
    )
    path.write_text(text)
    found = read(path)
    told = [f.message for f in found.findings if f.code == "import.xacro"]
    assert told == [
        "arm.urdf:7: package 'looks' was not found, its file is not included.",
        "arm.urdf:7: <xacro:blue> is defined by no file that was found, and is left out.",
        "'m_pi_2' is defined by no file that was found, and is 1.5707963267948966, as its name says.",
    ]
    assert found.mechanism.joint("q1").T_parent_joint[2, 3] == np.pi / 2
    path.write_text(text.replace("</visual>", "</visual><xacro:blue/>"))  # it could be a mass
    with pytest.raises(SourceError, match=r"arm\.urdf:7: unknown macro name: xacro:blue.*\(looks\): give its folder"):
        read(path)


def test_meshes_of_found_packages_are_read(tmp_path):
    import trimesh

    package = tmp_path / "src/looks"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>looks</name></package>")
    trimesh.creation.box((1, 2, 3)).export(package / "box.stl")
    path = tmp_path / "arm.xacro"
    mesh = '<visual><geometry><mesh filename="package://looks/box.stl"/></geometry></visual>'
    text = (HERE / "data/importing/error_macro_undefined.xacro").read_text().replace('"slide"', '"hinge"')
    path.write_text(text.replace('<link name="base"/>', f'<link name="base">{mesh}</link>'))
    assert [f.code for f in read(path).findings if f.severity == "warning"].count("import.mesh") == 1
    (box,) = read(path, xacro=settings([], [str(tmp_path / "src")])).mechanism.body("base").meshes
    assert np.ptp(box.vertices, axis=0) == pytest.approx([1, 2, 3])


def test_no_code_refuses_the_expressions(two_arms, monkeypatch, caplog, tmp_path, capsys):
    monkeypatch.setattr(consent, "_announced_files", set())
    caplog.set_level("INFO")
    read(two_arms)
    assert f"running the Python expressions of the xacro in {two_arms}" in caplog.text
    monkeypatch.setenv(consent.NO_CODE, "1")
    with pytest.raises(CodeRefusedError, match=r"two\.xacro: reading this file runs the Python expressions"):
        read(two_arms)
    assert cli.main(["new", "two", str(two_arms), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert "two.xacro: reading this file runs the Python expressions" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("expression", "limits", "message"),
    [
        ("9**9**9", Budget(10**6, seconds=0.5, memory=10**9), "exceeded its limit of 0 s of processor time"),
        ("len(list(range(10**8)))", Budget(10**6, seconds=5, memory=3 * 10**8), "not enough memory|limit of 300 MB"),
    ],
)
def test_an_expression_has_a_budget_of_time_and_memory(tmp_path, monkeypatch, expression, limits, message):
    path = tmp_path / "arm.xacro"
    path.write_text(f'<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><link name="${{{expression}}}"/></robot>')
    monkeypatch.setitem(budget.BUDGETS, "xacro", limits)
    with pytest.raises((BudgetError, SourceError), match=rf"arm\.xacro.*({message})"):
        read(path)


def test_options_of_a_xacro_are_refused_for_other_files():
    good = HERE / "data/importing/good.urdf"
    with pytest.raises(SourceError, match=r"good\.urdf: this is a URDF without expressions of xacro: omit --arg"):
        read(good, xacro=settings(["a:=1"], []))
    with pytest.raises(SourceError, match=r"good\.sdf: --arg and --packages are for a xacro"):
        read(good.with_suffix(".sdf"), xacro=settings(["a:=1"], []))


def test_files_for_others_to_include_are_no_robots(two_arms):
    files = sorted(two_arms.parent.iterdir())
    assert robots(files) == [two_arms]
    report = audit(two_arms.parents[1], xacro=settings(["reach:=0"], []))
    (content,) = report.files
    assert content["file"].endswith("two.xacro")
    assert not [f for f in report.findings if f.severity == "error"], report.findings


def test_a_xacro_without_consent_leaves_the_audit_of_the_other_files(two_arms, tmp_path, monkeypatch):
    shutil.copy(HERE / "data/importing/good.urdf", two_arms.parent / "good.urdf")
    monkeypatch.setenv("TWIN_NO_CODE", "1")
    report = audit(two_arms.parent)
    assert sorted(Path(content["file"]).name for content in report.files) == ["good.urdf"]
    (refused,) = [f for f in report.findings if f.code == "urdf.xacro"]
    assert refused.severity == "error"
    assert "two.xacro" in refused.message


def test_new_makes_a_folder_from_a_xacro(two_arms, tmp_path, capsys):
    target = tmp_path / "two"
    assert cli.main(["new", "two", str(two_arms), "--arg", "reach:=0", "--out", str(target), "--quiet"]) == 0
    assert "3 driven" in capsys.readouterr().out
    assert "two.xacro" in (target / "IMPORT.md").read_text()


# -- published robots, with the numbers of tests/kinerrata ------------------------------------------------

PAIRS = {
    "kuka_iiwa14_lengths": (7, ("joint_1", 2, 0.1375, 0.1575)),
    "fanuc_lrmate200id_axis6": (6, ("joint_6", 0, 1, -1)),
    "fanuc_m710ic50_axis6": (6, ("joint_6", 0, 1, -1)),
}


@pytest.mark.parametrize("state", ["before", "after"])
@pytest.mark.parametrize("name", PAIRS)
def test_published_robots_are_read_from_their_xacro(name, state, rng, tmp_path):
    path = errata.written(name, tmp_path / state, corrected=state == "after")
    found = read(path)
    assert len(found.mechanism.active) == PAIRS[name][0]
    assert not [f for f in found.findings if f.severity == "error"]
    text = expand(path, XacroSettings()).data.decode()
    renamed = {b.name: f.where for b in found.mechanism.bodies for f in found.findings if f.message.find(b.name) > 0}
    renamed = {body: link for body, link in renamed.items() if re.sub(r"\W", "_", link.lower()) == body}
    assert_poses_of_pinocchio(found.mechanism, text, rng, renamed.items())


@pytest.mark.parametrize("name", PAIRS)
def test_the_correction_of_a_published_robot_has_a_file_and_a_line(name, tmp_path):
    joint, axis, wrong, right = PAIRS[name][1]
    for state, value in (("before", wrong), ("after", right)):
        found = read(errata.written(name, tmp_path / state, corrected=state == "after"))
        file, line = found.places[f"joint/{joint}/{'origin' if isinstance(wrong, float) else 'axis'}"]
        numbers = re.findall(r"(?<=xyz=\")[^\"]+", Path(file).read_text().splitlines()[line - 1])[0].split()
        assert float(numbers[axis]) == value


def test_every_bad_xacro_leaves_no_process_behind(tmp_path):
    path = tmp_path / "empty.xacro"
    path.write_text("")
    with pytest.raises(TwinError, match=r"empty\.xacro: the file is not XML"):
        read(path)
