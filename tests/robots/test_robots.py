"""The contract that every formula found must keep: no list of robots here."""

import subprocess
import sys

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.kinematics import Pose, compile_formula, solve
from twin.kinematics.solve import seeds
from twin.robots import load_formula, names

ROBOTS = names()
ROUND_TRIP = 1e-10  # m or rad
JACOBIAN = 1e-6  # relative


@pytest.fixture(scope="module", params=ROBOTS)
def kin(request):
    return compile_formula(load_formula(request.param))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def states(kin, k, rng):
    """Poses and joints (k, ...) on the preferred branch, within reach, away from singularities."""
    spread = rng.uniform(-1, 1, (4 * k, 6)) * ([0.05] * 3 + [0.3] * 3)
    pick = rng.integers(len(kin.formula.seeds), size=4 * k)
    homes = np.array(list(seeds(kin, rng=0, starts=len(kin.formula.seeds))))[pick]
    if homes.ndim == 3:
        Ts = spatial.pose(spatial.exp_so3(spread[:, 3:]) @ homes[:, :3, :3], homes[:, :3, 3] + spread[:, :3])
        qs = kin.inverse_many(Ts)
    else:
        qs = homes + np.where(kin.revolute, 0.3, 0.005) * rng.uniform(-1, 1, homes.shape)
        Ts = kin.forward_many(qs)
        if len(kin.joints) > 6:  # of all that take the pose, those that the equations choose
            qs = kin.inverse_many(Ts)
    good = np.isfinite(qs).all(axis=1) & np.isfinite(Ts).all(axis=(1, 2))
    Ts, qs = Ts[good], qs[good]
    state = (Ts, None) if kin.closed_inverse else (None, qs)
    fine = kin.branch(*state) == kin.preferred_branch
    for alarm in kin.singularity_alarm(*state).values():
        fine &= ~alarm
    assert fine.sum() >= k, "the seeds of a formula must lie in its workspace"
    return Ts[fine][:k], qs[fine][:k]


def test_every_robot_is_found():
    assert "sils" in ROBOTS


def test_seeds_are_reachable_and_on_the_preferred_branch(kin):
    starts = np.array(list(seeds(kin, rng=0, starts=len(kin.formula.seeds))))
    labels = kin.branch(Ts=starts) if starts.ndim == 3 else kin.branch(qs=starts)
    assert set(labels) == {kin.preferred_branch}


def test_inverse_undoes_forward(kin, rng):
    Ts, qs = states(kin, 2000, rng)
    nudge = rng.uniform(-1, 1, (len(Ts), 6)) * ([2e-3] * 3 + [0.01] * 3)
    near = spatial.pose(spatial.exp_so3(nudge[:, 3:]) @ Ts[:, :3, :3], Ts[:, :3, 3] + nudge[:, :3])
    back = kin.forward_many(qs, near)
    assert np.abs(back - Ts).max() <= ROUND_TRIP
    if kin.closed_inverse:
        assert np.abs(kin.inverse_many(back) - qs).max() <= ROUND_TRIP


def test_single_calls_agree_with_batches(kin, rng):
    Ts, qs = states(kin, 40, rng)
    points, passive = kin.points_many(Ts, qs), kin.passive_many(Ts, qs)
    for i in (0, 7):
        one = slice(i, i + 1)
        if kin.closed_inverse:
            np.testing.assert_array_equal(kin.inverse(Ts[i]), kin.inverse_many(Ts)[i])
        np.testing.assert_array_equal(kin.jacobian(Ts[i], qs[i]), kin.jacobian_many(Ts, qs)[i])
        np.testing.assert_array_equal(kin.inverse_jacobian(Ts[i], qs[i]), kin.inverse_jacobian_many(Ts, qs)[i])
        for name, values in points.items():
            np.testing.assert_array_equal(kin.points_many(Ts[one], qs[one])[name][0], values[i])
        for name, values in passive.items():
            np.testing.assert_array_equal(kin.passive_many(Ts[one], qs[one])[name][0], values[i])
        assert kin.condition(Ts[i], qs[i]) >= 1
    assert points.keys() == kin.formula.points.keys()
    assert set(passive) == set(kin.formula.passive)


def test_cold_forward_finds_the_preferred_branch(kin, rng):
    Ts, qs = states(kin, 8, rng)
    for T, q in zip(Ts, qs, strict=True):
        found = kin.forward(q)
        np.testing.assert_allclose(found, T, rtol=0, atol=ROUND_TRIP)


def test_path_is_followed_from_one_seed(kin, rng):
    _, qs = states(kin, 2, rng)
    path = np.linspace(qs[0], qs[1], 60)
    start = kin.forward(qs[0])
    Ts = kin.forward_many(path, seed=start)
    if kin.closed_inverse:
        back = kin.inverse_many(Ts)  # where there are freedoms to spare, other joints may take the same pose
        off = back - path if len(kin.joints) <= 6 else kin.forward_many(back) - Ts
        assert np.abs(off).max() <= ROUND_TRIP
    assert np.abs(np.diff(Ts, axis=0)).max() < 0.1
    np.testing.assert_allclose(kin.forward_many(path), Ts, atol=ROUND_TRIP)


