"""Compiled closed loops: judged by the reference, by closed forms and by finite differences, and what they refuse."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

import twin
from made import loops as made
from made import mechanisms
from twin.analysis.error_propagation import ErrorPropagation, Spread
from twin.core import spatial
from twin.core.errors import AssemblyError, MechanismError
from twin.kinematics.closed_loops import LoopSolver, linear
from twin.kinematics.closed_loops.equations import LoopEquations
from twin.kinematics.closed_loops.placing import LinkPoses
from twin.model.mechanism import Coupling
from twin.reference import ReferenceModel

ROBOTS = twin.names()


@pytest.fixture(scope="module")
def solvers():
    return {n: LoopSolver(twin.load(n).mechanism) for n in ROBOTS}


def around(solver, rng, count, length=0.01, angle=0.2):
    size = [angle if j.is_angle else length for j in solver.mechanism.active]
    return solver.q + rng.uniform(-1, 1, (count, len(solver.q))) * size


# -- against the independent model ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_are_those_of_the_reference(solvers, name, rng):
    solver = solvers[name]
    q = around(solver, rng, 60, length=0.005)
    found = solver.forward_many(q)
    run = ReferenceModel(solver.mechanism).solve_many(q)
    assert np.abs(found.Ts_base_tool - run.Ts_base_tool).max() < 1e-9
    assert found.offset.max() < 1e-11
    assert found.tilt.max() < 1e-11
    assert found.margin.min() > 0


@pytest.mark.parametrize("name", ROBOTS)
def test_one_state_is_the_same_as_many(solvers, name, rng):
    solver = solvers[name]
    q = around(solver, rng, 9)
    many = solver.forward_many(q).Ts_base_tool
    for i in range(9):
        assert np.abs(solver.forward(q[i]) - many[i]).max() < 1e-12


@pytest.mark.parametrize("name", ROBOTS)
def test_links_of_small_and_large_moves_are_those_of_the_reference(solvers, name, rng):
    solver = solvers[name]
    model = ReferenceModel(solver.mechanism)
    links, seed = LinkPoses(solver), None
    small = solver.q + np.cumsum(rng.normal(size=(4, len(solver.q))) * 1e-3, axis=0)
    for q in (*small, *around(solver, rng, 3), solver.q):
        seed, found = model.solve(q, seed), links(q)
        assert found.keys() == seed.link_poses.keys()
        for body, T in seed.link_poses.items():
            np.testing.assert_allclose(found[body], T, atol=1e-9, err_msg=body)


def test_links_of_loops_that_cannot_be_closed_raise_and_the_next_state_is_found(solvers):
    solver = solvers["sils"]
    links = LinkPoses(solver)
    home = links(solver.q)
    with pytest.raises(AssemblyError, match="cannot be closed"):
        links(solver.q + np.eye(len(solver.q))[0] * 0.5)
    again = links(solver.q)
    assert all(np.allclose(again[body], T, atol=1e-12) for body, T in home.items())


def test_sils_is_closed_on_its_branch_from_a_cold_start_anywhere(solvers, rng):
    """Poses up to 40 mm and 23 degrees an axis from the middle; the truth is the equations' closed inverse."""
    solver = solvers["sils"]
    shift, turn = rng.uniform(-0.04, 0.04, (20_000, 3)), rng.uniform(-0.4, 0.4, (20_000, 3))
    Ts = solver.forward(solver.q) @ spatial.pose(spatial.exp_so3(turn), shift)
    q = twin.load("sils").kinematics().inverse_many(Ts)
    reached = np.isfinite(q).all(axis=1)
    assert reached.mean() > 0.99
    found = solver.forward_many(q[reached])
    assert np.abs(found.Ts_base_tool - Ts[reached]).max() < 1e-9
    assert found.offset.max() < 1e-11


# -- structure -----------------------------------------------------------------------------------------


