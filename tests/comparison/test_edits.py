"""Edits that `twin compare` names: signs, quarter turns, whole places, cells of tables, one edit for all changes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import twin
from made import errata
from made.errata import EntryRobot, Table


def _pair(right: EntryRobot, wrong: EntryRobot, folder: Path) -> tuple[Path, Path]:
    """Write a wrong and a right robot, as tables if they have rows."""
    paths = []
    for name, robot in (("wrong", wrong), ("right", right)):
        if robot.rows:
            path = folder / f"{name}.csv"
            path.write_text(errata.table_text(robot), encoding="utf-8")
        else:
            path = folder / f"{name}.urdf"
            path.write_text(errata.urdf_text(robot), encoding="utf-8")
        paths.append(path)
    return paths[0], paths[1]


def _changed(robot: EntryRobot, name: str, key: str, value: object) -> EntryRobot:
    """Return the robot with another value in a joint or row."""

    def one(owner: Table) -> Table:
        return {**owner, key: value} if owner["name"] == name else owner

    joints = tuple(one(joint) for joint in robot.joints)
    rows = tuple(one(row) for row in robot.rows)
    return EntryRobot(robot.name, joints, robot.bodies, rows, robot.convention)


CELLS = [
    ("toolbox_ur5_d1", "q1", "d", 0.3),
    ("toolbox_ur5_d1", "q2", "a", -0.4),
    ("toolbox_ur5_d1", "q4", "alpha", -1.5707963268),
    ("toolbox_ur5_d1", "q5", "d", 0.08),
    ("panda_link1_link2", "q3", "d", 0.361),
    ("panda_link1_link2", "q4", "a", 0.0852),
    ("panda_link1_link2", "q5", "alpha", 1.5707963268),
    ("dvrk_420006_length", "outer_roll", "d", 0.4826),
    ("dvrk_420006_length", "outer_wrist_yaw", "a", 0.0091),
]


@pytest.mark.parametrize(("entry", "row", "key", "value"), CELLS)
def test_a_wrong_cell_of_a_table_is_named_with_its_line(
    entry: str, row: str, key: str, value: float, tmp_path: Path
) -> None:
    right = errata.entry(entry).after()
    wrong, after = _pair(right, _changed(right, row, key, value), tmp_path)
    before = next(one for one in right.rows if one["name"] == row)[key]
    found = []
    for item in twin.compare(wrong, after).pairs[0].items:
        for edit in item.edits:
            if edit.side == "wrong.csv" and edit.what == f"row '{row}' {key}":
                found.append(edit)
    assert found
    assert float(found[0].new) == pytest.approx(before, abs=1e-5)
    assert wrong.read_text().splitlines()[found[0].line - 1].startswith(f"{row},")


PLACES = [
    ("joint_6", "axis", [1, 0, 0], "axis xyz[0]"),
    ("joint_6", "axis", [0, 0, 1], "axis xyz"),
    ("joint_4", "rpy", [3.1415926536, 0, 0], "origin rpy[0]"),
    ("joint_5", "rpy", [0, 1.5707963268, 0], "origin rpy[1]"),
    ("joint_6-tool0", "xyz", [0.1, 0.2, 0], "origin xyz"),
]


@pytest.mark.parametrize(("joint", "key", "value", "place"), PLACES)
def test_lost_signs_and_quarter_turns_are_named(
    joint: str, key: str, value: list[float], place: str, tmp_path: Path
) -> None:
    right = errata.entry("fanuc_m20ia_moved").after()
    stated = next(one for one in right.joints if one["name"] == joint)[key]
    wrong, after = _pair(right, _changed(right, joint, key, value), tmp_path)
    firsts = []
    for item in twin.compare(wrong, after).pairs[0].items:
        own = [edit for edit in item.edits if edit.side == "wrong.urdf"]
        firsts.append((own[0].what, [float(word) for word in own[0].new.split()]))
    named = dict(firsts)
    assert f"joint '{joint}' {place}" in named
    new = named[f"joint '{joint}' {place}"]
    component = re.search(r"\[(\d)\]", place)
    if component is not None:
        stated = [stated[int(component[1])]]
    assert new == pytest.approx(stated, abs=2e-5)


def test_a_moved_and_turned_tool_frame_is_one_edit(tmp_path: Path) -> None:
    right = errata.entry("fanuc_m20ia_moved").after()
    wrong_robot = _changed(right, "joint_6-tool0", "xyz", [0.05, 0, 0.1])
    wrong, after = _pair(right, _changed(wrong_robot, "joint_6-tool0", "rpy", [0, 0.4, 0]), tmp_path)
    item = twin.compare(wrong, after).pairs[0].items[0]
    edit = item.edits[0]
    assert item.kind == "tool frame"
    assert edit.what == "joint 'joint_6-tool0' origin"
    assert edit.old == "0.05 0 0.1 0 0.4 0"
    xyz, rpy = [float(word) for word in edit.new.split()[:3]], [float(word) for word in edit.new.split()[3:]]
    assert xyz == pytest.approx([0, 0, 0], abs=1e-5)
    fixed = _changed(_changed(right, "joint_6-tool0", "xyz", xyz), "joint_6-tool0", "rpy", rpy)
    edited = tmp_path / "edited.urdf"
    edited.write_text(errata.urdf_text(fixed), encoding="utf-8")
    assert twin.compare(edited, after).pairs[0].kinematics == "agree"


def test_one_edit_that_removes_all_changes_comes_first(tmp_path: Path) -> None:
    entry = errata.entry("mycobot_a450_joint7")
    wrong, after = _pair(entry.after(), entry.before(), tmp_path)
    items = twin.compare(wrong, after).pairs[0].items
    assert {item.edits[0].what for item in items} == {"joint 'joint7_to_joint6' origin rpy[0]"}
    assert float(items[0].edits[0].new) == pytest.approx(1.5708, abs=1e-5)
