"""The public names: each called twice with the same answer, its shapes and units, and what it refuses."""

from __future__ import annotations

import dataclasses
import inspect
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import one_of_a_kind
from twin.core import spatial
from twin.core.errors import KinematicsError, TwinError
from twin.core.units import DEG, MM
from twin.kinematics import Pose, Tip, Trocar

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "tests/data/short.toml"
STAGE = ROOT / "usd/sils/sils.usda"

Q_HOME = np.array([312.498356767, 524.843287564, 183.986838951, -4.84215325, 345.305837665, 575.267953963]) * MM


@pytest.fixture(scope="module")
def robot() -> twin.Robot:
    return twin.load("sils")


@pytest.fixture(scope="module")
def T_home() -> np.ndarray:  # noqa: N802
    """Pose C of Table 2."""
    return _pose([407.9, 306, 211.4], [10, 15, 10])


def _pose(p_mm, angles_deg) -> np.ndarray:
    psi, theta, phi = np.array(angles_deg) * DEG
    R = spatial.exp_so3([0, 0, psi]) @ spatial.exp_so3([0, theta, 0]) @ spatial.exp_so3([phi, 0, 0])
    return spatial.pose(R, np.array(p_mm) * MM)


def same(a, b) -> bool:
    """Equal to the last bit, whatever it is made of."""
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if dataclasses.is_dataclass(a):
        compared = [f.name for f in dataclasses.fields(a) if f.compare]
        return type(a) is type(b) and all(same(getattr(a, name), getattr(b, name)) for name in compared)
    if hasattr(a, "__dict__") and not callable(a):
        return type(a) is type(b) and same(vars(a), vars(b))
    if isinstance(a, float) and np.isnan(a):
        return bool(np.isnan(b))
    return a == b


# ---------------------------------------------------------------------------------------------- the package


def test_public_names_are_those_promised():
    calls = {"load", "names", "plan", "validate", "explain", "strokes", "study", "masses", "build", "export", "audit"}
    calls |= {"check", "compare", "diff", "new", "prove"}
    calls |= {"check_plan", "equations_of_motion", "validate_samples"}
    calls |= {"console", "load_scene", "operate", "operate_console", "play", "replay_session", "world"}
    calls |= {"operate_procedure", "replay_procedure"}
    analyses = {"workspace", "tolerance", "sweep", "track"}
    calls |= {"computing_on"}
    classes = {"Finding", "TwinError", "Joints", "Pose", "Tip", "Trocar", "Result", "Robot", "Spread"}
    assert set(twin.__all__) == calls | analyses | classes | {"__version__"}
    for name in twin.__all__:
        assert getattr(twin, name) is not None


def test_a_task_is_solved_by_what_the_package_alone_gives(robot, T_home):
    assert np.allclose(robot.solve(twin.Pose(T_home)).T_base_tool, T_home, atol=1e-9)
    with pytest.raises(twin.TwinError):
        robot.solve(twin.Pose(T_home), seed=np.zeros(5))


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'twin' has no attribute 'lode'"):
        twin.lode  # noqa: B018
    assert not hasattr(twin, "lode")


def test_every_public_function_says_what_it_does():
    for name in set(twin.__all__) - {"__version__"}:
        assert inspect.getdoc(getattr(twin, name))
    fields = {f.name for f in dataclasses.fields(twin.Robot)}
    for name, member in vars(twin.Robot).items():
        if not name.startswith("_") and name not in fields:
            assert inspect.getdoc(member), name


# ---------------------------------------------------------------------------------------- called twice, the same

