"""Control of the motors: PD or PID with gravity compensation, and the checks of the DAC.

The motor torque is (kp e + ki int e + kd de/dt) / gear + T^T g(q), with e the desired minus the measured motor angle.
The DAC gets the torque in whole counts. If a command exceeds `stop_dac` counts, the arm stops at any run level. If a
command exceeds the limit of the mode, the policy "none" only counts the violation, "soft" clips the command, and "hard"
stops the arm after more than `violations` violations. With `Released.shared_counter`, as in the released software, one
counter counts the violations of all motors; otherwise, each motor has its own counter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import le

import numpy as np

from twin.core.spatial import Array
from twin.model.mechanism import Mechanism
from twin.simulation.machine.arithmetic import Arithmetic
from twin.simulation.machine.settings import Mode, Policy, Settings


@dataclass
class Servo:
    """Controller of n motors, called once per tick.

    Attributes:
        settings: motors and limits.
        mechanism: the robot, for the order of the motors.
        arithmetic: the compiled control of the motors.
        mode, policy: name of the limits of the DAC, and reaction to commands above them.
        limit: (n,) largest counts of the DAC of the mode.
        violations: (n,) for each motor, number of commands so far that exceeded the limit of the mode.
        stop: reason why the arm must stop; "" without a reason.
    """

    settings: Settings
    mechanism: Mechanism
    arithmetic: Arithmetic
    mode: Mode
    policy: Policy
    stop: str = ""
    violations: np.ndarray = field(init=False)
    _integral: Array = field(init=False)

    def __post_init__(self) -> None:
        motors = self.settings.of_motors(self.mechanism)
        self.limit = np.array([getattr(motor.dac, self.mode) for motor in motors])
        self.reset()
        self._stop_counts = self.settings.number.stop_dac.value
        # commands up to these counts need no further check
        self._unchecked_counts = np.minimum(self.limit, self._stop_counts).tolist()
        self._allowed_violations = self.settings.number.violations.value

    def reset(self) -> None:
        """Reset the integral of the error, the violations and the stop."""
        n = len(self.limit)
        self._integral = np.zeros(n)
        self.violations = np.zeros(n, int)
        self.stop = ""

    @property
    def counted(self) -> int:
        """Number of violations for policy "hard": with a shared counter the sum over motors, otherwise the maximum."""
        if self.settings.released.shared_counter:
            return int(self.violations.sum())
        return int(self.violations.max())

    def counts_of(self, error: Array, error_rate: Array, efforts: Array) -> Array:
        """Return the counts of the DAC (n,), whole numbers; all 0 if the arm must stop.

        Args:
            error: (n,) desired minus measured motor angles in rad.
            error_rate: (n,) desired minus measured rates in rad/s.
            efforts: (n,) joint efforts of the gravity compensation in N m or N.
        """
        drive = self.arithmetic.drive(error, error_rate, efforts, self._integral)
        n = len(error)
        self._integral = drive[:n]
        command = drive[n:]
        # The usual case, without the time of the numpy calls below; NaN fails the comparison.
        if not self.stop and all(map(le, map(abs, command.tolist()), self._unchecked_counts)):
            return command
        magnitudes = np.abs(command)
        names = self.mechanism.motor_names
        is_over = magnitudes > self.limit
        if not magnitudes.max() <= self._stop_counts:  # NaN counts as above every limit
            i = int(np.argmax(np.where(np.isnan(magnitudes), np.inf, magnitudes)))
            self.stop = f"the command for {names[i]} is {command[i]:.0f} DAC counts (limit {self._stop_counts:.0f})"
        elif is_over.any():
            self.violations += is_over
            if self.policy == "hard" and self.counted > self._allowed_violations:
                i = int(np.argmax(is_over))
                allowed = f"{self._allowed_violations:.0f} are allowed"
                self.stop = (
                    f"{self.counted} commands exceed the limit of mode {self.mode} ({allowed}); the "
                    f"last one is {command[i]:.0f} DAC counts for {names[i]} (limit {self.limit[i]:.0f})"
                )
        if self.stop:
            return np.zeros_like(command)
        if self.policy == "none" or not is_over.any():
            return command
        return np.clip(command, -self.limit, self.limit)

    def torques(self, counts: Array) -> Array:
        """Return the motor torques (n,) in N m for counts of the DAC (n,)."""
        return counts / self.arithmetic.counts_per_effort
