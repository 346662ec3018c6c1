"""The independent model against closed forms, itself, finite differences, and its refusals."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from made import mechanisms as made
from made.loops import ALONG_X, ROD, mechanism, rod, slider_crank, through_a_trocar, two_links
from twin.core import spatial
from twin.core.errors import AssemblyError, MechanismError
from twin.core.units import DEG, MM
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import Coupling, Mechanism
from twin.reference import ReferenceModel, sensitivity


@pytest.fixture(scope="module")
def four_bar():
    return ReferenceModel(made.four_bar())


# -- a planar four-bar, closed by a revolute joint in space --------------------------------------------


def test_the_four_bar_follows_its_closed_form_through_a_full_turn(four_bar):
    cranks = made.CRANK_AT_REST + np.linspace(0, 2 * np.pi, 721)
    run = four_bar.run(cranks[:, None])
    links = four_bar.link_poses(run.x)
    for k, crank in enumerate(cranks):
        poses, q = made.four_bar_state(crank)
        for body, T in poses.items():
            assert np.abs(links[body][k] - T).max() < 1e-12
        T_tool = poses["coupler"] @ four_bar.mechanism.frame("tool").T_body_frame
        assert np.abs(run.Ts_base_tool[k] - T_tool).max() < 1e-12
        marker = poses["rocker"] @ np.append(four_bar.mechanism.point("marker").p_body, 1)
        assert np.abs(run.points["marker"][k] - marker[:3]).max() < 1e-12
        for joint in ("elbow", "rocker_joint", "closing"):
            assert abs(np.angle(np.exp(1j * (run.q_passive[joint][k] - q[joint])))) < 1e-11
    assert run.loop_names == ("closing",)
    assert run.gaps.shape == (721, 1, 2)
    assert np.abs(run.gaps).max() < 1e-13
    assert np.array_equal(run.q[:, 0], cranks)


@pytest.mark.parametrize("crank", [-2.5, -0.3, 0.9, 2.2, 4.0])
def test_one_state_of_the_four_bar(four_bar, crank):
    poses, q = made.four_bar_state(crank)
    got = four_bar.solve(np.array([crank]))
    for body, T in poses.items():
        assert np.abs(got.link_poses[body] - T).max() < 1e-12
    assert list(got.q_full) == ["crank_joint", "elbow", "rocker_joint", "closing"]
    assert got.q_full["crank_joint"] == crank
    assert abs(np.angle(np.exp(1j * (got.q_full["closing"] - q["closing"])))) < 1e-12
    assert got.worst_gap < 1e-13
    assert got.gap["closing"][1] < 1e-13
    back = four_bar.solve_pose(got.T_base_tool, seed=four_bar.solve(np.array([crank - 0.01])))
    assert back.q == pytest.approx([crank], abs=1e-11)


def test_the_four_bar_is_planar_so_three_of_its_five_closure_rows_are_redundant(four_bar, rng):
    for crank in rng.uniform(-3, 3, 5):
        m = four_bar.mobility(four_bar.solve(np.array([crank])).x)
        assert (m.freedom, m.redundancy, m.redundant, m.internal) == (1, 3, {"closing": 3}, 0)
        # In the plane the loop is not repeated; out of it every pin of the loop locks the same again.
        assert m.repeated == {"closing": ("offset z", "turn x", "turn y")}
        assert m.describe() == "closing: 3 among offset z, turn x, turn y"


# -- other closures ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("closure", "redundancy"), [("prismatic", 3), ("cylindrical", 2)])
def test_a_slider_crank_closed_by_its_guide(closure, redundancy):
    model = ReferenceModel(slider_crank(closure))
    angles = np.linspace(0, 2 * np.pi, 200)
    run = model.run(angles[:, None])
    x = 0.1 * np.cos(angles) + np.sqrt(0.3**2 - (0.1 * np.sin(angles)) ** 2)
    assert np.abs(run.Ts_base_tool - spatial.pose(p=np.stack([x, 0 * x, 0 * x], axis=-1))).max() < 1e-12
    assert np.abs(run.gaps).max() < 1e-13
    if closure == "prismatic":
        assert np.abs(run.q_passive["guide"] - x).max() < 1e-12
    m = model.mobility(run.x[33])
    assert (m.freedom, m.redundancy, m.internal) == (1, redundancy, 0)


def test_a_weld_that_closes_a_loop_makes_two_slides_one():
    turned = spatial.pose(spatial.exp_so3([0.3, 0.4, -0.2]), [0.1, 0.2, 0.3])
    shift = spatial.pose(p=[0.5, 0.1, 0.0])
    joints = (
        Joint("lead", "prismatic", "base", "a", turned, active=True),
        Joint("follow", "prismatic", "base", "b", turned @ shift),
        Joint("weld", "fixed", "a", "b", shift),
    )
    model = ReferenceModel(mechanism(*joints, tool="b"))
    got = model.solve(np.array([0.07]))
    assert got.q_full == {"lead": 0.07, "follow": pytest.approx(0.07, abs=1e-14)}
    assert np.abs(got.T_base_tool - turned @ shift @ spatial.pose(p=[0, 0, 0.07])).max() < 1e-14
    m = model.mobility(got.x)
    assert (m.freedom, m.redundancy, m.redundant) == (1, 5, {"weld": 5})


def test_a_rod_between_two_balls_spins_and_still_closes():
    model = ReferenceModel(rod())
    lifts = 0.3 + 0.15 * np.sin(np.linspace(0, 6, 300))
    run = model.run(lifts[:, None])
    assert np.abs(run.q_passive["push"] - np.sqrt(ROD**2 - lifts**2)).max() < 1e-12
    assert np.abs(run.gaps).max() < 1e-13
    m = model.mobility(run.x[-1])
    assert (m.freedom, m.redundancy, m.internal) == (2, 0, 1)
    assert m.redundant == {"foot": 0}
    # The spin is nobody's business: the short step leaves it where it was.
    spin = spatial.log_so3(model.link_poses(run.x)["rod"][:, :3, :3])
    assert np.abs(np.diff(spin, axis=0)).max() < 0.02


def test_without_loops_the_tree_alone_answers():
    joints = (
        Joint("a1", "revolute", "base", "a", active=True),
        Joint("a2", "revolute", "a", "b", spatial.pose(p=[0.3, 0, 0]), active=True),
    )
    model = ReferenceModel(mechanism(*joints, tool="b", T_tool=spatial.pose(p=[0.2, 0, 0])))
    got = model.solve(np.array([0.4, -1.1]))
    assert got.T_base_tool[:2, 3] == pytest.approx(
        [0.3 * np.cos(0.4) + 0.2 * np.cos(-0.7), 0.3 * np.sin(0.4) + 0.2 * np.sin(-0.7)], abs=1e-15
    )
    assert got.gap == {}
    assert got.worst_gap == 0.0
    m = model.mobility(got.x)
    assert (m.freedom, m.redundancy, m.redundant, m.internal) == (2, 0, {}, 0)


def test_a_mechanism_that_cannot_move_has_a_pose():
    T = spatial.pose(spatial.exp_so3([0.1, 0.2, 0.3]), [1, 2, 3.0])
    model = ReferenceModel(mechanism(Joint("weld", "fixed", "base", "a", T), tool="a"))
    got = model.solve(np.zeros(0))
    assert np.array_equal(got.T_base_tool, T)
    assert model.mobility(got.x).freedom == 0


# -- SILS ------------------------------------------------------------------------------------------------

SILS_POSTURES = ("home", "insertion", "inserted")
FIXTURE_POSES = {  # Table 2: X, Y, Z in mm, psi, theta, phi in deg
    "home": (407.9, 306.0, 211.4, 10.0, 15.0, 10.0),
    "insertion": (380.0, 280.0, 185.0, 0.0, 0.0, 0.0),
    "inserted": (380.0, 280.0, 145.0, 0.0, 0.0, 0.0),
}


def table_pose(name):
    *p, psi, theta, phi = FIXTURE_POSES[name]
    R = spatial.rotation_z(psi * DEG) @ spatial.exp_so3([0, theta * DEG, 0]) @ spatial.exp_so3([phi * DEG, 0, 0])
    return spatial.pose(R, np.array(p) * MM)


@pytest.mark.parametrize("posture", SILS_POSTURES)
def test_sils_stands_at_the_poses_of_table_2(sils_model, posture):
    got = sils_model.solve(sils_model.mechanism.posture(posture))
    assert np.abs(got.T_base_tool - table_pose(posture)).max() < 2e-11  # postures have nine digits of a mm
    assert got.worst_gap < 1e-13
    back = sils_model.solve_pose(table_pose(posture))
    assert np.abs(back.q - sils_model.mechanism.posture(posture)).max() < 2e-12


@pytest.fixture(scope="module")
def sils_states(sils_model):
    """Fifty random states within 8 mm of the way from home to inserted."""
    rng = np.random.default_rng(7)
    ends = [sils_model.mechanism.posture(n) for n in ("home", "inserted")]
    states = []
    for _ in range(50):
        q = ends[0] + rng.uniform() * (ends[1] - ends[0]) + rng.uniform(-8, 8, 6) * MM
        states.append(sils_model.solve(q))
    return states


def test_sils_has_six_freedoms_and_nine_redundant_rows_everywhere(sils_model, sils_states):
    for state in sils_states:
        m = sils_model.mobility(state.x)
        assert (m.freedom, m.redundancy, m.internal) == (6, 9, 0)
        assert {n: r for n, r in m.redundant.items() if r} == {"r13": 3, "r23": 3, "r33": 3}
        assert state.worst_gap < 1e-13


@pytest.mark.slow
def test_sils_goes_to_a_pose_and_back(sils_model, sils_states):
    for state in sils_states:
        back = sils_model.solve_pose(state.T_base_tool)
        assert np.abs(back.q - state.q).max() < 1e-12
        again = sils_model.solve(back.q, seed=back)
        assert np.abs(again.T_base_tool - state.T_base_tool).max() < 1e-12


@pytest.mark.parametrize("of", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_a_copy_has_poses_of_its_own(of, sils_model, sils_states):
    """Poses are read from Pinocchio's memory: a copy must not read the memory of another, nor what it once held."""
    tree, X = sils_model.tree, np.array([s.x for s in sils_states[:3]])
    other = of(tree)
    for closing_only in (False, True):
        expected = [tree.update(x[None], closing_only=closing_only) for x in X]
        for x, (poses, J) in zip(X[::-1], expected[::-1], strict=True):
            found = other.update(x[None], closing_only=closing_only)
            np.testing.assert_array_equal(found[0], poses)
            np.testing.assert_array_equal(found[1], J)


