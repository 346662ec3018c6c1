"""Forces of real contacts in a World: depths against drawn geometry, levers, grasps, held objects, switch."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import twin
from made.consoles import Hands
from twin.api.console_runs import replay_session
from twin.api.scene_parts import members_of
from twin.cli import main
from twin.core import spatial
from twin.core.errors import DescriptionError, WorldError
from twin.core.units import DEG, MM
from twin.model.movable import Movable
from twin.model.scene import load_scene
from twin.simulation import console_scene
from twin.simulation.condition import Condition, randomised
from twin.simulation.devices.received_hands import HandState
from twin.simulation.local_plane import PLANE_COUNT, LocalPlane
from twin.simulation.plants.contact import Contact, Gripper, Solid
from twin.simulation.plants.contact.levers import ToolLevers
from twin.simulation.session import session_run
from twin.simulation.session.forces import ForceMeter
from twin.simulation.setup import Setup
from twin.simulation.world import Block, World
from twin.ui.headset.client_messages import HapticsMessage
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session.exercise import Exercise
from twin.ui.session.timeline import TICK_RATE

FLOOR = 895 * MM  # of the board, as drawn


@pytest.fixture(scope="module")
def scene(theatre):
    return theatre.scene


@pytest.fixture(scope="module")
def setup(theatre):
    return Setup(theatre.scene, members_of(theatre.robots), None, theatre.props, Condition(haptics=True))


def moved(setup, ticks, right, left=None):
    """Return a World whose instruments have moved along `right` and `left`, functions of time in m in the World."""
    still = np.zeros(3)

    def script(t):
        ways = (2 * R.T @ right(t), still if left is None else 2 * R.T @ left(t))  # the motion scale is 0.5
        return *ways, 0, 0, 0, 0.5

    start = console_scene.world(replace(setup, condition=None), Hands(lambda t: (still, still, 0, 0, 0, 0.5)))
    R = start.signals["ecm.view"].reshape(4, 4)[:3, :3]
    world = console_scene.world(setup, Hands(script))
    world.step(ticks)
    return world, {n: world.recording()[f"{n}.force"] @ R.T for n in ("right", "left")}


def lowest(world, setup, robot="psm1"):
    """Return the height in m of the lowest drawn point of hand and jaws."""
    poses = world.frame().link_poses[robot]
    return min(
        float((part.vertices @ poses[b.name][:3, :3].T + poses[b.name][:3, 3])[:, 2].min())
        for b in setup.members[robot].mechanism.bodies
        if b.name in ("hand", "jaw_left", "jaw_right")
        for part in b.meshes
    )


def ramp(t, way, begin=0.2, speed=0.05):
    """Return a displacement (3,) in m that grows at a speed in m/s up to `way` (3,)."""
    length = np.linalg.norm(way)
    return np.asarray(way) / length * np.clip((t - begin) * speed, 0, length)


@pytest.mark.slow
def test_the_floor_pushes_by_the_depth_that_is_drawn(setup):
    world, force = moved(setup, 900, lambda t: ramp(t, [0, 0, -24 * MM]))
    depth = FLOOR - lowest(world, setup)
    assert 2 * MM < depth < 5 * MM
    np.testing.assert_allclose(force["right"][-1], [0, 0, 600 * depth], atol=0.01)
    felt = np.flatnonzero(force["right"].any(axis=1))
    before, _ = moved(setup, int(felt[0]) - 3, lambda t: ramp(t, [0, 0, -24 * MM]))
    assert 0 <= lowest(before, setup) - FLOOR < 0.3 * MM, "at 50 mm/s, found at most 3 ms late"
    assert not force["left"].any()
    assert world.recording()["right.energy"].min() >= 0


@pytest.mark.slow
def test_an_instrument_under_the_floor_is_pushed_back_up(setup):
    """The floor is 8 mm thick: its lower side is nearer, but the instrument came from above."""
    world, force = moved(setup, 800, lambda t: ramp(t, [0, 0, -31 * MM], speed=0.07))
    assert FLOOR - lowest(world, setup) > 6 * MM
    np.testing.assert_allclose(force["right"][-1], [0, 0, 3.3], atol=0.05)


@pytest.mark.slow
def test_instruments_push_each_other_apart(setup):
    """Both hands feel the same force, each to its own side, and it is steady while they rest."""

    def right(t):
        return ramp(t, [-13 * MM, 0, 0])

    world, force = moved(setup, 560, right, lambda t: ramp(t, [10 * MM, 0, 0]))
    assert world.signals["psm1.meets"] == 1
    assert 0.3 < np.linalg.norm(force["right"][-1]) < 3.3 + 1e-9
    np.testing.assert_allclose(force["right"][-1], -force["left"][-1], atol=0.05)
    assert force["right"][-1][0] > 0, "to its own side"
    assert np.ptp(force["right"][-20:], axis=0).max() < 0.02


@pytest.mark.slow
def test_without_haptics_the_world_has_no_forces_and_off_is_zero(setup):
    def way(t):
        return ramp(t, [0, 0, -24 * MM])

    off, force = moved(replace(setup, condition=Condition(haptics=False)), 650, way)
    assert not force["right"].any()
    on, force = moved(setup, 650, way)
    assert force["right"].any()
    assert on.signals["psm1.q"].tobytes() == off.signals["psm1.q"].tobytes(), "the hands of the device are the same"


# -- contacts as planes -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def psm():
    robot = twin.load("davinci_psm")
    return robot.mechanism, robot.kinematics()


def test_a_point_of_the_shaft_moves_as_the_lever_says(psm):
    """Against the inverse kinematics: the tool moves by 10 um at constant attitude."""
    mechanism, kin = psm
    gripper = Gripper("psm", mechanism, kin, spatial.pose(spatial.rotation_z(1.0), (0.1, 0, 0)), 0.02)
    q, R_base = mechanism.posture("aside"), spatial.rotation_z(1.0)
    T, start = kin.forward(q), gripper.poses(q)
    levers = ToolLevers(gripper)
    twists = levers.twists(q, 0)
    assert len(twists) == len(gripper.links) == 3
    for way in np.eye(3) * 1e-5:
        moved = kin.inverse(spatial.pose(T[:3, :3], T[:3, 3] + R_base.T @ way), seed=q)
        moved[gripper.jaw] = q[gripper.jaw]
        for twist, a, b in zip(twists, start, gripper.poses(moved), strict=True):
            turn = spatial.log_so3(b[:3, :3] @ a[:3, :3].T)
            np.testing.assert_allclose(twist @ way, [*(b[:3, 3] - a[:3, 3]), *turn], atol=2e-8)
    np.testing.assert_allclose(twists[0][3:], 0, atol=1e-6)  # the hand keeps its attitude
    other = q + 0.1
    new = ToolLevers(gripper).twists(other, 0)
    late = [levers.twists(other, k) for k in range(1, 25)]  # one of six joints in every fourth step
    assert np.abs(late[0][2] - new[2]).max() > 0.01
    np.testing.assert_allclose(late[-1], new, atol=1e-12)
    for k in range(25, 75, 2):  # called in odd steps only
        seldom = levers.twists(q, k)
    np.testing.assert_allclose(seldom, twists, atol=1e-12)


class Led(Block):
    """Joint values as a function of time."""

    def __init__(self, q):
        self.q, self.outputs = q, {"psm.q": q(0.0)}

    def step(self, signals, t, dt):
        return {"psm.q": self.q(t + dt)}


def planes(world):
    """Return the planes of the instrument, those in use."""
    rows = world.signals["psm.planes"].reshape(PLANE_COUNT, -1)
    return [LocalPlane(r[3:6], r[:3], r[6:9], float(r[9])) for r in rows if r.any()]


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, -1])
def test_a_thin_wall_pushes_back_to_the_side_of_entry_until_the_instrument_is_through(psm, side):
    """A wall of 3 mm in two panels, thinner than the instrument; through it, back through it, each from its side."""
    mechanism, kin = psm
    q0, panel = mechanism.posture("home"), Movable("panel", "box", (1.5 * MM, 10 * MM, 12 * MM), 1.0, 0.0).mesh()
    middle, lever = kin.forward(q0)[:3, 3], -kin.forward(q0)[2, 3]  # the first joint moves the tool along x
    panels = [
        replace(panel, name=f"panel{k}", vertices=panel.vertices + middle + [0, 10 * k * MM, 3 * MM]) for k in (-1, 1)
    ]

    def q(t):
        out = q0.copy()
        out[0] += side * (-20 * MM + 50 * MM * min(t, 1.6 - t)) / lever
        return out

    gripper = Gripper("psm", mechanism, kin, np.eye(4), 0.02)
    solids = [Solid("wall", panels, 0.5)]
    contact = Contact([], solids, [gripper], {"psm": q(0)}, gravity=(0, 0, 0), feels=True)
    world, deepest = World(plants=[Led(q), contact], records=False), {1: 0.0, -1: 0.0}
    for entry in (-side, side):
        touched = []
        for _ in range(400):
            world.step(2)
            found = planes(world)
            touched.append(bool(found))
            for plane in found:
                assert plane.normal[0] * entry > 0.9, "out of the wall on the side of entry"
            depths = [plane.depth(kin.forward(q(world.t))) for plane in found]
            deepest[entry] = max([deepest[entry], *depths])
        assert not touched[0]
        assert not touched[-1], "behind the wall nothing is felt"
        assert sum(a != b for a, b in pairwise(touched)) == 2
    assert min(deepest.values()) > 10 * MM, "of the wall and the instrument"


def test_a_held_ring_is_felt_where_it_would_be(psm):
    """The ring stays outside of the plate and slips between the jaws; what is felt is how far the jaws have gone on."""
    mechanism, kin = psm
    q0 = mechanism.posture("home")
    q0[6] = 30 * DEG
    T = kin.forward(q0)
    turn = spatial.pose(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), [0, 0, 15.25 * MM])
    ring = Movable("ring", "ring", (6.75 * MM, 0.7 * MM), 0.5e-3, 0.5, T @ turn)
    top = float((T @ turn)[2, 3]) - 7.45 * MM - 2 * MM  # 2 mm under the ring
    mesh = Movable("plate", "box", (0.03, 0.03, 0.0025), 1.0, 0.0).mesh()
    plate = replace(mesh, vertices=mesh.vertices + np.array([*(T @ turn)[:2, 3], top - 0.0025]))

    def q(t):
        out = q0.copy()
        out[6] = max(0.0, q0[6] * (1 - t / 0.2))
        out[2] += 4 * MM * np.clip((t - 0.3) / 0.2, 0, 1)
        return out

    gripper = Gripper("psm", mechanism, kin, np.eye(4), 0.02)
    plate = Solid("plate", [plate], 0.5)
    contact = Contact([ring], [plate], [gripper], {"psm": q0}, gravity=(0, 0, 0), feels=True)
    world = World(objects=[ring], plants=[Led(q), contact], records=False)
    world.step(300)
    assert world.signals["ring.holder"] == 0
    assert not planes(world), "the jaws feel no plane of what they hold"
    world.step(300)
    assert world.signals["ring.holder"] == 0
    (found,) = planes(world)[:1]
    gone = (kin.forward(q(0.6)) - T)[2, 3]
    assert found.depth(kin.forward(q(0.6))) == pytest.approx(-gone - 2 * MM, abs=0.25 * MM)
    assert found.normal[2] > 0.99


@pytest.mark.slow
def test_a_grasp_gives_one_pulse_along_x(setup):
    setup = replace(setup, task=setup.scene.tasks["pegboard"])
    world = console_scene.world(setup, session_run.surgeon(setup))
    while not any(world.signals[f"ring{k}.holder"] >= 0 for k in (1, 2, 3, 4)) and world.t < 10:
        world.step(10)
    world.step(30)
    recording, rings = world.recording(), [f"ring{k}.holder" for k in (1, 2, 3, 4)]
    for k, hand in enumerate(("right", "left")):
        held = np.flatnonzero(np.any([recording[n][:, 0] == k for n in rings], axis=0))
        if not len(held):
            continue
        force = recording[f"{hand}.force"]
        np.testing.assert_allclose(force[held[0] : held[0] + 3, 0], 1.0, atol=0.05)
        assert not force[: held[0]].any(), "nothing was felt before"
        assert (force[held[0] + 3 :, 0] < 0.9).all()
        meter = ForceMeter(recording.sizes, recording.dt, (hand,))
        meter.add(recording.rows)
        assert meter.measures().largest[hand] == pytest.approx(1.0, abs=0.05)
        return
    raise AssertionError("no ring was grasped")


def test_a_pulse_between_two_samples_is_measured():
    """A pulse of 3 ms in one hand, in the middle of the 5 ms between two kept samples, and over the end of a chunk."""
    sizes = {"haptics.on": 1, "right.force": 3, "left.force": 3}
    rows = np.zeros((40, 7))
    rows[:30, 0] = 1.0
    rows[11:14, 1] = [0.2, 1.0, 0.4]
    rows[19:22, 4:7] = [0.3, 0.4, 1.2]
    meter = ForceMeter(sizes, 1e-3, ("right", "left"))
    for chunk in (rows[:20], rows[20:20], rows[20:]):
        meter.add(chunk)
    found = meter.measures()
    assert found.on == pytest.approx(0.75)
    assert found.largest == pytest.approx({"right": 1.0, "left": 1.3})
    assert found.felt == pytest.approx({"right": 3e-3, "left": 3e-3})
    without = ForceMeter({"left.force": 3}, 1e-3, ("left",))
    without.add(np.ones((4, 3)))
    assert without.measures() is None


# -- switch, session, settings ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_switch_works_while_it_runs_and_the_session_knows(theatre, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.ui.session.live_console._STEPPING_TIME", np.inf)
    condition = randomised(7, 1)
    path = tmp_path / "hands.session"
    stream, sent = ConsoleStream(theatre, Exercise(session=path, condition=condition)), []
    stream.send = sent.append
    down = stream.view[:3, :3].T @ [0, 0, -1]
    stream.frame(0, 0.0)
    for k in range(75):
        if k == 60:
            stream.ask("c1", HapticsMessage(type="haptics", on=not stream.reading["haptics"]))
        s = k / TICK_RATE
        for hand, x in ((0, 0.08), (1, -0.08)):
            way = 2 * ramp(s, 24 * MM * down)
            pose = spatial.pose(spatial.rotation_z(min(s / 0.1, 1) * 5 * DEG), [way[0] + x, *way[1:]])
            stream.device.give(HandState(hand, False, False, k + 1, pose, 0.0))
        stream.frame(k, 0.0)
    stream.close()
    forces = [d for d in sent if d["type"] == "forces"]
    assert condition.haptics == (not stream.reading["haptics"])
    assert forces
    found = replay_session(path)
    told = found.as_dict()
    assert told["replay"] == "same"
    assert told["condition"] == {"haptics": condition.haptics, "participant": 7, "run": 1}
    assert told["forces"]["on"] == pytest.approx(0.8 if condition.haptics else 0.2, abs=0.05)
    assert told["forces"]["largest_n"]["right"] > 0.3
    assert any("participant 7, run 1" in str(part) for part in map(_said, found.text()))


def _said(part):
    return part if isinstance(part, str) else part.rows


def test_bad_settings_are_named_with_their_line(tmp_path, setup):
    scene = setup.scene
    text = scene.file.read_text()
    for old, new, said in (
        (
            "stiffness_n_m = 600",
            "stiffness_n_m = -600",
            r"haptics.stiffness_n_m = -600: out of range; allowed: a number > 0",
        ),
        (
            "largest_n = 3.3",
            "largest_n = 0",
            r"haptics.largest_n = 0: out of range; allowed: a number > 0",
        ),
    ):
        (tmp_path / "scene.toml").write_text(text.replace(old, new))
        (tmp_path / scene.props.name).touch()
        with pytest.raises(DescriptionError, match=said):
            load_scene(tmp_path / "scene.toml")
    table = scene.haptics.model_copy(update={"damping_ns_m": 40.0})
    with pytest.raises(WorldError, match=r"Lower the damping to at most 18\.09 N s/m"):
        console_scene.world(replace(setup, scene=replace(scene, haptics=table)), Hands(lambda t: None))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["serve", "davinci", "--participant", "7"], "--participant and --run must be given together"),
        (["serve", "davinci", "--participant", "7", "--run", "1"], "--participant requires --session"),
        (["serve", "davinci", "--participant", "7", "--run", "1", "--haptics", "on"], "cannot be combined"),
        (["serve", "sils", "--haptics", "on"], "--haptics requires a scene with a console"),
        (["serve", "davinci", "--participant", "0", "--run", "1", "--session", "x.session"], "participant 0"),
        (["operate", "sher", "--haptics", "on"], "--haptics applies to the console of a scene"),
    ],
)
def test_wrong_options_are_named(command, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(command) == 2
    assert said in capsys.readouterr().err
