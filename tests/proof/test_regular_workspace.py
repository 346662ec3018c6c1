"""Boxes that are proved regular: what independent solvers say at random positions in them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import twin
from twin.analysis import grid_workspace as sampled
from twin.analysis.pose_grid import PoseGrid
from twin.analysis.proven_workspace import proven_workspace
from twin.cli import main
from twin.core.errors import TwinError
from twin.formula import variant_choice
from twin.proof import intervals, krawczyk
from twin.proof.box_judge import BoxJudge
from twin.proof.formula_boxes import FormulaBoxes
from twin.proof.frame_motion import ToolBox
from twin.proof.interval_pose import IntervalPose, identity
from twin.proof.loops import ClosingConditions
from twin.proof.regular_workspace import cover

CORNERS = np.array([0.39, 0.30, 0.16]), np.array([0.43, 0.34, 0.20])
"""A box around the best position of SILS, which is partly beyond its limits."""


@pytest.fixture(scope="module")
def sils():
    return twin.load("sils")


@pytest.fixture(scope="module")
def proven(sils):
    return proven_workspace(sils, edge=0.01, corners=CORNERS)


def _positions(proof, count, seed=0):
    """Return random positions (count, 3) in proved boxes, their corners among them."""
    generator = np.random.default_rng(seed)
    k = generator.integers(0, len(proof.low), count)
    share = generator.uniform(size=(count, 3))
    share[: count // 3] = np.round(share[: count // 3])
    return proof.low[k] + share * (proof.high[k] - proof.low[k])


def test_proved_positions_are_assembled_by_the_reference_model_within_limits(sils, proven):
    """The reference model closes the loops of the CAD by Newton steps; it shares no code with the proof."""
    reference = sils.reference()
    R = proven.proof.orientation
    for p in _positions(proven.proof, 12):
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = p
        q = sils.inverse(T)
        assembly = reference.solve(q, seed=sils.reference().solve_pose(T))
        assert np.abs(assembly.T_base_tool - T).max() < 1e-8
        for value, joint in zip(q, sils.mechanism.active, strict=True):
            low, high = joint.limits
            assert low < value < high
        for lower, upper, least in sils.gaps:
            names = [joint.name for joint in sils.mechanism.active]
            assert q[names.index(upper)] - q[names.index(lower)] >= least


def test_the_sampled_workspace_reaches_all_proved_positions(sils, proven):
    proof = proven.proof
    grid = PoseGrid(CORNERS[0], 0.002, (21, 21, 21), proof.orientation)
    found = sampled.over_grid(sils, grid)
    p = grid.position(np.arange(grid.positions))[:, None]
    inside = ((proof.low < p) & (p < proof.high)).all(axis=2).any(axis=1)
    assert inside.sum() > 1000
    assert found.reached[inside].all()
    assert found.values[inside, 3].min() > 1e-4  # the smallest measure of a singularity


def test_where_nothing_is_proved_a_finding_says_it_and_no_certificate_is_written(sils, tmp_path):
    found = proven_workspace(sils, edge=0.04, corners=CORNERS)
    assert not len(found.proof.low)
    assert next(finding.code for finding in found.findings) == "prove.no_box"
    found.write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["boxes.json"]


def test_a_tolerance_does_not_prove_loops_that_the_lengths_of_the_cad_do_not_close(sils):
    """A joint is 20 um along its axis from where its plane loop closes: less than what the tolerance may leave."""
    corners = np.array([0.395, 0.32, 0.175]), np.array([0.405, 0.33, 0.185])
    proved = []
    for offset in (0.0, 2e-5):
        joints = []
        for joint in sils.mechanism.joints:
            if joint.name == "r13":
                T = np.array(joint.T_parent_joint)
                T[:3, 3] += offset * T[:3, 2]
                joint = replace(joint, T_parent_joint=T)
            joints.append(joint)
        loops = ClosingConditions(replace(sils.mechanism, joints=tuple(joints)), tolerance=1e-5)
        assert loops.largest_redundant_gap > 2e-5
        R = sampled.centre(sils)[:3, :3]
        equations = FormulaBoxes(sils.formula, variant_choice.choose(sils.formula, None), R, loops.names, [])
        judge = BoxJudge(loops, R, [], equations, corners[0])
        proved.append(cover(judge, *corners, edge=0.01, halvings=0).volume)
    assert proved == [pytest.approx(1e-6), 0.0]


def test_volumes_add_up(proven):
    proof = proven.proof
    total = proof.volume + proof.outside + sum(proof.open.values())
    assert total == pytest.approx(float(np.prod(CORNERS[1] - CORNERS[0])))
    assert 0.3 < proven.share < 1.0 + proven.sampled_error / proven.sampled
    assert 0 < proof.redundant < 1e-12


def test_derivatives_are_those_of_the_conditions(sils):
    loops = ClosingConditions(sils.mechanism)
    generator = np.random.default_rng(3)
    x = generator.uniform(-0.8, 0.8, (1, len(loops.names)))
    T = identity()
    tool = ToolBox(IntervalPose(T.R[None], intervals.exactly(generator.uniform(0.1, 0.3, (1, 3)))))
    J = loops.jacobian(loops.closures, intervals.exactly(x), tool, range(len(loops.names) + 3)).middle[0]
    for column in range(J.shape[1]):
        ends = []
        for sign in (-1e-6, 1e-6):
            moved, p = x.copy(), tool.pose.p.low.copy()
            (moved if column < x.shape[1] else p)[0, column % x.shape[1]] += sign
            at = ToolBox(IntervalPose(tool.pose.R, intervals.exactly(p)))
            ends.append(loops.residual(loops.closures, intervals.exactly(moved), at).middle[0])
        assert np.allclose((ends[1] - ends[0]) / 2e-6, J[:, column], atol=1e-7)


def _circle(x):
    """Return x^2 + y^2 - 2 and x - y of boxes (n, 2), whose zeros are (1, 1) and (-1, -1)."""
    return intervals.stack([x[:, 0] ** 2 + x[:, 1] ** 2 - 2.0, x[:, 0] - x[:, 1]], -1)


def _circle_slopes(x):
    ones = intervals.exactly(np.ones(len(x)))
    rows = [intervals.stack([x[:, 0] * 2.0, x[:, 1] * 2.0], -1), intervals.stack([ones, -ones], -1)]
    return intervals.stack(rows, 1)


def test_a_solution_is_enclosed_and_where_there_is_none_nothing_is():
    m = np.array([[1.01, 0.99], [-1.0, -1.001], [0.0, 0.0], [5.0, 5.0]])
    found = krawczyk.solve(_circle, _circle_slopes, m)
    assert found.solved.tolist() == [True, True, False, False]
    assert found.x[0].contains([1.0, 1.0]).all()
    assert found.x[1].contains([-1.0, -1.0]).all()


def test_only_regular_matrices_are_called_regular():
    generator = np.random.default_rng(7)
    A = generator.normal(size=(200, 4, 4))
    radius = 10.0 ** generator.uniform(-3, 0.5, (200, 1, 1))
    certain = krawczyk.regular(intervals.around(A, radius))
    assert 20 < certain.sum() < 180
    for centre, spread, regular in zip(A, radius, certain, strict=True):
        signs = generator.choice([-1.0, 1.0], (300, 4, 4))
        signs = np.sign(np.linalg.det(centre + spread * signs))
        if regular:
            assert np.unique(signs).size == 1
    assert not krawczyk.regular(intervals.exactly(np.ones((1, 2, 2))))[0]


def test_bad_boxes_and_robots_are_named(sils):
    with pytest.raises(TwinError, match=r"from 400 to 300 mm along y"):
        proven_workspace(sils, corners=(np.array([0.3, 0.4, 0.1]), np.array([0.4, 0.3, 0.2])))
    with pytest.raises(TwinError, match=r"from nan to 400 mm along x"):
        proven_workspace(sils, corners=(np.array([np.nan, 0.4, 0.1]), np.array([0.4, 0.5, 0.2])))
    with pytest.raises(TwinError, match=r"edge of the smallest boxes is nan mm"):
        proven_workspace(sils, edge=np.nan, corners=CORNERS)
    with pytest.raises(TwinError, match=r"no joint values at \[3000"):
        proven_workspace(sils, corners=(np.array([3.0, 3.0, 3.0]), np.array([3.1, 3.1, 3.1])))
    with pytest.raises(TwinError, match=r"reaches no volume"):
        proven_workspace(twin.load("hibou"))
    with pytest.raises(TwinError, match=r"coupling"):
        proven_workspace(twin.load("lapbot"))


@pytest.mark.slow
def test_the_command_prints_and_writes(tmp_path, capsys):
    out = tmp_path / "out"
    options = ["--edge-mm", "20", "--box-mm", "390", "430", "300", "340", "160", "200"]
    assert main(["prove", "sils", "--workspace", *options, "--json", "--out", str(out)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["schema"] == "twin/prove-workspace/1"
    assert data["proved_dm3"] <= data["sampled_dm3"] + 2 * data["sampled_error_dm3"]
    assert len(json.loads((out / "boxes.json").read_text())["low_mm"]) == data["proved_boxes"]
    assert main(["prove", "sils", "--edge-mm", "20"]) == 2
    assert "--edge-mm needs --workspace" in capsys.readouterr().err


@pytest.mark.nightly
def test_four_fifths_of_the_workspace_of_sils_are_proved(sils):
    found = proven_workspace(sils)
    assert found.share >= 0.8
    assert found.proof.volume <= found.sampled + 2 * found.sampled_error
    for p in _positions(found.proof, 24):
        grid = PoseGrid(p, 1e-3, (1, 1, 1), found.proof.orientation)
        assert sampled.over_grid(sils, grid).reached.all()
