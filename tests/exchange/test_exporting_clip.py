"""Clips: the key rate against brute force, errors between keys against closed forms, hashes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from twin import api
from twin.core import spatial
from twin.exchange.write import key_rate, player_interpolation
from twin.exchange.write.clip import ClipAccuracy
from twin.exchange.write.key_rate import make_clip
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.player_interpolation import interpolation_errors, key_rows
from twin.model.body import Body, Frame, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import key_times

SHORT = Path(__file__).parents[1] / "data/short.toml"
BOX = np.array([[x, y, z] for x in (-0.1, 0.4) for y in (-0.1, 0.1) for z in (0.0, 0.2)])


def wheel(name: str = "crank") -> Mechanism:
    """A base and one link that turns about z, with a box from x = -0.1 to 0.4 m."""
    mesh = Mesh(f"{name}_box", BOX, np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7]], np.int32))
    return Mechanism(
        "wheel",
        "ground",
        (Body("ground"), Body(name, (mesh,))),
        (Joint("pin", "revolute", "ground", name, active=True),),
        (Frame("tool", name, np.eye(4)),),
        rest={"ground": np.eye(4), name: np.eye(4)},
    )


def turning(rate: float, speed: float, seconds: float, p=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and poses of the wheel at a steady speed, its axis at the origin and its body frame at p on the rim."""
    times = np.arange(round(seconds * rate) + 1) / rate
    R = spatial.rotation_z(speed * times)
    return times, {"ground": np.tile(np.eye(4), (len(times), 1, 1)), "crank": spatial.pose(R, R @ np.array(p))}


# ------------------------------------------------------------------------------------------- between keys


@settings(max_examples=30, deadline=None)
@given(speed=st.floats(0.1, 6.0), stride=st.sampled_from([4, 8, 12, 24]))
def test_a_point_on_a_chord_is_off_by_its_sagitta(speed, stride):
    """Between keys the frame's origin runs on the chord, at most r (1 - cos(w h / 2)) inside of the circle."""
    m, r = wheel(), 0.7
    times, links = turning(480, speed, 1.0, (r, 0, 0))
    found = interpolation_errors(
        m, times, links, key_rows(len(times), stride), {"ground": BOX[:1], "crank": np.zeros((1, 3))}
    )
    assert found.position == pytest.approx(r * (1 - np.cos(speed * stride / 480 / 2)), rel=1e-9)
    assert found.position_at[0] == "crank"


def test_a_body_that_turns_about_its_own_origin_is_right_by_slerp_but_not_by_components():
    """Evenly turned it is exact; by components the angle lags: the worst of both is what is told."""
    m = wheel()
    times, links = turning(480, 3.0, 1.0)
    keys = key_rows(len(times), 48)
    found = interpolation_errors(m, times, links, keys, {"ground": BOX, "crank": BOX})
    h = 3.0 * 0.1
    share = np.linspace(0, 1, 49)
    half = h / 2  # nlerp of half angles: tan of the part turned
    turned = 2 * np.arctan2(share * np.sin(half), 1 - share + share * np.cos(half))
    lag = np.abs(turned - share * h).max()
    assert found.rotation == pytest.approx(lag, rel=1e-6)
    assert found.position == pytest.approx(2 * np.sin(lag / 2) * np.linalg.norm([0.4, 0.1]), rel=1e-6)


def test_the_true_gap_of_a_joint_is_no_fault_of_the_player():
    """Joint frames that lie 1 mm apart stay so: only what drawing adds counts, and sliding is not a gap."""
    m = wheel()
    apart = replace(m.joints[0], T_child_joint=spatial.pose(None, [0.001, 0, 0]))
    m = replace(m, joints=(apart,))
    times, links = turning(480, 2.0, 0.5)
    every = interpolation_errors(m, times, links, np.arange(len(times)), {"ground": BOX, "crank": BOX})
    assert max(every.position, every.rotation, every.joint_gap) < 1e-15
    slide = replace(m, joints=(replace(apart, type="prismatic"),))
    times = np.arange(121) / 480
    up = np.tile(np.eye(4), (121, 1, 1))
    up[:, 2, 3] = 0.1 * times**2
    links = {"ground": np.tile(np.eye(4), (121, 1, 1)), "crank": up}
    found = interpolation_errors(slide, times, links, key_rows(121, 24), {"ground": BOX, "crank": BOX})
    assert found.joint_gap < 1e-15
    assert found.position == pytest.approx(0.1 * (24 / 480) ** 2 / 4, rel=1e-9)


