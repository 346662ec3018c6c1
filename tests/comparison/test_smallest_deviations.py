"""Of deviations that lines leave open in part, the smallest are told, with as few numbers as possible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from made import chains
from twin.comparison.fit_problem import FitProblem
from twin.comparison.line_gaps import FitSolution, line_gap, lines_coincide
from twin.comparison.matching import match
from twin.comparison.mechanism_side import from_mechanism
from twin.comparison.refinement import refine
from twin.comparison.side import RobotSide
from twin.comparison.smallest_deviations import smallest_deviations, with_few_numbers, with_short_turns
from twin.comparison.unknowns import JointDeviation, Unknowns, convention_count, values_of
from twin.exchange.read import read


def side(robot: chains.Chain, file: Path) -> RobotSide:
    return from_mechanism(read(chains.write(robot, file, "urdf"), guarded=False).mechanism, file.name)


def solution(problem: FitProblem, joint: int, deviation: list[float]) -> FitSolution:
    n = problem.count
    unknowns = Unknowns(np.ones(n), np.zeros(6), np.zeros(n), (JointDeviation(joint),), np.array([deviation]))
    return FitSolution(unknowns, line_gap(problem, unknowns))


@pytest.mark.parametrize("simplest", [smallest_deviations, with_few_numbers])
def test_what_moves_no_line_is_taken_away(simplest, tmp_path: Path) -> None:
    robot = side(chains.ROBOTS["offset_arm"], tmp_path / "a")
    problem = FitProblem(robot, robot, match(robot, robot), 1e-5)
    # a turn about the line of the last joint, and a shift along it
    found = solution(problem, problem.count - 1, [0, 0, 0.3, 0, 0, 0.05])
    assert lines_coincide(problem, found.gap)
    smallest = simplest(problem, found)
    assert lines_coincide(problem, smallest.gap)
    np.testing.assert_allclose(smallest.unknowns.deviations, 0, atol=1e-9)


def test_what_moves_lines_stays(tmp_path: Path) -> None:
    robot = chains.ROBOTS["offset_arm"]
    *lines, last = robot.lines
    shift = np.eye(4)
    shift[:3, 3] = 0.05 * np.cross(last.axis, [0.36, -0.48, 0.8])
    first = side(robot, tmp_path / "a")
    second = side(chains.Chain((*lines, chains.moved(last, shift)), shift @ robot.tool), tmp_path / "b")
    problem = FitProblem(first, second, match(first, second), 1e-5)
    start = solution(problem, problem.count - 1, [0, 0, 0.3, 0, 0, 0.05]).unknowns
    free = np.arange(len(values_of(start))) >= convention_count(problem.count)
    found = refine(problem, start, free)
    assert lines_coincide(problem, found.gap)
    smallest = with_few_numbers(problem, smallest_deviations(problem, found))
    assert lines_coincide(problem, smallest.gap)
    assert smallest.unknowns.deviations is not None
    deviation = smallest.unknowns.deviations[0]
    np.testing.assert_allclose(deviation[[0, 1, 2, 5]], 0, atol=1e-9)
    assert np.linalg.norm(deviation) == pytest.approx(np.linalg.norm(shift[:3, 3]), abs=1e-5)


@pytest.mark.parametrize(("turn", "short_turn"), [(1.5 * np.pi, -0.5 * np.pi), (np.pi, np.pi), (0.2, 0.2)])
def test_turns_are_of_at_most_half_a_turn(turn: float, short_turn: float) -> None:
    vector = np.array([0, turn, 0, 1, 2, 3])
    unknowns = Unknowns(np.ones(1), vector, np.zeros(1), (JointDeviation(0),), vector[None])
    short = with_short_turns(unknowns)
    expected = [0, short_turn, 0, 1, 2, 3]
    assert short.deviations is not None
    np.testing.assert_allclose(short.base, expected, atol=1e-12)
    np.testing.assert_allclose(short.deviations, [expected], atol=1e-12)
