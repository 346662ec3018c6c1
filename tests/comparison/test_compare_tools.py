"""Tool frames with other names, and frames of tables and equations: conventions of `twin compare`."""

from __future__ import annotations

from pathlib import Path

import pytest

import twin

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
