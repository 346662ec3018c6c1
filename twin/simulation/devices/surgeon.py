"""A simulated surgeon, with a random seed, at a console with two hands, a clutch pedal and a camera pedal.

The surgeon touches the targets of a task one after another, with both hands at once. As in `devices.hand`, the hands
move with minimum jerk to reduce the remaining error in the picture, with tremor and errors of judgement. If the targets
are outside the middle of the picture, the surgeon moves the camera. If a hand has left its comfortable range, both
hands are moved back while the clutch is pressed. The grippers open on the way and close at the target. All of this is
ASSUMED: hand motions at such a console are not published.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from twin.core import spatial
from twin.core.errors import WorldError
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.kinematics import Kinematics
from twin.simulation.devices.hand import Hand, minimum_jerk, tremor
from twin.simulation.world import Block, Signals

_STALLED = 12
"""Number of strokes without progress after which the surgeon gives up a target."""

_DRAGS = 20
"""Maximum number of strokes with the camera pedal for one target; then the surgeon accepts the picture."""


@dataclass(frozen=True)
class Habits:
    """Parameters of the surgeon, SI; all ASSUMED.

    Attributes:
        hand: parameters of the motion of each hand.
        middle: position of the right hand in {H} in the middle of its range; that of the left hand is its mirror image.
        show: rotation of the handles in rad that shows that a person holds them; see `following.Start`.
        clutched: time in s for which the clutch is pressed before and after the hands move back.
        open: angle of the grippers on the way to a target.
        grasp: time in s in which the grippers open or close.
        central: size of the central area in which targets must be, as a fraction of half the picture.
        drag: motion of the scene divided by motion of the hands, as the surgeon expects with the camera pedal pressed.
        settle: time in s that the surgeon waits for the camera, whose speed is limited.
    """

    hand: Hand = field(default_factory=Hand)
    middle: tuple[float, float, float] = (0.08, 0.0, 0.0)
    show: float = 5 * DEG
    clutched: float = 0.15
    open: float = 30 * DEG
    grasp: float = 0.25
    central: float = 0.4
    drag: float = 0.2
    settle: float = 0.5


@dataclass(frozen=True)
class Eye:
    """One arm that the surgeon sees: its name in the World, its equations, and its base and tip frames (4, 4)."""

    robot: str
    kin: Kinematics
    T_world_base: Array
    T_tool_tip: Array


class ScriptedSurgeon(Block):
    """Writes `<hand>.pose` (16,) with tremor, `<hand>.grip`, the pedals, and `surgeon.target` (index, first -1).

    The surgeon sees the tips (from `<robot>.q`) in the picture (`<camera>.view`) between two strokes. The device ends
    after the last target.

    Attributes:
        missed: names of the targets that the surgeon gave up.
    """

    def __init__(
        self,
        device: str,
        arms: Mapping[str, Eye],
        camera: str,
        view: float,
        targets: Sequence[tuple[str, Mapping[str, Array]]],
        tolerance: float,
        hold: float,
        scale: float,
        dt: float = 1e-3,
        seed: int = 0,
        habits: Habits | None = None,
    ) -> None:
        """Connect to a console.

        Args:
            device: name of the device of the pedals.
            arms: the arm of the right and of the left hand, by hand, in this order.
            camera: name of the arm of the camera.
            view: angle of view in rad.
            targets: name of each target and, by hand, its point (3,) in m in the World.
            tolerance: largest distance in m of a tip from its point.
            hold: time in s for which the tips remain at a target.
            scale: motion scale of the console; the surgeon divides displacements by it.
            dt: duration of a tick in s.
            seed: seed of tremor and errors.
            habits: parameters of the surgeon; None: the defaults.

        Raises:
            WorldError: the number of hands is not two, or a target is for another hand.
        """
        if len(arms) != 2:
            raise WorldError(f"the surgeon has {len(arms)} hands; give two, right and left")
        for name, points in targets:
            if not points or not set(points) <= set(arms):
                raise WorldError(f"target '{name}' is for {', '.join(points) or 'no hand'}, not for {', '.join(arms)}")
        self.device, self.arms, self.camera, self.dt = device, dict(arms), camera, dt
        self.targets, self.tolerance, self.hold, self.scale = tuple(targets), tolerance, hold, scale
        self.habits, self._rng = habits or Habits(), np.random.default_rng(seed)
        self._half = np.tan(view / 2)
        self._shake = {hand: tremor(self._rng, self.habits.hand) for hand in arms}
        middle = np.array(self.habits.middle)
        self._middle = dict(zip(arms, (middle, middle * (-1, 1, 1)), strict=True))
        self._p = dict(self._middle)
        self._roll = self._grip = 0.0
        self._clutch = self._camera = False
        self._target, self._count = -1, 0
        self._T: dict[str, Array] = {}
        self.missed: list[str] = []
        self._ticks = self._work()
        self.outputs = self._said(0.0)

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, ArrayLike] | None:
        """Return the signals of this tick; None after the last target."""
        self._signals = signals
        if next(self._ticks, self) is self:
            return None
        self._count += 1
        return self._said((self._count - 1) * self.dt)

    def _said(self, t: float) -> dict[str, ArrayLike]:
        R = spatial.rotation_z(self._roll)
        out: dict[str, ArrayLike] = {}
        for hand in self.arms:
            out[f"{hand}.pose"] = spatial.pose(R, self._p[hand] + self._shake[hand](t)).ravel()
            out[f"{hand}.grip"] = self._grip
        out |= {f"{self.device}.clutch": float(self._clutch), f"{self.device}.camera": float(self._camera)}
        return out | {f"{self.device}.scale": self.scale, "surgeon.target": float(self._target)}

    # -- perception -----------------------------------------------------------------------------------

    def _in_picture(self, points: Mapping[str, Array]) -> dict[str, Array]:
        """Return points (3,) of the World in the frame of the picture."""
        T = spatial.inverse(self._signals[f"{self.camera}.view"].reshape(4, 4))
        return {hand: (T @ np.append(p, 1.0))[:3] for hand, p in points.items()}

    def _missing(self, points: Mapping[str, Array]) -> dict[str, Array]:
        """Return the vector (3,) in m from the tip of each hand to its point, in the frame of the picture."""
        tips = {}
        for hand in points:
            eye = self.arms[hand]
            T = self._T[hand] = eye.kin.forward(self._signals[f"{eye.robot}.q"], self._T.get(hand))
            tips[hand] = (eye.T_world_base @ T @ eye.T_tool_tip)[:3, 3]
        seen, tips = self._in_picture(points), self._in_picture(tips)
        return {hand: seen[hand] - tips[hand] for hand in points}

    # -- actions: each generator yields once per tick -------------------------------------------------

    def _work(self) -> Iterator[None]:
        yield from self._rest(0.3)
        yield from self._show()
        for i, (name, points) in enumerate(self.targets):
            self._target = i
            yield from self._look(points)
            yield from self._turn_grip(self.habits.open)
            if not (yield from self._touch(points)):
                self.missed.append(name)
                continue
            yield from self._turn_grip(0.0)
            yield from self._rest(self.hold)
        yield from self._rest(0.2)

    def _show(self) -> Iterator[None]:
        """Turn both handles a little, as the start condition requires."""
        for s in self._shares(0.3):
            self._roll = s * self.habits.show
            yield
        yield from self._rest(0.1)

    def _look(self, points: Mapping[str, Array]) -> Iterator[None]:
        """Move the camera until the mean of the points is near the middle of the picture."""
        for _ in range(_DRAGS):
            middle = np.mean(list(self._in_picture(points).values()), axis=0)
            aside = float(np.abs(middle[:2]).max()) / (self._half * max(-middle[2], 1e-6))
            # once the pedal is pressed, the limit is lower, so that the target is not at the edge of the central area
            if aside < self.habits.central * (0.4 if self._camera else 1.0):
                break
            if not self._camera:
                self._camera = True
                yield from self._rest(0.1)
            way = -np.append(middle[:2], 0.0) / self.habits.drag
            yield from self._stroke(dict.fromkeys(self.arms, way), self.habits.settle)
        if self._camera:
            self._camera = False
            yield from self._rest(0.1)

    def _touch(self, points: Mapping[str, Array]) -> Generator[None, None, bool]:
        """Move the tips to their points; return whether they have reached the points."""
        best, stalled = np.inf, 0
        while stalled < _STALLED:
            missing = self._missing(points)
            left = max(float(np.linalg.norm(m)) for m in missing.values())
            if left < 0.5 * self.tolerance:  # the rest of the tolerance is for tremor
                return True
            best, stalled = (left, 0) if left < 0.98 * best else (best, stalled + 1)
            ways = {hand: self._misjudged(m) / self.scale for hand, m in missing.items()}
            yield from self._stroke(ways, self.habits.hand.pause)
        return False

    def _misjudged(self, way: Array) -> Array:
        """Return a displacement (3,) with a random error of judgement in every direction."""
        return way + self.habits.hand.misjudge * float(np.linalg.norm(way)) * self._rng.normal(size=3)

    def _stroke(self, ways: Mapping[str, Array], pause: float) -> Iterator[None]:
        """Move the hands by `ways` (3,) in m as far as their range allows; at the end of the range, move them back."""
        hand = self.habits.hand
        part = 1.0
        for name, way in ways.items():
            off = self._p[name] - self._middle[name]
            room = np.where(way > 0, hand.reach[0] - off, hand.reach[0] + off)
            part = min(part, float((room / np.maximum(np.abs(way), 1e-12)).min()))
        if part < 0.05:
            yield from self._move_back()
            return
        longest = max(float(np.linalg.norm(way)) for way in ways.values())
        yield from self._move({n: self._p[n] + part * w for n, w in ways.items()}, part * longest / hand.speed[0])
        yield from self._rest(pause)

    def _move_back(self) -> Iterator[None]:
        """Press the clutch, and move both hands to the middle of their ranges."""
        self._clutch = True
        yield from self._rest(self.habits.clutched)
        yield from self._move(self._middle, 0.6)
        yield from self._rest(self.habits.clutched)
        self._clutch = False
        yield from self._rest(0.1)

    def _move(self, to: Mapping[str, Array], seconds: float) -> Iterator[None]:
        start = dict(self._p)
        for s in self._shares(max(0.35, seconds)):
            self._p |= {hand: start[hand] + s * (p - start[hand]) for hand, p in to.items()}
            yield

    def _turn_grip(self, to: float) -> Iterator[None]:
        start = self._grip
        for s in self._shares(self.habits.grasp):
            self._grip = start + s * (to - start)
            yield

    def _rest(self, seconds: float) -> Iterator[None]:
        for _ in range(round(seconds / self.dt)):
            yield

    def _shares(self, seconds: float) -> Iterator[float]:
        k = max(1, round(seconds / self.dt))
        yield from minimum_jerk(np.arange(1, k + 1) / k).tolist()
