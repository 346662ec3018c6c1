"""Control a machine and its model from a console: the hands move both, or the model alone, or a record moves both.

The goal of the console is converted to packets. Their increments follow the goal through a critically damped filter
with speed limits, because a jump would stop the machine. While a motion is rehearsed, the machine is at rest with its
pedal up; the model receives the packets, which are recorded. The record is checked at its end. The record is replayed
only if the machine is at the start of the record; the replay stops when the machine is too fast or deviates too far
from its model.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.core.spatial import Array
from twin.model.trainer import MODEL
from twin.simulation.controllers.packet_smoother import PacketSmoother
from twin.simulation.controllers.pedals import CAMERA, TOOLS
from twin.simulation.controllers.plan_states import RUN
from twin.simulation.controllers.tip_comparison import TipComparison
from twin.simulation.controllers.trainer_states import (
    LONGEST_RECORD,
    LONGEST_SILENCE,
    MODE,
    TrainerLimits,
    TrainerMode,
    TrainerPhase,
    TrainerReason,
    mode_of,
)
from twin.simulation.devices.machine_states import ANSWERS, LEVEL
from twin.simulation.machine.levels import Level
from twin.simulation.world import Block, Signals
from twin.simulation.world.signal_kinds import (
    CONSOLE_MODE,
    DEVICE_SILENT,
    ROBOT_GIVEN,
    ROBOT_JAW,
    ROBOT_PACKET,
    ROBOT_PHASE,
    ROBOT_PLANNED,
)

_PEDAL_UP = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0.0])
_PEDAL_DOWN = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1.0])
"""Values (9,) of packets without increments (`machine.itp.FIELDS`), with the pedal up and down."""

_LONGEST_WAIT = 1.0
"""Maximum time in s until machine and model reach PEDAL_DN in a replay."""

_SETTLING_TIME = 0.5
"""Time in s from the last packet of a replay until machine and model are at rest."""


class Trainer(Block):
    """Writes the packets of a machine and of its model.

    Writes `<robot>.packet` (9,) for the machine; `<robot>.given` (10,) for the model: a packet, then 1 in ticks that
    set the model to the joint values of the machine, otherwise 0; and `<robot>.phase` (3,): `TrainerPhase`,
    `TrainerReason`, and the value for `reason_text`.

    Reads `pedals.training`, `console.mode`, `<robot>.goal`, `<robot>.follows`, `<robot>.planned`, `<robot>.jaw`,
    `<robot>.run`, `<robot>.measured`, and of the model `<robot>.model`, `<robot>.deviation` and `<robot>_model.q`; see
    `MachineModelPlant`.
    """

    def __init__(
        self, robot: str, device: str, limits: TrainerLimits, grasp_step: float, tips: TipComparison, dt: float
    ) -> None:
        """Start with teleoperation.

        Args:
            robot: name of the machine.
            device: name of the device of the pedals.
            limits: limits of speeds, distances and angles.
            grasp_step: angle in rad by which one unit of jaw motion in a packet opens the jaws.
            tips: compares joint configurations by the positions of the tip.
            dt: duration of a tick in s.
        """
        self.robot = robot
        self.limits = limits
        self._tips = tips
        self._dt = dt
        self._signal_names = {n: f"{robot}.{n}" for n in ("goal", "follows", "run", "measured", "model", "deviation")}
        self._signal_names["model_q"] = f"{robot}{MODEL}.q"
        self._jaw_signal = ROBOT_JAW.of(robot)
        self._silent_signal = DEVICE_SILENT.of(device)
        self._planned_signal = ROBOT_PLANNED.of(robot)
        self._smoother = PacketSmoother(limits, grasp_step, dt)
        self._setting = 0.0  # of the device, see `asked`
        self._phase = TrainerPhase.TELEOPERATE
        self._reason = TrainerReason.NOTHING
        self._value = 0.0
        self._record: list[Array] = []
        self._start: Array | None = None  # joint values of the machine at the start of the record
        self._has_passed = False  # whether the record has passed its check
        self._was_moving = False  # whether a hand or a plan moves the goal
        self._fastest = 0.0  # largest speed of the model's tip in the rehearsal, m/s
        self._held_before = 0.0  # targets out of reach before the rehearsal
        self._next_packet = 0  # next packet of the replay
        self._ready_time = 0.0  # time in s at which machine and model last were in PEDAL_DN in the replay
        self._heard_time = 0.0  # time in s at which the hands last were not silent
        self.outputs = {
            ROBOT_PACKET.of(robot): _PEDAL_UP,
            ROBOT_GIVEN.of(robot): np.append(_PEDAL_UP, 0.0),
            ROBOT_PHASE.of(robot): [0, 0, 0],
        }

    def step(self, signals: Signals, t: float, dt: float) -> Mapping[str, Array]:
        """Compute the packets of this tick."""
        now = signals.now
        arm_signals = {n: now[name] for n, name in self._signal_names.items()}
        is_ready = arm_signals["run"][ANSWERS] > 0.5 and arm_signals["run"][LEVEL] >= Level.PEDAL_UP
        self._model_starts_anew = False
        setting = now[MODE].item()
        if setting != self._setting:
            self._setting = setting
            self._change(mode_of(setting), arm_signals, is_ready, t)
        machine = _PEDAL_UP
        model = _PEDAL_UP
        if self._phase == TrainerPhase.REPLAY:
            machine = self._replay(signals, arm_signals, t)
            model = machine
        elif self._phase == TrainerPhase.REHEARSE:
            model = self._rehearse(signals, arm_signals, is_ready, dt)
        elif self._phase == TrainerPhase.TELEOPERATE:
            machine = self._from_goal(signals, arm_signals, is_ready, model_alone=False)
            model = machine
        else:
            self._was_moving = False
        for_model = np.append(model, float(self._model_starts_anew))
        return {
            ROBOT_PACKET.of(self.robot): machine,
            ROBOT_GIVEN.of(self.robot): for_model,
            ROBOT_PHASE.of(self.robot): np.array([self._phase, self._reason, self._value]),
        }

    def _is_silent(self, signals: Signals) -> bool:
        return self._silent_signal in signals and signals.now[self._silent_signal].item() > 0.5

    def _is_planned(self, signals: Signals) -> bool:
        """Return whether a plan moves the goal, instead of a hand."""
        return self._planned_signal in signals and signals.now[self._planned_signal].item(0) == RUN

    # -- requested modes -----------------------------------------------------------------------------

    def _change(self, mode: TrainerMode, arm_signals: Mapping[str, Array], is_ready: bool, t: float) -> None:
        self._reason = TrainerReason.NOTHING
        self._value = 0.0
        if mode == TrainerMode.TELEOPERATE:
            self._phase = TrainerPhase.TELEOPERATE
            self._was_moving = False
        elif mode == TrainerMode.REHEARSE:
            if not is_ready:
                return self._stop(TrainerReason.NOT_READY, arm_signals["run"][LEVEL])
            self._phase = TrainerPhase.REHEARSE
            self._model_starts_anew = True
            self._was_moving = False
            self._record = []
            self._start = arm_signals["measured"].copy()
            self._has_passed = False
            self._fastest = 0.0
            self._held_before = float(arm_signals["model"][2])
        elif mode == TrainerMode.JUDGE:
            self._judge(arm_signals)
        else:
            self._begin_replay(arm_signals, is_ready, t)
        return None

    def _judge(self, arm_signals: Mapping[str, Array]) -> None:
        if self._phase != TrainerPhase.REHEARSE or not self._record:
            return self._stop(TrainerReason.NO_RECORD, 0.0)
        self._phase = TrainerPhase.JUDGED
        level = float(arm_signals["model"][0])
        out_of_reach = float(arm_signals["model"][2]) - self._held_before
        if level < Level.PEDAL_UP:
            self._reason = TrainerReason.MODEL_STOPPED
            self._value = level
        elif out_of_reach > 0:
            self._reason = TrainerReason.OUT_OF_REACH
            self._value = out_of_reach
        elif self._fastest > self.limits.rehearsed:
            self._reason = TrainerReason.TOO_FAST
            self._value = self._fastest
        else:
            self._has_passed = True
        return None

    def _begin_replay(self, arm_signals: Mapping[str, Array], is_ready: bool, t: float) -> None:
        if self._start is None or not self._record:
            return self._stop(TrainerReason.NO_RECORD, 0.0)
        if not self._has_passed:
            return self._stop(TrainerReason.NOT_JUDGED, 0.0)
        if not is_ready:
            return self._stop(TrainerReason.NOT_READY, arm_signals["run"][LEVEL])
        distance = self._tips.apart(arm_signals["measured"], self._start)
        if distance > self.limits.start:
            return self._stop(TrainerReason.START, distance)
        angle = self._tips.turned(arm_signals["measured"], self._start)
        if angle > self.limits.start_angle:
            return self._stop(TrainerReason.START_ANGLE, angle)
        self._phase = TrainerPhase.REPLAY
        self._model_starts_anew = True
        self._next_packet = 0
        self._ready_time = t
        self._heard_time = t
        return None

    def _stop(self, reason: TrainerReason, value: float) -> None:
        self._phase = TrainerPhase.STOPPED
        self._reason = reason
        self._value = float(value)

    # -- packets --------------------------------------------------------------------------------------

    def _from_goal(
        self, signals: Signals, arm_signals: Mapping[str, Array], is_ready: bool, *, model_alone: bool
    ) -> Array:
        """Return the values (9,) of this tick's packet; its increments are 0 until PEDAL_DN is reached.

        If the model moves `model_alone`, the machine need not be ready.
        """
        is_moving = (arm_signals["follows"].item() > 0.5 or self._is_planned(signals)) and (is_ready or model_alone)
        goal = arm_signals["goal"].reshape(4, 4)
        if is_moving and not self._was_moving:
            q = arm_signals["model_q"] if model_alone else arm_signals["measured"]
            self._smoother.begin(goal, self._tips.opening(q))
            if not model_alone:
                self._model_starts_anew = True  # the model starts at the joint values of the machine
        self._was_moving = is_moving
        if not is_moving:
            return _PEDAL_UP
        level = arm_signals["model"][0]
        if not model_alone:
            level = min(level, arm_signals["run"][LEVEL])
        if level < Level.PEDAL_DN:
            return _PEDAL_DOWN
        jaw = 0.0
        if self._jaw_signal in signals:
            jaw = signals.now[self._jaw_signal].item()
        return self._smoother.values(goal, jaw)

    def _rehearse(self, signals: Signals, arm_signals: Mapping[str, Array], is_ready: bool, dt: float) -> Array:
        """Return the values (9,) of the model's packet, and record them; the record begins with the motion."""
        if len(self._record) * dt >= LONGEST_RECORD:
            self._reason = TrainerReason.FULL
            self._value = LONGEST_RECORD
            self._was_moving = False
            return _PEDAL_UP
        values = self._from_goal(signals, arm_signals, is_ready, model_alone=True)
        if self._record or values[8] > 0.5:
            self._record.append(values)
            self._fastest = max(self._fastest, float(arm_signals["model"][1]))
        return values

    def _replay(self, signals: Signals, arm_signals: Mapping[str, Array], t: float) -> Array:
        """Return the values (9,) of the packet of this tick, while the operator does not stop the replay."""
        is_silent = self._is_silent(signals)
        if not is_silent:
            self._heard_time = t
        is_clutched = not is_silent and signals.now[CONSOLE_MODE.name].item() not in (TOOLS, CAMERA)
        is_stopped = is_clutched or t - self._heard_time > LONGEST_SILENCE
        # A replay does not begin while the clutch cannot be read.
        is_waiting = self._next_packet == 0 and is_silent and not is_stopped
        if self._model_starts_anew or is_waiting:
            return _PEDAL_UP
        return self._recorded(arm_signals, is_stopped, t)

    def _recorded(self, arm_signals: Mapping[str, Array], is_stopped: bool, t: float) -> Array:
        """Return the values (9,) of the next packet; the replay pauses while machine or model is not in PEDAL_DN."""
        level = arm_signals["run"][LEVEL]
        record = self._record
        values = _PEDAL_DOWN  # after the record, until both are at rest
        if self._next_packet < len(record):
            values = record[self._next_packet]
        is_waiting = min(arm_signals["model"][0], level) < Level.PEDAL_DN and values[8] > 0.5
        if not is_waiting:
            self._ready_time = t
        distance, speed = arm_signals["deviation"]
        # The first reason that applies counts.
        for applies, reason, value in (
            (is_stopped, TrainerReason.OPERATOR, 0.0),
            (arm_signals["run"][ANSWERS] < 0.5, TrainerReason.MACHINE_SILENT, 0.0),
            (level < Level.PEDAL_UP, TrainerReason.MACHINE_STOPPED, level),
            (t - self._ready_time > _LONGEST_WAIT, TrainerReason.NOT_READY, level),
            (speed > self.limits.replayed, TrainerReason.MACHINE_FAST, speed),
            (distance > self.limits.deviation, TrainerReason.DEVIATES, distance),
        ):
            if applies:
                self._stop(reason, value)
                return _PEDAL_UP
        if is_waiting:
            return _PEDAL_DOWN
        self._next_packet += 1
        if self._next_packet > len(record) + round(_SETTLING_TIME / self._dt):
            self._phase = TrainerPhase.DONE
            return _PEDAL_UP
        return values
