"""Simulate a machine of one arm tick by tick: network, PLC, control software, motors and links; no clock, no sockets.

The simulated control software follows the released software of the Raven-II (uw-biorobotics/raven2). While the pedal
is down, the software adds the increments in the packets to the tool pose. The inverse kinematics computes joint values
from this pose, and the servo computes counts of the DAC. If parameters of the plant differ from those in the software,
the machine deviates from its model. Faults act on the signals of `LOCATIONS`:

| signal | numbers | where the fault acts |
|---|---|---|
| wire | sequence number | before a packet is checked |
| packet | `itp.FIELDS` | after a packet has been accepted |
| usb | number of bytes of a read | at the USB board; if the number is not `BYTES`, the software keeps the old counts |
| encoder | counts of each motor | before the software reads them |
| level | run level | as the software reads it from the PLC |
| tool | desired position of the tool, x, y, z in base, µm | while the pedal is down |
| joints | desired joint values, rad or m | while the motors are on |
| dac | counts of each motor | after the checks of the software |
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from operator import le
from typing import Any

import numpy as np

from twin.core import spatial
from twin.core.errors import DeviceError, KinematicsError, TwinError, WorldError, unknown
from twin.core.spatial import Array
from twin.kinematics import Kinematics
from twin.simulation.dynamics.arm import Arm
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.gravity_compensation import GravityEfforts, LoopHolding, compensation
from twin.simulation.machine.itp import FIELDS, Packet
from twin.simulation.machine.levels import Level, Plc, Reader
from twin.simulation.machine.loop_plant import LoopPlant
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import TICK, Physics
from twin.simulation.machine.receiver import Receiver
from twin.simulation.machine.servo import Servo
from twin.simulation.machine.settings import Settings
from twin.simulation.machine.stability import require_stable
from twin.simulation.machine.wire import SENT, Wire

LOCATIONS = {
    "wire": "network",
    "packet": "network",
    "usb": "USB read",
    "encoder": "USB read",
    "level": "control state",
    "tool": "control state",
    "joints": "control state",
    "dac": "USB write",
}
"""Signals that faults can change, each with its place in the machine."""

LOSABLE = ("wire", "packet")
"""Signals that faults can lose or repeat."""

BYTES = 27
"""Number of bytes of a USB board's packet; the software ignores a read of any other length (uw-biorobotics/raven2)."""

_ON = (Level.INIT, Level.PEDAL_DN)
"""Run levels at which the motors are on."""

_MICRO = 1e-6
"""A micrometre in m: packets have positions in whole micrometres."""

_HOMED = (0.02, 5e-3, 5e-4)
"""Largest joint errors at which homing is complete: for a joint without brake, in rad; for a revolute joint with brake,
in rad; for a prismatic joint with brake, in m."""

_STILL = (0.02, 2e-3)
"""Largest rates at which homing is complete: for a revolute joint with brake, in rad/s; for a prismatic one, in m/s."""

_EASE = 1.875
"""Largest speed of a minimum-jerk motion, divided by its mean speed."""


