"""One tick of two hands on two instrument arms with the camera: our World beside other engines on the same robots."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from race import Contender, Effort, Table, installed, race
from scipy.spatial.transform import Rotation
from teleoperation import hands

import twin
from twin.api.scene_parts import members_of
from twin.core import spatial
from twin.simulation import console_scene
from twin.simulation import setup as inputs
from twin.simulation.console_scene import HANDS, PEDALS
from twin.simulation.devices.recorded import Recorded

DT, PYBULLET_DT = 1e-3, 1 / 240
SCENE, LONG, LEAD = "davinci", 100_000, 500
PINS = (-0.025, 0.025)
"""m along a pin, where a loop is tied by points."""
DH = (
    *((np.pi / 2, 0.0, 0.0, np.pi / 2), (-np.pi / 2, 0.0, 0.0, -np.pi / 2), (np.pi / 2, 0.0, -0.4318, 0.0)),
    *((0.0, 0.0, 0.4162, 0.0), (-np.pi / 2, 0.0, 0.0, -np.pi / 2), (-np.pi / 2, 0.0091, 0.0, -np.pi / 2)),
)
"""Rows (alpha, a, d, theta) of the PSM, modified DH: jhu-dvrk/sawIntuitiveResearchKit, tool 400006."""

BESIDE = Path(__file__).with_name("davinci_peers.md").read_text(encoding="utf-8").rstrip()
"""What both can do; of SurRoL by its files at one commit."""


@dataclass
class Setup:
    """The scene, its robots, and a session of `ticks`: joint values and goals of each arm, at each tick."""

    scene: object
    robots: dict
    places: dict
    ticks: int
    q: dict[str, np.ndarray]
    goals: dict[str, np.ndarray]

    def world(self, ticks: int = LONG, records: bool = False):
        """Return a World at the start of the session; after so many ticks the hands end it."""
        device = Recorded(hands(ticks), *HANDS, PEDALS)
        return console_scene.world(inputs.Setup(self.scene, members_of(self.robots)), device, records=records)

    def port(self, name: str) -> np.ndarray:
        """Return the port of an arm in the world, (3,)."""
        return next(iter(self.places[name].p_world_ports.values()))

    def shaft(self, name: str):
        """Return the joint about which the shaft turns, behind the insertion: its axis is the shaft."""
        tree = self.robots[name].mechanism.tree
        slide = next(j for j in tree if j.active and j.type == "prismatic")
        return next(j for j in tree if j.parent == slide.child)


def setup(ticks: int) -> Setup:
    """Run the session once."""
    scene = twin.load_scene(SCENE)
    kinds = {name: twin.load(name).weighed() for name in {p.robot for p in scene.places}}
    robots = {p.name: kinds[p.robot] for p in scene.places}
    out = Setup(scene, robots, {p.name: p for p in scene.places}, ticks, {}, {})
    world = out.world(ticks, records=True)
    world.step(ticks)
    rows = world.recording()
    out.q = {n: rows[f"{n}.q"] for n in robots}
    led = [n for n in robots if f"{n}.goal" in rows.sizes]
    out.goals = {n: rows[f"{n}.goal"].reshape(-1, 4, 4) for n in led}
    return out


def there_and_back(ticks: int) -> Iterator[int]:
    """Yield the ticks of a session, then backwards, and so on: no arm ever jumps."""
    while True:
        yield from range(ticks)
        yield from reversed(range(ticks))


def off_port(s: Setup, name: str, T_world_body: np.ndarray) -> float:
    """Return how far a shaft passes its port, m; the pose is that of the body before it."""
    T = T_world_body @ s.shaft(name).T_parent_joint
    to = s.port(name) - T[:3, 3]
    return float(np.linalg.norm(to - T[:3, 2] * (T[:3, 2] @ to)))


def topic(effort: Effort) -> list[Table]:
    """Run the race and the runs that give its errors."""
    table = Table("console", "Two hands on two PSMs and the ECM: one tick of 1 ms")
    table.judge = "largest distance of a shaft from its port in m along the session, by the link poses of each program"
    table.limit = 1e-9
    s = setup(effort.of(1500, 300))
    with tempfile.TemporaryDirectory() as folder:
        rows = [*ours(s, table), mujoco_row(s, Path(folder))]
        if installed(table, "pybullet", "PyBullet"):
            rows += pybullet_rows(s, Path(folder), table)
        race(table, rows, effort)
    table.notes.append(BESIDE)
    return [table]


def ours(s: Setup, table: Table) -> list[Contender]:
    """Return the World alone, and with the poses of all links at every tick."""
    world, shown = s.world(), s.world()
    tick = Contender("twin: World.step(), equations, console, limits", world.step)

    def frame() -> None:
        shown.step()
        shown.frame()

    model = {n: r.reference() for n, r in s.robots.items()}
    worst = 0.0
    for n in s.robots:
        links = model[n].link_poses(model[n].run(s.q[n][::10]).x)[s.shaft(n).parent]
        worst = max(worst, *(off_port(s, n, s.places[n].T_world_base @ T) for T in links))
    tick.error = worst
    again = [s.world(300, records=True) for _ in range(2)]
    for w in again:
        w.step(300)
    one, two = (w.recording() for w in again)
    same = all(one[k].tobytes() == two[k].tobytes() for k in one.sizes)
    table.notes.append(f"twin, the session twice: {'the same bytes' if same else 'OTHER BYTES'}.")
    links = sum(len(r.mechanism.bodies) for r in s.robots.values())
    return [tick, Contender(f"twin: the same, and the poses of all {links} links", frame)]


# -- MuJoCo -----------------------------------------------------------------------------------------------


def mujoco_row(s: Setup, folder: Path) -> Contender:
    """Return MuJoCo, which holds the loops of our MJCF by constraints while drives follow the joints of the session."""
    import mujoco

    from twin.exchange.formats.mjcf.write import write_mjcf

    models, controls = {}, {}
    for n, r in s.robots.items():
        m = r.mechanism
        models[n] = mujoco.MjModel.from_xml_path(str(write_mjcf(m, folder / n)))
        home = np.array([models[n].joint(j.name).qpos0[0] for j in m.active])
        first = s.q[n][0] - home
        part = np.linspace(0, 1, LEAD)[:, None]
        lead = part**2 * (3 - 2 * part) * first  # from home to the start of the session
        columns = [m.motor_names.index(models[n].actuator(i).name) for i in range(models[n].nu)]
        controls[n] = m.motors(np.concatenate([lead, s.q[n] - home]))[:, columns]
    datas = {n: mujoco.MjData(model) for n, model in models.items()}
    order = chain(range(LEAD), (LEAD + k for k in there_and_back(s.ticks)))

    def tick() -> None:
        k = next(order)
        for n, model in models.items():
            datas[n].ctrl[:] = controls[n][k]
            mujoco.mj_step(model, datas[n])

    worst = 0.0
    for k in range(LEAD + s.ticks):
        tick()
        for n, data in datas.items() if k >= LEAD and k % 10 == 0 else ():
            body = data.body(s.shaft(n).parent)
            T = spatial.pose(body.xmat.reshape(3, 3), body.xpos)
            worst = max(worst, off_port(s, n, s.places[n].T_world_base @ T))
    return Contender("MuJoCo, our MJCF: dynamics, loops by constraints", tick, error=worst)


# -- PyBullet ---------------------------------------------------------------------------------------------


class Bullet:
    """A client of PyBullet with arms at their places."""

    def __init__(self, s: Setup, urdfs: dict[str, Path]) -> None:
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        self.p, self.s = BulletClient(pybullet.DIRECT), s
        self.p.setGravity(0, 0, -9.81)
        self.p.setTimeStep(DT)
        self.body, self.joint, self.link = {}, {}, {}
        for n, urdf in urdfs.items():
            T = s.places[n].T_world_base
            x, y, z, w = np.roll(spatial.quat_from_matrix_wxyz(T[:3, :3]), -1)
            self.body[n] = self.p.loadURDF(str(urdf), T[:3, 3].tolist(), [x, y, z, w], useFixedBase=True)
            infos = [self.p.getJointInfo(self.body[n], i) for i in range(self.p.getNumJoints(self.body[n]))]
            self.joint[n] = {i[1].decode(): i[0] for i in infos if i[2] != self.p.JOINT_FIXED}
            self.link[n] = {i[12].decode(): i[0] for i in infos}

    def put(self, n: str, values: dict[str, float]) -> None:
        """Put joints at values."""
        for name, value in values.items():
            self.p.resetJointState(self.body[n], self.joint[n][name], value)

    def drive(self, n: str, names: list[str], values: list[float]) -> None:
        """Let PyBullet's motors go for values."""
        ids = [self.joint[n][name] for name in names]
        self.p.setJointMotorControlArray(self.body[n], ids, self.p.POSITION_CONTROL, targetPositions=values)

    def pose(self, n: str, link: str) -> np.ndarray:
        """Return the pose of a link in the world."""
        state = self.p.getLinkState(self.body[n], self.link[n][link], computeForwardKinematics=1)
        return spatial.pose(spatial.matrix_from_quat_wxyz(np.roll(state[5], 1)), np.array(state[4]))