TWICE = {
    "names": lambda r, T: twin.names(),
    "files": lambda r, T: r.files,
    "joints": lambda r, T: r.joints,
    "variants": lambda r, T: r.variants,
    "unwritten": lambda r, T: r.unwritten,
    "has_equations": lambda r, T: r.has_equations,
    "frames": lambda r, T: r.frames,
    "gaps": lambda r, T: r.gaps,
    "inverse": lambda r, T: r.inverse(T),
    "hashes": lambda r, T: r.hashes(),
    "inverse of many": lambda r, T: r.inverse(np.array([T, T])),
    "inverse in a variant": lambda r, T: r.inverse(T, variant={"eq1": "printed"}),
    "forward": lambda r, T: r.forward(Q_HOME),
    "forward of many": lambda r, T: r.forward(np.array([Q_HOME, Q_HOME])),
    "forward from a seed": lambda r, T: r.forward(Q_HOME, seed=T),
    "jacobian": lambda r, T: r.jacobian(Q_HOME),
    "solve": lambda r, T: r.solve(Pose(T)),
    "reference": lambda r, T: r.reference().solve(Q_HOME).T_base_tool,
    "dynamics": lambda r, T: r.dynamics().gravity(Q_HOME),
    "protocol": lambda r, T: r.protocol(),
    "bound": lambda r, T: r.bound(r.protocol()).mechanism.rest["platform"],
    "path_kinematics": lambda r, T: r.path_kinematics().lower,
    "plan": lambda r, T: twin.plan(r, SHORT),
}


@pytest.mark.parametrize("case", TWICE)
def test_second_call_answers_as_the_first(robot, T_home, case):
    first, second = TWICE[case](robot, T_home), TWICE[case](robot, T_home)
    assert same(first, second)


@pytest.mark.parametrize("case", ["inverse", "forward", "jacobian", "solve", "plan"])
def test_another_robot_object_answers_the_same(robot, T_home, case):
    assert same(TWICE[case](robot, T_home), TWICE[case](twin.load("sils"), T_home))


def test_every_public_member_of_robot_is_called_twice_here_or_below():
    called = {c.split()[0] for c in TWICE} | {"cad", "mechanism", "formula", "kinematics", "loops", "weighed"}
    called |= {"name", "tool_note", "with_formula", "with_mechanism", "with_parameters"}
    called |= {"with_transmission"}  # tests/simulation/test_raven_motion.py
    called |= {"with_timing"}  # tests/validation/test_retiming.py
    called |= {"with_inverse"}  # tests/kinematics/test_point_search.py
    called |= {"link_motion"}  # tests/usd/test_stage_motion.py
    called |= {"passive_check"}  # tests/analysis/test_limits_bind.py
    members = set(vars(twin.Robot)) - {f.name for f in dataclasses.fields(twin.Robot)}
    assert {n for n in members if not n.startswith("_")} == called - {"names", "plan"}


def test_a_robot_is_never_changed(robot):
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.parameters = {}
    drawn = robot.mechanism
    other = robot.with_mechanism(replace(drawn, name="other"))
    assert (robot.mechanism, other.mechanism.name) == (drawn, "other")
    assert other.cad.mechanism.name == "other"
    longer = robot.with_parameters({"l_p": 0.14})
    assert longer.inverse(robot.forward(Q_HOME))[0] != pytest.approx(Q_HOME[0], abs=1e-4)
    assert robot.inverse(robot.forward(Q_HOME)) == pytest.approx(Q_HOME, abs=1e-9)
    assert robot.weighed().mechanism.bodies[1].inertia is not None
    assert robot.mechanism.bodies[1].inertia is None


def test_loaded_parts_are_kept(robot):
    assert robot.cad is robot.cad
    assert robot.mechanism is robot.mechanism
    assert robot.formula is robot.formula
    assert robot.loops is robot.loops
    assert robot.kinematics() is robot.kinematics()
    assert robot.kinematics({"eq1": "printed"}).variants == robot.kinematics({"eq1": "printed"}).variants


def test_answers_are_not_shared(robot, T_home):
    """Writing into an answer changes no later one."""
    robot.inverse(T_home)[:] = 0
    assert np.allclose(robot.inverse(T_home), Q_HOME, atol=1e-9)
    robot.forward(Q_HOME)[:] = 0
    assert np.allclose(robot.forward(Q_HOME), T_home, atol=1e-9)
    robot.variants.clear()
    assert robot.variants


