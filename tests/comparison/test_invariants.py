"""What joint lines and frames say before any fit: nothing that explains a difference may be ruled out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from made import chains
from twin.comparison.evidence import Evidence, StatedEvidence
from twin.comparison.fit_problem import FitProblem
from twin.comparison.invariants import neighbour_lines
from twin.comparison.matching import match
from twin.comparison.mechanism_side import from_mechanism
from twin.comparison.side import RobotSide
from twin.comparison.tool_lines import may_frames_agree
from twin.comparison.unknowns import JointDeviation, Unknowns
from twin.exchange.read import read

TOLERANCE = 1e-5


def side_of(robot: chains.Chain, file: Path) -> RobotSide:
    imported = read(chains.write(robot, file, "urdf"), guarded=False)
    return from_mechanism(imported.mechanism, file.name)


def problem_of(first: RobotSide, second: RobotSide) -> FitProblem:
    return FitProblem(first, second, match(first, second), TOLERANCE)


def with_turned_axis(robot: chains.Chain, i: int, angle: float) -> chains.Chain:
    """Return the robot with one axis turned about its point, while all links stay."""
    lines = list(robot.lines)
    across = np.cross(lines[i].axis, [0.36, -0.48, 0.8])
    turn = Rotation.from_rotvec(angle * across / np.linalg.norm(across))
    lines[i] = replace(lines[i], axis=turn.apply(lines[i].axis))
    return replace(robot, lines=tuple(lines))


def with_longer_link(robot: chains.Chain, i: int, shift: np.ndarray) -> chains.Chain:
    """Return the robot with joint i, and all behind it, shifted on its parent link."""
    T = np.eye(4)
    T[:3, 3] = shift
    lines = [*robot.lines[:i], *(chains.moved(line, T) for line in robot.lines[i:])]
    return chains.Chain(tuple(lines), T @ robot.tool)


@pytest.mark.parametrize(("name", "joints"), [("offset_arm", (1, 2, 4)), ("scara", (1, 2, 3)), ("seven", (3,))])
@pytest.mark.parametrize("angle", [0.001, 0.4])
def test_a_turned_axis_explains_its_differences(
    name: str, joints: tuple[int, ...], angle: float, tmp_path: Path
) -> None:
    first = side_of(chains.ROBOTS[name], tmp_path / "first")
    for i in joints:
        second = side_of(with_turned_axis(chains.ROBOTS[name], i, angle), tmp_path / f"turned{i}")
        for problem in (problem_of(first, second), problem_of(second, first)):
            found = list(neighbour_lines(problem).contradictions())
            assert found
            assert all(difference.is_explained({JointDeviation(i, axis_only=True)}) for difference in found)
            assert all(
                difference.is_explained({JointDeviation(i), JointDeviation(i + 1)})
                for difference in found
                if i + 1 < problem.count
            )


def test_no_turned_axis_explains_another_distance_of_parallel_axes(tmp_path: Path) -> None:
    robot = chains.ROBOTS["offset_arm"]
    first = side_of(robot, tmp_path / "first")
    second = side_of(with_longer_link(robot, 2, np.array([0.0005, 0.0, 0.0])), tmp_path / "longer")
    problem = problem_of(first, second)
    (difference,) = neighbour_lines(problem).contradictions()
    assert difference.is_explained({JointDeviation(2)})
    axes = [JointDeviation(i, axis_only=True) for i in range(problem.count)]
    assert not any(difference.is_explained({axis}) for axis in axes)
    assert difference.is_explained({JointDeviation(1, axis_only=True), JointDeviation(2, axis_only=True)})


def may_hold(problem: FitProblem, flips: tuple[int, ...] = (), deviating: tuple[JointDeviation, ...] = ()) -> bool:
    signs = np.ones(problem.count)
    signs[list(flips)] = -1.0
    u = Unknowns(signs, np.zeros(6), np.zeros(problem.count), deviating, np.zeros((len(deviating), 6)))
    return StatedEvidence(problem).may_be_equal(Evidence("tool", problem.count - 1, 1.0), u)


@pytest.mark.parametrize("name", ["wrist_arm", "scara"])
def test_a_tool_that_conventions_make_equal_is_not_ruled_out(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng([3, len(name)])
    robot = chains.ROBOTS[name]
    last = len(robot.lines) - 1
    first = side_of(robot, tmp_path / "first")
    changed = chains.with_base(chains.with_zero(robot, last, 0.7), chains.pose(rng, 0.5, 1.1))
    assert may_hold(problem_of(first, side_of(changed, tmp_path / "changed")))
    turned = problem_of(first, side_of(chains.with_sign(changed, last), tmp_path / "turned"))
    assert may_hold(turned, (last,))
    assert not may_hold(turned)


def test_a_tool_elsewhere_on_its_line_is_ruled_out_unless_its_joint_deviates(tmp_path: Path) -> None:
    robot = chains.ROBOTS["wrist_arm"]  # the last axis is x
    first = side_of(robot, tmp_path / "first")
    shift = np.eye(4)
    for k, told in ((0, 5), (1, None)):
        shift[:3, 3] = 0.001 * np.eye(3)[k]
        problem = problem_of(first, side_of(chains.with_tool(robot, shift), tmp_path / f"tool{k}"))
        assert not may_hold(problem)
        assert may_hold(problem, deviating=(JointDeviation(5),)) == (told is not None)
        assert may_hold(problem, deviating=(JointDeviation(5, axis_only=True),))


def test_frames_of_one_link_that_lie_elsewhere_in_each_other_are_ruled_out(tmp_path: Path) -> None:
    robot = chains.ROBOTS["wrist_arm"]
    first = side_of(robot, tmp_path / "first")
    problem = problem_of(first, side_of(robot, tmp_path / "second"))
    tool = first.frames["tool"][1]
    probe = tool.copy()
    probe[1, 3] += 0.1
    elsewhere = probe.copy()
    elsewhere[1, 3] += 0.0005
    signs = np.ones(problem.count)
    assert may_frames_agree(problem, 5, np.array([tool, probe]), np.array([tool, probe]), signs, ())
    for deviating in ((), (JointDeviation(5),), (JointDeviation(5, axis_only=True),)):
        assert not may_frames_agree(problem, 5, np.array([tool, probe]), np.array([tool, elsewhere]), signs, deviating)
