"""The neutral model: its tree and loops, joints met from their far side, and what is not a mechanism."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.core import spatial
from twin.core.errors import MechanismError
from twin.model.body import Body, Frame, Point
from twin.model.inertia import Inertia
from twin.model.joint import FREE_AXES, Joint
from twin.model.mechanism import Mechanism
from twin.reference import ReferenceModel


def joint(name, parent, child, kind="revolute", **more):
    return Joint(name, kind, parent, child, **more)


def mechanism(*joints, bodies="base a b c", **more):
    fields = {
        "name": "m",
        "base": "base",
        "bodies": tuple(Body(n) for n in bodies.split()),
        "joints": joints,
        "frames": (Frame("tool", "base", np.eye(4)),),
    }
    return Mechanism(**{**fields, **more})


CHAIN = (joint("j1", "base", "a", active=True), joint("j2", "a", "b"), joint("j3", "b", "c"))


def names(joints):
    return [j.name for j in joints]


# -- tree and loops ----------------------------------------------------------------------------------


def test_a_chain_is_its_own_tree():
    m = mechanism(*CHAIN)
    assert names(m.tree) == ["j1", "j2", "j3"]
    assert m.loops == ()


def test_the_tree_puts_parents_first_whatever_the_file_order():
    m = mechanism(*reversed(CHAIN))
    assert names(m.tree) == ["j1", "j2", "j3"]
    assert names(m.joints) == ["j3", "j2", "j1"]


def test_the_path_leads_from_the_base_out_to_a_body():
    m = mechanism(*reversed(CHAIN))
    assert names(m.path("c")) == ["j1", "j2", "j3"]
    assert names(m.path("a")) == ["j1"]
    assert m.path("base") == ()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["revolute", "prismatic"]))
def test_the_coordinate_between_two_body_poses_is_the_motion_that_was_made(seed, kind):
    rng = np.random.default_rng(seed)
    poses = [spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
    T_base_parent, T_parent_joint, T_child_joint = poses
    j = joint("j", "base", "a", kind, T_parent_joint=T_parent_joint, T_child_joint=T_child_joint)
    q = rng.uniform(-3, 3, 5)
    motion = np.tile(np.eye(4), (5, 1, 1))
    if kind == "revolute":
        motion[:, :3, :3] = [spatial.exp_so3(np.array([0, 0, v])) for v in q]
    else:
        motion[:, 2, 3] = q
    T_base_child = T_base_parent @ T_parent_joint @ motion @ spatial.inverse(T_child_joint)
    np.testing.assert_allclose(j.coordinate(T_base_parent, T_base_child), q, atol=1e-12)


def test_of_two_joints_that_reach_a_body_the_earlier_one_does():
    a, b, c, closing = *CHAIN, joint("close", "c", "base")
    first = mechanism(a, b, c, closing)
    assert (names(first.tree), names(first.loops)) == (["j1", "j2", "j3"], ["close"])
    second = mechanism(a, b, closing, c)
    assert (names(second.tree), names(second.loops)) == (["j1", "j2", "close"], ["j3"])


def test_a_second_joint_between_the_same_bodies_closes_a_loop():
    m = mechanism(*CHAIN, joint("twin", "a", "b"))
    assert names(m.loops) == ["twin"]


def test_a_loop_joint_is_kept_as_it_was_written():
    T = spatial.pose(spatial.exp_so3([0.1, 0.2, 0.3]), [1, 2, 3.0])
    closing = joint("close", "base", "c", T_parent_joint=T)
    assert mechanism(*CHAIN, closing).loops[0] is closing


def test_active_and_passive_keep_the_file_order():
    m = mechanism(
        joint("j3", "b", "c", active=True),
        joint("ball", "a", "b", "spherical"),
        joint("j1", "base", "a", "prismatic", active=True),
        joint("close", "c", "base"),
    )
    assert names(m.active) == ["j3", "j1"]
    assert names(m.passive) == ["close"]  # a spherical joint has no single coordinate


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.data())
def test_tree_and_loops_part_the_joints_of_any_connected_graph(data):
    count = data.draw(st.integers(2, 7))
    edges = [(data.draw(st.integers(0, i - 1)), i) for i in range(1, count)]
    pair = st.tuples(st.integers(0, count - 1), st.integers(0, count - 1))
    edges += data.draw(st.lists(pair.filter(lambda e: e[0] != e[1]), max_size=4))
    edges = [e if data.draw(st.booleans()) else e[::-1] for e in data.draw(st.permutations(edges))]
    label = ["base", *(f"b{i}" for i in range(1, count))]
    m = mechanism(*(joint(f"j{k}", label[i], label[j]) for k, (i, j) in enumerate(edges)), bodies=" ".join(label))
    assert sorted(names(m.tree) + names(m.loops)) == sorted(names(m.joints))
    assert len(m.tree) == count - 1
    reached = {"base"}
    for j in m.tree:
        assert j.parent in reached
        assert j.child not in reached
        reached.add(j.child)
    assert reached == set(label)


# -- a joint met from its child's side ---------------------------------------------------------------

FRAMES = (
    spatial.pose(spatial.exp_so3([0.3, -0.2, 0.5]), [0.1, -0.2, 0.3]),
    spatial.pose(spatial.exp_so3([-1.1, 0.4, 0.2]), [-0.3, 0.1, 0.2]),
)


@pytest.mark.parametrize(("kind", "q"), [("revolute", 0.7), ("revolute", -2.9), ("prismatic", 0.2)])
def test_a_joint_that_is_turned_round_keeps_the_sign_of_its_coordinate(kind, q):
    motion = spatial.pose(spatial.rotation_z(q)) if kind == "revolute" else spatial.pose(p=[0, 0, q])
    far = joint("j", "a", "base", kind, T_parent_joint=FRAMES[0], T_child_joint=FRAMES[1], active=True)
    m = mechanism(far, bodies="base a", frames=(Frame("tool", "a", np.eye(4)),))
    # By definition T_parent_child = T_parent_joint motion(q) inverse(T_child_joint); here the child is the base.
    T_a_base = FRAMES[0] @ motion @ spatial.inverse(FRAMES[1])
    turned = m.tree[0]
    assert (turned.parent, turned.child, turned.name) == ("base", "a", "j")
    T_base_a = turned.T_parent_joint @ motion @ spatial.inverse(turned.T_child_joint)
    assert np.abs(T_base_a - spatial.inverse(T_a_base)).max() < 1e-15
    solved = ReferenceModel(m).solve(np.array([q]))
    assert np.abs(solved.link_poses["a"] - spatial.inverse(T_a_base)).max() < 1e-14
    assert solved.q_full == {"j": q}


def test_relative_is_the_motion_of_the_joint():
    j = joint("j", "a", "b", T_parent_joint=FRAMES[0], T_child_joint=FRAMES[1])
    T_base_a = spatial.pose(spatial.exp_so3([1, 0, 0.2]), [4, 5, 6.0])
    T_base_b = T_base_a @ FRAMES[0] @ spatial.pose(spatial.rotation_z(0.4)) @ spatial.inverse(FRAMES[1])
    assert np.abs(j.relative(T_base_a, T_base_b) - spatial.pose(spatial.rotation_z(0.4))).max() < 4e-15


def test_free_axes_and_angles():
    assert {k: len(v) for k, v in FREE_AXES.items()} == {
        "fixed": 0,
        "revolute": 1,
        "prismatic": 1,
        "cylindrical": 2,
        "spherical": 3,
        "free": 6,
    }
    assert joint("j", "a", "b").free_axes == (5,)
    assert joint("j", "a", "b").is_angle
    assert not joint("j", "a", "b", "prismatic").is_angle


# -- what is no mechanism ----------------------------------------------------------------------------

BENT = np.diag([1.0, 1.0, 2.0, 1.0])
J1, J2, J3 = CHAIN

WRONG = {
    "unknown base": (
        lambda: mechanism(*CHAIN, base="bas"),
        "m: base: there is no body 'bas'. Did you mean 'base'? Known: a, b, base, c.",
    ),
    "unknown parent": (
        lambda: mechanism(*CHAIN, joint("j4", "d", "a")),
        "m: joint 'j4', parent: there is no body 'd'. Known: a, b, base, c.",
    ),
    "unknown child": (
        lambda: mechanism(*CHAIN, joint("j4", "a", "basis")),
        "m: joint 'j4', child: there is no body 'basis'. Did you mean 'base'? Known: a, b, base, c.",
    ),
    "self-joint": (lambda: mechanism(*CHAIN, joint("j4", "a", "a")), "m: joint 'j4' connects body 'a' to itself"),
    "unknown type": (
        lambda: mechanism(*CHAIN, joint("j4", "a", "c", "revolut")),
        "m: joint 'j4': there is no joint type 'revolut'. Did you mean 'revolute'?",
    ),
    "bent frame": (
        lambda: mechanism(J1, J2, replace(J3, T_child_joint=BENT)),
        "m: joint 'j3': the frame on its child is not a rigid pose",
    ),
    "frame with NaN": (
        lambda: mechanism(J1, J2, replace(J3, T_parent_joint=np.full((4, 4), np.nan))),
        "m: joint 'j3': the frame on its parent is not a rigid pose",
    ),
    "swapped limits": (
        lambda: mechanism(replace(J1, limits=(1.0, -1.0)), J2, J3),
        "m: joint 'j1': limits 1 .. -1 are not ordered",
    ),
    "empty limits": (
        lambda: mechanism(replace(J1, limits=(1.0, 1.0)), J2, J3),
        "m: joint 'j1': limits 1 .. 1 are not ordered",
    ),
    "swapped soft limits": (
        lambda: mechanism(replace(J1, soft_limits=(1.0, -1.0)), J2, J3),
        "m: joint 'j1': soft limits 1 .. -1 are not ordered",
    ),
    "NaN limits": (
        lambda: mechanism(replace(J1, limits=(np.nan, 1.0)), J2, J3),
        "m: joint 'j1': limits nan .. 1 are not ordered",
    ),
    "active ball": (
        lambda: mechanism(J1, J2, replace(J3, type="spherical", active=True)),
        "m: active joint 'j3' must have one coordinate; a spherical joint does not",
    ),
    "two bodies of one name": (
        lambda: mechanism(*CHAIN, bodies="base a b c a"),
        "m: two body entries are named 'a'",
    ),
    "two joints of one name": (
        lambda: mechanism(*CHAIN, replace(J1, child="b")),
        "m: two joint entries are named 'j1'",
    ),
    "two frames of one name": (
        lambda: mechanism(*CHAIN, frames=(Frame("f", "a", np.eye(4)), Frame("f", "b", np.eye(4)))),
        "m: two frame entries are named 'f'",
    ),
    "two points of one name": (
        lambda: mechanism(*CHAIN, points=(Point("p", "a", np.zeros(3)), Point("p", "b", np.zeros(3)))),
        "m: two point entries are named 'p'",
    ),
    "name with a capital": (
        lambda: mechanism(*CHAIN, bodies="base a b c D"),
        "m: body name 'D' is not an identifier [a-z][a-z0-9_]*",
    ),
    "empty name": (
        lambda: mechanism(replace(J1, name=""), J2, J3),
        "m: joint name '' is not an identifier [a-z][a-z0-9_]*",
    ),
    "frame on no body": (
        lambda: mechanism(*CHAIN, frames=(Frame("tool", "d", np.eye(4)),)),
        "m: 'tool': there is no body 'd'. Known: a, b, base, c.",
    ),
    "point on no body": (
        lambda: mechanism(*CHAIN, points=(Point("p", "d", np.zeros(3)),)),
        "m: 'p': there is no body 'd'. Known: a, b, base, c.",
    ),
    "unreachable bodies": (
        lambda: mechanism(J1, J3),
        "m: no joints connect base 'base' to: b, c. Add joints, or move these bodies to the props of a scene.",
    ),
    "posture without a joint": (
        lambda: mechanism(*CHAIN, postures={"home": {}}),
        "m: posture 'home' must have exactly one value for each active joint; check: j1",
    ),
    "posture of a passive joint": (
        lambda: mechanism(*CHAIN, postures={"home": {"j1": 0.0, "j2": 0.0}}),
        "m: posture 'home' must have exactly one value for each active joint; check: j2",
    ),
    "active loop joint": (
        lambda: mechanism(*CHAIN, joint("close", "c", "base", active=True)),
        "m: active joint 'close' would close a loop; list it before the passive joints of its loop",
    ),
    "bent rest pose": (lambda: mechanism(*CHAIN, rest={"a": BENT}), "m: body 'a': its rest pose is not rigid"),
    "bent frame on a body": (
        lambda: mechanism(*CHAIN, frames=(Frame("tool", "a", BENT),)),
        "m: frame 'tool' is not a rigid pose",
    ),
    "point with NaN": (
        lambda: mechanism(*CHAIN, points=(Point("p", "a", np.array([0, np.nan, 0])),)),
        "m: point 'p' is not three finite numbers",
    ),
    "posture with NaN": (
        lambda: mechanism(*CHAIN, postures={"home": {"j1": np.nan}}),
        "m: posture 'home': j1 = nan is not finite",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_no_mechanism_is_refused_by_name(wrong):
    make, message = WRONG[wrong]
    with pytest.raises(MechanismError) as caught:
        make()
    assert str(caught.value).startswith(message)


# -- looking things up -------------------------------------------------------------------------------


def test_names_are_found_or_listed():
    m = mechanism(*CHAIN, points=(Point("tip", "c", np.zeros(3)),), postures={"home": {"j1": 0.25}})
    assert m.body("b").name == "b"
    assert m.joint("j2") is CHAIN[1]
    assert m.frame("tool").body == "base"
    assert m.point("tip").body == "c"
    assert m.posture("home").tolist() == [0.25]
    for look, kind, known in (
        (m.body, "body", "a, b, base, c"),
        (m.joint, "joint", "j1, j2, j3"),
        (m.frame, "frame", "tool"),
        (m.point, "point", "tip"),
        (m.posture, "posture", "home"),
    ):
        with pytest.raises(MechanismError, match=rf"there is no {kind} 'zzz'\. Known: {known}\."):
            look("zzz")


def test_a_posture_is_in_the_order_of_the_active_joints():
    m = mechanism(J1, replace(J2, active=True), J3, postures={"p": {"j2": 2.0, "j1": 1.0}})
    assert m.posture("p").tolist() == [1.0, 2.0]


def test_with_rest_changes_nothing_else():
    m = mechanism(*CHAIN)
    T = spatial.pose(p=[1, 2, 3.0])
    moved = m.with_rest({"a": T})
    assert np.array_equal(moved.rest["a"], T)
    assert replace(moved, rest=m.rest) == m


# -- inertia -----------------------------------------------------------------------------------------


def test_a_solid_box_has_no_violations():
    assert Inertia(2.0, np.zeros(3), np.diag([1.0, 2.0, 2.5])).violations() == []


@pytest.mark.parametrize(
    ("mass", "moments", "fragment"),
    [
        (0.0, [1, 1, 1], "mass 0 kg is not positive"),
        (np.nan, [1, 1, 1], "mass nan kg is not positive"),
        (1.0, [-1e-6, 1, 1], "smallest principal moment -1e-06 kg m2 is not positive"),
        (1.0, [1, 1, 2.1], "principal moments 1, 1, 2.1 kg m2 violate the triangle inequality"),
    ],
)
def test_impossible_inertia_is_named(mass, moments, fragment):
    R = spatial.exp_so3([0.3, 0.2, 0.1])
    bad = Inertia(mass, np.zeros(3), R @ np.diag(np.array(moments, float)) @ R.T).violations()
    assert any(fragment in b for b in bad)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_pseudo_inertia_is_the_moments_of_the_masses(seed):
    """Of points of mass: the sum of m (p, 1)(p, 1)'; it adds as they do, and is moved by 4 x 4 poses."""
    rng = np.random.default_rng(seed)
    m, p = rng.uniform(0.1, 2, 6), rng.normal(size=(6, 3))
    com = m @ p / m.sum()
    d = p - com
    I_com = np.einsum(
        "i,ijk->jk", m, np.einsum("ij,ij->i", d, d)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None]
    )
    inertia = Inertia(m.sum(), com, I_com)
    ones = np.column_stack([p, np.ones(6)])
    np.testing.assert_allclose(inertia.pseudo(), ones.T @ np.diag(m) @ ones, atol=1e-12)
    T = spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3))
    np.testing.assert_allclose(inertia.seen_from(T).pseudo(), T @ inertia.pseudo() @ T.T, atol=1e-10)
    assert np.linalg.eigvalsh(inertia.pseudo())[0] > 0