def pybullet_rows(s: Setup, folder: Path, table: Table) -> list[Contender]:
    """Return PyBullet on our URDF, every joint driven or loops tied by points, and on virtual arms with its inverse."""
    from twin.exchange.formats.urdf.write import write_urdf

    urdfs = {n: write_urdf(r.mechanism, folder / f"{n}_urdf") for n, r in s.robots.items()}
    full = {}
    for n, r in s.robots.items():
        run = r.reference().run(s.q[n])
        full[n] = {j.name: s.q[n][:, i] for i, j in enumerate(r.mechanism.active)} | dict(run.q_passive)
    rows = [
        driven("PyBullet, our URDF: every joint driven, as SurRoL does", s, urdfs, full, tied=False),
        driven("PyBullet, our URDF: loops tied by points", s, urdfs, full, tied=True),
        virtual(s, folder),
    ]
    again = [driven("", s, urdfs, full, tied=False).end for _ in range(2)]
    same = np.array_equal(again[0], again[1])
    table.notes.append(f"PyBullet, the session twice in new clients: {'the same bytes' if same else 'other bytes'}.")
    table.notes.append(
        f"PyBullet takes ticks of 1 ms here as well; SurRoL's are 1/240 s: {PYBULLET_DT / DT:.1f} times fewer."
    )
    return rows