def test_loops_are_closed_twice(robot):
    q = robot.loops.q
    assert np.array_equal(robot.loops.forward(q), robot.loops.forward(q))
    robot.loops.forward(q)[:] = 0
    assert np.allclose(robot.loops.forward(q), robot.loops.forward_many(q[None]).Ts_base_tool[0], atol=1e-12)


def test_arguments_are_left_alone(robot, T_home):
    T, q = T_home.copy(), Q_HOME.copy()
    robot.inverse(T)
    robot.forward(q, seed=T)
    robot.jacobian(q)
    robot.solve(Pose(T), seed=q)
    assert same(T, T_home)
    assert same(q, Q_HOME)


# ----------------------------------------------------------------------------------------------- what they return


def test_names_of_things(robot):
    assert "sils" in twin.names()
    assert repr(robot) == "Robot('sils')"
    assert robot.joints == ("q1", "q2", "q3", "q4", "q5", "q6")
    assert robot.frames == ("base", "tool", "endoscope_tip")
    assert set(robot.variants) == {"eq1", "eq2"}
    assert set(robot.variants["eq1"]) == {"corrected", "printed"}


def test_inverse_is_in_metres(robot, T_home):
    q = robot.inverse(T_home)
    assert q.shape == (6,)
    assert q.dtype == np.float64
    assert np.abs(q - Q_HOME).max() < 1e-9


def test_inverse_takes_lists(robot, T_home):
    assert same(robot.inverse(T_home.tolist()), robot.inverse(T_home))


def test_batch_of_poses_equals_single_poses(robot, T_home):
    Ts = np.array([T_home, _pose([380, 280, 185], [0, 0, 0]), _pose([380, 280, 145], [0, 0, 0])])
    q = robot.inverse(Ts)
    assert q.shape == (3, 6)
    assert np.allclose(q, [robot.inverse(T) for T in Ts], rtol=0, atol=1e-14)
    back = robot.forward(q)
    assert back.shape == (3, 4, 4)
    assert np.allclose(back, Ts, atol=1e-9)
    assert np.allclose(back, [robot.forward(row) for row in q], atol=1e-9)


@pytest.mark.parametrize("name", one_of_a_kind())
def test_many_poses_are_answered_by_compiled_code(name, monkeypatch):
    """Row by row the same as single poses, and without one call of Python a pose."""
    loaded = twin.load(name)
    kin, model, rng = loaded.kinematics(), loaded.reference(), np.random.default_rng(7)
    Ts = model.run(model.home().q + 2e-3 * np.cumsum(rng.uniform(-1, 1, (30, len(kin.joints))), axis=0)).Ts_base_tool
    Ts = Ts[np.isfinite(kin.inverse_many(Ts)).all(axis=1)]
    assert len(Ts) > 5
    single = np.array([kin.inverse(T) for T in Ts])
    if kin.closed_inverse:
        monkeypatch.setattr(kin, "inverse", None)
    assert np.allclose(loaded.inverse(Ts), single, rtol=0, atol=1e-12)


def test_batch_of_none(robot):
    assert robot.inverse(np.zeros((0, 4, 4))).shape == (0, 6)
    assert robot.forward(np.zeros((0, 6))).shape == (0, 4, 4)


def test_jacobian_is_the_derivative_of_forward(robot):
    J = robot.jacobian(Q_HOME)
    assert J.shape == (6, 6)
    h, T = 1e-6, robot.forward(Q_HOME)
    for j in range(6):
        a, b = (robot.forward(Q_HOME + s * h * np.eye(6)[j], seed=T) for s in (-1, 1))
        v = (b[:3, 3] - a[:3, 3]) / (2 * h)
        w = spatial.log_so3(b[:3, :3] @ a[:3, :3].T) / (2 * h)
        assert np.allclose(J[:, j], np.r_[v, w], atol=1e-6)


