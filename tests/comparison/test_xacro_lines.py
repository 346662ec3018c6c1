"""Edits that `twin compare` names in a xacro: only where the line states the number, for one element."""

from __future__ import annotations

from pathlib import Path

import pytest

import twin
from twin.comparison.xacro_lines import obstacle

LEG = """<link name="{p}_a"/>
<joint name="{p}_1" type="revolute"><parent link="base"/><child link="{p}_a"/>
<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="{upper}" effort="1" velocity="1"/></joint>
"""
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="base"/>'


def urdf(file: Path, legs: dict[str, tuple[str, str]]) -> Path:
    """Write {name: (x in m, upper limit)} as a URDF."""
    text = "".join(LEG.format(p=name, x=x, upper=upper) for name, (x, upper) in legs.items())
    file.write_text(f'<robot name="r"><link name="base"/>{text}</robot>')
    return file


def test_a_line_of_a_macro_that_is_used_twice_has_no_edit(tmp_path: Path) -> None:
    macro = LEG.format(p="${p}", x="${x}", upper="1")
    calls = '<xacro:leg p="l" x="0.5"/><xacro:leg p="r" x="-0.5"/>'
    xacro = tmp_path / "a.xacro"
    xacro.write_text(f'{HEAD}\n<xacro:macro name="leg" params="p x">{macro}</xacro:macro>{calls}</robot>')
    result = twin.compare(xacro, urdf(tmp_path / "b.urdf", {"l": ("0.5", "1"), "r": ("-0.5", "0.8")}))
    properties = result.pairs[0].properties
    assert properties is not None
    (row,) = [row for row in properties.rows if row.stated]
    edit = row.edits[0]
    assert (edit.line, edit.old, edit.new, edit.confirmed) == (5, "1", "", False)
    assert "line 5 is used by 2 elements" in edit.text()
    (finding,) = [finding for finding in result.findings if finding.code == "compare.limits"]
    assert "a.xacro:5: joint 'r_1' limit upper[0] is 1, but line 5" in finding.suggestion


def test_a_line_with_an_expression_has_no_edit(tmp_path: Path) -> None:
    xacro = tmp_path / "a.xacro"
    legs = LEG.format(p="l", x="${d}", upper="1") + LEG.format(p="r", x="-0.5", upper="${k}")
    stated = '<xacro:property name="d" value="0.3"/><xacro:property name="k" value="1"/>'
    xacro.write_text(f"{HEAD}{stated}{legs}</robot>")
    pair = twin.compare(xacro, urdf(tmp_path / "b.urdf", {"l": ("0.35", "0.9"), "r": ("-0.5", "0.8")})).pairs[0]
    (edit, *_) = pair.items[0].edits
    assert (edit.old, edit.new, edit.confirmed) == ("0.3", "", False)
    assert edit.text().endswith("but line 3 holds an expression")
    assert pair.properties is not None
    named = {}
    for row in pair.properties.rows:
        if row.stated:
            named[row.where] = (row.edits[0].new, row.edits[0].confirmed, row.edits[0].obstacle)
    assert named["l_1"] == ("0.9", True, "")
    # beside effort="1", which is no expression
    assert named["r_1"] == ("", False, "line 8 holds an expression")


@pytest.mark.parametrize(
    ("text", "what", "old", "reason"),
    [
        ('<origin xyz="0.3 ${a} 0"/>', "joint 'j' origin xyz[0]", "0.3", ""),
        ('<origin xyz="0.3 ${a} 0"/>', "joint 'j' origin xyz[1]", "0.3", "line 1 holds an expression"),
        ('<origin xyz="0.3 1${a} 0"/>', "joint 'j' origin xyz[1]", "1", "line 1 holds an expression"),
        ('<origin xyz="0.3 0.2 0"/>', "joint 'j' origin xyz", "0.3 0.2 0", ""),
        ('<origin xyz="0.3 0.2 0"/>', "joint 'j' origin xyz[1]", "0.3", "line 1 does not state it"),
        # the attribute of another element of the line
        ('<origin rpy="1 2 3"/><axis xyz="0 0 1"/>', "joint 'j' origin xyz[2]", "1", "line 1 does not state it"),
        # the element began in the line before
        ('xyz="0 0 0.3"/><axis xyz="0 0 1"/>', "joint 'j' origin xyz[2]", "0.3", ""),
        ('xyz="0 0 0.3"/><axis xyz="0 0 1"/>', "joint 'j' origin xyz[2]", "1", "line 1 does not state it"),
    ],
)
def test_a_line_states_the_number_at_its_index(tmp_path: Path, text: str, what: str, old: str, reason: str) -> None:
    xacro = tmp_path / "a.xacro"
    xacro.write_text(text)
    places = {"joint/j/origin": (str(xacro), 1)}
    assert obstacle(places, str(xacro), 1, what, old) == reason