def test_sils_solves_the_same_from_any_seed(sils_model, sils_states):
    far = sils_states[11]
    for state in sils_states[:10]:
        assert np.abs(sils_model.solve(state.q, seed=far).x - state.x).max() < 1e-11


def bang_bang(q0, q1, count, pieces=6):
    """Accelerations that switch sign at once: positions are pieces of parabolas."""
    sign = np.resize([1.0, -1.0, -1.0, 1.0], pieces)
    qdd = np.repeat(sign, int(np.ceil(count / pieces)))[:count]
    s = np.cumsum(np.cumsum(qdd))
    s = (s - s.min()) / np.ptp(s)
    return q0 + s[:, None] * (q1 - q0)


@pytest.fixture(scope="module")
def sils_run(sils_model):
    ends = [sils_model.mechanism.posture(n) for n in ("home", "inserted")]
    return sils_model.run(bang_bang(*ends, 2000))


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.nightly)])
def test_a_run_equals_its_samples_solved_one_by_one(sils_model, sils_run, every):
    state, worst = None, 0.0
    for k in range(0, 2000, every):
        state = sils_model.solve(sils_run.q[k], seed=state)
        worst = max(worst, np.abs(state.T_base_tool - sils_run.Ts_base_tool[k]).max())
        if k % 100 == 0:
            assert np.abs(state.x - sils_run.x[k]).max() < 1e-11
            for n, p in state.points.items():
                assert np.abs(p - sils_run.points[n][k]).max() < 1e-12
            for n, v in sils_run.q_passive.items():
                assert abs(state.q_full[n] - v[k]) < 1e-11
    assert worst < 1e-12
    assert np.abs(sils_run.gaps).max() < 1e-12


