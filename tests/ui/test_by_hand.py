"""Instruments that pass ports under the hands at a console: ports, limits, fulcrum, tools, sessions."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import twin
from made.by_hand import ByHand, RandomHands
from twin.api.console_runs import replay_session
from twin.api.scene_parts import robots_at
from twin.cli import main, scenes
from twin.core import spatial
from twin.core.errors import DescriptionError
from twin.core.units import MM
from twin.model.scene import load_scene
from twin.simulation.controllers.instrument_pivot import LARGEST_ANGLE, SHORTEST_PART, InstrumentPivot
from twin.simulation.limits import JointLimits
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import FulcrumMessage, HandsMessage, RefusedError, ToolMessage
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.session.exercise import Exercise
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.timeline import TICK_RATE


@pytest.fixture(scope="module")
def scene():
    found = [s for s in map(twin.load_scene, scenes.names()) if s.console is not None and s.console.instrument_mm]
    assert found, "a scene whose instruments pass ports"
    return found[0]


@pytest.fixture(scope="module")
def robots(scene):
    return robots_at(scene.places)


def works(scene, robots, seconds, seed):
    """Move both hands at random; check ports and speeds, and that every arm moves."""
    hands = ByHand(scene, robots)
    hands.begin()
    limits = {n: JointLimits.of(m.mechanism) for n, m in hands.members.items()}
    before = {n: hands.world.signals[f"{n}.q"].copy() for n in limits}
    first, off = dict(before), dict.fromkeys(limits, 0.0)
    random = RandomHands(hands, seed)
    for _ in range(round(seconds / 0.04)):
        random.step(0.04)
        for name, x in hands.off_port().items():
            off[name] = max(off[name], x)
        for name, limit in limits.items():
            q = hands.world.signals[f"{name}.q"].copy()
            assert (np.abs(q - before[name]) <= limit.max_speed * 0.04 + 1e-9).all(), name
            assert ((q >= limit.lower - 1e-9) & (q <= limit.upper + 1e-9)).all(), name
            before[name] = q
    assert all(np.abs(before[n] - first[n]).max() > 0.02 for n in limits), "every arm was moved"
    assert all(hands.world.signals[f"{n}.follows"][0] == 1 for n in (*scene.console.right, *scene.console.left))
    return off


@pytest.mark.slow
def test_shafts_stay_in_their_ports_under_random_hands(scene, robots):
    off = works(scene, robots, 3.6, seed=1)
    assert max(off.values()) < 0.1 * MM, off


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [2, 3])
def test_shafts_stay_in_their_ports_for_a_minute(scene, robots, seed):
    off = works(scene, robots, 60, seed)
    assert max(off.values()) < 0.1 * MM, off
    print({n: f"{1e6 * x:.3g} um" for n, x in off.items()})


@pytest.mark.slow
@pytest.mark.parametrize("hand", ["right", "left"])
def test_the_fulcrum_turns_the_motion_across_the_shaft_round_and_scales_it(scene, robots, hand):
    ways, size = {}, 0.012
    for fulcrum in ("compensated", "direct"):
        hands = ByHand(scene, robots, fulcrum)
        hands.begin()
        robot = getattr(scene.console, hand)[0]
        before, (a, inner) = hands.tip(robot), hands.shaft(robot)
        right = np.array([1.0, 0, 0]) - a[0] * a  # to the right, across the shaft
        right /= np.linalg.norm(right)
        hands.move(hand, size * right)
        ways[fulcrum] = hands.tip(robot) - before
    led = scene.console.scale * size * right
    outer = scene.console.instrument_mm[robot] * MM - inner
    assert ways["compensated"] == pytest.approx(led, abs=0.05 * MM)
    assert ways["compensated"][0] > 1 * MM, "the hand goes right, the tip goes right"
    assert ways["direct"][0] < -1 * MM, "the hand goes right, the tip goes left"
    assert ways["direct"] == pytest.approx(-led * inner / outer, abs=0.4 * MM)  # the way is short, but not a point


def test_the_fulcrum_can_be_switched_without_a_jump_of_the_tool(scene, robots):
    hands = ByHand(scene, robots)
    hands.begin()
    for k in range(6):
        hands.device.set("pedals.fulcrum", k % 2)
        before = {n: hands.world.signals[f"{n}.q"].copy() for n in hands.members}
        hands.step(50)
        for name, q in before.items():
            assert np.abs(hands.world.signals[f"{name}.q"] - q).max() < 1e-6, name


_pivot = InstrumentPivot(np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, -1.0]), 0.33, guided=False)


@given(
    st.floats(-0.6, 0.6),
    st.floats(-0.6, 0.6),
    st.floats(SHORTEST_PART + 1e-3, 0.33 - SHORTEST_PART - 1e-3),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
)
@example(0.0, 3e-6, 0.25, [0.0, 0.0, 0.0])  # nearly half a turn
@settings(max_examples=60, deadline=None)
def test_the_outer_end_gives_the_tool_back(x, y, depth, turn):
    a = np.array([np.sin(x), np.sin(y), -1.0])
    a /= np.linalg.norm(a)
    T = spatial.pose(spatial.exp_so3(np.array(turn)), _pivot.p_port + depth * a)
    outer = _pivot.outer(T)
    assert np.linalg.norm(outer[:3, 3] - T[:3, 3]) == pytest.approx(0.33)
    assert _pivot.tool(outer, True) == pytest.approx(T, abs=1e-12)
    assert _pivot.tool(T, False) == pytest.approx(T, abs=1e-12)
    back = InstrumentPivot(_pivot.p_port, _pivot.axis, 0.33, guided=True).tool(T, False)
    assert back[:3, 2] == pytest.approx(a, abs=1e-7)  # least exact near half a turn
    assert spatial.is_pose(back, 1e-6)


@given(st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3), st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_led_end_stays_on_its_side_of_the_port(p, direct):
    T = _pivot.tool(spatial.pose(np.eye(3), _pivot.p_port + p), direct)
    way = T[:3, 3] - _pivot.p_port
    depth = np.linalg.norm(way)
    assert SHORTEST_PART - 1e-12 <= depth <= 0.33 - SHORTEST_PART + 1e-12
    assert way @ _pivot.axis / depth >= np.cos(LARGEST_ANGLE) - 1e-9


# -- the served console ---------------------------------------------------------------------------------------------


class Client:
    """A client of an `ConsoleStream` that moves the hands."""

    def __init__(self, op):
        self.op, self.number, self.tick, self.frame = op, 0, 0, None
        self.p, self.roll = {"right": np.zeros(3), "left": np.zeros(3)}, 0.0

    def step(self, ticks=1):
        for _ in range(ticks):
            q = spatial.rotation_z(self.roll)
            hand = {s: {"pose": wire.sevens(spatial.pose(q, p)).tolist(), "grip": 0.0} for s, p in self.p.items()}
            message = {"type": "hands", "number": self.number, **hand, "clutch": False, "camera": False}
            self.op.ask("c1", HandsMessage.model_validate(message, strict=False))
            self.number += 1
            self.frame = self.op.frame(self.tick, self.tick / TICK_RATE) or self.frame
            self.tick += 1

    def begin(self):
        self.step(2)
        self.roll = 0.1
        self.step(2)


def test_tools_and_fulcrum_are_chosen_by_the_client_that_leads(scene, robots):
    op = ConsoleStream(LoadedScene(scene, robots))
    client = Client(op)
    client.begin()
    name = list(scene.tools)[-1]
    op.ask("c1", ToolMessage(type="tool", hand="right", name=name))
    op.ask("c1", FulcrumMessage(type="fulcrum", mode="direct"))
    client.step(2)
    assert op.reading["hands"]["right"]["tool"] == name
    assert op.reading["hands"]["left"]["tool"] != name
    assert op.reading["fulcrum"] == "direct"
    arm = scene.console.right[0]
    assert op.world.signals[f"{arm}.tool"][0] == len(scene.tools) - 1
    with pytest.raises(RefusedError, match="no tool 'spoon'"):
        op.ask("c1", ToolMessage(type="tool", hand="right", name="spoon"))
    with pytest.raises(RefusedError, match="c1 controls the hands"):
        op.ask("c2", FulcrumMessage(type="fulcrum", mode="compensated"))
    op.close()


def test_a_scene_without_ports_and_tools_refuses_them(bare_theatre):
    op = ConsoleStream(bare_theatre)
    with pytest.raises(RefusedError, match="instrument_mm"):
        op.ask("c1", FulcrumMessage(type="fulcrum", mode="direct"))
    with pytest.raises(RefusedError, match="tool"):
        op.ask("c1", ToolMessage(type="tool", hand="right", name="scalpel"))
    assert op.reading["fulcrum"] is None
    op.close()


@pytest.mark.nightly
def test_organs_dent_under_an_instrument_that_a_hand_leads(scene, robots, monkeypatch):
    # on a busy machine the World would fall behind the hand, and take its motion for a jump
    monkeypatch.setattr("twin.ui.session.live_console._STEPPING_TIME", np.inf)
    op = ConsoleStream(scenes.with_organs(LoadedScene(scene, robots)))
    feed = op.feed
    client = Client(op)
    client.begin()
    client.step(5)
    rest = {n: unpack_scene(client.frame).fields[k].copy() for k, n in enumerate(feed.surfaces)}
    view = op.view
    down = view[:3, :3].T @ np.array([0, 0, -1.0])
    for _ in range(60):
        client.p["left"] = client.p["left"] + 0.002 * down
        client.step()
    client.step(20)
    now = {n: unpack_scene(client.frame).fields[k] for k, n in enumerate(feed.surfaces)}
    dents = {n: float(np.abs(now[n] - rest[n]).max()) for n in rest}
    assert max(dents.values()) > 2 * MM, dents
    op.close()


@pytest.mark.nightly
def test_a_session_by_hand_replays_bit_for_bit(scene, robots, tmp_path):
    path = tmp_path / "hands.session"
    op = ConsoleStream(scenes.with_organs(LoadedScene(scene, robots)), Exercise(session=path))
    client, rng = Client(op), np.random.default_rng(5)
    client.begin()
    for k in range(130):
        client.p["right"] = client.p["right"] + rng.normal(0, 0.001, 3)
        client.p["left"] = client.p["left"] + rng.normal(0, 0.001, 3)
        if k == 40:
            op.ask("c1", FulcrumMessage(type="fulcrum", mode="direct"))
            op.ask("c1", ToolMessage(type="tool", hand="left", name=list(scene.tools)[-1]))
        client.step()
    op.close()
    found = replay_session(path, scene)
    assert found.run.difference is None
    assert found.run.duration > 1.0
    assert main(["session", str(path)]) == 0


# -- files and options ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('through = ["pa10"]', 'through = ["hibou"]', "'hibou' needs the length of its instrument"),
        ("pa10 = 330, lapbot", "pa1 = 330, pa10 = 330, lapbot", "pa1"),
        ("pa10 = 330", "pa10 = 3", "50"),
        ("pan_deg = [-40, 40]", "pan_deg = [40, -40]", "must be below"),
        ('kind = "scalpel"', 'kind = "spoon"', "kind"),
    ],
)
def test_a_wrong_entry_of_the_console_or_of_a_tool_is_named(scene, tmp_path, old, new, said):
    shutil.copytree(scene.file.parent, tmp_path / "here")
    shutil.copytree(scene.file.parents[1] / "organs", tmp_path / "organs")
    file = tmp_path / "here" / scene.file.name
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError, match=said):
        load_scene(file)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["sils", "--fulcrum", "direct"], "--fulcrum requires a scene with a console"),
        (["davinci", "--fulcrum", "direct"], "add the key instrument_mm to the section [console]"),
        (["vsrs", "--protocols", "--mqtt", "localhost"], "--mqtt and --protocols cannot be combined"),
    ],
)
def test_options_that_do_not_fit_are_refused(arguments, said, capsys):
    assert main(["serve", *arguments, "--port", "0", "--no-browser"]) == 2
    assert said in capsys.readouterr().err
