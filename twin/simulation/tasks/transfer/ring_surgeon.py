"""A simulated surgeon, with a random seed, who moves rings from pegs on a wall to pegs on a floor, with both hands.

Both hands work at the same time, each with a ring for a peg on its side: they open, move to the ring, grasp its wire
from the side, lift the ring, pull it off, rotate it on the way to its peg, put it over the end of the peg, and open. If
a ring slips before it has left its first peg, the hand tries again; a ring that has fallen to the floor is left there.
The motion of the hands is in `devices.surgeon_hands`; all habits are ASSUMED.

In the tool frame, z points ahead, out of the jaws, and the jaws close along y; they are interchangeable. The tip of the
jaws is at `SeenArm.T_tool_tip`. The z axis of a ring's pose is the ring's axis; that of the picture points from the
scene towards the camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.simulation.devices.hand import HandMotion
from twin.simulation.devices.surgeon_hands import Habits, Seat, SurgeonHands
from twin.simulation.world.signal_kinds import OBJECT_HOLDER, OBJECT_POSE, SURGEON_TARGET

_TRIES = 3
"""Number of grasps of a ring after which the surgeon gives up this ring."""

_FLAT = 0.8
"""Cosine of the angle between a ring's axis and the vertical above which the ring counts as lying flat; ASSUMED."""

_REST_BEFORE = 0.3
_REST_AFTER = 0.5
_REST_CLOSED = 0.15
_REST_OPENED = 0.3
"""Times in s for which the hands rest: before and after the work, after the jaws have closed, and after they have
opened; ASSUMED."""

HABITS = Habits(hand=HandMotion(reach=(0.05, 2.5), speed=(0.08, 0.9), pause=0.3), open=30 * DEG, central=0.6)
"""Habits in handling rings: the hands turn further than in touching points, and wait less after a stroke."""


@dataclass(frozen=True)
class Ring:
    """A ring to bring to a peg; lengths in m.

    Attributes:
        name: name of the ring.
        radius, wire: radius of the ring (of the centre line of its wire), and radius of the wire.
        peg: name of the peg.
        end, foot: (3,) free end and other end of the peg in the World.
    """

    name: str
    radius: float
    wire: float
    peg: str
    end: Array
    foot: Array


@dataclass(frozen=True)
class RingHabits:
    """Parameters of the handling of a ring, in m and rad; all ASSUMED.

    Attributes:
        beyond: length by which the tips of the jaws extend beyond the held wire.
        side: angle from the vertical at which an upright ring is grasped, on the side of the hand.
        before: distance of the jaws from the wire before they approach it, and after they retreat.
        lift: distance by which a ring is lifted before it is pulled off.
        pull: distance by which the ring is pulled off its first peg.
        above, below: distance by which the ring's centre is above the end of its peg before the ring is lowered, and
            below this end when the ring is released.
        tilt: angle at which a ring is put over its peg, its far side lower than the near one.
        near, fine: distance from the target at which a rough movement ends, and at which a fine movement ends.
    """

    beyond: float = 1.0 * MM
    side: float = 50 * DEG
    before: float = 14 * MM
    lift: float = 2.5 * MM
    pull: float = 24 * MM
    above: float = 9 * MM
    below: float = 8 * MM
    tilt: float = 30 * DEG
    near: float = 1.5 * MM
    fine: float = 0.5 * MM


