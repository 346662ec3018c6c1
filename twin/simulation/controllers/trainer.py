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
from twin.simulation.controllers.plan_states import RUN
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.machine.machine_link import PATIENCE
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    CONSOLE_VIEW,
    DEVICE_CAMERA,
    DEVICE_SILENT,
    DEVICE_TRAINING,
    PEDALS,
    ROBOT_GIVEN,
    ROBOT_JAW,
    ROBOT_PACKET,
    ROBOT_PHASE,
    ROBOT_PLANNED,
)

MODE = DEVICE_TRAINING.of(PEDALS)
"""Name of the device's setting that requests a mode, see `asked`."""

VIEW = CONSOLE_VIEW.name
"""Signal that selects what the viewer draws as a solid: the machine (0) or its model (1)."""

FIELDS = 9
"""Number of values of a packet; see `twin.simulation.machine.itp.FIELDS`."""

LONGEST = 120.0
"""Largest duration of a record in s."""

_FOLLOW = 40.0
"""Natural frequency in rad/s of the filter that follows the goal (ASSUMED)."""

_JAW = 2.0
"""Largest increment of the jaws in one packet, in steps of the machine (ASSUMED)."""

_UM = 1e-6

_STILL = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0.0])
"""Values of a packet without increments, with the pedal up."""

_READY = 1.0
"""Maximum time in s until machine and model reach PEDAL_DN."""

_SETTLE = 0.5
"""Time in s from the last packet of a replay until machine and model are at rest."""

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


class TrainerPhase(IntEnum):
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
class TrainerLimits:
    """Limits of a trainer, SI; see `twin.model.trainer.TrainerTable`."""

    speed: float
    turn: float
    rehearsed: float
    replayed: float
    start: float
    start_angle: float
    deviation: float


def told(why: Why, value: float, bounds: TrainerLimits, robot: str) -> str:
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
        self._camera = DEVICE_CAMERA.of(device)
        self._tap = tap
        self._view = 0.0
        self._since: float | None = None  # time in s at which the pedal was pressed
        self.outputs = {VIEW: 0.0}

    def step(self, signals: Signals, t: float, dt: float) -> dict[str, float]:
        """Read the pedal."""
        if signals.now[self._camera].item() > 0.5:
            if self._since is None:
                self._since = t
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

    def __init__(self, bounds: TrainerLimits, step: float, dt: float) -> None:
        """Prepare for packets every dt s, in which one unit of jaw motion opens the jaws by `step` in rad."""
        self._bounds = bounds
        self._step = step
        self._dt = dt
        self.begin(np.eye(4), 0.0)

    def slow(self, bounds: TrainerLimits) -> None:
        """Use other limits of the speeds from the next packet on."""
        self._bounds = bounds

    def begin(self, T: Array, jaw: float) -> None:
        """Start at rest at a pose (4, 4) of the tool and an opening of the jaws in rad."""
        self.sent = T.copy()
        self._p = T[:3, 3].copy()
        self._v = np.zeros(3)
        self._w = np.zeros(3)
        self._jaw = jaw

    @property
    def opening(self) -> float:
        """Opening of the jaws in rad after all increments sent so far."""
        return self._jaw

    def values(self, goal: Array, jaw: float) -> Array:
        """Return the values (9,) of the next packet, with the pedal down, to a goal (4, 4) and a jaw opening in rad."""
        dt = self._dt
        self._v = _chased(self._v, goal[:3, 3] - self._p, self._bounds.speed, dt)
        self._p = self._p + dt * self._v
        # The rounded rest is sent with later packets, because `sent` has only what was sent.
        steps = np.round((self._p - self.sent[:3, 3]) / _UM)
        rotation = _rotation_vector(goal[:3, :3] @ self.sent[:3, :3].T)
        self._w = _chased(self._w, rotation, self._bounds.turn, dt)
        wx, wy, wz = (dt * self._w).tolist()
        half = 0.5 * math.hypot(wx, wy, wz)
        share = 0.5  # limit of sin(half) / (2 half)
        if half > 0:
            share = 0.5 * math.sin(half) / half
        quat_wxyz = [math.cos(half), share * wx, share * wy, share * wz]
        self.sent[:3, 3] += _UM * steps
        if half > 0:
            self.sent[:3, :3] = spatial.matrix_from_quat_wxyz(quat_wxyz) @ self.sent[:3, :3]
        jaw_steps = min(max(round((jaw - self._jaw) / self._step), -_JAW), _JAW)
        self._jaw += self._step * jaw_steps
        return np.array([*steps, *quat_wxyz, jaw_steps, 1.0])