def largest_slopes(solver, rng):
    """Return the largest entries of the Jacobian of the residual by the passive states, over five random states."""
    e = solver.equations
    J = ca.Function("J", [e.q, e.states], [ca.densify(e.jacobian)])
    slopes = np.zeros(e.jacobian.shape)
    for _ in range(5):
        state = [x + 0.1 * rng.normal(size=x.shape) for x in solver.home]
        slopes = np.maximum(slopes, np.abs(J(around(solver, rng, 1)[0], np.concatenate([[], *state])).full()))
    return slopes


@pytest.mark.parametrize("name", ROBOTS)
def test_loops_fall_apart_into_the_smallest_blocks(solvers, name, rng):
    """The truth is SciPy's: each state gets a row of its own, then states that need each other are one component."""
    found = solvers[name].blocks
    assert all(b.is_square for b in found)
    used = np.zeros(0, int)
    if found:
        used = np.concatenate([b.rows for b in found])
    needs = csr_array(largest_slopes(solvers[name], rng)[used] > 1e-9)
    row_of_state = maximum_bipartite_matching(needs, perm_type="row")
    assert (row_of_state >= 0).all()
    _, component = connected_components(needs[row_of_state], directed=True, connection="strong")
    sizes = np.bincount(component) if len(component) else []
    assert sorted(len(b.columns) for b in found) == sorted(sizes)


@pytest.mark.parametrize("name", ["sils", "sher", "lapbot"])
def test_a_block_needs_only_what_was_found_before(solvers, name, rng):
    solver = solvers[name]
    known = set()
    slopes = largest_slopes(solver, rng)
    for block in solver.blocks:
        known |= set(block.columns)
        others = sorted(set(range(slopes.shape[1])) - known)
        assert np.abs(slopes[np.ix_(block.rows, others)]).max(initial=0) < 1e-12
    assert len(known) == slopes.shape[1]


@pytest.mark.parametrize("name", ["sils", "sher", "lapbot", "hibou"])
def test_the_jacobian_is_the_derivative_of_the_residual(solvers, name, rng):
    e = solvers[name].equations
    moved = ca.vertcat(*[p.stepped(p.step) for p in e.passive])
    at = ca.Function("at", [e.q, e.states, e.steps], [ca.substitute(e.residual, e.states, moved)])
    J = ca.Function("J", [e.q, e.states], [ca.densify(e.jacobian)])
    q, x, h = around(solvers[name], rng, 1)[0], np.concatenate(solvers[name].home), 1e-6
    eye = h * np.eye(e.steps.numel())
    slopes = np.column_stack([(at(q, x, s).full() - at(q, x, -s).full()) / (2 * h) for s in eye])
    assert np.abs(slopes - J(q, x).full()).max() < 1e-8


# -- other mechanisms ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("names", [("q", "e"), ("error", "pose")])
def test_joints_may_be_called_as_the_values_of_a_kernel(names):
    """A passive joint `q` or `e` of a user is told from the values of the same name inside."""
    plain, called = mechanisms.four_bar(), dict(zip(("elbow", "rocker_joint"), names, strict=True))
    renamed = replace(plain, joints=tuple(replace(j, name=called.get(j.name, j.name)) for j in plain.joints))
    q = np.array([plain.posture("home")[0] + 0.3])
    np.testing.assert_array_equal(LoopSolver(renamed).forward(q), LoopSolver(plain).forward(q))
    spread = Spread(1e-5, 1e-5, 1e-6, 1e-5)
    budgets = [ErrorPropagation(m, spread).budget("q", q, 1000) for m in (plain, renamed)]
    np.testing.assert_array_equal(budgets[0].sampled, budgets[1].sampled)


def test_the_four_bar_follows_its_closed_form_through_a_full_turn():
    bars = mechanisms
    solver = LoopSolver(bars.four_bar())
    assert [(len(b.rows), len(b.columns)) for b in solver.blocks] == [(2, 2)]
    cranks = bars.CRANK_AT_REST + np.linspace(0, 2 * np.pi, 721)
    found = solver.forward_many(cranks[:, None])
    for k, crank in enumerate(cranks):
        T = bars.four_bar_state(crank)[0]["coupler"] @ solver.mechanism.frame("tool").T_body_frame
        assert np.abs(found.Ts_base_tool[k] - T).max() < 1e-12
    assert found.margin.min() > 0