@dataclass(frozen=True)
class Parts:
    """Compiled parts of a machine, which machine and model share.

    Attributes:
        arm: the mechanism with masses.
        kin: the robot's equations, with a closed-form inverse.
        settings: motors, gains and limits.
        plant: a plant with the parameters of the robot's files.
        arithmetic: the control software's arithmetic with the gains of the settings.
        gravity: function from joint values (n,) to the joint efforts (n,) of the gravity compensation.
        home: (n,) joint values of the posture `home`.
        gaps: (lower joint, upper joint, minimum distance in m) of carriages on one rail.
    """

    arm: Arm
    kin: Kinematics
    settings: Settings
    plant: MotorPlant
    arithmetic: Arithmetic
    gravity: GravityEfforts
    home: Array
    gaps: tuple[tuple[str, str, float], ...] = ()

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """For each signal of `LOCATIONS`, the names of its numbers."""
        mechanism = self.arm.mechanism
        motors = tuple(mechanism.motor_names)
        joints = tuple(joint.name for joint in mechanism.active)
        return {
            "wire": SENT,
            "packet": FIELDS,
            "usb": ("bytes",),
            "encoder": motors,
            "level": ("level",),
            "tool": ("x", "y", "z"),
            "joints": joints,
            "dac": motors,
        }

    @classmethod
    def of(cls, arm: Arm, kin: Kinematics, settings: Settings, gaps: Iterable[tuple[str, str, float]] = ()) -> Parts:
        """Compile the equations and the plant of a robot; `gaps`: see `Parts.gaps`.

        Raises:
            MechanismError: the mechanism lacks a frame of the settings; or the gains make a joint oscillate; or its
                passive joints cannot be simulated.
            WorldError: the mechanism has no posture `home`.
        """
        mechanism = arm.mechanism
        if mechanism.home is None:
            raise WorldError(f"{mechanism.name} has no posture 'home', to which a machine moves at its start")
        home = mechanism.posture("home")
        require_stable(arm, settings, home)
        gaps = tuple(gaps)
        physics = Physics.of(arm, settings.coulomb(mechanism))
        plant = LoopPlant(arm, physics, gaps) if mechanism.loops else MotorPlant(arm, physics)
        # A machine evaluates one pose per tick; compiled now, the first tick takes no longer than the others.
        if kin.closed_forward:
            kin.program.forward.compile_one()
        kin.program.inverse.compile_one()
        arithmetic = Arithmetic.of(settings, mechanism)
        gravity = compensation(settings, mechanism)
        return cls(arm, kin, settings, plant, arithmetic, gravity, home, gaps)


