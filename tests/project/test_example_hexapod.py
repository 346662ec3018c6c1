"""The example of a robot of one's own: it agrees, and faults seeded in its plain formula are found and undone."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from twin import api
from twin.core.errors import ProtocolError
from twin.core.program_end import ProgramEndError
from twin.validation.explain.explain import ExplainOptions, explain
from twin.validation.explain.function_source import patched
from twin.validation.explain.judged_states import sampled_values
from twin.validation.explain.repair_search import RepairSearch
from twin.validation.explain.row_deviations import Judge

pytestmark = pytest.mark.usefixtures("sampled_once")

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/examples/hexapod"

POINTS = '''
"""Hexapod, by way of its named points."""
import numpy as np
from twin.formula import deg, mm
PARAMETERS = {"r_a": mm(165), "h_a": mm(30), "alpha": deg(18), "r_b": mm(95), "h_b": mm(34), "beta": deg(45)}


def on_circle(radius, angle, height):
    return np.array([radius * np.cos(angle), radius * np.sin(angle), height])


def points(pose, r_a, h_a, alpha, r_b, h_b, beta):
    out = {}
    for leg in range(6):
        middle, side = 2 * np.pi / 3 * (leg // 2), (-1, 1)[leg % 2]
        out[f"a{leg + 1}"] = on_circle(r_a, middle + side * alpha, h_a)
        out[f"b{leg + 1}"] = pose[:3, 3] + pose[:3, :3] @ on_circle(r_b, middle + side * beta, -h_b)
    return out


def inverse(a1, a2, a3, a4, a5, a6, b1, b2, b3, b4, b5, b6):
    q1, q2 = np.linalg.norm(b1 - a1), np.linalg.norm(b2 - a2)
    q3, q4 = np.linalg.norm(b3 - a3), np.linalg.norm(b4 - a4)
    q5, q6 = np.linalg.norm(b5 - a5), np.linalg.norm(b6 - a6)
    return q1, q2, q3, q4, q5, q6
'''
CASADI = '''
"""Hexapod in CasADi."""
from casadi import cos, norm_2, pi, sin, vertcat
from twin.formula import deg, mm
PARAMETERS = {"r_a": mm(165), "h_a": mm(30), "alpha": deg(18), "r_b": mm(95), "h_b": mm(34), "beta": deg(45)}


def on_circle(radius, angle, height):
    return vertcat(radius * cos(angle), radius * sin(angle), height)


def inverse(pose, r_a, h_a, alpha, r_b, h_b, beta):
    R, p = pose[:3, :3], pose[:3, 3]
    q = []
    for leg in range(6):
        middle, side = 2 * pi / 3 * (leg // 2), (-1, 1)[leg % 2]
        a = on_circle(r_a, middle + side * alpha, h_a)
        b = on_circle(r_b, middle + side * beta, -h_b)
        q.append(norm_2(p + R @ b - a))
    return q
'''
NUMPY = (FOLDER / "formula.py").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def robot():
    return api.load(FOLDER)


@pytest.fixture(scope="module")
def model(robot):
    return robot.reference()


@pytest.fixture(scope="module")
def formula_of(robot, tmp_path_factory):
    """A function that loads a text as the formula of this robot."""
    from twin.robots import load_formula

    def load(text):
        path = tmp_path_factory.mktemp("formula") / "formula.py"
        path.write_text(text, encoding="utf-8")
        return load_formula(path, "hexapod", lambda: robot.mechanism.driven)

    return load


@pytest.fixture(scope="module")
def truths(model, formula_of):
    """The mechanism's values for each way to write the formula."""
    return {text: sampled_values(formula_of(text), model) for text in (NUMPY, POINTS, CASADI)}


def test_parts_are_drawn_to_the_lengths_of_the_formula(robot):
    assert robot.cad.findings == ()
    model, kin = robot.reference(), robot.kinematics()
    state = model.home()
    np.testing.assert_allclose(kin.inverse(state.T_base_tool), state.q, atol=1e-12)
    parts = [m for b in robot.mechanism.bodies for m in b.meshes]
    assert len(parts) > 100


def test_formula_goes_both_ways_like_the_mechanism(robot, model):
    kin = robot.kinematics()
    q = robot.mechanism.posture("level") + 1e-3 * np.array([3, -4, 5, 1, -2, 6])
    state = model.solve(q)
    np.testing.assert_allclose(robot.forward(q), state.T_base_tool, atol=1e-10)
    np.testing.assert_allclose(kin.inverse(state.T_base_tool), q, atol=1e-11)


@pytest.mark.parametrize("text", [NUMPY, POINTS, CASADI], ids=["numpy", "points", "casadi"])
def test_nothing_is_explained_where_all_agree(text, truths, formula_of):
    judge = Judge(formula_of(text), None, truths[text])
    assert judge.residuals
    assert judge.notes == []
    assert judge.failing() == []