def test_variant_changes_the_answer(robot, T_home):
    printed = robot.inverse(T_home, variant={"eq1": "printed"})
    assert np.abs(printed - robot.inverse(T_home)).max() > 1e-4
    assert same(robot.inverse(T_home, variant={"eq1": "corrected"}), robot.inverse(T_home))
    assert same(twin.load("sils", variants={"eq1": "printed"}).inverse(T_home), printed)


def test_unknown_variant_is_refused(robot, T_home):
    with pytest.raises(KinematicsError, match="printd"):
        robot.inverse(T_home, variant={"eq1": "printd"})
    with pytest.raises(KinematicsError, match="eq9"):
        robot.inverse(T_home, variant={"eq9": "printed"})


def test_parameters_replace_published_ones(T_home):
    longer = twin.load("sils", parameters={"l_1": 0.2})
    assert np.abs(longer.inverse(T_home) - Q_HOME).max() > 1 * MM
    with pytest.raises(KinematicsError, match="l_9"):
        twin.load("sils", parameters={"l_9": 0.2}).inverse(T_home)


def test_pose_out_of_reach_is_refused(robot, T_home):
    far = T_home.copy()
    far[0, 3] = 5.0
    with pytest.raises(KinematicsError, match=r"limb|reach|short"):
        robot.inverse(far)
    with pytest.raises(KinematicsError, match=r"^pose 1 \(of 0 \.\. 2\): .*limb.*; poses without a solution: 2 of 3"):
        robot.inverse(np.array([T_home, far, far]))


def test_the_first_pose_that_is_none_is_named(robot, T_home):
    with pytest.raises(KinematicsError, match=r"^pose 2 \(of 0 \.\. 2\): .*Check that the pose is rigid"):
        robot.inverse(np.array([T_home, T_home, 2 * T_home]))


@pytest.mark.parametrize("wrong", [np.zeros((4, 4)), np.full((4, 4), np.nan), np.eye(3), np.zeros(7)])
def test_what_is_no_pose_is_refused(robot, wrong):
    with pytest.raises(KinematicsError):
        robot.inverse(wrong)


@pytest.mark.parametrize("wrong", [np.zeros(5), np.full(6, np.nan)])
def test_what_is_no_configuration_is_refused(robot, wrong):
    with pytest.raises(KinematicsError):
        robot.forward(wrong)


# ------------------------------------------------------------------------------------------------------------ seeds


def test_seed_of_forward_is_a_pose_and_chooses_the_branch(robot, T_home):
    assert np.allclose(robot.forward(Q_HOME, seed=T_home), T_home, atol=1e-9)
    near = T_home.copy()
    near[:3, 3] += 2 * MM
    assert np.allclose(robot.forward(Q_HOME, seed=near), T_home, atol=1e-9)
    others = [T for T in robot.kinematics().branches(Q_HOME) if not np.allclose(T, T_home, atol=1e-6)]
    for T in others:
        assert np.allclose(robot.forward(Q_HOME, seed=T), T, atol=1e-7)


def test_seed_of_a_batch_is_that_of_each_row(robot, T_home):
    q = np.array([Q_HOME, Q_HOME + 1 * MM])
    assert np.allclose(robot.forward(q, seed=T_home), [robot.forward(row, seed=T_home) for row in q], rtol=0, atol=1e-9)


def test_seed_of_the_wrong_kind_is_refused(robot, T_home):
    with pytest.raises(KinematicsError):
        robot.forward(Q_HOME, seed=Q_HOME)
    with pytest.raises(KinematicsError):
        robot.solve(Pose(T_home), seed=T_home[:2])


@pytest.fixture(scope="module")
def forward_only() -> twin.Robot:
    """A serial arm whose equations lead only forwards, so that its inverse is solved."""
    arm = twin.load("pa10")
    forward = tuple(e for e in arm.formula.equations if e.stage == "forward")
    arm = arm.with_formula(
        replace(
            arm.formula,
            equations=forward,
            seeds=((0.1,) * 7,),
            reach={},
            measures=(),
            points={},
            aspects=(),
            point_search=None,
        )
    )
    assert not arm.kinematics().closed_inverse
    return arm


