"""The C# kinematics of a robot, compiled and run by mono, against the reference model, which shares no code with it.

Joint values and link poses come from Pinocchio, also those of changed designs. It does not show what Unity does with
the classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import nightly
from twin.exchange.formats.unity.kinematics import DeviceModel, class_name, source
from twin.model.joint_distance import kinematic_distances, with_distance
from twin.reference import ReferenceModel
from twin.reference.joint_range import joint_range
from unity import mono

pytestmark = pytest.mark.witness

ROBOTS = twin.names()
CLOSE = 1e-9  # m, and of entries of rotations
RUNTIME = mono.PACKAGE / "Runtime"


@dataclass(frozen=True)
class Reply:
    """One answer of the program: whether the call succeeded, why not, and its numbers."""

    good: bool
    why: str
    numbers: np.ndarray


class Program:
    """The kinematics of robots, compiled with a program that calls them."""

    def __init__(self, folder: Path, robots: list[str]) -> None:
        self.folder = folder
        files = []
        for name in robots:
            robot = loaded(name)
            files.append(folder / f"{class_name(name)}.cs")
            files[-1].write_text(source(DeviceModel(robot.mechanism, robot.kinematics(), robot.gaps)))
        # each file alone needs nothing but System
        mono.compiled(files, folder / "Alone.dll", library=True)
        shared = [RUNTIME / "IRobotKinematics.cs", RUNTIME / "KinematicGrab.cs", mono.HERE / "device/Device.cs"]
        mono.compiled([*files, *shared], folder / "Device.exe", define="TWIN_PLAYER")

    def ask(self, robot: str, commands: list[str]) -> list[Reply]:
        script = self.folder / f"{robot}.txt"
        script.write_text("\n".join(commands) + "\n")
        done = mono.run(["mono", str(self.folder / "Device.exe"), class_name(robot), str(script)])
        assert done.returncode == 0, done.stderr
        replies = []
        for line in done.stdout.splitlines():
            said, why, numbers = (line + "||").split("|")[:3]
            replies.append(Reply(said == "good", why, np.array(numbers.split(), float)))
        return replies


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return Program(tmp_path_factory.mktemp("device"), ROBOTS)


def text(command: str, *numbers) -> str:
    flat = np.concatenate([np.ravel(np.asarray(x, float)) for x in numbers])
    return command + " " + " ".join(repr(float(x)) for x in flat)


def poses(reply: Reply, mechanism) -> dict[str, np.ndarray]:
    rows = reply.numbers[: 12 * len(mechanism.bodies)].reshape(-1, 3, 4)
    return {body.name: row for body, row in zip(mechanism.bodies, rows, strict=True)}


@cache
def loaded(name: str):
    return twin.load(name)


@cache
def states(robot, count: int = 48):
    """Return joints (k, n), {link: T_base_link (k, 4, 4)}, tool poses (k, 4, 4) of the reference model."""
    model = ReferenceModel(robot.mechanism)
    run = joint_range(model, count).run
    links = model.link_poses(run.x)
    frame = robot.mechanism.frame(robot.mechanism.tool)
    return run.q, links, links[frame.body] @ frame.T_body_frame


@pytest.mark.parametrize("name", ROBOTS)
def test_links_and_inverse_are_those_of_the_reference_model(program, name):
    robot = loaded(name)
    q, links, tools = states(robot)
    commands = []
    for joints, T in zip(q, tools, strict=True):
        commands += [text("move", joints), text("inverse", T)]
    replies = program.ask(name, commands)
    wanted = robot.kinematics().inverse_many(tools)
    reached = 0
    for i in range(len(q)):
        moved, inverse = replies[2 * i : 2 * i + 2]
        assert moved.good, moved.why
        for link, T in poses(moved, robot.mechanism).items():
            assert np.abs(T - links[link][i, :3]).max() < CLOSE, (link, i)
        assert np.abs(moved.numbers[-12:].reshape(3, 4) - tools[i, :3]).max() < CLOSE
        assert inverse.good == np.isfinite(wanted[i]).all(), inverse.why
        if inverse.good:
            reached += 1
            assert np.abs(inverse.numbers - wanted[i]).max() < CLOSE
    assert reached > len(q) / 2


@pytest.mark.parametrize("name", ["sils", "davinci_psm", "pa10"])
def test_a_changed_distance_is_the_changed_mechanism(program, name):
    robot = loaded(name)
    mechanism = robot.mechanism
    distances = kinematic_distances(mechanism)
    start, _, _ = states(robot)
    joints = mechanism.home if mechanism.home is not None else start[0]
    tested = 0
    for k, distance in enumerate(distances):
        changed = distance.distance * 1.01
        reply = program.ask(name, [text("move", joints), text("distance", [k, changed])])[1]
        other = with_distance(mechanism, distance.joint, distance.other, changed)
        try:
            assembly = ReferenceModel(other).solve(joints)
        except twin.TwinError:
            continue
        if max(map(max, assembly.gap.values()), default=0.0) > 1e-8:  # the distance opens a planar loop
            assert not reply.good
            continue
        assert reply.good, (distance, reply.why)
        tested += 1
        for link, T in poses(reply, mechanism).items():
            assert np.abs(T - assembly.link_poses[link][:3]).max() < CLOSE, (distance, link)
    assert tested >= 3


@pytest.mark.parametrize("name", ROBOTS)
def test_a_grabbed_tool_follows(program, name):
    """The state after a grab is judged by the reference model."""
    robot = loaded(name)
    q, _, _ = states(robot)
    home = robot.mechanism.home if robot.mechanism.home is not None else q[0]
    model = ReferenceModel(robot.mechanism)
    T = model.solve(home).T_base_tool.copy()
    far = np.argmax(np.linalg.norm(q - home, axis=1))
    goal = model.solve(home + 0.02 * (q[far] - home)).T_base_tool
    reply = program.ask(name, [text("move", home), text("tool", goal[:3], [60])])[1]
    joints = reply.numbers[1:]
    assert reply.numbers[0] < 1e-6, reply.why
    after = model.solve(joints).T_base_tool
    assert np.abs(after[:3, 3] - goal[:3, 3]).max() < 1e-6
    assert np.abs(after - T).max() > 1e-5, "it has moved"


def test_a_grabbed_link_and_a_joint_stop_at_limits(program):
    robot = loaded("sils")
    mechanism = robot.mechanism
    home = np.asarray(mechanism.home)
    links = [body.name for body in mechanism.bodies]
    bar = links.index("bar1")
    far = [5.0, 0.0, 0.0]
    commands = [text("move", home), text("grab", [bar], [0, 0, 0], far, [40]), "check"]
    commands += [text("move", home), text("joint", [3, -1.0, 400]), "check"]
    replies = program.ask("sils", commands)
    assert replies[1].numbers[0] > 1.0
    assert replies[1].why != ""
    joints = replies[4].numbers[1:]
    low = mechanism.limits[3, 0]
    assert joints[3] >= low - 1e-12
    for reply in (replies[1], replies[4]):
        stopped = reply.numbers[1:]
        assert (stopped >= mechanism.limits[:, 0] - 1e-9).all()
        assert (stopped <= mechanism.limits[:, 1] + 1e-9).all()


def test_what_cannot_be_is_refused_and_changes_nothing(program):
    robot = loaded("sils")
    home = np.asarray(robot.mechanism.home)
    beyond = home + np.array([0, 3.0, 0, 0, 0, 0])
    far = np.eye(4)
    far[:3, 3] = 9.0
    sheared = robot.forward(home)
    sheared[0, 0] += 0.1
    commands = [text("move", home), text("move", beyond), text("move", home), text("inverse", far)]
    commands += [text("inverse", sheared), text("distance", [0, -1.0]), text("move", home[:-1])]
    first, refused, again, reach, shear, length, short = program.ask("sils", commands)
    assert not refused.good
    assert "loops do not close" in refused.why
    assert np.array_equal(refused.numbers, first.numbers)
    assert np.abs(again.numbers - first.numbers).max() < 1e-14, "Newton's method begins where it ended"
    assert (reach.good, reach.why) == (False, "the pose is out of reach")
    assert not shear.good
    assert "deviates" in shear.why
    assert not length.good
    assert "6 finite numbers" in short.why


@pytest.mark.parametrize("convention", mono.CONVENTIONS)
def test_joints_of_physics_meet_and_a_hand_moves_the_tool(build, tmp_path, convention):
    """On the stub of the engine: both sides of every joint, those of loops too, are at one place in Unity's world."""
    names = ["sils", "sher"]
    files = []
    for name in names:
        robot = loaded(name)
        files.append(tmp_path / f"{class_name(name)}.cs")
        files[-1].write_text(source(DeviceModel(robot.mechanism, robot.kinematics(), robot.gaps)))
    # beside the assemblies that it uses
    program = build.folder / f"Joints{convention}.exe"
    references = (build.engine, build.player, build.editor)
    mono.compiled([*files, mono.HERE / "device/Joints.cs"], program, *references, define="TWIN_PLAYER")
    for name in names:
        mechanism = loaded(name).mechanism
        done = mono.run(["mono", str(program), name, convention])
        assert done.returncode == 0, done.stderr
        said = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines()}
        count, loops = map(int, said["joints"][:2])
        apart, tilted = map(float, said["joints"][2:])
        assert count == len(mechanism.joints)
        assert loops == len(mechanism.loops) > 0
        assert apart < 2e-6, "single precision"
        assert tilted < 2e-6
        left, error = map(float, said["grab"])
        assert left < 1e-5
        assert error < 2e-5
        assert int(said["again"][0]) == sum(j.child == mechanism.joints[0].child for j in mechanism.joints)


