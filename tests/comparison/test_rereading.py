"""Edits that are found by reading a changed text again: properties of a URDF, and places in an SDF and a stage."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

import twin
from comparison.test_compare_faults import mimic, robot
from made import chains
from twin.comparison.file_numbers import has_numbers

CHAIN = [
    {"name": "a", "xyz": "0 0 0.3"},
    {"name": "b", "xyz": "0.1 0 0.2", "axis": "0 1 0", "limits": "-2.5 1.25", "mimic": mimic("a", 2.0)},
    {"name": "c", "xyz": "0 0.05 0.4", "axis": "1 0 0"},
]


WRONG = {
    "limits": ('upper="1.25"', 'upper="1.52"'),
    "couplings": ('multiplier="2.0"', 'multiplier="0.5"'),
    "masses": ('<mass value="1"/>', '<mass value="10"/>'),
    "inertias": ('ixx="1"', 'ixx="1.5"'),
    "speeds": ('velocity="1"', 'velocity="3"'),
    "efforts": ('effort="1"', 'effort="100"'),
}
"""(right, wrong) text of one property of each kind, at its last place in the file."""


@pytest.mark.parametrize("kinds", [["limits", "couplings", "masses", "speeds", "efforts"], ["inertias"]])
def test_wrong_properties_have_their_edits(kinds: list[str], tmp_path: Path) -> None:
    right = robot(tmp_path / "right.urdf", CHAIN)
    text = right.read_text()
    for kind in kinds:
        old, new = WRONG[kind]
        before, _, after = text.rpartition(old)
        text = before + new + after
    wrong = tmp_path / "wrong.urdf"
    wrong.write_text(text)
    pair = twin.compare(wrong, right).pairs[0]
    assert pair.properties is not None
    rows = [row for row in pair.properties.rows if row.stated]
    assert sorted(row.kind for row in rows) == sorted(kinds)
    for row in rows:
        old, new = WRONG[row.kind]
        edits = [edit for edit in row.edits if edit.side == "wrong.urdf"]
        assert edits[0].line == text.rpartition(new)[0].count("\n") + 1
        written = [float(part.split('"')[1]) for part in (new, old)]
        assert [float(edits[0].old), float(edits[0].new)] == written
        assert edits[0].confirmed


@pytest.mark.parametrize(
    ("kind", "mark", "key"),
    [
        pytest.param("sdf", '<link name="link4">', "<pose>", marks=pytest.mark.slow),
        pytest.param("usda", 'Joint "joint4"', "localPos0 = (", marks=pytest.mark.slow),
    ],
)
def test_a_wrong_number_of_a_format_without_statements_has_its_edit(
    kind: str, mark: str, key: str, tmp_path: Path
) -> None:
    right = chains.write(chains.ROBOTS["wrist_arm"], tmp_path / "right", kind)
    text = right.read_text()
    start = text.index(key, text.index(mark)) + len(key)
    # the second number: the joint turns about x, so that the first moves nothing
    start = next(k for k in range(start, start + 30) if text[k] == " ") + 1
    end = next(k for k in range(start, start + 30) if text[k] in " ,")
    wrong = tmp_path / f"wrong{right.suffix}"
    wrong.write_text(f"{text[:start]}0.03{text[end:]}")
    items = twin.compare(wrong, right).pairs[0].items
    assert items
    for item in items:
        first = next(edit for edit in item.edits if edit.side == wrong.name)
        assert first.line == text.count("\n", 0, start) + 1
        assert float(first.old) == 0.03
        assert float(first.new) == pytest.approx(float(text[start:end]), abs=1e-5)
        if kind == "usda":
            assert first.what == "</made/joint4>.physics:localPos0[1]"


MJCF = """<mujoco model="r">
<include file="{include}"/><compiler angle="radian"/><worldbody><body name="b1" pos="0 0 .1">
<joint name="j1" axis="0 0 1" range="-1 {upper}" limited="true"/><geom size=".02"/></body></worldbody></mujoco>"""


def test_a_text_with_references_above_its_folder_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    common = "<mujocoinclude><default><joint damping='1'/></default></mujocoinclude>"
    for include in ("../assets/common.xml", "../../common.xml"):
        folder = tmp_path / "package" / "mjcf"
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / include
        file.parent.mkdir(exist_ok=True)
        file.write_text(common)
        sides = []
        for name, upper in (("a.xml", "1"), ("b.xml", ".8")):
            sides.append(folder / name)
            sides[-1].write_text(MJCF.format(include=include, upper=upper))
        pair = twin.compare(*sides).pairs[0]
        assert pair.properties is not None
        (row,) = [row for row in pair.properties.rows if row.stated]
        assert [(edit.line, edit.old, edit.new) for edit in row.edits] == [(3, "1", "0.8"), (3, ".8", "1")]
    assert not list(temporary.iterdir())


def test_only_texts_whose_numbers_are_known_are_read_again() -> None:
    step = b"ISO-10303-21;\nHEADER;\nDATA;\n#10 = CARTESIAN_POINT('', (0., 1., 2.));\n"
    assert not has_numbers(step, table=False)
    assert not has_numbers(b"PXR-USDC\0\0 1 2 3", table=False)
    assert not has_numbers(b"PK\3\4 1 2 3", table=False)
    assert not has_numbers(b"d,a\0\n1,2", table=True)
    assert has_numbers(b"d,a\n1,2", table=True)
    assert has_numbers(b"#usda 1.0\n", table=False)
    assert has_numbers(b"\xef\xbb\xbf<robot/>", table=False)