def test_inverse_jacobian_by_finite_differences(kin, rng):
    if not kin.closed_inverse:
        pytest.skip("no closed inverse")
    Ts, qs = states(kin, 50, rng)
    J = kin.inverse_jacobian_many(Ts)
    if len(kin.joints) < 6:  # most twists are out of reach: it is a left inverse on those that are not
        forward = kin.jacobian_many(Ts, qs)
        assert np.abs(J @ forward - np.eye(len(kin.joints))).max() < 1e-9
        return
    h, want = 1e-5, np.zeros_like(J)
    for i in range(6):
        xi = h * np.eye(6)[i]
        plus, minus = (
            kin.inverse_many(spatial.pose(spatial.exp_so3(s * xi[3:]) @ Ts[:, :3, :3], Ts[:, :3, 3] + s * xi[:3]))
            for s in (1, -1)
        )
        want[:, :, i] = (plus - minus) / (2 * h)
    assert np.abs(J - want).max() <= JACOBIAN * np.abs(want).max()


def test_jacobian_by_finite_differences(kin, rng):
    Ts, qs = states(kin, 20, rng)
    J = kin.jacobian_many(Ts, qs)
    h, want = 1e-6, np.zeros_like(J)
    for i in range(qs.shape[1]):
        dq = h * np.eye(qs.shape[1])[i]
        plus, minus = kin.forward_many(qs + dq, Ts), kin.forward_many(qs - dq, Ts)
        want[:, :3, i] = (plus[:, :3, 3] - minus[:, :3, 3]) / (2 * h)
        turn = plus[:, :3, :3] @ np.swapaxes(minus[:, :3, :3], 1, 2)
        want[:, 3:, i] = spatial.log_so3(turn) / (2 * h)
    assert np.abs(J - want).max() <= JACOBIAN * np.abs(want).max()


def test_points_alone_lead_to_the_joints(kin, rng):
    if not kin.closed_inverse:
        pytest.skip("no closed inverse")
    Ts, qs = states(kin, 30, rng)
    printed = {o for e in kin.formula.equations if e.stage == "inverse" for o in e.outputs}
    if not any({s} & printed if isinstance(s, str) else set(s) <= printed for s in kin.formula.points.values()):
        with pytest.raises(KinematicsError, match="needs"):  # its points are helpers, and lead nowhere
            kin.joints_from_points(kin.points_many(Ts))
        return
    np.testing.assert_allclose(kin.joints_from_points(kin.points_many(Ts)), qs, rtol=0, atol=1e-12)


def test_solver_agrees_with_the_equations(kin, rng):
    Ts, qs = states(kin, 3, rng)
    for T, q in zip(Ts, qs, strict=True):
        found = solve(kin, Pose(T), seed=None if kin.closed_inverse else q + 0.05)
        np.testing.assert_allclose(found.T_base_tool, T, rtol=0, atol=1e-10)
        assert found.branch == kin.preferred_branch
        assert found.residual < 1e-10
        if kin.closed_inverse and len(kin.joints) <= 6:
            np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-9)


def test_measures_reach_and_branch_have_one_value_for_each_sample(kin, rng):
    Ts, qs = states(kin, 5, rng)
    values = {**kin.singularity(Ts, qs), **kin.reach(Ts, qs)}
    assert all(v.shape == (5,) and np.isfinite(v).all() for v in values.values())
    assert all((m >= 0).all() for m in kin.reach(Ts, qs).values())
    assert set(kin.singularity_alarm(Ts, qs)) == {m.name for m in kin.formula.measures}
    assert kin.branch(Ts, qs).shape == (5,)


def test_variants_are_selectable_for_each_equation(kin):
    for equation, variants in kin.choices.items():
        for variant in variants:
            chosen = compile_formula(kin.formula, {equation: variant}).variants
            assert chosen == {**kin.variants, equation: variant}
        with pytest.raises(KinematicsError, match=f"no variant 'nope'.*{variants[0]}"):
            compile_formula(kin.formula, {equation: "nope"})


def test_one_name_chooses_it_in_every_equation_that_has_it(kin):
    every = {v for variants in kin.choices.values() for v in variants}
    for name in every:
        chosen = compile_formula(kin.formula, name).variants
        assert all(chosen[e] == name for e, v in kin.choices.items() if name in v)
    with pytest.raises(KinematicsError, match="no variant 'nope'"):
        compile_formula(kin.formula, "nope")


def test_every_variant_that_departs_from_the_print_says_why(kin):
    for e in kin.formula.equations:
        if len(e.variants) > 1:
            assert all(len(e.reasons[v]) > 20 for v in e.variants)


def test_parameters_have_provenance_and_can_be_replaced(kin):
    assert all(p.note and p.provenance in ("PUBLISHED", "CITED", "DERIVED", "ASSUMED") for p in kin.formula.parameters)
    first = kin.formula.parameters[0]
    assert (
        compile_formula(kin.formula, parameters={first.name: 1.01 * first.value}).parameters[first.name] != first.value
    )
    with pytest.raises(KinematicsError, match="no parameter 'nope'"):
        compile_formula(kin.formula, parameters={"nope": 1.0})
    with pytest.raises(KinematicsError, match="not a finite number"):
        compile_formula(kin.formula, parameters={first.name: float("nan")})


def test_wrong_input_is_named(kin):
    n = len(kin.joints)
    with pytest.raises(KinematicsError, match=r"poses must have shape \(4, 4\)"):
        kin.inverse(np.eye(3))
    with pytest.raises(KinematicsError, match=r"poses must have shape \(k, 4, 4\)"):
        kin.inverse_many(np.eye(4))
    with pytest.raises(KinematicsError, match=rf"q must have shape \({n},\)"):
        kin.forward(np.zeros(n + 1))
    with pytest.raises(KinematicsError, match=rf"q must have shape \(k, {n}\)"):
        kin.forward_many(np.zeros(n))


def test_listing_robots_imports_no_casadi():
    code = "import sys, twin.robots as r; r.names(); sys.exit('casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
