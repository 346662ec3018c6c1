"""The PA-10 drawing as measured: faces, joints, masses; and a defect shows where it is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from twin import spatial
from twin.cad.build import read_mechanism
from twin.reference import ReferenceModel
from twin.reference.clearance import clearance
from twin.units import DEG

ROOT = Path(__file__).parents[1]
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
    want = {"link1": 9.22, "link2": 4.51, "link3": 5.64, "link4": 2.04, "link5": 2.61}
    for name, mass in want.items():
        assert cad.mechanism.body(name).inertia.mass == pytest.approx(mass, rel=0.005)


def test_cited_lengths_and_assumed_shapes_are_told_apart(cad):
    cited = {d.name.removeprefix("drawing.") for d in cad.dimensions if d.provenance == "CITED"}
    assert {"upper_arm", "forearm", "wrist_flange", "shoulder_high"} <= cited
    assert all(d.note for d in cad.dimensions)


@pytest.mark.parametrize(
    "q",
    [
        [61.4, 8.9, 0, 87.4, -10.1, 78.4, 0],
        [0, 90, 0, 90, 0, 90, 0],
        [0, -60, 45, 100, 90, -90, 0],
        [30, 45, -45, 110, 200, 60, 0],
    ],
)
def test_links_do_not_run_through_each_other(cad, model, q):
    x = model.solve(np.array(q) * DEG).x
    found = clearance(cad.mechanism, model.link_poses(x[None]))
    assert found.distance[0] > 1e-3, found.pair
    assert found.contacts == ()


@pytest.mark.slow
def test_the_committed_drawing_is_current_and_a_defect_shows(tmp_path):
    command = [sys.executable, PA10 / "model.py", "--quiet"]
    subprocess.run([*command, "--out", tmp_path / "again.step"], check=True, timeout=300)
    assert (tmp_path / "again.step").read_bytes() == (PA10 / "pa10.step").read_bytes()
    extra = "\n[part.link3]\nbore4_offset_mm = [0.03, -0.04]\n"
    (tmp_path / "dimensions.toml").write_text((PA10 / "dimensions.toml").read_text() + extra)
    command += ["--dimensions", tmp_path / "dimensions.toml", "--out", tmp_path / "pa10.step"]
    subprocess.run(command, check=True, timeout=300)
    (tmp_path / "pa10.toml").write_text((PA10 / "pa10.toml").read_text())
    found = read_mechanism(tmp_path / "pa10.toml", with_mass=False).findings
    assert [(f.where, f.code) for f in found] == [("q4", "cad.meeting")]
    assert found[0].size == pytest.approx(0.05, abs=1e-6)
