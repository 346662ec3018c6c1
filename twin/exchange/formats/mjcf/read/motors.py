"""Read the transmissions of an MJCF: n actuators that pull n fixed tendons over n joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.identifiers import identifier
from twin.exchange.read.imported_robot import Findings, unique_identifiers
from twin.model.transmission import LARGEST_CONDITION, Actuator, Coordinate, Transmission, condition

Name = Callable[[str, int], str]
"""Function (kind, number) that returns the name of an object of the model."""

_ROUNDING = 1e-12
"""Share of the largest entry of an inverse matrix below which an entry is zero up to rounding."""


@dataclass(frozen=True)
class Motors:
    """Actuators and transmissions of a mechanism.

    `joints`, `numbers` and `tendons` are MuJoCo's indices of the joints, actuators and tendons, respectively.
    """

    actuators: tuple[Actuator, ...]
    transmissions: tuple[Transmission, ...]
    joints: frozenset[int]
    numbers: frozenset[int]
    tendons: frozenset[int]


def fixed_tendon(model, tendon: int) -> dict[int, float]:
    """Return {MuJoCo's joint index: coefficient} of a fixed tendon, in file order; {} for a spatial tendon."""
    import mujoco

    first = model.tendon_adr[tendon]
    coefficients: dict[int, float] = {}
    for wrap in range(first, first + model.tendon_num[tendon]):
        if int(model.wrap_type[wrap]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return {}
        coefficients[int(model.wrap_objid[wrap])] = float(model.wrap_prm[wrap])
    return coefficients


def read_motors(model, robot_bodies: Sequence[int], joints: Sequence[str], name: Name, findings: Findings) -> Motors:
    """Return the transmissions that drive the joints of the robot's bodies.

    A group of tendons that share joints is a transmission if it meets six conditions: each tendon has an actuator;
    there are as many tendons as joints; the joints belong to the robot; no other actuator drives these joints; no
    equality constrains the tendons; the matrix is invertible. `robot_bodies` contains the numbers of the robot's
    bodies; `joints[i]` is the name of the joint with number i.
    """
    import mujoco

    direct = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    actuator_of_tendon: dict[int, int] = {}  # tendon -> actuator
    unavailable_joints: set[int] = set()  # joints that an actuator drives directly, or whose tendon has two actuators
    for actuator in range(model.nu):
        kind = int(model.actuator_trntype[actuator])
        target = int(model.actuator_trnid[actuator, 0])
        if kind in direct:
            unavailable_joints.add(target)
        elif kind == int(mujoco.mjtTrn.mjTRN_TENDON) and model.actuator_gear[actuator, 0]:
            if target in actuator_of_tendon:
                unavailable_joints.update(fixed_tendon(model, target))
            actuator_of_tendon[target] = actuator
    movable = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
    groups: list[tuple[list[int], list[int]]] = []
    for tendons, group_joints in _tendon_groups(model, actuator_of_tendon):
        available = 0
        for joint in group_joints:
            of_robot = model.jnt_type[joint] in movable and model.jnt_bodyid[joint] in robot_bodies
            if of_robot and joint not in unavailable_joints:
                available += 1
        if available != len(group_joints) or len(tendons) != len(group_joints):
            continue
        if condition(_rows(model, tendons, group_joints, actuator_of_tendon)) <= LARGEST_CONDITION:
            groups.append((tendons, group_joints))
    return _make_motors(model, groups, actuator_of_tendon, joints, name, findings)


def _tendon_groups(model, actuator_of_tendon: dict[int, int]) -> list[tuple[list[int], list[int]]]:
    """Return (tendons, joints) of each group of tendons that share joints, without tendons that an equality constrains.

    `actuator_of_tendon` is {tendon: actuator}.
    """
    import mujoco

    constrained: set[int] = set()
    for equality in range(model.neq):
        if model.eq_type[equality] == mujoco.mjtEq.mjEQ_TENDON:
            constrained.add(int(model.eq_obj1id[equality]))
    groups: list[tuple[list[int], list[int]]] = []
    for tendon in sorted(actuator_of_tendon, key=actuator_of_tendon.__getitem__):
        if tendon in constrained:
            continue
        # The tendon joins all groups with which it shares a joint.
        tendons: list[int] = []
        tendon_joints = set(fixed_tendon(model, tendon))
        separate: list[tuple[list[int], list[int]]] = []
        shared: set[int] = set()
        for group in groups:
            if tendon_joints.isdisjoint(group[1]):
                separate.append(group)
            else:
                tendons += group[0]
                shared.update(group[1])
        groups = [*separate, ([*tendons, tendon], sorted(tendon_joints | shared))]
    return groups


def _rows(model, tendons: Sequence[int], group_joints: Sequence[int], actuator_of_tendon: dict[int, int]) -> np.ndarray:
    """Return the matrix (n, n) from joint to motor coordinates. A motor coordinate is gear x tendon length."""
    rows: list[list[float]] = []
    for tendon in tendons:
        gear = float(model.actuator_gear[actuator_of_tendon[tendon], 0])
        coefficients = fixed_tendon(model, tendon)
        rows.append([gear * coefficients.get(joint, 0.0) for joint in group_joints])
    return np.array(rows)


def _make_motors(
    model, groups, actuator_of_tendon: dict[int, int], joints: Sequence[str], name: Name, findings: Findings
) -> Motors:
    tendon_numbers: list[int] = []
    joint_numbers: set[int] = set()
    for tendons, group_joints in groups:
        tendon_numbers += tendons
        joint_numbers.update(group_joints)
    actuator_numbers = {tendon: actuator_of_tendon[tendon] for tendon in tendon_numbers}
    actuator_names: list[tuple[int, str]] = []
    for tendon, number in actuator_numbers.items():
        actuator_names.append((tendon, name("ACTUATOR", number)))
    labels = unique_identifiers("motor", actuator_names, joints, findings)
    texts: dict[str, str] = {}  # a text of the name of a motor states its kind of coordinate, as twin writes it
    for number in range(model.ntext):
        texts[name("TEXT", number)] = _text(model, number)
    actuators: list[Actuator] = []
    transmissions: list[Transmission] = []
    used_labels: set[str] = set()
    for tendons, group_joints in groups:
        label, tendons, group_joints = _ordered_group(model, tendons, group_joints, actuator_of_tendon, name)
        while label in used_labels:
            label += "_more"
        used_labels.add(label)
        for tendon in tendons:
            number = actuator_of_tendon[tendon]
            text = texts.get(name("ACTUATOR", number))
            actuators.append(_actuator(model, labels[tendon], tendon, number, text, group_joints))
        matrix = np.linalg.inv(_rows(model, tendons, group_joints, actuator_of_tendon))
        matrix[np.abs(matrix) < _ROUNDING * np.abs(matrix).max()] = 0.0
        joint_names = tuple(joints[joint] for joint in group_joints)
        motors = tuple(labels[tendon] for tendon in tendons)
        transmissions.append(Transmission(label, joint_names, motors, matrix))
    return Motors(
        actuators=tuple(actuators),
        transmissions=tuple(transmissions),
        joints=frozenset(joint_numbers),
        numbers=frozenset(actuator_numbers.values()),
        tendons=frozenset(tendon_numbers),
    )


def _ordered_group(
    model, tendons: list[int], group_joints: list[int], actuator_of_tendon: dict[int, int], name: Name
) -> tuple[str, list[int], list[int]]:
    """Return (name, tendons, joints) of a group, ordered as in its <tuple>; without a <tuple>, in file order."""
    import mujoco

    by_actuator = {actuator_of_tendon[tendon]: tendon for tendon in tendons}
    for number in range(model.ntuple):
        joints: list[int] = []
        actuators: list[int] = []
        first_row = model.tuple_adr[number]
        for row in range(first_row, first_row + model.tuple_size[number]):
            kind = int(model.tuple_objtype[row])
            if kind == int(mujoco.mjtObj.mjOBJ_JOINT):
                joints.append(int(model.tuple_objid[row]))
            elif kind == int(mujoco.mjtObj.mjOBJ_ACTUATOR):
                actuators.append(int(model.tuple_objid[row]))
        if (
            sorted(joints) == group_joints
            and set(actuators) == set(by_actuator)
            and len(actuators) == len(group_joints)
        ):
            ordered = [by_actuator[actuator] for actuator in actuators]
            return identifier(name("TUPLE", number)), ordered, joints
    first = identifier(name("ACTUATOR", actuator_of_tendon[tendons[0]]))
    return f"{first}_transmission", tendons, group_joints


def _text(model, number: int) -> str:
    start = int(model.text_adr[number])
    end = start + int(model.text_size[number])
    characters = bytes(model.text_data[start:end])
    text, _, _ = characters.partition(b"\0")  # MuJoCo ends texts with a zero byte
    return text.decode("utf-8", "replace")


def _actuator(
    model, label: str, tendon: int, number: int, stated_kind: str | None, group_joints: Sequence[int]
) -> Actuator:
    import mujoco

    kind: Coordinate = "angle"
    if stated_kind == "length":
        kind = "length"
    elif stated_kind != "angle":
        # Without a text about it, a motor of slides alone counts as one that pulls lengths.
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        if all(model.jnt_type[joint] == slide for joint in group_joints):
            kind = "length"
    gear = float(model.actuator_gear[number, 0])
    limits = None
    if model.tendon_limited[tendon]:
        first, last = map(float, model.tendon_range[tendon])
        low, high = sorted((first * gear, last * gear))  # a negative gear exchanges them
        limits = (low, high)
    max_effort = None
    if model.actuator_forcelimited[number]:
        max_effort = float(np.abs(model.actuator_forcerange[number]).max())
    # An actuator is a position servo if its force is kp (control - length) - kv speed: its bias has -kp and -kv.
    kp = float(model.actuator_gainprm[number, 0])
    bias = model.actuator_biasprm[number]
    stiffness = None
    damping = 0.0
    if kp > 0 and bias[1] < 0 and np.isclose(-bias[1], kp):
        stiffness = kp
        damping = max(0.0, float(-bias[2]))
    rotor_inertia = float(model.tendon_armature[tendon]) / gear**2
    return Actuator(
        label,
        kind,
        limits,
        max_effort=max_effort,
        rotor_inertia=rotor_inertia or None,
        stiffness=stiffness,
        damping=damping,
    )
