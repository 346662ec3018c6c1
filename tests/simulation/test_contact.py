"""Contact of movable objects: they rest, slip at the limit of friction, are carried by two jaws and by nothing else."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import twin
from twin.core import spatial
from twin.core.errors import TwinError, WorldError
from twin.model.body import Mesh
from twin.model.movable import Movable
from twin.simulation.plants.contact import Contact, Gripper, Solid
from twin.simulation.world import Block, Placed, World

MM, G = 1e-3, 9.81
DOWN = np.array([0.0, 0.0, -G])
RING = Movable("ring", "ring", (6.75 * MM, 0.7 * MM), 0.5e-3, 0.5)
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the axis of a ring along -y
EFFORT = 0.02


@pytest.fixture(scope="module")
def psm():
    robot = twin.load("davinci_psm")
    return robot.mechanism, robot.kinematics()


class Led(Block):
    """Joint values as a function of time."""

    def __init__(self, q):
        self.q, self.outputs = q, {"psm.q": q(0.0)}

    def step(self, signals, t, dt):
        return {"psm.q": self.q(t + dt)}


def box(name, low, high):
    """Return a box between two corners (3,) in mm."""
    half = np.subtract(high, low) / 2 * MM
    mesh = Movable(name, "box", tuple(half), 1.0, 0.0).mesh()
    return replace(mesh, vertices=mesh.vertices + np.add(low, high) / 2 * MM)


def peg(name, start, end, radius):
    """Return a cylinder with round ends between two points (3,) in mm."""
    ball = Movable(name, "ball", (radius * MM,), 1.0, 0.0).mesh()
    a, b = np.array(start) * MM, np.array(end) * MM
    R = spatial.frame_from_axes(b - a, [1, 0.1, 0])
    upper = ball.vertices[:, 2] >= 0
    vertices = np.where(upper[:, None], b, a) + ball.vertices @ R.T
    return Mesh(name, vertices, ball.triangles)


def alone(items, solids, seconds):
    """Return the World of objects on fixed parts after some time."""
    world = World(objects=items, plants=[Contact(items, solids)], records=False)
    world.step(round(seconds / world.dt))
    return world


def pose(world, name="ring"):
    return world.signals[f"{name}.pose"].reshape(4, 4)


FLOOR = Solid("floor", [box("floor", (-70, -55, -8), (70, 55, 0))], 0.5)
T_LEAN = np.radians(0.9)
WALL_PEG = peg("peg", (0, 40, 50), (0, 40 - 22 * np.cos(T_LEAN), 50 + 22 * np.sin(T_LEAN)), 2.8)


def test_a_flat_part_is_named():
    sheet = box("sheet", (-70, -55, 0), (70, 55, 0))
    with pytest.raises(TwinError, match=r"board: part 'sheet' is flat.* Draw it with a thickness"):
        Contact([RING], [Solid("board", [sheet], 0.5)])


@pytest.mark.slow
@pytest.mark.parametrize("sleeps", [True, False])
def test_a_ring_rests_on_a_peg_for_a_minute(sleeps):
    """Also if it is simulated all the time: that objects at rest are skipped hides no creep."""
    board = Solid("board", [box("wall", (-70, 38, 0), (70, 46, 95)), WALL_PEG], 0.5)
    hung = replace(RING, T_world_object=spatial.pose(UPRIGHT, np.array([0, 28, 47.5]) * MM))
    contact = Contact([hung], [FLOOR, board])
    if not sleeps:
        contact._model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    world = World(objects=[hung], plants=[contact], records=False)
    world.step(2000)
    start = pose(world)
    assert start[2, 3] == pytest.approx((50 + 12 * np.tan(T_LEAN) + 2.8 / np.cos(T_LEAN) - 6.05) * MM, abs=0.15 * MM)
    world.step(60_000)
    assert np.linalg.norm(pose(world)[:3, 3] - start[:3, 3]) < 0.1 * MM
    assert spatial.rotation_angle(start[:3, :3].T @ pose(world)[:3, :3]) < np.radians(0.1)


def test_what_falls_stops_where_it_lies():
    ball = Movable("ball", "ball", (3 * MM,), 2e-3, 0.5, spatial.pose(p=[0, 0.02, 0.03]))
    block = Movable("block", "box", (4 * MM, 5 * MM, 6 * MM), 5e-3, 0.5, spatial.pose(p=[0.03, 0, 0.03]))
    ring = replace(RING, T_world_object=spatial.pose(p=[-0.03, 0, 0.03]))
    world = alone([ball, block, ring], [FLOOR], 1.5)
    for name, high in (("ball", 3.0), ("block", 6.0), ("ring", 0.7)):
        assert pose(world, name)[2, 3] == pytest.approx(high * MM, abs=0.02 * MM)


def test_a_thin_ring_passes_through_nothing(psm):
    # dropped by 5 mm it has 310 mm/s before a plate of 1 mm; the insertion of the arm reaches 200 mm/s
    plate = Solid("plate", [box("plate", (-50, -50, -1), (50, 50, 0))], 0.5)
    for turn, low in (((0, 0, 0), 0.7), ((0.5, 0.2, 0), 4.1), ((np.pi / 2, 0, 0), 7.5)):
        item = replace(RING, T_world_object=spatial.pose(spatial.exp_so3(turn), [0, 0, (5 + low) * MM]))
        world = World(plants=[Contact([item], [plate])], records=False)
        for _ in range(200):
            world.step(2)
            assert pose(world)[2, 3] > 0.05 * MM  # its wire has a radius of 0.7 mm


def closing(psm, item, solids=(), *, gravity=DOWN, moves=lambda q, t: q, friction=0.5, records=False):
    """Return a World in which the jaws close around an object in 0.2 s, while q is `moves(q, time)`."""
    mechanism, kin = psm
    q0 = mechanism.posture("home")
    q0[6] = np.radians(30)

    def q(t):
        out = q0.copy()
        out[6] = max(0.0, q0[6] * (1 - t / 0.2))
        return moves(out, t)

    gripper = Gripper("psm", mechanism, kin, np.eye(4), EFFORT)
    contact = Contact([item], solids, [gripper], {"psm": q0}, gravity=tuple(gravity), friction=friction)
    robots = [Placed("psm", mechanism)]
    return World(robots=robots, objects=[item], plants=[Led(q), contact], records=records)


def between(psm, item, ahead_mm, R_tool_object=None):
    """Return an object at a distance in mm ahead of the jaws' axis."""
    mechanism, kin = psm
    T = kin.forward(mechanism.posture("home"))
    return replace(item, T_world_object=T @ spatial.pose(R_tool_object, [0, 0, ahead_mm * MM]))


