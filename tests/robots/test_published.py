"""Published and derived numbers of the SILS robot against its formula, at their printed precision."""

import tomllib
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.units import DEG, MM
from twin.kinematics import compile_formula
from twin.robots import load_formula

DATA = tomllib.loads((Path(__file__).parents[1] / "data" / "sils_published.toml").read_text(encoding="utf-8"))
TOL = DATA["tolerance"]
POSES = DATA["pose"]
TABLE2 = ("C", "B", "I", "T")
FORMULA = load_formula(DATA["robot"])
SIGMA = np.array([1, -1, 1])


@pytest.fixture(scope="module")
def kin():
    return compile_formula(FORMULA)


@pytest.fixture(scope="module")
def printed1():
    return compile_formula(FORMULA, {"eq1": "printed"})


@pytest.fixture(scope="module")
def printed2():
    return compile_formula(FORMULA, {"eq2": "printed"})


def pose_of(mm_deg):
    """T_base_tool by numpy alone: Rz(psi) Ry(theta) Rx(phi)."""
    psi, theta, phi = np.asarray(mm_deg[3:]) * DEG
    R = spatial.rotation_z(psi) @ spatial.exp_so3([0, theta, 0]) @ spatial.exp_so3([phi, 0, 0])
    return spatial.pose(R, np.asarray(mm_deg[:3]) * MM)


def poses_of(names):
    return np.array([pose_of(POSES[n]["pose_mm_deg"]) for n in names])


def sides(points):
    return [np.linalg.norm(points[a] - points[b], axis=1) for a, b in (("s1", "s2"), ("s1", "s3"), ("s2", "s3"))]


def random_poses(kin, k, angle=30.0, seed=0):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform([150, 60, 40], [520, 600, 420], (k, 3))
    Ts = np.array([pose_of(row) for row in np.hstack([xyz, rng.uniform(-angle, angle, (k, 3))])])
    return Ts[np.isfinite(kin.inverse_many(Ts)).all(axis=1)]


def test_parameters_are_those_of_eq_3(kin):
    assert {k: pytest.approx(v * MM) for k, v in DATA["parameters_mm"].items()} == kin.parameters
    assert {p.name: p.provenance for p in FORMULA.parameters}["L_H"] == "ASSUMED"


@pytest.mark.parametrize("name", TABLE2)
def test_pose_fixture(kin, printed2, name):
    T, want = pose_of(POSES[name]["pose_mm_deg"]), POSES[name]
    points, passive = kin.points_many(T[None]), kin.passive_many(T[None])
    np.testing.assert_allclose(kin.inverse(T) / MM, want["q_mode_n_mm"], rtol=0, atol=TOL["fixture_mm"])
    np.testing.assert_allclose(printed2.inverse(T) / MM, want["q_printed_mm"], rtol=0, atol=TOL["fixture_mm"])
    S = np.array([points[f"s{i}"][0] for i in (1, 2, 3)])
    np.testing.assert_allclose(S / MM, want["S_mm"], rtol=0, atol=TOL["fixture_mm"])
    alpha = [passive[f"rf{i}"][0] / DEG for i in (1, 2, 3)]
    np.testing.assert_allclose(alpha, want["alpha_deg"], rtol=0, atol=TOL["fixture_deg"])
    # beta from the passive bar pivot: sigma (pi/2 - beta); rho and h follow from it.
    beta = np.pi / 2 - SIGMA * [passive[f"r{i}2"][0] for i in (1, 2, 3)]
    np.testing.assert_allclose(50 + 574 * np.sin(beta), want["rho_mm"], rtol=0, atol=TOL["fixture_mm"])
    np.testing.assert_allclose(574 * np.cos(beta), want["h_mm"], rtol=0, atol=TOL["fixture_mm"])
    assert kin.singularity(T[None])["type2"][0] == pytest.approx(want["D"], abs=TOL["fixture_D"])
    assert kin.condition(T) == pytest.approx(want["condition"], abs=TOL["condition"])


