"""Several arms at once: free by an exact check that shares nothing with the search, each arm on its own path."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pytest

import twin
from made.arm import CLEARANCE, LINK, SIZE, arm, space_of
from made.mechanisms import four_bar
from twin import api
from twin.cli import main
from twin.core import spatial
from twin.core.errors import CancelledError, ProtocolError, TwinError
from twin.model.joined import joined, owners
from twin.planning.around import around
from twin.planning.smooth import line
from twin.planning.timing import time_path
from twin.planning.together import Behind, beside
from twin.reference import ReferenceModel
from twin.reference.clearance import Shape, distance_between

ROOT = Path(__file__).parents[1]
PLACES = {"left": spatial.pose(p=[-0.5, 0, 0]), "right": spatial.pose(spatial.rotation_z(np.pi), [0.5, 0, 0])}
UP, DOWN = np.array([0.5, 0.0, 0.0]), np.array([-0.5, 0.0, 0.0])


def both(limits=None):
    """Return the spaces of the left arm alone and of both arms."""
    right = arm()
    if limits is not None:
        right = replace(right, joints=tuple(replace(j, limits=limits) for j in right.joints))
    arms = {"left": (arm(), PLACES["left"]), "right": (right, PLACES["right"])}
    return space_of(joined({"left": arms["left"]})), space_of(joined(arms), arms=owners(arms))


def boxes(q, T):
    """Return the links of an arm with its base at T as boxes for coal, by trigonometry."""
    out, at = [], T
    for a in q:
        at = at @ spatial.pose(spatial.rotation_z(a))
        middle = at @ spatial.pose(p=[LINK / 2, 0, 0])
        out.append((coal.Box(*SIZE), coal.Transform3s(middle[:3, :3], middle[:3, 3])))
        at = at @ spatial.pose(p=[LINK, 0, 0])
    return out


def apart(q):
    """Return the smallest distance (k,) between both arms at q (k, 6)."""
    out = []
    for row in q:
        left, right = boxes(row[:3], PLACES["left"]), boxes(row[3:], PLACES["right"])
        out.append(
            min(coal.distance(*a, *b, coal.DistanceRequest(), coal.DistanceResult()) for a in left for b in right)
        )
    return np.array(out)


@pytest.mark.parametrize("seed", range(3))
def test_two_arms_exchange_places_without_touching(seed):
    one, whole = both()
    first = around(one, UP, DOWN)
    s = np.linspace(0.0, 1.0, 801)
    assert apart(line(np.r_[UP, UP], np.r_[DOWN, DOWN])(s)).min() <= 0, "at once, the arms would collide"
    path = beside(whole, first, UP, DOWN, seed=seed)
    q = path(s)
    np.testing.assert_allclose(q[[0, -1]], [np.r_[UP, UP], np.r_[DOWN, DOWN]], atol=1e-9)
    seen = whole.certify(path)
    assert CLEARANCE / 2 <= seen.proven <= apart(q).min()
    # the arm with priority stays on its path, and never goes back
    u = (UP[0] - q[:, 0]) / (UP[0] - DOWN[0])
    np.testing.assert_allclose(q[:, :3], first(np.clip(u, 0, 1)), atol=1e-9)
    assert np.all(np.diff(u) >= -1e-9)
    # derivatives, and a timing within limits, with the distances at the times of its samples
    h = 1e-6
    inner = s[5:-5:40]
    np.testing.assert_allclose(path(inner, 1), (path(inner + h) - path(inner - h)) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(path(inner, 2), (path(inner + h, 1) - path(inner - h, 1)) / (2 * h), atol=1e-3)
    timing = time_path(path, np.full(6, 1.0), np.full(6, 3.0))
    rates = np.diff(path(timing.s), axis=0) / 1e-3
    assert np.abs(rates).max() <= 1.001
    assert apart(path(timing.s[::20])).min() >= seen.proven
    # u grows faster than s here and there, so that the certificate has parts; its place counts along the whole path
    space = Behind(whole, first)
    seen = space.certify(path._path)
    assert len(space._parts(path._path)) > 1
    assert whole.nearest(path(np.array([seen.s]))[0]) == (pytest.approx(seen.found, abs=1e-6), seen.bodies)


def test_a_third_coordinate_that_may_not_decrease_orders_the_connections():
    one, whole = both()
    space = Behind(whole, around(one, UP, DOWN))
    a, b = np.append(UP, 0.3), np.append(UP + 0.1, 0.6)
    assert np.isfinite(space.cost(a[None], b[None])[0])
    assert space.cost(b[None], a[None])[0] == np.inf
    assert not space.free_each(b[None], a[None])[0]
    assert not space.free_along(line(b, a))


def test_arms_that_collide_at_the_goal_are_named():
    one, whole = both()
    with pytest.raises(ProtocolError, match=r"at its goal, left_link2 and right_link\d collide"):
        beside(whole, around(one, UP, DOWN), UP, np.array([0.5, 0, 0]) * 0.0 + np.array([0.35, 0.3, 0.0]))


def test_an_arm_that_cannot_give_way_is_said_to_have_no_path():
    one, whole = both(limits=(-0.55, 0.55))
    first = around(one, np.array([0.5, 0, 0]), DOWN)
    with pytest.raises(ProtocolError, match=r"no path .* was found through \d+ free random configurations"):
        beside(whole, first, UP, DOWN)


def test_a_search_for_a_second_arm_can_be_cancelled():
    one, whole = both()
    count = iter(range(30))
    with pytest.raises(CancelledError):
        beside(whole, around(one, UP, DOWN), UP, DOWN, cancelled=lambda: next(count, None) is None)


def test_joined_arms_have_the_poses_of_the_single_ones():
    T = spatial.pose(spatial.rotation_z(0.7), [0.4, -0.2, 0.1])
    single = {"arm": (arm(), PLACES["left"]), "bar": (four_bar(), T)}
    whole = joined(single)
    assert [j.name for j in whole.active] == [f"{n}_{j.name}" for n, (m, _) in single.items() for j in m.active]
    model = ReferenceModel(whole)
    links = model.home().link_poses
    for name, (mechanism, T_world_base) in single.items():
        for body, T_base_body in ReferenceModel(mechanism).home().link_poses.items():
            np.testing.assert_allclose(links[f"{name}_{body}"], T_world_base @ T_base_body, atol=1e-9)


def test_each_body_belongs_to_its_arm_even_if_names_begin_alike():
    """Two arms psm and psm_2 at one place collide in their rest poses: all pairs of both count, in full."""
    arms = {"psm": (arm(), PLACES["left"]), "psm_2": (arm(), PLACES["left"])}
    assert set(owners(arms)) | {"world"} == {b.name for b in joined(arms).bodies}
    pairs = space_of(joined(arms), arms=owners(arms))._pairs
    names = [{pairs.shapes[i].name for i in row} for row in pairs.rows]
    for link in range(3):
        assert {f"psm_link{link}", f"psm_2_link{link}"} in names


def raven(side, tmp_path, **waypoints):
    """Return (robot, protocol) with free phases between waypoints (shoulder, elbow in deg; depth in mm)."""
    text = (ROOT / "trajectories/raven_left/around/dome.toml").read_text(encoding="utf-8")
    head = text[: text.index("[waypoints.below]")].replace("raven_left", f"raven_{side}").replace('"below"', '"a"')
    body = ""
    for name, (shoulder, elbow, depth) in waypoints.items():
        joints = f"shoulder_deg = {shoulder}, elbow_deg = {elbow}, insertion_mm = {depth}"
        body += (
            f'[waypoints.{name}]\nlabel = "{name}"\njoints = {{ {joints} }}\nprovenance = "ASSUMED"\nnote = "test"\n'
        )
    for name in list(waypoints)[1:]:
        body += f'[[phases]]\ntype = "free"\nname = "to_{name}"\nto = "{name}"\nclearance_mm = 2\n'
    file = tmp_path / f"{side}.toml"
    file.write_text(head + body, encoding="utf-8")
    robot = twin.load(f"raven_{side}")
    return robot, robot.protocol(file)


@pytest.mark.parametrize(
    ("scene", "names", "clearance", "text"),
    [
        ("raven", ("raven_left", "raven_right"), float("nan"), "the clearance is nan m; give more than 0"),
        ("raven", ("raven_left", "raven_right"), 0.0, "the clearance is 0 m"),
        ("ravel", ("raven_left", "raven_right"), 0.002, "raven"),
        ("raven", ("raven_left", "sils"), 0.002, "has no robot 'sils'; it has: raven_right, ecm"),
        ("raven", ("raven_left",), 0.002, "name at least two"),
    ],
)
def test_bad_input_for_several_arms_is_named(tmp_path, scene, names, clearance, text):
    places = {"a": (40, 90, 400), "b": (50, 90, 400)}
    made = {"raven_left": raven("left", tmp_path, **places), "raven_right": raven("right", tmp_path, **places)}
    arms = {n: made.get(n, made["raven_left"]) for n in names}
    with pytest.raises(TwinError, match=text):
        api.plan_together(scene, arms, clearance)


def test_a_phase_that_follows_a_given_path_cannot_be_planned_beside_another_arm(tmp_path):
    places = {"a": (40, 90, 400), "b": (50, 90, 400)}
    robot = twin.load("raven_left")
    arms = {"raven_right": raven("right", tmp_path, **places), "raven_left": (robot, robot.protocol("reach"))}
    with pytest.raises(ProtocolError, match=r"raven_left.*cannot be planned|is a pose|no phase can avoid|no choice"):
        api.plan_together("raven", arms, 0.002)


@pytest.mark.slow
def test_both_ravens_pass_each_other_without_touching(tmp_path, capsys):
    arms = {
        "raven_left": raven("left", tmp_path, a=(59.6, 119.5, 324.5), b=(14.6, 106.9, 400)),
        "raven_right": raven("right", tmp_path, a=(12.6, 132, 378.6), b=(60.3, 87.6, 341.7)),
    }
    files = {name: str(tmp_path / f"{name[6:]}.toml") for name in arms}
    options = ["--avoid", "raven", "--with", f"raven_right={files['raven_right']}", "--clearance-mm", "2"]
    assert main(["plan", "raven_left", files["raven_left"], *options, "--out", str(tmp_path / "out"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    (phase,) = said["phases"]
    places = {p.name: p.T_world_base for p in api.load_scene("raven").places}
    q, shapes, links = {}, {}, {}
    for name, (robot, _) in arms.items():
        table = np.loadtxt(tmp_path / "out" / f"{name}.csv", delimiter=",", skiprows=1)
        assert table[-1, 0] == pytest.approx(phase["t1_s"])
        scale = [np.pi / 180 if j.is_angle else 1e-3 for j in robot.mechanism.active]
        q[name] = table[:, 1:] * scale
        shapes[name] = {b.name: Shape(b.name, b.name, b.meshes) for b in robot.mechanism.bodies if b.meshes}

    def least(count, straight=False):
        """Return the smallest distance between the arms at `count` moments, by coal, or on the straight paths."""
        for name, (robot, _) in arms.items():
            rows = q[name][np.linspace(0, len(q[name]) - 1, count).astype(int)]
            if straight:
                rows = line(rows[0], rows[-1])(np.linspace(0, 1, count))
            poses = ReferenceModel(robot.mechanism).run(rows)
            found = ReferenceModel(robot.mechanism).link_poses(poses.x)
            links[name] = {n: places[name] @ T for n, T in found.items()}
        left, right = (shapes[n].items() for n in arms)
        return min(
            distance_between(a, b, links["raven_left"][m][k], links["raven_right"][n][k])
            for m, a in left
            for n, b in right
            for k in range(count)
        )

    assert least(25, straight=True) <= 0, "at once on straight paths, the arms would collide"
    assert phase["proven_mm"] / 1e3 <= least(60)