def _rotation_vector(R: Array) -> Array:
    """Return the rotation vector (3,) of a rotation; faster than `spatial.log_so3` for angles below 30 deg."""
    v = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = math.hypot(*v.tolist())
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if sine > 0.5 or trace < 1:
        return spatial.log_so3(R)
    if sine == 0:
        return v
    return v * (math.asin(sine) / sine)


def _chased(v: Array, displacement: Array, most: float, dt: float) -> Array:
    """Return the rate (at most `most`) of a critically damped filter after one tick; `displacement`: what remains.

    The acceleration is limited to `_FOLLOW` * most / e. This limit does not delay a stop, because the filter needs no
    larger acceleration to stop at a goal from the rate `most`. Without the limit, a jump of the goal would start the
    arm so suddenly that the speed of its tip exceeds `most`.
    """
    next_v = (v + dt * _FOLLOW**2 * displacement) / (1 + dt * _FOLLOW) ** 2  # implicit Euler method
    change = _limited(next_v - v, dt * _FOLLOW * most / math.e)
    return _limited(v + change, most)


def _limited(v: Array, most: float) -> Array:
    """Return a vector (3,), shortened to the length `most` if it is longer."""
    size = math.hypot(*v.tolist())
    return v * (most / size) if size > most else v


class Tips:
    """Compares two joint configurations of one arm by the positions of its tip."""

    def __init__(self, kin: Kinematics, angles: Array) -> None:
        """Prepare for an arm with the equations `kin`; `angles` (n,): whether each joint value is an angle."""
        self._kin = kin
        self._turns = np.asarray(angles, bool) & ~kin.auxiliary
        self._auxiliary = np.flatnonzero(kin.auxiliary)[:1]

    def apart(self, q: Array, q_other: Array) -> float:
        """Return the distance in m between the tips at the joint values q and `q_other` (n,)."""
        return float(np.linalg.norm(self.tip(q) - self.tip(q_other)))

    def tip(self, q: Array) -> Array:
        """Return the position of the tip (3,) in m in base."""
        return self._kin.forward(q)[:3, 3]

    def turned(self, q: Array, q_other: Array) -> float:
        """Return the largest difference in rad between q and `q_other` (n,) among the joints that turn the tool."""
        return float(np.abs(q - q_other)[self._turns].max(initial=0.0))

    def opening(self, q: Array) -> float:
        """Return the opening of the jaws in rad; 0 without jaws."""
        return float(q[self._auxiliary].sum())