def test_seed_of_a_batched_inverse_is_handed_on(forward_only):
    """Without a closed inverse each pose begins at the answer before it, the first at the seed."""
    start = np.array([10, 30, -20, 60, 15, 40, 5]) * DEG
    qs = start + np.linspace(0, 0.2, 4)[:, None] * np.array([1, -1, 1, 1, -1, 1, -1])
    Ts = forward_only.forward(qs)
    found = forward_only.inverse(Ts, seed=start)
    single = [forward_only.inverse(Ts[0], seed=start)]
    for T in Ts[1:]:
        single.append(forward_only.inverse(T, seed=single[-1]))
    assert same(found, np.array(single))
    assert np.abs(found - qs).max() < 0.1, "a redundant arm stays near its seed"


def test_solved_poses_out_of_reach_are_named(forward_only):
    near = forward_only.forward(np.array([10, 30, -20, 60, 15, 40, 5]) * DEG)
    far = near.copy()
    far[:3, 3] *= 100
    with pytest.raises(KinematicsError, match=r"^pose 1 \(of 0 \.\. 2\)"):
        forward_only.inverse(np.array([near, far, near]))


# ------------------------------------------------------------------------------------------------------------ solve


def test_solve_brings_the_tool_to_a_pose(robot, T_home):
    T = _pose([380, 280, 185], [0, 0, 0])
    solution = robot.solve(Pose(T), seed=Q_HOME)
    assert solution.q.shape == (6,)
    assert np.allclose(solution.T_base_tool, T, atol=1e-9)
    assert np.allclose(solution.q, robot.inverse(T), atol=1e-8)
    assert solution.residual < 1e-8
    assert solution.branch == robot.solve(Pose(T_home)).branch


def test_solve_leads_the_endoscope_through_a_trocar(robot):
    """A shaft along -z of the tool, its tip 200 mm below, through a point 100 mm above where it stood."""
    T = _pose([380, 280, 185], [0, 0, 0])
    tip = np.array([0, 0, -200]) * MM
    port = T[:3, 3] + np.array([0, 0, -100]) * MM
    goal = T[:3, 3] + np.array([10, 5, -198]) * MM
    q0 = robot.inverse(T)
    solution = robot.solve(Tip(goal, tip) + Trocar(port, (0, 0, -1), tip), seed=q0)
    found = solution.T_base_tool
    assert np.allclose(found[:3, :3] @ tip + found[:3, 3], goal, atol=1e-9)
    shaft = found[:3, :3] @ np.array([0, 0, -1.0])
    assert spatial.point_to_line(port, found[:3, 3], shaft) < 1e-9
    low, high = np.array([j.limits for j in robot.mechanism.active]).T
    assert ((solution.q > low - 2e-9) & (solution.q < high + 2e-9)).all()
    assert np.allclose(robot.forward(solution.q, seed=found), found, atol=1e-8)


def test_solve_stays_within_the_joint_limits_and_says_so(robot):
    beyond = _pose([407.9, 306, 411.4], [10, 15, 10])
    assert robot.inverse(beyond).max() > 0.58, "the equations reach it, the joints do not"
    with pytest.raises(KinematicsError, match=r"no solution of the task in \d+ starts: .*q\d") as caught:
        robot.solve(Pose(beyond), seed=Q_HOME)
    assert caught.value.best.q.shape == (6,)
    assert caught.value.best.residual == caught.value.residual > 0


def test_solve_of_a_masked_pose_leaves_the_rest_free(robot, T_home):
    turned = T_home @ spatial.pose(spatial.exp_so3([0, 0, 3 * DEG]), np.zeros(3))
    solution = robot.solve(Pose(turned, (True,) * 5 + (False,)), seed=Q_HOME)
    assert np.allclose(solution.T_base_tool[:3, 2], turned[:3, 2], atol=1e-8)
    assert np.allclose(solution.T_base_tool[:3, 3], turned[:3, 3], atol=1e-9)