class Machine:
    """One arm with its control software and PLC.

    Attributes:
        parts: compiled parts of the machine.
        plc, receiver, servo, plant: controller of power and brakes, check of packets, motor control, simulated arm.
        level: run level as the software reads it.
        t: time of the last tick in s.
        tick: number of ticks.
        q, qd: (n,) joint values and rates as the encoders measure them.
        wanted: (n,) desired joint values.
        dac: (n,) counts of the DAC sent to the motors.
        held: number of packets whose target was out of reach; the arm then kept its last target within reach.
    """

    def __init__(
        self,
        parts: Parts,
        *,
        physics: Physics | None = None,
        q: Array | None = None,
        faults: Sequence[Fault] = (),
    ) -> None:
        """Switch the machine on, in E_STOP.

        Args:
            parts: compiled parts of the machine.
            physics: parameters of the plant; None: those of the robot's files.
            q: (n,) joint values at the start; None: home.
            faults: faults of the signals of `LOCATIONS`.

        Raises:
            WorldError: a fault has an unknown signal, or loses or repeats a signal that is not a packet.
            MechanismError: a parameter of the plant is impossible.
        """
        self.parts = parts
        self._mechanism = parts.arm.mechanism
        self._faults = _by_signal(faults)
        self._wire = Wire(self._faults["wire"])
        self.plant = parts.plant.another(physics)
        self.plant.reset(parts.home if q is None else q)
        settings = parts.settings
        number = settings.number
        self.plc = Plc(number.plc_timeout.value)
        self._reader = Reader(int(number.equal_cycles.value))
        self.receiver = Receiver(settings.arm, settings.packet_version, number.master_timeout.value)
        self.servo = Servo(settings, self._mechanism, parts.arithmetic, settings.mode, settings.overdrive)
        self._prepare_joints(settings)
        self.level = Level.E_STOP
        self.t = float("-inf")
        self.tick = 0
        self.held = 0
        self._bit = False
        self._initialised = False
        self._pedal = False
        n = len(self._mechanism.active)
        self._counts = np.zeros(n)
        self._gravity = _gravity_of_one(parts.gravity)
        self._home_tool = self._tool_at(parts.home, None)
        self._tool = self._tool_at(self.plant.q, self._home_tool)  # the last pose that the software knew
        self._motors: Array | None = None  # known from the first reading of the encoders on
        self._speeds = np.zeros(n)
        self.q = self.plant.q.copy()
        self.qd = np.zeros(n)
        self.dac = np.zeros(n)
        self.wanted = self.q.copy()
        self._rates = np.zeros(n)
        self._target: Array | None = None  # T_base_tool while the pedal is down
        self._homing: tuple[float, float, Array] | None = None  # start and duration in s, joints at the start
        self._brake(True)

    def _prepare_joints(self, settings: Settings) -> None:
        """Store what the control software needs of the joints in each tick."""
        turn = settings.number.counts_per_turn.value / (2 * np.pi)  # counts per rad
        self._count = 1 / turn
        T = self._mechanism.motor_matrix
        self._rates_of = T
        if settings.released.rates_without_coupling:
            one_way = (T != 0) & (T.T == 0)  # the motor of another joint, whose cable runs over this joint
            self._rates_of = np.where(one_way, 0.0, T)
        # Lists: for the few joints of an arm, comparing Python floats is faster than numpy.
        self._low, self._high = self._mechanism.limits.T.tolist()
        self._angles = np.array([joint.is_angle for joint in self._mechanism.active])
        self._grasped = np.flatnonzero(self.parts.kin.auxiliary).tolist()
        brakes = np.array([friction.brake for friction in settings.of_joints(self._mechanism)])
        # A brake is a Coulomb friction in addition to that of the joint.
        self._free = self.plant.physics
        self._braked = replace(self._free, coulomb=self._free.coulomb + brakes)
        self._fast: list[tuple[int, float, str]] = []  # joints whose speed is checked, with limit and unit
        number = settings.number
        for i in np.flatnonzero(brakes > 0).tolist():
            if self._angles[i]:
                self._fast.append((i, number.largest_speed.value, "turns at {:.3g} rad/s"))
            elif number.largest_travel_speed is not None:
                self._fast.append((i, number.largest_travel_speed.value, "moves at {:.3g} m/s"))
        names = [joint.name for joint in self._mechanism.active]
        self._gaps: list[tuple[int, int, float]] = []
        for lower, upper, least in self.parts.gaps:
            self._gaps.append((names.index(lower), names.index(upper), least))
        self._close = np.where(brakes == 0, _HOMED[0], np.where(self._angles, *_HOMED[1:]))
        self._still = np.where(brakes == 0, np.inf, np.where(self._angles, *_STILL))

    def start(self) -> None:
        """Press the start button, which has an effect only in E_STOP."""
        if self.plc.level != Level.E_STOP:
            return
        self.servo.reset()
        self._initialised = False
        self._homing = None
        self.plc.start(max(self.t, 0.0))

    def stand(self, q: Array) -> None:
        """Put the arm at rest at joint values q (n,), in the state after homing: PEDAL_UP, brakes on, servo reset."""
        self.plant.reset(q)
        self.plc.ready()
        self._reader.hold(Level.PEDAL_UP)
        self.level = Level.PEDAL_UP
        self._initialised = True
        self._pedal = False
        self._target = None
        self._gravity = _gravity_of_one(self.parts.gravity)
        self._tool = self._tool_at(q, self._tool)
        self.servo.reset()
        self._motors = self._encoders() * self.parts.arithmetic.angle
        self._speeds = np.zeros_like(self._speeds)
        self._rates = np.zeros_like(self._rates)
        self.q = self._mechanism.from_motors(self._motors)
        self.qd = np.zeros_like(self.qd)
        self.wanted = self.q.copy()
        self.dac = np.zeros_like(self.dac)
        self._brake(True)

    def stop(self, reason: str = "the stop button is pressed") -> None:
        """Press the stop button."""
        self.plc.stop(reason)

    @property
    def reason(self) -> str:
        """Reason why the machine is in E_STOP; "" in other run levels."""
        return self.plc.reason

    def step(self, t: float, packets: Iterable[tuple[bytes, Any]] = ()) -> list[tuple[bytes, Any]]:
        """Run one tick at t in s with the packets (bytes, sender) that have arrived; return packets to send back.

        Invalid packets have no effect; `receiver` counts them.
        """
        if not t > self.t:
            self.plc.stop(f"the clock went back from {self.t:g} s to {t:g} s")
            t = self.t
        self.t = t
        answers = []
        accepted: list[Packet] = []
        for data, sender in self._wire.carry(t, packets):
            try:
                packet = self.receiver.read(data, sender, t)
            except DeviceError:
                continue
            if packet is None:
                answers.append((data, sender))
            else:
                accepted += self._disturbed(packet)
        # A read of another length is ignored: the software keeps the counts of the previous tick.
        if not self._faults["usb"] or self._changed("usb", t, np.array([float(BYTES)]))[0] == BYTES:
            self._counts = self._encoders()
        counts = self._changed("encoder", t, self._counts)
        try:
            self._control(t, counts, accepted)
            self._bit = not self._bit
        except TwinError as error:  # the watchdog bit does not change: the PLC stops the arm
            self.servo.stop = self.servo.stop or str(error)
        if self.servo.stop:
            self.plc.stop(self.servo.stop)
        allowed = self.plc.step(t, self._bit, self._initialised, self._pedal)
        powered = allowed in _ON
        self._brake(not powered)
        sent = self._changed("dac", t, self.dac)
        self.dac = sent if powered else np.zeros_like(sent)
        self.plant.advance(self.servo.torques(self.dac))
        self.tick += 1
        return answers

    def _encoders(self) -> Array:
        return np.rint(self._mechanism.motors(self.plant.encoded) / self._count)

    # -- the control software ----------------------------------------------------------------------------

    def _control(self, t: float, counts: Array, packets: list[Packet]) -> None:
        """Run one tick of the control software at t in s: encoder counts (n,) and packets to counts of the DAC."""
        previous_level = self.level
        self._sense(counts)
        level = self._level(t, self._reader.read([self.plc.level]))
        self.level = level
        if packets:
            self._pedal = bool(packets[-1].values[8])
        if self.receiver.silent(t):
            self._pedal = False
        if level == Level.E_STOP:
            self._initialised = False
            self._homing = None
        self._check_speed()
        if level != previous_level:
            self._change_level()
        previous = self.wanted
        if level == Level.INIT:
            self.wanted = self._home(t)
        elif level == Level.PEDAL_DN:
            for packet in packets:
                self._follow(packet)
            self._misplace(t)
        if level in _ON:
            self.wanted = self._changed("joints", t, self.wanted)
        aim = self.parts.arithmetic.aim(self.wanted, previous, self._rates, self.q, self.qd)
        n = len(counts)
        self._rates = aim[:n]
        if level in _ON:
            error = self._mechanism.motors(aim[n : 2 * n])
            error_rate = self._mechanism.motors(aim[2 * n :])
            self.dac = self.servo.counts_of(error, error_rate, self._gravity(self.q))
        else:
            self.dac = np.zeros_like(self.q)

    def _sense(self, counts: Array) -> None:
        """Compute joint values and filtered rates from encoder counts (n,)."""
        arithmetic = self.parts.arithmetic
        if self._motors is None:
            self._motors = counts * arithmetic.angle
        readings = arithmetic.sense(counts, self._motors, self._speeds)
        n = len(counts)
        self._motors = readings[:n]
        self._speeds = readings[n:]
        self.q = self._mechanism.from_motors(self._motors)
        self.qd = self._rates_of.dot(self._speeds)

    def _change_level(self) -> None:
        """Start a new run level from the measured joint values, so that the arm does not jump."""
        if not self.servo.stop:
            self.servo.reset()
        self.wanted = self.q.copy()
        self._rates = np.zeros_like(self.q)
        self._target = None
        if self.level == Level.PEDAL_DN:
            self._tool = self._tool_at(self.q, self._tool)
            self._target = self._tool.copy()

    def _check_speed(self) -> None:
        """Stop the arm if a joint with a brake is faster than its limit while the motors are on."""
        if self.level not in _ON:
            return
        for i, limit, text in self._fast:
            if not abs(self.qd[i]) <= limit:  # true also for NaN
                name = self._mechanism.active[i].name
                self.servo.stop = f"{name} {text.format(self.qd[i])} (limit {limit:g})"
                return

    def _home(self, t: float) -> Array:
        """Return the desired joint values (n,) at t in s: a minimum-jerk motion from the start of homing to home."""
        home = self.parts.home
        if self._homing is None:
            # The setting is in rad/s; a prismatic joint moves with a tenth of the number in m/s.
            speeds = self.parts.settings.number.homing_speed.value * np.where(self._angles, 1.0, 0.1)
            times = np.abs(home - self.q) / speeds
            duration = max(_EASE * float(times.max()), 10 * TICK)
            self._homing = t, duration, self.q.copy()
        begin, duration, start = self._homing
        s = min((t - begin) / duration, 1.0)
        close = np.abs(home - self.q) <= self._close
        still = np.abs(self.qd) <= self._still
        if s == 1 and close.all() and still.all():
            self._initialised = True
            self._tool = self._home_tool
        fraction = 10 * s**3 - 15 * s**4 + 6 * s**5
        return start + fraction * (home - start)

    def _follow(self, packet: Packet) -> None:
        """Move the target by the increments of a packet, if the new target is within reach and joint limits."""
        if self._target is None:
            return
        _, _, _, _, qx, qy, qz, grasp, _ = packet.values.tolist()
        T = self._target.copy()
        T[:3, 3] += _MICRO * packet.values[:3]
        if qx or qy or qz:  # without vector part, the quaternion is no rotation
            quat_wxyz = packet.values[3:7]
            T[:3, :3] = spatial.matrix_from_quat_wxyz(quat_wxyz / np.linalg.norm(quat_wxyz)) @ T[:3, :3]
        seed = self.wanted
        if grasp:
            opening = self.parts.settings.number.grasp_step.value * grasp
            seed = seed.copy()
            for i in self._grasped:
                seed[i] = min(max(seed[i] + opening, self._low[i]), self._high[i])
        self._reach(T, seed)

    def _reach(self, T: Array, seed: Array) -> None:
        """Move the target to pose T, if T is within reach and joint limits; `seed` (n,): see `Kinematics.inverse`."""
        try:
            q = self.parts.kin.inverse(T, seed)
        except KinematicsError:
            self.held += 1
            return
        joints = q.tolist()
        if not (all(map(le, self._low, joints)) and all(map(le, joints, self._high))) or self._is_closed_off(T, joints):
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
        alarms = self.parts.kin.singularity_alarm(Ts=T[None])
        return any(alarm.any() for alarm in alarms.values())

    def _tool_at(self, q: Array, near: Array | None) -> Array:
        """Return the pose (4, 4) of the tool at joint values q (n,); of several assemblies, that of the pose `near`."""
        if not self._mechanism.loops:
            return self.parts.kin.forward(q)
        return self.parts.kin.forward(q, near)

    # -- faults and power --------------------------------------------------------------------------------

    def _disturbed(self, packet: Packet) -> list[Packet]:
        """Return an accepted packet as its faults leave it: none, one, or several."""
        if not self._faults["packet"]:
            return [packet]
        values = packet.values
        copies = 1
        for fault in self._faults["packet"]:
            moment = packet.sequence if fault.counts else self.t
            copies *= fault.copies(moment)
            values = fault.change(moment, values)
        return [packet._replace(values=values)] * copies

    def _level(self, t: float, level: Level) -> Level:
        if not self._faults["level"]:
            return level
        number = self._changed("level", t, np.array([float(level)]))[0]
        return Level(int(np.clip(number, min(Level), max(Level))))

    def _misplace(self, t: float) -> None:
        """Apply faults to the desired position of the tool."""
        if self._target is None or not self._faults["tool"]:
            return
        position = self._target[:3, 3] / _MICRO
        faulty = self._changed("tool", t, position)
        if (faulty != position).any():
            T = self._target.copy()
            T[:3, 3] = faulty * _MICRO
            self._reach(T, self.wanted)

    def _changed(self, signal: str, t: float, value: Array) -> Array:
        """Return the value of a signal as its faults leave it at t in s."""
        for fault in self._faults[signal]:
            moment = self.receiver.sequence if fault.counts else t
            value = fault.change(moment, value)
        return value

    def _brake(self, on: bool) -> None:
        physics = self._braked if on else self._free
        # Setting checks all parameters; so set only when the brakes change.
        if self.plant.physics is not physics:
            self.plant.set(physics)


def _gravity_of_one(gravity: GravityEfforts) -> GravityEfforts:
    """Return the gravity compensation for one machine: with loops, it remembers how these were closed."""
    if isinstance(gravity, LoopHolding):
        return gravity.another()
    return gravity


def _by_signal(faults: Iterable[Fault]) -> dict[str, list[Fault]]:
    """Return {signal of `LOCATIONS`: its faults}; raise a `WorldError` if a fault is impossible."""
    by_signal: dict[str, list[Fault]] = {}
    for name in LOCATIONS:
        by_signal[name] = []
    for fault in faults:
        if fault.signal not in LOCATIONS:
            raise WorldError(unknown("signal of the machine", fault.signal, LOCATIONS))
        if fault.operation in ("skip", "duplicate") and fault.signal not in LOSABLE:
            raise WorldError(f"fault of {fault.signal}: {fault.operation} is possible for packets only; use hold")
        by_signal[fault.signal].append(fault)
    return by_signal
