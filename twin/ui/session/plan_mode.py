"""Planning mode of a console: a hand moves a target; its arm's motion to the target is planned, shown and executed.

    off -> aim -> plan -> preview -> run -> off

In `aim`, the hand moves the target, which may pass through anything; all arms are at rest. In `plan`, another process
searches for a motion. This search begins already in `aim`, when the target has been at rest for a moment, so that the
user waits less. `preview` shows the motion until it is accepted. In `run`, the arm follows the motion, whose poses are
inputs of the World and are recorded.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.jobs import Stream
from twin.core.json_types import JsonObject
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.model.scene import Scene
from twin.simulation.console_scene import PEDALS
from twin.simulation.controllers.plan_states import OFF
from twin.simulation.controllers.trainer_states import TrainerPhase
from twin.simulation.devices.plans import PlannedArm, Plans
from twin.simulation.setup import Member
from twin.simulation.world import World
from twin.simulation.world.signal_kinds import ROBOT_ENCODER, ROBOT_PHASE, ROBOT_Q, ROBOT_TARGET
from twin.ui.session.plan_jobs import (
    CheckedTarget,
    Clear,
    JobResult,
    PlanJob,
    PlannedMotion,
    Proven,
    Room,
    TargetCheck,
    work,
)

PlanPhase = Literal["off", "aim", "plan", "preview", "run"]

RESTING_PHASES: tuple[PlanPhase, ...] = ("plan", "preview", "run")
"""Phases in which the hands move neither an arm nor the target."""

_TOOL_SPEED = 60 * MM
"""Largest speed of a tool in m/s in a planned motion (ASSUMED: well below the limits of the joints)."""

_TOOL_ANGULAR_SPEED = 45 * DEG
"""Largest angular speed of a tool in rad/s in a planned motion (ASSUMED: well below the limits of the joints)."""

_MACHINE_SPEED_SHARE = 0.75
"""Speed limits of a plan for a machine as a fraction of the trainer's limits; packets then follow the plan closely."""

_MOVED_TOLERANCE = 1e-3
"""Change of a joint in rad or m, since the plan was made, above which the arm counts as moved."""

_MESSAGE_TIME = 6.0
"""Time in s for which the message about the end of a motion is shown."""

_TARGET_TOLERANCE = 1e-4
"""The arm is at the target if the values of each joint at arm and target differ by less than this, in rad or m."""

_UNSEEN_MOTION = (0.1 * MM, 0.1 * DEG)
"""Largest motion of the target in m and rad that the ghost does not follow. Such a motion is too small to be seen, and
smaller than an arm's deviation at the end of a motion. A trembling hand thus counts as at rest: the target is tested,
and a plan to the target is computed, only once."""

_ERROR_CLEARING_MOTION = (1 * MM, 1 * DEG)
"""Motion of the target in m and rad after which an error is no longer shown (ASSUMED)."""

_REST_TIME = 0.15
"""Time in s for which a free target must be at rest before the search begins in the phase "aim"."""


@dataclass
class _EarlySearch:
    """A search that began before the user requested a plan.

    Attributes:
        job: the plan to compute.
        pieces: results yielded so far.
        end: None while the search runs; then "" (success) or the error.
    """

    job: PlanJob
    pieces: list[JobResult] = field(default_factory=list)
    end: str | None = None


@dataclass
class Preview:
    """A planned motion, the clearances computed so far, and the proven bound of the clearance (None until known)."""

    motion: PlannedMotion
    clear: list[Clear] = field(default_factory=list)
    proven: Proven | None = None