@pytest.mark.parametrize("name", TABLE2)
def test_number_of_assemblies(kin, name):
    T = pose_of(POSES[name]["pose_mm_deg"])
    found = kin.branches(kin.inverse(T))
    assert len(found) == POSES[name]["assemblies"]
    np.testing.assert_allclose(kin.inverse_many(np.array(found)), np.tile(kin.inverse(T), (len(found), 1)), atol=1e-11)
    np.testing.assert_allclose(found[0], T, atol=1e-9)
    labels = list(kin.branch(np.array(found)))
    assert labels.count(kin.preferred_branch) == 1
    # Mirror pairs in the plane of the portal.
    x = np.sort([T[0, 3] for T in found])
    np.testing.assert_allclose(x, -x[::-1], atol=1e-9)


@pytest.mark.parametrize("name", TABLE2)
def test_errors_of_eq_1_as_printed(kin, printed1, name):
    T, want = pose_of(POSES[name]["pose_mm_deg"])[None], POSES[name]
    points, right = printed1.points_many(T), kin.points_many(T)
    np.testing.assert_allclose(np.ravel(sides(points)) / MM, want["sides_printed_mm"], rtol=0, atol=TOL["side_mm"])
    for s in ("s1", "s3"):
        shift = np.linalg.norm(points[s] - right[s]) / MM
        assert shift == pytest.approx(want["shift_printed_mm"], abs=TOL["shift_mm"])
    dq = np.abs(printed1.inverse_many(T) - kin.inverse_many(T)).max() / MM
    assert dq == pytest.approx(want["max_dq_printed_mm"], abs=TOL["max_dq_mm"])


def test_corrected_platform_is_rigid_everywhere(kin):
    for side in sides(kin.points_many(random_poses(kin, 500))):
        np.testing.assert_allclose(side, 135 * MM, rtol=0, atol=1e-12)


def test_worst_error_of_eq_1_within_30_deg(kin, printed1):
    grid = [(380, 280, 145, 0, th, ph) for th, ph in product(np.linspace(-30, 30, 13), repeat=2)]
    Ts = np.array([pose_of(g) for g in grid])
    points, right = printed1.points_many(Ts), kin.points_many(Ts)
    worst, tol = DATA["worst"], DATA["worst"]["tolerance_mm"]
    assert np.abs(sides(points)[1] - 135 * MM).max() / MM == pytest.approx(worst["side_error_mm"], abs=tol)
    shift = np.linalg.norm(points["s1"] - right["s1"], axis=1)
    assert shift.max() / MM == pytest.approx(worst["shift_mm"], abs=tol)
    assert abs(grid[int(shift.argmax())][4]) == 30
    assert grid[int(shift.argmax())][5] == 0


@pytest.mark.parametrize("name", TABLE2)
def test_carriage_gaps_literal_and_full(kin, name):
    T = pose_of(POSES[name]["pose_mm_deg"])
    literal = compile_formula(FORMULA, {"eq2": "literal"})
    for robot, key in ((literal, "gap_literal_mm"), (kin, "gap_full_mm")):
        q = robot.inverse(T) / MM
        np.testing.assert_allclose(q[1::2] - q[::2], POSES[name][key], rtol=0, atol=TOL["gap_mm"])


@pytest.mark.parametrize("name", TABLE2)
def test_strut_that_eq_2_as_printed_implies(kin, printed2, name):
    """With odd carriages on the struts, carriage to apex is l_1; as printed the bar carriage is 244 to 396 mm away."""
    T = pose_of(POSES[name]["pose_mm_deg"])
    points, passive, want = (
        kin.points_many(T[None]),
        kin.passive_many(T[None]),
        POSES[name]["implied_strut_mm"],
    )
    for i in range(3):
        for robot, carriage, length in (
            (kin, 2 * i, 182.0),
            (kin, 2 * i + 1, 182.0),
            (printed2, 2 * i + 1, want[i]),
        ):
            pivot = pivot_at(i, robot.inverse(T)[carriage], passive[f"rf{i + 1}"][0])
            span = np.linalg.norm(points[f"apex{i + 1}"][0] - pivot) / MM
            assert span == pytest.approx(length, abs=TOL["strut_mm"])


