"""Planning mode of a console: the hand moves a target through everything, a motion to it is planned, shown, and made.

    off -> aim -> plan -> preview -> run -> off

In `aim`, the hand moves the target, and all arms are at rest. `plan` searches in another process; the search begins
already when the target rests, so that a user who stops before releasing the pedal does not wait for all of it.
`preview` shows the motion until it is accepted. In `run`, the arm follows it; the poses are an input of the World and
in its recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from twin.core.errors import KinematicsError, TwinError
from twin.core.jobs import Stream
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.mechanism import Mechanism
from twin.model.scene import Scene
from twin.simulation.console_scene import PEDALS, Member
from twin.simulation.controllers.planned import OFF
from twin.simulation.controllers.trainer import Phase as TrainerPhase
from twin.simulation.devices.plans import Led, Plans
from twin.simulation.world import World
from twin.ui.session.plan_work import Check, Checked, Clear, Found, Plan, Proven, Room, work

Phase = Literal["off", "aim", "plan", "preview", "run"]

_SPEED, _TURN = 60 * MM, 45 * DEG
"""Largest speed of a tool in m/s and rad/s on a planned motion (ASSUMED: well below the limits of the joints)."""

_SHARE = 0.75
"""Part of the speeds of a machine's packets that a plan uses, so that the packets follow it closely."""

_MOVED = 1e-3
"""Difference in rad or m of a joint above which an arm is no longer where a plan left it."""

_SAID = 6.0
"""Time in s for which the end of a motion is told."""

_SAME = 1e-4
"""Largest difference in rad or m of all joints at which the target is where the arm is."""


_REST = 0.15
"""Time in s without motion of a free target after which the search begins before the pedal is released."""


@dataclass
class _Ahead:
    """A search that began before the pedal was released.

    Attributes:
        job: what is planned.
        pieces: what was found so far.
        end: None while it runs; then "" or the error.
    """

    job: Plan
    pieces: list[Any] = field(default_factory=list)
    end: str | None = None


@dataclass
class Preview:
    """What is known of a planned motion: the motion, its clearance so far, and the proven bound when it is known."""

    found: Found
    clear: list[Clear] = field(default_factory=list)
    proven: Proven | None = None


