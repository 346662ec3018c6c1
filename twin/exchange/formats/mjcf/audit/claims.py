"""Check what the comments of an MJCF claim: the stepping at which its loops were tested, and the controls that hold it.

A file of others makes no such claims; a program that saves the file again drops its comments, and its author may then
choose another stepping.
"""

from __future__ import annotations

import re

import mujoco
import numpy as np

from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array
from twin.exchange.formats.mjcf.audit.statics import Balance

# The beginnings of the comments that an export writes; each claim has checks of its own in `check_claims`.
_STEPPING_CLAIM = re.compile(r"<!--[^>]*At this time step, with this integrator")
_CONTROL_CLAIM = re.compile(r"<!--[^>]*A control is the displacement of its joint from home")
_HOLDING_CLAIM = re.compile(r"<!--[^>]*Zero holds the robot at home")

_MOTOR_KIND_CLAIM = re.compile(r"<!--[^>]*as stated by the text of that name")

_TESTED_OPTIONS = {"timestep": 0.001, "iterations": 100, "tolerance": 1e-12}
"""Options at which the loops were tested to stay closed (tests/exchange/test_exporting_engines.py)."""

_TESTED_CONSTRAINT = (0.001, 1.0, 0.9999, 0.9999, 0.001, 0.5, 2.0)
"""solref and solimp of the equality constraints in these tests."""

_OPTION_ROUNDING = 1e-9
"""Relative difference of an option from the tested one that is only rounding: files state options as they are."""

_CONSTRAINT_ROUNDING = 1e-6
"""The same for solref and solimp: MuJoCo saves six digits."""

_TESTED_INTEGRATOR = "discrete"

_HOME_KEYFRAME = "home"
"""Name of the keyframe in which a control of 0 holds the robot."""

_BALL = int(mujoco.mjtJoint.mjJNT_BALL)

_COORDINATE_COUNTS = {_BALL: 4, int(mujoco.mjtJoint.mjJNT_FREE): 7}
"""Numbers of `qpos` of joints with more than one."""

_SAVED_ROUNDING = 1e-5
"""Difference of equal coordinates in m, rad or of quaternions: MuJoCo saves six digits."""

_UNBALANCED_SHARE = 1e-5
"""Part of the weight's largest effort that may remain unbalanced at a keyframe: numbers have 12 digits."""

_NEGLIGIBLE_EFFORT = 1e-6
"""Effort in N or N m that counts as none."""


def check_claims(text: str, model: mujoco.MjModel, balance: Balance | None, weighed: bool, ledger: Ledger) -> None:
    """Report claims in the comments of a file that its model does not keep.

    Args:
        text: the file.
        model: the compiled model.
        balance: the forces at the keyframe; None without one.
        weighed: whether all masses are those of the robot, none of them assumed.
        ledger: receives the findings.
    """
    if _STEPPING_CLAIM.search(text):
        _check_stepping(model, ledger)
        _check_constraint_parameters(model, ledger)
    if _MOTOR_KIND_CLAIM.search(text):
        _check_motor_texts(model, ledger)
    if _CONTROL_CLAIM.search(text):
        _check_names(model, ledger)
    if _HOLDING_CLAIM.search(text):
        if balance is None:
            advice = "write the keyframe again, or remove the comment"
            message = "a comment states that a control of 0 holds the robot at home, but the file has no keyframe."
            ledger.add("mjcf.claim", "warning", message, "keyframe", suggestion=advice)
            return
        _check_home(model, ledger)
        if weighed:
            _check_holding(model, balance, ledger)


def counts_from_home(text: str) -> bool:
    """Return whether a comment of a file states that its controls are displacements from home."""
    return _CONTROL_CLAIM.search(text) is not None


def home_coordinates(text: str, model: mujoco.MjModel) -> dict[str, float] | None:
    """Return {joint: coordinate in m or rad at home} of the joints with one coordinate; None without such a claim.

    A file of others may use the name of the keyframe for any pose.
    """
    names = [model.key(k).name for k in range(model.nkey)]
    if not _HOLDING_CLAIM.search(text) or _HOME_KEYFRAME not in names:
        return None
    qpos = model.key_qpos[names.index(_HOME_KEYFRAME)]
    coordinates: dict[str, float] = {}
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) not in _COORDINATE_COUNTS:
            coordinates[model.joint(joint).name] = float(qpos[int(model.jnt_qposadr[joint])])
    return coordinates


