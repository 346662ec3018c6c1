"""The drawings of Lapbot and Hibou as measured, and the equations against them over the whole workspace."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.cad.build import read_mechanism
from twin.core import spatial
from twin.kinematics import compile_formula
from twin.reference import ReferenceModel
from twin.reference.clearance import clearance
from twin.robots import load_formula

ROOT = Path(__file__).parents[2]
from made.trocars import TROCAR, lapbot_poses


@pytest.fixture(scope="module", params=["lapbot", "hibou"])
def robot(request):
    cad = read_mechanism(ROOT / f"cad/{request.param}/{request.param}.toml")
    return request.param, cad, ReferenceModel(cad.mechanism), compile_formula(load_formula(request.param))


def test_all_faces_are_found_and_meet(robot):
    _, cad, _, _ = robot
    assert cad.findings == ()
    assert all(d.provenance == "ASSUMED" and d.note for d in cad.dimensions)


def test_structure_is_the_published_one(robot):
    name, cad, model, _ = robot
    chain = [j for j in cad.mechanism.joints if j.name.startswith("q")]
    assert len(chain) == {"lapbot": 9, "hibou": 7}[name]
    assert len(cad.mechanism.active) == {"lapbot": 6, "hibou": 5}[name]
    assert chain[0].type == {"lapbot": "prismatic", "hibou": "revolute"}[name]
    m = model.mobility(model.home().x)
    assert (m.freedom, m.redundancy, m.internal) == ({"lapbot": 6, "hibou": 5}[name], 0, 0)
    np.testing.assert_allclose(cad.mechanism.trocar_at(), TROCAR, atol=1e-12)


def test_without_its_belt_lapbot_has_an_idle_freedom():
    mechanism = read_mechanism(ROOT / "cad/lapbot/lapbot.toml", with_mass=False).mechanism
    loose = ReferenceModel(replace(mechanism, couplings=()))
    m = loose.mobility(loose.home().x)
    assert (m.freedom, m.internal) == (7, 1)


def test_the_drawn_posture_is_that_of_the_equations(robot):
    _, cad, model, kin = robot
    home = model.home()
    np.testing.assert_allclose(kin.inverse(home.T_base_tool), home.q, atol=1e-12)
    np.testing.assert_allclose(home.q, cad.mechanism.posture("home"), atol=1e-9)
    found = clearance(cad.mechanism, model.link_poses(home.x[None]))
    assert found.distance[0] > 1e-3, found.pair
    assert found.contacts == ()


def targets(name, kin, count):
    """Reachable joint values for tools about the trocar."""
    if name == "lapbot":
        q = kin.inverse_many(lapbot_poses(count, 9))
        return q[np.isfinite(q).all(axis=1)]
    rng = np.random.default_rng(9)
    inner = TROCAR + np.column_stack([rng.uniform(-0.08, 0.08, (count, 2)), -rng.uniform(0.05, 0.18, count)])
    W = inner + 0.30 * (TROCAR - inner) / np.linalg.norm(TROCAR - inner, axis=1)[:, None]
    rr, zz = np.hypot(W[:, 0], W[:, 1]), W[:, 2] - 0.35
    q3 = np.arccos((rr**2 + zz**2 - 0.18) / 0.18)
    q2 = np.arctan2(-zz, rr) - np.arctan2(0.3 * np.sin(q3), 0.3 + 0.3 * np.cos(q3))
    return np.column_stack([np.arctan2(W[:, 1], W[:, 0]), q2, q3, rng.uniform([-3, -0.7], [3, 0.7], (count, 2))])


@pytest.mark.parametrize("count", [60, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_equations_and_mechanism_agree_over_the_workspace(robot, count):
    """A = B: tool, passive joints, points; the shaft in its trocar; the loop closed."""
    name, _, model, kin = robot
    q = targets(name, kin, count)
    run = model.solve_many(q)
    Ts = kin.forward_many(q)
    assert np.abs(run.Ts_base_tool - Ts).max() < 1e-9
    assert run.gaps.max() < 1e-11
    for joint, value in kin.passive_many(Ts=Ts).items():
        assert np.abs(np.angle(np.exp(1j * (value - run.q_passive[joint])))).max() < 1e-9
    points = kin.points_many(Ts=Ts)
    for point in set(points) & set(run.points):
        assert np.abs(points[point] - run.points[point]).max() < 1e-9
    shaft = run.points["outer"] - run.points["inner"]
    assert spatial.point_to_line(TROCAR, run.points["inner"], shaft).max() < 1e-9
    assert len(q) > 0.98 * count


def test_a_trocar_elsewhere_is_followed(robot):
    name, cad, _, _ = robot
    at = TROCAR + np.array([0.02, 0.015, -0.01])
    model = ReferenceModel(cad.mechanism.with_trocar(at))
    kin = compile_formula(
        load_formula(name), parameters=dict(zip(("trocar_x", "trocar_y", "trocar_z"), at, strict=True))
    )
    q = cad.mechanism.posture("home")
    np.testing.assert_allclose(model.solve(q).T_base_tool, kin.forward(q), atol=1e-10)
