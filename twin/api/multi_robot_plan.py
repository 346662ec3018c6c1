"""Plan the motions of several robots of a scene at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from twin.api.robot import Robot
from twin.api.robot_loading import load
from twin.api.scene_loading import load_scene, place_of
from twin.api.scene_obstacles import obstacles_in_world
from twin.core import spatial
from twin.core.errors import CancelledError, ProtocolError, TwinError
from twin.core.progress import Progress, silent
from twin.core.spatial import Array

if TYPE_CHECKING:
    from twin.model.mechanism import Mechanism
    from twin.model.scene import Place, Scene
    from twin.planning.group_result import PlannedTogether
    from twin.planning.path import Path
    from twin.planning.path_kinematics import StateTest
    from twin.planning.plan_files import RobotSamples
    from twin.planning.protocol import Protocol
    from twin.planning.rounds import SearchRounds
    from twin.reference.joint_space import JointSpace

_NO_MOTION = 1e-9
"""Change in m or rad below which a joint counts as not moved."""


class _Arm:
    """An arm to plan, with joint values and tool poses at the start and the end of each of its phases."""

    def __init__(self, place: Place, robot: Robot, protocol: Protocol) -> None:
        from twin.planning.arm_group import GroupArm, stops
        from twin.planning.protocol import Free

        self.place = place
        self.name = place.name
        self.protocol = protocol
        self.waypoints = [protocol.start]
        for phase in protocol.phases:
            if not isinstance(phase, Free):  # a path that the protocol states has no room to evade another arm
                raise ProtocolError(
                    f"{self.name}: phase '{phase.name}' ({phase.type}) of protocol {protocol.name} follows a given "
                    "path, which cannot avoid another arm; use only phases of type joints, positioning, home or free"
                )
            if phase.samples or phase.cost != "length":
                raise ProtocolError(
                    f"{self.name}: phase '{phase.name}' of protocol {protocol.name} sets cost or samples, which a plan "
                    "of several robots does not use (it minimises the length, and takes the first path found); remove "
                    "these keys"
                )
            self.waypoints.append(phase.to)
        robot = robot.bound(protocol)
        self.mechanism = robot.mechanism
        self.kinematics = robot.path_kinematics()
        T_tool_frame = self.mechanism.frame_in_tool(protocol.frame)
        self.timed = GroupArm(self.name, protocol, self.kinematics, T_tool_frame)
        self.q, self._Ts = stops(self.timed)

    def row_of(self, phase: int) -> int:
        """Return the row index in `q` of the start of a phase; for phases after the arm's last one, the last row."""
        return min(phase, len(self.q) - 1)

    def ends(self, phase: int) -> tuple[Array, Array]:
        """Return the joint values (n,) at the start and at the end of a phase."""
        return self.q[self.row_of(phase)], self.q[self.row_of(phase + 1)]

    def moves(self, phase: int) -> bool:
        """Return whether a joint of this arm moves in a phase."""
        start, end = self.ends(phase)
        return bool(np.abs(end - start).max() > _NO_MOTION)

    def phase_name(self, phase: int) -> str:
        """Return the name of a phase of this arm; "at rest" after its last one."""
        phases = self.protocol.phases
        if phase >= len(phases):
            return "at rest"
        return phases[phase].name

    def waypoint(self, phase: int) -> str:
        """Return the name of the waypoint at the start of a phase."""
        return self.waypoints[self.row_of(phase)]

    def exceeded_limits(self, phase: int) -> str:
        """Return a text that names the limits exceeded at the start of a phase; "" if none is exceeded."""
        from twin.planning.feasibility import Anchor, margins_at, violation

        row = self.row_of(phase)
        # the working mode is that of the phase that ends here
        before = self.row_of(max(phase - 1, 0))
        anchor = Anchor.at(self.kinematics, self._Ts[[before]], self.q[[before]])
        margins = margins_at(self.kinematics, self._Ts[[row]], self.q[[row]], anchor)
        return violation(self.kinematics, margins)

    def keep(self, phase: int) -> StateTest:
        """Return a function that tests whether this arm is within its limits and in the phase's working mode.

        The working mode is the one at the start of the phase. The function has two arguments: the tool poses
        T_world_tool (k, 4, 4) of this arm (other tests use T_base_tool), and the joint values q (k, m) of all arms up
        to this arm. The values of this arm are the last columns of q.
        """
        from twin.planning.feasibility import Anchor
        from twin.planning.free_phase import limits_satisfied

        row = self.row_of(phase)
        anchor = Anchor.at(self.kinematics, self._Ts[[row]], self.q[[row]])
        is_within = limits_satisfied(self.kinematics, anchor)
        T_base_world = spatial.inverse(self.place.T_world_base)
        joint_count = self.q.shape[1]

        def within(Ts_world_tool: Array, q: Array) -> Array:
            return is_within(T_base_world @ Ts_world_tool, q[:, -joint_count:])

        return within