def _check_home(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report a file without the keyframe by whose name programs find the pose that the comment speaks of."""
    names = [model.key(number).name for number in range(model.nkey)]
    if _HOME_KEYFRAME in names:
        _check_home_pose(model, names.index(_HOME_KEYFRAME), ledger)
        return
    listed = ", ".join(f"'{name}'" for name in names)
    text = (
        f"a comment states how the robot is held at home, but no keyframe is named '{_HOME_KEYFRAME}': the file has "
        f"{listed}."
    )
    advice = f"name the keyframe '{_HOME_KEYFRAME}', or remove the comment"
    ledger.wrong("mjcf.claim", text, "keyframe", suggestion=advice)


def _check_home_pose(model: mujoco.MjModel, key: int, ledger: Ledger) -> None:
    """Report a keyframe of home that is not at the coordinates `ref`, from which the comment counts the controls."""
    for joint in range(model.njnt):
        first = int(model.jnt_qposadr[joint])
        end = first + _COORDINATE_COUNTS.get(int(model.jnt_type[joint]), 1)
        home = model.key_qpos[key, first:end]
        ref = model.qpos0[first:end]
        difference = float(np.abs(home - ref).max())
        if int(model.jnt_type[joint]) == _BALL:
            # A quaternion and its negative are one rotation.
            difference = min(difference, float(np.abs(home + ref).max()))
        if difference <= _SAVED_ROUNDING * max(1.0, float(np.abs(ref).max())):
            continue
        name = model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name
        text = (
            f"keyframe '{_HOME_KEYFRAME}': joint '{name}' is at {_number_text(home)}, but a comment of the file counts "
            f"controls from home, which is {_number_text(ref)} by its ref or its body."
        )
        size = Measured(difference, _SAVED_ROUNDING)
        ledger.wrong("mjcf.claim", text, name, size=size, suggestion="write the same coordinates in both places")


def _number_text(values: Array) -> str:
    return " ".join(map("{:.6g}".format, values))


def _check_motor_texts(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report motors without the text that states the kind of their coordinate, or of no tuple of joints and motors."""
    texts = set()
    for number in range(model.ntext):
        texts.add(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, number))
    grouped = set()
    for key in range(sum(model.tuple_size.tolist())):
        if model.tuple_objtype[key] == int(mujoco.mjtObj.mjOBJ_ACTUATOR):
            grouped.add(int(model.tuple_objid[key]))
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            continue
        name = model.actuator(actuator).name
        lacking = []
        if name not in texts:
            lacking.append("no text that states the kind of its coordinate")
        if int(model.tendon_num[int(model.actuator_trnid[actuator, 0])]) > 1 and actuator not in grouped:
            lacking.append("no tuple that names its joints and motors")  # of one joint, the tendon names it
        if lacking:
            text = f"motor '{name}' has {' and '.join(lacking)}; a comment of the file states that it has."
            ledger.wrong("mjcf.claim", text, name, suggestion="write the <custom> elements again")


def _check_names(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report an actuator with a name that is neither that of its joint nor that of any other joint.

    The comment states controls by their joints, so a program finds the control of a joint by the joint's name. An
    actuator with the name of another joint is reported in files without the comment too.
    """
    joints: set[str | None] = set()
    for number in range(model.njnt):
        joints.add(model.joint(number).name)
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        name = model.actuator(actuator).name
        joint = model.joint(int(model.actuator_trnid[actuator, 0])).name
        if name not in joints:
            text = f"actuator '{name}' drives joint '{joint}'; a comment of the file states controls by their joints."
            ledger.wrong("mjcf.claim", text, name, suggestion="name the actuator as its joint, or remove the comment")


def _check_stepping(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report options that are not those at which the file says that its loops were tested."""
    for name, tested in _TESTED_OPTIONS.items():
        value = getattr(model.opt, name)
        if abs(value - tested) > _OPTION_ROUNDING * tested:
            _report_stepping(name, f"{value:g}", f"{tested:g}", ledger)
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
    if integrator != _TESTED_INTEGRATOR:
        _report_stepping("integrator", integrator, _TESTED_INTEGRATOR, ledger)


def _check_constraint_parameters(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report constraints that yield by other parameters than those with which the loops were tested."""
    for equality in range(model.neq):
        parameters = np.concatenate([model.eq_solref[equality], model.eq_solimp[equality]])
        if np.allclose(parameters, _TESTED_CONSTRAINT, rtol=_CONSTRAINT_ROUNDING, atol=0.0):
            continue
        name = model.equality(equality).name
        solref = " ".join(map("{:g}".format, parameters[:2]))
        solimp = " ".join(map("{:g}".format, parameters[2:]))
        text = (
            f"equality '{name}' has solref {solref} and solimp {solimp}; a comment of the file states that its loops "
            "stay closed, which was tested with solref 0.001 1 and solimp 0.9999 0.9999 0.001 0.5 2."
        )
        advice = "write the tested solref and solimp, or remove the comment"
        ledger.wrong("mjcf.claim", text, name, suggestion=advice)


def _report_stepping(name: str, value: str, tested: str, ledger: Ledger) -> None:
    text = (
        f"option {name} is {value}; a comment of the file states that its loops stay closed at this time step, with "
        f"this integrator, which was tested with {name} {tested}."
    )
    ledger.wrong("mjcf.claim", text, "option", suggestion=f"write {name} {tested}, or remove the comment")


def _check_holding(model: mujoco.MjModel, balance: Balance, ledger: Ledger) -> None:
    """Report the actuator that is farthest from holding the robot at its keyframe, though the file says so.

    An actuator at its limit is no fault of its control: it is reported by itself. Where even the right forces do not
    hold the robot, as motors without gains would have to pull, nothing can be said.
    """
    limited = model.actuator_forcelimited.astype(bool)
    bounds = np.abs(model.actuator_forcerange).max(axis=1, initial=0.0)
    if np.any(limited & (np.abs(balance.forces) >= bounds)) or not model.nu:
        return
    limit = _UNBALANCED_SHARE * balance.weight + _NEGLIGIBLE_EFFORT
    if balance.least_remaining > limit or balance.remaining <= limit:
        return
    actuator = int(np.argmax(np.abs(balance.forces - balance.holding)))
    name = model.actuator(actuator).name
    text = (
        f"the actuators do not hold the robot at its keyframe, though a comment of the file states that a control of 0 "
        f"does: '{name}' pulls by {balance.forces[actuator]:.6g} N or N m, {balance.holding[actuator]:.6g} hold it."
    )
    size = Measured(float(balance.forces[actuator]), float(balance.holding[actuator]))
    ledger.wrong("mjcf.claim", text, name, size=size, suggestion="correct biasprm, ctrl or qpos")