FAULTS = (
    (NUMPY, "p + R @ b", "p + R.T @ b"),
    (NUMPY, "np.sin(angle)", "np.cos(angle)"),
    (NUMPY, "-h_b", "h_b"),
    (NUMPY, "side * beta", "side * alpha"),
    (NUMPY, "middle + side * alpha", "middle - side * alpha"),
    (NUMPY, "on_circle(r_a", "on_circle(r_b"),
    (NUMPY, "pose[:3, 3]", "pose[:3, 2]"),
    (NUMPY, "2 * np.pi / 3", "2 * np.pi / 4"),
    (POINTS, "b4 - a4", "b4 - a3"),
    (POINTS, "b5 - a5", "b5 + a5"),
    (POINTS, "pose[:3, :3] @ on", "pose[:3, :3].T @ on"),
    (CASADI, "sin(angle)", "cos(angle)"),
    (CASADI, "p + R @ b", "p - R @ b"),
    (CASADI, "-h_b", "h_b"),
)


SHARED = [
    pytest.param(*f, id=f"{f[1]} as {f[2]}", marks=[pytest.mark.nightly] if k % 4 else []) for k, f in enumerate(FAULTS)
]
"""One in four is tested in the slow lane, the others in the nightly lane."""


@pytest.mark.slow
@pytest.mark.parametrize(("text", "right", "wrong"), SHARED)
def test_a_fault_of_one_token_is_found_and_undone(text, right, wrong, truths, formula_of):
    assert text.count(right) == 1
    faulty = formula_of(text.replace(right, wrong))
    judge = Judge(faulty, None, truths[text])
    assert judge.failing()
    found, lost = RepairSearch(judge).run(2.0)
    assert lost == []
    assert all(len(f.cures) == 1 for f in found), "another function fits as well"
    edits = [e for f in found for e in f.cures[0][0].edits]
    line = text[: text.index(right)].count("\n") + 1
    for f in found:  # the first reading undoes it; where several make the same function, one is at that line
        assert line in {e.line for reading in f.cures[0] for e in reading.edits}
    assert min(f.runner_up_residual for f in found) > 1e6
    cured = formula_of(patched(edits))
    assert Judge(cured, None, truths[text]).failing() == []


def test_points_that_are_right_are_not_blamed(truths, formula_of):
    judge = Judge(formula_of(POINTS.replace("b4 - a4", "b4 - a3")), None, truths[POINTS])
    assert {p.symbol for p in judge.failing()} == {"q4"}
    judge = Judge(formula_of(POINTS.replace("beta, -h_b", "beta, h_b")), None, truths[POINTS])
    assert {p.symbol for p in judge.failing()} == {f"b{i}" for i in range(1, 7)}  # not the joints made of them


@pytest.mark.slow
def test_a_wrong_number_is_told_from_a_wrong_form(model, truths, formula_of):
    faulty = formula_of(NUMPY.replace('"r_b": mm(95.0', '"r_b": mm(95.1'))
    reference = sampled_values(faulty, model)
    result = explain("hexapod", faulty, model, reference=reference, options=ExplainOptions(budget=0.5))
    assert result.identified is not None
    moved = {m.name: m.fitted for m in result.identified.moved}
    assert moved["r_b"] == pytest.approx(95.0, abs=1e-3)


@pytest.mark.nightly
def test_a_stage_or_a_track_beside_a_formula_does_not_run_it(tmp_path):
    """Only equations are code; geometry, protocols and stages are data."""
    folder = tmp_path / "hexapod"
    shutil.copytree(FOLDER, folder, ignore=shutil.ignore_patterns("usd", "*.py"))
    (folder / "formula.py").write_text("raise SystemExit('this ran')\n")
    robot = api.load(folder)
    api.build(robot, protocols=())
    assert api.load(folder / "usd/hexapod.usda").mechanism.joints
    with pytest.raises(ProgramEndError, match="this ran"):
        robot.kinematics()


def test_a_plan_without_values_names_the_line(tmp_path):
    shutil.copytree(FOLDER, tmp_path, ignore=shutil.ignore_patterns("usd", "*.py"), dirs_exist_ok=True)
    text = NUMPY.replace("np.linalg.norm(p + R @ b - a)", "np.sqrt(0.06 - (p + R @ b - a) @ (p + R @ b - a))")
    (tmp_path / "formula.py").write_text(text)
    with pytest.raises(ProtocolError, match=r"formula\.py:28: inverse\(\): invalid value encountered in sqrt"):
        api.plan(api.load(tmp_path))


@pytest.mark.nightly
def test_it_agrees_along_its_protocol(robot):
    report = api.validate(robot)
    assert report.verdict == "agree"


@pytest.mark.slow
def test_no_part_runs_through_another_along_the_protocol(robot, model):
    from twin.reference.clearance import clearance

    run = model.run(api.plan(robot).q[::60])
    found = clearance(robot.mechanism, model.link_poses(run.x))
    assert found.contacts == ()
    assert found.distance.min() > 0.5e-3  # fork and bracket of a universal joint