def test_a_run_along_poses_gives_back_the_joints(sils_model, sils_run):
    back = sils_model.run_poses(sils_run.Ts_base_tool)
    assert np.abs(back.q - sils_run.q).max() < 1e-12
    assert np.abs(back.Ts_base_tool - sils_run.Ts_base_tool).max() < 1e-12
    one = sils_model.solve_pose(sils_run.Ts_base_tool[777])
    assert np.abs(one.q - back.q[777]).max() < 1e-12


def test_a_run_reports_its_progress(sils_model, sils_run):
    seen = []
    sils_model.run(sils_run.q[:200], progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert 0 < seen[0] < 0.5


# -- the constraint Jacobian ----------------------------------------------------------------------------


def test_the_tool_jacobian_is_the_derivative_of_the_tool(sils_model, sils_states):
    tree, x, h = sils_model.tree, sils_states[3].x, 1e-6
    poses, J = tree.update(x[None])
    T, J_tool = tree.tool(poses)[0], tree.tool_jacobian(poses, J)[0]
    for i, unit in enumerate(np.eye(tree.model.nv)):
        T1, T0 = (tree.tool(tree.update(pin.integrate(tree.model, x, s * h * unit)[None])[0])[0] for s in (1, -1))
        twist = np.concatenate([T1[:3, 3] - T0[:3, 3], spatial.log_so3(T1[:3, :3] @ T0[:3, :3].T)]) / (2 * h)
        assert np.abs(twist - J_tool[:, i]).max() < 1e-9
    assert spatial.is_pose(T)


# -- loops that do not fit --------------------------------------------------------------------------------


@pytest.mark.parametrize("tilt", [1e-4, 0.01, 0.1])
def test_a_tilted_pin_leaves_its_tilt_as_the_gap_of_that_joint(tilt):
    good = made.four_bar()
    pin_joint = good.joint("closing")
    bent = pin_joint.T_child_joint @ spatial.pose(spatial.exp_so3([0.6 * tilt, 0.8 * tilt, 0]))
    joints = tuple(replace(j, T_child_joint=bent) if j.name == "closing" else j for j in good.joints)
    model = ReferenceModel(replace(good, joints=joints))
    for crank in (made.CRANK_AT_REST, 2.0, -2.5):
        got = model.solve(np.array([crank]))
        offset, angle = got.gap["closing"]
        assert angle == pytest.approx(tilt, rel=1e-9)
        assert offset < 1e-9
        poses, _ = made.four_bar_state(crank)
        assert np.abs(got.link_poses["rocker"] - poses["rocker"]).max() < 1e-8


def test_a_loop_that_is_too_short_shares_its_gap(sils_cad):
    """Two parallel slides welded 0.2 mm askew along their way: nothing can give, the weld shows it."""
    joints = (
        Joint("lead", "prismatic", "base", "a", active=True),
        Joint("follow", "prismatic", "base", "b", spatial.pose(p=[0.5, 0, 0])),
        Joint("weld", "fixed", "a", "b", spatial.pose(p=[0.5002, 0, 0])),
    )
    got = ReferenceModel(mechanism(*joints, tool="b")).solve(np.array([0.05]))
    assert got.gap["weld"] == (pytest.approx(0.2 * MM, rel=1e-12), 0.0)
    assert got.q_full["follow"] == pytest.approx(0.05, abs=1e-15)


# -- refusals ----------------------------------------------------------------------------------------------


def test_poses_out_of_reach_raise(sils_model):
    T = table_pose("home")
    T[0, 3] += 0.5
    with pytest.raises(AssemblyError) as caught:
        sils_model.solve_pose(T)
    assert np.isfinite(caught.value.best.q).all()
    with pytest.raises(AssemblyError, match="at sample 1"):
        sils_model.run_poses(np.stack([table_pose("home"), T]))


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros(5), r"q has shape \(5,\); expected \(6,\) for q1, q2, q3, q4, q5, q6"),
        (np.zeros((1, 6)), r"q has shape \(1, 6\); expected \(6,\)"),
        (np.array([0.1, np.nan, 0, 0, 0, 0]), r"q is not finite: \{'q1': 0\.1, 'q2': nan"),
        (np.array([np.inf, 0, 0, 0, 0, 0]), r"q is not finite: \{'q1': inf"),
    ],
)
def test_joint_values_of_the_wrong_form_are_refused(sils_model, q, message):
    with pytest.raises(MechanismError, match=message):
        sils_model.solve(q)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros((3, 5)), r"q has shape \(3, 5\); expected \(k, 6\) for q1, q2, q3, q4, q5, q6"),
        (np.zeros(6), r"q has shape \(6,\); expected \(k, 6\)"),
        (np.zeros((0, 6)), r"q has no samples"),
        (np.array([[0.1] * 6, [0.1] * 6, [0.1, 0.1, np.nan, 0, 0, 0]]), r"q is not finite at sample 2"),
    ],
)
def test_motions_of_the_wrong_form_are_refused(sils_model, q, message):
    with pytest.raises(MechanismError, match=message):
        sils_model.run(q)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (np.zeros((3, 5)), r"q has shape \(3, 5\); expected \(k, 6\) for q1, q2, q3, q4, q5, q6"),
        (np.zeros((0, 6)), r"q has no rows"),
        (np.array([[0.1] * 6, [0.1, 0.1, np.nan, 0, 0, 0]]), r"q is not finite at row 1"),
    ],
)
def test_rows_of_the_wrong_form_are_refused(sils_model, q, message):
    with pytest.raises(MechanismError, match=message):
        sils_model.solve_many(q)


