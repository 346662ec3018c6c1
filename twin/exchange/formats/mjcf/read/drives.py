"""Read which joints of an MJCF are driven, and the gains of their drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.exchange.formats.mjcf.read.motors import Motors, fixed_tendon
from twin.exchange.formats.mjcf.read.robots import tied_bodies
from twin.exchange.read.imported_robot import Findings
from twin.model.joint import Drive

if TYPE_CHECKING:
    import mujoco


@dataclass
class DriveReader:
    """Reader of the drives of one compiled model.

    Attributes:
        path: the file.
        model: the compiled model.
        name: function (kind, number) that returns the name of an object.
        joints: identifiers of the joints, by MuJoCo's numbers.
        one_coordinate_joints: numbers of the slides and hinges between the bodies of the robot.
        findings: receives what is left out.
        efforts: {joint: maximum effort in N or N m} of driven joints without a drive, filled by `read`.
    """

    path: Path
    model: mujoco.MjModel
    name: Callable[[str, int], str]
    joints: Sequence[str]
    one_coordinate_joints: Sequence[int]
    findings: Findings

    def __post_init__(self) -> None:
        self.efforts: dict[str, float] = {}

    def read(self, motors: Motors, robot_bodies: Sequence[int]) -> dict[int, Drive | None]:
        """Return {joint number: drive} of the driven joints; the drive is None without a position actuator.

        `motors` have transmissions, so their joints are driven without a drive of their own.
        """
        drives = self._of_actuators(motors)
        drives |= dict.fromkeys(motors.joints)
        if not self.model.nu:
            drives = dict.fromkeys(self._without_actuators(robot_bodies))
        return drives

    def _of_actuators(self, motors: Motors) -> dict[int, Drive | None]:
        """Return {joint number: drive} of the joints that actuators drive, without those of `motors`."""
        import mujoco

        model = self.model
        transmission_types = mujoco.mjtTrn
        drives: dict[int, Drive | None] = {}
        for number in range(model.nu):
            if number in motors.numbers:
                continue
            name = self.name("ACTUATOR", number)
            kind = transmission_types(int(model.actuator_trntype[number]))
            target = int(model.actuator_trnid[number, 0])
            if kind == transmission_types.mjTRN_TENDON:
                tendon_joints = list(fixed_tendon(model, target))
                if tendon_joints:
                    self._warn_of_tendon(name, tendon_joints)
                    drives.setdefault(tendon_joints[0], None)  # another actuator may drive this joint by itself
                    continue
            if kind not in (transmission_types.mjTRN_JOINT, transmission_types.mjTRN_JOINTINPARENT):
                text = f"actuator '{name}' acts on a spatial tendon, a site or a body, so it drives no joint."
                self.findings.warn("actuator", text, name)
            elif int(model.jnt_type[target]) not in (
                int(mujoco.mjtJoint.mjJNT_SLIDE),
                int(mujoco.mjtJoint.mjJNT_HINGE),
            ):
                text = (
                    f"actuator '{name}' drives joint '{self.joints[target]}', which has several coordinates: the "
                    "actuator is left out."
                )
                self.findings.warn("actuator", text, name)
            else:
                drive = self._drive(number, name, self.joints[target])
                known_drive = drives.get(target)
                if known_drive is None:
                    drives[target] = drive
                elif drive is not None:
                    text = f"actuator '{name}' is another position servo of joint '{self.joints[target]}': only the "
                    text += "gains of the first are imported."
                    self.findings.warn("actuator", text, name)
        for target, drive in drives.items():
            if drive is not None:  # another actuator of the joint may state an effort
                self.efforts.pop(self.joints[target], None)
        return drives

    def _without_actuators(self, robot_bodies: Sequence[int]) -> list[int]:
        """Return the joints that are driven in a file without actuators: all that have one coordinate and follow none.

        If equalities close loops, no joint is driven: the file does not say which of the joints of a loop could be.
        """
        import mujoco

        model = self.model
        eq = mujoco.mjtEq
        followers: set[int] = set()
        for number in range(model.neq):
            if not model.eq_active0[number]:
                continue
            kind = eq(int(model.eq_type[number]))
            first = int(model.eq_obj1id[number])
            if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD) and tied_bodies(model, number).issubset(robot_bodies):
                return []
            if kind == eq.mjEQ_JOINT:
                followers.add(first)
            if kind == eq.mjEQ_TENDON:
                # The first joint of the tendon is taken as the follower of the others.
                tendon_joints = list(fixed_tendon(model, first))
                followers.update(tendon_joints[:1])
        driven = [joint for joint in self.one_coordinate_joints if joint not in followers]
        if driven:
            text = f"the file has no actuators: {len(driven)} joints are imported as driven."
            self.findings.warn("driven", text, self.path.name)
        return driven

    def _warn_of_tendon(self, name: str, tendon_joints: Sequence[int]) -> None:
        first, *other_joints = tendon_joints
        text = f"actuator '{name}' pulls a fixed tendon: joint '{self.joints[first]}' is imported as driven, "
        text += "without gains."
        if other_joints:
            others = ", ".join(f"'{self.joints[joint]}'" for joint in other_joints)
            text += f" The tendon's other joints, {others}, move only if an equality couples them."
        self.findings.warn("actuator", text, name)

    def _drive(self, number: int, name: str, joint: str) -> Drive | None:
        """Return the drive of an actuator; None if it is not a position servo, whose effort is added to `efforts`.

        MuJoCo's gains are for the motor, those of a drive for the joint: the gear ratio counts twice.
        """
        model = self.model
        gear = float(model.actuator_gear[number, 0])
        gain = model.actuator_gainprm[number, 0]
        bias = model.actuator_biasprm[number]
        kp = float(gain) * gear**2
        effort = None
        if model.actuator_forcelimited[number]:
            effort = float(np.abs(model.actuator_forcerange[number]).max() * abs(gear))
        # A position servo has the force gain * control - gain * length: its bias has the negative gain.
        if bias[1] < 0 and np.isclose(-bias[1], gain) and kp > 0:
            return Drive(kp, max(0.0, float(-bias[2] * gear**2)), effort)
        if effort is not None:
            self.efforts[joint] = effort
        text = (
            f"actuator '{name}' is not a position servo: joint '{joint}' is imported as driven, and the gains of "
            "the actuator are ignored."
        )
        self.findings.warn("actuator", text, name)
        return None
