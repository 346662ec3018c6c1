"""Simulated control software of a machine: from encoder counts and packets to counts of the DAC, one call per tick.

It follows the released software of the Raven-II (uw-biorobotics/raven2). What it does depends on the run level that it
reads:

| run level | desired joint values | motors |
|---|---|---|
| E_STOP | the measured ones at the change of level | off |
| INIT | a minimum-jerk motion to home (`_home`) | on |
| PEDAL_UP | the measured ones at the change of level | off |
| PEDAL_DN | those of a target pose, which the increments in the packets move (`_follow`) | on |

While the motors are on, the servo computes counts of the DAC from desired and measured joint values. At each change of
the level, the desired joint values begin at the measured ones, so that the arm does not jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import le
from typing import NamedTuple

import numpy as np

from twin.core import spatial
from twin.core.errors import KinematicsError
from twin.core.spatial import Array, length
from twin.core.units import UM
from twin.simulation.machine.gravity_compensation import GravityEfforts, LoopHolding
from twin.simulation.machine.itp import Packet
from twin.simulation.machine.levels import Level, Reader
from twin.simulation.machine.machine_faults import MachineFaults
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import TICK
from twin.simulation.machine.servo import Servo
from twin.simulation.machine.settings import Settings

MOTORS_ON = (Level.INIT, Level.PEDAL_DN)
"""Run levels at which the motors are on."""

_HOMED_ERRORS = (0.02, 5e-3, 5e-4)
"""Largest joint errors at which homing is complete: for a joint without brake, in rad; for a revolute joint with brake,
in rad; for a prismatic joint with brake, in m."""

_HOMED_RATES = (0.02, 2e-3)
"""Largest rates at which homing is complete: for a revolute joint with brake, in rad/s; for a prismatic one, in m/s."""

_MINIMUM_JERK_PEAK = 1.875
"""Largest speed of a minimum-jerk motion, divided by its mean speed."""

_SLIDE_PER_TURN = 0.1
"""Homing speed of a prismatic joint in m/s, divided by that of a revolute joint in rad/s, which is the setting."""

_SHORTEST_HOMING = 10 * TICK
"""Shortest duration of homing in s."""


class _SpeedLimit(NamedTuple):
    """Speed limit of a joint with a brake: index of the joint, limit in rad/s or m/s, and message for a rate."""

    joint: int
    limit: float
    message: str


class _Homing(NamedTuple):
    """A motion to home: its start and duration in s, and the joint values (n,) at its start."""

    start: float
    duration: float
    q: Array


class ControlSoftware:
    """Control software of one arm with n joints.

    Attributes:
        level: run level as the software reads it.
        q, qd: (n,) joint values and rates as the encoders measure them.
        wanted: (n,) desired joint values.
        dac: (n,) counts of the DAC that the software asks for.
        held: number of packets whose target was out of reach; the arm then kept its last target within reach.
        servo: control of the motors; its `stop` is the reason why the arm must stop.
        watchdog_bit: changes in each tick without an error.
        is_initialised: whether the arm has homed.
        is_pedal_down: whether the pedal is down, by the last packet.
    """

    def __init__(self, parts: Parts, faults: MachineFaults, q: Array) -> None:
        """Start in E_STOP, with the arm at joint values q (n,)."""
        settings = parts.settings
        self._parts = parts
        self._faults = faults
        self._mechanism = parts.arm.mechanism
        self._reader = Reader(int(settings.number.equal_cycles.value))
        self.servo = Servo(settings, self._mechanism, parts.arithmetic, settings.mode, settings.overdrive)
        self._prepare_joints(settings)
        self.level = Level.E_STOP
        self.held = 0
        self.watchdog_bit = False
        self.is_initialised = False
        self.is_pedal_down = False
        n = len(q)
        self._gravity = _own_gravity(parts.gravity)
        self._home_tool = self._tool_at(parts.home, None)
        self._tool = self._tool_at(q, self._home_tool)  # the last pose that the software knew
        self._motors: Array | None = None  # motor values, known from the first reading of the encoders on
        self._motor_rates = np.zeros(n)  # filtered
        self.q = q.copy()
        self.qd = np.zeros(n)
        self.dac = np.zeros(n)
        self.wanted = q.copy()
        self._wanted_rates = np.zeros(n)  # filtered
        self._target: Array | None = None  # T_base_tool while the pedal is down
        self._homing: _Homing | None = None

    def _prepare_joints(self, settings: Settings) -> None:
        """Store what is needed of the joints in each tick."""
        T = self._mechanism.motor_matrix
        self._rate_matrix = T  # rates of the joints per rate of each motor
        if settings.released.rates_without_coupling:
            is_one_way = (T != 0) & (T.T == 0)  # the motor of another joint, whose cable runs over this joint
            self._rate_matrix = np.where(is_one_way, 0.0, T)
        # Lists: for the few joints of an arm, comparing Python floats is faster than numpy.
        self._low, self._high = self._mechanism.limits.T.tolist()
        self._is_angle = np.array([joint.is_angle for joint in self._mechanism.active])
        self._jaw_joints = np.flatnonzero(self._parts.kin.auxiliary).tolist()
        brakes = np.array([friction.brake for friction in settings.of_joints(self._mechanism)])
        self._speed_limits: list[_SpeedLimit] = []
        number = settings.number
        for i in np.flatnonzero(brakes > 0).tolist():
            if self._is_angle[i]:
                self._speed_limits.append(_SpeedLimit(i, number.largest_speed.value, "turns at {:.3g} rad/s"))
            elif number.largest_travel_speed is not None:
                limit = number.largest_travel_speed.value
                self._speed_limits.append(_SpeedLimit(i, limit, "moves at {:.3g} m/s"))
        names = [joint.name for joint in self._mechanism.active]
        self._gaps: list[tuple[int, int, float]] = []
        for lower, upper, least in self._parts.gaps:
            self._gaps.append((names.index(lower), names.index(upper), least))
        unbraked_error, *braked_errors = _HOMED_ERRORS
        self._homed_errors = np.where(brakes == 0, unbraked_error, np.where(self._is_angle, *braked_errors))
        self._homed_rates = np.where(brakes == 0, np.inf, np.where(self._is_angle, *_HOMED_RATES))

    def restart(self) -> None:
        """Forget errors and homing, as after a press of the start button in E_STOP."""
        self.servo.reset()
        self.is_initialised = False
        self._homing = None

    def stand(self, q: Array, counts: Array) -> None:
        """Take the state after homing, PEDAL_UP, of an arm at rest at joint values q (n,) with encoder counts (n,)."""
        self._reader.hold(Level.PEDAL_UP)
        self.level = Level.PEDAL_UP
        self.is_initialised = True
        self.is_pedal_down = False
        self._target = None
        self._gravity = _own_gravity(self._parts.gravity)
        self._tool = self._tool_at(q, self._tool)
        self.servo.reset()
        self._motors = counts * self._parts.arithmetic.angle
        self._motor_rates = np.zeros_like(self._motor_rates)
        self._wanted_rates = np.zeros_like(self._wanted_rates)
        self.q = self._mechanism.from_motors(self._motors)
        self.qd = np.zeros_like(self.qd)
        self.wanted = self.q.copy()
        self.dac = np.zeros_like(self.dac)

    def step(self, t: float, counts: Array, packets: Sequence[Packet], plc_level: Level, is_silent: bool) -> None:
        """Run one tick at t in s.

        Args:
            t: time in s.
            counts: (n,) encoder counts.
            packets: accepted packets of this tick.
            plc_level: run level that the PLC allows.
            is_silent: whether no packet has come for longer than the time-out.

        Raises:
            TwinError: a computation failed; the watchdog bit has not changed, so that the PLC stops the arm.
        """
        previous_level = self.level
        self._sense(counts)
        level = self._read_level(t, plc_level)
        self.level = level
        if packets:
            self.is_pedal_down = bool(packets[-1].values[8])
        if is_silent:
            self.is_pedal_down = False
        if level == Level.E_STOP:
            self.is_initialised = False
            self._homing = None
        self._check_speed()
        if level != previous_level:
            self._change_level()
        previous_wanted = self.wanted
        if level == Level.INIT:
            self.wanted = self._home(t)
        elif level == Level.PEDAL_DN:
            for packet in packets:
                self._follow(packet)
            self._apply_tool_faults(t)
        if level in MOTORS_ON:
            self.wanted = self._faults.changed("joints", t, self.wanted)
        self._drive(previous_wanted)
        self.watchdog_bit = not self.watchdog_bit

    def _sense(self, counts: Array) -> None:
        """Compute joint values and filtered rates from encoder counts (n,)."""
        arithmetic = self._parts.arithmetic
        if self._motors is None:
            self._motors = counts * arithmetic.angle
        readings = arithmetic.sense(counts, self._motors, self._motor_rates)
        n = len(counts)
        self._motors = readings[:n]
        self._motor_rates = readings[n:]
        self.q = self._mechanism.from_motors(self._motors)
        self.qd = self._rate_matrix @ self._motor_rates

    def _read_level(self, t: float, plc_level: Level) -> Level:
        """Return the run level that counts at t in s, as its faults leave it."""
        level = self._reader.read([plc_level])
        if not self._faults.of("level"):
            return level
        number = self._faults.changed("level", t, np.array([float(level)]))[0]
        return Level(int(np.clip(number, min(Level), max(Level))))

    def _check_speed(self) -> None:
        """Stop the arm if a joint with a brake is faster than its limit while the motors are on."""
        if self.level not in MOTORS_ON:
            return
        for joint, limit, message in self._speed_limits:
            if not abs(self.qd[joint]) <= limit:  # true also for NaN
                name = self._mechanism.active[joint].name
                self.servo.stop = f"{name} {message.format(self.qd[joint])} (limit {limit:g})"
                return

    def _change_level(self) -> None:
        """Start a new run level from the measured joint values, so that the arm does not jump."""
        if not self.servo.stop:
            self.servo.reset()
        self.wanted = self.q.copy()
        self._wanted_rates = np.zeros_like(self.q)
        self._target = None
        if self.level == Level.PEDAL_DN:
            self._tool = self._tool_at(self.q, self._tool)
            self._target = self._tool.copy()

    def _drive(self, previous_wanted: Array) -> None:
        """Compute the counts of the DAC from the desired joint values (n,) of this tick and of the previous one."""
        aim = self._parts.arithmetic.aim(self.wanted, previous_wanted, self._wanted_rates, self.q, self.qd)
        n = len(self.q)
        self._wanted_rates = aim[:n]
        if self.level in MOTORS_ON:
            error = self._mechanism.motors(aim[n : 2 * n])
            error_rate = self._mechanism.motors(aim[2 * n :])
            self.dac = self.servo.counts_of(error, error_rate, self._gravity(self.q))
        else:
            self.dac = np.zeros_like(self.q)

    def _home(self, t: float) -> Array:
        """Return the desired joint values (n,) at t in s: a minimum-jerk motion from the start of homing to home."""
        home = self._parts.home
        if self._homing is None:
            speed = self._parts.settings.number.homing_speed.value
            speeds = speed * np.where(self._is_angle, 1.0, _SLIDE_PER_TURN)
            times = np.abs(home - self.q) / speeds
            duration = max(_MINIMUM_JERK_PEAK * float(times.max()), _SHORTEST_HOMING)
            self._homing = _Homing(t, duration, self.q.copy())
        start_time, duration, start = self._homing
        s = min((t - start_time) / duration, 1.0)
        is_close = np.abs(home - self.q) <= self._homed_errors
        is_still = np.abs(self.qd) <= self._homed_rates
        if s == 1 and is_close.all() and is_still.all():
            self.is_initialised = True
            self._tool = self._home_tool
        fraction = 10 * s**3 - 15 * s**4 + 6 * s**5
        return start + fraction * (home - start)

    def _follow(self, packet: Packet) -> None:
        """Move the target by the increments of a packet, if the new target is within reach and joint limits."""
        if self._target is None:
            return
        _, _, _, _, qx, qy, qz, grasp, _ = packet.values.tolist()
        T = self._target.copy()
        T[:3, 3] += UM * packet.values[:3]
        if qx or qy or qz:  # without vector part, the quaternion is no rotation
            quat_wxyz = packet.values[3:7]
            T[:3, :3] = spatial.matrix_from_quat_wxyz(quat_wxyz / length(quat_wxyz)) @ T[:3, :3]
        seed = self.wanted
        if grasp:
            opening = self._parts.settings.number.grasp_step.value * grasp
            seed = seed.copy()
            for i in self._jaw_joints:
                seed[i] = min(max(seed[i] + opening, self._low[i]), self._high[i])
        self.reach(T, seed)

    def _apply_tool_faults(self, t: float) -> None:
        """Apply faults to the desired position of the tool at t in s."""
        if self._target is None or not self._faults.of("tool"):
            return
        position = self._target[:3, 3] / UM
        faulty_position = self._faults.changed("tool", t, position)
        if (faulty_position != position).any():
            T = self._target.copy()
            T[:3, 3] = faulty_position * UM
            self.reach(T, self.wanted)

    def reach(self, T: Array, seed: Array) -> None:
        """Move the target to pose T, if T is within reach and joint limits; `seed` (n,): see `Kinematics.inverse`."""
        try:
            q = self._parts.kin.inverse(T, seed)
        except KinematicsError:
            self.held += 1
            return
        joints = q.tolist()
        is_in_limits = all(map(le, self._low, joints)) and all(map(le, joints, self._high))
        if not is_in_limits or self._is_closed_off(T, joints):
            self.held += 1
            return
        self._target = T
        self._tool = T
        self.wanted = q

    def _is_closed_off(self, T: Array, joints: list[float]) -> bool:
        """Return whether carriages on one rail come too close at T, or a robot with loops comes near a singularity.

        There, the loops of a parallel robot no longer hold its platform, or change to another assembly.
        """
        for lower, upper, least in self._gaps:
            if joints[upper] - joints[lower] < least:
                return True
        if not self._mechanism.loops:
            return False
        alarms = self._parts.kin.singularity_alarm(Ts=T[None])
        return any(alarm.any() for alarm in alarms.values())

    def _tool_at(self, q: Array, near: Array | None) -> Array:
        """Return the pose (4, 4) of the tool at joint values q (n,); of several assemblies, that of the pose `near`."""
        if not self._mechanism.loops:
            return self._parts.kin.forward(q)
        return self._parts.kin.forward(q, near)


def _own_gravity(gravity: GravityEfforts) -> GravityEfforts:
    """Return the gravity compensation for one machine: with loops, it remembers how these were closed."""
    if isinstance(gravity, LoopHolding):
        return gravity.another()
    return gravity