def test_no_point_of_a_mesh_is_further_off_than_the_extremes(rng, sils_cad):
    m = sils_cad.mechanism
    reaches = player_interpolation.extreme_points(m)
    for body in m.bodies:
        reach = reaches[body.name]
        for _ in range(5):
            T = spatial.pose(spatial.exp_so3(rng.normal(size=3) * 0.01), rng.normal(size=3) * 1e-3)
            bound = np.linalg.norm(reach @ (T[:3, :3] - np.eye(3)).T + T[:3, 3], axis=1).max()
            for mesh in body.meshes:
                moved = mesh.vertices @ (T[:3, :3] - np.eye(3)).T + T[:3, 3]
                assert np.linalg.norm(moved, axis=1).max() <= bound * (1 + 1e-12)


# ------------------------------------------------------------------------------------------- the rate


@pytest.fixture(scope="module")
def short():
    """SILS, half a second of its protocol, planned."""
    robot = api.load("sils")
    return robot.mechanism, api.plan(robot, SHORT)


def brute_force(mechanism, trajectory, rate: float) -> tuple[float, float]:
    """Worst point and rotation between keys at 1 kHz, by scipy: nothing of the code under test."""
    from twin.reference import ReferenceModel

    fine = np.linspace(0, trajectory.duration, int(trajectory.duration * 1000) + 1)
    keys = key_times(trajectory.duration, rate)
    model = ReferenceModel(mechanism)
    both = np.concatenate([keys, fine])
    links = model.link_poses(model.run_poses(trajectory.poses(both)).x)
    off, turn = 0.0, 0.0
    for body in mechanism.bodies:
        at_keys, true = links[body.name][: len(keys)], links[body.name][len(keys) :]
        p = np.stack([np.interp(fine, keys, at_keys[:, i, 3]) for i in range(3)], axis=1)
        R = Slerp(keys, Rotation.from_matrix(at_keys[:, :3, :3]))(fine)
        turn = max(turn, (R.inv() * Rotation.from_matrix(true[:, :3, :3])).magnitude().max())
        for mesh in body.meshes:
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            for v in (low, high):
                drawn = R.apply(v) + p
                off = max(off, np.linalg.norm(drawn - (true[:, :3, :3] @ v + true[:, :3, 3]), axis=1).max())
    return off, turn


@pytest.mark.slow
@pytest.mark.parametrize("um", [20, 2])
def test_the_rate_is_the_lowest_that_keeps_the_budget_as_brute_force_finds_it(short, um):
    mechanism, trajectory = short
    budget = ClipAccuracy(um * 1e-6, 1.0, 1.0)
    clip = make_clip(mechanism, trajectory, budget=budget)
    assert clip.between.keeps(budget)
    lower = [r for r in key_rate.KEY_RATES if r < clip.rate]
    assert lower, "this budget says nothing: the lowest rate keeps it"
    off, _ = brute_force(mechanism, trajectory, clip.rate)
    assert off <= clip.between.position * 1.02
    assert off > clip.between.position * 0.8
    assert brute_force(mechanism, trajectory, lower[-1])[0] > budget.position


def test_a_smaller_budget_never_has_a_lower_rate(short):
    rates = [make_clip(*short, budget=ClipAccuracy(p * 1e-6, 1.0, 1.0)).rate for p in (1000, 20, 5, 2)]
    assert rates == sorted(rates)
    assert rates[0] == key_rate.KEY_RATES[0] < rates[-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "budget", [ClipAccuracy(1e-9, 1.0, 1.0), ClipAccuracy(1.0, 1e-9, 1.0), ClipAccuracy(1.0, 1.0, 1e-12)]
)
def test_each_number_of_the_budget_counts_and_the_highest_rate_is_the_last_resort(short, budget):
    clip = make_clip(*short, budget=budget)
    assert clip.rate == key_rate.KEY_RATES[-1]
    assert not clip.between.keeps(budget)


