"""Control a machine and its model from a console: the hands move both, or the model alone, or a record moves both.

The goal of the console is converted to packets. Their increments follow the goal through a critically damped filter
with speed limits, because a jump would stop the machine. While a motion is rehearsed, the machine is at rest with its
pedal up; the model receives the packets, which are recorded. The record is checked at its end. The record is replayed
only if the machine is at the start of the record; the replay stops when the machine is too fast or deviates too far
from its model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.kinematics import Kinematics
from twin.model.trainer import MODEL
from twin.simulation.controllers.pedals import CAMERA, TOOLS
from twin.simulation.controllers.planned import RUN
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.machine.link import PATIENCE
from twin.simulation.world import Block, Signals

MODE = "pedals.training"
"""Name of the device's setting that requests a mode, see `asked`."""

VIEW = "console.view"
"""Signal that selects what the viewer draws as a solid: the machine (0) or its model (1)."""

FIELDS = 9
"""Number of values of a packet; see `twin.simulation.machine.itp.FIELDS`."""

LONGEST = 120.0
"""Largest duration of a record in s."""

_FOLLOW = 40.0
"""Natural frequency in rad/s of the filter that follows the goal (ASSUMED)."""

_JAW = 2.0
"""Largest increment of the jaws in one packet, in steps of the machine (ASSUMED)."""

_UM, _STILL = 1e-6, np.array([0, 0, 0, 1, 0, 0, 0, 0, 0.0])

_READY, _SETTLE = 1.0, 0.5
"""Maximum time in s until machine and model reach PEDAL_DN; time in s from the last packet until both are at rest."""

_SILENCE = 1.0
"""Maximum time in s for which the hands may be silent in a replay (ASSUMED).

The hands do not move the machine in a replay, but the clutch stops it; while the hands are silent, the clutch cannot be
read.
"""


class Mode(IntEnum):
    """Requested mode of the trainer."""

    TELEOPERATE = 0
    REHEARSE = 1
    JUDGE = 2
    REPLAY = 3


def asked(mode: Mode, count: int) -> float:
    """Return the setting that requests a mode; a different `count` requests the same mode again."""
    return float(mode + len(Mode) * count)


def mode_of(setting: float) -> Mode:
    """Return the mode that a setting requests."""
    return Mode(int(setting) % len(Mode))


class Phase(IntEnum):
    """Current phase of the trainer."""

    TELEOPERATE = 0
    REHEARSE = 1
    JUDGED = 2
    REPLAY = 3
    DONE = 4
    STOPPED = 5


class Why(IntEnum):
    """Reason why a record was refused or ended, or why a replay stopped."""

    NOTHING = 0
    NO_RECORD = 1
    NOT_READY = 2
    TOO_FAST = 3
    OUT_OF_REACH = 4
    MODEL_STOPPED = 5
    START = 6
    START_ANGLE = 7
    MACHINE_FAST = 8
    DEVIATES = 9
    MACHINE_STOPPED = 10
    OPERATOR = 11
    NOT_JUDGED = 12
    FULL = 13
    MACHINE_SILENT = 14


@dataclass(frozen=True)
class Bounds:
    """Limits of a trainer, SI; see `twin.model.trainer.TrainerTable`."""

    speed: float
    turn: float
    rehearsed: float
    replayed: float
    start: float
    start_angle: float
    deviation: float