class PlanMode:
    """Planning mode of the arms of a console.

    Attributes:
        plans: the input device of the World.
        phase: see the module.
        hand, robot: the hand and its arm; "" if `phase` is "off".
        said: what the user should know now; "" if there is nothing.
        bad: whether `said` is an error.
        blocked: why the target is not free; "" if it is, or is not known yet.
        done: part of the search that is done, or of the motion that was made.
        preview: the planned motion; None before.
        ghost: T_base_body (4, 4) of the arm at the target, by body; empty: there is none.
        changes: number of changes of `ghost` and `preview`, for the source of a stream.
    """

    def __init__(self, scene: Scene, members: Mapping[str, Member], world: Callable[[], World], source: str) -> None:
        """Prepare for a scene with a console; `source` is the name or file of the scene for another process."""
        assert scene.console is not None
        self._scene, self._members, self._world, self._source = scene, members, world, source
        self._table, self._machines = scene.console, set(scene.trainer.robots) if scene.trainer else set()
        self._stream: Stream[Any] = Stream(work, nice=0)  # the user waits for it
        arms = {n: Led(members[n].kin, n in self._machines) for n in (*self._table.right, *self._table.left)}
        self.plans = Plans(PEDALS, arms)
        self._numbers, self._room = itertools.count(1), None
        self._stands: dict[str, Array] = {}
        self.changes, self._told = 0, 0.0
        self._clear()

    def _clear(self) -> None:
        self.phase: Phase = "off"
        self.hand = self.robot = self.said = self.blocked = ""
        self.bad, self.done, self.ready = False, 0.0, False
        self.preview: Preview | None = None
        self.ghost: Mapping[str, Array] = {}
        self._q = self._start = self._seen = np.zeros(0)
        self._checks = False
        self._tested: Array | None = None
        self._ahead: _Ahead | None = None
        self._moved = 0.0
        self.changes += 1

    @property
    def holds_camera(self) -> bool:
        """Whether the camera must rest: its arm is among the obstacles of a plan."""
        return self.phase in ("plan", "preview", "run")

    # -- requests -------------------------------------------------------------------------------------

    def aim(self, hand: str, robot: str) -> None:
        """Let a hand move the target of its arm; in a preview, move the same target again.

        Raises:
            TwinError: another arm is planned for, an arm moves, or this arm cannot be planned for.
        """
        if self.phase == "run":
            raise TwinError(f"{self.robot} follows a plan: wait until it has arrived, or cancel")
        if self.phase != "off" and robot != self.robot:
            raise TwinError(f"a motion of {self.robot} is being planned: accept or cancel it first")
        if robot in self._table.through:
            raise TwinError(
                f"{robot} is kept in its port by software, and the planner does not know its port: move it by hand"
            )
        if robot in self._machines and (p := self._world().signals[f"{robot}.phase"][0]) > TrainerPhase.REHEARSE:
            name = TrainerPhase(int(p)).name.lower()
            raise TwinError(f"the trainer of {robot} is in '{name}': choose Engage or Rehearse, then plan")
        self._stream.cancel()
        self._checks, self._ahead = False, None
        again = self.phase != "off"
        if not again:
            self._clear()
            self.hand, self.robot, self._q = hand, robot, self._at(robot)
            self._seen = np.zeros(0)
        self.phase, self.preview, self.said, self.bad, self._tested = "aim", None, "", False, None
        self.plans.aim(robot)
        self._enter()
        if not self.ready:
            self._stream.start(Check(self._require_room()))
            self._checks = True
        self.changes += 1

    def find(self) -> None:
        """Plan a motion from the arm to the target.

        Raises:
            TwinError: there is no target, or it is where the arm is.
        """
        if self.phase != "aim":
            raise TwinError("there is no target yet: press Plan, and move the target")
        start = self._at(self.robot)
        if np.abs(self._q - start).max() < _SAME:
            raise TwinError(f"the target is where {self.robot} is: move it away first")
        self._enter()
        ahead, self._ahead = self._ahead, None
        self._start, self.phase, self.done, self.said, self.bad = start, "plan", 0.0, "", False
        self.plans.hold()
        self._checks = False
        self.changes += 1
        if ahead is None or ahead.job.room is not self._room or not np.array_equal(ahead.job.goal, self._q):
            self._stream.start(self._plan(start))
            return
        for piece in ahead.pieces:
            self._take(piece)
        if ahead.end is not None:
            self._ended(ahead.end)

    def accept(self) -> None:
        """Let the arm make the planned motion.

        Raises:
            TwinError: there is no plan, or an arm has moved since.
        """
        if self.phase != "preview" or self.preview is None:
            raise TwinError("there is no plan to accept: press Plan, and move the target")
        off = {n: float(np.abs(self._at(n) - q).max()) for n, q in self._stands.items()}
        off[self.robot] = float(np.abs(self._at(self.robot) - self._start).max())
        for name, size in off.items():
            if size > _MOVED:
                raise TwinError(
                    f"{name} has moved since the plan: a joint by {size:.2g} rad or m (limit {_MOVED:g}); plan again"
                )
        self.phase, self.done, self.said, self.bad = "run", 0.0, "", False
        self.plans.run(self.preview.found.Ts)
        self.changes += 1

    def cancel(self, why: str = "") -> None:
        """End planning mode in any phase: the arm stays where it is, and the hands move the arms again."""
        was = self.phase
        self._stream.cancel()
        self.plans.stop(why)
        self._clear()
        if was == "run" or why:
            self._tell(why or "Cancelled: the arm stays where it is.", bool(why))

    def close(self) -> None:
        """End the process."""
        self._stream.close()

    # -- time -----------------------------------------------------------------------------------------

    def poll(self, arm: str) -> None:
        """Take what the other process has found, and follow the target; `arm` is the arm of `hand` now."""
        if self.phase == "off":
            return
        pieces, end = self._stream.poll()
        if self._ahead is not None:
            self._ahead.pieces += pieces
            self._ahead.end = self._ahead.end if end is None else end
        else:
            for piece in pieces:
                self._take(piece)
            if end is not None:
                self._ended(end)
        if self.phase == "aim":
            if arm != self.robot:
                return self.cancel(f"The clutch has chosen {arm}: planning of {self.robot} was cancelled.")
            self._follow()
        elif self.phase == "run":
            self._watch()
        return None

    def _take(self, piece: Any) -> None:
        if isinstance(piece, float):
            self.done = piece
        elif isinstance(piece, Checked):
            self.blocked = piece.why
        elif isinstance(piece, Found):
            self.preview, self.phase, self.done = Preview(piece), "preview", 1.0
            self.changes += 1
        elif self.preview is not None and isinstance(piece, Clear):
            self.preview.clear.append(piece)
            self.changes += 1
        elif self.preview is not None and isinstance(piece, Proven):
            self.preview.proven = piece
            self.changes += 1

    def _ended(self, error: str) -> None:
        """Note that a job has ended; `error` is "" if it is done."""
        self._checks = False
        if not error:
            self.ready = True
        elif self.phase == "plan":
            self.phase, self._tested, self.said, self.bad = "aim", self._q, f"No plan: {error}", True
            self.plans.aim(self.robot)
            self.changes += 1
        else:
            self.said, self.bad = error, True

    def _follow(self) -> None:
        """Compute the ghost at the target, and test it when the last test has ended."""
        member, signals = self._members[self.robot], self._world().signals
        target = signals[f"{self.robot}.target"][1:]
        if self.plans.state != OFF and not np.array_equal(target, self._seen):
            first = not len(self._seen)
            self._seen = target
            self._q, why = self._reached(member, target.reshape(4, 4))
            self.ghost = (member.links or _links(member.mechanism))(self._q)
            if not first:
                self.said, self.bad = why, False
            self.changes += 1
        if not self.ready or self._checks:
            return
        now = self._world().t
        if self._tested is None or not np.array_equal(self._tested, self._q):
            self._tested, self._checks, self._moved, self._ahead = self._q, True, now, None
            self._stream.start(Check(self._require_room(), self._q))
        elif self._ahead is None and not self.blocked and now - self._moved > _REST:
            start = self._at(self.robot)
            if np.abs(self._q - start).max() >= _SAME:
                self._ahead = _Ahead(self._plan(start))
                self._stream.start(self._ahead.job)

    def _plan(self, start: Array) -> Plan:
        """Return the plan from start (n,) to the target."""
        return Plan(self._require_room(), start, self._q, *self._limits())

    def _reached(self, member: Member, T: Array) -> tuple[Array, str]:
        """Return the joint values (n,) at a pose (4, 4) in base, or the last ones and why there are none."""
        kin, mechanism, last = member.kin, member.mechanism, self._q
        stays = "; the ghost stays at the last pose within reach"
        try:
            q = np.array(kin.inverse(T, last), float)
        except KinematicsError as error:
            return last, f"{error}{stays}"
        q[kin.revolute] -= 2 * np.pi * np.rint((q - last)[kin.revolute] / (2 * np.pi))
        q[kin.auxiliary] = last[kin.auxiliary]
        for joint, x in zip(mechanism.active, q, strict=True):
            low, high = joint.limits or (-np.inf, np.inf)
            if not low <= x <= high:
                unit, text = (DEG, "deg") if joint.is_angle else (MM, "mm")
                within = f"{low / unit:.4g} to {high / unit:.4g} {text}"
                return last, f"The target needs {joint.name} = {x / unit:.4g} {text} (limits {within}){stays}"
        return q, ""

    def _watch(self) -> None:
        """Note how far the motion is, and its end."""
        self.done = self.plans.fraction
        if self.plans.state != OFF:
            return
        robot, off, arrived, why = self.robot, self.plans.off, self.plans.arrived, self.plans.why
        self._stream.cancel()
        self._clear()
        there = f"{robot} has arrived; its tip was at most {off / MM:.2f} mm from its path."
        self._tell(there if arrived else why, not arrived)

    def _tell(self, text: str, bad: bool) -> None:
        """Tell how planning mode has ended."""
        self.said, self.bad, self._told = text, bad, self._world().t

    # -- what surrounds the arm -----------------------------------------------------------------------

    def _at(self, robot: str) -> Array:
        """Return the present joint values (n,) of an arm."""
        signals = self._world().signals
        return signals[f"{robot}.encoder" if f"{robot}.encoder" in signals else f"{robot}.q"]

    def _enter(self) -> None:
        """Note where the other robots stand; the geometry is loaded again if one has moved since the last plan."""
        signals, names = self._world().signals, [p.name for p in self._scene.places if p.name != self.robot]
        others = {n: signals[f"{n}.q"] for n in names if f"{n}.q" in signals}
        same = self._room is not None and self._room.robot == self.robot and others.keys() == self._stands.keys()
        if same and all(np.abs(q - self._stands[n]).max() <= _MOVED for n, q in others.items()):
            return
        self._stands = others
        links = self._world().link_poses()
        poses = {n: dict(links[n]) for n in others}
        self._room, self.ready = Room(next(self._numbers), self._source, self.robot, poses), False

    def _require_room(self) -> Room:
        assert self._room is not None
        return self._room

    def _limits(self) -> tuple[float, float]:
        """Return the largest speed in m/s and rad/s of the tool on a planned motion."""
        if (t := self._scene.trainer) is None or self.robot not in self._machines:
            return _SPEED, _TURN
        return min(_SPEED, _SHARE * t.speed_mm_s * MM), min(_TURN, _SHARE * t.turn_deg_s * DEG)

    # -- state ----------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any] | None:
        """Return the state for displays; None if there is nothing to show."""
        if self.phase == "off" and (not self.said or self._world().t - self._told > _SAID):
            return None
        out: dict[str, Any] = {"phase": self.phase, "hand": self.hand, "robot": self.robot}
        return out | {
            "said": self.said,
            "bad": self.bad,
            "blocked": self.blocked,
            "ready": self.ready,
            "done": round(self.done, 2),
        }


def _links(mechanism: Mechanism) -> Callable[[Array], Mapping[str, Array]]:
    """Return the function from joint values to link poses of the reference model."""
    from twin.reference import ReferenceModel

    model = ReferenceModel(mechanism)
    return lambda q: model.solve(q).link_poses
