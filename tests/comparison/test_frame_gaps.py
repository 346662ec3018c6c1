"""Tool frames with other names, and frames of tables and equations: conventions of `twin compare`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import twin
from twin.comparison.comparison_result import Comparison
from twin.comparison.pair import compare_pair
from twin.comparison.side import JointGroup, PoseRows, RobotSide
from twin.core import spatial
from twin.core.spatial import Array

JOINTS = (("j1", "base", "l1", "0 0 0.3", "0 0 0"), ("j2", "l1", "l2", "0.2 0 0.1", "1.5707963 0 0"))


def arm(file: Path, tool: str, shift: str) -> Path:
    """Write a URDF of three hinges, whose last link has a tool frame with this name and shift in m."""
    joints = (*JOINTS, ("j3", "l2", "l3", "0.3 0 0", "0 0 0"))
    lines = ['<robot name="arm">']
    lines += [f'<link name="{link}"/>' for link in ("base", "l1", "l2", "l3", tool)]
    for name, parent, child, xyz, rpy in joints:
        lines.append(
            f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/></joint>'
        )
    lines.append(f'<joint name="end" type="fixed"><parent link="l3"/><child link="{tool}"/><origin xyz="{shift}"/>')
    file.write_text("\n".join([*lines, "</joint></robot>"]))
    return file


def test_a_tool_with_another_name_and_place_is_told(tmp_path: Path) -> None:
    first = arm(tmp_path / "a.urdf", "tool0", "0.1 0 0")
    second = arm(tmp_path / "b.urdf", "ee_link", "0.4 0 0")
    found = twin.compare(first, second).pairs[0]
    assert found.kinematics == "agree after conventions"
    (item,) = found.items
    assert (item.kind, item.link) == ("tool frame", "ee_link")
    assert item.shift == pytest.approx(0.3, abs=1e-9)
    assert twin.compare(first, second, strict=True).verdict == "disagree"


def test_a_tool_with_another_name_at_the_same_place_agrees(tmp_path: Path) -> None:
    first = arm(tmp_path / "a.urdf", "tool0", "0.1 0 0")
    second = arm(tmp_path / "b.urdf", "ee_link", "0.1 0 0")
    assert twin.compare(first, second, strict=True).pairs[0].kinematics == "agree"


def poses(base: Array, tool: Array, q: Array) -> Array:
    """Return the poses (rows, 4, 4) of the arm with a tool at 0.1 m, by the products of its joints, in other frames."""
    T = np.broadcast_to(base, (len(q), 4, 4))
    places = (((0.0, 0.0, 0.3), 0.0), ((0.2, 0.0, 0.1), 1.5707963), ((0.3, 0.0, 0.0), 0.0))
    for i, (shift, roll) in enumerate(places):
        T = T @ spatial.pose(spatial.exp_so3(np.array([roll, 0.0, 0.0])), np.array(shift))
        T = T @ spatial.pose(spatial.exp_so3(q[:, i, None] * np.array([0.0, 0.0, 1.0])), np.zeros(3))
    return T @ spatial.pose(np.eye(3), np.array([0.1, 0.0, 0.0])) @ tool


@pytest.mark.parametrize("moved", [(), ("base frame",), ("tool frame",), ("base frame", "tool frame")])
@pytest.mark.parametrize("computed", [True, False])
def test_other_frames_of_computed_poses_are_conventions(moved: tuple[str, ...], computed: bool, tmp_path: Path) -> None:
    file = arm(tmp_path / "a.urdf", "tool0", "0.1 0 0")
    robot = twin.compare(file, file).sides[0]
    motion = spatial.pose(spatial.exp_so3(np.array([0.0, 0.3, 0.1])), np.array([0.05, 0.02, -0.01]))
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (30, 3))
    base = motion if "base frame" in moved else np.eye(4)
    tool = motion if "tool frame" in moved else np.eye(4)
    names = ("j1", "j2", "j3")
    rows = PoseRows(names, (True,) * 3, q, poses(base, tool, q), computed=computed)
    groups = (JointGroup(("base",)),)
    frames = {"base": (0, np.eye(4))}
    side = RobotSide("rows", "rows", (), groups, frames, tool="base", driven_joints=names, sample_poses=lambda: rows)
    found = compare_pair(side, robot, 1e-5)
    assert found.agrees
    told = tuple(item.kind for item in found.items)
    assert told == (moved if computed else ())
    strict = Comparison((side, robot), (found,), 1e-5, strict=True)
    assert strict.verdict == ("disagree" if told else "agree")
    text = "\n".join(str(part) for part in strict.text())
    assert all(f"convention, {kind}: the {kind} of" in text for kind in told)
