"""Robot files with one mistake each: the message says where, what and the way out (the file's first line)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.cad import references
from twin.cad.build import fingerprint, read_mechanism
from twin.cad.description import load
from twin.core.errors import CadError, DescriptionError, MechanismError

DATA = Path(__file__).parents[1] / "data/cad"
FILES = sorted(DATA.glob("error_*.toml"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_error_files_say_what_is_wrong_and_where(path):
    with pytest.raises(DescriptionError) as caught:
        read_mechanism(path)
    lines = path.read_text().splitlines()
    found = re.fullmatch(re.escape(str(path)) + r":(\d+): (.*)", str(caught.value))
    assert found is not None
    assert found[2] == lines[0].removeprefix("# ")
    # The line holds the key, or the header of the table that lacks it.
    key = re.split(r"[ =:]", found[2])[0]
    last = re.sub(r"\[\d+\]", "", key).split(".")[-1]
    missing = "is missing" in found[2] or "needs exactly one" in found[2] or path.stem == "error_not_toml"
    assert missing or last in lines[int(found[1]) - 1]
    assert int(found[1]) > 1


def test_there_is_a_file_for_each_kind_of_mistake():
    assert len(FILES) == 35


def test_the_file_without_a_mistake_is_read():
    assert load(DATA / "crank.toml").name == "crank"


def copy(tmp_path, *changes):
    text = (DATA / "crank.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "crank.toml").write_text(text)
    (tmp_path / "crank.step").write_bytes((DATA / "crank.step").read_bytes())
    return tmp_path / "crank.toml"


@pytest.mark.parametrize(
    ("change", "error", "fragment"),
    [
        (
            ("radius_mm = 3.02", "radius_mm = 3.1"),
            CadError,
            "feature 'bore' of body 'arm': the body has no cylinder of radius 3.1 mm; radii found: 2, 3.02 mm",
        ),
        (
            ("near_mm = [80, 0, 20]", "near_mm = [83, 0, 20]"),
            CadError,
            "feature 'ball' of body 'arm': the nearest sphere (on 'arm_ball', at (80.00, 0.00, 20.00) mm) is 3.000 mm",
        ),
        (("[body.arm]", '[body.arm]\nnode = "arms"'), CadError, "body 'arm': there is no node 'arms'. Did you mean"),
        (('step = "crank.step"', 'step = "crunk.step"'), CadError, "crunk.step: cannot read the STEP file"),
        (
            ('x_along = "side" }', 'x_along = "top" }'),
            CadError,
            "joint 'turn' on body 'base': the frame at 'pin': its x or y direction is parallel to z",
        ),
        (("limits_mm = [-100.0, 20.0]", "limits_mm = [5, 5]"), MechanismError, "joint 'slide': limits 0.005 .. 0.005"),
        (
            (
                "[posture.",
                '[[coupling]]\nname = "c"\njoints = ["turn", "turn"]\nratios = [1, 1]\nsum_mm = 5\n'
                'provenance = "ASSUMED"\nnote = "x"\n\n[posture.',
            ),
            DescriptionError,
            "coupling[0].sum_mm: joint 'turn' is revolute; write sum_deg",
        ),
        (
            ('child = "slider"', 'child = "arm"'),
            DescriptionError,
            "joint[1].on_child.at: body 'arm': there is no feature 'front'",
        ),
        (
            ('parent = "base"\nchild = "slider"', 'parent = "slider"\nchild = "slider"'),
            DescriptionError,
            "joint[1].on_parent.origin: body 'slider': there is no feature 'rail'",
        ),
    ],
)
def test_mistakes_that_only_the_cad_or_the_mechanism_shows(tmp_path, change, error, fragment):
    with pytest.raises(error) as caught:
        read_mechanism(copy(tmp_path, change))
    assert fragment in str(caught.value)


def test_a_defect_in_the_drawing_is_a_finding_with_its_size(tmp_path):
    """The top of the plate named instead of the underside of the arm: 8 mm apart along the pin, in line."""
    path = copy(tmp_path, ("near_mm = [40, 0, 0]", "near_mm = [40, 0, 8]"))
    (finding,) = read_mechanism(path, with_mass=False).findings
    assert (finding.code, finding.severity, finding.where) == ("cad.meeting", "disagreement", "turn")
    assert finding.size == pytest.approx(8.0, abs=1e-12)
    assert (finding.unit, finding.limit) == ("mm", 0.001)
    assert finding.message == "joint 'turn': faces on 'base' and 'arm' are apart in the CAD: 8 mm (tolerance 0.001 mm)"


def test_a_part_without_material_is_a_warning(tmp_path):
    path = copy(tmp_path, ('parts = ["*"]', 'parts = ["base_*", "arm_bar", "slider_*"]'))
    (finding,) = read_mechanism(path).findings
    assert (finding.code, finding.severity, finding.where) == ("cad.no_material", "warning", "arm_ball")


ONE_BODY = """
name = "{name}"
title = "One body"
source = "made for the tests"
default_protocol = "none"
base = "group"
{step}
joint = []
[tolerance]
gross_mm = 1.0
gross_deg = 1.0
meeting_um = 1.0
meeting_deg = 0.001
[body.group]
{meshes}
[frame.tool]
body = "group"
at = {{ position_mm = [0, 0, 0] }}
[material.steel]
density_kg_m3 = 8000.0
parts = ["{parts}"]
provenance = "ASSUMED"
note = "test"
"""
"""robot.toml of one body, whose parts are in a STEP file or in meshes."""


def test_a_mesh_that_is_inside_out_is_a_warning_and_has_no_mass(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.1
    faces = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]  # clockwise seen from outside
    trimesh.Trimesh(corners, faces, process=False).export(tmp_path / "wedge.stl")
    meshes = 'meshes = [{ file = "wedge.stl", unit = "m" }]'
    (tmp_path / "wedge.toml").write_text(ONE_BODY.format(name="wedge", step="", meshes=meshes, parts="*"))
    cad = read_mechanism(tmp_path / "wedge.toml")
    (finding,) = cad.findings
    assert (finding.code, finding.severity, finding.where) == ("cad.inverted_mesh", "warning", "wedge")
    assert cad.mechanism.bodies[0].inertia is None


def test_the_last_material_that_matches_wins(tmp_path):
    extra = '[material.foam]\ndensity_kg_m3 = 80.0\nparts = ["slider_*"]\nprovenance = "ASSUMED"\nnote = "test"\n'
    heavy, light = (
        read_mechanism(DATA / "crank.toml"),
        read_mechanism(copy(tmp_path, ("[posture.home]", extra + "\n[posture.home]"))),
    )
    masses = [[m.mechanism.body(b).inertia.mass for b in ("arm", "slider")] for m in (heavy, light)]
    assert masses[1][0] == masses[0][0]
    assert masses[1][1] == pytest.approx(masses[0][1] / 100, rel=1e-12)


def test_the_fingerprint_follows_the_text_and_the_cad(tmp_path):
    path = copy(tmp_path)
    first = fingerprint(path)
    assert first == fingerprint(path)
    step = tmp_path / "crank.step"
    step.write_text(step.read_text().replace("'arm_bar'", "'arm_rod'"))
    second = fingerprint(path)
    path.write_text(path.read_text() + "# a remark\n")
    assert len({first, second, fingerprint(path)}) == 3
    step.unlink()
    with pytest.raises(CadError, match=r"crank\.step: cannot be read \(No such file or directory\)"):
        fingerprint(path)


def test_twice_the_same_part_is_weighed_where_each_is(tmp_path):
    """Both pegs of nested.step share one name and one path."""
    (tmp_path / "nested.step").write_bytes((DATA / "nested.step").read_bytes())
    step = 'step = "nested.step"'
    (tmp_path / "pegs.toml").write_text(ONE_BODY.format(name="pegs", step=step, meshes="", parts="peg"))
    cad = read_mechanism(tmp_path / "pegs.toml")
    assert [f.code for f in cad.findings] == ["cad.placement_precision"]
    assert cad.findings[0].size == pytest.approx(0.12, abs=0.01)
    (group,) = cad.mechanism.bodies
    assert [m.name for m in group.meshes] == ["peg", "peg_2"]
    middles = [(m.vertices.min(axis=0) + m.vertices.max(axis=0)) / 2 for m in group.meshes]
    assert abs(group.inertia.p_body_com - (middles[0] + middles[1]) / 2).max() < 1e-7
    assert abs(middles[0] - middles[1]).max() > 0.02
    assert group.inertia.mass == pytest.approx(2 * 8000 * 3.14159265 * 0.005**2 * 0.03, rel=2e-3)


NUMBERS = st.one_of(
    st.floats().map(repr), st.integers().map(str), st.sampled_from(["true", '"text"', "[]", "{}", "[1, 2]"])
)


@given(st.integers(0, 10_000), NUMBERS)
@settings(max_examples=150, deadline=None)
def test_any_value_in_any_place_is_read_or_refused_with_its_line(tmp_path_factory, place, value):
    text = (DATA / "crank.toml").read_text()
    places = [m.span(1) for m in re.finditer(r"= (.+)$", text, re.MULTILINE)]
    start, end = places[place % len(places)]
    path = tmp_path_factory.mktemp("any") / "crank.toml"
    path.write_text(text[:start] + value + text[end:])
    try:
        references.check(path, load(path))
    except DescriptionError as error:
        assert re.match(re.escape(str(path)) + r":\d+: ", str(error))  # noqa: PT017 - others must pass through


def test_given_points_and_colours_with_alpha_are_read(tmp_path):
    text = (DATA.parent / "importing/given.toml").read_text()
    more = '[point.spot]\nbody = "crank"\nposition_mm = [1, 2, 3]\n'
    path = tmp_path / "given.toml"
    path.write_text(text + more)
    (point,) = read_mechanism(path).mechanism.points
    assert (point.name, point.body) == ("spot", "crank")
    path.write_text(text + more.replace("position_mm = [1, 2, 3]", 'at = "x"'))
    with pytest.raises(DescriptionError, match="either measured"):
        load(path)
