"""The PA-10 drawing as measured: faces, joints, masses; and a defect shows where it is."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from made.drawing import draw
from twin.cad.build import read_mechanism
from twin.core import spatial
from twin.core.units import DEG
from twin.reference import ReferenceModel
from twin.reference.clearance import clearance

ROOT = Path(__file__).parents[2]
PA10 = ROOT / "cad/pa10"
LENGTHS = {3: 0.450, 5: 0.480, 7: 0.070}


@pytest.fixture(scope="module")
def cad():
    return read_mechanism(PA10 / "pa10.toml")


@pytest.fixture(scope="module")
def model(cad):
    return ReferenceModel(cad.mechanism)


def table(q):
    """Frame 8 of the modified Denavit-Hartenberg table, multiplied here apart from the equations."""
    T = np.eye(4)
    for j, (alpha, angle) in enumerate(zip([0, -90, 90, -90, 90, -90, 90], q, strict=True), 1):
        R = spatial.exp_so3([alpha * DEG, 0, 0]) @ spatial.exp_so3([0, 0, angle])
        T = T @ spatial.pose(R) @ spatial.pose(p=[0, 0, LENGTHS.get(j, 0.0)])
    return T @ spatial.pose(p=[0, 0, 0.330])


def test_all_faces_are_found_and_meet(cad):
    assert cad.findings == ()
    assert len(cad.mechanism.active) == 7


def test_the_drawing_is_the_table(model, rng):
    for q in rng.uniform(-1.5, 1.5, (20, 7)):
        assert np.abs(model.solve(q).T_base_tool - table(q)).max() < 1e-12


def test_it_has_a_freedom_to_spare(model):
    m = model.mobility(model.home().x)
    assert (m.freedom, m.redundancy, m.internal) == (7, 0, 0)
    assert model.redundant


def test_masses_of_the_links_are_those_of_the_cited_model(cad):
    want = {"link1": 9.22, "link2": 4.51, "link3": 5.64, "link4": 2.04, "link5": 2.61, "link6": 2.07, "instrument": 0.5}
    for name, mass in want.items():
        assert cad.mechanism.body(name).inertia.mass == pytest.approx(mass, rel=0.005), name
    assert cad.mechanism.body("link7").inertia.mass == pytest.approx(1.05, rel=0.1)  # steel as drawn
    assert [b.name for b in cad.mechanism.bodies if b.inertia.violations()] == []


def test_named_places_stand_where_the_table_has_them(cad):
    m = cad.mechanism
    for name, z in {"shoulder": 0, "elbow": 0.45, "wrist": 0.93, "flange": 1.0, "tip": 1.33}.items():
        point = m.point(name)
        at = m.rest[point.body] @ np.append(point.p_body, 1)
        assert np.abs(at[:3] - [0, 0, z]).max() < 1e-12, name
    for name, z in {"base": 0, "flange": 1.0, "tool": 1.33, "instrument_tip": 1.33}.items():
        frame = m.frame(name)
        assert np.abs(m.rest[frame.body] @ frame.T_body_frame - spatial.pose(p=[0, 0, z])).max() < 1e-12, name


def test_each_joint_turns_about_its_axis_from_the_x_axis_of_the_world(cad):
    m = cad.mechanism
    for k, joint in enumerate(m.active, 1):
        T = m.rest[joint.parent] @ joint.T_parent_joint
        assert T[:3, 0] == pytest.approx([1, 0, 0], abs=1e-12), joint.name
        assert T[:3, 2] == pytest.approx([0, 0, 1] if k % 2 else [0, 1, 0], abs=1e-12), joint.name


def test_every_dimension_is_used_and_says_where_it_is_from():
    drawn = (PA10 / "parts.py").read_text() + (PA10 / "model.py").read_text()
    forks = {f"{key}{n}" for key in ("gap", "cheek", "fork", "waist", "crotch", "drum") for n in (2, 4, 6)}
    forks |= {f"{key}{n}" for key in ("r", "j") for n in range(1, 8)} | {f"hub{n}" for n in (1, 3, 5, 7)}
    forks |= {f"tube{n}" for n in (3, 5)} | {f"foot{n}" for n in (4, 6)}
    for name, entry in tomllib.loads((PA10 / "dimensions.toml").read_text()).items():
        assert entry["provenance"] in {"CITED", "DERIVED", "ASSUMED"}, name
        assert entry["note"], name
        assert re.search(rf"\bd\.{name}\b", drawn) or name in forks, name


def test_cited_lengths_and_assumed_shapes_are_told_apart(cad):
    cited = {d.name.removeprefix("drawing.") for d in cad.dimensions if d.provenance == "CITED"}
    assert {"upper_arm", "forearm", "wrist_flange", "shoulder_high"} <= cited
    assert all(d.note for d in cad.dimensions)


POSTURES = [
    [61.41389, 8.88466, 0, 87.37881, -10.12347, 78.44788, 0],
    [0, 90, 0, 90, 0, 90, 0],
    [0, -60, 45, 100, 90, -90, 0],
    [30, 45, -45, 110, 200, 60, 0],
]


@pytest.mark.nightly
def test_links_do_not_run_through_each_other(cad, model):
    sweeps = [np.eye(7)[k] * a for k, end in ((1, 90), (3, 130), (5, 100)) for a in np.linspace(-end, end, 9)]
    q = np.repeat([*POSTURES, *sweeps], 5, axis=0)  # contacts of jointed bodies are looked for at every fifth sample
    found = clearance(cad.mechanism, model.link_poses(model.solve_many(q * DEG).x))
    worst = int(np.argmin(found.distance))
    assert found.distance[worst] > 1e-3, (q[worst], found.pair[worst])
    assert found.contacts == ()


@pytest.mark.slow
def test_a_drawn_defect_shows(tmp_path):
    extra = "\n[part.link3]\nbore4_offset_mm = [0.03, -0.04]\n"
    (tmp_path / "dimensions.toml").write_text((PA10 / "dimensions.toml").read_text() + extra)
    draw(PA10 / "model.py", "--dimensions", tmp_path / "dimensions.toml", "--out", tmp_path / "pa10.step")
    (tmp_path / "pa10.toml").write_text((PA10 / "pa10.toml").read_text())
    found = read_mechanism(tmp_path / "pa10.toml", with_mass=False).findings
    assert [(f.where, f.code) for f in found] == [("q4", "cad.meeting")]
    assert found[0].size == pytest.approx(0.05, abs=1e-6)