def test_a_row_at_which_a_loop_stays_open_is_named():
    """Two driven slides, welded: at different values, nothing can give."""
    joints = (
        Joint("lead", "prismatic", "base", "a", active=True),
        Joint("follow", "prismatic", "base", "b", spatial.pose(p=[0.5, 0, 0]), active=True),
        Joint("weld", "fixed", "a", "b", spatial.pose(p=[0.5, 0, 0])),
    )
    model = ReferenceModel(mechanism(*joints, tool="b"))
    with pytest.raises(AssemblyError, match=r"at row 1: .*loops do not close"):
        model.solve_many(np.array([[0.0, 0.0], [0.0, 0.01]]))


@pytest.mark.parametrize("T", [np.full((4, 4), np.nan), np.diag([1.0, 1, -1, 1]), np.eye(3), np.stack([np.eye(4)] * 2)])
def test_poses_of_the_wrong_form_are_refused(sils_model, T):
    with pytest.raises(MechanismError, match=r"the tool pose is not a rigid \(4, 4\) pose"):
        sils_model.solve_pose(T)


@pytest.mark.parametrize("Ts", [np.full((2, 4, 4), np.nan), np.eye(4), np.zeros((0, 4, 4))])
def test_runs_of_poses_of_the_wrong_form_are_refused(sils_model, Ts):
    with pytest.raises(MechanismError, match=r"rigid \(k, 4, 4\) poses"):
        sils_model.run_poses(Ts)