class Trainer(Block):
    """Writes the packets of a machine and of its model.

    Writes `<robot>.packet` (9,) for the machine; `<robot>.given` (10,) for the model: a packet, then 1 in ticks that
    set the model to the joint values of the machine, otherwise 0; and `<robot>.phase` (3,): `TrainerPhase`, `Why`, and
    the value for `told`.

    Reads `pedals.training`, `console.mode`, `<robot>.goal`, `<robot>.follows`, `<robot>.planned`, `<robot>.jaw`,
    `<robot>.run`, `<robot>.measured`, and of the model `<robot>.model`, `<robot>.deviation` and `<robot>_model.q`; see
    `MachineModelPlant`.
    """

    def __init__(
        self, robot: str, device: str, bounds: TrainerLimits, grasp_step: float, tips: Tips, dt: float
    ) -> None:
        """Start with teleoperation.

        Args:
            robot: name of the machine.
            device: name of the device of the pedals.
            bounds: limits.
            grasp_step: angle in rad by which one unit of jaw motion in a packet opens the jaws.
            tips: compares joint configurations by the positions of the tip.
            dt: duration of a tick in s.
        """
        self.robot = robot
        self.bounds = bounds
        self._tips = tips
        self._dt = dt
        self._names = {n: f"{robot}.{n}" for n in ("goal", "follows", "run", "measured", "model", "deviation")}
        self._names["ghost"] = f"{robot}{MODEL}.q"
        self._jaw = ROBOT_JAW.of(robot)
        self._silent = DEVICE_SILENT.of(device)
        self._planned = ROBOT_PLANNED.of(robot)
        self._smooth = Smooth(bounds, grasp_step, dt)
        self._setting = 0.0  # of the device, see `asked`
        self._phase = TrainerPhase.TELEOPERATE
        self._why = Why.NOTHING
        self._value = 0.0
        self._record: list[Array] = []
        self._start: Array | None = None  # joint values of the machine at the start of the record
        self._passed = False  # whether the record has passed its check
        self._moving = False  # whether a hand or a plan moves the goal
        self._fastest = 0.0  # largest speed of the model's tip in the rehearsal, m/s
        self._held = 0.0  # targets out of reach before the rehearsal
        self._k = 0  # next packet of the replay
        self._since = 0.0  # time in s at which machine and model last were in PEDAL_DN in the replay
        self._heard = 0.0  # time in s at which the hands last were not silent
        self.outputs = {
            ROBOT_PACKET.of(robot): _STILL,
            ROBOT_GIVEN.of(robot): np.append(_STILL, 0.0),
            ROBOT_PHASE.of(robot): [0, 0, 0],
        }

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Compute the packets of this tick."""
        now = signals.now
        arm_signals = {n: now[name] for n, name in self._names.items()}
        ready = arm_signals["run"][ANSWERS] > 0.5 and arm_signals["run"][LEVEL] >= Level.PEDAL_UP
        self._sync = False
        setting = now[MODE].item()
        if setting != self._setting:
            self._setting = setting
            self._change(mode_of(setting), arm_signals, ready, t)
        machine = _STILL
        model = _STILL
        if self._phase == TrainerPhase.REPLAY:
            machine = self._replay(signals, arm_signals, t)
            model = machine
        elif self._phase == TrainerPhase.REHEARSE:
            model = self._rehearse(signals, arm_signals, ready, dt)
        elif self._phase == TrainerPhase.TELEOPERATE:
            machine = self._from_goal(signals, arm_signals, ready, alone=False)
            model = machine
        else:
            self._moving = False
        for_model = np.append(model, float(self._sync))
        return {
            ROBOT_PACKET.of(self.robot): machine,
            ROBOT_GIVEN.of(self.robot): for_model,
            ROBOT_PHASE.of(self.robot): np.array([self._phase, self._why, self._value]),
        }

    def _is_silent(self, signals: Signals) -> bool:
        return self._silent in signals and signals.now[self._silent].item() > 0.5

    def _is_planned(self, signals: Signals) -> bool:
        """Return whether a plan moves the goal, instead of a hand."""
        return self._planned in signals and signals.now[self._planned].item(0) == RUN

    # -- requested modes -----------------------------------------------------------------------------

    def _change(self, mode: Mode, arm_signals: Mapping[str, Array], ready: bool, t: float) -> None:
        self._why = Why.NOTHING
        self._value = 0.0
        if mode == Mode.TELEOPERATE:
            self._phase = TrainerPhase.TELEOPERATE
            self._moving = False
        elif mode == Mode.REHEARSE:
            if not ready:
                return self._stop(Why.NOT_READY, arm_signals["run"][LEVEL])
            self._phase = TrainerPhase.REHEARSE
            self._sync = True
            self._moving = False
            self._record = []
            self._start = arm_signals["measured"].copy()
            self._passed = False
            self._fastest = 0.0
            self._held = float(arm_signals["model"][2])
        elif mode == Mode.JUDGE:
            self._judge(arm_signals)
        else:
            self._begin_replay(arm_signals, ready, t)
        return None

    def _judge(self, s: Mapping[str, Array]) -> None:
        if self._phase != TrainerPhase.REHEARSE or not self._record:
            return self._stop(Why.NO_RECORD, 0.0)
        self._phase = TrainerPhase.JUDGED
        level = float(s["model"][0])
        out_of_reach = float(s["model"][2]) - self._held
        if level < Level.PEDAL_UP:
            self._why = Why.MODEL_STOPPED
            self._value = level
        elif out_of_reach > 0:
            self._why = Why.OUT_OF_REACH
            self._value = out_of_reach
        elif self._fastest > self.bounds.rehearsed:
            self._why = Why.TOO_FAST
            self._value = self._fastest
        else:
            self._passed = True
        return None

    def _begin_replay(self, arm_signals: Mapping[str, Array], ready: bool, t: float) -> None:
        if self._start is None or not self._record:
            return self._stop(Why.NO_RECORD, 0.0)
        if not self._passed:
            return self._stop(Why.NOT_JUDGED, 0.0)
        if not ready:
            return self._stop(Why.NOT_READY, arm_signals["run"][LEVEL])
        distance = self._tips.apart(arm_signals["measured"], self._start)
        if distance > self.bounds.start:
            return self._stop(Why.START, distance)
        angle = self._tips.turned(arm_signals["measured"], self._start)
        if angle > self.bounds.start_angle:
            return self._stop(Why.START_ANGLE, angle)
        self._phase = TrainerPhase.REPLAY
        self._sync = True
        self._k = 0
        self._since = t
        self._heard = t
        return None

    def _stop(self, why: Why, value: float) -> None:
        self._phase = TrainerPhase.STOPPED
        self._why = why
        self._value = float(value)

    # -- packets --------------------------------------------------------------------------------------

    def _from_goal(self, signals: Signals, arm_signals: Mapping[str, Array], ready: bool, *, alone: bool) -> Array:
        """Return the values (9,) of this tick's packet; its increments are 0 until PEDAL_DN is reached.

        If the model moves `alone`, the machine need not be ready.
        """
        moving = (arm_signals["follows"].item() > 0.5 or self._is_planned(signals)) and (ready or alone)
        goal = arm_signals["goal"].reshape(4, 4)
        if moving and not self._moving:
            q = arm_signals["ghost"] if alone else arm_signals["measured"]
            self._smooth.begin(goal, self._tips.opening(q))
            if not alone:
                self._sync = True  # the model starts at the joint values of the machine
        self._moving = moving
        if not moving:
            return _STILL
        level = arm_signals["model"][0]
        if not alone:
            level = min(level, arm_signals["run"][LEVEL])
        if level < Level.PEDAL_DN:
            return np.append(_STILL[:8], 1.0)
        jaw = 0.0
        if self._jaw in signals:
            jaw = signals.now[self._jaw].item()
        return self._smooth.values(goal, jaw)

    def _rehearse(self, signals: Signals, arm_signals: Mapping[str, Array], ready: bool, dt: float) -> Array:
        """Return the values (9,) of the model's packet, and record them; the record begins with the motion."""
        if len(self._record) * dt >= LONGEST:
            self._why = Why.FULL
            self._value = LONGEST
            self._moving = False
            return _STILL
        values = self._from_goal(signals, arm_signals, ready, alone=True)
        if self._record or values[8] > 0.5:
            self._record.append(values)
            self._fastest = max(self._fastest, float(arm_signals["model"][1]))
        return values

    def _replay(self, signals: Signals, arm_signals: Mapping[str, Array], t: float) -> Array:
        """Return the values (9,) of the packet of this tick, while the operator does not stop the replay."""
        silent = self._is_silent(signals)
        if not silent:
            self._heard = t
        clutched = not silent and signals.now[CONSOLE_MODE.name].item() not in (TOOLS, CAMERA)
        stopped = clutched or t - self._heard > _SILENCE
        # A replay does not begin while the clutch cannot be read.
        waits = self._k == 0 and silent and not stopped
        if self._sync or waits:
            return _STILL
        return self._recorded(arm_signals, stopped, t)

    def _recorded(self, arm_signals: Mapping[str, Array], stopped: bool, t: float) -> Array:
        """Return the values (9,) of the next packet; the replay pauses while machine or model is not in PEDAL_DN."""
        level = arm_signals["run"][LEVEL]
        record = self._record
        down = np.append(_STILL[:8], 1.0)
        values = down  # after the record, until both are at rest
        if self._k < len(record):
            values = record[self._k]
        waits = min(arm_signals["model"][0], level) < Level.PEDAL_DN and values[8] > 0.5
        if not waits:
            self._since = t
        distance, speed = arm_signals["deviation"]
        # The first reason that applies counts.
        for applies, why, value in (
            (stopped, Why.OPERATOR, 0.0),
            (arm_signals["run"][ANSWERS] < 0.5, Why.MACHINE_SILENT, 0.0),
            (level < Level.PEDAL_UP, Why.MACHINE_STOPPED, level),
            (t - self._since > _READY, Why.NOT_READY, level),
            (speed > self.bounds.replayed, Why.MACHINE_FAST, speed),
            (distance > self.bounds.deviation, Why.DEVIATES, distance),
        ):
            if applies:
                self._stop(why, value)
                return _STILL
        if waits:
            return down
        self._k += 1
        if self._k > len(record) + round(_SETTLE / self._dt):
            self._phase = TrainerPhase.DONE
            return _STILL
        return values
