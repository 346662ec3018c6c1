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

from collections.abc import Callable, Iterable, Sequence
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
from twin.simulation.machine.itp import FIELDS, Packet
from twin.simulation.machine.levels import Level, Plc, Reader
from twin.simulation.machine.plant import TICK, Physics, Plant
from twin.simulation.machine.receiver import Receiver
from twin.simulation.machine.servo import Servo, compensation
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
    """

    arm: Arm
    kin: Kinematics
    settings: Settings
    plant: Plant
    arithmetic: Arithmetic
    gravity: Callable[[Array], Array]
    home: Array

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """For each signal of `LOCATIONS`, the names of its numbers."""
        m = self.arm.mechanism
        motors, joints = tuple(m.motor_names), tuple(j.name for j in m.active)
        many = {"packet": FIELDS, "encoder": motors, "tool": ("x", "y", "z"), "joints": joints, "dac": motors}
        return {"wire": SENT, "usb": ("bytes",), "level": ("level",)} | many

    @classmethod
    def of(cls, arm: Arm, kin: Kinematics, settings: Settings) -> Parts:
        """Compile the equations and the plant of a robot.

        Raises:
            MechanismError: the mechanism has loops, or lacks a frame of the settings; or the gains make a joint
                oscillate.
            WorldError: the mechanism has no posture `home`.
        """
        m = arm.mechanism
        if m.home is None:
            raise WorldError(f"{m.name} has no posture 'home', to which a machine moves at its start")
        require_stable(arm, settings, m.posture("home"))
        plant = Plant(arm, Physics.of(arm, settings.coulomb(m)))
        for equation in (kin.program.forward, kin.program.inverse):
            equation.compile_one()
        return cls(arm, kin, settings, plant, Arithmetic.of(settings, m), compensation(settings, m), m.posture("home"))


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
        for fault in faults:
            if fault.signal not in LOCATIONS:
                raise WorldError(unknown("signal of the machine", fault.signal, LOCATIONS))
            if fault.operation in ("skip", "duplicate") and fault.signal not in LOSABLE:
                raise WorldError(f"fault of {fault.signal}: {fault.operation} is possible for packets only; use hold")
        self.parts, s = parts, parts.settings
        self._mechanism = m = parts.arm.mechanism
        self._faults = {name: [f for f in faults if f.signal == name] for name in LOCATIONS}
        self._wire = Wire(self._faults["wire"])
        self.plant = parts.plant.another(physics)
        self.plant.reset(parts.home if q is None else q)
        brakes = np.array([j.brake for j in s.of_joints(m)])
        own = self.plant.physics
        self._free, self._braked = own, replace(own, coulomb=own.coulomb + brakes)
        self.plc, self._reader = Plc(s.number.plc_timeout.value), Reader(int(s.number.equal_cycles.value))
        self.receiver = Receiver(s.arm, s.packet_version, s.number.master_timeout.value)
        self.servo = Servo(s, m, parts.arithmetic, s.mode, s.overdrive)
        self.level, self.t, self.tick, self.held = Level.E_STOP, float("-inf"), 0, 0
        self._bit = self._initialised = self._pedal = False
        self._count = 1 / (s.number.counts_per_turn.value / (2 * np.pi))
        self._counts = np.zeros(len(m.active))
        T = m.motor_matrix
        one_way = (T != 0) & (T.T == 0)  # the motor of another joint, whose cable runs over this joint
        self._rates_of = np.where(one_way, 0.0, T) if s.released.rates_without_coupling else T
        self._low, self._high = np.array([j.limits or (-np.inf, np.inf) for j in m.active]).T.tolist()
        self._angles = np.array([j.is_angle for j in m.active])
        self._fast = np.flatnonzero(self._angles & (brakes > 0)).tolist()
        self._close = np.where(brakes == 0, _HOMED[0], np.where(self._angles, *_HOMED[1:]))
        self._still = np.where(brakes == 0, np.inf, np.where(self._angles, *_STILL))
        self._grasped = np.flatnonzero(parts.kin.auxiliary).tolist()
        n = len(m.active)
        self._motors, self._speeds, self.qd, self.dac = None, np.zeros(n), np.zeros(n), np.zeros(n)
        self.q = self.plant.q.copy()
        self.wanted, self._rates = self.q.copy(), np.zeros(n)
        self._target: Array | None = None  # T_base_tool while the pedal is down
        self._homing: tuple[float, float, Array] | None = None  # start and duration in s, joints at the start
        self._brake(True)

    def start(self) -> None:
        """Press the start button, which has an effect only in E_STOP."""
        if self.plc.level != Level.E_STOP:
            return
        self.servo.reset()
        self._initialised, self._homing = False, None
        self.plc.start(max(self.t, 0.0))

    def stand(self, q: Array) -> None:
        """Put the arm at rest at joint values q (n,), in the state after homing: PEDAL_UP, brakes on, servo reset."""
        self.plant.reset(q)
        self.plc.ready()
        self._reader.hold(Level.PEDAL_UP)
        self.level, self._initialised, self._pedal, self._target = Level.PEDAL_UP, True, False, None
        self.servo.reset()
        self._motors = self._encoders() * self.parts.arithmetic.angle
        self._speeds, self._rates = np.zeros_like(self._speeds), np.zeros_like(self._rates)
        self.q, self.qd = self._mechanism.from_motors(self._motors), np.zeros_like(self.qd)
        self.wanted, self.dac = self.q.copy(), np.zeros_like(self.dac)
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
        back, accepted = [], []
        for data, sender in self._wire.carry(t, packets):
            try:
                packet = self.receiver.read(data, sender, t)
            except DeviceError:
                continue
            back += [(data, sender)] if packet is None else []
            accepted += self._disturbed(packet) if packet is not None else []
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
        return back

    def _encoders(self) -> Array:
        return np.rint(self._mechanism.motors(self.plant.q) / self._count)

    # -- the control software ----------------------------------------------------------------------------

    def _control(self, t: float, counts: Array, packets: list[Packet]) -> None:
        m, arithmetic, n, before = self._mechanism, self.parts.arithmetic, len(counts), self.level
        if self._motors is None:
            self._motors = counts * arithmetic.angle
        read = arithmetic.sense(counts, self._motors, self._speeds)
        self._motors, self._speeds = read[:n], read[n:]
        self.q, self.qd = m.from_motors(self._motors), self._rates_of.dot(self._speeds)
        self.level = level = self._level(t, self._reader.read([self.plc.level]))
        pedals = [bool(p.values[8]) for p in packets] or [self._pedal]
        self._pedal = pedals[-1] and not self.receiver.silent(t)
        if level == Level.E_STOP:
            self._initialised, self._homing = False, None
        self._check_speed()
        if level != before:
            if not self.servo.stop:
                self.servo.reset()
            self.wanted, self._rates = self.q.copy(), np.zeros_like(self.q)
            self._target = self.parts.kin.forward(self.q) if level == Level.PEDAL_DN else None
        old = self.wanted
        if level == Level.INIT:
            self.wanted = self._home(t)
        elif level == Level.PEDAL_DN:
            for packet in packets:
                self._follow(packet)
            self._misplace(t)
        if level in _ON:
            self.wanted = self._changed("joints", t, self.wanted)
        aimed = arithmetic.aim(self.wanted, old, self._rates, self.q, self.qd)
        self._rates = aimed[:n]
        if level in _ON:
            error, change = m.motors(aimed[n : 2 * n]), m.motors(aimed[2 * n :])
            self.dac = self.servo.counts_of(error, change, self.parts.gravity(self.q))
        else:
            self.dac = np.zeros_like(self.q)

    def _check_speed(self) -> None:
        if self.level not in _ON:
            return
        most = self.parts.settings.number.largest_speed.value
        for i in self._fast:
            if not abs(self.qd[i]) <= most:
                name = self._mechanism.active[i].name
                self.servo.stop = f"{name} turns at {self.qd[i]:.3g} rad/s (limit {most:g})"
                return

    def _home(self, t: float) -> Array:
        """Return the desired joint values (n,) at t in s: a minimum-jerk motion from the start of homing to home."""
        speed = self.parts.settings.number.homing_speed.value * np.where(self._angles, 1.0, 0.1)
        if self._homing is None:
            way = np.abs(self.parts.home - self.q) / speed
            self._homing = t, max(_EASE * float(way.max()), 10 * TICK), self.q.copy()
        begin, duration, start = self._homing
        s = min((t - begin) / duration, 1.0)
        error = np.abs(self.parts.home - self.q)
        if s == 1 and (error <= self._close).all() and (np.abs(self.qd) <= self._still).all():
            self._initialised = True
        return start + (10 * s**3 - 15 * s**4 + 6 * s**5) * (self.parts.home - start)

    def _follow(self, packet: Packet) -> None:
        """Move the target by the increments of a packet, if the new target is within reach and joint limits."""
        if self._target is None:
            return
        v = packet.values
        _, _, _, _, x, y, z, grasp, _ = v.tolist()
        T = self._target.copy()
        T[:3, 3] += _MICRO * v[:3]
        if x or y or z:
            T[:3, :3] = spatial.matrix_from_quat_wxyz(v[3:7] / np.linalg.norm(v[3:7])) @ T[:3, :3]
        seed = self.wanted
        if grasp:
            seed, more = seed.copy(), self.parts.settings.number.grasp_step.value * grasp
            for i in self._grasped:
                seed[i] = min(max(seed[i] + more, self._low[i]), self._high[i])
        self._reach(T, seed)

    def _reach(self, T: Array, seed: Array) -> None:
        """Move the target to pose T, if T is within reach and joint limits; `seed` (n,): see `Kinematics.inverse`."""
        try:
            q = self.parts.kin.inverse(T, seed)
        except KinematicsError:
            self.held += 1
            return
        joints = q.tolist()
        if not (all(map(le, self._low, joints)) and all(map(le, joints, self._high))):
            self.held += 1
            return
        self._target, self.wanted = T, q

    # -- faults and power --------------------------------------------------------------------------------

    def _disturbed(self, packet: Packet) -> list[Packet]:
        if not self._faults["packet"]:
            return [packet]
        values, copies = packet.values, 1
        for fault in self._faults["packet"]:
            at = packet.sequence if fault.counts else self.t
            copies *= fault.copies(at)
            values = fault.change(at, values)
        return [packet._replace(values=values)] * copies

    def _level(self, t: float, level: Level) -> Level:
        if not self._faults["level"]:
            return level
        return Level(int(np.clip(self._changed("level", t, np.array([float(level)]))[0], 0, 3)))

    def _misplace(self, t: float) -> None:
        """Apply faults to the desired position of the tool."""
        if self._target is None or not self._faults["tool"]:
            return
        place = self._target[:3, 3] / _MICRO
        moved = self._changed("tool", t, place)
        if (moved != place).any():
            T = self._target.copy()
            T[:3, 3] = moved * _MICRO
            self._reach(T, self.wanted)

    def _changed(self, signal: str, t: float, value: Array) -> Array:
        for fault in self._faults[signal]:
            value = fault.change(self.receiver.sequence if fault.counts else t, value)
        return value

    def _brake(self, on: bool) -> None:
        wanted = self._braked if on else self._free
        if self.plant.physics is not wanted:
            self.plant.set(wanted)
