"""The solver on a parallel robot (SILS) and on a serial arm that is only a forward formula."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.provenance import Parameter
from twin.formula import symbolic
from twin.kinematics import (
    ActiveJoint,
    Aspect,
    Coordinates,
    Equation,
    Formula,
    Joints,
    Measure,
    Pose,
    Tip,
    Trocar,
    compile_formula,
    solve,
)
from twin.kinematics.solve import descend, seeds
from twin.robots import load_formula

TIP_TOL = 1e-10  # m
TIP = (0.0, 0.0, 0.3)  # m in the tool frame of the arm; its shaft runs along z
LIMITS = np.tile([-2.9, 2.9], (6, 1))


def arm_forward(q1, q2, q3, q4, q5, q6, d1, a2, d4, d6):
    """A 6R arm with a spherical wrist, in modified DH: Rx(alpha) Tx(a) Rz(q) Tz(d)."""
    T = ca.SX.eye(4)
    half = ca.pi / 2
    rows = (
        (0, 0, q1, d1),
        (-half, 0, q2, 0),
        (0, a2, q3, 0),
        (-half, 0, q4, d4),
        (half, 0, q5, 0),
        (-half, 0, q6, d6),
    )
    for alpha, a, q, d in rows:
        T = T @ symbolic.pose(symbolic.rotation_x(alpha), ca.vertcat(a, 0, 0))
        T = T @ symbolic.pose(symbolic.rotation_z(q), ca.vertcat(0, 0, d))
    return T


def wrist(q5):
    return ca.sin(q5), q5


ARM = Formula(
    name="arm",
    title="6R arm",
    source="test",
    parameters=tuple(
        Parameter(n, v, "m", v, "ASSUMED", "test") for n, v in (("d1", 0.3), ("a2", 0.4), ("d4", 0.35), ("d6", 0.1))
    ),
    joints=tuple(ActiveJoint(f"q{i}", "revolute") for i in range(1, 7)),
    coordinates=Coordinates(
        ("x", "y", "z", "psi", "theta", "phi"),
        ("m",) * 3 + ("rad",) * 3,
        lambda x, y, z, psi, theta, phi: symbolic.pose(symbolic.rotation_zyx(psi, theta, phi), ca.vertcat(x, y, z)),
        lambda T: (T[0, 3], T[1, 3], T[2, 3], *symbolic.angles_zyx(T)),
    ),
    equations=(
        Equation("eq1", "joints -> pose", "test", "forward", ("T_base_tool",), {"only": arm_forward}, {}, "only"),
        Equation("wrist", "", "test", "helper", ("s5", "bend"), {"only": wrist}, {}, "only"),
    ),
    characteristic_length=lambda a2: a2,
    points={"tool": ("x", "y", "z")},
    measures=(Measure("wrist", "s5", "type1", 0.05, "test"),),
    aspects=(Aspect("bend", 1, "wrist bent one way"),),
    seeds=((0.3, -1.0, 0.8, 0.2, 0.9, 0.1),),
)


@pytest.fixture(scope="module")
def arm():
    return compile_formula(ARM)


@pytest.fixture(scope="module")
def sils():
    return compile_formula(load_formula("sils"))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def bent(rng, k):
    q = rng.uniform(-1.5, 1.5, (k, 6))
    q[:, 4] = rng.uniform(0.3, 1.5, k)
    return q


def test_serial_jacobian_by_finite_differences(arm, rng):
    qs, h = bent(rng, 20), 1e-6
    J, want = arm.jacobian_many(qs=qs), np.zeros((20, 6, 6))
    for i in range(6):
        plus, minus = arm.forward_many(qs + h * np.eye(6)[i]), arm.forward_many(qs - h * np.eye(6)[i])
        want[:, :3, i] = (plus[:, :3, 3] - minus[:, :3, 3]) / (2 * h)
        want[:, 3:, i] = spatial.log_so3(plus[:, :3, :3] @ np.swapaxes(minus[:, :3, :3], 1, 2)) / (2 * h)
    np.testing.assert_allclose(J, want, rtol=0, atol=1e-8)
    np.testing.assert_allclose(arm.inverse_jacobian_many(qs=qs) @ J, np.tile(np.eye(6), (20, 1, 1)), atol=1e-9)


def test_serial_pose_from_cold_starts(arm, rng):
    for q in bent(rng, 15):
        T = arm.forward(q)
        found = solve(arm, Pose(T), limits=LIMITS)
        np.testing.assert_allclose(found.T_base_tool, T, rtol=0, atol=1e-10)
        np.testing.assert_allclose(arm.forward(found.q), found.T_base_tool, rtol=0, atol=1e-14)
        assert found.branch == "bend+"
        assert np.all((found.q >= LIMITS[:, 0]) & (found.q <= LIMITS[:, 1]))


def test_serial_inverse_near_a_seed_keeps_the_configuration(arm, rng):
    for q in bent(rng, 10):
        np.testing.assert_allclose(arm.inverse(arm.forward(q), seed=q + 0.02), q, atol=1e-8)
    path = np.linspace(*bent(rng, 2), 30)
    back = arm.inverse_many(arm.forward_many(path))
    np.testing.assert_allclose(arm.forward_many(back), arm.forward_many(path), atol=1e-10)


def test_serial_robot_answers_the_common_questions(arm):
    q = np.array(ARM.seeds[0])
    assert arm.branch(qs=q[None])[0] == arm.preferred_branch
    assert arm.condition(q=q) > 1
    assert arm.singularity(qs=q[None])["wrist"][0] == pytest.approx(np.sin(0.9))
    assert not arm.singularity_alarm(qs=q[None])["wrist"][0]
    np.testing.assert_allclose(arm.points_many(qs=q[None])["tool"][0], arm.forward(q)[:3, 3])
    assert len(arm.branches(q)) == 1
    np.testing.assert_allclose(arm.jacobian(arm.forward(q), q), arm.jacobian(q=q))


def shaft_error(T, p_trocar, tip):
    """Distance from trocar to shaft, and how far the tip is beyond the trocar."""
    p_tip = T[:3, 3] + T[:3, :3] @ tip
    return spatial.point_to_line(p_trocar, p_tip, T[:3, 2]), (p_tip - p_trocar) @ T[:3, 2]


def test_tip_through_trocar_never_ends_on_the_wrong_side(arm, rng):
    reached = 0
    for q in bent(rng, 20):
        T = arm.forward(q)
        p_tip = T[:3, 3] + T[:3, :3] @ TIP
        p_trocar = p_tip - rng.uniform(0.03, 0.15) * T[:3, 2]
        task = Tip(p_tip, TIP) + Trocar(p_trocar, (0, 0, 1), TIP)
        found = solve(arm, task, limits=LIMITS, any_branch=True)
        error, depth = shaft_error(found.T_base_tool, p_trocar, TIP)
        assert error < TIP_TOL
        assert depth > 0
        np.testing.assert_allclose(found.T_base_tool[:3, 3] + found.T_base_tool[:3, :3] @ TIP, p_tip, atol=TIP_TOL)
        reached += 1
    assert reached == 20


def test_trocar_with_depth_needs_no_tip(arm):
    T = arm.forward(ARM.seeds[0])
    p = T[:3, 3] + 0.2 * T[:3, 2]
    found = solve(arm, Trocar(p, (0, 0, 2), TIP, depth=0.07), seed=ARM.seeds[0])
    error, depth = shaft_error(found.T_base_tool, p, TIP)
    assert error < TIP_TOL
    assert depth == pytest.approx(0.07, abs=TIP_TOL)


def test_trocar_residual_is_a_distance_and_excludes_the_wrong_side(at_pose):
    term = Trocar((0, 0, 0.0), (0, 0, 1)).terms[0]
    beyond = spatial.pose(p=[1e-4, 0, 0.1])
    before = spatial.pose(p=[0, 0, -0.1])
    assert np.linalg.norm(at_pose(term, beyond)[0]) == pytest.approx(1e-4, rel=1e-3)
    assert np.linalg.norm(at_pose(term, before)[0]) == pytest.approx(0.2)
    assert np.isfinite(at_pose(term, np.eye(4))[1]).all()  # tip exactly in the trocar


@pytest.mark.parametrize(
    "task",
    [
        Pose(spatial.pose(spatial.exp_so3([0.3, 0.2, -0.4]), [0.1, 0.2, 0.3])),
        Tip([0.1, 0.2, 0.3]),
        Tip([0.1, 0.2, 0.3], TIP),
        Trocar([0.1, 0.2, 0.3], (0, 1, 1), TIP),
        Trocar([0.1, 0.2, 0.3], (0, 1, 1), TIP, depth=0.1),
    ],
    ids=["pose", "position", "tip", "trocar", "trocar_depth"],
)
def test_task_jacobians_by_finite_differences(task, rng, at_pose):
    (term,), h = task.terms, 1e-6
    for _ in range(5):
        T = spatial.pose(spatial.exp_so3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
        _, J = at_pose(term, T)
        for i in range(6):
            xi = h * np.eye(6)[i]
            ends = [
                at_pose(term, spatial.pose(spatial.exp_so3(s * xi[3:]) @ T[:3, :3], T[:3, 3] + s * xi[:3]))[0]
                for s in (1, -1)
            ]
            np.testing.assert_allclose(J[:, i], (ends[0] - ends[1]) / (2 * h), rtol=0, atol=1e-8)


def test_masked_pose_leaves_the_roll_free(arm):
    q = np.array(ARM.seeds[0])
    target = arm.forward(q) @ spatial.pose(spatial.rotation_z(0.5))
    found = solve(arm, Pose(target, (1, 1, 1, 1, 1, 0)), seed=q)
    np.testing.assert_allclose(found.T_base_tool[:3, 2:], target[:3, 2:], atol=1e-10)
    assert spatial.rotation_angle(found.T_base_tool[:3, :3].T @ target[:3, :3]) > 0.1
    assert solve(arm, Pose(target), seed=q).residual < 1e-10


def test_limits_are_respected_or_named(arm):
    q = np.array(ARM.seeds[0])
    tight = np.column_stack([q - 0.05, q + 0.05])
    far = arm.forward(q + 0.5)
    with pytest.raises(KinematicsError, match="no solution of the task") as caught:
        solve(arm, Pose(far), seed=q, limits=tight, starts=4)
    best = caught.value.best
    assert np.all((best.q >= tight[:, 0]) & (best.q <= tight[:, 1]))
    assert caught.value.residual == best.residual > 1e-3
    near = arm.forward(q + 0.04)
    np.testing.assert_allclose(solve(arm, Pose(near), seed=q, limits=tight).q, q + 0.04, atol=1e-8)


def test_random_starts_are_within_limits_on_one_side_only(arm):
    limits = np.tile([-np.inf, np.inf], (6, 1))
    limits[0] = [4.0, np.inf]
    limits[1] = [-np.inf, -5.0]
    limits[2] = [-0.5, np.inf]
    random_starts = np.array(list(seeds(arm, 0, 30, limits))[len(ARM.seeds) :])
    assert np.all((random_starts >= limits[:, 0]) & (random_starts <= limits[:, 1]))
    assert np.abs(random_starts[:, 3:]).max() <= np.pi


def test_posture_weight_chooses_among_many(arm):
    """A light pull towards a posture decides what the task leaves free, and costs little of the task."""
    q = np.array(ARM.seeds[0])
    task = Tip(arm.forward(q)[:3, 3])
    pulled = descend(arm, task + 1e-3 * Joints(q), q + 0.2)
    assert np.abs(pulled.q - q).max() < 1e-3
    assert (2.0 * task).terms[0].weight == 2.0


def test_same_seed_same_answer(arm):
    T = arm.forward(np.array(ARM.seeds[0]) + 0.4)
    a, b = (solve(arm, Pose(T), rng=7) for _ in range(2))
    np.testing.assert_array_equal(a.q, b.q)
    assert a.iterations == b.iterations > 0
    assert solve(arm, Pose(T), length_scale=0.05).residual < 1e-10


def test_parallel_pose_and_limits(sils):
    B = np.array(sils.formula.seeds[0])
    T = spatial.pose(p=B[:3])
    C = sils.program.pose_of_coordinates.one(sils.formula.seeds[1])
    found = solve(sils, Pose(C), seed=T)
    np.testing.assert_allclose(found.q, sils.inverse(C), atol=1e-10)
    np.testing.assert_allclose(solve(sils, Pose(C), seed=sils.inverse(T)).q, found.q, atol=1e-9)
    # q4 is at -4.84 mm at C: a rail that begins at 0 forbids the pose, and the message says which joint.
    rails = np.tile([0.0, 0.657], (6, 1))
    with pytest.raises(KinematicsError, match=r"q4 = -0\.00\d+ m is outside 0 .. 0\.657|stays above") as caught:
        solve(sils, Pose(C), seed=T, limits=rails, starts=3)
    assert caught.value.best.q[3] > -0.00485


def test_parallel_trocar_with_free_roll_keeps_the_rails(sils):
    """Tip through a trocar leaves one freedom; the rail limits are kept by using it."""
    T = spatial.pose(p=sils.formula.seeds[0][:3])
    trocar, tip = T[:3, 3], np.array([0, 0, -0.04])
    target = trocar + np.array([0.004, 0.003, -0.04])
    q = solve(sils, Tip(target, tip) + Trocar(trocar, (0, 0, -1), tip), seed=T).q
    limits = np.tile([-0.01, 0.657], (6, 1))
    limits[0] = [-0.01, q[0] - 2e-3]  # forbid what was found
    found = solve(sils, Tip(target, tip) + Trocar(trocar, (0, 0, -1), tip), seed=T, limits=limits)
    assert np.all((found.q >= limits[:, 0] - 1e-9) & (found.q <= limits[:, 1] + 1e-9))
    p_tip = found.T_base_tool[:3, 3] + found.T_base_tool[:3, :3] @ tip
    np.testing.assert_allclose(p_tip, target, atol=1e-10)
    assert spatial.point_to_line(trocar, p_tip, found.T_base_tool[:3, 2]) < 1e-10
    assert found.branch == sils.preferred_branch


def test_unreachable_targets_raise_with_the_best_iterate(sils, arm):
    with pytest.raises(KinematicsError) as caught:
        solve(sils, Tip([2.0, 0, 0]), starts=3)
    assert spatial.is_pose(caught.value.best.T_base_tool)
    assert caught.value.residual > 1
    with pytest.raises(KinematicsError) as caught:
        solve(arm, Tip([2.0, 0, 0]), starts=3)
    assert caught.value.best.q.shape == (6,)


def test_bad_tasks_are_refused(arm):
    for make, message in (
        (lambda: Pose(2 * np.eye(4)), "not a rigid pose"),
        (lambda: Pose(np.eye(4), (0,) * 6), "mask"),
        (lambda: Tip([1, 2]), "finite vector of 3"),
        (lambda: Trocar([0, 0, 0], (0, 0, 0)), "axis has length 0"),
        (lambda: Trocar([0, 0, 0], depth=-1), "depth -1 m must be above 0"),
        (lambda: Joints([np.nan]), "finite vector"),
        (lambda: 0 * Tip([0, 0, 0]), "weight must be positive"),
        (lambda: solve(arm, Joints([0.0])), "1 values for 6 joints"),
        (lambda: solve(arm, Tip([0, 0, 0]), seed=[1, 2]), "seed must be"),
        (lambda: solve(arm, Tip([0, 0, 0]), seed=[0, np.nan, 0, 0, 0, 0]), "seed is not finite: .*'q2': nan"),
        (lambda: solve(arm, Tip([0, 0, 0]), limits=[[1, 0]]), "limits must be"),
        (lambda: solve(arm, Tip([0, 0, 0]), length_scale=0), "must be positive"),
        (lambda: arm.jacobian(), "give poses"),
    ):
        with pytest.raises(KinematicsError, match=message):
            make()


def planar_forward(q1, q2, a, b):
    return a * ca.cos(q1) + b * ca.cos(q1 + q2), a * ca.sin(q1) + b * ca.sin(q1 + q2)


def planar_inverse(x, y, a, b):
    q2 = ca.acos((x**2 + y**2 - a**2 - b**2) / (2 * a * b))
    return ca.atan2(y, x) - ca.atan2(b * ca.sin(q2), a + b * ca.cos(q2)), q2


BOTH = Formula(
    name="planar",
    title="two bars in a plane: fewer joints than a pose has freedoms, equations both ways",
    source="test",
    parameters=tuple(Parameter(n, v, "m", v, "ASSUMED", "test") for n, v in (("a", 0.4), ("b", 0.3))),
    joints=(ActiveJoint("q1", "revolute"), ActiveJoint("q2", "revolute")),
    coordinates=Coordinates(
        ("x", "y"),
        ("m", "m"),
        lambda x, y: symbolic.pose(ca.SX.eye(3), ca.vertcat(x, y, 0)),
        lambda T: (T[0, 3], T[1, 3]),
    ),
    equations=(
        Equation("eq1", "", "test", "forward", ("x", "y"), {"only": planar_forward}, {}, "only"),
        Equation("eq2", "", "test", "inverse", ("q1", "q2"), {"only": planar_inverse}, {}, "only"),
    ),
    characteristic_length=lambda a: a,
    seeds=((0.4, 0.3),),
)


def test_formula_with_equations_both_ways_and_two_joints():
    kin, q = compile_formula(BOTH), np.array([0.3, 0.8])
    T = kin.forward(q)
    np.testing.assert_allclose(kin.inverse(T), q, atol=1e-14)
    np.testing.assert_allclose(kin.inverse_jacobian(T) @ kin.jacobian(q=q), np.eye(2), atol=1e-12)
    np.testing.assert_allclose(solve(kin, Tip(T[:3, 3])).q, q, atol=1e-9)
    np.testing.assert_allclose(kin.forward_many(q[None])[0], T)
    one_way = compile_formula(replace(BOTH, equations=BOTH.equations[1:]))
    for ask in (lambda: one_way.forward(q), lambda: solve(one_way, Tip(T[:3, 3]))):
        with pytest.raises(KinematicsError, match="2 joints do not determine the 6 numbers of a pose"):
            ask()
