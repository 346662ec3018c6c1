"""Several arms at once: free by an exact check that shares nothing with the search, each arm on its own path."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import coal
import numpy as np
import pytest

import twin
from made import protocols
from made.arm import CLEARANCE, LINK, SIZE, arm, space_of
from made.mechanisms import four_bar
from twin import api
from twin.api.multi_robot_plan import _Arm
from twin.api.scene_loading import place_of
from twin.cad.build import inputs
from twin.cli import main
from twin.cli.commands.plan import EXAMPLES
from twin.core import spatial
from twin.core.errors import CancelledError, DescriptionError, ProtocolError, TwinError
from twin.core.findings import verdict
from twin.model.body import Frame
from twin.model.combined_arms import joined, owners
from twin.model.scene import Place, load_scene
from twin.model.transmission import Actuator, Transmission
from twin.planning.arm_distances import ArmDistances, Nearest
from twin.planning.obstacle_avoidance import around
from twin.planning.path import line
from twin.planning.path_kinematics import without_equations
from twin.planning.plan import plan as plan_
from twin.planning.plan_files import RobotSamples, props_files, protocol_files, write_plan_scene
from twin.planning.priority import NewArmSpace, beside
from twin.planning.protocol import load_protocol
from twin.planning.timing import time_path
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, Shape, distance_between
from twin.reference.follower import Follower
from twin.ui.report import together_figures
from twin.ui.report.scene_figures import RobotPhases
from twin.ui.report.scene_figures import distances as drawn
from twin.ui.report.style import PALETTE

ROOT = Path(__file__).parents[2]
PLACES = {"left": spatial.pose(p=[-0.5, 0, 0]), "right": spatial.pose(spatial.rotation_z(np.pi), [0.5, 0, 0])}
UP, DOWN, LOW = (np.array([a, 0.0, 0.0]) for a in (0.5, -0.5, -1.2))


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


def test_a_second_arm_of_a_kind_is_found_by_the_name_of_its_robot():
    scene = load_scene(twin.core.assets.scene_file("davinci"))
    of = [p.name for p in scene.places if p.robot == "davinci_psm"]
    assert [place_of(scene, "davinci_psm").name, place_of(scene, "davinci_psm", of[:1]).name] == of[:2]
    with pytest.raises(TwinError, match=f"scene 'davinci' has no further robot '{of[0]}'; it has: {of[1]}"):
        place_of(scene, of[0], of[:1])


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.nightly)])
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
    space = NewArmSpace(whole, first)
    seen = space.certify(path._path)
    assert len(space._parts(path._path)) > 1
    assert whole.nearest(path(np.array([seen.s]))[0]) == (pytest.approx(seen.found, abs=1e-6), seen.bodies)


def test_a_third_coordinate_that_may_not_decrease_orders_the_connections():
    one, whole = both()
    space = NewArmSpace(whole, around(one, UP, DOWN))
    a, b = np.append(UP, 0.3), np.append(UP + 0.1, 0.6)
    assert np.isfinite(space.cost(a[None], b[None])[0])
    assert space.cost(b[None], a[None])[0] == np.inf
    assert not space.free_each(b[None], a[None])[0]
    assert not space.free_along(line(b, a))


def test_arms_that_collide_at_the_goal_are_named():
    one, whole = both()
    with pytest.raises(ProtocolError, match="at the goal, left_link2 and right_link2 collide"):
        beside(whole, around(one, UP, DOWN), UP, np.array([0.35, 0.3, 0.0]))


def test_an_arm_that_cannot_give_way_is_said_to_have_no_path():
    one, whole = both(limits=(-0.55, 0.55))
    first = around(one, np.array([0.5, 0, 0]), DOWN)
    with pytest.raises(ProtocolError, match=r"no path was found through \d+ free random configurations") as told:
        beside(whole, first, UP, DOWN)
    assert "goal seems to be enclosed" not in str(told.value), "from the goal, the arms can go back a long way"


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


class Robot:
    """A planar arm as `twin.load` returns robots; `bound` returns it with another mechanism, if there is one."""

    name = "arm"

    def __init__(self, mechanism, other=None):
        self.mechanism, self._other = mechanism, other

    def bound(self, protocol):
        return self if self._other is None else Robot(self._other)

    def path_kinematics(self):
        return without_equations(self.mechanism, Follower(lambda: ReferenceModel(self.mechanism)), ())


def protocol_of(tmp_path, *waypoints, frame="tool", limits=""):
    """Return a protocol with free phases between waypoints (3,) in rad."""
    head = {"name": "over", "title": "Two arms", "robot": "arm", "frame": frame, "shaft_axis": [1, 0, 0], "start": "w0"}
    parts = []
    for k, q in enumerate(waypoints):
        values = ", ".join(f"q{i}_deg = {v}" for i, v in enumerate(np.round(np.rad2deg(q), 9)))
        parts.append(protocols.waypoint(f"w{k}", label=f"w{k}", joints=f"{{ {values} }}"))
        parts.append(protocols.phase(type="free", name=f"to_w{k}", to=f"w{k}", clearance_mm=5) if k else "")
    most = {"free": (300, 900, 90, 300)}
    text = protocols.text(head | {"no_patient": "made for a test"}, "", most, parts)
    text = text.replace("rotation_acceleration_deg_s2 = 300\n", f"rotation_acceleration_deg_s2 = 300\n{limits}\n")
    file = tmp_path / "over.toml"
    file.write_text(text, encoding="utf-8")
    return load_protocol(file)


def motorised(slow=0.4, most=4.0):
    """Return the arm with motors m0 = q0 + q1 and m1 = q1 - q0; m0 is slow, and m1 has limits that no joint has."""
    motors = Actuator("m0", max_speed=slow), Actuator("m1", limits=(-most, most))
    cables = Transmission("cables", ("q0", "q1"), ("m0", "m1"), np.linalg.inv([[1.0, 1.0], [-1.0, 1.0]]))
    made = arm()
    tip = Frame("tip", made.bodies[-1].name, spatial.pose(p=[LINK, 0.1, 0]))
    return replace(made, actuators=motors, transmissions=(cables,), frames=(*made.frames, tip))


@pytest.fixture
def stand(monkeypatch):
    """A scene with two places for arms, and nothing else."""
    places = tuple(Place(n, "arm", "", T, {}, {}, {}) for n, T in PLACES.items())
    scene = SimpleNamespace(name="stand", places=places, props=None, touching=frozenset())
    monkeypatch.setattr("twin.api.multi_robot_plan.load_scene", lambda name: scene)
    return scene


def tip_of(q, y=0.0):
    """Return the point (k, 2) of the planar arm at (LINK, y) on its last link, by trigonometry."""
    a = np.cumsum(q, axis=1)
    ends = LINK * np.stack([np.cos(a), np.sin(a)], axis=2).sum(axis=1)
    return ends + y * np.stack([-np.sin(a[:, 2]), np.cos(a[:, 2])], axis=1)


@pytest.mark.slow
def test_a_plan_of_two_arms_keeps_all_limits_of_both(tmp_path, stand):
    """Also of a motor, of a moved frame that is not the tool, and of its jerk, by differences of the samples."""
    goal, jerk = UP + np.array([0.3, 0.2, 0.1]), "tip_jerk_mm_s3 = 4000"
    arms = {
        "left": (Robot(motorised()), protocol_of(tmp_path, UP, goal)),
        "right": (Robot(motorised(9.0)), protocol_of(tmp_path, UP, UP + 0.05, frame="tip", limits=jerk)),
    }
    plan = api.plan_together("stand", arms, CLEARANCE)
    assert plan.verdict == "agree", [f.message for f in plan.findings if f.severity != "info"]
    left, tip, dt = plan.q["left"], tip_of(plan.q["right"], 0.1), plan.t[1]
    rates = {
        "motor": np.abs(np.diff(left[:, 0] + left[:, 1])).max() / dt / 0.4,
        "speed": np.linalg.norm(np.diff(tip, axis=0), axis=1).max() / dt / 0.3,
        "acceleration": np.linalg.norm(np.diff(tip, 2, axis=0), axis=1).max() / dt**2 / 0.9,
        "jerk": np.linalg.norm(np.diff(tip, 3, axis=0), axis=1).max() / dt**3 / 4,
    }
    assert max(rates.values()) <= 1.01, rates
    assert min(rates["motor"], rates["jerk"]) > 0.9, "these limits must matter"


@pytest.mark.slow
def test_two_arms_of_a_scene_pass_each_other_and_one_stays_where_its_phases_end(tmp_path, stand):
    arms = {
        "left": (Robot(arm()), protocol_of(tmp_path, UP, DOWN)),
        "right": (Robot(motorised(9.0, most=1.3)), protocol_of(tmp_path, UP, DOWN, LOW)),
    }
    plan = api.plan_together("stand", arms, CLEARANCE)
    assert plan.verdict == "agree", [f.message for f in plan.findings if f.severity != "info"]
    assert [p.name for p in plan.phases] == ["to_w1 / to_w1", "at rest / to_w2"]
    assert plan.phases[0].t1 == plan.phases[1].t0
    left, right = plan.q["left"], plan.q["right"]
    assert len(left) == len(right) == len(plan.t)
    assert np.abs(right[:, 1] - right[:, 0]).max() <= 1.3, "without motor m1, the arm would fold to 1.48 rad"
    np.testing.assert_allclose(left[[0, -1]], [UP, DOWN], atol=1e-9)
    np.testing.assert_allclose(right[[0, -1]], [UP, LOW], atol=1e-9)
    least = apart(np.hstack([left, right])[::20]).min()
    assert least >= min(p.certificate.proven for p in plan.phases) >= CLEARANCE / 4
    assert "rounds" in plan.content()["phases"][0]
    assert [list(p.rounds) for p in plan.phases] == [["right"], []], "the other paths are straight"
    assert plan.as_dict()["search_times"] == {"right, to_w1 / to_w1": plan.phases[0].rounds["right"].times()}
    (first, *_) = (f.message for f in plan.findings if f.code == "clearance.proven")
    assert "except bodies connected by a joint, bodies of one robot that in the CAD are nearer than twice" in first


SCENE = """
name = "stand"
title = "Two planar arms"
source = "made for a test"
clearance_mm = 5
[port.here]
position_mm = [0, 0, 0]
provenance = "ASSUMED"
note = "test"
"""


@pytest.fixture
def stand_file(tmp_path, monkeypatch):
    """The scene `stand` as a file."""
    text = SCENE
    for name, T in PLACES.items():
        yaw = np.degrees(np.arctan2(T[1, 0], T[0, 0]))
        text += f'[[robot]]\nname = "{name}"\nrobot = "arm"\nprotocol = "any"\nport = "here"\n'
        text += (
            f'position_mm = {[float(x) for x in T[:3, 3] * 1e3]}\nyaw_deg = {yaw}\nprovenance = "ASSUMED"\nnote = "t"\n'
        )
    file = tmp_path / "stand/scene.toml"
    file.parent.mkdir()
    file.write_text(text, encoding="utf-8")
    monkeypatch.setattr("twin.api.multi_robot_plan.load_scene", lambda name: load_scene(file))
    return file


@pytest.mark.slow
def test_a_plan_tells_the_distance_between_the_arms_from_that_inside_an_arm_and_its_files_play_it(tmp_path, stand_file):
    arms = {
        n: (Robot(motorised(9.0)), protocol_of(tmp_path, UP, DOWN, *rest))
        for n, rest in (("left", ()), ("right", (LOW,)))
    }
    plan = api.plan_together("stand", arms, CLEARANCE)
    q = np.hstack([plan.q["left"], plan.q["right"]])
    # the clearance between the arms, by exact distances of boxes
    shown = np.searchsorted(plan.t, plan.arm_distances.t - 1e-9)
    distance = apart(q[shown])
    np.testing.assert_allclose(plan.arm_distances.by_pair["left", "right"].distance, distance, atol=1e-6)
    said = plan.as_dict()["clearances"]
    between = said["between_arms"]
    assert between["found_mm"] == pytest.approx(distance.min() * 1e3, abs=0.6)
    assert between["proven_mm"] <= distance.min() * 1e3
    assert {name.split("_")[0] for name in between["bodies"]} == {"left", "right"}
    assert between["found_mm"] == pytest.approx(
        apart(q[[np.searchsorted(plan.t, between["t_s"] - 1e-9)]])[0] * 1e3, abs=0.1
    )
    assert set(said) == {"between_arms", "inside_arm"}, "there are no props"
    inside = said["inside_arm"]
    assert len({name.split("_")[0] for name in inside["bodies"]}) == 1
    assert plan.phases[0].certificate.found == min(n.found for n in plan.phases[0].nearest_pairs.values())
    assert between["phase"] in {p.name for p in plan.phases}
    assert all("between_arms" in p["clearances"] for p in plan.content()["phases"])
    found = [f for f in plan.findings if f.code == "clearance.between_arms"]
    assert [f.where for f in found] == [p.name for p in plan.phases]
    assert "left and right keep at least" in found[0].message
    text = "\n".join(map(str, plan.text()))
    assert "between arms" in text
    assert "inside one arm" in text
    # the plot, and the files
    assert len(together_figures.figure(plan).axes) == 2
    folder = tmp_path / "plan"
    folder.mkdir()
    plan.write(folder)
    assert sorted(p.name for p in folder.iterdir()) == sorted(plan.files())
    scene = load_scene(folder / "scene.toml")
    assert (scene.name, scene.clearance, scene.has_protocols) == ("stand_plan", CLEARANCE, True)
    for place in scene.places:
        np.testing.assert_allclose(place.T_world_base, PLACES[place.name], atol=1e-12)
        assert place.protocol_name == place.name
        protocol = load_protocol(place.protocol)
        assert protocol.findings == (), [f.message for f in protocol.findings]
        robot = Robot(motorised(9.0))
        again = plan_(protocol, robot.path_kinematics(), T_tool_frame=robot.mechanism.frame_in_tool("tool"))
        planned = plan.q[place.name]
        np.testing.assert_allclose(again.q, planned[: len(again.q)], atol=1e-12)
        np.testing.assert_allclose(
            planned[len(again.q) :], planned[-1:].repeat(len(planned) - len(again.q), 0), atol=1e-12
        )
        assert [p.type for p in again.phases] == ["samples"] * (1 if place.name == "left" else 2)
        assert verdict(again.findings) == "agree", [f.message for f in again.findings]


def test_a_phase_shorter_than_the_steps_of_the_distances_keeps_its_nearest_bodies():
    apart_ = ArmDistances(
        np.array([0.0, 1.0, 2.0]), {("a", "b"): Clearance(np.full(3, 0.1), (("a/x", "b/y"),) * 3, ())}
    )
    near = Nearest(0.2, 0.3, ("a_x", "b_z"), 1.45)
    assert near.or_nearer(apart_, 1.4, 1.5) is near
    assert near.or_nearer(apart_, 1.4, 2.0) == Nearest(0.1, 0.1, ("a_x", "b_y"), 2.0)
    with pytest.raises(ValueError, match=r"no time from 1\.4 s to 1\.5 s"):
        apart_.least(1.4, 1.5)


def test_every_pair_of_a_scene_is_drawn():
    pairs = {(f"a{k}", "b"): np.array([0.1, 0.2]) for k in range(len(PALETTE) + 2)}
    axes = drawn("t", np.array([0.0, 1.0]), pairs, 0.005, [RobotPhases("b", [(0.0, 1.0)])]).axes[0]
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == [f"{a} - {b}" for a, b in pairs]
    looks = [(line.get_color(), line.get_linestyle()) for line in axes.get_lines()]
    assert len(set(looks)) == len(looks)


def test_the_files_of_a_plan_have_different_names(tmp_path):
    """A robot may be called as the file of the scene, and the props as a robot; the STEP file may be in a folder."""
    places = [
        f'[[robot]]\nname = "{name}"\nrobot = "arm"\nprotocol = "any"\nport = "here"\nposition_mm = [0, 0, 0]\n'
        'yaw_deg = 0\nprovenance = "ASSUMED"\nnote = "t"\n'
        for name in ("scene", "right")
    ]
    stand = tmp_path / "in/stand.toml"
    stand.parent.mkdir()
    stand.write_text(SCENE + "".join(places), encoding="utf-8")
    props = stand.parent / "right.toml"
    props.write_text(PROPS.replace("MESH", "step/a.obj").replace('"props"', '"right"'), encoding="utf-8")
    (stand.parent / "step").mkdir()
    for file in ("a.step", "a.obj"):
        (stand.parent / "step" / file).write_text("ISO-10303-21;", encoding="utf-8")
    scene = replace(load_scene(stand), props=props)
    rest = RobotSamples(protocol_of(tmp_path, UP, DOWN), [("a", True), ("b", True), ("c", True)], np.zeros((1, 3)))
    folder = tmp_path / "out"
    folder.mkdir()
    write_plan_scene(scene, {"scene": rest, "right": rest}, np.array([0.0, 1.0]), 0.005, folder)
    table = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    for robot in table["robot"]:
        assert tomllib.loads((folder / robot["protocol"]).read_text(encoding="utf-8"))["phases"], robot
    copied = tomllib.loads((folder / table["props"]).read_text(encoding="utf-8"))
    assert copied["name"] == "right"
    assert (folder / copied["step"]).read_text(encoding="utf-8") == "ISO-10303-21;"


def test_a_scene_names_the_protocol_file_that_is_missing(stand_file):
    stand_file.write_text(stand_file.read_text().replace('"any"', '"other.toml"', 1), encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"robot\[0\]\.protocol: there is no file other\.toml in the folder"):
        load_scene(stand_file)


def test_limits_of_an_arm_are_tested_at_poses_in_its_own_base(tmp_path, stand):
    right = _Arm(stand.places[1], Robot(motorised(most=2.0)), protocol_of(tmp_path, UP, DOWN))
    seen = []
    right.kinematics = replace(right.kinematics, reach=lambda Ts: seen.append(Ts) or {})
    whole, q = both()[1], np.array([[*UP, *UP], [*UP, 1.3, -0.9, 0.0]])
    assert whole.free(q).all()
    assert whole.keeping(right.keep(0)).free(q).tolist() == [True, False], "motor m1 has -2.2 rad, its limit is -2 rad"
    np.testing.assert_allclose(seen[-1], ReferenceModel(arm()).run(q[:, 3:]).Ts_base_tool, atol=1e-9)


def test_the_arm_of_a_plan_is_bound_to_its_protocol(tmp_path, stand):
    """A trocar of the protocol moves the mechanism; the limits and bodies are those of the moved one."""
    other = motorised()
    made = _Arm(stand.places[0], Robot(arm(), other), protocol_of(tmp_path, UP, DOWN))
    assert made.mechanism is other
    assert made.kinematics.motors.names == ("m0", "m1")


@pytest.mark.parametrize(
    ("left", "right", "text"),
    [
        (
            (UP, DOWN),
            (UP, [-1.3, 0.9, 0.0]),
            "right at 'w1': motor m1 would go .* beyond its limits .* Change this waypoint$",
        ),
        ((UP, [2.7, 0, 0]), (UP, DOWN), "left at 'w1': joint q0 would go 5.73 deg above its upper limit .*waypoint$"),
        ((UP, [0.033, 0, 0]), (UP, [0.033, 0, 0]), "^left at 'w1', right at 'w1': .* apart .* lower the clearance$"),
        ((UP, [0, 0, 0]), (UP, [0, 0, 0]), "^left at 'w1', right at 'w1': left_.* and right_.* collide .* waypoint$"),
        ((UP, UP, DOWN), (UP, UP, DOWN), "^phase to_w1 / to_w1: no arm moves: left stays at 'w0', right stays at 'w0'"),
    ],
)
def test_waypoints_that_cannot_be_planned_are_named_before_any_search(tmp_path, stand, monkeypatch, left, right, text):
    monkeypatch.setattr("twin.planning.obstacle_avoidance.around", lambda *a, **k: pytest.fail("it searched"))
    made = {"left": left, "right": right}
    arms = {n: (Robot(motorised(most=2.0)), protocol_of(tmp_path, *map(np.array, made[n]))) for n in PLACES}
    with pytest.raises(ProtocolError, match=text):
        api.plan_together("stand", arms, CLEARANCE)


def test_a_robot_that_does_not_stand_at_its_place_is_refused(tmp_path, stand):
    arms = {n: (Robot(arm()), protocol_of(tmp_path, UP, DOWN)) for n in PLACES}
    arms["right"][0].name = "sils"
    with pytest.raises(TwinError, match="'right' in scene 'stand' is the robot arm; a plan of sils does not apply"):
        api.plan_together("stand", arms, CLEARANCE)


@pytest.mark.slow
def test_a_plan_of_several_arms_can_be_cancelled_at_any_moment(tmp_path, stand):
    arms = {n: (Robot(arm()), protocol_of(tmp_path, UP, UP + 0.1)) for n in PLACES}
    now, steps = [""], {}

    def progress(label, fraction):
        now[0] = label

    def cancelled():
        steps[now[0]] = steps.get(now[0], 0) + 1
        return False

    api.plan_together("stand", arms, CLEARANCE, progress=progress, cancelled=cancelled)
    assert {"bodies of robots and scene", "timing"} <= set(steps)
    assert any(label.startswith("clearance of phase to_w1") for label in steps)
    for label in steps:
        now[0] = ""
        with pytest.raises(CancelledError):
            api.plan_together("stand", arms, CLEARANCE, progress=progress, cancelled=lambda at=label: now[0] == at)


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
        ("raven", ("raven_left", "raven_right"), float("nan"), "the clearance is nan m; give a finite number above 0"),
        ("raven", ("raven_left", "raven_right"), float("inf"), "the clearance is inf m; give a finite number above 0"),
        ("ravel", ("raven_left", "raven_right"), 0.002, "there is no scene 'ravel'. Did you mean 'raven'"),
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


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ("", "--with '': scene 'raven' has no such robot; it has: raven_left, raven_right, ecm"),
        ("sils", "--with 'sils': scene 'raven' has no such robot; it has: raven_left, raven_right, ecm"),
        ("raven_left", "--with raven_left: this robot is given twice"),
        ("raven_right", "cannot write to"),
    ],
)
def test_options_are_checked_before_the_plan(tmp_path, capsys, monkeypatch, given, text):
    monkeypatch.setattr("twin.api.multi_robot_plan.plan_together", lambda *a, **k: pytest.fail("it planned"))
    monkeypatch.setattr("twin.api.protocol_plan.plan", lambda *a, **k: pytest.fail("it planned"))
    (tmp_path / "file").write_text("")
    out = ["--out", str(tmp_path / "file/out"), "--quiet"]
    assert main(["plan", "raven_left", "--avoid", "raven", "--with", given, *out]) == 2
    assert text in capsys.readouterr().err
    if given == "raven_right":
        assert main(["plan", "raven_left", *out]) == 2
        assert text in capsys.readouterr().err


def test_a_phase_that_follows_a_given_path_cannot_be_planned_beside_another_arm(tmp_path):
    places = {"a": (40, 90, 400), "b": (50, 90, 400)}
    robot = twin.load("raven_left")
    arms = {"raven_right": raven("right", tmp_path, **places), "raven_left": (robot, robot.protocol("reach"))}
    with pytest.raises(ProtocolError, match=r"raven_left: phase '.+' \(.+\) of protocol reach follows a given path"):
        api.plan_together("raven", arms, 0.002)


def test_a_phase_whose_cost_would_be_ignored_is_refused(tmp_path):
    robot = Robot(arm())
    protocol = protocol_of(tmp_path, (0, 0, 0), (10, 0, 0))
    free = replace(protocol.phases[0], cost="clearance")
    with pytest.raises(ProtocolError, match=r"arm: phase 'to_w1' .* sets cost or samples, which a plan of several"):
        _Arm(Place("arm", "arm", "", np.eye(4), {}, {}, {}), robot, replace(protocol, phases=(free,)))


@pytest.mark.nightly
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
    assert 0.5e-3 <= phase["proven_mm"] / 1e3 <= least(60)
    assert (tmp_path / "out" / "path_cost.png").exists()
    assert set(said["search_times"]) == {f"{arm}, {phase['name']}" for arm in phase["rounds"]} != set()


@pytest.mark.nightly
def test_the_example_of_the_help_runs_and_its_folder_is_shown_served_and_exported(tmp_path, capsys, monkeypatch):
    """An instrument is drawn back while the other one takes its place."""
    line = next(x for x in EXAMPLES.splitlines() if "--with" in x)
    monkeypatch.chdir(tmp_path)
    assert main([*line.strip().split("  ")[0].split()[1:], "--out", "out", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [p["name"] for p in said["phases"]] == ["withdraw / deeper", "aside / across"]
    assert all(p["proven_mm"] > 1 for p in said["phases"])
    near = said["clearances"]
    assert near["between_arms"]["proven_mm"] > 10 > near["to_scene"]["proven_mm"] > near["inside_arm"]["proven_mm"] > 2
    assert (tmp_path / "out/clearance.png").stat().st_size > 10_000
    scene = api.load_scene("out")
    assert [p.name for p in scene.places] == ["psm1", "psm2", "ecm"], "the endoscope is at rest"
    world = api.world(scene, dt=0.01)
    world.step(300)
    recording = world.recording()
    for name in ("psm1", "psm2"):
        table = np.loadtxt(tmp_path / "out" / f"{name}.csv", delimiter=",", skiprows=1)[-1, 1:]
        scale = [np.pi / 180 if j.is_angle else 1e-3 for j in api.load("davinci_psm").mechanism.active]
        np.testing.assert_allclose(recording[f"{name}.q"][-1], table * scale, atol=1e-6)
    np.testing.assert_allclose(recording["ecm.q"][-1], recording["ecm.q"][0], atol=1e-12)
    assert main(["view", "out", "--html", "shown.html", "--quiet"]) == 0
    assert (tmp_path / "shown.html").stat().st_size > 1e6
    assert main(["export", "out", "--to", "usd,glb", "--out", "exported", "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "▲" not in shown, shown
    assert main(["run", "out"]) == 2
    assert "plays protocol files; `twin run` requires protocols with a built stage" in capsys.readouterr().err


PROPS = """name = "props"
title = "Props"
source = "test"
default_protocol = "none"
base = "a"
step = "step/a.step"
joint = []
frame = {}
tolerance = { gross_mm = 1, gross_deg = 1, meeting_um = 1, meeting_deg = 1 }
[body.a]
[[body.a.meshes]]
file = "MESH"
unit = "m"
"""


def written_with_props(folder, mesh):
    """Write the playable files of a scene whose props have a mesh and a STEP file; return their folder."""
    own, out = folder / "own", folder / "out"
    for file, text in (("props.toml", PROPS.replace("MESH", mesh)), ("step/a.step", "s"), (mesh, "m")):
        (own / file).parent.mkdir(parents=True, exist_ok=True)
        (own / file).write_text(text)
    (own / "scene.toml").write_text("robot = []")
    out.mkdir()
    scene = SimpleNamespace(file=own / "scene.toml", name="s", source="test", props=own / "props.toml")
    write_plan_scene(scene, {}, np.zeros(1), 0.0, out)
    return out


def test_all_files_of_the_props_are_copied_to_where_their_toml_names_them(tmp_path):
    out = written_with_props(tmp_path, "meshes/fine/a.obj")
    assert [f.read_text() for f in inputs(out / "props.toml")[1:]] == ["s", "m"]


def test_a_file_outside_the_folder_of_the_props_is_refused(tmp_path):
    with pytest.raises(TwinError, match="outside the folder of the props"):
        written_with_props(tmp_path, "../a.obj")


def test_props_with_the_name_of_the_scene_file_of_a_plan_are_refused(tmp_path):
    props = tmp_path / "props/scene.toml"
    props.parent.mkdir()
    text = PROPS.replace('"props"', '"scene"').replace('step = "step/a.step"', "").replace("MESH", "a.obj")
    props.write_text(text, encoding="utf-8")
    with pytest.raises(TwinError, match=r"props/scene\.toml: a plan writes its scene to scene\.toml: give"):
        props_files(props)


def test_protocol_files_of_a_plan_have_different_names():
    scene = SimpleNamespace(props=Path("a_protocol.toml"))
    robots = ["a", "a_protocol", "scene", "scene_protocol", "a_protocol_protocol"]
    files = protocol_files(robots, scene)  # type: ignore[arg-type]
    assert files["a"] == "a.toml"
    assert len({*files.values(), "scene.toml", "a_protocol.toml"}) == len(robots) + 2
