"""Kinds of robots for which `twin compare` once gave a wrong answer, each drawn by a seeded generator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import twin
from made import chains
from made.lanes import thinned
from twin.comparison.mechanism_side import from_mechanism
from twin.comparison.pair import compare_pair
from twin.comparison.pose_comparison import compare_rows
from twin.comparison.side import PoseRows, RobotSide, plain_name
from twin.core.errors import TwinError
from twin.exchange.read import read

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def robot(file: Path, joints: list[dict[str, str]]) -> Path:
    """Write a URDF of one chain; each joint has name, and type, xyz, rpy, axis, limits, mimic if they differ."""
    lines = ['<robot name="made"><link name="base"/>']
    parent = "base"
    for i, joint in enumerate(joints, 1):
        given = {"type": "revolute", "xyz": "0 0 0.1", "rpy": "0 0 0", "axis": "0 0 1", "limits": "-1 1", **joint}
        low, high = given["limits"].split()
        lines += [
            f'<link name="link{i}">{INERTIAL}</link>',
            f'<joint name="{given["name"]}" type="{given["type"]}"><parent link="{parent}"/><child link="link{i}"/>',
            f'<origin xyz="{given["xyz"]}" rpy="{given["rpy"]}"/><axis xyz="{given["axis"]}"/>',
            f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{given.get("mimic", "")}</joint>',
        ]
        parent = f"link{i}"
    file.write_text("\n".join([*lines, "</robot>"]), encoding="utf-8")
    return file


def mimic(leader: str, ratio: float, offset: float = 0.0) -> str:
    return f'<mimic joint="{leader}" multiplier="{ratio!r}" offset="{offset!r}"/>'


def finger(*mimics: str) -> list[dict[str, str]]:
    """Return three joints, each coupled as stated ("" is free)."""
    return [
        {"name": name, "mimic": text, "axis": axis, "limits": "-9 9"}
        for name, text, axis in zip("abc", mimics, ("0 0 1", "0 1 0", "1 0 0"), strict=True)
    ]


@pytest.mark.parametrize("seed", thinned(range(3), 3))
def test_the_same_coupling_under_another_leader_agrees(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([seed, 40])
    to_b, to_c = (float(x) for x in rng.uniform(0.3, 2.0, 2) * rng.choice([-1.0, 1.0], 2))
    offset = float(rng.uniform(-0.3, 0.3))
    chain = robot(tmp_path / "chain.urdf", finger("", mimic("a", to_b, offset), mimic("b", to_c)))
    star = robot(tmp_path / "star.urdf", finger("", mimic("a", to_b, offset), mimic("a", to_b * to_c, to_c * offset)))
    other = robot(tmp_path / "other.urdf", finger(mimic("b", 1 / to_b, -offset / to_b), "", mimic("b", to_c)))
    result = twin.compare(chain, star, other)
    assert [pair.properties.verdict("couplings") for pair in result.pairs if pair.properties] == ["agree"] * 3
    wrong = robot(tmp_path / "wrong.urdf", finger(mimic("b", to_b, -offset * to_b), "", mimic("b", to_c)))
    assert twin.compare(chain, wrong).verdict == "disagree"


def test_a_coupling_that_one_side_lacks_is_no_agreement(tmp_path: Path) -> None:
    coupled = robot(tmp_path / "coupled.urdf", finger("", mimic("a", 2.0), ""))
    free = robot(tmp_path / "free.urdf", finger("", "", ""))
    result = twin.compare(coupled, free)
    assert result.verdict == "disagree"
    (row,) = result.pairs[0].properties.rows  # pyright: ignore[reportOptionalMemberAccess]
    assert (row.where, row.first, row.second) == ("b", "2 × a", "moves freely")


@pytest.mark.parametrize("limits", ["0 20", "-3 16", "-30 30"])
def test_limits_that_are_no_full_turn_apart_move_no_zero(limits: str, tmp_path: Path) -> None:
    first = robot(tmp_path / "first.urdf", [{"name": "a", "limits": "-10 10"}, {"name": "b", "axis": "0 1 0"}])
    second = robot(tmp_path / "second.urdf", [{"name": "a", "limits": limits}, {"name": "b", "axis": "0 1 0"}])
    found = twin.compare(first, second).pairs[0]
    assert found.items == ()
    assert found.properties is not None
    assert found.properties.verdict("limits") == "disagree"


def test_names_that_differ_in_a_sign_between_digits_are_two_joints(tmp_path: Path) -> None:
    assert plain_name("j1_1") != plain_name("j_11")
    assert plain_name("Joint 1-2") == plain_name("joint_1_2")
    joints = [{"name": "j1_1"}, {"name": "j_11", "axis": "0 1 0"}]
    first = robot(tmp_path / "first.urdf", joints)
    longer = [dict(joints[0]), {**joints[1], "xyz": "0.04 0 0.1"}]
    found = twin.compare(first, robot(tmp_path / "second.urdf", longer)).pairs[0]
    assert [item.joint for item in found.items] == ["j_11"]
    assert {edit.what for edit in found.items[0].edits} == {"joint 'j_11' origin xyz[0]"}


def test_a_joint_of_another_type_is_named(tmp_path: Path) -> None:
    first = robot(tmp_path / "first.urdf", [{"name": "a"}, {"name": "b", "type": "prismatic"}])
    second = robot(tmp_path / "second.urdf", [{"name": "a"}, {"name": "b"}])
    with pytest.raises(TwinError, match=r"joint 'b' is prismatic in first\.urdf, revolute in second\.urdf"):
        twin.compare(first, second)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("inf"), float("nan"), 1.0])
def test_a_tolerance_with_which_all_robots_agree_is_refused(tolerance: float, tmp_path: Path) -> None:
    file = robot(tmp_path / "a.urdf", [{"name": "a"}])
    with pytest.raises(TwinError, match="tolerance"):
        twin.compare(file, file, tolerance=tolerance)


def test_joints_to_compare_are_found_in_the_spelling_of_each_side(tmp_path: Path) -> None:
    first = robot(
        tmp_path / "first.urdf", [{"name": "Joint_1"}, {"name": "Joint_2", "axis": "0 1 0"}, {"name": "grip"}]
    )
    second = robot(tmp_path / "second.urdf", [{"name": "joint1"}, {"name": "joint2", "axis": "0 1 0"}])
    assert twin.compare(first, second, only=["joint-1", "joint-2"]).pairs[0].agrees
    with pytest.raises(TwinError, match="Did you mean 'joint_2'"):
        twin.compare(first, second, only=["Joint_3"])


@pytest.mark.parametrize("seed", thinned(range(3), every=3))
def test_a_direction_without_effect_on_the_lines_stays_in_place(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([seed, 41])
    joints = [
        {"name": "a", "type": "prismatic", "axis": "1 0 0"},
        {"name": "b", "type": "prismatic", "axis": "0 1 0"},
        {"name": "c", "axis": "0 0 1"},
    ]
    first = robot(tmp_path / "first.urdf", joints)
    tilt = float(rng.uniform(0.05, 0.4))
    turned = [joints[0], {**joints[1], "rpy": f"0 0 {tilt!r}"}, joints[2]]
    found = twin.compare(first, robot(tmp_path / "second.urdf", turned)).pairs[0]
    assert found.kinematics == "disagree"
    assert max(item.shift for item in found.items) < 0.5


@pytest.mark.parametrize("axis", ["-1 0 0", *(pytest.param(a, marks=pytest.mark.slow) for a in ("0 1 0", "0 0 -1"))])
@pytest.mark.parametrize("joint", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_an_axis_that_alone_is_wrong_has_its_edit(joint: int, axis: str, tmp_path: Path) -> None:
    joints = [
        {"name": f"joint_{i}", "xyz": xyz, "axis": direction, "limits": f"-1 {1 + 0.1 * i}"}
        for i, (xyz, direction) in enumerate(
            [
                ("0 0 0.3", "0 0 1"),
                ("0.1 0 0.2", "0 1 0"),
                ("0 0 0.4", "1 0 0"),
                ("0.3 0 0.05", "0 1 0"),
                ("0.2 0.1 0", "0 0 1"),
                ("0.1 0 0", "1 0 0"),
            ]
        )
    ]
    right = robot(tmp_path / "right.urdf", joints)
    joints[joint] = {**joints[joint], "axis": axis}
    wrong = robot(tmp_path / "wrong.urdf", joints)
    found = twin.compare(wrong, right).pairs[0]
    (item,) = found.items
    assert item.joint == f"joint_{joint}"
    (edit,) = [edit for edit in item.edits if edit.side == "wrong.urdf"][:1]
    assert edit.what.startswith(f"joint 'joint_{joint}' axis xyz")
    assert edit.new in ("1 0 0", "1")


def cable(file: Path, second_ratio: float) -> Path:
    """Write an MJCF of three joints whose sum j1 + second_ratio j2 + j3 is constant."""
    bodies = ""
    for name, axis in (("j1", "0 0 1"), ("j2", "0 1 0"), ("j3", "1 0 0")):
        bodies += f'<body name="{name}_body" pos=".2 0 0"><joint name="{name}" axis="{axis}"/><geom size=".02"/>'
    tendon = f'<joint joint="j1" coef="1"/><joint joint="j2" coef="{second_ratio}"/><joint joint="j3" coef="1"/>'
    file.write_text(
        f'<mujoco model="r"><worldbody>{bodies}{"</body>" * 3}</worldbody><tendon><fixed name="t">{tendon}</fixed>'
        '</tendon><equality><tendon tendon1="t"/></equality></mujoco>'
    )
    return file


def cable_side(folder: Path, second_ratio: float, only: tuple[str, ...] = ()) -> RobotSide:
    """Return the side of a cable, whose file is read in this process."""
    file = cable(folder / "cable.xml", second_ratio)
    return from_mechanism(read(file, guarded=False).mechanism, f"cable {second_ratio}", only=only)


def test_a_coupling_of_three_joints_is_compared(tmp_path: Path) -> None:
    first = cable_side(tmp_path, 1.0)
    properties = compare_pair(first, cable_side(tmp_path, 5.0), 1e-5).properties
    assert properties is not None
    (row,) = properties.rows
    assert (row.kind, row.where, row.first, row.second) == ("couplings", "j1", "-1 × j2 + -1 × j3", "-5 × j2 + -1 × j3")
    assert properties.verdict("couplings") == "disagree"
    same = compare_pair(first, cable_side(tmp_path, 1.0), 1e-5).properties
    assert same is not None
    assert same.verdict("couplings") == "agree"


@pytest.mark.parametrize(("only", "verdict"), [(("j1", "j3"), "agree"), (("j1", "j2"), "disagree")])
def test_joints_that_are_held_are_constants_of_couplings(only: tuple[str, ...], verdict: str, tmp_path: Path) -> None:
    """With j2 held at zero, both cables are j1 + j3 = 0."""
    found = compare_pair(cable_side(tmp_path, 1.0, only), cable_side(tmp_path, 5.0, only), 1e-5).properties
    assert found is not None
    assert found.verdict("couplings") == verdict


@pytest.mark.parametrize(("ratio", "agrees"), [(0.5, True), (0.9, False)])
def test_poses_of_a_coupling_of_three_joints_are_those_of_its_sum(ratio: float, agrees: bool, tmp_path: Path) -> None:
    q = np.random.default_rng(5).uniform(-1, 1, (30, 2))
    Ts = []
    for second, third in q:
        T = np.eye(4)
        for value, axis in ((-ratio * second - third, (0, 0, 1)), (second, (0, 1, 0)), (third, (1, 0, 0))):
            step = np.eye(4)
            step[0, 3] = 0.2
            step[:3, :3] = Rotation.from_rotvec(value * np.array(axis)).as_matrix()
            T = T @ step
        Ts.append(T)
    rows = PoseRows(("j2", "j3"), (True, True), q, np.array(Ts))
    assert compare_rows(rows, "poses", cable_side(tmp_path, 0.5), 1e-5).fit.agrees == agrees


def hinge(file: Path, attributes: str) -> Path:
    """Write an MJCF of one hinge."""
    body = f'<body name="link1"><joint name="a" {attributes}/><geom size=".02"/></body>'
    file.write_text(
        f'<mujoco model="r"><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>', encoding="utf-8"
    )
    return file


def limits_of(first: Path, second: Path) -> tuple[str, list[tuple[str, str]]]:
    """Return the verdict on the limits, and the texts of both sides where they differ."""
    properties = twin.compare(first, second).pairs[0].properties
    assert properties is not None
    rows = [(row.first, row.second) for row in properties.rows if row.kind == "limits"]
    return properties.verdict("limits"), rows


def test_no_limits_are_no_agreement_with_limits(tmp_path: Path) -> None:
    bounded = robot(tmp_path / "bounded.urdf", [{"name": "a"}])
    endless = robot(tmp_path / "endless.urdf", [{"name": "a", "type": "continuous"}])
    one_turn = "-57.3° .. 57.3°"
    assert limits_of(bounded, endless) == ("disagree", [(one_turn, "no limits")])
    assert limits_of(endless, bounded) == ("disagree", [("no limits", one_turn)])
    assert limits_of(endless, endless) == ("agree", [])
    bounded_hinge = hinge(tmp_path / "bounded.xml", 'range="-1 1"')
    endless_hinge = hinge(tmp_path / "endless.xml", 'limited="false"')
    assert limits_of(bounded_hinge, endless_hinge) == ("disagree", [(one_turn, "no limits")])
    assert limits_of(endless_hinge, endless) == ("agree", [])


def test_a_stage_without_limits_states_that_there_are_none(tmp_path: Path) -> None:
    stage = chains.write(chains.ROBOTS["scara"], tmp_path / "stage", "usda")
    lines = [line for line in stage.read_text().splitlines() if "Limit" not in line]
    stage.write_text("\n".join(lines) + "\n")
    bounded = chains.write(chains.ROBOTS["scara"], tmp_path / "bounded", "urdf")
    verdict, rows = limits_of(bounded, stage)
    assert verdict == "disagree"
    assert {second for _, second in rows} == {"no limits"}


def test_limits_of_only_one_side_are_named_as_not_compared(tmp_path: Path) -> None:
    bounded = hinge(tmp_path / "bounded.xml", 'range="-1 1"')
    silent = hinge(tmp_path / "silent.xml", "")
    assert limits_of(bounded, silent) == ("not stated", [("-57.3° .. 57.3°", "-")])
    text = "\n".join(str(part) for part in twin.compare(bounded, silent).text())
    assert "limits of 'a': not compared, because only one side states them" in text