# --------------------------------------------------------------------------------------------- plan, validate, build


def test_reference_agrees_with_the_equations(robot, T_home):
    model = robot.reference()
    assembly = model.solve(Q_HOME)
    assert np.allclose(assembly.T_base_tool, T_home, atol=1e-9)
    assert assembly.worst_gap < 1e-11
    assert set(assembly.link_poses) == {b.name for b in robot.mechanism.bodies}


def test_plan_takes_name_path_or_protocol(robot):
    by_path = twin.plan(robot, SHORT)
    assert same(by_path.q, twin.plan(robot, str(SHORT)).q)
    assert same(by_path.q, twin.plan(robot, robot.protocol(SHORT)).q)
    k = len(by_path.t)
    assert by_path.q.shape == by_path.qd.shape == by_path.qdd.shape == (k, 6)
    assert by_path.Ts_base_tool.shape == (k, 4, 4)
    assert np.allclose(np.diff(by_path.t), 1e-3)
    assert np.allclose(by_path.q[0], Q_HOME, atol=1e-9)


def test_progress_is_told_what_is_done(robot):
    told = []
    twin.plan(robot, SHORT, progress=lambda label, fraction: told.append((label, fraction)))
    assert told
    assert all(label and 0 <= fraction <= 1 for label, fraction in told)


@pytest.mark.nightly
def test_validate_twice_gives_the_same_report(robot):
    """Also: a trajectory from elsewhere is judged; the report is plain data."""
    trajectory = twin.plan(robot, SHORT)
    first, second = (twin.validate(robot, trajectory, protocol=SHORT).as_dict() for _ in range(2))
    first.pop("environment"), second.pop("environment")
    assert first == second
    assert first["verdict"] == "agree"
    assert json.loads(json.dumps(first, allow_nan=False))["protocol"] == "short"


@pytest.mark.slow
def test_validate_judges_a_stage_that_is_handed_in(robot, tmp_path):
    """A body moved in the stage is seen there, and there only."""
    stage = tmp_path / "usd"
    shutil.copytree(STAGE.parent, stage)
    layer = stage / "physics.usda"
    text = layer.read_text()
    at = text.index("point3f physics:localPos0", text.index('"s2"'))
    row = text[at : text.index("\n", at)]
    x = row[row.index("(") + 1 : row.index(",")]
    layer.write_text(text.replace(row, row.replace(f"({x},", f"({float(x) + 1e-4:.9g},")))
    report = twin.validate(robot, protocol=SHORT, stage=stage / "sils.usda")
    assert report.verdict == "disagree"
    wrong = {r.pair for r in report.residuals if not r.agrees}
    assert "B-C" in wrong
    assert "A-B" not in wrong


@pytest.mark.nightly
def test_build_twice_writes_the_same_bytes(robot, tmp_path):
    first, second = (twin.build(robot, tmp_path / n, protocols=()) for n in ("a", "b"))
    assert first[0] == tmp_path / "a/sils.usda"
    assert [p.name for p in first] == [p.name for p in second]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(first, second, strict=True))


def _with_a_port() -> tuple[twin.Robot, twin.Robot]:
    """Return a robot whose protocol places its trocar, as drawn and bound."""
    for name in twin.names():
        loaded = twin.load(name)
        for protocol in map(loaded.protocol, loaded.files.protocols()):
            if protocol.trocars:
                return loaded, loaded.bound(protocol)
    raise AssertionError("no robot has a protocol that places its trocar")


