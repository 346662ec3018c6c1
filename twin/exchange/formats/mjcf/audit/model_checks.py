"""Check what an MJCF file declares beside poses: servos, names, colliders, softness, keyframes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Mapping
from typing import TypeVar

import mujoco
import numpy as np

from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.poses import Array
from twin.exchange.formats.mjcf.audit.keyframe_checks import check_keyframe
from twin.exchange.formats.mjcf.audit.mujoco_conventions import HINGE, SLIDE

ROUNDING_TOL = 1e-5
"""Maximum relative difference of limits or gains that counts as a rounding error: MuJoCo saves six digits."""

Form = TypeVar("Form", bound=Hashable)

_COMMON_SHARE = 0.7
"""Fraction of elements that must be alike, so that the others count as different by mistake."""

_FEWEST_FORMS = 3
"""Elements from which the common form counts: two that differ do not say which of them is meant."""

_UNLIMITED = 1e29
"""Limits of tracks in m or rad above this size mean "no limit"."""


def check_model(model: mujoco.MjModel, ledger: Ledger, from_home: bool = False) -> None:
    """Report faults of actuators, names, colliders, solver parameters and keyframes.

    `from_home` is whether the file states that its controls are displacements from home over the whole range.
    """
    data = mujoco.MjData(model)
    names: dict[str, int] = {}
    for joint in range(model.njnt):
        if model.joint(joint).name:
            names[model.joint(joint).name] = joint
    for actuator in range(model.nu):
        if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        name = model.actuator(actuator).name
        joint = int(model.actuator_trnid[actuator, 0])
        if names.get(name, joint) != joint:
            text = f"actuator '{name}' drives joint '{model.joint(joint).name}', not the joint of the same name."
            advice = "let the actuator drive the joint of the same name, or rename the actuator"
            ledger.wrong("mjcf.actuator", text, name, suggestion=advice)
    for actuator in range(model.nu):
        _check_servo(model, actuator, from_home, ledger)
        _check_ranges(model, actuator, ledger)
    _check_names(model, ledger)
    _check_colliders(model, ledger)
    _check_softness(model, ledger)
    _check_soft_limits(model, ledger)
    for key in range(model.nkey):
        check_keyframe(model, data, key, ledger)


def check_limits(
    model: mujoco.MjModel, track: str, low: Mapping[str, float], high: Mapping[str, float], ledger: Ledger
) -> None:
    """Compare the joint ranges of a model with the joint limits in a track.

    `track` is the file name of the track. `low` and `high` map joints to their limits in the track, in m or rad.
    """
    for number in range(model.njnt):
        joint = model.joint(number).name
        if joint not in low:
            continue
        lower = -np.inf
        upper = np.inf
        if model.jnt_limited[number]:
            lower, upper = model.jnt_range[number].tolist()
        differences = [0.0]
        scale = 1.0
        for limit, track_limit in ((lower, low[joint]), (upper, high[joint])):
            if abs(track_limit) < _UNLIMITED:  # on a side without a limit, there is nothing to compare
                differences.append(abs(limit - track_limit))
                scale = max(scale, abs(track_limit))
        difference = float(np.max(differences))
        if not difference <= ROUNDING_TOL * scale:
            text = (
                f"joint '{joint}' has range {lower:g} .. {upper:g}; in {track} it is {low[joint]:g} .. {high[joint]:g}."
            )
            ledger.wrong("mjcf.limits", text, joint, size=difference)


def _check_servo(model: mujoco.MjModel, actuator: int, from_home: bool, ledger: Ledger) -> None:
    """Report a position servo whose control is no position: force = gain * control - stiffness * coordinate + ...

    The control is the coordinate, or the displacement of the coordinate from `ref`.
    """
    name = model.actuator(actuator).name
    gain = float(model.actuator_gainprm[actuator, 0])
    stiffness = -float(model.actuator_biasprm[actuator, 1])
    is_affine = int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not is_affine or stiffness <= 0:  # a motor, or a drive of the speed
        return
    if abs(gain - stiffness) > ROUNDING_TOL * stiffness:
        text = (
            f"actuator '{name}': gainprm is {gain:.6g}, but -biasprm[1] is {stiffness:.6g}: a control of 1 moves the "
            f"drive by {gain / stiffness:.6g}."
        )
        ledger.wrong(
            "mjcf.control", text, name, size=Measured(gain, stiffness), suggestion="write gainprm = -biasprm[1]"
        )
    moved_range = _moved_range(model, actuator)
    gear = float(model.actuator_gear[actuator, 0])
    if moved_range is None or not model.actuator_ctrllimited[actuator] or not gear:
        return
    range_, at_home, kind = moved_range
    lowest, highest = np.sort(model.actuator_ctrlrange[actuator] / gear)
    if from_home:
        _check_range_from_home(name, (float(lowest), float(highest)), range_ - at_home, kind, ledger)
        return
    excesses = []
    for start in (0.0, at_home):
        low, high = range_ - start
        excesses.append(max(float(low - lowest), float(highest - high)))
    excess = min(excesses)  # the control may count from zero or from home; the nearer one is meant
    largest = float(np.abs(range_).max())
    if excess > ROUNDING_TOL * max(1.0, largest):
        text = (
            f"actuator '{name}': ctrlrange {lowest:.6g} .. {highest:.6g} goes beyond the range of its {kind} by "
            f"{excess:.6g}: relative to home it is {low:.6g} .. {high:.6g}."
        )
        advice = f"write ctrlrange = range of the {kind} - its value at home"
        ledger.wrong("mjcf.control", text, name, size=excess, suggestion=advice)


def _check_range_from_home(name: str, stated: tuple[float, float], expected: Array, kind: str, ledger: Ledger) -> None:
    """Report a control range `stated` that is not the range `expected` (2,) of what is moved, counted from home."""
    differences = [0.0]
    largest = 1.0
    for bound, expected_bound in zip(stated, expected.tolist(), strict=True):
        if bound != expected_bound:  # of two equal infinite bounds, the difference would be NaN
            differences.append(abs(bound - expected_bound))
        if np.isfinite(expected_bound):
            largest = max(largest, abs(expected_bound))
    difference = float(np.max(differences))
    if difference <= ROUNDING_TOL * largest:
        return
    low, high = expected
    text = (
        f"actuator '{name}': ctrlrange is {stated[0]:.6g} .. {stated[1]:.6g}, but the range of its {kind} relative to "
        f"home, from which a comment of the file counts controls, is {low:.6g} .. {high:.6g}."
    )
    advice = f"write ctrlrange = range of the {kind} - its value at home"
    ledger.wrong("mjcf.control", text, name, size=difference, suggestion=advice)


def _check_ranges(model: mujoco.MjModel, actuator: int, ledger: Ledger) -> None:
    """Report ranges of an actuator that the file declares and switches off: MuJoCo then ignores them."""
    name = model.actuator(actuator).name
    for kind, limited, range_ in (
        ("ctrl", model.actuator_ctrllimited[actuator], model.actuator_ctrlrange[actuator]),
        ("force", model.actuator_forcelimited[actuator], model.actuator_forcerange[actuator]),
    ):
        if limited or not range_.any():
            continue
        text = (
            f"actuator '{name}' has {kind}range {range_[0]:g} .. {range_[1]:g}, but {kind}limited is false: MuJoCo "
            "ignores the range."
        )
        ledger.add("mjcf.range_off", "warning", text, name, suggestion=f"remove {kind}limited, or {kind}range")


def _moved_range(model: mujoco.MjModel, actuator: int) -> tuple[Array, float, str] | None:
    """Return (range (2,), value at home, "joint" or "tendon") of what an actuator moves; None if it has no range."""
    target = int(model.actuator_trnid[actuator, 0])
    kind = int(model.actuator_trntype[actuator])
    if kind == int(mujoco.mjtTrn.mjTRN_TENDON) and model.tendon_limited[target]:
        return model.tendon_range[target], float(model.tendon_length0[target]), "tendon"
    if (
        kind == int(mujoco.mjtTrn.mjTRN_JOINT)
        and model.jnt_limited[target]
        and model.jnt_type[target] in (HINGE, SLIDE)
    ):
        address = model.jnt_qposadr[target]
        return model.jnt_range[target], float(model.qpos0[address]), "joint"
    return None


def _check_names(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report hinges and slides without a name if most others of the file have one: values are assigned by name."""
    named = 0
    unnamed: list[int] = []
    for joint in range(model.njnt):
        if model.jnt_type[joint] not in (HINGE, SLIDE):
            continue
        if model.joint(joint).name:
            named += 1
        else:
            unnamed.append(joint)
    if len(unnamed) >= named:
        return
    for joint in unnamed:
        body = model.body(int(model.jnt_bodyid[joint])).name
        text = f"the joint of body '{body}' has no name; {named} others of the file have one."
        ledger.add("mjcf.unnamed", "warning", text, body, suggestion="name the joint as in the other files")


