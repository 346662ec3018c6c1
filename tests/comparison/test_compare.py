"""`twin compare`: right pairs are never accused, wrong numbers are found and located, conventions are resolved."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import twin
from made import errata
from twin.cli import main
from twin.core.errors import TwinError

LENGTHS = (0.15, 0.3, 0.25, 0.2, 0.1, 0.08)


def arm(
    *,
    z3: float = 0.25,
    rpy4: str = "0 0 0",
    axis6: str = "0 0 1",
    base: str = "0 0 0.15",
    zero2: float = 0.0,
    upper5: float = 2.0,
    speed1: float = 2.0,
    mass4: float = 3.0,
    tool: str = "0 0 0.08",
    name: str = "joint_",
) -> str:
    """Return the URDF of a six-joint arm, with one number of each kind to change."""
    places = [
        (base, "0 0 0", "0 0 1"),
        ("0.05 0 0.3", f"0 {zero2} 0", "0 1 0"),
        (f"0 0.02 {z3}", "0 0 0", "0 1 0"),
        ("0.2 0 0.03", rpy4, "1 0 0"),
        ("0.1 0 0", "0 0 0", "0 1 0"),
        ("0.09 0 0", "0 1.5707963267948966 0", axis6),
    ]
    lines = ['<robot name="arm">', '<link name="base_link"/>']
    for i, (xyz, rpy, axis) in enumerate(places, 1):
        parent = "base_link" if i == 1 else f"link_{i - 1}"
        upper = upper5 if i == 5 else 2.5
        mass = mass4 if i == 4 else 1.0 + 0.1 * i
        lines += [
            f'<link name="link_{i}"><inertial><origin xyz="0 0 0.05"/><mass value="{mass}"/>',
            '<inertia ixx="0.01" iyy="0.012" izz="0.009" ixy="0" ixz="0" iyz="0"/></inertial></link>',
            f'<joint name="{name}{i}" type="revolute"><parent link="{parent}"/><child link="link_{i}"/>',
            f'<origin xyz="{xyz}" rpy="{rpy}"/>',
            f'<axis xyz="{axis}"/>',
            f'<limit lower="-2.5" upper="{upper}" velocity="{speed1 if i == 1 else 2.0}" effort="50"/></joint>',
        ]
    lines += [
        '<link name="flange"/>',
        '<joint name="flange_joint" type="fixed"><parent link="link_6"/><child link="flange"/>',
        f'<origin xyz="{tool}"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines)


def pair(folder: Path, **changed: object) -> tuple[Path, Path]:
    first = folder / "first.urdf"
    second = folder / "second.urdf"
    first.write_text(arm(**changed))  # pyright: ignore[reportArgumentType]
    second.write_text(arm())
    return first, second


def test_the_same_robot_agrees(tmp_path: Path) -> None:
    result = twin.compare(*pair(tmp_path))
    assert result.verdict == "agree"
    assert result.pairs[0].kinematics == "agree"
    assert result.findings == []


def test_a_wrong_length_is_found_at_its_joint(tmp_path: Path) -> None:
    result = twin.compare(*pair(tmp_path, z3=0.27))
    found = result.pairs[0]
    assert result.verdict == "disagree"
    assert [item.joint for item in found.differences] == ["joint_3"]
    assert found.differences[0].shift == pytest.approx(0.02, abs=1e-9)
    assert found.conventions == ()
    assert found.worst is not None
    assert found.worst.distance == pytest.approx(0.02, rel=1e-6)


def test_a_wrong_rotation_is_found_at_its_joint(tmp_path: Path) -> None:
    found = twin.compare(*pair(tmp_path, rpy4="0 0 0.1")).pairs[0]
    assert [item.joint for item in found.differences] == ["joint_4"]
    assert found.differences[0].turn == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("changed", "kind", "joint"),
    [
        ({"axis6": "0 0 -1"}, "sign", "joint_6"),
        ({"zero2": 0.4}, "zero", "joint_2"),
        ({"base": "0 0 0.35"}, "base frame", ""),
        ({"tool": "0 0 0.10"}, "tool frame", "joint_6"),
    ],
)
def test_conventions_are_named_and_are_no_disagreement(
    tmp_path: Path, changed: dict[str, object], kind: str, joint: str
) -> None:
    files = pair(tmp_path, **changed)
    result = twin.compare(*files)
    found = result.pairs[0]
    assert [(item.kind, item.joint) for item in found.conventions] == [(kind, joint)]
    assert found.kinematics == "agree after conventions"
    assert not [f for f in result.findings if f.code == "compare.link"]
    assert twin.compare(*files, strict=True).verdict == "disagree"


def test_other_joint_names_are_matched_by_structure(tmp_path: Path) -> None:
    found = twin.compare(*pair(tmp_path, name="axis_a")).pairs[0]
    assert {item.kind for item in found.conventions} == {"name"}
    assert found.agrees


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"upper5": 1.9}, "compare.limits"),
        ({"speed1": 1.9}, "compare.speeds"),
        ({"mass4": 30.0}, "compare.masses"),
    ],
)
def test_properties_have_their_own_verdicts(tmp_path: Path, changed: dict[str, object], code: str) -> None:
    result = twin.compare(*pair(tmp_path, **changed))
    assert [f.code for f in result.findings] == [code]
    assert result.pairs[0].kinematics == "agree"


def test_of_three_sides_the_lonely_one_is_named(tmp_path: Path) -> None:
    first, second = pair(tmp_path, z3=0.2)
    third = tmp_path / "third.urdf"
    third.write_text(arm())
    result = twin.compare(first, second, third)
    assert result.alone == "first.urdf"


def test_different_numbers_of_joints_name_the_way_out(tmp_path: Path) -> None:
    first, second = pair(tmp_path)
    text = second.read_text().replace('name="joint_6" type="revolute"', 'name="joint_6" type="fixed"')
    second.write_text(text)
    with pytest.raises(TwinError, match=r"joint_6.*--only joint_1"):
        twin.compare(first, second)
    only = [f"joint_{i}" for i in range(1, 6)]
    assert twin.compare(first, second, only=only).verdict == "agree"


@pytest.mark.parametrize("rpy", [pytest.param("0 1.5708 0", marks=pytest.mark.slow), "0.3 -0.7 1.1"])
def test_an_edit_of_a_turned_element_removes_the_difference(tmp_path: Path, rpy: str) -> None:
    first = errata.written("kuka_iiwa14_lengths", tmp_path / "first", corrected=True)
    second = errata.written("kuka_iiwa14_lengths", tmp_path / "second", corrected=True)
    place = 'xyz="0 0 0.2155" rpy="0 0 0"'
    macros = [path.with_name("kuka_iiwa14_lengths_macro.xacro") for path in (first, second)]
    for macro, length in zip(macros, ("0.2155", "0.2455"), strict=True):
        text = macro.read_text().replace(place, f'xyz="0 0 {length}" rpy="{rpy}"', 1)
        macro.write_text(text)
    (item,) = twin.compare(first, second).pairs[0].items
    assert (item.edits[0].old, item.edits[0].new) == ("0.2155", "0.2455")
    lines = macros[0].read_text().splitlines()
    lines[item.edits[0].line - 1] = lines[item.edits[0].line - 1].replace(item.edits[0].old, item.edits[0].new)
    macros[0].write_text("\n".join(lines))
    assert twin.compare(first, second).verdict == "agree"


def _two_joints(file: Path, parent: str) -> Path:
    """Write a URDF whose second joint begins at a link, at the same place in the drawn pose."""
    links = "".join(f'<link name="link_{k}"/>' for k in range(3))
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
    joints = (
        '<joint name="joint_1" type="revolute"><parent link="link_0"/><child link="link_1"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
        f'<joint name="joint_2" type="revolute"><parent link="{parent}"/><child link="link_2"/>'
        f'<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>{limit}</joint>'
    )
    file.write_text(f'<robot name="two">{links}{joints}</robot>', encoding="utf-8")
    return file


def test_a_joint_on_another_link_is_no_agreement(tmp_path: Path) -> None:
    first = _two_joints(tmp_path / "a.urdf", "link_1")
    second = _two_joints(tmp_path / "b.urdf", "link_0")
    with pytest.raises(TwinError, match=r"joint 'joint_2' of .* connect different links"):
        twin.compare(first, second)
    assert twin.compare(first, _two_joints(tmp_path / "c.urdf", "link_1")).verdict == "agree"


def test_no_common_range_is_an_error(tmp_path: Path) -> None:
    first, second = pair(tmp_path)
    lower = 'lower="-2.5" upper="2.0"'
    second.write_text(second.read_text().replace(lower, 'lower="2.2" upper="2.4"'))
    with pytest.raises(TwinError, match="joint 'joint_5' has no common range"):
        twin.compare(first, second)


def test_the_command_prints_verdict_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(path) for path in pair(tmp_path, z3=0.27)]
    assert main(["compare", *files]) == 1
    assert "place of joint 'joint_3' on link 'link_2' differs by 20 mm" in capsys.readouterr().out
    assert main(["compare", *files, "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "twin/compare/1"
    assert data["pairs"][0]["differences"][0]["shift_mm"] == pytest.approx(20.0)
    assert main(["compare", files[0]]) == 2
    assert "at least two sides" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("robot", "edits"),
    [
        ("kuka_iiwa14_lengths", [("joint_1", "0.1375", "0.1575"), ("joint_3", "0.1845", "0.2045")]),
        ("fanuc_lrmate200id_axis6", [("joint_6", "1", "-1")]),
        ("fanuc_m710ic50_axis6", [("joint_6", "1", "-1")]),
    ],
)
def test_public_errors_are_named_with_file_and_line(
    robot: str, edits: list[tuple[str, str, str]], tmp_path: Path
) -> None:
    before = errata.written(robot, tmp_path / "before", corrected=False)
    after = errata.written(robot, tmp_path / "after", corrected=True)
    found = twin.compare(before, after).pairs[0]
    lines = (tmp_path / "before" / f"{robot}_macro.xacro").read_text().splitlines()
    named = []
    for item in found.items:
        edit = item.edits[0]
        assert edit.file.endswith("_macro.xacro")
        opened = [line for line in lines[: edit.line] if "<joint " in line][-1]
        named.append((opened.split('"')[1], edit.old, edit.new))
    assert named == edits


def test_a_page_shows_both_robots(tmp_path: Path) -> None:
    files = [str(path) for path in pair(tmp_path, z3=0.27)]
    assert main(["compare", *files, "--out", str(tmp_path / "out")]) == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"compare.html", "compare.json", "compare.png"}
