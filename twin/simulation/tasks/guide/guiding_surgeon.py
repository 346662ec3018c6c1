"""A simulated surgeon, with a random seed, who hands a ring over in a dome and guides it along a wire, with two arms.

A planner (`tasks.guide.ways`) computes paths ("ways") into the dome and out of it; the hands follow these paths. The
first arm grasps the ring on the tower and brings the ring to the meeting place. The second arm grasps the ring there,
brings it to the free end of the wire and guides it to the other end. The motion of the hands is in
`devices.surgeon_hands`; all habits are ASSUMED.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import KinematicsError, ProtocolError, WorldError, unknown
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.movable import Movable
from twin.simulation.contact_scene import WireCourse
from twin.simulation.devices.hand import HandMotion
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.tasks.guide.task import KIND, Mistake
from twin.simulation.tasks.guide.ways import Ways

_TRIES = 3
"""Maximum number of grasps of the ring, and of searches for a way, before the surgeon gives up."""

HABITS = Habits(hand=HandMotion(reach=(0.05, 2.5), speed=(0.08, 0.9), pause=0.2), open=30 * DEG)


@dataclass(frozen=True)
class GuidingHabits:
    """Parameters of the handling of the ring, in m and rad; all ASSUMED.

    Attributes:
        sides: angle from the vertical, in the plane of the ring and towards the camera, at which the first and the
            second arm grasp the ring.
        beyond: length by which the tips of the jaws extend beyond the wire of the held ring.
        before: distance of the jaws from the ring before they approach it, and after they retreat.
        lift: distance by which the ring is lifted out of its pocket.
        meet: (3,) position of the meeting place of both arms, relative to the free end of the wire.
        ahead: distance of the ring from the free end of the wire before the ring is put over this end.
        step: length of the wire along which the ring is guided in one movement.
        last: distance of the ring from the end of the wire when the ring is released.
        fallen: largest depth of the ring below the free end of the wire at which the surgeon still tries to grasp the
            ring.
        near, fine: distance from the target at which a rough movement ends, and at which a fine movement ends.
    """

    sides: tuple[float, float] = (-10 * DEG, 45 * DEG)
    beyond: float = 1.0 * MM
    before: float = 14 * MM
    lift: float = 10 * MM
    meet: tuple[float, float, float] = (0.0, -2 * MM, 14 * MM)
    ahead: float = 8 * MM
    step: float = 4 * MM
    last: float = 1 * MM
    fallen: float = 12 * MM
    near: float = 1.5 * MM
    fine: float = 0.6 * MM


class GuidingSurgeon(SurgeonHands):
    """Writes what `SurgeonHands` writes, and `surgeon.target`: number of the step of the task.

    The surgeon reads the pose of the ring from `<ring>.pose`, and which jaws hold the ring from `<ring>.holder`. The
    frame `T_tool_tip` of each arm is at its closed jaws: z out of the tips, y along the closing direction.

    Attributes:
        missed: what the surgeon gave up: names of steps, or "way of <robot>: <reason>".
    """

    def __init__(
        self,
        seat: Seat,
        ring: Movable,
        course: WireCourse,
        first: str,
        ways: Ways,
        mistake: str = "",
    ) -> None:
        """Connect the surgeon to a console.

        Args:
            seat: the console; `T_tool_tip` of its arms is the frame of their closed jaws.
            ring: the ring.
            course: wire and dome.
            first: the hand that picks the ring up.
            ways: plans the ways into the dome and out of it.
            mistake: a mistake to make, "": none.

        Raises:
            WorldError: there is no such mistake.
        """
        if mistake not in get_args(Mistake):
            raise WorldError(unknown("mistake", mistake, KIND.mistakes))
        self.ring, self.course, self.mistake, self.manner = ring, course, mistake, GuidingHabits()
        self._first, self._ways, self._seed = first, ways, seat.seed
        (self._second,) = (hand for hand in seat.arms if hand != first)
        self._numbers = {hand: k for k, hand in enumerate(seat.arms)}
        self._flips: dict[str, float] = {}
        self._rests: dict[str, Array] = {}
        self._stage = 0
        lengths = np.linalg.norm(np.diff(course.wire, axis=0), axis=1)
        self._along = np.concatenate([[0.0], np.cumsum(lengths)])
        super().__init__(seat, HABITS)

    def _said(self, k: int) -> dict[str, ArrayLike]:
        return super()._said(k) | {"surgeon.target": float(self._stage)}

    # -- what the surgeon sees ------------------------------------------------------------------------

    def _pose(self) -> Array:
        """Return the pose (4, 4) of the ring in the World."""
        return self._signals[f"{self.ring.name}.pose"].reshape(4, 4)

    def _holder(self) -> int:
        return int(self._signals[f"{self.ring.name}.holder"].item())

    def _axis(self, towards: Array) -> Array:
        """Return the axis (3,) of the ring, with the sign that makes `axis . towards` non-negative."""
        n = self._pose()[:3, 2]
        return n if n @ towards >= 0 else -n

    def _wire(self, s: float) -> tuple[Array, Array]:
        """Return point (3,) and direction (3,) of the wire at arc length s in m from its free end, or extrapolated."""
        a, b = (self._on_wire(s + d) for d in (-self.manner.step / 2, self.manner.step / 2))
        return self._on_wire(s), (b - a) / np.linalg.norm(b - a)

    def _on_wire(self, s: float) -> Array:
        wire, along = self.course.wire, self._along
        k = int(np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(wire) - 2))
        return wire[k] + (s - along[k]) / (along[k + 1] - along[k]) * (wire[k + 1] - wire[k])

    # -- poses ----------------------------------------------------------------------------------------

    def _grasp(self, hand: str, centre: Array, n: Array, back: float = 0.0) -> Array:
        """Return the tool pose (4, 4) at which the jaws grasp a ring with the given centre (3,) and axis n (3,).

        The jaws point to the centre and close along the axis. `back`: distance in m by which the jaws are drawn back.
        """
        return self._gripping(hand, centre, n, self._flips[hand], back)

    def _gripping(self, hand: str, centre: Array, n: Array, flip: float, back: float = 0.0) -> Array:
        up = np.array([0.0, 0.0, 1.0]) - n[2] * n
        up /= np.linalg.norm(up)
        near, side = np.cross(n, up), self.manner.sides[hand != self._first]
        out = np.cos(side) * up + np.sin(side) * near
        y = flip * n
        R = np.column_stack([np.cross(y, -out), y, -out])
        tip = centre + (self.ring.size[0] - self.manner.beyond + back) * out
        return spatial.pose(R, tip) @ spatial.inverse(self.arms[hand].T_tool_tip)

    def _flip(self, hand: str, places: Sequence[tuple[Array, Array]]) -> float:
        """Return the sign of the closing direction, 1 or -1, that is farther from joint limits in all of the grasps.

        A grasp is given by centre (3,) and axis (3,) of the ring.
        """
        robot = self.arms[hand].robot
        q, room = self._signals[f"{robot}.q"], {}
        for flip in (1.0, -1.0):
            try:
                goals = [self._ways.joints(robot, self._gripping(hand, c, n, flip), q) for c, n in places]
                room[flip] = min(self._ways.room(robot, x) for x in goals)
            except KinematicsError:
                room[flip] = -np.inf
        return max(room, key=lambda flip: room[flip])

    def _carrying(self, hand: str, centre: Array, n: Array) -> Array:
        """Return the tool pose (4, 4) at which the ring, as grasped now, has the given centre (3,) and axis n (3,)."""
        T, T_ring = self._tool(hand), self._pose()
        R = self._grasp(hand, centre, n)[:3, :3]
        held = R @ T[:3, :3].T @ self._axis(T[:3, :3] @ R.T @ n)
        R = _turning(held, n) @ R
        return spatial.pose(R, centre - R @ T[:3, :3].T @ (T_ring[:3, 3] - T[:3, 3]))

    # -- actions: each generator yields once per tick -------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        self._rests = {hand: self._signals[f"{eye.robot}.q"].copy() for hand, eye in self.arms.items()}
        for stage, step in enumerate((self._enter, self._pick_up, self._hand_over, self._guide, self._retract)):
            self._stage = stage
            yield from step()
            if self.missed:
                break
        yield from self._rest(0.5)

    def _give_up(self, step: str) -> None:
        self.missed.append(step)

    def _meeting(self) -> tuple[Array, Array]:
        """Return centre and axis (3,) of the ring at the meeting place."""
        start, n = self._wire(0.0)
        return start + self.manner.meet, n

    def _enter(self) -> Iterator[None]:
        """Bring both arms into the dome: the first close to the ring, the second close to the meeting place."""
        start, n = self._meeting()
        ends = [self._wire(s) for s in np.arange(-self.manner.ahead, self._along[-1], self.manner.step)]
        centre, axis = self._pose()[:3, 3].copy(), self._axis(n).copy()
        self._flips[self._first] = self._flip(self._first, [(centre, axis), (start, n)])
        self._flips[self._second] = self._flip(self._second, [(start, n), *ends])
        yield from self._turn_grip(dict.fromkeys(self.arms, self.habits.open))
        yield from self._follow(self._first, self._grasp(self._first, centre, axis, self.manner.before))
        yield from self._follow(self._second, self._grasp(self._second, start, n, 2 * self.manner.before))

    def _pick_up(self) -> Iterator[None]:
        """Grasp the ring on the tower, and lift it out of its pocket."""
        hand, n = self._first, self._meeting()[1]
        yield from self._seize(hand, n)
        if self._holder() != self._numbers[hand]:
            self._give_up("picked up")
            return
        goal, n = self._pose()[:3, 3] + [0.0, 0.0, self.manner.lift], self._axis(n).copy()
        yield from self._reach({hand: self._carrying(hand, goal, n)}, self.manner.near)

    def _seize(self, hand: str, towards: Array) -> Iterator[None]:
        """Try to grasp the ring, at most `_TRIES` times; `towards` (3,) selects the sign of its axis, see `_axis`."""
        manner = self.manner
        for _ in range(_TRIES):
            if self._wire(0.0)[0][2] - self._pose()[2, 3] > manner.fallen:
                return
            n = self._axis(towards)
            yield from self._turn_grip({hand: self.habits.open})
            for back, near in ((manner.before, manner.near), (0.0, manner.fine)):
                yield from self._reach({hand: self._grasp(hand, self._pose()[:3, 3], n, back)}, near)
            yield from self._turn_grip({hand: 0.0})
            yield from self._rest(0.2)
            if self._holder() == self._numbers[hand]:
                return
            yield from self._let_go(hand)

    def _let_go(self, hand: str) -> Iterator[None]:
        yield from self._turn_grip({hand: self.habits.open})
        yield from self._rest(0.3)
        back = self._tool(hand) @ self.arms[hand].T_tool_tip
        back = back @ spatial.pose(p=[0, 0, -self.manner.before]) @ spatial.inverse(self.arms[hand].T_tool_tip)
        yield from self._reach({hand: back}, self.manner.near)

    def _hand_over(self) -> Iterator[None]:
        """Bring the ring to the meeting place, hand it to the second arm, and move the first arm out of the dome."""
        first, second, manner = self._first, self._second, self.manner
        centre, n = self._meeting()
        yield from self._reach({first: self._carrying(first, centre, n)}, manner.near)
        yield from self._reach({first: self._carrying(first, centre, n)}, manner.fine)
        if self.mistake == "not_handed_over":
            return
        if self.mistake == "dropped":
            yield from self._let_go(first)
        yield from self._seize(second, n)
        if self._holder() != self._numbers[second]:
            self._give_up("handed over")
            return
        yield from self._let_go(first)
        if self.mistake != "left_inside":
            yield from self._out(first)

    def _guide(self) -> Iterator[None]:
        """Put the ring over the free end of the wire, guide it to the other end, and release it there."""
        hand, manner = self._first if self.mistake == "not_handed_over" else self._second, self.manner
        end = self._along[-1] * (0.5 if self.mistake == "stopped_short" else 1.0) - manner.last
        for s in (-manner.ahead, *np.arange(0.0, end, manner.step), end):
            place, n = self._wire(s)
            if self.mistake == "wire_touched" and 0 <= s < end / 2:  # the ring lies on the wire
                place = place - [0.0, 0.0, self.ring.size[0] - 1.75 * self.ring.size[1]]
            goal = self._carrying(hand, place, n)
            yield from self._reach({hand: goal}, manner.near if s < 0 else manner.fine)
            if self._holder() != self._numbers[hand]:
                self._give_up("guided")
                return
        yield from self._let_go(hand)

    def _retract(self) -> Iterator[None]:
        """Move the second arm out of the dome."""
        hand = self._first if self.mistake == "not_handed_over" else self._second
        if self.mistake == "wall_hit":
            wall = spatial.pose(p=[60 * MM, 0.0, 0.0]) @ self._tool(hand)
            yield from self._reach({hand: wall}, 30 * MM)
            yield from self._out(hand)
        elif self.mistake != "left_inside":
            yield from self._out(hand)

    def _out(self, hand: str) -> Iterator[None]:
        """Move an arm back to its start."""
        eye = self.arms[hand]
        T = eye.T_world_base @ eye.kin.forward(self._rests[hand])
        yield from self._follow(hand, T, self._rests[hand])

    def _follow(self, hand: str, T: Array, q: Array | None = None) -> Iterator[None]:
        """Plan a path of an arm to a tool pose T (4, 4), optionally with joint values q (n,) there, and follow it."""
        eye, robot = self.arms[hand], self.arms[hand].robot
        now = {
            name: self._signals[f"{name}.q"].copy() for name in (*(e.robot for e in self.arms.values()), self.camera)
        }
        things = {self.ring.name: self._pose().copy()}
        problem: Exception | None = None
        for trial in range(_TRIES):
            try:
                if q is None:
                    goal = self._ways.joints(robot, T, now[robot])
                else:
                    goal = np.where(eye.kin.auxiliary, now[robot], q)
                clearance = self._ways.clearance / 2**trial  # an arm that let the ring go may be near the wall
                way = self._ways.plan(robot, goal, now, things, clearance, _TRIES * self._seed + trial)
            except (ProtocolError, KinematicsError) as error:
                problem = error
                continue
            for station in way[:-1]:
                yield from self._reach({hand: station}, 2 * self.manner.near, 8 * DEG)
            yield from self._reach({hand: way[-1]}, self.manner.near)
            return
        self._give_up(f"way of {robot}: {problem}")


def _turning(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns a direction a (3,) to b (3,)."""
    w = np.cross(a, b)
    angle = float(np.arctan2(np.linalg.norm(w), a @ b))
    return spatial.exp_so3(w / max(float(np.linalg.norm(w)), 1e-12) * angle)