MUTATIONS = {
    "a sine is a cosine": ("Math.Sin(", "Math.Cos("),
    "an arc tangent has the other sign": ("Math.Atan2(t", "-Math.Atan2(t"),
    "a state of another joint": ("= states[0];", "= states[1];"),
}


@pytest.mark.parametrize("name", nightly(MUTATIONS, every=2))
def test_a_mistake_in_the_file_is_seen(tmp_path, name):
    robot = loaded("davinci_psm")
    made = Program(tmp_path, ["davinci_psm"])
    file = tmp_path / f"{class_name('davinci_psm')}.cs"
    old, new = MUTATIONS[name]
    whole = file.read_text()
    assert old in whole
    file.write_text(whole.replace(old, new))
    shared = [RUNTIME / "IRobotKinematics.cs", RUNTIME / "KinematicGrab.cs", mono.HERE / "device/Device.cs"]
    mono.compiled([file, *shared], tmp_path / "Device.exe", define="TWIN_PLAYER", strict=False)
    q, links, tools = states(robot, 12)
    commands = []
    for joints, T in zip(q, tools, strict=True):
        commands += [text("move", joints), text("inverse", T)]
    replies = made.ask("davinci_psm", commands)
    wrong = 0
    for i in range(len(q)):
        moved, inverse = replies[2 * i : 2 * i + 2]
        wrong += not (moved.good and inverse.good)
        for link, T in poses(moved, robot.mechanism).items():
            wrong += np.abs(T - links[link][i, :3]).max() > CLOSE
        wrong += np.abs(inverse.numbers - robot.kinematics().inverse(tools[i])).max() > CLOSE
    assert wrong