def test_a_tool_that_is_not_there_is_refused():
    with pytest.raises(MechanismError, match=r"there is no frame 'tip'\. Known: tool\."):
        ReferenceModel(replace(rod(), tool="tip"))


# -- what rounding costs -------------------------------------------------------------------------------------


def rounded(mechanism_, keep=None):
    """Store joint frames as UsdPhysics does: float32 position and quaternion."""

    def store(T):
        q = np.float32(spatial.quat_from_matrix_wxyz(T[:3, :3])).astype(float)
        return spatial.pose(spatial.matrix_from_quat_wxyz(q), np.float32(T[:3, 3]).astype(float))

    joints = tuple(
        j
        if keep is not None and j.name not in keep
        else replace(j, T_parent_joint=store(j.T_parent_joint), T_child_joint=store(j.T_child_joint))
        for j in mechanism_.joints
    )
    return replace(mechanism_, joints=joints)


def tool_error(a, b):
    return (
        float(np.linalg.norm(a[:3, 3] - b[:3, 3])),
        float(spatial.rotation_angle(a[:3, :3].T @ b[:3, :3])),
    )


@pytest.mark.parametrize("posture", SILS_POSTURES)
def test_rounding_all_frames_costs_what_is_foretold(sils_model, posture):
    q = sils_model.mechanism.posture(posture)
    exact = sils_model.solve(q)
    foretold = sensitivity.of_rounding(sils_model, exact.x)
    actual = tool_error(exact.T_base_tool, ReferenceModel(rounded(sils_model.mechanism)).solve(q).T_base_tool)
    for got, expected, bound in zip(actual, foretold.expected, foretold.bound, strict=True):
        assert got <= bound
        assert expected / 20 < got < 3 * expected
    assert foretold.worst_joint in {j.name for j in sils_model.mechanism.joints}


def test_rounding_costs_are_of_first_order(sils_model):
    x = sils_model.home().x
    fine, coarse = (sensitivity.of_rounding(sils_model, x, 2.0**-n) for n in (30, 24))
    assert np.array(coarse.bound) == pytest.approx(np.array(fine.bound) * 64, rel=1e-12)
    assert np.array(coarse.expected) == pytest.approx(np.array(fine.expected) * 64, rel=1e-12)