def plan_together(
    scene: str,
    arms: Mapping[str, tuple[Robot, Protocol]],
    clearance: float = 0.005,
    seed: int = 0,
    progress: Progress = silent,
    cancelled: Callable[[], bool] | None = None,
) -> PlannedTogether:
    """Return a common plan of several robots of a scene, by priority.

    The first phases of all protocols begin together and end together, then the second phases, and so on. The first arm
    avoids the obstacles at rest. Each further arm also avoids the arms before it as they move; the earlier arms may
    wait. If no path is found, the opposite order of the arms is tried.

    Each arm satisfies the limits that `plan` checks for one robot: joints and motors; speed, acceleration and jerk of
    the moved frame; reach, singularities and working mode. `plan`'s check of the samples is applied to each arm.

    Args:
        scene: name or path of the scene.
        arms: {name of an arm in the scene, or of its robot: (robot, protocol)}, in the order of priority.
        clearance: minimum distance between bodies in m.
        seed: seed of the random searches.
        progress: see `Progress`.
        cancelled: called every few milliseconds, in the same thread; planning ends when it returns True. None: planning
            is not cancelled.

    Raises:
        CancelledError: `cancelled` returned True.
        TwinError: the scene or an arm does not exist, or the arm in the scene is another robot than the given one.
        ProtocolError: the type of a phase is none of joints, positioning, home and free; a waypoint exceeds a limit or
            has too little clearance; no arm moves in a phase; or no path was found.
        TimingError: no timing within the limits was found.
    """
    from twin.planning.plan_files import props_files
    from twin.planning.protocol.free_motions import with_free_motions

    if not 0 < clearance < float("inf"):
        raise ProtocolError(f"the clearance is {clearance:g} m; give a finite number above 0")
    read_scene = load_scene(scene)
    if read_scene.props is not None:
        props_files(read_scene.props)  # before planning, because a plan that cannot be written would be lost
    planned: list[_Arm] = []
    taken_names: set[str] = set()
    for name, (robot, protocol) in arms.items():
        place = place_of(read_scene, name, taken_names)
        if robot.name != place.robot:
            raise TwinError(
                f"'{name}' in scene '{read_scene.name}' is the robot {place.robot}; "
                f"a plan of {robot.name} does not apply"
            )
        planned.append(_Arm(place, robot, with_free_motions(protocol, scene, clearance, seed)))
        taken_names.add(place.name)
    if len(planned) < 2:
        raise TwinError("to plan several arms at once, name at least two")

    def check() -> None:
        if cancelled is not None and cancelled():
            raise CancelledError("planning of several arms was cancelled")

    plan = _Plan(read_scene, planned, clearance, seed, progress, check)
    plan.require_ends()  # before the searches: a waypoint in a wall would cost minutes
    try:
        return plan.result()
    except ProtocolError as error:
        reason = str(error)
    # the first arm plans as if it were alone, and may take the only way of the other one
    opposite = _Plan(read_scene, planned[::-1], clearance, seed, progress, check)
    try:
        return opposite.result()
    except ProtocolError as error:
        raise ProtocolError(f"{reason}. In the opposite order: {error}") from error