def axes(i, alpha):
    """e_a, e_r and a point of rail i, written again from the description of the frame."""
    c, s = np.cos(alpha), np.sin(alpha)
    return (
        (np.array([0, 0, 1.0]), np.array([c, s, 0]), np.zeros(3)),
        (np.array([0, 1.0, 0]), np.array([c, 0, -s]), np.array([0, 0, 0.657])),
        (np.array([0, 0, 1.0]), np.array([c, -s, 0]), np.array([0, 0.612, 0])),
    )[i]


def pivot_at(i, q, alpha):
    e_a, e_r, o = axes(i, alpha)
    return o + q * e_a + 50 * MM * e_r


def test_worked_geometry_at_b(kin):
    T = pose_of(POSES["B"]["pose_mm_deg"])
    q, passive, points = kin.inverse(T), kin.passive_many(T[None]), kin.points_many(T[None])
    want, tol = DATA["geometry_B"], TOL["clearance_mm"]
    for i in range(3):
        alpha = passive[f"rf{i + 1}"][0]
        np.testing.assert_allclose(pivot_at(i, q[2 * i], alpha) / MM, want["strut_pivot_mm"][i], rtol=0, atol=tol)
        np.testing.assert_allclose(pivot_at(i, q[2 * i + 1], alpha) / MM, want["bar_pivot_mm"][i], rtol=0, atol=tol)
        np.testing.assert_allclose(points[f"apex{i + 1}"][0] / MM, want["apex_mm"][i], rtol=0, atol=tol)


@pytest.mark.parametrize("name", TABLE2)
def test_passive_joints_by_vectors(kin, name):
    """Signs and zeros measured on directions: angles about t = e_a x e_r, counted from e_r."""
    T = pose_of(POSES[name]["pose_mm_deg"])
    q, passive, points = kin.inverse(T), kin.passive_many(T[None]), kin.points_many(T[None])

    def about(t, start, end):
        return np.arctan2(t @ np.cross(start, end), start @ end)

    for i in range(3):
        n, alpha = i + 1, passive[f"rf{i + 1}"][0]
        e_a, e_r, _ = axes(i, alpha)
        t, apex, S = np.cross(e_a, e_r), points[f"apex{n}"][0], points[f"s{n}"][0]
        strut = apex - pivot_at(i, q[2 * i], alpha)
        bar = apex - pivot_at(i, q[2 * i + 1], alpha)
        assert about(t, e_r, strut) == pytest.approx(passive[f"r{n}1"][0], abs=1e-12)
        assert about(t, e_r, bar) == pytest.approx(passive[f"r{n}2"][0], abs=1e-12)
        assert about(t, strut, bar) == pytest.approx(passive[f"r{n}3"][0], abs=1e-12)
        np.testing.assert_allclose(np.cross(bar, S - apex), 0, atol=1e-12)
        assert np.linalg.norm(S - apex) == pytest.approx(392 * MM, abs=1e-12)


def test_ranges_over_the_protocol(kin):
    passive, tol = kin.passive_many(poses_of(POSES)), DATA["ranges"]["tolerance_deg"]
    for i in range(3):
        alpha = passive[f"rf{i + 1}"] / DEG
        beta = 90 - SIGMA[i] * passive[f"r{i + 1}2"] / DEG
        assert [alpha.min(), alpha.max()] == pytest.approx(DATA["ranges"]["alpha_deg"][i], abs=tol)
        assert [beta.min(), beta.max()] == pytest.approx(DATA["ranges"]["beta_deg"][i], abs=tol)