def told(why: Why, value: float, bounds: Bounds, robot: str) -> str:
    """Return a sentence that states a reason with its value, the limit and what to do; "" for NOTHING."""
    again = "rehearse again"
    return {
        Why.NOTHING: "",
        Why.NO_RECORD: f"there is no record of {robot}: rehearse first",
        Why.NOT_JUDGED: f"the record of {robot} has not passed its check: rehearse again",
        Why.FULL: f"the rehearsal was stopped: the record of {robot} is {value:g} s long (limit {LONGEST:g}). Press "
        f"Judge to use it, or {again} a shorter motion",
        Why.NOT_READY: f"{robot} is not ready (run level {Level(int(value)).name if 0 <= value <= 3 else value}): "
        "press its start button, and wait for PEDAL_UP",
        Why.TOO_FAST: f"the rehearsed tip moved at {value / MM:.4g} mm/s (limit {bounds.rehearsed / MM:g}): "
        f"{again} more slowly",
        Why.OUT_OF_REACH: f"{value:.0f} packets had a target out of reach (limit 0): {again} within the ranges of "
        "the joints",
        Why.MODEL_STOPPED: f"the model stopped in the rehearsal: {again} more slowly",
        Why.START: f"{robot} is {value / MM:.1f} mm from where the record begins (limit {bounds.start / MM:g}): move "
        f"it to the start by teleoperation, or {again} from here",
        Why.START_ANGLE: f"a joint of {robot} is {value / DEG:.1f} deg from where the record begins "
        f"(limit {bounds.start_angle / DEG:g}): move it to the start by teleoperation, or {again} from here",
        Why.MACHINE_FAST: f"the replay was stopped: the tip of {robot} moved at {value / MM:.4g} mm/s "
        f"(limit {bounds.replayed / MM:g})",
        Why.DEVIATES: f"the replay was stopped: the tip of {robot} was {value / MM:.1f} mm from its model "
        f"(limit {bounds.deviation / MM:g}); find the cause before the next replay",
        Why.MACHINE_STOPPED: f"the replay was stopped: {robot} left PEDAL_DN "
        f"(run level {Level(int(value)).name if 0 <= value <= 3 else value})",
        Why.MACHINE_SILENT: f"the replay was stopped: no state of {robot} was received for {PATIENCE:g} s; wait until "
        "it answers, then rehearse again",
        Why.OPERATOR: f"the replay was stopped by the clutch, or because the hands were silent for {_SILENCE:g} s",
    }[why]


class ViewSwitch(Block):
    """Reads `<device>.camera`; writes `console.view`, which a quick tap of the camera pedal changes."""

    def __init__(self, device: str, tap: float) -> None:
        """Connect to a device; `tap`: longest duration of a quick tap in s."""
        self._camera, self._tap, self._view = f"{device}.camera", tap, 0.0
        self._since: float | None = None
        self.outputs = {VIEW: 0.0}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, float]:
        """Read the pedal."""
        if signals.now[self._camera].item() > 0.5:
            self._since = t if self._since is None else self._since
        elif self._since is not None:
            if t - self._since <= self._tap + 1e-9:
                self._view = 1.0 - self._view
            self._since = None
        return {VIEW: self._view}


class Smooth:
    """Computes packets whose increments add up to a motion that follows a goal smoothly.

    Attributes:
        sent: (4, 4) pose after all increments sent so far.
    """

    def __init__(self, bounds: Bounds, step: float, dt: float) -> None:
        """Prepare for packets every dt s, in which one unit of jaw motion opens the jaws by `step` in rad."""
        self._bounds, self._step, self._dt = bounds, step, dt
        self.begin(np.eye(4), 0.0)

    def begin(self, T: Array, jaw: float) -> None:
        """Start at rest at a pose (4, 4) of the tool and an opening of the jaws in rad."""
        self.sent, self._p, self._v, self._w = T.copy(), T[:3, 3].copy(), np.zeros(3), np.zeros(3)
        self._jaw = jaw

    def values(self, goal: Array, jaw: float) -> Array:
        """Return the values (9,) of the next packet, with the pedal down, to a goal (4, 4) and a jaw opening in rad."""
        dt, b = self._dt, self._bounds
        self._v = _chased(self._v, goal[:3, 3] - self._p, b.speed, dt)
        self._p = self._p + dt * self._v
        steps = np.round((self._p - self.sent[:3, 3]) / _UM)
        self._w = _chased(self._w, _turn(goal[:3, :3] @ self.sent[:3, :3].T), b.turn, dt)
        w = (dt * self._w).tolist()
        half = 0.5 * math.hypot(*w)
        share = 0.5 * math.sin(half) / half if half > 0 else 0.5
        turn = [math.cos(half), *(share * x for x in w)]
        self.sent[:3, 3] += _UM * steps
        if half > 0:
            self.sent[:3, :3] = spatial.matrix_from_quat_wxyz(turn) @ self.sent[:3, :3]
        opened = min(max(round((jaw - self._jaw) / self._step), -_JAW), _JAW)
        self._jaw += self._step * opened
        return np.array([*steps, *turn, opened, 1.0])