class Driven(Contender):
    """A contender with the positions of all links at the end of its measured session."""

    end: np.ndarray


def driven(name: str, s: Setup, urdfs: dict, full: dict, tied: bool) -> Driven:
    """Return PyBullet with motors at all joints, or, `tied`, at the active ones and loops held by points."""
    bullet, names = Bullet(s, urdfs), {}
    for n, values in full.items():
        m = s.robots[n].mechanism
        active = {j.name for j in m.active}
        names[n] = [j for j in bullet.joint[n] if j in values and (not tied or j in active)]
        bullet.put(n, {j: float(v[0]) for j, v in values.items() if j in bullet.joint[n]})
        for j in bullet.joint[n]:
            if tied and j not in active:  # PyBullet brakes every joint unless told otherwise
                bullet.p.setJointMotorControl2(bullet.body[n], bullet.joint[n][j], bullet.p.VELOCITY_CONTROL, force=0)
        for joint in m.loops if tied else ():
            tie(bullet, n, joint)
    targets = {n: np.array([full[n][j] for j in names[n]]).T.tolist() for n in names}
    order = there_and_back(s.ticks)

    def tick() -> None:
        k = next(order)
        for n, rows in targets.items():
            bullet.drive(n, names[n], rows[k])
        bullet.p.stepSimulation()

    worst = 0.0
    for k in range(s.ticks):
        tick()
        for n in s.robots if k % 10 == 0 else ():
            worst = max(worst, off_port(s, n, bullet.pose(n, s.shaft(n).parent)))
    out = Driven(name, tick, error=worst)
    out.end = np.array([bullet.pose(n, link)[:3, 3] for n in s.robots for link in sorted(bullet.link[n])])
    return out


