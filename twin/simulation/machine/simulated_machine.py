"""Simulate a machine of one arm tick by tick: network, PLC, control software, motors and links; no clock, no sockets.

In a tick:

1. the packets go through the network (`wire`), and are checked (`receiver`);
2. the encoders of the motors are read over USB;
3. the control software computes counts of the DAC (`control_software`);
4. the PLC decides on power and brakes (`levels`);
5. the motors move the links (`motor_plant`, `loop_plant` or `cable_plant`).

If parameters of the plant differ from those in the software, the machine deviates from its model. Faults act on the
signals of `machine_faults.LOCATIONS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from twin.core.errors import DeviceError, TwinError
from twin.core.spatial import Array
from twin.simulation.hazards.fault import Fault
from twin.simulation.machine.control_software import MOTORS_ON, ControlSoftware
from twin.simulation.machine.itp import Packet
from twin.simulation.machine.levels import Level, Plc
from twin.simulation.machine.machine_faults import BYTES, MachineFaults
from twin.simulation.machine.machine_parts import Parts
from twin.simulation.machine.physics import Physics
from twin.simulation.machine.receiver import Receiver, Sender
from twin.simulation.machine.servo import Servo
from twin.simulation.machine.wire import Wire


class Machine:
    """One arm with its control software and PLC.

    Attributes:
        parts: compiled parts of the machine.
        plc, receiver, software, plant: controller of power and brakes, check of packets, control software, simulated
            arm.
        t: time of the last tick in s.
        tick: number of ticks.
        dac: (n,) counts of the DAC sent to the motors.
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
        settings = parts.settings
        number = settings.number
        self.receiver = Receiver(settings.arm, settings.packet_version, number.master_timeout.value)
        self._faults = MachineFaults(faults, self.receiver)
        self._wire = Wire(self._faults.of("wire"))
        self.plant = parts.plant.another(physics)
        self.plant.reset(parts.home if q is None else q)
        self.plc = Plc(number.plc_timeout.value)
        self.software = ControlSoftware(parts, self._faults, self.plant.q)
        counts_per_rad = number.counts_per_turn.value / (2 * np.pi)
        self._angle_per_count = 1 / counts_per_rad
        brakes = np.array([friction.brake for friction in settings.of_joints(self._mechanism)])
        # A brake is a Coulomb friction in addition to that of the joint.
        self._unbraked = self.plant.physics
        self._braked = replace(self._unbraked, coulomb=self._unbraked.coulomb + brakes)
        self.t = float("-inf")
        self.tick = 0
        n = len(self._mechanism.active)
        self._counts = np.zeros(n)  # of the encoders, as read last
        self.dac = np.zeros(n)
        self._set_brakes(on=True)

    @property
    def level(self) -> Level:
        """Run level as the software reads it; `plc.level` is the one that the PLC allows."""
        return self.software.level

    @property
    def q(self) -> Array:
        """Joint values (n,) as the encoders measure them, rad or m."""
        return self.software.q

    @property
    def qd(self) -> Array:
        """Joint rates (n,) as the software computes them from the encoders."""
        return self.software.qd

    @property
    def wanted(self) -> Array:
        """Desired joint values (n,) of the software."""
        return self.software.wanted

    @property
    def held(self) -> int:
        """Number of packets whose target was out of reach; the arm then kept its last target within reach."""
        return self.software.held

    @property
    def servo(self) -> Servo:
        """Control of the motors."""
        return self.software.servo

    @property
    def reason(self) -> str:
        """Reason why the machine is in E_STOP; "" in other run levels."""
        return self.plc.reason

    def start(self) -> None:
        """Press the start button, which has an effect only in E_STOP."""
        if self.plc.level != Level.E_STOP:
            return
        self.software.restart()
        self.plc.start(max(self.t, 0.0))

    def stop(self, reason: str = "the stop button is pressed") -> None:
        """Press the stop button."""
        self.plc.stop(reason)

    def stand(self, q: Array) -> None:
        """Put the arm at rest at joint values q (n,), in the state after homing: PEDAL_UP, brakes on, servo reset."""
        self.plant.reset(q)
        self.plc.ready()
        self.software.stand(q, self._encoders())
        self.dac = np.zeros_like(self.dac)
        self._set_brakes(on=True)

    def step(self, t: float, packets: Iterable[tuple[bytes, Sender]] = ()) -> list[tuple[bytes, Sender]]:
        """Run one tick at t in s with the packets (bytes, sender) that have arrived; return packets to send back.

        Invalid packets have no effect; `receiver` counts them.
        """
        if not t > self.t:
            text = f"the clock went back from {self.t:g} s to {t:g} s"
            if not t < self.t:  # equal, or not a number
                text = f"the clock did not advance: {self.t:g} s was followed by {t:g} s"
            self.plc.stop(text)
            t = self.t
        self.t = t
        software = self.software
        accepted, answers = self._receive(t, packets)
        counts = self._read_encoders(t)
        try:
            software.step(t, counts, accepted, self.plc.level, self.receiver.silent(t))
        except TwinError as error:
            software.dac = self.dac  # as sent last; the motors get no counts, because the arm stops
            software.servo.stop = software.servo.stop or str(error)
        if software.servo.stop:
            self.plc.stop(software.servo.stop)
        level = self.plc.step(t, software.watchdog_bit, software.is_initialised, software.is_pedal_down)
        is_powered = level in MOTORS_ON
        self._set_brakes(on=not is_powered)
        dac = self._faults.changed("dac", t, software.dac)
        self.dac = dac if is_powered else np.zeros_like(dac)
        self.plant.advance(software.servo.torques(self.dac))
        self.tick += 1
        return answers

    def _receive(
        self, t: float, packets: Iterable[tuple[bytes, Sender]]
    ) -> tuple[list[Packet], list[tuple[bytes, Sender]]]:
        """Return the packets that are accepted at t in s, as their faults leave them, and those to send back."""
        accepted: list[Packet] = []
        answers = []
        for data, sender in self._wire.carry(t, packets):
            try:
                packet = self.receiver.read(data, sender, t)
            except DeviceError:
                continue
            if packet is None:
                answers.append((data, sender))
            elif self._faults.of("packet"):
                accepted += self._faults.changed_packet(packet, t)
            else:
                accepted.append(packet)
        return accepted, answers

    def _read_encoders(self, t: float) -> Array:
        """Return the encoder counts (n,) that the software reads at t in s."""
        byte_count = float(BYTES)
        if self._faults.of("usb"):
            byte_count = self._faults.changed("usb", t, np.array([byte_count]))[0]
        # A read of another length is ignored: the software keeps the counts of the previous tick.
        if byte_count == BYTES:
            self._counts = self._encoders()
        return self._faults.changed("encoder", t, self._counts)

    def _encoders(self) -> Array:
        """Return the present counts (n,) of the encoders."""
        return np.rint(self._mechanism.motors(self.plant.encoded) / self._angle_per_count)

    def _set_brakes(self, *, on: bool) -> None:
        physics = self._braked if on else self._unbraked
        # Setting checks all parameters; so set only when the brakes change.
        if self.plant.physics is not physics:
            self.plant.set(physics)