def _turn(R: Array) -> Array:
    """Return the rotation vector (3,) of a rotation; faster than `spatial.log_so3` for angles below 30 deg."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s = math.hypot(*v.tolist())
    if s > 0.5 or R[0, 0] + R[1, 1] + R[2, 2] < 1:
        return spatial.log_so3(R)
    return v * (math.asin(s) / s) if s > 0 else v


def _chased(v: Array, way: Array, most: float, dt: float) -> Array:
    """Return the rate (at most `most`) of a critically damped filter after one tick; `way`: remaining displacement.

    The acceleration is limited to `_FOLLOW` * most / e. This limit does not delay a stop, because the filter needs no
    larger acceleration to stop at a goal from the rate `most`. Without the limit, a jump of the goal would start the
    arm so suddenly that the speed of its tip exceeds `most`.
    """
    change = _limited((v + dt * _FOLLOW**2 * way) / (1 + dt * _FOLLOW) ** 2 - v, dt * _FOLLOW * most / math.e)
    return _limited(v + change, most)


def _limited(v: Array, most: float) -> Array:
    """Return a vector (3,), shortened to the length `most` if it is longer."""
    size = math.hypot(*v.tolist())
    return v * (most / size) if size > most else v


class Tips:
    """Compares two joint configurations of one arm by the positions of its tip."""

    def __init__(self, kin: Kinematics, angles: Array) -> None:
        """Prepare for an arm with the equations `kin`; `angles` (n,): whether each joint value is an angle."""
        self._kin, self._turns = kin, np.asarray(angles, bool) & ~kin.auxiliary
        self._auxiliary = np.flatnonzero(kin.auxiliary)[:1]

    def apart(self, q: Array, other: Array) -> float:
        """Return the distance in m between the tips at the joint values q and `other` (n,)."""
        return float(np.linalg.norm(self.tip(q) - self.tip(other)))

    def tip(self, q: Array) -> Array:
        """Return the position of the tip (3,) in m in base."""
        return self._kin.forward(q)[:3, 3]

    def turned(self, q: Array, other: Array) -> float:
        """Return the largest difference in rad between q and `other` (n,) among the joints that turn the tool."""
        return float(np.abs(q - other)[self._turns].max(initial=0.0))

    def opening(self, q: Array) -> float:
        """Return the opening of the jaws in rad; 0 without jaws."""
        return float(q[self._auxiliary].sum())


class Trainer(Block):
    """Writes the packets of a machine and of its model.

    Writes `<robot>.packet` (9,) for the machine; `<robot>.given` (10,) for the model: a packet, then 1 in ticks that
    set the model to the joint values of the machine, otherwise 0; and `<robot>.phase` (3,): `Phase`, `Why`, and the
    value for `told`.

    Reads `pedals.training`, `console.mode`, `<robot>.goal`, `<robot>.follows`, `<robot>.planned`, `<robot>.jaw`,
    `<robot>.run`, `<robot>.measured`, and of the model `<robot>.model`, `<robot>.deviation` and `<robot>_model.q`; see
    `Modelled`.
    """

    def __init__(self, robot: str, device: str, bounds: Bounds, grasp_step: float, tips: Tips, dt: float) -> None:
        """Start with teleoperation.

        Args:
            robot: name of the machine.
            device: name of the device of the pedals.
            bounds: limits.
            grasp_step: angle in rad by which one unit of jaw motion in a packet opens the jaws.
            tips: compares joint configurations by the positions of the tip.
            dt: duration of a tick in s.
        """
        self.robot, self.bounds, self._tips, self._dt = robot, bounds, tips, dt
        self._names = {n: f"{robot}.{n}" for n in ("goal", "follows", "run", "measured", "model", "deviation")}
        self._names["ghost"] = f"{robot}{MODEL}.q"
        self._jaw, self._silent, self._planned = f"{robot}.jaw", f"{device}.silent", f"{robot}.planned"
        self._smooth, self._wanted, self._phase = Smooth(bounds, grasp_step, dt), 0.0, Phase.TELEOPERATE
        self._why, self._value = Why.NOTHING, 0.0
        self._record: list[Array] = []
        self._start: Array | None = None
        self._good = self._led = False
        self._fastest, self._held = 0.0, 0.0
        self._k, self._since, self._heard = 0, 0.0, 0.0
        self.outputs = {
            f"{robot}.packet": _STILL,
            f"{robot}.given": np.append(_STILL, 0.0),
            f"{robot}.phase": [0, 0, 0],
        }

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Compute the packets of this tick."""
        now = signals.now
        s = {n: now[name] for n, name in self._names.items()}
        ready = s["run"][ANSWERS] > 0.5 and s["run"][LEVEL] >= Level.PEDAL_UP
        self._sync = False
        if (wanted := now[MODE].item()) != self._wanted:
            self._wanted = wanted
            self._change(mode_of(wanted), s, ready, t)
        machine = model = _STILL
        if self._phase == Phase.REPLAY:
            silent = self._is_silent(signals)
            self._heard = self._heard if silent else t
            clutched = not silent and now["console.mode"].item() not in (TOOLS, CAMERA)
            held = clutched or t - self._heard > _SILENCE
            waits = self._k == 0 and silent and not held
            machine = model = _STILL if self._sync or waits else self._replayed(s, held, t)
        elif self._phase in (Phase.TELEOPERATE, Phase.REHEARSE):
            alone = self._phase == Phase.REHEARSE
            full = alone and len(self._record) * dt >= LONGEST
            if full:
                self._why, self._value, self._led = Why.FULL, LONGEST, False
            values = _STILL if full else self._led_by_hand(signals, s, ready, alone)
            machine, model = (_STILL, values) if alone else (values, values)
            if alone and not full:
                self._rehearsed(values, s)
        else:
            self._led = False
        given = np.append(model, float(self._sync))
        return {
            f"{self.robot}.packet": machine,
            f"{self.robot}.given": given,
            f"{self.robot}.phase": np.array([self._phase, self._why, self._value]),
        }

    def _is_silent(self, signals: Signals) -> bool:
        return self._silent in signals and signals.now[self._silent].item() > 0.5

    def _is_planned(self, signals: Signals) -> bool:
        """Return whether a plan moves the goal, instead of a hand."""
        return self._planned in signals and signals.now[self._planned].item(0) == RUN

    # -- requested modes -----------------------------------------------------------------------------

    def _change(self, wanted: Mode, s: Mapping[str, Array], ready: bool, t: float) -> None:
        self._why, self._value = Why.NOTHING, 0.0
        if wanted == Mode.TELEOPERATE:
            self._phase, self._led = Phase.TELEOPERATE, False
        elif wanted == Mode.REHEARSE:
            if not ready:
                return self._stop(Why.NOT_READY, s["run"][LEVEL])
            self._phase, self._sync, self._led = Phase.REHEARSE, True, False
            self._record, self._start, self._good = [], s["measured"].copy(), False
            self._fastest, self._held = 0.0, float(s["model"][2])
        elif wanted == Mode.JUDGE:
            self._judge(s)
        else:
            self._begin_replay(s, ready, t)
        return None

    def _judge(self, s: Mapping[str, Array]) -> None:
        held, stopped = float(s["model"][2]) - self._held, s["model"][0] < Level.PEDAL_UP
        if self._phase != Phase.REHEARSE or not self._record:
            return self._stop(Why.NO_RECORD, 0.0)
        self._phase = Phase.JUDGED
        for bad, why, value in (
            (stopped, Why.MODEL_STOPPED, s["model"][0]),
            (held > 0, Why.OUT_OF_REACH, held),
            (self._fastest > self.bounds.rehearsed, Why.TOO_FAST, self._fastest),
        ):
            if bad:
                self._why, self._value = why, float(value)
                return None
        self._good = True
        return None

    def _begin_replay(self, s: Mapping[str, Array], ready: bool, t: float) -> None:
        if self._start is None or not self._record:
            return self._stop(Why.NO_RECORD, 0.0)
        if not self._good:
            return self._stop(Why.NOT_JUDGED, 0.0)
        if not ready:
            return self._stop(Why.NOT_READY, s["run"][LEVEL])
        far = self._tips.apart(s["measured"], self._start)
        turned = self._tips.turned(s["measured"], self._start)
        if far > self.bounds.start:
            return self._stop(Why.START, far)
        if turned > self.bounds.start_angle:
            return self._stop(Why.START_ANGLE, turned)
        self._phase, self._sync, self._k, self._since, self._heard = Phase.REPLAY, True, 0, t, t
        return None

    def _stop(self, why: Why, value: float) -> None:
        self._phase, self._why, self._value = Phase.STOPPED, why, float(value)

    # -- packets --------------------------------------------------------------------------------------

    def _led_by_hand(self, signals: Signals, s: Mapping[str, Array], ready: bool, alone: bool) -> Array:
        """Return the values (9,) of this tick's packet; its increments are 0 until PEDAL_DN is reached."""
        led = (s["follows"].item() > 0.5 or self._is_planned(signals)) and (ready or alone)
        jaw = signals.now[self._jaw].item() if self._jaw in signals else 0.0
        goal = s["goal"].reshape(4, 4)
        if led and not self._led:
            self._smooth.begin(goal, self._tips.opening(s["ghost" if alone else "measured"]))
            self._sync = self._sync or not alone  # the model starts at the joint values of the machine
        self._led = led
        if not led:
            return _STILL
        levels = [s["model"][0]] if alone else [s["model"][0], s["run"][LEVEL]]
        if min(levels) < Level.PEDAL_DN:
            return np.append(_STILL[:8], 1.0)
        return self._smooth.values(goal, jaw)

    def _rehearsed(self, values: Array, s: Mapping[str, Array]) -> None:
        if values[8] < 0.5 and not self._record:
            return  # the record begins with the motion
        self._record.append(values)
        self._fastest = max(self._fastest, float(s["model"][1]))

    def _replayed(self, s: Mapping[str, Array], held: bool, t: float) -> Array:
        """Return the values (9,) of the next packet; the replay pauses while machine or model is not in PEDAL_DN."""
        level, record, down = s["run"][LEVEL], self._record, np.append(_STILL[:8], 1.0)
        values = record[self._k] if self._k < len(record) else down
        if min(s["model"][0], level) >= Level.PEDAL_DN or values[8] < 0.5:
            self._since, waits = t, False
        else:
            waits = True
        far, speed = s["deviation"]
        for bad, why, value in (
            (held, Why.OPERATOR, 0.0),
            (s["run"][ANSWERS] < 0.5, Why.MACHINE_SILENT, 0.0),
            (level < Level.PEDAL_UP, Why.MACHINE_STOPPED, level),
            (t - self._since > _READY, Why.NOT_READY, level),
            (speed > self.bounds.replayed, Why.MACHINE_FAST, speed),
            (far > self.bounds.deviation, Why.DEVIATES, far),
        ):
            if bad:
                self._stop(why, value)
                return _STILL
        if waits:
            return down
        self._k += 1
        if self._k > len(record) + round(_SETTLE / self._dt):
            self._phase = Phase.DONE
            return _STILL
        return values