@pytest.mark.parametrize("name", ["rf1", "q4", "r12", "r23", "s1", "s3"])
def test_one_moved_frame_moves_the_tool_as_foretold(sils_model, name):
    """One frame at a time by 0.1 um or 0.1 urad, against the first-order effect that the sum is made of."""
    mechanism_ = sils_model.mechanism
    state = sils_model.home()
    tree = sils_model.tree
    poses, J = tree.update(state.x[None])
    A = tree.loops.evaluate(state.x[None], poses, J)[1][0]
    give = tree.tool_jacobian(poses, J)[0][:, tree.passive] @ np.linalg.pinv(A[:, tree.passive], rcond=1e-9)
    joint = mechanism_.joint(name)
    frame = state.link_poses[joint.parent] @ joint.T_parent_joint
    for axis in range(6):
        twist = np.zeros(6)
        twist[axis] = 1e-7
        effect = sensitivity._effect(sils_model, joint, frame, twist, state.link_poses, state.T_base_tool, give)
        moved = joint.T_parent_joint @ spatial.pose(spatial.exp_so3(twist[3:]), twist[:3])
        changed = replace(
            mechanism_,
            joints=tuple(replace(j, T_parent_joint=moved) if j.name == name else j for j in mechanism_.joints),
        )
        got = ReferenceModel(changed).solve(state.q).T_base_tool
        motion = np.concatenate(
            [got[:3, 3] - state.T_base_tool[:3, 3], spatial.log_so3(got[:3, :3] @ state.T_base_tool[:3, :3].T)]
        )
        if joint not in mechanism_.loops:
            assert np.abs(motion - effect).max() < 1e-11
        else:  # the sign is that of the child's side, which for a loop is the other way round
            assert np.abs(np.abs(motion) - np.abs(effect)).max() < 1e-11


# -- belts and trocars ---------------------------------------------------------------------------------


def test_a_belt_keeps_the_sum_of_its_joints(rng):
    model = ReferenceModel(two_links(Coupling("belt", ("a", "b", "c"), (1.0, 1.0, 1.0), 0.3)))
    m = model.mobility(model.home().x)
    assert (m.freedom, m.redundancy, m.internal) == (2, 0, 0)
    q = rng.uniform(-2, 2, (50, 2))
    run = model.solve_many(q)
    np.testing.assert_allclose(q.sum(axis=1) + run.q_passive["c"], 0.3, atol=1e-12)
    np.testing.assert_allclose(spatial.rotation_angle(run.Ts_base_tool[:, :3, :3]), 0.3, atol=1e-12)
    assert run.loop_names == ("belt",)
    assert np.abs(run.gaps).max() < 1e-12
    back = model.solve_pose(run.Ts_base_tool[7], model.solve(q[7] + 0.01))
    assert back.q == pytest.approx(q[7], abs=1e-10)


def test_a_belt_on_what_it_cannot_drive_is_named():
    with pytest.raises(MechanismError, match="coupling 'belt': there is no joint with one coordinate 'd'"):
        two_links(Coupling("belt", ("a", "d"), (1.0, 1.0)))
    with pytest.raises(MechanismError, match="coupling 'belt' needs one nonzero ratio"):
        two_links(Coupling("belt", ("a", "c"), (1.0, 0.0)))
    for ratio, total in ((np.nan, 0.0), (np.inf, 0.0), (1.0, np.nan)):
        with pytest.raises(MechanismError, match="coupling 'belt': its ratios and its sum must be finite"):
            two_links(Coupling("belt", ("a", "c"), (1.0, ratio), total))
    with pytest.raises(MechanismError, match="the parent of joint 'c' must be the base"):
        two_links(trocars=("c",))


def test_a_shaft_stays_in_its_trocar_wherever_that_is():
    m = through_a_trocar()
    for place in ([0, 0, 0.3], [0.05, -0.04, 0.25]):
        model = ReferenceModel(m.with_trocar(np.array(place)))
        assert np.allclose(model.mechanism.trocar_at(), place)
        for x in (-0.1, 0.0, 0.12):
            T = model.solve(np.array([x])).T_base_tool
            assert spatial.point_to_line(np.array(place), T[None, :3, 3], T[None, :3, 2])[0] < 1e-12
    with pytest.raises(MechanismError, match="no joint is a trocar"):
        _ = two_links().trocar_at()


def test_what_swings_beside_a_loop_has_no_part_in_it():
    """The only joint that is free to close the loop cannot move it: it stays where it is."""
    lift = Joint("lift", "prismatic", "base", "a", active=True)
    m = mechanism(lift, Joint("swing", "revolute", "a", "b"), replace(lift, name="rail", active=False), tool="a")
    model = ReferenceModel(m)
    assert model.home().worst_gap == 0
    assert model.solve(np.array([0.1])).q_full["swing"] == 0