class _Plan:
    """A common plan of several arms, for one order of their priorities."""

    def __init__(
        self,
        scene: Scene,
        arms: Sequence[_Arm],
        clearance: float,
        seed: int,
        progress: Progress,
        check: Callable[[], None],
    ) -> None:
        self.scene = scene
        self.arms = arms
        self.clearance = clearance
        self.seed = seed
        self.progress = progress
        self.check = check
        self.load = cache(load)  # each joint space asks for the same obstacles
        self.owners: Mapping[str, str] = {}
        progress("bodies of robots and scene", 0.0)
        self.spaces: list[JointSpace] = []
        for count in range(1, len(arms) + 1):
            self.spaces.append(self._space(count).interruptible(check))

    def _space(self, count: int) -> JointSpace:
        """Return the joint space of the first `count` arms.

        Later arms are not in the space; the robots of the scene that are not planned are obstacles.
        """
        from twin.model.combined_arms import joined, owners
        from twin.reference import ReferenceModel
        from twin.reference.joint_space import JointSpace

        names = [arm.name for arm in self.arms]
        parts = _placed(self.arms[:count])
        self.owners = owners(parts)
        return JointSpace(
            lambda: ReferenceModel(joined(parts)),
            self.clearance,
            around=lambda: obstacles_in_world(self.scene, names, self.load),
            arms=self.owners,
        )

    @property
    def count(self) -> int:
        """Number of phases."""
        most_waypoints = 0
        for arm in self.arms:
            most_waypoints = max(most_waypoints, len(arm.q))
        return most_waypoints - 1

    def require_ends(self) -> None:
        """Raise an error if a waypoint exceeds a limit or has too little clearance, or if no arm moves in a phase."""
        for phase in range(self.count + 1):
            self.check()
            starts = []
            for arm in self.arms:
                reason = arm.exceeded_limits(phase)
                if reason:
                    raise ProtocolError(f"{arm.name} at '{arm.waypoint(phase)}': {reason}. Change this waypoint")
                start, _ = arm.ends(phase)
                starts.append(start)
            q = np.concatenate(starts)
            reason = self.spaces[-1].why(q)
            if reason:
                where = self._waypoints(phase, "at")
                advice = "Change a waypoint"
                distance = self.spaces[-1].too_small_distance(q)
                if distance is not None and distance > 0:  # for bodies that collide, a lower clearance would not help
                    advice += ", or lower the clearance"
                raise ProtocolError(f"{where}: {reason}. {advice}")
            moving_arms = [arm for arm in self.arms if arm.moves(phase)]
            if phase < self.count and not moving_arms:
                where = self._waypoints(phase, "stays at")
                raise ProtocolError(f"phase {self._phase_names(phase)}: no arm moves: {where}. Change a waypoint")

    def _waypoints(self, phase: int, verb: str) -> str:
        """Return the names of all arms and their waypoints at the start of a phase, as text."""
        texts = []
        for arm in self.arms:
            texts.append(f"{arm.name} {verb} '{arm.waypoint(phase)}'")
        return ", ".join(texts)

    def result(self) -> PlannedTogether:
        """Return the plan.

        Raises:
            ProtocolError: no path was found.
            TimingError: no timing within the limits was found.
        """
        from twin.planning.arm_distances import distances_between_arms, nearest_at
        from twin.planning.arm_group import trajectories
        from twin.planning.group_result import CommonPhase, PlannedTogether
        from twin.planning.plan_files import PhaseTimes, RobotSamples

        paths: list[Path] = []
        rounds: list[Mapping[str, SearchRounds]] = []
        for phase in range(self.count):
            path, searched = self._path(phase)
            paths.append(path)
            rounds.append(searched)
        certificates = []
        for phase, path in enumerate(paths):
            self.progress(f"clearance of phase {self._phase_names(phase)}", phase / len(paths))
            certificates.append(self.spaces[-1].certify_each(path, self._kind))

        self.progress("timing", 0.0)
        timed = [arm.timed for arm in self.arms]
        trajectories_of_arms = trajectories(timed, self._courses(paths))
        longest = max(trajectories_of_arms, key=lambda trajectory: len(trajectory.t))
        q: dict[str, Array] = {}
        checked = {}
        for arm, trajectory in zip(self.arms, trajectories_of_arms, strict=True):
            waiting = len(longest.t) - len(trajectory.t)  # samples in which the arm stays at its last waypoint
            q[arm.name] = np.pad(trajectory.q, ((0, waiting), (0, 0)), "edge")
            checked[arm.name] = trajectory.findings

        self.progress("distances between the arms", 0.0)
        arm_distances = distances_between_arms(_placed(self.arms), q, longest.t, self.check)
        q_all = np.column_stack(list(q.values()))
        phases = []
        for phase, span in enumerate(longest.phases):
            rows = slice(span.start, span.stop + 1)
            nearest_pairs = {}
            for kind, certificate in certificates[phase].items():
                if np.isfinite(certificate.found):  # infinite: there is no pair of this kind
                    nearest_pairs[kind] = nearest_at(certificate, paths[phase], q_all[rows], longest.t[rows])
            # the distances over time are sampled more densely, and may have seen a nearer moment
            if "between_arms" in nearest_pairs:
                proven_pair = nearest_pairs["between_arms"]
                nearest_pairs["between_arms"] = proven_pair.or_nearer(arm_distances, span.t0, span.t1)
            name = self._phase_names(phase)
            phases.append(CommonPhase(name, span.t0, span.t1, nearest_pairs, span.solver or "", rounds[phase]))

        robots = {}
        for arm, trajectory in zip(self.arms, trajectories_of_arms, strict=True):
            spans = []
            for span in trajectory.phases:
                spans.append(PhaseTimes(span.name, span.waypoint or "", span.t0, span.t1))
            robots[arm.name] = RobotSamples(arm.protocol, _joints(arm.mechanism), q[arm.name], spans)
        planned = list(robots)
        robots |= self._resting()
        return PlannedTogether(self.scene, self.clearance, robots, planned, longest.t, phases, checked, arm_distances)

    def _courses(self, paths: Sequence[Path]) -> list[list[_Course]]:
        """Return, for each arm, its joint path in each of its phases."""
        courses = []
        start = 0
        for arm in self.arms:
            stop = start + arm.q.shape[1]
            columns = slice(start, stop)
            own_phases = len(arm.q) - 1  # an arm with fewer phases than the others rests afterwards
            courses_of_arm = []
            for path in paths[:own_phases]:
                courses_of_arm.append(_Course(path, columns, self.check))
            courses.append(courses_of_arm)
            start = stop
        return courses

    def _kind(self, first_body: str, second_body: str) -> str:
        """Return the kind of a pair of bodies (a key of `KINDS`), given their names in the joint space."""
        first_owner = self.owners.get(first_body)
        second_owner = self.owners.get(second_body)
        if first_owner is None or second_owner is None:
            return "to_scene"
        if first_owner == second_owner:
            return "inside_arm"
        return "between_arms"

    def _resting(self) -> dict[str, RobotSamples]:
        """Return the scene's robots that are not planned, each at rest in the pose that it has as an obstacle."""
        from twin.planning.plan_files import RobotSamples

        planned_names = [arm.name for arm in self.arms]
        resting: dict[str, RobotSamples] = {}
        for place in self.scene.places:
            if place.name in planned_names:
                continue
            self.check()
            robot = self.load(place.robot)
            protocol = robot.protocol(place.protocol or None)
            robot = robot.bound(protocol)
            q = robot.reference().home().q
            resting[place.name] = RobotSamples(protocol, _joints(robot.mechanism), q[None])
        return resting

    def _phase_names(self, phase: int) -> str:
        """Return the names of a phase in the protocols of all arms, as text."""
        names = [arm.phase_name(phase) for arm in self.arms]
        return " / ".join(names)

    def _path(self, phase: int) -> tuple[Path, Mapping[str, SearchRounds]]:
        """Return the common path of all arms in a phase, and {arm: rounds of its path search}."""
        from twin.planning.obstacle_avoidance import around
        from twin.planning.priority import beside
        from twin.planning.rounds import SearchRound, SearchRounds

        path: Path | None = None
        before: list[str] = []
        rounds_of_arms: dict[str, SearchRounds] = {}
        for arm, joint_space in zip(self.arms, self.spaces, strict=True):
            space = joint_space.keeping(arm.keep(phase))
            start, goal = arm.ends(phase)
            label = f"{arm.name}: path around obstacles"
            moving = ""
            if before:
                names = ", ".join(before)
                label += f" and {names}"
                verb = "move" if len(before) > 1 else "moves"
                subjects = " and ".join(before)
                moving = f" while {subjects} {verb}"
            rounds: list[SearchRound] = []
            # default arguments bind the values of this arm: the functions are called while it is planned
            options = {
                "seed": self.seed,
                "progress": lambda fraction, text=label: self.progress(text, fraction),
                "ended": lambda search_round, tree, rounds_of_arm=rounds: rounds_of_arm.append(search_round),
            }
            try:
                if path is None:
                    path = around(space, start, goal, **options)
                else:
                    path = beside(space, path, start, goal, **options)
            except ProtocolError as error:
                raise ProtocolError(f"{arm.name}, phase '{arm.phase_name(phase)}'{moving}: {error}") from error
            before.append(arm.name)
            if rounds:
                rounds_of_arms[arm.name] = SearchRounds("length", tuple(rounds))
        assert path is not None
        return path, rounds_of_arms


def _placed(arms: Sequence[_Arm]) -> dict[str, tuple[Mechanism, Array]]:
    """Return {name of an arm: (mechanism, T_world_base)}."""
    placed = {}
    for arm in arms:
        placed[arm.name] = (arm.mechanism, arm.place.T_world_base)
    return placed


def _joints(mechanism: Mechanism) -> list[tuple[str, bool]]:
    """Return (name, whether its coordinate is an angle) of each active joint."""
    return [(joint.name, joint.is_angle) for joint in mechanism.active]


class _Course:
    """The joint path of one arm: its columns of the common path. Each evaluation first checks for cancellation."""

    def __init__(self, path: Path, columns: slice, check: Callable[[], None]) -> None:
        self._path = path
        self._columns = columns
        self._check = check

    def __call__(self, s: Array, order: int = 0) -> Array:
        """Return q (k, n) at s (k,), or its derivative of order 1 or 2."""
        self._check()
        return self._path(s, order)[:, self._columns]