def _check_colliders(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report meshes that a body has twice, and meshes that collide in another way than most others in the file."""
    forms: dict[int, tuple[int, int]] = {}
    places: set[tuple[bytes, ...]] = set()
    for geom in range(model.ngeom):
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        forms[geom] = (int(model.geom_contype[geom]), int(model.geom_conaffinity[geom]))
        fields = (
            model.geom_bodyid,
            model.geom_dataid,
            model.geom_pos,
            model.geom_quat,
            model.geom_contype,
            model.geom_conaffinity,
            model.geom_group,
            model.geom_matid,
        )
        place = tuple(field[geom].tobytes() for field in fields)
        if place in places:
            name, mesh = _body_and_mesh(model, geom)
            text = f"body '{name}' has the shape of mesh '{mesh}' twice at the same place."
            ledger.add("mjcf.repeated", "warning", text, name, suggestion="keep one of them")
        places.add(place)
    common = _common_form(forms.values())
    if common is None:
        return
    count = list(forms.values()).count(common)
    for geom, form in forms.items():
        if form != common:
            name, mesh = _body_and_mesh(model, geom)
            text = (
                f"body '{name}': the shape of mesh '{mesh}' has contype {form[0]} and conaffinity {form[1]}, "
                f"{count} others have {common[0]} and {common[1]}: it collides with other things."
            )
            ledger.add("mjcf.collider", "warning", text, name, suggestion="give all shapes the same bits")


def _body_and_mesh(model: mujoco.MjModel, geom: int) -> tuple[str, str]:
    """Return the names of the body and of the mesh of a geom."""
    body = model.body(int(model.geom_bodyid[geom]))
    mesh = model.mesh(int(model.geom_dataid[geom]))
    return body.name, mesh.name


def _common_form(forms: Collection[Form]) -> Form | None:
    """Return the form that most have; None if there is none, or so few that they do not say which is meant."""
    if len(forms) < _FEWEST_FORMS:
        return None
    common, count = Counter(forms).most_common(1)[0]
    return common if count >= _COMMON_SHARE * len(forms) else None


def _solver_text(row: tuple[float, ...], common: tuple[float, ...]) -> str:
    """Return the parameters of the solver in words, beside those of most others."""
    parameters = f"solref {row[0]:g} {row[1]:g} and solimp {row[2]:g} {row[3]:g}"
    return f"{parameters}, most others have {common[0]:g} {common[1]:g} and {common[2]:g} {common[3]:g}"


def _check_softness(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report equality constraints whose solver parameters differ from those of most others in the file."""
    rows: list[tuple[float, ...]] = []
    for equality in range(model.neq):
        rows.append((*model.eq_solref[equality].tolist(), *model.eq_solimp[equality].tolist()))
    if not rows:
        return
    common, _ = Counter(rows).most_common(1)[0]
    for equality, row in enumerate(rows):
        if row != common:
            name = model.equality(equality).name
            text = f"equality '{name}' has {_solver_text(row, common)}: its loop opens by another amount under load."
            ledger.wrong("mjcf.softness", text, name, suggestion="give all loops the same solref and solimp")


def _check_soft_limits(model: mujoco.MjModel, ledger: Ledger) -> None:
    """Report limits of joints that yield by other parameters of the solver than most others in the file."""
    rows: dict[str, tuple[float, ...]] = {}
    for joint in range(model.njnt):
        if model.jnt_limited[joint]:
            rows[model.joint(joint).name] = (*model.jnt_solref[joint].tolist(), *model.jnt_solimp[joint].tolist())
    common = _common_form(rows.values())
    if common is None:
        return
    for name, row in rows.items():
        if row != common:
            text = f"the limit of joint '{name}' has {_solver_text(row, common)}: it yields differently."
            ledger.add("mjcf.softness", "warning", text, name, suggestion="give all limits the same parameters")
