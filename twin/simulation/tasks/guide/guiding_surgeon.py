"""A simulated surgeon, with a random seed, who hands a ring over in a dome and guides it along a wire, with two arms.

A planner (`tasks.guide.arm_paths`) computes paths into the dome and out of it; the hands follow these paths. The first
arm grasps the ring on the tower and brings the ring to the meeting place. The second arm grasps the ring there,
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
from twin.simulation.tasks.guide.arm_paths import ArmPaths
from twin.simulation.tasks.guide.task import KIND, Mistake
from twin.simulation.world.signal_kinds import OBJECT_HOLDER, OBJECT_POSE, ROBOT_Q, SURGEON_TARGET

_LARGEST_TRIES = 3
"""Maximum number of grasps of the ring, and of searches for a path, before the surgeon gives up."""

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
        paths: ArmPaths,
        mistake: str = "",
    ) -> None:
        """Connect the surgeon to a console.

        Args:
            seat: the console; `T_tool_tip` of its arms is the frame of their closed jaws.
            ring: the ring.
            course: wire and dome.
            first: the hand that picks the ring up.
            paths: plans the paths into the dome and out of it.
            mistake: a mistake to make, "": none.

        Raises:
            WorldError: there is no such mistake.
        """
        if mistake not in get_args(Mistake):
            raise WorldError(unknown("mistake", mistake, KIND.mistakes))
        self.ring = ring
        self.course = course
        self.mistake = mistake
        self.manner = GuidingHabits()
        self._first = first
        (self._second,) = set(seat.arms) - {first}
        self._paths = paths
        self._seed = seat.seed
        self._gripper_numbers: dict[str, int] = {}  # of the grippers, as in `<ring>.holder`
        for k, hand in enumerate(seat.arms):
            self._gripper_numbers[hand] = k
        self._closing_signs: dict[str, float] = {}
        self._start_q: dict[str, Array] = {}
        self._step_number = 0
        lengths = np.linalg.norm(np.diff(course.wire, axis=0), axis=1)
        self._arc_lengths = np.concatenate([[0.0], np.cumsum(lengths)])
        super().__init__(seat, HABITS)

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[SURGEON_TARGET.name] = float(self._step_number)
        return values

    # -- what the surgeon sees ------------------------------------------------------------------------

    def _pose(self) -> Array:
        """Return the pose (4, 4) of the ring in the World."""
        return self._signals[OBJECT_POSE.of(self.ring.name)].reshape(4, 4)

    def _holder(self) -> int:
        return int(self._signals[OBJECT_HOLDER.of(self.ring.name)].item())

    def _axis(self, towards: Array) -> Array:
        """Return the axis (3,) of the ring, with the sign that makes `axis . towards` non-negative."""
        n = self._pose()[:3, 2]
        if n @ towards >= 0:
            return n
        return -n

    def _wire(self, s: float) -> tuple[Array, Array]:
        """Return point (3,) and direction (3,) of the wire at arc length s in m from its free end, or extrapolated."""
        # the direction between two points, so that it does not jump at the nodes of the wire
        before = self._on_wire(s - self.manner.step / 2)
        after = self._on_wire(s + self.manner.step / 2)
        along = after - before
        return self._on_wire(s), along / np.linalg.norm(along)

    def _on_wire(self, s: float) -> Array:
        """Return the point (3,) of the wire at arc length s in m; outside, the first or last segment is extended."""
        wire = self.course.wire
        starts = self._arc_lengths
        k = int(np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(wire) - 2))
        fraction = (s - starts[k]) / (starts[k + 1] - starts[k])
        return wire[k] + fraction * (wire[k + 1] - wire[k])

    # -- poses ----------------------------------------------------------------------------------------

    def _grasp(self, hand: str, centre: Array, n: Array, back: float = 0.0) -> Array:
        """Return the tool pose (4, 4) at which the jaws grasp a ring with the given centre (3,) and axis n (3,).

        The jaws point to the centre and close along the axis. `back`: distance in m by which the jaws are drawn back.
        """
        return self._gripping(hand, centre, n, self._closing_signs[hand], back)

    def _gripping(self, hand: str, centre: Array, n: Array, sign: float, back: float = 0.0) -> Array:
        """Return the pose of `_grasp` for a sign of the closing direction, `sign`."""
        # `up` and `aside` span the plane of the ring
        up = np.array([0.0, 0.0, 1.0]) - n[2] * n
        up /= np.linalg.norm(up)
        aside = np.cross(n, up)
        first_side, second_side = self.manner.sides
        side = first_side if hand == self._first else second_side
        approach = np.cos(side) * up + np.sin(side) * aside
        y = sign * n
        R = np.column_stack([np.cross(y, -approach), y, -approach])
        radius = self.ring.size[0]
        tip = centre + (radius - self.manner.beyond + back) * approach
        return spatial.pose(R, tip) @ spatial.inverse(self.arms[hand].T_tool_tip)

    def _closing_sign(self, hand: str, places: Sequence[tuple[Array, Array]]) -> float:
        """Return the sign of the closing direction, 1 or -1, that is farther from joint limits in all of the grasps.

        A grasp is given by centre (3,) and axis (3,) of the ring.
        """
        room = self._room(hand, places, 1.0)
        room_flipped = self._room(hand, places, -1.0)
        if room_flipped > room:
            return -1.0
        return 1.0

    def _room(self, hand: str, places: Sequence[tuple[Array, Array]], sign: float) -> float:
        """Return the smallest distance from limits in all of the grasps, see `ArmPaths.room`; -inf: out of reach."""
        robot = self.arms[hand].robot
        q = self._signals[ROBOT_Q.of(robot)]
        room = np.inf
        for centre, n in places:
            try:
                goal = self._paths.joints(robot, self._gripping(hand, centre, n, sign), q)
            except KinematicsError:
                return -np.inf
            room = min(room, self._paths.room(robot, goal))
        return room

    def _carrying(self, hand: str, centre: Array, n: Array) -> Array:
        """Return the tool pose (4, 4) at which the ring, as grasped now, has the given centre (3,) and axis n (3,)."""
        T = self._tool(hand)
        R_now = T[:3, :3]
        R = self._grasp(hand, centre, n)[:3, :3]
        # The ring may be tilted in the jaws: the axis that it would have in this pose, and the turn that corrects it.
        held_axis = R @ R_now.T @ self._axis(R_now @ R.T @ n)
        R = _turning(held_axis, n) @ R
        tool_to_centre = self._pose()[:3, 3] - T[:3, 3]
        return spatial.pose(R, centre - R @ R_now.T @ tool_to_centre)

    # -- actions: each generator yields once per tick -------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for hand, arm in self.arms.items():
            self._start_q[hand] = self._signals[ROBOT_Q.of(arm.robot)].copy()
        for number, step in enumerate((self._enter, self._pick_up, self._hand_over, self._guide, self._retract)):
            self._step_number = number
            yield from step()
            if self.missed:
                break
        yield from self._rest(0.5)

    def _meeting(self) -> tuple[Array, Array]:
        """Return centre and axis (3,) of the ring at the meeting place."""
        start, n = self._wire(0.0)
        return start + self.manner.meet, n

    def _enter(self) -> Iterator[None]:
        """Bring both arms into the dome: the first close to the ring, the second close to the meeting place."""
        meeting, n = self._meeting()
        centre = self._pose()[:3, 3].copy()
        axis = self._axis(n).copy()
        grasps = [(meeting, n)]
        for s in np.arange(-self.manner.ahead, self._arc_lengths[-1], self.manner.step):
            grasps.append(self._wire(s))
        self._closing_signs[self._first] = self._closing_sign(self._first, [(centre, axis), (meeting, n)])
        self._closing_signs[self._second] = self._closing_sign(self._second, grasps)
        yield from self._turn_grip(dict.fromkeys(self.arms, self.habits.open))
        yield from self._follow(self._first, self._grasp(self._first, centre, axis, self.manner.before))
        yield from self._follow(self._second, self._grasp(self._second, meeting, n, 2 * self.manner.before))

    def _pick_up(self) -> Iterator[None]:
        """Grasp the ring on the tower, and lift it out of its pocket."""
        hand = self._first
        _, n = self._meeting()
        yield from self._seize(hand, n)
        if self._holder() != self._gripper_numbers[hand]:
            self.missed.append("picked up")
            return
        goal = self._pose()[:3, 3] + [0.0, 0.0, self.manner.lift]
        axis = self._axis(n).copy()
        yield from self._reach({hand: self._carrying(hand, goal, axis)}, self.manner.near)

    def _seize(self, hand: str, towards: Array) -> Iterator[None]:
        """Try to grasp the ring, at most `_LARGEST_TRIES` times.

        `towards` (3,) selects the sign of the ring's axis, see `_axis`.
        """
        manner = self.manner
        for _ in range(_LARGEST_TRIES):
            free_end, _ = self._wire(0.0)
            depth = free_end[2] - self._pose()[2, 3]
            if depth > manner.fallen:
                return
            n = self._axis(towards)
            yield from self._turn_grip({hand: self.habits.open})
            for back, tolerance in ((manner.before, manner.near), (0.0, manner.fine)):
                grasp = self._grasp(hand, self._pose()[:3, 3], n, back)
                yield from self._reach({hand: grasp}, tolerance)
            yield from self._turn_grip({hand: 0.0})
            yield from self._rest(0.2)
            if self._holder() == self._gripper_numbers[hand]:
                return
            yield from self._let_go(hand)

    def _let_go(self, hand: str) -> Iterator[None]:
        yield from self._turn_grip({hand: self.habits.open})
        yield from self._rest(0.3)
        T_tool_tip = self.arms[hand].T_tool_tip
        drawn_back = self._tool(hand) @ T_tool_tip
        drawn_back = drawn_back @ spatial.pose(p=[0, 0, -self.manner.before]) @ spatial.inverse(T_tool_tip)
        yield from self._reach({hand: drawn_back}, self.manner.near)

    def _hand_over(self) -> Iterator[None]:
        """Bring the ring to the meeting place, hand it to the second arm, and move the first arm out of the dome."""
        first = self._first
        second = self._second
        centre, n = self._meeting()
        # twice, because the ring may have turned in the jaws on the way
        yield from self._reach({first: self._carrying(first, centre, n)}, self.manner.near)
        yield from self._reach({first: self._carrying(first, centre, n)}, self.manner.fine)
        if self.mistake == "not_handed_over":
            return
        if self.mistake == "dropped":
            yield from self._let_go(first)
        yield from self._seize(second, n)
        if self._holder() != self._gripper_numbers[second]:
            self.missed.append("handed over")
            return
        yield from self._let_go(first)
        if self.mistake != "left_inside":
            yield from self._out(first)

    @property
    def _guiding_hand(self) -> str:
        """The hand that guides the ring: the second one, except for a mistake."""
        if self.mistake == "not_handed_over":
            return self._first
        return self._second

    def _guide(self) -> Iterator[None]:
        """Put the ring over the free end of the wire, guide it to the other end, and release it there."""
        hand = self._guiding_hand
        manner = self.manner
        end = self._arc_lengths[-1] - manner.last
        if self.mistake == "stopped_short":
            end = self._arc_lengths[-1] * 0.5 - manner.last
        for s in (-manner.ahead, *np.arange(0.0, end, manner.step), end):
            centre, n = self._wire(s)
            if self.mistake == "wire_touched" and 0 <= s < end / 2:
                # so low that the ring hangs on the wire
                radius = self.ring.size[0]
                wire = self.ring.size[1]
                centre = centre - [0.0, 0.0, radius - 1.75 * wire]
            goal = self._carrying(hand, centre, n)
            yield from self._reach({hand: goal}, manner.near if s < 0 else manner.fine)
            if self._holder() != self._gripper_numbers[hand]:
                self.missed.append("guided")
                return
        yield from self._let_go(hand)

    def _retract(self) -> Iterator[None]:
        """Move the second arm out of the dome."""
        hand = self._guiding_hand
        if self.mistake == "left_inside":
            return
        if self.mistake == "wall_hit":
            wall = spatial.pose(p=[60 * MM, 0.0, 0.0]) @ self._tool(hand)
            yield from self._reach({hand: wall}, 30 * MM)
        yield from self._out(hand)

    def _out(self, hand: str) -> Iterator[None]:
        """Move an arm back to its start."""
        arm = self.arms[hand]
        T = arm.T_world_base @ arm.kin.forward(self._start_q[hand])
        yield from self._follow(hand, T, self._start_q[hand])

    def _follow(self, hand: str, T: Array, q: Array | None = None) -> Iterator[None]:
        """Plan a path of an arm to a tool pose T (4, 4), optionally with joint values q (n,) there, and follow it."""
        arm = self.arms[hand]
        robot = arm.robot
        # copies, because the signals go on while the arm moves
        q_now = {self.camera: self._signals[ROBOT_Q.of(self.camera)].copy()}
        for any_arm in self.arms.values():
            q_now[any_arm.robot] = self._signals[ROBOT_Q.of(any_arm.robot)].copy()
        objects = {self.ring.name: self._pose().copy()}
        problem: Exception | None = None
        for trial in range(_LARGEST_TRIES):
            # an arm that let the ring go may be near the wall
            clearance = self._paths.clearance / 2**trial
            try:
                if q is None:
                    goal = self._paths.joints(robot, T, q_now[robot])
                else:
                    goal = np.where(arm.kin.auxiliary, q_now[robot], q)
                path = self._paths.plan(robot, goal, q_now, objects, clearance, _LARGEST_TRIES * self._seed + trial)
            except (ProtocolError, KinematicsError) as error:
                problem = error
                continue
            for station in path[:-1]:
                yield from self._reach({hand: station}, 2 * self.manner.near, 8 * DEG)
            yield from self._reach({hand: path[-1]}, self.manner.near)
            return
        self.missed.append(f"way of {robot}: {problem}")


def _turning(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns a direction a (3,) to b (3,)."""
    normal = np.cross(a, b)
    sine = float(np.linalg.norm(normal))
    angle = float(np.arctan2(sine, a @ b))
    # of parallel directions the normal is 0: the rotation is none
    return spatial.exp_so3(normal / max(sine, 1e-12) * angle)