def test_keys_are_uniform_and_end_at_the_end(short):
    mechanism, trajectory = short
    clip = make_clip(mechanism, trajectory)
    assert clip.times[0] == 0
    assert clip.times[-1] == pytest.approx(trajectory.duration, abs=1e-12)
    assert np.allclose(np.diff(clip.times)[:-1], 1 / clip.rate)
    assert 0 < np.diff(clip.times)[-1] <= 1 / clip.rate + 1e-12
    assert {n for n, T in clip.links.items() if T.shape == (len(clip.times), 4, 4)} == {
        b.name for b in mechanism.bodies
    }
    single = {j.name for j in mechanism.joints if len(j.free_axes) == 1}
    assert set(clip.joints) == single
    assert {j.name for j in mechanism.loops} & set(clip.joints), "loop joints have values too"


def test_clip_is_the_independent_model_and_its_loops_are_closed(short):
    mechanism, trajectory = short
    clip = make_clip(mechanism, trajectory)
    for joint in mechanism.joints:
        T = joint.relative(clip.links[joint.parent], clip.links[joint.child])
        locked = [i for i in range(3) if i not in joint.free_axes]
        assert np.abs(T[:, locked, 3]).max() < 1e-9, joint.name
        if joint.type == "revolute":
            measured = np.arctan2(T[:, 1, 0], T[:, 0, 0])
            assert np.allclose(np.exp(1j * measured), np.exp(1j * clip.joints[joint.name]), atol=1e-9), joint.name
        if joint.type == "prismatic":
            assert np.allclose(T[:, 2, 3], clip.joints[joint.name], atol=1e-9), joint.name


# ------------------------------------------------------------------------------------------- quaternions


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=2, max_size=30), st.floats(0.0, 20.0))
def test_signs_never_jump_and_matrices_come_back(axes, turns):
    steps = np.array(axes) * 0.9
    R = [Rotation.from_rotvec([0, 0, turns])]
    for s in steps:
        R.append(R[-1] * Rotation.from_rotvec(s))
    matrices = np.array([r.as_matrix() for r in R])
    q = player_interpolation.quaternions_xyzw(spatial.pose(matrices))
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)
    assert np.allclose(Rotation.from_quat(q).as_matrix(), matrices, atol=1e-12)
    assert q[0, 3] >= 0


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 3.0), st.floats(0.0, 1.0))
def test_slerp_is_scipys(angle, share):
    r = Rotation.from_rotvec([[0.1, -0.2, 0.3], (np.array([2.0, 1.0, -2.0]) / 3 * angle).tolist()])
    r = Rotation.concatenate([r[0], r[0] * r[1]])
    q = spatial.continuous_signs(r.as_quat())
    mine = Rotation.from_quat(player_interpolation.slerp(q[:1], q[1:], np.array([share])))
    assert (mine.inv() * Slerp([0, 1], r)([share])).magnitude()[0] < 1e-7


# ------------------------------------------------------------------------------------------- hash


def test_hash_tells_robots_apart_by_what_a_player_must_agree_on():
    m = wheel()
    joint, body = m.joints[0], m.bodies[1]
    mesh = body.meshes[0]
    moved = mesh.vertices.copy()
    moved[3, 1] += 1e-6
    others = [
        replace(m, name="wheel2"),
        replace(m, joints=(replace(joint, limits=(0.0, 1.0)),)),
        replace(m, joints=(replace(joint, T_child_joint=spatial.pose(None, [1e-6, 0, 0])),)),
        replace(m, joints=(replace(joint, active=False),)),
        replace(m, frames=(Frame("tool", "crank", spatial.pose(None, [0, 0, 1e-6])),)),
        replace(m, bodies=(m.bodies[0], replace(body, meshes=(replace(mesh, vertices=moved),)))),
        replace(m, bodies=(m.bodies[0], replace(body, meshes=(replace(mesh, color_rgba=(1, 0, 0, 1)),)))),
    ]
    hashes = {model_hash(x) for x in (m, *others)}
    assert len(hashes) == len(others) + 1
    assert all(h.startswith("sha256:") and len(h) == 71 for h in hashes)


def test_hash_leaves_masses_and_last_bits_aside():
    """A server that does not weigh, and another processor, must find the same robot."""
    m = wheel()
    weighed = replace(m.bodies[1], inertia=Inertia(2.0, np.zeros(3), np.eye(3)))
    assert model_hash(replace(m, bodies=(m.bodies[0], weighed))) == model_hash(m)
    mesh = replace(m.bodies[1].meshes[0], vertices=BOX * (1 + 1e-15))
    assert model_hash(replace(m, bodies=(m.bodies[0], replace(m.bodies[1], meshes=(mesh,))))) == model_hash(m)