def test_redundant_is_what_has_more_drives_than_directions_of_its_tool():
    """Whatever else is free: a rod that spins between two balls counts for nothing."""
    spinning = ReferenceModel(rod("lift"))
    assert spinning.mobility(spinning._home).internal == 1
    assert not spinning.redundant
    assert not ReferenceModel(made.four_bar()).redundant
    twice = [Joint("a", "prismatic", "base", "k", active=True), Joint("b", "prismatic", "k", "l", active=True)]
    assert ReferenceModel(mechanism(*twice, tool="l")).redundant
    assert not ReferenceModel(mechanism(twice[0], replace(twice[1], T_parent_joint=ALONG_X), tool="l")).redundant


def test_a_robot_with_freedoms_to_spare_takes_a_pose_from_where_it_is(rng):
    """Four joints in a plane, three freedoms of the hand: near the given joints, and exactly at the pose."""
    z = [Joint(n, "revolute", a, b, spatial.pose(p=[0.2, 0, 0]), active=True) for n, a, b in
         (("a", "base", "k"), ("b", "k", "l"), ("c", "l", "m"), ("d", "m", "n"))]  # fmt: skip
    planar = ReferenceModel(mechanism(*z, tool="n", T_tool=spatial.pose(p=[0.2, 0, 0])))
    assert planar.redundant
    lift = [Joint(f"lift{i}", "prismatic", a, b, T, active=True) for i, (a, b, T) in enumerate(
        (("n", "o", np.eye(4)), ("o", "p", ALONG_X), ("p", "q", np.eye(4))))]  # fmt: skip
    spare = ReferenceModel(mechanism(*z, *lift, tool="q"))
    assert spare.redundant
    q = 0.3 * rng.uniform(-1, 1, (30, 7)) + 0.4
    Ts = spare.solve_many(q).Ts_base_tool
    back = spare.run_poses(Ts, near=q)
    np.testing.assert_allclose(back.q, q, atol=1e-9)
    moved = spare.run_poses(Ts, near=q + 1e-3)
    np.testing.assert_allclose(moved.Ts_base_tool, Ts, atol=1e-9)
    assert np.abs(moved.q - q).max() < 5e-3


def test_a_pose_out_of_reach_is_refused_with_the_distance_of_the_tool_from_it():
    z = [Joint(n, "revolute", a, b, spatial.pose(p=[0.2, 0, 0]), active=True) for n, a, b in
         (("a", "base", "k"), ("b", "k", "l"), ("c", "l", "m"), ("d", "m", "n"))]  # fmt: skip
    planar = ReferenceModel(mechanism(*z, tool="n", T_tool=spatial.pose(p=[0.2, 0, 0])))
    with pytest.raises(AssemblyError, match=r"out of reach, largest loop gap 0 mm, tool 50 mm from its target"):
        planar.run_poses(spatial.pose(p=[1.05, 0, 0])[None], near=np.zeros((1, 4)))


def test_a_pose_that_only_the_rotation_of_the_tool_misses_is_refused_with_the_angle():
    """A slide along z, driven beside another one: the tool cannot turn."""
    slides = (
        Joint("a", "prismatic", "base", "k", active=True),
        Joint("b", "prismatic", "k", "l", active=True),
    )
    sliding = ReferenceModel(mechanism(*slides, tool="l"))
    tilted = spatial.pose(spatial.exp_so3([0.0, 0.0, np.pi / 6]), [0, 0, 0.1])
    with pytest.raises(AssemblyError, match=r"tool \S+ mm and 30 deg from its target"):
        sliding.run_poses(tilted[None], near=np.array([[0.05, 0.05]]))


def test_a_weld_that_is_upside_down_is_not_closed():
    """The sine of half a turn is zero, but nobody would call such a joint assembled."""
    half = spatial.pose(np.diag([1.0, -1.0, -1.0]))
    turned = Mechanism(
        "turned",
        "base",
        (Body("base"), Body("arm")),
        (
            Joint("hinge", "revolute", "base", "arm", active=True),
            Joint("weld", "fixed", "base", "arm", T_child_joint=half),
        ),
        (Frame("tool", "arm", np.eye(4)),),
    )
    assert ReferenceModel(turned).home().gap["weld"][1] == pytest.approx(np.pi)
