"""Masses and inertias: what can be passes, what cannot is told, and a slip of the pen is named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from twin.cli import main
from twin.core import spatial
from twin.model.body import Mesh
from twin.model.inertia import Inertia
from twin.validation.masses import mass_sources, physical_limits, published_moments
from twin.validation.masses.physical_limits import StatedInertia, hull_distance, judged_inertia, stated_inertia
from twin.validation.masses.probable_mistake import misfit, probable_mistakes

SLOW = settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))


def body(seed: int, uneven: float = 0.0, extent=(0.05, 0.12, 0.3)) -> tuple[Inertia, tuple[Mesh, ...]]:
    """A box of three different sides, anywhere, weighed by trimesh; `uneven` adds point masses inside it."""

    rng = np.random.default_rng(seed)
    R, p = spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3) * 0.3
    box = trimesh.creation.box(np.array(extent) * rng.uniform(0.8, 1.25, 3))
    vertices = box.vertices @ R.T + p
    mesh = Mesh("box", vertices, np.asarray(box.faces, np.int32))
    made = trimesh.Trimesh(vertices, box.faces, process=False)
    made.density = 2700.0
    mass, com, I = float(made.mass), np.array(made.center_mass), np.array(made.moment_inertia)  # noqa: E741
    if uneven:
        points = (rng.uniform(-0.5, 0.5, (4, 3)) * box.extents) @ R.T + p
        masses = rng.uniform(0, uneven * mass, 4)
        total = mass + masses.sum()
        centre = (mass * com + masses @ points) / total
        for m, at in ((mass, com), *zip(masses, points, strict=True)):
            r = at - centre
            I = I + m * ((r @ r) * np.eye(3) - np.outer(r, r))  # noqa: E741
        mass, com = total, centre
    return Inertia(mass, com, I), (mesh,)


def codes(found):
    return [f.code for f in found]


@SLOW
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.05]))
def test_a_body_that_can_be_passes(seed, uneven):
    inertia, meshes = body(seed, uneven)
    out = judged_inertia(stated_inertia("b", "test", inertia, meshes))
    assert out.findings == ()
    assert out.definite > 0
    assert 0 <= out.least <= inertia.mass
    assert out.outside == 0
    assert out.density == pytest.approx(2700 * (1 + 4 * uneven), rel=0.2)


@SLOW
@given(st.integers(0, 10**6))
def test_moments_of_point_masses_are_possible_and_the_least_mass_is_the_edge(seed):
    rng = np.random.default_rng(seed)
    m, p = rng.uniform(0.1, 2, 6), rng.normal(size=(6, 3))
    S = np.einsum("k,ki,kj->ij", m, p, p)
    tensor, first = np.trace(S) * np.eye(3) - S, m @ p
    least = physical_limits.least_mass(tensor, first)
    assert 0 < least <= m.sum() * (1 + 1e-9)
    assert least == pytest.approx(float(first @ np.linalg.solve(S, first)), rel=1e-6)
    assert codes(judged_inertia(StatedInertia("b", "t", 0.99 * least, first, tensor)).findings) == [
        "inertia.impossible"
    ]
    assert judged_inertia(StatedInertia("b", "t", 1.5 * least, first, tensor)).findings == ()


@SLOW
@given(st.integers(0, 10**6))
def test_the_other_sign_of_the_products_is_named(seed):
    inertia, meshes = body(seed)
    I = inertia.I_com  # noqa: E741
    products = np.array([I[0, 1], I[0, 2], I[1, 2]])
    assume(np.linalg.norm(products) > 0.15 * np.abs(I).max())
    assume(np.sort(np.abs(products))[0] > 0.05 * np.abs(I).max())  # a flip of all is then no exchange of axes
    wrong = replace(inertia, I_com=2 * np.diag(np.diag(I)) - I)
    found = judged_inertia(stated_inertia("b", "t", wrong, meshes)).findings
    assert {"inertia.sign", "inertia.impossible"} & set(codes(found))


@SLOW
@given(st.integers(0, 10**6), st.sampled_from([-3, -2, -1, 1, 2, 3]))
def test_a_lost_decimal_mark_of_the_whole_tensor_is_named(seed, power):
    inertia, meshes = body(seed)
    found = judged_inertia(
        stated_inertia("b", "t", replace(inertia, I_com=inertia.I_com * 10.0**power), meshes)
    ).findings
    assert "inertia.decimal" in codes(found)
    assert f"{10.0**power:g} times" in next(f.message for f in found if f.code == "inertia.decimal")


@SLOW
@given(st.integers(0, 10**6), st.integers(0, 2))
def test_a_lost_decimal_mark_of_one_moment_is_named(seed, i):
    inertia, meshes = body(seed)
    tensor = inertia.I_com.copy()
    tensor[i, i] *= 10
    found = judged_inertia(stated_inertia("b", "t", replace(inertia, I_com=tensor), meshes)).findings
    told = [f.message for f in found if f.code == "inertia.decimal"]
    assert any(f"I{'xyz'[i] * 2} " in t for t in told)


@SLOW
@given(st.integers(0, 10**6), st.sampled_from([-2, 2, 3]))
def test_a_lost_decimal_mark_of_the_mass_is_named(seed, power):
    inertia, meshes = body(seed)
    found = judged_inertia(stated_inertia("b", "t", replace(inertia, mass=inertia.mass * 10.0**power), meshes)).findings
    told = next(f for f in found if f.code == "inertia.density")
    assert f"{abs(power)} places" in told.message


@pytest.mark.parametrize("order", [(0, 2, 1), (2, 1, 0), (1, 2, 0)])  # two alike axes exchanged cannot be told
def test_exchanged_axes_are_named(order):

    box = trimesh.creation.box((0.05, 0.15, 0.4))
    meshes = (Mesh("box", box.vertices, np.asarray(box.faces, np.int32)),)
    box.density = 2700.0
    tensor = np.array(box.moment_inertia)[np.ix_(order, order)]
    found = judged_inertia(stated_inertia("b", "t", Inertia(float(box.mass), np.zeros(3), tensor), meshes)).findings
    assert codes(found) == ["inertia.axes"]


def test_a_tensor_about_the_origin_is_named_where_one_about_the_mass_centre_is_said():
    inertia, meshes = body(7, extent=(0.05, 0.06, 0.3))
    p = inertia.p_body_com * 0 + np.array([0.3, -0.2, 0.1])
    shift = p - inertia.p_body_com
    meshes = tuple(replace(m, vertices=m.vertices + shift) for m in meshes)
    wrong = inertia.I_com + inertia.mass * ((p @ p) * np.eye(3) - np.outer(p, p))
    found = judged_inertia(stated_inertia("b", "t", Inertia(inertia.mass, p, wrong), meshes)).findings
    assert codes(found) == ["inertia.origin"]
    assert "about the frame's origin" in found[0].message


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"mass": -1.0}, "inertia.mass"),
        ({"mass": float("nan")}, "inertia.number"),
        ({"I_com": np.diag([1.0, 1.0, 2.5])}, "inertia.impossible"),
        ({"I_com": np.diag([-1.0, 1.0, 1.0])}, "inertia.impossible"),
        ({"I_com": np.array([[1.0, 0.2, 0], [0, 1, 0], [0, 0, 1]])}, "inertia.symmetry"),
    ],
)
def test_what_no_body_has_is_told(change, code):
    found = judged_inertia(stated_inertia("b", "t", replace(Inertia(1.0, np.zeros(3), np.eye(3)), **change))).findings
    assert code in codes(found)


def test_a_mass_centre_outside_the_shapes_is_told_and_measured():
    inertia, meshes = body(3)
    far = np.array([0.5, 0, 0])
    found = judged_inertia(stated_inertia("b", "t", replace(inertia, p_body_com=inertia.p_body_com + far), meshes))
    assert "inertia.outside" in codes(found.findings)
    vertices = meshes[0].vertices
    p = inertia.p_body_com + far
    rng = np.random.default_rng(0)
    mixes = rng.dirichlet(np.full(8, 0.3), 20000) @ vertices
    assert found.outside <= np.linalg.norm(mixes - p, axis=1).min() + 1e-9
    assert found.outside == pytest.approx(np.linalg.norm(mixes - p, axis=1).min(), rel=0.05)
    odd = judged_inertia(stated_inertia("b", "t", replace(inertia, p_body_com=p), meshes, own_shapes=False))
    assert {f.severity for f in odd.findings} == {"warning"}  # somebody else's drawing


def test_a_mass_centre_in_the_middle_of_a_flat_sheet_is_inside():
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0], [0, 0.2, 0]])
    sheet = Mesh("sheet", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    assert hull_distance(np.array([0.1, 0.1, 0.0]), [sheet]) == pytest.approx(0, abs=1e-9)
    assert hull_distance(np.array([0.1, 0.1, 0.03]), [sheet]) == pytest.approx(0.03, rel=1e-6)
    assert hull_distance(np.array([0.1, 0.24, 0.03]), [sheet]) == pytest.approx(0.05, rel=1e-6)


def test_a_hollow_body_is_not_accused():

    outer, inner = trimesh.creation.box((0.1, 0.12, 0.3)), trimesh.creation.box((0.094, 0.114, 0.294))
    m, n = 2700 * outer.volume, 2700 * inner.volume
    tensor = 2700 * (np.array(outer.moment_inertia) - np.array(inner.moment_inertia))
    meshes = (Mesh("box", outer.vertices, np.asarray(outer.faces, np.int32)),)
    assert judged_inertia(stated_inertia("b", "t", Inertia(m - n, np.zeros(3), tensor), meshes)).findings == ()
    assert probable_mistakes("b", "t", tensor, np.zeros(3), m - n, None) == []
    assert misfit(np.eye(3), np.eye(3)) == 0


# -- the printed tables of the PA-10, by other arithmetic than `twin study`


def test_the_printed_tables_of_the_pa10():
    from twin.core import assets

    source = mass_sources.of_exhibit(assets.files("pa10").cad / "exhibit.toml")
    assert [round(b.least, 3) for b in source.bodies] == [10.036, 9.801, 5.945, 4.906, 2.472, 0.452, 0.087]
    assert codes(source.all_findings) == ["inertia.sign"]
    assert "158.06" in source.findings[0].message
    assert "row 2 alone 93.420 kg" in source.findings[0].message


def test_moments_about_the_mass_centre_need_no_mass():
    """Without a first moment, any mass is possible, also a small one."""
    out = judged_inertia(StatedInertia("b", "t", None, np.zeros(3), np.diag([2.0, 3.0, 4.0])))
    assert (out.least, out.findings) == (0.0, ())
    assert 0 < out.definite < 1
    thin = judged_inertia(StatedInertia("b", "t", None, np.zeros(3), np.diag([1.0, 1.0, 4.0])))
    assert codes(thin.findings) == ["inertia.impossible"]


@SLOW
@given(st.integers(0, 10**6))
def test_the_sign_of_printed_products_is_told_by_the_mass_that_it_asks_for(seed):
    rng = np.random.default_rng(seed)
    rows, negated = [], []
    for i in range(4):
        inertia, _ = body(int(rng.integers(10**6)))
        s = stated_inertia(f"{i}", "t", inertia)
        rows.append((s.name, s.first, s.tensor))
        negated.append((s.name, s.first, published_moments.negated(s.tensor)))
    assert "inertia.sign" not in codes(mass_sources.of_moments("t", rows).findings)
    told = mass_sources.of_moments("t", negated)
    assert codes(told.findings) in (["inertia.sign"], ["inertia.sign_open"])
    least = sum(physical_limits.least_mass(J, h) for _, h, J in negated)
    if least > 1.1 * sum(b.least for b in told.bodies):
        assert codes(told.findings) == ["inertia.sign"]


@pytest.mark.slow
def test_the_command_on_the_pa10(capsys):
    assert main(["info", "pa10", "--inertia", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    titles = [s["title"] for s in data["sources"]]
    assert titles[0] == "computed from the CAD"
    assert titles[1] == "stage pa10.usda"
    assert "inertia.toml" in titles[2]
    assert {f["code"] for f in data["findings"] if f["severity"] == "disagreement"} == {"inertia.sign"}


@pytest.mark.slow
def test_the_command_on_a_stage_and_on_one_without_masses(capsys, tmp_path):
    from twin.core import assets

    assert main(["info", str(assets.files("sher").stage), "--inertia"]) == 0
    out = capsys.readouterr().out
    assert "inside" in out
    assert "FAILED" not in out


def test_the_command_names_the_part_that_cannot_be_weighed(capsys, tmp_path):
    """The densities of all parts are stated, but one mesh is open: the reason is said, not only the result."""
    solid = trimesh.creation.box((0.1, 0.1, 0.1))
    solid.export(tmp_path / "post.stl")
    solid.update_faces(np.arange(len(solid.faces)) != 3)
    solid.export(tmp_path / "lever.stl")
    still = "{ position_mm = [0, 0, 0], angles_deg = [0, 0, 0] }"
    (tmp_path / "hatch.toml").write_text(f"""
name = "hatch"
title = "One lever on a post"
source = "test"
default_protocol = "none"
base = "post"
[tolerance]
gross_mm = 1
gross_deg = 1
meeting_um = 1
meeting_deg = 0.001
[body.post]
meshes = [{{ file = "post.stl", unit = "m" }}]
[body.lever]
meshes = [{{ file = "lever.stl", unit = "m" }}]
[[joint]]
name = "q"
type = "revolute"
parent = "post"
child = "lever"
active = true
on_parent = {still}
on_child = {still}
[frame.tool]
body = "lever"
at = {still}
[material.steel]
density_kg_m3 = 7850
parts = ["post", "lever"]
provenance = "ASSUMED"
note = "test"
""")
    (tmp_path / "cad").mkdir()
    for file in [*tmp_path.glob("*.stl"), tmp_path / "hatch.toml"]:
        file.rename(tmp_path / "cad" / file.name)
    assert main(["info", str(tmp_path), "--inertia"]) == 0
    assert "'lever' is not watertight: its volume is undefined" in capsys.readouterr().out