@pytest.mark.parametrize("closure", ["prismatic", "cylindrical"])
def test_a_slider_crank_closed_by_its_guide(closure):
    angles = np.linspace(0, 2 * np.pi, 200)
    found = LoopSolver(made.slider_crank(closure)).forward_many(angles[:, None])
    x = 0.1 * np.cos(angles) + np.sqrt(0.3**2 - (0.1 * np.sin(angles)) ** 2)
    assert np.abs(found.Ts_base_tool - spatial.pose(p=np.stack([x, 0 * x, 0 * x], axis=-1))).max() < 1e-11


def test_a_rod_between_two_balls_spins_and_still_closes():
    solver = LoopSolver(made.rod())
    lifts = np.linspace(0.05, 0.45, 50)
    found = solver.forward_many(lifts[:, None])
    assert np.abs(found.Ts_base_tool[:, 0, 3] - np.sqrt(made.ROD**2 - lifts**2)).max() < 1e-11
    assert not solver.blocks[0].is_square


def test_a_belt_keeps_the_sum_of_its_joints(rng):
    solver = LoopSolver(made.two_links(Coupling("belt", ("a", "b", "c"), (1.0, 1.0, 1.0), 0.3)))
    found = solver.forward_many(rng.uniform(-2, 2, (50, 2)))
    np.testing.assert_allclose(spatial.rotation_angle(found.Ts_base_tool[:, :3, :3]), 0.3, atol=1e-12)


def test_a_shaft_stays_in_its_trocar_wherever_that_is():
    for place in ([0, 0, 0.3], [0.05, -0.04, 0.25]):
        solver = LoopSolver(made.through_a_trocar().with_trocar(np.array(place)))
        T = solver.forward_many(np.array([[-0.1], [0.0], [0.12]])).Ts_base_tool
        assert spatial.point_to_line(np.array(place), T[:, :3, 3], T[:, :3, 2]).max() < 1e-12


def test_a_mechanism_without_loops_answers_by_its_tree(rng):
    solver = LoopSolver(made.two_links())
    assert solver.blocks == []
    a, b = rng.uniform(-2, 2, (2, 30))
    T = solver.forward_many(np.stack([a, b], axis=1)).Ts_base_tool
    assert np.abs(T[:, 0, 3] - 0.3 * np.cos(a) - 0.2 * np.cos(a + b)).max() < 1e-14


@pytest.mark.parametrize("tilt", [1e-7, 1e-4])
def test_a_tilted_pin_leaves_its_tilt_and_no_more(tilt):
    good = mechanisms.four_bar()
    bent = good.joint("closing").T_child_joint @ spatial.pose(spatial.exp_so3([0.6 * tilt, 0.8 * tilt, 0]))
    joints = tuple(replace(j, T_child_joint=bent) if j.name == "closing" else j for j in good.joints)
    solver = LoopSolver(replace(good, joints=joints))
    found = solver.forward_many(solver.q + np.linspace(-1, 1, 21)[:, None])
    assert np.allclose(found.tilt, tilt, rtol=1e-6)
    straight = LoopSolver(good).forward_many(solver.q + np.linspace(-1, 1, 21)[:, None])
    assert np.abs(found.Ts_base_tool - straight.Ts_base_tool).max() < 0.2 * tilt


# -- what it refuses -----------------------------------------------------------------------------------


def test_what_cannot_be_closed_is_nan_or_raises():
    solver = LoopSolver(made.rod())
    found = solver.forward_many(np.array([[0.3], [0.55], [np.nan]]))
    assert np.isfinite(found.Ts_base_tool[0]).all()
    assert np.isnan(found.Ts_base_tool[1:]).all()
    assert found.offset[1] == pytest.approx(0.05, abs=5e-3)
    with pytest.raises(AssemblyError, match=r"m: the loops cannot be closed at q = \[0.55\]: .* gap is 5\d(.\d)? mm"):
        solver.forward(np.array([0.55]))
    with pytest.raises(MechanismError, match="q is not finite"):
        solver.forward(np.array([np.nan]))
    with pytest.raises(MechanismError, match=r"q has shape \(2,\); expected \(1,\)"):
        solver.forward(np.zeros(2))
    with pytest.raises(MechanismError, match=r"q has shape \(3,\); expected \(k, 1\)"):
        solver.forward_many(np.zeros(3))