def tie(bullet: Bullet, n: str, joint) -> None:
    """Close the loop of a pin by two points on it, as PyBullet's users do; a point counts from the centre of mass."""
    for along in PINS:
        ends = []
        for body, T in ((joint.parent, joint.T_parent_joint), (joint.child, joint.T_child_joint)):
            inertial = bullet.p.getDynamicsInfo(bullet.body[n], bullet.link[n][body])
            R = spatial.matrix_from_quat_wxyz(np.roll(inertial[4], 1))
            ends.append((R.T @ (T[:3, 3] + along * T[:3, 2] - np.array(inertial[3]))).tolist())
        body, ids = bullet.body[n], bullet.link[n]
        point = bullet.p.JOINT_POINT2POINT
        bullet.p.createConstraint(body, ids[joint.parent], body, ids[joint.child], point, [0, 0, 0], *ends)


def virtual(s: Setup, folder: Path) -> Contender:
    """Return PyBullet on two virtual six-joint arms about their remote centres, led by its own inverse kinematics.

    Parameters of the inverse are those of SurRoL's `Arm.inverse_kinematics`.
    """
    urdf = folder / "virtual.urdf"
    urdf.write_text(ET.tostring(six_joints(), encoding="unicode"))
    led = [n for n in s.goals if s.robots[n].mechanism.auxiliary]
    bullet = Bullet(s, dict.fromkeys(led, urdf))
    names, targets = [f"j{i}" for i in range(6)], {}
    worst = 0.0
    for n in led:
        bullet.put(n, dict(zip(names, s.q[n][0, :6].tolist(), strict=True)))
        T_base = s.places[n].T_world_base
        T_tip_tool = spatial.inverse(bullet.pose(n, "l5")) @ T_base @ s.robots[n].kinematics().forward(s.q[n][0])
        Ts = [T_base @ T @ spatial.inverse(T_tip_tool) for T in s.goals[n]]
        targets[n] = [(T[:3, 3].tolist(), np.roll(spatial.quat_from_matrix_wxyz(T[:3, :3]), -1).tolist()) for T in Ts]
    limits = np.array([j.limits for j in s.robots[led[0]].mechanism.active[:6]])
    low, high = limits[:, 0].tolist(), limits[:, 1].tolist()
    order = there_and_back(s.ticks)

    def tick() -> None:
        k = next(order)
        for n in led:
            q = bullet.p.calculateInverseKinematics(
                bullet.body[n],
                bullet.link[n]["l5"],
                *targets[n][k],
                lowerLimits=low,
                upperLimits=high,
                jointRanges=(limits[:, 1] - limits[:, 0]).tolist(),
                restPoses=[0.0] * 6,
                residualThreshold=1e-9,
                maxNumIterations=200,
            )
            bullet.drive(n, names, list(q))
        bullet.p.stepSimulation()

    for k in range(s.ticks):
        tick()
        for n in led:
            worst = max(worst, float(np.linalg.norm(bullet.pose(n, "l5")[:3, 3] - targets[n][k][0])))
    out = Contender("PyBullet, virtual arms of 6 joints: its inverse, motors", tick)
    out.good = f"{worst * 1e3:.2g} mm behind"
    return out


def six_joints() -> ET.Element:
    """Return a URDF of the PSM as a chain of six joints about its remote centre; masses are made up."""
    robot = ET.Element("robot", name="virtual")
    ET.SubElement(robot, "link", name="base")
    for i, (alpha, a, d, theta) in enumerate(DH):
        link = ET.SubElement(robot, "link", name=f"l{i}")
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "mass", value="0.1")
        ET.SubElement(inertial, "inertia", ixx="1e-4", iyy="1e-4", izz="1e-4", ixy="0", ixz="0", iyz="0")
        joint = ET.SubElement(robot, "joint", name=f"j{i}", type="prismatic" if i == 2 else "revolute")
        ET.SubElement(joint, "parent", link=f"l{i - 1}" if i else "base")
        ET.SubElement(joint, "child", link=f"l{i}")
        # Rx(alpha) Tx(a) Tz(d) Rz(theta); rpy are turns about fixed axes.
        R_alpha = Rotation.from_euler("x", alpha)
        xyz, rpy = R_alpha.apply([a, 0, d]), (R_alpha * Rotation.from_euler("z", theta)).as_euler("xyz")
        ET.SubElement(joint, "origin", xyz=" ".join(map(repr, xyz.tolist())), rpy=" ".join(map(repr, rpy.tolist())))
        ET.SubElement(joint, "axis", xyz="0 0 1")
        ET.SubElement(joint, "limit", lower="-10", upper="10", effort="100", velocity="100")
    return robot