@pytest.mark.slow
def test_what_builds_a_robot_leaves_it_as_it_is(tmp_path):
    """Bound to a port it stays there, in Python and on its stage; weighing moves nothing and changes no robot."""
    drawn, bound = _with_a_port()
    before = {id(r): (r.cad, r.mechanism, dict(r.kinematics().parameters)) for r in (drawn, bound)}
    stage = twin.load(twin.build(bound, tmp_path, protocols=())[0])
    for r in (drawn, bound):
        cad, mechanism, parameters = before[id(r)]
        assert r.cad is cad
        assert r.mechanism is mechanism
        assert r.kinematics().parameters == parameters
    assert not np.allclose(bound.mechanism.trocar_at(), drawn.mechanism.trocar_at(), atol=1e-6)
    assert np.allclose(stage.mechanism.trocar_at(), bound.mechanism.trocar_at(), atol=1e-6)
    weighed = bound.weighed()
    assert weighed.weighed() is weighed
    assert np.allclose(weighed.mechanism.trocar_at(), bound.mechanism.trocar_at(), atol=1e-12)
    assert weighed.cad.mechanism is weighed.mechanism
    masses = [[b.inertia is not None for b in r.mechanism.bodies] for r in (weighed, bound)]
    assert sum(masses[0]) > sum(masses[1])


# ------------------------------------------------------------------------------------------------- where robots are


def test_robot_folder_is_a_robot(robot, T_home, tmp_path):
    folder = tmp_path / "mine"
    shutil.copytree(ROOT / "cad/sils", folder / "cad", ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    shutil.copytree(ROOT / "trajectories/sils", folder / "trajectories")
    shutil.copy(ROOT / "twin/robots/sils.py", folder / "formula.py")
    for mine in (twin.load(folder), twin.load(str(folder))):
        assert mine.name == "sils"
        assert mine.files.cad == folder / "cad"
        assert same(mine.inverse(T_home), robot.inverse(T_home))
        assert mine.protocol().name == "table2"
    assert not (folder / "usd").exists()


@pytest.fixture(scope="module")
def stage() -> twin.Robot:
    return twin.load(STAGE)


def test_stage_is_a_robot_without_equations(stage, robot, T_home):
    assert stage.name == "sils"
    assert stage.joints == robot.joints
    assert set(stage.frames) == set(robot.frames)
    assert stage.mechanism is stage.mechanism
    assembly = stage.reference().solve(Q_HOME)
    assert np.abs(assembly.T_base_tool - T_home).max() < 1e-6


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: r.inverse(np.eye(4), variant="printed"), "robot 'sils' has no equations"),
        (lambda r: r.forward(np.zeros(6), variant="printed"), "robot 'sils' has no equations"),
        (lambda r: r.variants, "robot 'sils' has no equations"),
        (lambda r: r.cad, "sils was loaded from a USD stage: it has no CAD"),
        (lambda r: r.protocol(), "give the path of a protocol file"),
        (lambda r: r.protocol("table2"), "give the path of a protocol file"),
        (lambda r: twin.plan(r, SHORT), "robot 'sils' has no equations"),
        (lambda r: twin.validate(r), "it has no CAD"),
        (lambda r: twin.build(r), "sils was loaded from a USD stage"),
    ],
)
def test_stage_says_what_it_cannot_do(stage, call, message):
    with pytest.raises(TwinError, match=message):
        call(stage)


def test_unknown_robot_is_refused(tmp_path):
    with pytest.raises(TwinError, match=r"there is no robot 'silss'\. Did you mean 'sils'"):
        twin.load("silss")
    with pytest.raises(TwinError, match=r"gone\.usda: the stage does not exist"):
        twin.load(tmp_path / "gone.usda")


def test_protocol_of_another_robot_is_refused(robot, tmp_path):
    other = tmp_path / "other.toml"
    other.write_text(SHORT.read_text().replace('robot = "sils"', 'robot = "arm"'))
    with pytest.raises(TwinError, match=r"other\.toml:\d+: robot: the protocol is written for 'arm', not for 'sils'"):
        robot.protocol(other)


def test_frame_of_the_tool(robot):
    assert np.allclose(robot.mechanism.frame_in_tool("tool"), np.eye(4), atol=1e-12)
    T = robot.mechanism.frame_in_tool("endoscope_tip")
    assert T[2, 3] < 0, "the tip is below the platform"
    with pytest.raises(TwinError, match="it moves relative to the tool"):
        robot.mechanism.frame_in_tool("base")
