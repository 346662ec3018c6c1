"""The distance of two joints on one body, changed without drawing."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import twin
from made.lanes import one_of_a_kind
from twin.core import spatial
from twin.core.errors import MechanismError
from twin.model.body import Body
from twin.model.joint import Joint
from twin.model.joint_distance import Distance, distances, with_distance
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel

SHIFT = 1e-4


@pytest.fixture(scope="module")
def sils():
    return twin.load("sils").mechanism


def arm() -> Mechanism:
    """Two links in a plane, 300 and 200 mm."""

    def joint(name, parent, child, x):
        return Joint(name, "revolute", parent, child, spatial.pose(p=[x, 0, 0]), active=True)

    joints = (joint("j1", "base", "upper", 0.1), joint("j2", "upper", "lower", 0.3), joint("j3", "lower", "hand", 0.2))
    return Mechanism("arm", "base", tuple(Body(n) for n in ("base", "upper", "lower", "hand")), joints)


def test_an_arm_has_the_distances_of_its_links():
    assert distances(arm()) == [Distance("upper", "j1", "j2", 0.3), Distance("lower", "j2", "j3", 0.2)]


@pytest.mark.parametrize("name", one_of_a_kind())
def test_every_listed_distance_can_be_set_from_both_sides(name):
    mechanism = twin.load(name).mechanism
    listed = distances(mechanism)
    assert listed
    assert all(d.distance > 1e-6 for d in listed)
    for d in listed:
        for joint, other in ((d.joint, d.other), (d.other, d.joint)):
            changed = with_distance(mechanism, joint, other, d.distance + SHIFT)
            now = {(e.body, e.joint, e.other): e.distance for e in distances(changed)}
            assert now[d.body, d.joint, d.other] == pytest.approx(d.distance + SHIFT, abs=1e-12)
            moved = [(a, b) for a, b in zip(mechanism.joints, changed.joints, strict=True) if a is not b]
            assert [a.name for a, _ in moved] == [joint]
            (a, b), side = moved[0], "T_parent_joint" if moved[0][0].parent == d.body else "T_child_joint"
            before, after = getattr(a, side), getattr(b, side)
            np.testing.assert_array_equal(after[:3, :3], before[:3, :3])
            assert np.linalg.norm(after[:3, 3] - before[:3, 3]) == pytest.approx(SHIFT, abs=1e-12)
            assert replace(b, **{side: before}) == a
            for field in ("bodies", "frames", "points", "rest", "postures", "couplings"):
                assert getattr(changed, field) is getattr(mechanism, field)
        same = with_distance(mechanism, d.joint, d.other, d.distance)
        np.testing.assert_allclose(
            same.joint(d.joint).T_parent_joint, mechanism.joint(d.joint).T_parent_joint, rtol=0, atol=1e-15
        )


@pytest.mark.parametrize(
    ("joint", "other"), [("r12", "s1"), ("s1", "r12"), ("r13", "r12"), ("s2", "s1"), ("rf2", "rf1"), ("q4", "rf2")]
)
def test_the_tool_of_sils_follows_to_first_order(joint, other, sils):
    """A shift of 0.1 mm moves the tool by some 0.1 mm, half of it by half as much; the loops stay closed."""
    q = sils.posture("home")
    drawn = ReferenceModel(sils).solve(q)
    present = next(d.distance for d in distances(sils) if {d.joint, d.other} == {joint, other})

    def moved(shift: float) -> tuple[np.ndarray, np.ndarray]:
        at = ReferenceModel(with_distance(sils, joint, other, present + shift)).solve(q)
        assert at.worst_gap < 1e-6
        turn = spatial.log_so3(drawn.T_base_tool[:3, :3].T @ at.T_base_tool[:3, :3])
        return at.T_base_tool[:3, 3] - drawn.T_base_tool[:3, 3], turn

    (whole, turned), (half, half_turned), (back, _) = moved(SHIFT), moved(SHIFT / 2), moved(-SHIFT)
    assert 0.1 * SHIFT < np.linalg.norm(whole) < 3 * SHIFT
    np.testing.assert_allclose(2 * half, whole, rtol=0, atol=2e-3 * float(np.linalg.norm(whole)))
    np.testing.assert_allclose(-back, whole, rtol=0, atol=4e-3 * float(np.linalg.norm(whole)))
    np.testing.assert_allclose(2 * half_turned, turned, rtol=0, atol=2e-3 * float(np.linalg.norm(turned)))


def test_an_oblique_shift_opens_the_loop_by_its_part_along_the_axis(sils):
    """Strut 1 has its two bores 1 mm apart along their axes over 182 mm: that share of the shift is a gap."""
    q = sils.posture("home")
    present = next(d.distance for d in distances(sils) if (d.joint, d.other) == ("r11", "r13"))
    at = ReferenceModel(with_distance(sils, "r13", "r11", present + SHIFT)).solve(q)
    assert at.worst_gap == pytest.approx(SHIFT / 182, rel=0.02)


@pytest.mark.parametrize(
    ("joint", "other", "distance", "words"),
    [
        ("j9", "j1", 0.1, "there is no joint 'j9'"),
        ("j1", "j9", 0.1, "there is no joint 'j9'"),
        ("j1", "j1", 0.1, "joints 'j1' and 'j1' are the same, so they have no distance; 'j1' has a distance to: j2"),
        ("j1", "j3", 0.1, "joints 'j1' and 'j3' share no body, so they have no distance; 'j1' has a distance to: j2"),
        ("j2", "j1", 0.0, "distance of 'j2' from 'j1' on 'upper': 0 mm is not possible; give a length above 0.001 mm"),
        ("j2", "j1", -0.3, "-300 mm is not possible"),
        ("j2", "j1", float("nan"), "nan mm is not possible"),
        ("j2", "j1", float("inf"), "inf mm is not possible"),
    ],
)
def test_what_cannot_be_moved_is_named(joint, other, distance, words):
    with pytest.raises(MechanismError, match=re.escape(words)):
        with_distance(arm(), joint, other, distance)


def test_origins_that_coincide_have_no_line_between_them(sils):
    with pytest.raises(MechanismError, match=r"distance of 'q1' from 'rf1' on 'limb1': the origins coincide"):
        with_distance(sils, "q1", "rf1", 0.1)


def test_joints_that_share_two_bodies_have_no_one_distance():
    m = arm()
    double = replace(m.joints[1], name="j2b", active=False, T_parent_joint=spatial.pose(p=[0.3, 0, 0.05]))
    m = replace(m, joints=(*m.joints, double))
    with pytest.raises(
        MechanismError, match="share lower and upper, so they have no distance; 'j2' has a distance to: j1, j3"
    ):
        with_distance(m, "j2", "j2b", 0.1)
    assert ("j2", "j2b") not in [(d.joint, d.other) for d in distances(m)]