class PlanMode:
    """Planning mode of the arms of a console.

    Attributes:
        plans: the input device of the World that receives targets and motions.
        phase: "off", "aim" (a hand moves the target), "plan", "preview" or "run" (the arm follows the motion).
        hand, robot: the hand that moves the target, and its arm; "" if `phase` is "off".
        message: text for the user; "" if there is none.
        is_error: whether `message` is an error.
        blocked: why the arm cannot be at the target; "" if it can, or if the target has not been tested yet.
        completed: completed fraction, 0 to 1, of the search or of the motion.
        ready: whether the geometry is loaded.
        preview: the planned motion; None before it is found.
        ghost: T_base_body (4, 4) of the arm at the target, by body; empty: no ghost.
        changes: number of changes of `ghost` and `preview` so far; a stream sends both again when the number increases.
    """

    def __init__(self, scene: Scene, members: Mapping[str, Member], world: Callable[[], World]) -> None:
        """Create planning mode, switched off, for the arms of a scene with a console; `world` returns the World."""
        assert scene.console is not None
        self._scene = scene
        self._members = members
        self._world = world
        self._console_scene = scene.console
        self._machines: set[str] = set()
        if scene.trainer is not None:
            self._machines.update(scene.trainer.robots)
        self._stream: Stream[JobResult] = Stream(work, nice=0)  # the user waits for it
        arms = {}
        for name in (*self._console_scene.right, *self._console_scene.left):
            arms[name] = PlannedArm(members[name].kin, name in self._machines)
        self.plans = Plans(PEDALS, arms)
        self._numbers = itertools.count(1)
        self._room: Room | None = None
        self._q_others: dict[str, Array] = {}
        self.changes = 0
        self._message_time = 0.0
        self._reset_state()

    def _reset_state(self) -> None:
        self.phase: PlanPhase = "off"
        self.hand = ""
        self.robot = ""
        self.message = ""
        self.blocked = ""
        self.is_error = False
        self.completed = 0.0
        self.ready = False
        self.preview: Preview | None = None
        self.ghost: Mapping[str, Array] = {}
        self._q = np.zeros(0)  # joint values of the target
        self._start = np.zeros(0)  # joint values at the start of the plan
        self._target = np.zeros(0)  # pose of the target; empty before the first
        self._is_testing = False
        self._tested_q: Array | None = None
        self._early_search: _EarlySearch | None = None
        self._target_error: tuple[Array, str] | None = None  # pose of the target, and message
        self._rest_began = 0.0
        self.changes += 1

    # -- requests -------------------------------------------------------------------------------------

    def aim(self, hand: str, robot: str) -> None:
        """Let a hand move the target of its arm; in the phase "preview", let the hand move the same target again.

        Raises:
            TwinError: planning mode is on for another arm, an arm follows a plan, or no plan is possible for this arm.
        """
        if self.phase == "run" or robot != self.robot:
            self.require_off()
        if robot in self._console_scene.through:
            raise TwinError(
                f"{robot} is kept in its port by software, which the planner does not model: move it directly with the "
                "hands of the console"
            )
        if robot in self._machines:
            trainer = self._world().signals[ROBOT_PHASE.of(robot)]
            phase = TrainerPhase(int(trainer[0]))
            if phase > TrainerPhase.REHEARSE:
                name = phase.name.lower()
                raise TwinError(f"the trainer of {robot} is in '{name}': choose Engage or Rehearse, then plan")
        self._stream.cancel()
        self._is_testing = False
        self._early_search = None
        if self.phase == "off":
            self._reset_state()
            self.hand = hand
            self.robot = robot
            self._q = self._q_of(robot)
            self.ghost = self._link_poses_at(self._q)
        self.phase = "aim"
        self.preview = None
        self.message = ""
        self.is_error = False
        self._tested_q = None
        self._target_error = None
        self.plans.aim(robot)
        self._note_surroundings()
        self._load_geometry()
        self.changes += 1

    def _load_geometry(self) -> None:
        """Begin to load the geometry, if it is not loaded."""
        if not self.ready:
            self._stream.start(TargetCheck(self._require_room()))
            self._is_testing = True

    def find(self) -> None:
        """Plan a motion from the arm to the target.

        Raises:
            TwinError: there is no target, or the arm is already at the target.
        """
        if self.phase != "aim":
            raise TwinError("there is no target yet: press Plan, and move the target")
        start = self._q_of(self.robot)
        if np.abs(self._q - start).max() < _TARGET_TOLERANCE:
            raise TwinError(f"the target is where {self.robot} is: move the target away first")
        self._note_surroundings()
        ahead = self._early_search
        self._early_search = None
        self._target_error = None
        self._start = start
        self.phase = "plan"
        self.completed = 0.0
        self.message = ""
        self.is_error = False
        self.plans.hold()
        self._is_testing = False
        self.changes += 1
        if ahead is None or not self._is_usable(ahead.job, start):
            self._stream.start(self._plan_job(start))
            return
        self._start = ahead.job.start
        for piece in ahead.pieces:
            self._use_result(piece)
        if ahead.end is not None:
            self._end_job(ahead.end)

    def accept(self) -> None:
        """Let the arm make the planned motion.

        Raises:
            TwinError: there is no plan, or an arm has moved since the plan was made.
        """
        if self.phase != "preview" or self.preview is None:
            raise TwinError("there is no plan to accept: press Plan, and move the target")
        signals = self._world().signals
        motions = {}
        for name, q in self._q_others.items():
            motions[name] = np.abs(signals[ROBOT_Q.of(name)] - q)
        motions[self.robot] = np.abs(self._q_of(self.robot) - self._start)
        for name, motion in motions.items():
            k = int(np.argmax(motion))
            if motion[k] > _MOVED_TOLERANCE:
                joint = self._members[name].mechanism.active[k]
                text, unit = display_unit(joint.is_angle)
                raise TwinError(
                    f"{name} has moved since the plan: {joint.name} by {motion[k] / unit:.2g} {text} "
                    f"(limit {_MOVED_TOLERANCE / unit:.2g} {text}); plan again"
                )
        self.phase = "run"
        self.completed = 0.0
        self.message = ""
        self.is_error = False
        self.plans.run(self.preview.motion.Ts)
        self.changes += 1

    def cancel(self, why: str = "") -> None:
        """End planning mode in any phase: the arm stays where it is, and the hands move the arms again."""
        if self.phase == "off":
            return
        moves = self.phase == "run"
        self.reset(why)
        if moves or why:
            self._set_end_message(why or "Cancelled: the arm stays where it is.", bool(why))

    def reset(self, why: str = "") -> None:
        """End planning mode, and delete the message about the last motion; called when a World ends or begins."""
        self._stream.cancel()
        self.plans.stop(why)
        self._reset_state()

    def require_off(self) -> None:
        """Check that no motion is planned or made.

        Raises:
            TwinError: a motion is being planned or made.
        """
        if self.phase == "run":
            raise TwinError(f"{self.robot} follows a plan: wait until it has arrived, or cancel")
        if self.phase != "off":
            raise TwinError(f"a motion of {self.robot} is being planned: accept or cancel it first")

    def close(self) -> None:
        """End the process."""
        self._stream.close()

    # -- time -----------------------------------------------------------------------------------------

    def poll(self, arm: str) -> None:
        """Receive the results of the planning process, and move the ghost to the target.

        `arm` is the arm that the hand `hand` controls now; if it is not `robot`, planning mode ends.
        """
        if self.phase == "off":
            return
        pieces, end = self._stream.poll()
        if self._early_search is not None:
            self._early_search.pieces += pieces
            if end is not None:
                self._early_search.end = end
        else:
            for piece in pieces:
                self._use_result(piece)
            if end is not None:
                self._end_job(end)
        if self.phase == "aim":
            if arm != self.robot:
                self.cancel(f"The clutch has chosen {arm}: planning of {self.robot} was cancelled.")
            else:
                self._follow_target()
        elif self.phase == "run":
            self._follow_motion()

    def _use_result(self, piece: JobResult) -> None:
        if isinstance(piece, float):
            self.completed = piece
        elif isinstance(piece, CheckedTarget):
            self.blocked = piece.why
        elif isinstance(piece, PlannedMotion):
            self.preview = Preview(piece)
            self.phase = "preview"
            self.completed = 1.0
            self.changes += 1
        elif self.preview is not None and isinstance(piece, Clear):
            self.preview.clear.append(piece)
            self.changes += 1
        elif self.preview is not None and isinstance(piece, Proven):
            self.preview.proven = piece
            self.changes += 1

    def _end_job(self, error: str) -> None:
        """Handle the end of a job; `error` is "" after success."""
        self._is_testing = False
        if not error:
            self.ready = True
            return
        self.message = error
        self.is_error = True
        was_planning = self.phase == "plan"
        if was_planning:
            self.message = f"No plan: {error}"
        self._target_error = (self._target, self.message)
        if was_planning:
            self.phase = "aim"
            self._tested_q = self._q
            self.plans.aim(self.robot)
            self._load_geometry()
            self.changes += 1

    def _follow_target(self) -> None:
        """Move the ghost to the target. Test a new target; if the target is at rest and free, begin the search."""
        target = self._world().signals[ROBOT_TARGET.of(self.robot)][1:].reshape(4, 4)
        if self.plans.state != OFF and not _are_near(target, self._target, *_UNSEEN_MOTION):
            self._move_ghost(target)
        if not self.ready or self._is_testing:
            return
        world_time = self._world().t
        if self._tested_q is None or not np.array_equal(self._tested_q, self._q):
            self._tested_q = self._q
            self._is_testing = True
            self._rest_began = world_time
            self._early_search = None
            self._stream.start(TargetCheck(self._require_room(), self._q))
            return
        if self._early_search is not None or self._target_error is not None or self.blocked:
            return
        if world_time - self._rest_began > _REST_TIME:
            start = self._q_of(self.robot)
            if np.abs(self._q - start).max() >= _TARGET_TOLERANCE:
                self._early_search = _EarlySearch(self._plan_job(start))
                self._stream.start(self._early_search.job)

    def _move_ghost(self, target: Array) -> None:
        """Move the ghost to a new pose (4, 4) of the target, and set the message about this pose."""
        is_first = not len(self._target)
        self._target = target
        why = self._solve_target(self._members[self.robot], target)
        if self._target_error is not None and not _are_near(target, self._target_error[0], *_ERROR_CLEARING_MOTION):
            self._target_error = None
        if self._target_error is not None and not why:
            self.message = self._target_error[1]
            self.is_error = True
        elif not is_first:
            self.message = why
            self.is_error = False
        self.changes += 1

    def _is_usable(self, job: PlanJob, start: Array) -> bool:
        """Return whether a job plans from start (n,) to the present target, in the present surroundings of the arm."""
        if job.room is not self._room or not np.array_equal(job.goal, self._q):
            return False
        return bool(np.abs(job.start - start).max() <= _MOVED_TOLERANCE)

    def _plan_job(self, start: Array) -> PlanJob:
        """Return the job that plans a motion from start (n,) to the target."""
        speed, turn = self._tool_speed_limits()
        return PlanJob(self._require_room(), start, self._q, speed, turn)

    def _solve_target(self, member: Member, T: Array) -> str:
        """Move the ghost to a pose (4, 4) in the base frame; return why this is not possible, "" if it is possible."""
        kin = member.kin
        last = self._q
        stays = "; the ghost stays at the last pose within reach"
        try:
            q = np.array(kin.inverse(T, last), float)
            # full turns are removed, so that the arm does not turn once around
            full_turns = np.rint((q - last)[kin.revolute] / (2 * np.pi))
            q[kin.revolute] -= 2 * np.pi * full_turns
            q[kin.auxiliary] = last[kin.auxiliary]
            for joint, value in zip(member.mechanism.active, q, strict=True):
                low, high = joint.limits or (-np.inf, np.inf)
                if not low <= value <= high:
                    sign, unit = display_unit(joint.is_angle)
                    limits = f"{low / unit:.4g} to {high / unit:.4g} {sign}"
                    return f"The target needs {joint.name} = {value / unit:.4g} {sign} (limits {limits}){stays}"
            self.ghost = self._link_poses_at(q)
        except TwinError as error:  # out of reach, or the loops cannot be closed
            return f"{error}{stays}"
        self._q = q
        return ""

    def _link_poses_at(self, q: Array) -> Mapping[str, Array]:
        links = self._members[self.robot].links
        assert links is not None, "a console has the link poses of its robots"
        return links(q)

    def _follow_motion(self) -> None:
        """Update the completed fraction of the motion, and end planning mode at the end of the motion."""
        self.completed = self.plans.fraction
        if self.plans.state != OFF:
            return
        robot = self.robot
        self._stream.cancel()
        self._reset_state()
        if self.plans.arrived:
            deviation = self.plans.off / MM
            self._set_end_message(f"{robot} has arrived; its tip was at most {deviation:.2f} mm from its path.", False)
        else:
            self._set_end_message(self.plans.why, True)

    def _set_end_message(self, text: str, is_error: bool) -> None:
        """Set the message on how planning mode has ended."""
        self.message = text
        self.is_error = is_error
        self._message_time = self._world().t

    # -- what surrounds the arm -----------------------------------------------------------------------

    def _q_of(self, robot: str) -> Array:
        """Return the present joint values (n,) of an arm, as measured if it has encoders."""
        signals = self._world().signals
        encoder = ROBOT_ENCODER.of(robot)
        if encoder in signals:
            return signals[encoder]
        return signals[ROBOT_Q.of(robot)]

    def _note_surroundings(self) -> None:
        """Store the joints of the other robots; if a robot has moved since the last plan, load the geometry again."""
        signals = self._world().signals
        q_others = {}
        for place in self._scene.places:
            if place.name != self.robot and ROBOT_Q.of(place.name) in signals:
                q_others[place.name] = signals[ROBOT_Q.of(place.name)]
        if self._is_loaded_for(q_others):
            return
        self._q_others = q_others
        links = self._world().link_poses()
        poses = {name: dict(links[name]) for name in q_others}
        self._room = Room(next(self._numbers), str(self._scene.file), self.robot, poses)
        self.ready = False

    def _is_loaded_for(self, q_others: Mapping[str, Array]) -> bool:
        """Return whether the geometry is that of the present arm, with the other robots at joint values q_others."""
        if self._room is None or self._room.robot != self.robot or q_others.keys() != self._q_others.keys():
            return False
        for name, q in q_others.items():
            motion = np.abs(q - self._q_others[name]).max()
            if motion > _MOVED_TOLERANCE:
                return False
        return True

    def _require_room(self) -> Room:
        assert self._room is not None
        return self._room

    def _tool_speed_limits(self) -> tuple[float, float]:
        """Return the largest speeds of the tool in a planned motion, in m/s and rad/s."""
        trainer = self._scene.trainer
        if trainer is None or self.robot not in self._machines:
            return _TOOL_SPEED, _TOOL_ANGULAR_SPEED
        speed = min(_TOOL_SPEED, _MACHINE_SPEED_SHARE * trainer.speed_mm_s * MM)
        turn = min(_TOOL_ANGULAR_SPEED, _MACHINE_SPEED_SHARE * trainer.turn_deg_s * DEG)
        return speed, turn

    # -- state ----------------------------------------------------------------------------------------

    def state(self) -> JsonObject | None:
        """Return the state of planning mode as plain data for displays; None if there is nothing to show."""
        if self.phase == "off" and (not self.message or self._world().t - self._message_time > _MESSAGE_TIME):
            return None
        return {
            "phase": self.phase,
            "hand": self.hand,
            "robot": self.robot,
            "said": self.message,
            "bad": self.is_error,
            "blocked": self.blocked,
            "ready": self.ready,
            "done": round(self.completed, 2),
        }


def _are_near(T: Array, T_other: Array, length: float, angle: float) -> bool:
    """Return whether two poses (4, 4) are within a distance in m and an angle in rad; False if `T_other` is empty."""
    if not len(T_other):
        return False
    if np.linalg.norm(T[:3, 3] - T_other[:3, 3]) > length:
        return False
    return float(spatial.rotation_angle(T[:3, :3] @ T_other[:3, :3].T)) <= angle
