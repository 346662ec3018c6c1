"""STEP in: units, damage, names, nested placements, mirror images, the cache.

The files in data/cad are drawn by data/cad/draw.py; what they hold is stated there.
"""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest

from twin.cad import step
from twin.cad.step import length_unit, read_step
from twin.core import spatial
from twin.core.errors import CadError
from twin.core.units import DEG, MM

DATA = Path(__file__).parents[1] / "data/cad"


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    """A cache of one's own, shared by the tests of this session."""
    folder = tmp_path_factory.getbasetemp() / "step-cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "twin/step"


def volume(part):
    a, b, c = (part.vertices[part.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij", a, np.cross(b, c)) / 6)


def altered(tmp_path, name, *changes):
    text = (DATA / name).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


# -- units -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "unit"), [("crank.step", 1e-3), ("inch.step", 0.0254), ("metre.step", 1.0)])
def test_the_unit_is_read(name, unit):
    assert length_unit(DATA / name) == unit


@pytest.mark.parametrize("name", ["inch.step", "metre.step"])
def test_a_part_has_its_size_in_metres_whatever_the_unit(name):
    (part,) = read_step(DATA / name).parts
    assert np.abs(part.vertices.min(axis=0)).max() < 1e-9
    assert np.abs(part.vertices.max(axis=0) - [0.040, 0.030, 0.020]).max() < 2e-9  # vertices are float32
    (bore,) = [f for f in part.faces if f.kind == "cylinder"]
    assert bore.radius == pytest.approx(5 * MM, abs=1e-14)
    assert np.abs(bore.point - np.array([12, 15, 10]) * MM).max() < 1e-12  # ten digits of an inch
    assert np.abs(np.abs(bore.direction) - [0, 0, 1]).max() < 1e-14


def test_the_chord_tolerance_does_not_depend_on_the_unit():
    inch, metre = (read_step(DATA / n).parts[0] for n in ("inch.step", "metre.step"))
    assert len(inch.triangles) == len(metre.triangles) < 200


@pytest.mark.parametrize(("tolerance", "angle"), [(0.1 * MM, 1.0), (0.01 * MM, 1.0)])
def test_chords_stay_within_the_tolerance(tolerance, angle):
    (part,) = read_step(DATA / "metre.step", tolerance, angle).parts
    bore = np.hypot(part.vertices[:, 0] - 0.012, part.vertices[:, 1] - 0.015) < 0.006
    ring = part.vertices[bore & (part.vertices[:, 2] < 0.001)]
    around = np.sort(np.arctan2(ring[:, 1] - 0.015, ring[:, 0] - 0.012))
    widest = np.diff(np.append(around, around[0] + 2 * np.pi)).max()
    sagitta = 5 * MM * (1 - np.cos(widest / 2))
    assert tolerance / 4 < sagitta < tolerance


MM_UNIT = "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )"


@pytest.mark.parametrize(
    ("entity", "unit"),
    [
        ("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.CENTI.,.METRE.) )", 1e-2),
        ("( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.) )", 1.0),
        ("(LENGTH_UNIT()\n NAMED_UNIT(*)\n SI_UNIT(.MICRO.,.METRE.))", 1e-6),
        ("( CONVERSION_BASED_UNIT('foot',#9) LENGTH_UNIT() NAMED_UNIT(#8) )", 0.3048),
        ("( CONVERSION_BASED_UNIT('INCH',#9) LENGTH_UNIT() NAMED_UNIT(#8) )", 0.0254),
    ],
)
def test_units_as_other_programs_write_them(tmp_path, entity, unit):
    assert length_unit(altered(tmp_path, "crank.step", (MM_UNIT, entity))) == unit


def test_a_missing_unit_is_an_error(tmp_path):
    path = altered(tmp_path, "crank.step", (MM_UNIT, "( NAMED_UNIT(*) SI_UNIT($,.RADIAN.) )"))
    with pytest.raises(CadError) as caught:
        read_step(path)
    assert str(caught.value) == (
        f"{path} states no length unit; a STEP file without a unit cannot be scaled. Export it again in mm."
    )


def test_a_named_metric_unit_counts_before_the_si_unit_that_defines_it(tmp_path):
    named = "( CONVERSION_BASED_UNIT('CENTIMETRE',#9998) LENGTH_UNIT() NAMED_UNIT(#8) )"
    text = (DATA / "crank.step").read_text().replace(MM_UNIT, named)
    path = tmp_path / "cm.step"
    path.write_text(text.replace("ENDSEC;\nEND-ISO", f"#9999={MM_UNIT.replace('.MILLI.', '$')};\nENDSEC;\nEND-ISO"))
    assert length_unit(path) == 0.01


def test_an_unknown_unit_is_an_error(tmp_path):
    entity = "( CONVERSION_BASED_UNIT('CUBIT',#9) LENGTH_UNIT() NAMED_UNIT(#8) )"
    with pytest.raises(CadError, match=r"crank\.step: the length unit 'CUBIT' is not known; export in mm"):
        length_unit(altered(tmp_path, "crank.step", (MM_UNIT, entity)))


def test_mixed_units_are_an_error(tmp_path):
    text = (DATA / "crank.step").read_text()
    path = tmp_path / "mixed.step"
    path.write_text(text.replace("ENDSEC;\nEND-ISO", f"#9999={MM_UNIT.replace('.MILLI.', '$')};\nENDSEC;\nEND-ISO"))
    with pytest.raises(CadError, match=r"mixed\.step mixes length units \(0\.001 m, 1 m\); use one\."):
        read_step(path)


# -- damage ------------------------------------------------------------------------------------------


def test_a_missing_file_is_named():
    with pytest.raises(CadError, match=r"nothing\.step: cannot read the STEP file \(No such file or directory\)"):
        read_step(Path("nothing.step"))


def test_a_folder_is_no_step_file(tmp_path):
    with pytest.raises(CadError, match="cannot read the STEP file"):
        read_step(tmp_path)


@pytest.mark.parametrize("content", [b"solid x\n", bytes(range(256)) * 40], ids=["stl", "noise"])
def test_what_is_no_step_file_is_said_to_be_none(tmp_path, content):
    path = tmp_path / "odd.step"
    path.write_bytes(content)
    with pytest.raises(CadError) as caught:
        read_step(path)
    assert str(caught.value) == f"{path} is not a STEP file: it does not begin with ISO-10303-21"


@pytest.mark.parametrize("content", [b"", b" \r\n"], ids=["empty", "blank"])
def test_an_empty_file_is_said_to_be_empty(tmp_path, content):
    path = tmp_path / "odd.step"
    path.write_bytes(content)
    with pytest.raises(CadError, match=r"odd\.step is empty: export or copy the STEP file again"):
        read_step(path)


@pytest.mark.parametrize("part", [0.02, 0.5, 0.99])
def test_a_file_that_is_cut_off_is_said_to_be(tmp_path, part):
    whole = (DATA / "crank.step").read_bytes()
    path = tmp_path / "cut.step"
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(CadError) as caught:
        read_step(path)
    assert str(caught.value) == f"{path} is truncated: END-ISO-10303-21 is missing. Export or copy it again."


def test_a_file_whose_middle_is_lost_is_damaged(tmp_path, capfd):
    whole = (DATA / "inch.step").read_text()
    start = whole.index("DATA;") + 5
    path = tmp_path / "hole.step"
    unit = next(line for line in whole.splitlines() if "LENGTH_UNIT" in line and "CONVERSION" in line)
    path.write_text(whole[:start] + "\n" + unit + "\nENDSEC;\nEND-ISO-10303-21;\n")
    with pytest.raises(CadError, match=r"hole\.step(: OpenCASCADE could not read it| contains no solids)"):
        read_step(path)


# -- names and placements ----------------------------------------------------------------------------


def test_non_ascii_names_survive():
    assert [p.name for p in read_step(DATA / "nested.step").parts] == ["peg", "peg", "Träger_Ω"]


def test_names_in_the_encoding_of_the_standard_survive(tmp_path):
    path = altered(tmp_path, "nested.step", ("Träger_Ω", r"Tr\X2\00E4\X0\ger_\X2\03A9\X0\ "))
    assert read_step(path).parts[2].name.strip() == "Träger_Ω"


def test_latin_1_letters_alone_survive(tmp_path):
    path = altered(tmp_path, "nested.step", ("Träger_Ω", r"Tr\X2\00E4\X0\ger"))
    assert read_step(path).parts[2].name == "Träger"


def test_paths_name_the_assemblies_above():
    assert [p.path for p in read_step(DATA / "nested.step").parts] == [
        ("nested", "group", "inner"),
        ("nested", "group", "inner"),
        ("nested",),
    ]


def nested_truth():
    """T of both pegs in nested.step, from the numbers in draw.py."""
    T_group = spatial.pose(spatial.rotation_z(90 * DEG), np.array([100, 200, 300]) * MM)
    T_inner = spatial.pose(spatial.exp_so3([30 * DEG, 0, 0]), np.array([7, 0, 0]) * MM)
    T_peg = spatial.pose(spatial.exp_so3([0, 90 * DEG, 0]), np.array([0, 40, 0]) * MM)
    return T_group @ T_inner, T_group @ T_inner @ T_peg


def test_nested_placements_put_faces_where_they_are_to_the_stated_precision():
    model = read_step(DATA / "nested.step")
    assert 1e-9 < model.placement_error < 1e-6
    for part, T in zip(model.parts, nested_truth(), strict=False):
        (side,) = [f for f in part.faces if f.kind == "cylinder"]
        middle = T @ [10 * MM, 0, 15 * MM, 1]
        assert side.radius == pytest.approx(5 * MM, abs=1e-15)
        assert np.abs(side.point - middle[:3]).max() < model.placement_error / 10
        assert np.abs(np.cross(side.direction, T[:3, 2])).max() < 1e-7
        ends = sorted(f.point @ T[:3, 2] for f in part.faces if f.kind == "plane")
        base = T[:3, 3] @ T[:3, 2]
        assert np.abs(np.array(ends) - base - [0, 30 * MM]).max() < model.placement_error
        assert np.abs(part.vertices.mean(axis=0) - middle[:3]).max() < model.placement_error


def test_shapes_that_carry_their_placement_are_exact():
    assert read_step(DATA / "crank.step").placement_error == 0.0


def test_a_mirror_image_is_wound_outward():
    left, right = read_step(DATA / "mirrored.step").parts
    assert (left.name, right.name) == ("left", "right")
    assert volume(right) == pytest.approx(7200e-9, rel=1e-7)
    assert volume(left) == pytest.approx(7200e-9, rel=1e-7)
    image = left.vertices * [-1, 1, 1]
    assert (
        np.abs(
            np.sort(image.view("f8,f8,f8"), axis=0).view(float)
            - np.sort(right.vertices.view("f8,f8,f8"), axis=0).view(float)
        ).max()
        < 1e-9
    )


def test_an_instance_that_is_placed_by_a_mirror_is_wound_outward(monkeypatch):
    """STEP rarely says this, glTF may: a node matrix with negative determinant."""
    data = step._glb(DATA / "mirrored.step", 0.1, 0.5)
    header, binary = step._split_glb(data)
    node = next(n for n in header["nodes"] if n.get("name") == "right")
    node["matrix"] = np.diag([-1.0, 1, 1, 1]).T.reshape(-1).tolist()
    text = json.dumps(header).encode()
    forged = struct.pack("<4sIIII", b"glTF", 2, 0, len(text), 0x4E4F534A) + text + b"\0" * 8 + binary
    monkeypatch.setattr(step, "_glb", lambda *_: forged)
    left, right = read_step(DATA / "mirrored.step").parts
    assert volume(right) == pytest.approx(7200e-9, rel=1e-7)
    assert np.abs(right.vertices.min(axis=0) - left.vertices.min(axis=0)).max() < 1e-9
    tilted = {tuple(np.round(np.abs(f.direction), 9)) for f in left.faces}
    assert {tuple(np.round(np.abs(f.direction), 9)) for f in right.faces} == tilted
    assert np.abs(np.sort([f.point[0] for f in right.faces]) - np.sort([f.point[0] for f in left.faces])).max() < 1e-9


def test_faces_of_every_kind_with_their_middle():
    parts = {p.name: p for p in read_step(DATA / "crank.step").parts}
    assert list(parts) == ["base_plate", "base_pin", "base_rail", "arm_bar", "arm_ball", "slider_block"]
    (ball,) = parts["arm_ball"].faces
    assert (ball.kind, ball.radius) == ("sphere", pytest.approx(5 * MM, abs=1e-15))
    assert np.abs(ball.point - np.array([80, 0, 20]) * MM).max() < 1e-15
    assert not ball.direction.any()
    plate = parts["base_plate"].faces
    assert {f.kind for f in plate} == {"plane"}
    # A plane's point is the middle of the face.
    middles = sorted(tuple(np.round(f.point / MM, 9)) for f in plate)
    assert middles == [(-60, 10, -5), (0, -40, -5), (0, 10, -10), (0, 10, 0), (0, 60, -5), (60, 10, -5)]
    rail = next(f for f in parts["base_rail"].faces if f.kind == "cylinder")
    assert np.abs(rail.point - np.array([0, 50, 10]) * MM).max() < 1e-15


def test_colours_are_linear():
    color = read_step(DATA / "crank.step").parts[0].color_rgba
    srgb = np.array([0.8, 0.1, 0.1])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert np.abs(np.array(color[:3]) - linear).max() < 1e-4
    assert color[3] == 1.0


# -- the cache ---------------------------------------------------------------------------------------


def same(a, b):
    return all(
        np.array_equal(p.vertices, q.vertices) and np.array_equal(p.triangles, q.triangles)
        for p, q in zip(a.parts, b.parts, strict=True)
    )


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache/twin/step"


def test_a_second_reading_comes_from_the_cache(fresh, monkeypatch):
    import cascadio

    first = read_step(DATA / "inch.step")
    assert len(list(fresh.iterdir())) == 1
    monkeypatch.setattr(cascadio, "step_to_glb", lambda *_, **__: pytest.fail("read again"))
    assert same(first, read_step(DATA / "inch.step"))


@pytest.mark.slow
def test_other_content_and_other_tolerances_are_other_entries(fresh, tmp_path):
    read_step(DATA / "inch.step")
    read_step(DATA / "inch.step", 0.05 * MM)
    read_step(altered(tmp_path, "inch.step", ("'block'", "'brick'")))
    assert len(list(fresh.glob("*.glb"))) == 3
    assert read_step(altered(tmp_path, "inch.step", ("'block'", "'brick'"))).parts[0].name == "brick"


@pytest.mark.slow
def test_a_damaged_entry_is_read_anew_and_repaired(fresh):
    first = read_step(DATA / "inch.step")
    (entry,) = fresh.iterdir()
    whole = entry.read_bytes()
    for damaged in (b"", b"noise" * 100, whole[: len(whole) // 2]):
        entry.write_bytes(damaged)
        assert same(first, read_step(DATA / "inch.step"))
        assert entry.read_bytes() == whole


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert len(read_step(DATA / "inch.step").parts) == 1
    assert blocked.read_text() == "not a folder"


def test_the_cache_forgets_its_oldest_entries(fresh):
    fresh.mkdir(parents=True)
    for i in range(step._MAX_CACHED_FILES + 5):
        (fresh / f"{i:03}.glb").write_bytes(b"old")
    read_step(DATA / "inch.step")
    assert len(list(fresh.glob("*.glb"))) == step._MAX_CACHED_FILES + 1


def test_what_is_in_use_stays_in_the_cache(fresh):
    read_step(DATA / "inch.step")
    (used,) = fresh.glob("*.glb")
    os.utime(used, (1, 1))
    for i in range(step._MAX_CACHED_FILES + 5):
        other = fresh / f"{i:03}.glb"
        other.write_bytes(b"old")
        os.utime(other, (10 + i, 10 + i))
    read_step(DATA / "inch.step")  # from the cache
    read_step(DATA / "metre.step")  # is written: the oldest entries are removed
    assert used.is_file()
    assert not (fresh / "000.glb").exists()
