"""Joint values that are computed from the poses of a chain's end."""

from __future__ import annotations

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.chain_poses import ChainStep, chain_end, nearest_keys, solve_chain


def test_the_nearest_solved_key_may_be_before_or_after():
    solved = np.array([2, 10, 11])
    keys = np.array([0, 3, 6, 7, 9, 12])
    assert nearest_keys(solved, keys).tolist() == [2, 2, 2, 10, 10, 11]
    assert nearest_keys(np.array([4]), np.array([0, 9])).tolist() == [4, 4]


def test_a_chain_has_the_values_that_bring_its_end_to_the_goals():
    turn = ChainStep(np.eye(4), "turn", np.array([0.0, 0.0, 1.0]), "turn")
    slide = ChainStep(poses.pose(None, np.array([0.1, 0.0, 0.0])), "slide", np.array([1.0, 0.0, 0.0]), "slide")
    angles = np.linspace(0.0, 3.0, 40)  # beyond 0.5 rad, one Gauss-Newton step from zero is not enough
    lengths = np.linspace(0.02, 0.3, 40)
    goal = chain_end([turn, slide], [angles, lengths], 40)
    solved = solve_chain([turn, slide], [None, None], goal)
    np.testing.assert_allclose(solved[0], angles, atol=1e-8)
    np.testing.assert_allclose(solved[1], lengths, atol=1e-8)