@pytest.mark.parametrize("friction", [0.3, 0.6])
@pytest.mark.parametrize(("share", "slips"), [(0.97, False), (1.03, True)])
def test_a_grip_slips_at_the_limit_of_friction(psm, friction, share, slips):
    """Two jaws at an angle of 2 b press a ball with N = torque / lever each, and friction alone carries its weight.

    The wedge drives the ball out by 2 N sin b, so that of the friction, mu N a jaw, N tan b is used up along the jaws.
    """
    mechanism, kin = psm
    radius, ahead = 1.0 * MM, 8.5 * MM
    b = np.arcsin((radius + 0.03 * MM) / ahead)  # the inner face of a jaw is 0.03 mm beside its axis
    N = EFFORT / (ahead * np.cos(b))
    limit = 2 * N * np.sqrt(friction**2 - np.tan(b) ** 2)
    across = kin.forward(mechanism.posture("home"))[:3, 0]  # the axis of the jaws
    ball = between(psm, Movable("ball", "ball", (radius,), share * limit / G, friction), ahead / MM)
    q0 = mechanism.posture("home")
    q0[6] = 2 * b + 1e-3  # 4 um from the ball
    shut = q0.copy()
    shut[6] = 0.0
    gripper = Gripper("psm", mechanism, kin, np.eye(4), EFFORT)
    contact = Contact([ball], [], [gripper], {"psm": q0}, gravity=tuple(G * across), friction=0.0)
    world = World(plants=[Led(lambda t: shut), contact], records=False)
    world.step(50)
    start = pose(world, "ball")[:3, 3] @ across
    world.step(150)
    gone = pose(world, "ball")[:3, 3] @ across - start
    free_fall = 0.5 * G * 0.15**2
    assert (gone > 0.01 * free_fall) == slips, f"{gone / MM:.3f} mm"