def test_replacement_pose_keeps_the_rcm(kin):
    want, tol = POSES["T_rcm"], DATA["pose_precision"]["T_rcm"]
    T, B = pose_of(want["pose_mm_deg"]), pose_of(POSES["B"]["pose_mm_deg"])
    np.testing.assert_allclose(T[:3, 3] / MM, (B[:3, 3] - 40 * MM * T[:3, 2]) / MM, rtol=0, atol=2 * tol["pose_mm"])
    np.testing.assert_allclose(kin.inverse(T) / MM, want["q_mode_n_mm"], rtol=0, atol=tol["q_mm"])
    assert kin.singularity(T[None])["type2"][0] == pytest.approx(want["D"], abs=tol["D"])
    assert kin.condition(T) == pytest.approx(want["condition"], abs=TOL["condition"])


@pytest.mark.parametrize("name", ["I", "T", "T_rcm"])
def test_rcm_error_of_each_pose(name):
    T, B = pose_of(POSES[name]["pose_mm_deg"]), pose_of(POSES["B"]["pose_mm_deg"])
    error = spatial.point_to_line(B[:3, 3], T[:3, 3], T[:3, 2]) / MM
    assert error == pytest.approx(DATA["rcm"][f"{name}_mm"], abs=DATA["rcm"]["tolerance_mm"])


def test_jacobian_determinant_is_a_product_of_singularity_measures(kin):
    """det J = -lp^3 D prod_i [-(2 l1/L) (rho_i - l0)/h_i], fact sheet section 7."""
    Ts = random_poses(kin, 3000)
    m = kin.singularity(Ts)
    product_ = -(0.135**3) * m["type2"]
    for i in (1, 2, 3):
        product_ = product_ * -(2 * 0.182 / 0.574) * m[f"bar_along_{i}"] / m[f"bar_across_{i}"]
    np.testing.assert_allclose(np.linalg.det(kin.inverse_jacobian_many(Ts)), product_, rtol=1e-8, atol=1e-15)
    assert len(Ts) > 1500


def test_type_2_vanishes_where_stated(kin):
    angle, tol = DATA["type2_zero"]["theta_deg"], DATA["type2_zero"]["tolerance_deg"]
    Ts = np.array([pose_of((380, 280, 145, 0, angle + d, 0)) for d in (-tol, tol)])
    D = kin.singularity(Ts)["type2"]
    assert D[0] * D[1] < 0
    assert kin.singularity_alarm(Ts)["type2"].all()


def test_working_aspect_along_the_protocol(kin):
    """D keeps its sign along C, B, I, T and I, T'."""
    for names in (("C", "B", "I", "T"), ("I", "T_rcm")):
        for a, b in pairwise(names):
            ends = np.array([POSES[a]["pose_mm_deg"], POSES[b]["pose_mm_deg"]])
            Ts = np.array([pose_of((1 - s) * ends[0] + s * ends[1]) for s in np.linspace(0, 1, 101)])
            assert (kin.singularity(Ts)["type2"] < -0.69).all()
            assert not np.any(list(kin.singularity_alarm(Ts).values()))
            assert set(kin.branch(Ts)) == {kin.preferred_branch}


def test_unreachable_target_names_the_limb_and_the_gap(kin):
    want = DATA["unreachable"]
    T = pose_of(want["pose_mm_deg"])
    margin = kin.reach(T[None])[want["limb"]][0] / MM
    assert 624 - margin == pytest.approx(want["rho2_mm"], abs=want["tolerance_mm"])
    with pytest.raises(KinematicsError, match=f"{want['limb']} is {-margin:.3f} mm beyond its limit"):
        kin.inverse(T)
    assert np.isnan(kin.inverse_many(T[None])).all()


def test_rail_ends_show_printed_and_corrected_apart(kin, printed2):
    """Facts 1.3: odd carriages on the struts fit the frame but for q4 at C; as printed no pose fits."""
    low, high = np.zeros(6), np.array([657, 657, 612, 612, 657, 657]) * MM
    out = {n: [] for n in TABLE2}
    for n, T in zip(TABLE2, poses_of(TABLE2), strict=True):
        q = kin.inverse(T)
        out[n] = [kin.joints[i] for i in range(6) if not low[i] <= q[i] <= high[i]]
        q = printed2.inverse(T)
        assert ((q < low) | (q > high)).any()
    assert out == {"C": ["q4"], "B": [], "I": [], "T": []}