def test_a_mechanism_that_is_drawn_open_is_refused():
    good = mechanisms.four_bar()
    far = good.joint("closing").T_child_joint @ spatial.pose(p=[0, 0, 0.01])
    joints = tuple(replace(j, T_child_joint=far) if j.name == "closing" else j for j in good.joints)
    with pytest.raises(AssemblyError, match="the loops do not close in the rest poses: 10 mm"):
        LoopSolver(replace(good, joints=joints))


def test_a_start_on_another_branch_does_not_lead_to_it(rng):
    """From anywhere Newton's method finds either state of a four-bar; the determinant tells them apart."""
    solver = LoopSolver(mechanisms.four_bar())
    q = np.tile(solver.q + 0.2, (200, 1))
    seeds = rng.uniform(-3, 3, (200, len(solver._rest_unknowns)))
    right = solver.forward_many(q[:1]).Ts_base_tool[0]
    poses, gaps, _ = solver._kernel_from_seeds(np.ascontiguousarray(q.T), np.ascontiguousarray(seeds.T))
    closed = gaps[0] < 1e-12
    off = np.abs(poses.T.reshape(-1, 3, 4) - right[:3]).max(axis=(1, 2))
    assert (off[closed & (gaps[2] > 0)] < 1e-11).all()
    assert (off[closed & (gaps[2] < 0)] > 1e-3).all()
    assert 20 < (closed & (gaps[2] < 0)).sum() < 180, "the other branch was not tried"
    assert np.abs(solver.forward_many(q, seeds).Ts_base_tool - right).max() < 1e-11


# -- linear systems written out ------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_square_systems_are_solved_and_their_determinant_told(n, rng):
    pattern = rng.random((n, n)) < 0.5
    pattern |= np.eye(n, dtype=bool)[rng.permutation(n)]
    J, b = ca.SX.sym("J", n, n), ca.SX.sym("b", n)
    A = np.where(pattern, rng.normal(size=(n, n)), 0.0)
    x, determinant = linear.solve_square(J, b, pattern, A)
    f = ca.Function("f", [J, b], [x, determinant])
    B = A * rng.uniform(0.8, 1.2, (n, n))
    rhs = rng.normal(size=n)
    got, det = f(B, rhs)
    assert np.abs(B @ got.full().ravel() - rhs).max() < 1e-9 * max(1, np.linalg.cond(B))
    assert abs(float(det)) == pytest.approx(abs(np.linalg.det(B)), rel=1e-9)


@pytest.mark.parametrize(("m", "n"), [(3, 3), (7, 4), (3, 5)])
def test_least_squares_of_any_shape(m, n, rng):
    A, rhs = rng.normal(size=(m, n)), rng.normal(size=m)
    J, b = ca.SX.sym("J", m, n), ca.SX.sym("b", m)
    x = ca.Function("f", [J, b], [linear.solve_least_squares(J, b, np.ones((m, n), bool))])(A, rhs).full().ravel()
    best = np.linalg.lstsq(A, rhs, rcond=None)[0]
    assert np.linalg.norm(A @ x - rhs) == pytest.approx(np.linalg.norm(A @ best - rhs), abs=1e-4)


def test_equations_of_joints_that_move_freely():
    joints = (
        made.Joint("x", "prismatic", "base", "slide", active=True),
        made.Joint("loose", "free", "base", "block"),
        made.Joint("weld", "fixed", "slide", "block", spatial.pose(p=[0.1, 0.2, 0.3])),
    )
    m = made.mechanism(*joints, tool="block", rest={"block": spatial.pose(p=[0.1, 0.2, 0.3])})
    assert LoopEquations(m).residual.numel() == 6
    T = LoopSolver(m).forward(np.array([0.25]))
    assert np.abs(T - spatial.pose(p=[0.1, 0.2, 0.55])).max() < 1e-12