def lift(out, t):
    out[2] -= 0.04 * np.clip((t - 0.3) / 0.5, 0, 1)
    return out


def gripped_ring(psm, friction=0.5):
    """Return a ring whose wire lies between the jaws, across them."""
    R_tool_ring = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return between(psm, replace(RING, friction=friction), 8.5 + 6.75, R_tool_ring)


def under(ring, friction):
    """Return a plate under an upright ring."""
    high = ring.T_world_object[2, 3] / MM - 8
    return Solid("plate", [box("plate", (-30, -30, high - 5), (30, 30, high))], friction)


def test_two_jaws_carry_a_ring_and_let_it_go(psm):
    def moves(out, t):
        out = lift(out, t)
        if t > 1.0:
            out[6] = np.radians(30)
        return out

    ring = gripped_ring(psm)
    world = closing(psm, ring, [under(ring, 0.5)], moves=moves)
    world.step(300)
    assert world.signals["ring.holder"] == 0
    low = pose(world)
    world.step(700)
    assert world.signals["ring.holder"] == 0
    up = pose(world)[:3, 3] - low[:3, 3]
    assert up[2] == pytest.approx(40 * MM, abs=0.2 * MM)
    assert np.linalg.norm(up[:2]) < 0.2 * MM
    np.testing.assert_allclose(world.frame().link_poses["ring"]["ring"], pose(world))
    world.step(500)
    assert world.signals["ring.holder"] == -1
    assert pose(world)[2, 3] < low[2, 3] + 2 * MM


def test_nothing_is_carried_without_friction(psm):
    """A ring that was glued to the tool, or caught by its overlap with the jaws, would come along."""
    ring = gripped_ring(psm, 0.0)
    world = closing(psm, ring, [under(ring, 0.0)], moves=lift, friction=0.0)
    world.step(1000)
    assert pose(world)[2, 3] < ring.T_world_object[2, 3] + 1 * MM


def test_a_swept_ring_stays_before_the_instrument(psm):
    """At 200 mm/s a shut instrument pushes a ball over the floor and does not pass through it."""
    mechanism, kin = psm
    q0 = mechanism.posture("home")
    T = kin.forward(q0)
    reach = float(np.linalg.norm(T[:3, 3]))

    def q(t):
        out = q0.copy()
        out[0] += min(t, 0.15) * 0.2 / reach
        return out

    tip = T @ mechanism.frame_in_tool("instrument_tip")
    side = np.sign((kin.forward(q(0.01)) - T)[:3, 3] @ np.eye(3)[0]) * np.eye(3)[0]
    floor = tip[2, 3] / MM - 2
    rest = Solid("floor", [box("floor", (-100, -100, floor - 5), (100, 100, floor))], 0.5)
    ball = Movable("ball", "ball", (2 * MM,), 1e-3, 0.2, spatial.pose(p=tip[:3, 3] + side * 8 * MM))
    gripper = Gripper("psm", mechanism, kin, np.eye(4), EFFORT)
    world = World(plants=[Led(q), Contact([ball], [rest], [gripper], {"psm": q0})], records=False)
    for _ in range(15):
        world.step(10)
        at = (kin.forward(q(world.t)) @ mechanism.frame_in_tool("instrument_tip"))[:3, 3]
        assert (pose(world, "ball")[:3, 3] - at) @ side > 0
    assert (at - tip[:3, 3]) @ side > 25 * MM