class RingSurgeon(SurgeonHands):
    """Writes what `SurgeonHands` writes, and `surgeon.target`: number of rings that the surgeon has put on pegs.

    The surgeon reads the poses of rings from `<ring>.pose`, and whether jaws hold a ring from `<ring>.holder`.

    Attributes:
        missed: names of the rings that the surgeon gave up.
    """

    def __init__(self, seat: Seat, rings: Sequence[Ring]) -> None:
        """Connect the surgeon to a console; `rings`: the rings in the order of work."""
        self.rings = tuple(rings)
        self.manner = RingHabits()
        # by hand: 1 if the tool's y axis points along a grasped ring's axis away from the camera, -1 if towards it
        self._turned: dict[str, float] = {}
        self._numbers: dict[str, int] = {}  # of the grippers, as in `<ring>.holder`
        for k, eye in enumerate(seat.arms.values()):
            self._numbers[eye.robot] = k
        self._done = 0
        self._remaining: list[Ring] = list(rings)
        self._tried: dict[str, int] = {}
        for ring in rings:
            self._tried[ring.name] = 0
        super().__init__(seat, HABITS)  # last, because it calls `_output_signals`, which needs the attributes above

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        values = super()._output_signals(k)
        values[SURGEON_TARGET.name] = float(self._done)
        return values

    # -- what the surgeon sees ------------------------------------------------------------------------

    def _ring(self, ring: Ring) -> Array:
        """Return the pose (4, 4) of a ring in the World."""
        return self._signals[OBJECT_POSE.of(ring.name)].reshape(4, 4)

    def _holds(self, hand: str, ring: Ring) -> bool:
        holder = int(self._signals[OBJECT_HOLDER.of(ring.name)].item())
        return holder == self._numbers[self.arms[hand].robot]

    def _lies(self, ring: Ring) -> bool:
        """Return whether a ring has fallen: it lies flat, and not around its peg."""
        is_flat = abs(self._ring(ring)[2, 2]) > _FLAT
        return is_flat and not self._around(ring)

    def _around(self, ring: Ring) -> bool:
        """Return whether the peg of a ring passes through it."""
        T = spatial.inverse(self._ring(ring))
        foot = T[:3, :3] @ ring.foot + T[:3, 3]
        end = T[:3, :3] @ ring.end + T[:3, 3]
        if foot[2] * end[2] > 0:  # both ends of the peg are on one side of the ring's plane
            return False
        crossing = foot + (end - foot) * (foot[2] / (foot[2] - end[2]))
        return float(np.hypot(crossing[0], crossing[1])) < ring.radius

    # -- actions: each generator yields once per tick -------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._rest(_REST_BEFORE)
        yield from self._show()
        while jobs := self._next():
            centres = {}
            for hand, ring in jobs.items():
                centres[hand] = self._ring(ring)[:3, 3]
            yield from self._look(centres)
            yield from self._bring(jobs)
            self._judge(jobs)
        yield from self._rest(_REST_AFTER)

    def _next(self) -> dict[str, Ring]:
        """Return {hand: its next ring}; a ring is for the hand on the side where its peg is in the picture."""
        right, left = self.arms
        first: dict[str, Ring] = {}
        for ring in self._remaining:
            peg_seen = self._in_picture({right: ring.end})[right]
            hand = left
            if peg_seen[0] > 0:
                hand = right
            first.setdefault(hand, ring)
        # in the order of the hands, in which random numbers are drawn
        jobs = {}
        for hand in self.arms:
            if hand in first:
                jobs[hand] = first[hand]
        return jobs

    def _judge(self, jobs: Mapping[str, Ring]) -> None:
        for ring in jobs.values():
            self._tried[ring.name] += 1
            if self._around(ring):
                self._done += 1
                self._remaining.remove(ring)
            elif self._lies(ring) or self._tried[ring.name] >= _TRIES:
                self.missed.append(ring.name)
                self._remaining.remove(ring)

    def _bring(self, jobs: dict[str, Ring]) -> Iterator[None]:
        """Try to bring the ring of each hand to its peg."""
        manner = self.manner
        yield from self._turn_grip(dict.fromkeys(jobs, self.habits.open))
        before = {}
        for hand, grasp in self._grasps(jobs).items():
            before[hand] = grasp @ spatial.pose(p=[0, 0, -manner.before])
        yield from self._reach(before, manner.near)
        # seen again, because the first look was from afar
        yield from self._reach(self._grasps(jobs), manner.fine)
        yield from self._turn_grip(dict.fromkeys(jobs, 0.0))
        yield from self._rest(_REST_CLOSED)
        failed = []
        jobs_held = {}
        for hand, ring in jobs.items():
            if self._holds(hand, ring):
                jobs_held[hand] = ring
            else:
                failed.append(hand)
        if failed:
            yield from self._let_go(failed)
        lifted = {}
        for hand in jobs_held:
            lifted[hand] = spatial.pose(p=[0, 0, manner.lift]) @ self._tool(hand)
        yield from self._reach(lifted, manner.fine)
        pulled_off = {}
        for hand, ring in jobs_held.items():
            pulled_off[hand] = spatial.pose(p=self._outwards(ring) * manner.pull) @ self._tool(hand)
        yield from self._reach(pulled_off, manner.near)
        yield from self._reach(self._over_pegs(jobs_held, manner.above), manner.near)
        yield from self._reach(self._over_pegs(jobs_held, -manner.below), 2 * manner.fine)
        yield from self._let_go(list(jobs_held))

    def _grasps(self, jobs: Mapping[str, Ring]) -> dict[str, Array]:
        """Return {hand: pose (4, 4) of its tool at which it grasps its ring}."""
        grasps = {}
        for hand, ring in jobs.items():
            grasps[hand] = self._grasp(hand, ring)
        return grasps

    def _over_pegs(self, jobs: Mapping[str, Ring], height: float) -> dict[str, Array]:
        """Return {hand: pose (4, 4) of its tool with its ring at a height in m above the peg}, if it holds the ring."""
        goals = {}
        for hand, ring in jobs.items():
            if self._holds(hand, ring):
                goals[hand] = self._over(hand, ring, height)
        return goals

    def _let_go(self, hands: Sequence[str]) -> Iterator[None]:
        yield from self._turn_grip(dict.fromkeys(hands, self.habits.open))
        yield from self._rest(_REST_OPENED)
        drawn_back = {}
        for hand in hands:
            drawn_back[hand] = self._tool(hand) @ spatial.pose(p=[0, 0, -self.manner.before])
        yield from self._reach(drawn_back, self.manner.near)

    def _outwards(self, ring: Ring) -> Array:
        """Return the axis (3,) of a ring, with the sign that makes it point towards the camera."""
        n = self._ring(ring)[:3, 2]
        if n @ self._view()[:3, 2] > 0:
            return n
        return -n

    def _grasp(self, hand: str, ring: Ring) -> Array:
        """Return the tool's pose (4, 4) in the World with the open jaws on both sides of a ring's wire.

        The jaws point to the centre of the ring, from above and from the hand's side: the direction of approach is in
        the ring's plane, at the angle `RingHabits.side` from the vertical as projected on this plane. They close along
        the ring's axis.
        """
        centre = self._ring(ring)[:3, 3]
        n = -self._outwards(ring)  # away from the camera
        right, _ = self.arms
        aside = self._view()[:3, 0]
        if hand != right:
            aside = -aside
        # sideways and upwards within the plane of the ring
        aside = aside - n * (n @ aside)
        up = np.cross(n, np.cross([0.0, 0.0, 1.0], n))
        approach = np.cos(self.manner.side) * _unit(up) + np.sin(self.manner.side) * _unit(aside)
        # The jaws are interchangeable: at the first grasp, the hand uses the orientation that needs less rotation.
        sign = 1.0 if n @ self._tool(hand)[:3, 1] > 0 else -1.0
        y = n * self._turned.setdefault(hand, sign)
        R = np.column_stack([np.cross(y, -approach), y, -approach])
        return spatial.pose(R, centre + (ring.radius + self._ahead(hand)) * approach)

    def _ahead(self, hand: str) -> float:
        """Return the distance in m from the tool to the wire that the jaws hold."""
        return float(self.arms[hand].T_tool_tip[2, 3]) - self.manner.beyond

    def _over(self, hand: str, ring: Ring, height: float) -> Array:
        """Return the tool's pose (4, 4) with the centre of the held ring at a height in m above the end of its peg.

        The side of the ring that was towards the camera at the grasp faces up, along the peg; tool and ring then tilt
        together by `RingHabits.tilt`, the jaws downwards. The ring does not move in the jaws.
        """
        T = self._tool(hand)
        T_ring = self._ring(ring)
        up = _unit(ring.end - ring.foot)
        # the direction of the jaws, across the peg
        ahead = _unit(T[:3, 2] - up * (up @ T[:3, 2]))
        tilt = self.manner.tilt
        z = np.cos(tilt) * ahead - np.sin(tilt) * up
        # the ring's axis, upwards, is -y or y, depending on how the ring was grasped
        y = -self._turned[hand] * (np.sin(tilt) * ahead + np.cos(tilt) * up)
        R = np.column_stack([np.cross(y, z), y, z])
        centre_in_tool = T[:3, :3].T @ (T_ring[:3, 3] - T[:3, 3])
        return spatial.pose(R, ring.end + height * up - R @ centre_in_tool)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v)
