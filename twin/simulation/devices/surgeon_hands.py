"""The hands and feet of a simulated surgeon at a console: strokes, grippers, pedals.

The hands move like the hand of `devices.hand`: with minimum jerk to reduce the remaining error in the picture, with
tremor and errors of judgement. If the targets are outside the middle of the picture, the surgeon moves the camera; if a
hand has left its comfortable range, it is moved back while the clutch is pressed. All of this is ASSUMED: hand motions
at such a console are not published.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.kinematics import Kinematics
from twin.simulation.devices.hand import HandMotion, Tremor, minimum_jerk
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CAMERA_VIEW,
    DEVICE_CAMERA,
    DEVICE_CLUTCH,
    DEVICE_SCALE,
    HAND_GRIP,
    HAND_POSE,
    ROBOT_Q,
)

_LARGEST_STALLS = 8
"""Number of strokes without progress after which the surgeon gives up a movement."""

_LARGEST_DRAGS = 20
"""Maximum number of camera strokes for one target; after these, the surgeon works with the picture as it is."""

_PROGRESS = 0.98
"""Largest ratio of the remaining error to the least one before that counts as progress; less may be tremor only."""

_LEAST_STROKE = 0.05
"""Share of a stroke within the ranges of the hands below which they are moved back with the clutch pressed; ASSUMED."""

_MOVE_BACK = 0.6
"""Time in s in which the hands are moved back to the middle of their ranges; ASSUMED."""

_SHORTEST_STROKE = 0.35
"""Shortest duration of a stroke in s; ASSUMED."""

_SHOW_TIME = 0.3
"""Time in s in which both handles are turned to meet the start condition; ASSUMED."""

_SHORT_REST = 0.1
"""Time in s for which the hands rest after they have pressed or released a pedal, or met the start condition; ASSUMED.
"""

_CENTRED_SHARE = 0.4
"""Size of the area into which the camera is moved once its pedal is pressed, divided by `Habits.central`; ASSUMED."""

_IDENTITY = np.eye(4)
"""Identity matrix; in every tick, a copy of this matrix is faster than a call of `np.eye`."""


@dataclass(frozen=True)
class Habits:
    """Parameters of the surgeon, SI; all ASSUMED.

    Attributes:
        hand: parameters of the motion of each hand.
        middle: middle of the right hand's range in m in {H}; that of the left hand is its mirror image.
        show: rotation of the handles in rad to meet the start condition, see `tool_following.is_held`.
        clutched: time in s for which the clutch is pressed before and after the hands move back.
        open: angle of the grippers on the way to a target.
        grasp: time in s in which the grippers open or close.
        central: size of the central area in which targets must be, as a fraction of half the picture.
        drag: motion of the scene divided by motion of the hands, as expected while the camera pedal is pressed.
        settle: time in s that the surgeon waits for the camera, whose speed is limited.
    """

    hand: HandMotion = field(default_factory=HandMotion)
    middle: tuple[float, float, float] = (0.08, 0.0, 0.0)
    show: float = 5 * DEG
    clutched: float = 0.15
    open: float = 30 * DEG
    grasp: float = 0.25
    central: float = 0.4
    drag: float = 0.2
    settle: float = 0.5


@dataclass(frozen=True)
class SeenArm:
    """One arm that the surgeon sees: its name in the World, its equations, and its base and tip frames (4, 4)."""

    robot: str
    kin: Kinematics
    T_world_base: Array
    T_tool_tip: Array


@dataclass(frozen=True)
class Seat:
    """Connection of a surgeon to a console: names of pedals, arms and camera, and parameters of the picture.

    Attributes:
        device: name of the device of the pedals.
        arms: {hand: its arm}; first the right hand, then the left hand, if the console has two hands. `SurgeonHands`
            needs two; a pen needs one.
        camera: name of the arm of the camera.
        view: angle of view over the height of the picture, in rad.
        scale: motion scale of the console; the surgeon divides displacements by this scale.
        dt: duration of a tick in s.
        seed: seed of everything random that the surgeon does.

    Raises:
        WorldError: there is no arm, or there are more than two.
    """

    device: str
    arms: Mapping[str, SeenArm]
    camera: str
    view: float
    scale: float
    dt: float = 1e-3
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= len(self.arms) <= 2:
            raise WorldError(f"the surgeon has {len(self.arms)} hands; give one, or two: right and left")


class SimulatedHands(Block):
    """A device whose hands perform a task, and which ends when the task is done.

    Attributes:
        missed: names of the targets, rings or steps that the hands gave up.
    """

    missed: list[str]


class SurgeonHands(SimulatedHands):
    """Writes `<hand>.pose` (16,) with tremor, `<hand>.grip`, and the pedals; a subclass defines the task.

    The surgeon sees the instruments (from `<robot>.q`) in the picture (`<camera>.view`) only between two strokes
    (single hand motions). The input of the device ends when the task is done.

    Attributes:
        missed: names of the targets, rings or steps that the surgeon gave up; see the subclass.
    """

    def __init__(self, seat: Seat, habits: Habits) -> None:
        """Connect the surgeon to a console; `habits`: parameters of the surgeon.

        Raises:
            WorldError: the seat has one arm only.
        """
        if len(seat.arms) != 2:
            raise WorldError(
                f"the surgeon has one arm ({', '.join(seat.arms)}), but this task is done with two hands; "
                "give an arm for the right hand and one for the left"
            )
        self.device = seat.device
        self.arms = dict(seat.arms)
        self.camera = seat.camera
        self.dt = seat.dt
        self.scale = seat.scale
        self.habits = habits
        self.missed: list[str] = []
        self._rng = np.random.default_rng(seat.seed)
        self._half_picture = np.tan(seat.view / 2)
        self._tremors = {hand: Tremor(self._rng, habits.hand, seat.dt) for hand in self.arms}
        right, left = self.arms
        middle = np.array(self.habits.middle)
        self._middle = {right: middle, left: middle * (-1, 1, 1)}
        self._positions = dict(self._middle)
        self._rotations = {right: np.eye(3), left: np.eye(3)}
        self._grip = dict.fromkeys(self.arms, 0.0)
        self._clutch = False
        self._camera = False
        self._tick = 0
        self._last_tools: dict[str, Array] = {}
        self._ticks = self._work()
        self.outputs = self._output_signals(0)

    @abstractmethod
    def _work(self) -> Iterator[None]:
        """Do the work; yield once per tick."""

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the end of the work."""
        self._signals = signals
        finished = object()
        if next(self._ticks, finished) is finished:
            return None
        self._tick += 1
        return self._output_signals(self._tick - 1)

    def _output_signals(self, k: int) -> dict[str, ArrayLike]:
        """Return the signals of tick k."""
        values: dict[str, ArrayLike] = {}
        for hand in self.arms:
            pose = _IDENTITY.copy()
            pose[:3, :3] = self._rotations[hand]
            pose[:3, 3] = self._positions[hand] + self._tremors[hand].output(k)
            values[HAND_POSE.of(hand)] = pose.ravel()
            values[HAND_GRIP.of(hand)] = self._grip[hand]
        values[DEVICE_CLUTCH.of(self.device)] = float(self._clutch)
        values[DEVICE_CAMERA.of(self.device)] = float(self._camera)
        values[DEVICE_SCALE.of(self.device)] = self.scale
        return values

    # -- perception -----------------------------------------------------------------------------------

    def _view(self) -> Array:
        """Return the frame (4, 4) of the picture in the World."""
        return self._signals[CAMERA_VIEW.of(self.camera)].reshape(4, 4)

    def _in_picture(self, points: Mapping[str, Array]) -> dict[str, Array]:
        """Transform points (3,) from the World to the frame of the picture."""
        T = spatial.inverse(self._view())
        return {hand: (T @ np.append(p, 1.0))[:3] for hand, p in points.items()}

    def _tool(self, hand: str) -> Array:
        """Return the pose (4, 4) of the tool of a hand in the World."""
        arm = self.arms[hand]
        # the last pose is the start of the search, if the equations have no closed forward solution
        T_base_tool = arm.kin.forward(self._signals[ROBOT_Q.of(arm.robot)], self._last_tools.get(hand))
        self._last_tools[hand] = T_base_tool
        return arm.T_world_base @ T_base_tool

    # -- actions: each generator yields once per tick -------------------------------------------------

    def _show(self) -> Iterator[None]:
        """Turn both handles a little, as the start condition requires."""
        for s in self._done_shares(_SHOW_TIME):
            R = spatial.rotation_z(s * self.habits.show)
            self._rotations = dict.fromkeys(self.arms, R)
            yield
        yield from self._rest(_SHORT_REST)

    def _look(self, points: Mapping[str, Array]) -> Iterator[None]:
        """Move the camera until the mean of the points is near the middle of the picture."""
        for _ in range(_LARGEST_DRAGS):
            middle = np.mean(list(self._in_picture(points).values()), axis=0)
            half_picture = self._half_picture * max(-middle[2], 1e-6)
            eccentricity = float(np.abs(middle[:2]).max()) / half_picture
            limit = self.habits.central
            if self._camera:  # the target is not left at the edge of the central area
                limit *= _CENTRED_SHARE
            if eccentricity < limit:
                break
            if not self._camera:
                self._camera = True
                yield from self._rest(_SHORT_REST)
            displacement = -np.append(middle[:2], 0.0) / self.habits.drag
            yield from self._stroke(dict.fromkeys(self.arms, displacement), self.habits.settle)
        if self._camera:
            self._camera = False
            yield from self._rest(_SHORT_REST)

    def _misjudged(self, displacement: Array) -> Array:
        """Return a displacement (3,) with a random error of judgement in every direction."""
        length = float(np.linalg.norm(displacement))
        return displacement + self.habits.hand.misjudge * length * self._rng.normal(size=3)

    def _stroke(
        self, displacements: Mapping[str, Array], pause: float, turns: Mapping[str, Array] | None = None
    ) -> Iterator[None]:
        """Move the hands by displacements (3,) in m and rotations (3,) in rad.

        If a hand would leave its range, all displacements and rotations are shortened by the same factor. If this
        factor is below `_LEAST_STROKE`, the hands instead move back to the middle of their ranges, with the clutch
        pressed.
        """
        hand = self.habits.hand
        factor = 1.0
        largest_length = 0.0
        for name, displacement in displacements.items():
            from_middle = self._positions[name] - self._middle[name]
            space = np.where(displacement > 0, hand.reach[0] - from_middle, hand.reach[0] + from_middle)
            possible = space / np.maximum(np.abs(displacement), 1e-12)
            factor = min(factor, float(possible.min()))
            largest_length = max(largest_length, float(np.linalg.norm(displacement)))
        if factor < _LEAST_STROKE:
            yield from self._move_back()
            return
        seconds = largest_length / hand.speed[0]
        rotations = {}
        for name, rotation in (turns or {}).items():
            seconds = max(seconds, float(np.linalg.norm(rotation)) / hand.speed[1])
            rotations[name] = factor * rotation
        targets = {}
        for name, displacement in displacements.items():
            targets[name] = self._positions[name] + factor * displacement
        yield from self._move(targets, factor * seconds, rotations)
        yield from self._rest(pause)

    def _move_back(self) -> Iterator[None]:
        """Press the clutch, and move both hands to the middle of their ranges."""
        self._clutch = True
        yield from self._rest(self.habits.clutched)
        yield from self._move(self._middle, _MOVE_BACK)
        yield from self._rest(self.habits.clutched)
        self._clutch = False
        yield from self._rest(_SHORT_REST)

    def _move(
        self, targets: Mapping[str, Array], seconds: float, turns: Mapping[str, Array] | None = None
    ) -> Iterator[None]:
        """Move the hands to points (3,) in m, turned by rotations (3,) in rad, with minimum jerk."""
        start = dict(self._positions)
        rotations = {}
        for hand, turn in (turns or {}).items():
            angle = float(np.linalg.norm(turn))
            if angle > 1e-9:
                K = spatial.hat(turn / angle)
                R = self._rotations[hand]
                rotations[hand] = (angle, R, K @ R, K @ K @ R)
        for s in self._done_shares(max(_SHORTEST_STROKE, seconds)):
            for hand, p in targets.items():
                self._positions[hand] = start[hand] + s * (p - start[hand])
            for hand, (angle, R, KR, KKR) in rotations.items():  # Rodrigues' formula
                self._rotations[hand] = R + np.sin(s * angle) * KR + (1 - np.cos(s * angle)) * KKR
            yield

    def _reach(
        self, goals: Mapping[str, Array], tolerance: float, near_turn: float = 4 * DEG
    ) -> Generator[None, None, bool]:
        """Move the tools to poses (4, 4) in the World by strokes; return whether the poses are reached.

        A pose is reached if at most `tolerance` in m and `near_turn` in rad remain.
        """
        least_remaining = np.inf
        stalled = 0
        while goals and stalled < _LARGEST_STALLS:
            R_view = self._view()[:3, :3]
            displacements = {}
            rotations = {}
            remaining = 0.0  # the largest error, as a multiple of its tolerance
            for hand, goal in goals.items():
                T = self._tool(hand)
                displacement = R_view.T @ (goal[:3, 3] - T[:3, 3])
                rotation = R_view.T @ spatial.log_so3(goal[:3, :3] @ T[:3, :3].T)
                distance = float(np.linalg.norm(displacement)) / tolerance
                angle = float(np.linalg.norm(rotation)) / near_turn
                remaining = max(remaining, distance, angle)
                displacements[hand] = self._misjudged(displacement) / self.scale
                rotations[hand] = self._misjudged(rotation)
            if remaining < 1.0:
                return True
            if remaining < _PROGRESS * least_remaining:
                least_remaining = remaining
                stalled = 0
            else:
                stalled += 1
            yield from self._stroke(displacements, self.habits.hand.pause, rotations)
        return not goals

    def _turn_grip(self, targets: Mapping[str, float]) -> Iterator[None]:
        start = dict(self._grip)
        for s in self._done_shares(self.habits.grasp):
            for hand, grip in targets.items():
                self._grip[hand] = start[hand] + s * (grip - start[hand])
            yield

    def _rest(self, seconds: float) -> Iterator[None]:
        for _ in range(round(seconds / self.dt)):
            yield

    def _done_shares(self, seconds: float) -> Iterator[float]:
        """Yield the fraction of a movement that is done at each tick."""
        k = max(1, round(seconds / self.dt))
        yield from minimum_jerk(np.arange(1, k + 1) / k).tolist()
