"""What `twin compare` tells of masses of welded bodies, and of limits that a robot folder denies."""

from __future__ import annotations

from pathlib import Path

import pytest

import twin
from twin.comparison.properties import PropertyRow
from twin.core.errors import TwinError
from twin.exchange.read import read
from twin.exchange.read.robot_folder import write_folder

WELDED = """<robot name="welded">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0.05"/><mass value="{arm}"/>
<inertia ixx="0.01" iyy="0.01" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="{kind}"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
{limit}</joint>
<link name="plate"><inertial><mass value="{plate}"/>
<inertia ixx="0.004" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="weld" type="fixed"><parent link="arm"/><child link="plate"/><origin xyz="0.2 0 0.3"/></joint>
</robot>"""

LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def welded(file: Path, **changed: object) -> Path:
    given = {"arm": 2.0, "plate": 1.0, "moment": 0.004, "kind": "revolute", "limit": LIMIT, **changed}
    file.write_text(WELDED.format(**given), encoding="utf-8")
    return file


def rows_of(first: Path, second: Path) -> dict[str, PropertyRow]:
    pair = twin.compare(first, second).pairs[0]
    assert pair.properties is not None
    return {row.kind: row for row in pair.properties.rows}


def test_a_wrong_mass_of_welded_bodies_is_the_edit_of_all_that_it_changes(tmp_path: Path) -> None:
    rows = rows_of(welded(tmp_path / "right.urdf"), welded(tmp_path / "heavy.urdf", plate=3.0))
    for kind in ("masses", "centres of mass", "inertias"):
        assert not rows[kind].together
        first = {edit.side: (edit.what, float(edit.old), float(edit.new)) for edit in reversed(rows[kind].edits)}
        assert first["right.urdf"] == ("link 'plate' inertial mass value[0]", 1.0, pytest.approx(3.0))
        assert first["heavy.urdf"] == ("link 'plate' inertial mass value[0]", 3.0, pytest.approx(1.0))


def test_no_edit_of_an_inertia_is_told_that_no_body_can_have(tmp_path: Path) -> None:
    rows = rows_of(welded(tmp_path / "right.urdf"), welded(tmp_path / "wrong.urdf", plate=3.0, moment=0.008))
    assert rows["masses"].edits
    assert rows["inertias"].edits == ()  # the sum is right only after the mass is
    alone = rows_of(tmp_path / "right.urdf", welded(tmp_path / "moment.urdf", moment=0.008))
    edits = {edit.side: (edit.what, edit.new) for edit in reversed(alone["inertias"].edits)}
    assert edits["moment.urdf"] == ("link 'arm' inertial inertia izz[0]", "0.004")


def test_a_folder_states_that_a_joint_has_no_limits(tmp_path: Path) -> None:
    free = welded(tmp_path / "free.urdf", kind="continuous", limit="")
    bounded = welded(tmp_path / "bounded.urdf")
    description = write_folder(read(free), "free", tmp_path / "free", free)[0]
    text = description.read_text(encoding="utf-8")
    assert 'limits = "none"' in text
    row = rows_of(tmp_path / "free", bounded)["limits"]
    assert (row.stated, row.first) == (True, "no limits")
    assert "limits" not in rows_of(tmp_path / "free", free)
    # an entry without limits says nothing
    description.write_text(text.replace('limits = "none"\n', ""), encoding="utf-8")
    assert not rows_of(tmp_path / "free", bounded)["limits"].stated
    description.write_text(
        text.replace('limits = "none"\n', 'limits = "none"\nlimits_deg = [-1, 1]\n'), encoding="utf-8"
    )
    with pytest.raises(TwinError, match=r'limits_deg is given beside limits = "none"'):
        twin.compare(tmp_path / "free", bounded)


def test_limits_without_a_common_range_are_named_with_their_lines(tmp_path: Path) -> None:
    first = welded(tmp_path / "first.urdf")
    second = welded(tmp_path / "second.urdf", limit=LIMIT.replace("-1", "2").replace('"1" eff', '"3" eff'))
    with pytest.raises(TwinError, match=r"first\.urdf:6\) .* in second\.urdf \(\S*second\.urdf:6\)"):
        twin.compare(first, second)


def test_texts_of_a_row_differ(tmp_path: Path) -> None:
    """A tensor turned by 90 degrees, limits that differ in the fifth digit, and a coupling with an offset."""
    tensor = '<inertia ixx="0.01" iyy="0.01" izz="{moment}"'
    turned = WELDED.replace(tensor, '<inertia ixx="0.01" iyy="{moment}" izz="0.01"')
    mimic = """<link name="slider"/><joint name="follows" type="prismatic"><parent link="base"/><child link="slider"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
<mimic joint="shoulder" multiplier="0.01" offset="OFFSET"/></joint></robot>"""
    given = {"arm": 2.0, "plate": 1.0, "moment": 0.004, "kind": "revolute"}
    files = []
    for name, text, offset, upper in (("first", WELDED, "0", "3.1415"), ("second", turned, "0.5", "3.1417")):
        file = tmp_path / f"{name}.urdf"
        limit = LIMIT.replace('upper="1"', f'upper="{upper}"')
        ending = mimic.replace("OFFSET", offset)
        file.write_text(text.format(**given, limit=limit).replace("</robot>", ending), encoding="utf-8")
        files.append(file)
    # without the plate, both tensors have the same moments
    for file in files:
        file.write_text(
            file.read_text()
            .replace('type="fixed"', 'type="revolute"')
            .replace(
                '<child link="plate"/>',
                '<child link="plate"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/>',
            )
        )
    rows = rows_of(*files)
    assert (rows["inertias"].first, rows["inertias"].second) == (
        "ixx 0.01, iyy 0.01, izz 0.004, ixy 0, ixz 0, iyz 0 kg m2 in the base",
        "ixx 0.01, iyy 0.004, izz 0.01, ixy 0, ixz 0, iyz 0 kg m2 in the base",
    )
    assert (rows["limits"].first, rows["limits"].second) == ("-57.2958° .. 179.995°", "-57.2958° .. 180.006°")
    assert (rows["couplings"].first, rows["couplings"].second) == (
        "0.01 m/rad × shoulder",
        "0.01 m/rad × shoulder + 500 mm",
    )
