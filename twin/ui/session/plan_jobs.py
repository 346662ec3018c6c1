"""Jobs of planning mode in another process: test the target, plan and time a motion, compute the motion's clearance.

For each robot, the process keeps the obstacles of the last job in memory, so that a test takes milliseconds. A motion
is planned in a thread, while the generator `work` yields the progress. If the generator is closed, the search ends at
its next check for cancellation.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from twin.core import spatial
from twin.core.errors import CancelledError, TwinError
from twin.core.sampling import spread
from twin.core.spatial import Array
from twin.core.units import MM

if TYPE_CHECKING:
    from twin.api import Robot
    from twin.kinematics import Kinematics
    from twin.model.scene import Scene
    from twin.planning.fmt import SearchTree
    from twin.planning.path import Path
    from twin.planning.rounds import SearchRound
    from twin.reference.joint_space import JointSpace

DT = 1e-3
"""Time in s between two poses of a plan: a tick of the World."""

PREVIEW_PERIOD = 33 * DT
"""Time in s between two poses of the arm in a preview, a whole number of ticks."""

_PROGRESS_PERIOD = 0.05
"""Time in s between two reports of progress."""

_CLEARANCE_POINTS = 64
"""Number of points along a motion at which the clearance is computed."""

_MIN_CLEARANCE = 2 * MM
"""Minimum clearance of a plan in m. With a smaller minimum, a search would take seconds, and an arm could deviate from
the plan by more than the clearance."""

_LINEAR_SPEED = 0.1
"""Speed limit in m/s of a prismatic joint without a speed limit (ASSUMED)."""

_ANGULAR_SPEED = 1.0
"""Speed limit in rad/s of a revolute joint without a speed limit (ASSUMED)."""

_RISE_TIME = 0.25
"""Time in s in which a joint without an acceleration limit reaches its largest speed (ASSUMED)."""

_POINTS_PER_PIECE = 8
"""Number of points of a motion whose clearances are yielded together; a page draws them while others are computed."""


@dataclass(frozen=True)
class Room:
    """Surroundings in which an arm moves.

    Attributes:
        number: identifies the state of the other robots; a different state has a different number.
        scene: the scene file.
        robot: the name of the arm's place.
        poses: T_world_body (4, 4) of the bodies of the other robots, by place and body.
    """

    number: int
    scene: str
    robot: str
    poses: Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class TargetCheck:
    """Job: check whether the arm can be at q (n,), and yield a `CheckedTarget`; q None: only load the geometry."""

    room: Room
    q: Array | None = None


@dataclass(frozen=True)
class CheckedTarget:
    """Result of a `TargetCheck`: why the arm cannot be at the joint values (contact, limit); "" if it can."""

    why: str


@dataclass(frozen=True)
class PlanJob:
    """Job: plan a motion from joint values start (n,) to goal (n,).

    The job yields the completed fraction of the search (a float) repeatedly, then one `PlannedMotion`, several `Clear`
    and one `Proven`. `speed` in m/s and `turn` in rad/s are the largest speeds of the tool.
    """

    room: Room
    start: Array
    goal: Array
    speed: float
    turn: float
    seed: int = 0


@dataclass(frozen=True)
class PlannedMotion:
    """A timed motion.

    Attributes:
        Ts: (k, 4, 4) poses of the tool in the base frame, one every `DT` s.
        shown: (m, links, 4, 4) poses of all links in the base frame, one set every `PREVIEW_PERIOD` s.
        links: names of the links in `shown`.
        tree: (edges, 2, 3) tip positions at both ends of each edge of the search tree, in m in the base frame; no edges
            if the path is straight.
    """

    Ts: Array
    shown: Array
    links: tuple[str, ...]
    tree: Array

    @property
    def duration(self) -> float:
        """Duration in s."""
        return (len(self.Ts) - 1) * DT


@dataclass(frozen=True)
class Clear:
    """Times (k,) in s of a motion, and minimum distances (k,) in m between arm and other bodies, by exact geometry."""

    t: Array
    distance: Array


@dataclass(frozen=True)
class Proven:
    """Clearance of a whole motion: proven lower `bound` in m; smallest `computed` distance in m; the nearest bodies."""

    bound: float
    computed: float
    bodies: tuple[str, str]


PlanResult = PlannedMotion | Clear | Proven
"""What a `PlanJob` yields in its second part."""

JobResult = float | CheckedTarget | PlanResult
"""What a job yields; a number is the completed fraction of a search."""


def work(job: TargetCheck | PlanJob) -> Iterator[JobResult]:
    """Yield the results of a job.

    Raises:
        TwinError: a file is malformed, or there is no plan; the message has the reason.
    """
    if isinstance(job, PlanJob):
        yield from _plan_with_progress(job)
        return
    arm = _arm_of(job.room)
    if job.q is not None:
        yield CheckedTarget(arm.space.why(job.q))
    else:
        arm.space.load()


def _plan_with_progress(job: PlanJob) -> Iterator[JobResult]:
    """Yield the results of a plan, made in a thread, and each `_PROGRESS_PERIOD` without one the completed fraction."""
    # results of the plan, then None, or the error that ended it
    results: queue.SimpleQueue[PlanResult | BaseException | None] = queue.SimpleQueue()
    is_cancelled = threading.Event()
    completed = 0.0

    def report(fraction: float) -> None:
        nonlocal completed
        completed = fraction

    def run() -> None:
        try:
            for piece in plan(job, report, is_cancelled.is_set):
                results.put(piece)
            results.put(None)
        except BaseException as error:  # raised again in the thread that waits for the results
            results.put(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while True:
            try:
                piece = results.get(timeout=_PROGRESS_PERIOD)
            except queue.Empty:
                yield completed
                continue
            if piece is None:
                return
            if isinstance(piece, BaseException):
                raise piece
            yield piece
    finally:
        is_cancelled.set()
        thread.join()


def plan(
    job: PlanJob, report: Callable[[float], None] = lambda fraction: None, cancelled: Callable[[], bool] = lambda: False
) -> Iterator[PlanResult]:
    """Yield the results of a plan; `report` is called with the completed fraction of the search.

    Raises:
        CancelledError: the function `cancelled` has returned True.
        TwinError: there is no plan; the message has the reason.
    """
    from twin.planning.obstacle_avoidance import NoPathError, around

    def check() -> None:
        if cancelled():
            raise CancelledError

    arm = _arm_of(job.room)
    trees: list[SearchTree] = []  # the tree after each round of the search

    def keep_tree(search_round: SearchRound, tree: SearchTree) -> None:
        trees.append(tree)

    try:
        path = around(
            arm.space,
            job.start,
            job.goal,
            seed=job.seed,
            progress=report,
            cancelled=cancelled,
            ended=keep_tree,
        )
    except NoPathError as error:
        remedy = "end the planning mode and move the arm" if error.at_start else "move the target"
        raise TwinError(f"{error.reason}; {remedy}, or another arm that is in the way") from None
    s = _time_parameters(path, arm, job)
    q = path(s)
    times: Array = np.arange(len(s), dtype=np.float64) * DT
    names, link_poses = _preview_poses(arm, q)
    yield PlannedMotion(arm.kin.forward_many(q), link_poses, names, _tree_tips(arm, trees))
    for part in np.array_split(spread(len(s), _CLEARANCE_POINTS), _CLEARANCE_POINTS // _POINTS_PER_PIECE):
        check()
        distances = np.zeros(len(part))
        for k, q_point in enumerate(q[part]):
            distances[k], *_ = arm.space.nearest(q_point)
        yield Clear(times[part], distances)
    certificate = arm.space.interruptible(check).certify(path)
    yield Proven(certificate.proven, certificate.found, certificate.bodies)


def _preview_poses(arm: _Arm, q: Array) -> tuple[tuple[str, ...], Array]:
    """Return (names of the links, their poses (m, links, 4, 4) in the base frame) at each `PREVIEW_PERIOD` of q (k, n).

    The last pose is that of the end of the motion.
    """
    every = round(PREVIEW_PERIOD / DT)
    rows = np.append(np.arange(0, len(q), every), len(q) - 1)
    poses = []
    names: tuple[str, ...] = ()
    for row in np.unique(rows):
        links = arm.links(q[row])
        names = tuple(links)
        poses.append([links[name] for name in names])
    return names, np.array(poses)


def _tree_tips(arm: _Arm, trees: Sequence[SearchTree]) -> Array:
    """Return the tip positions (edges, 2, 3) at both ends of each edge of the last tree, in m in the base frame."""
    if not trees or not len(trees[-1].branches):
        return np.zeros((0, 2, 3))
    tree = trees[-1]
    tips = arm.kin.forward_many(tree.q)[:, :3, 3]
    return tips[tree.branches]


def _time_parameters(path: Path, arm: _Arm, job: PlanJob) -> Array:
    """Return path parameters s (k,), one every `DT` s, of the fastest motion within the limits of joints and tool."""
    from twin.planning.timing import time_path

    timing = time_path(path, arm.speed, arm.acceleration, dt=DT)
    Ts = arm.kin.forward_many(path(timing.s))
    speed = np.linalg.norm(np.diff(Ts[:, :3, 3], axis=0), axis=1).max(initial=0.0) / DT
    turns = np.swapaxes(Ts[:-1, :3, :3], 1, 2) @ Ts[1:, :3, :3]
    turn = float(np.max(spatial.rotation_angle(turns), initial=0.0)) / DT
    slowdown = max(1.0, speed / job.speed, turn / job.turn)
    if slowdown > 1:
        # a motion that takes c times as long has speeds c times, and accelerations c² times smaller
        timing = time_path(path, arm.speed / slowdown, arm.acceleration / slowdown**2, dt=DT)
    return timing.s


@dataclass(frozen=True)
class _Arm:
    """The arm of a room: joint space, equations, link poses, speed limits (n,) and acceleration limits (n,)."""

    space: JointSpace
    kin: Kinematics
    links: Callable[[Array], Mapping[str, Array]]
    speed: Array
    acceleration: Array


_arm_cache: dict[str, tuple[int, _Arm]] = {}


def _arm_of(room: Room) -> _Arm:
    """Return the arm of a room, from a cache that stores the last arm of each robot."""
    if room.robot in _arm_cache:
        number, arm = _arm_cache[room.robot]
        if number == room.number:
            return arm
    arm = _load_arm(room)
    _arm_cache[room.robot] = (room.number, arm)
    return arm


def _load_arm(room: Room) -> _Arm:
    """Load the arm of a room, with the bodies around it as obstacles.

    Raises:
        TwinError: there is no such scene or robot, or a file is malformed.
    """
    from twin.api.scene_obstacles import obstacles_in_base
    from twin.kinematics.closed_loops.placing import LinkPoses
    from twin.reference import ReferenceModel
    from twin.reference.joint_space import JointSpace

    scene = _load_scene(room.scene)
    robots = {place.name: place.robot for place in scene.places}
    if room.robot not in robots:
        raise TwinError(f"scene '{scene.name}' has no robot '{room.robot}'")
    robot = _load_robot(robots[room.robot])
    space = JointSpace(
        lambda: ReferenceModel(robot.mechanism),
        max(scene.clearance, _MIN_CLEARANCE),
        around=lambda: obstacles_in_base(room.scene, room.robot, _load_robot, room.poses),
    )
    active = robot.mechanism.active
    speed = np.zeros(len(active))
    acceleration = np.zeros(len(active))
    for k, joint in enumerate(active):
        assumed_speed = _ANGULAR_SPEED if joint.is_angle else _LINEAR_SPEED
        speed[k] = joint.max_speed or assumed_speed
        acceleration[k] = joint.max_acceleration or speed[k] / _RISE_TIME
    return _Arm(space, robot.kinematics(), LinkPoses(robot.loops), speed, acceleration)


@cache
def _load_robot(robot: str) -> Robot:
    from twin.api import load

    return load(robot)


@cache
def _load_scene(file: str) -> Scene:
    from twin.core import assets
    from twin.model.scene import load_scene

    path = assets.scene_file(file)
    if path is None:
        raise TwinError(f"there is no scene '{file}'")
    return load_scene(path)