def test_instruments_report_what_they_touch_and_stay_exact(psm):
    mechanism, kin = psm
    q0 = mechanism.posture("home")
    T = kin.forward(q0)
    floor = T[2, 3] / MM - 15
    rest = Solid("floor", [box("floor", (-100, -100, floor - 20), (100, 100, floor))], 0.5)

    def q(t):
        out = q0.copy()
        out[2] += 0.02 * np.clip(t / 0.19, 0, 1)
        return out

    gripper = Gripper("psm", mechanism, kin, np.eye(4), EFFORT)
    other = Gripper("psm", mechanism, kin, spatial.pose(p=[0.03, 0, 0]), EFFORT)
    other.robot = "other"
    contact = Contact([], [rest], [gripper, other], {"psm": q0, "other": q0})

    class Both(Led):
        def __init__(self):
            super().__init__(q)
            self.outputs = {"psm.q": q0, "other.q": q0}

        def step(self, signals, t, dt):
            aside = q0.copy()
            aside[0] -= np.clip(t - 0.2, 0, 1)
            return {"psm.q": q(t + dt), "other.q": aside}

    world = World(plants=[Both(), contact], records=False)
    world.step(40)
    assert world.signals["psm.touches"] == 0
    world.step(160)
    assert world.signals["psm.touches"] == 1
    assert world.signals["other.touches"] == world.signals["psm.meets"] == 0
    hand = contact._data.joint("psm/hand").qpos[:3]  # where MuJoCo has the link, which is deep in the floor
    np.testing.assert_allclose(hand, gripper.poses(world.signals["psm.q"])[0][:3, 3], atol=1e-15)
    met = []
    for _ in range(60):
        world.step(10)
        met.append(bool(world.signals["psm.meets"] and world.signals["other.meets"]))
    assert any(met)
    assert not met[0]


def test_the_links_stand_where_the_reference_model_has_them(psm):
    mechanism, kin = psm
    model = twin.load("davinci_psm").reference()
    gripper = Gripper("psm", mechanism, kin, np.eye(4), EFFORT)
    assert [b.name for b in gripper.links] == ["hand", "wrist", "shaft"]
    q = mechanism.posture("aside")
    poses = model.solve(q).link_poses
    for body, T in zip(gripper.links, gripper.poses(q), strict=True):
        np.testing.assert_allclose(T, poses[body.name], atol=1e-12)
    for jaw in gripper.jaws:
        p = jaw.point
        turn = spatial.pose(spatial.exp_so3(jaw.axis * jaw.ratio * q[6]))
        T = poses["hand"] @ spatial.pose(p=p) @ turn @ spatial.pose(p=-p) @ jaw.T_hand_jaw
        np.testing.assert_allclose(T, poses[jaw.body.name], atol=1e-9)


def test_the_same_motion_gives_the_same_bytes(psm):
    rows = []
    for _ in range(2):
        world = closing(psm, gripped_ring(psm), moves=lift, gravity=0.1 * DOWN, records=True)
        world.step(800)
        rows.append(world.recording().rows.tobytes())
    assert rows[0] == rows[1]


def test_bad_objects_are_named(psm):
    mechanism, kin = psm
    with pytest.raises(WorldError, match=r"object 'ring': friction is -0.1; it must be finite and at least 0"):
        Contact([replace(RING, friction=-0.1)])
    with pytest.raises(WorldError, match=r"object 'ring': mass is 0; it must be finite and at least 1e-06"):
        Contact([replace(RING, mass=0.0)])
    with pytest.raises(WorldError, match=r"object 'ring': its size is \(0.1, 0.0\); each length must be above 0"):
        Contact([replace(RING, size=(0.1, 0.0))])
    with pytest.raises(WorldError, match=r"'(ring|a fixed part)' and '(ring|a fixed part)' overlap by \d+\.\d+ mm"):
        Contact([replace(RING, T_world_object=spatial.pose(p=[0, 0, -0.001]))], [FLOOR])
    with pytest.raises(WorldError, match="torque of a jaw is 0 N m"):
        Gripper("psm", mechanism, kin, np.eye(4), 0.0)
    with pytest.raises(WorldError, match="object 'ring' has no plant"):
        World(objects=[RING])
