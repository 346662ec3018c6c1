"""Read the transmissions of an MJCF: n actuators that pull n fixed tendons over n joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.read.source import Findings, named_apart
from twin.model.transmission import CONDITION, Actuator, Coordinate, Transmission, condition
from twin.usd.read.names import identifier

Name = Callable[[str, int], str]


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


def fixed_tendon(m, tendon: int) -> dict[int, float]:
    """Return {MuJoCo's joint index: coefficient} of a fixed tendon, in file order; {} for a spatial tendon."""
    import mujoco

    first = m.tendon_adr[tendon]
    coefficients: dict[int, float] = {}
    for wrap in range(first, first + m.tendon_num[tendon]):
        if int(m.wrap_type[wrap]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            return {}
        coefficients[int(m.wrap_objid[wrap])] = float(m.wrap_prm[wrap])
    return coefficients


def read_motors(m, kept: Sequence[int], joints: Sequence[str], name: Name, findings: Findings) -> Motors:
    """Return the transmissions that drive the joints of the robot's bodies.

    A group of tendons that share joints is a transmission if it meets six conditions: each tendon has an actuator;
    there are as many tendons as joints; the joints belong to the robot; no other actuator drives these joints; no
    equality constrains the tendons; the matrix is invertible. `kept` contains the numbers of the robot's bodies;
    `joints[i]` is the name of the joint with number i.
    """
    import mujoco

    direct = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    pulls: dict[int, int] = {}  # tendon -> actuator
    taken: set[int] = set()  # joints that an actuator drives directly, or whose tendon has two actuators
    for actuator in range(m.nu):
        kind = int(m.actuator_trntype[actuator])
        target = int(m.actuator_trnid[actuator, 0])
        if kind in direct:
            taken.add(target)
        elif kind == int(mujoco.mjtTrn.mjTRN_TENDON) and m.actuator_gear[actuator, 0]:
            if target in pulls:
                taken.update(fixed_tendon(m, target))
            pulls[target] = actuator
    movable = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
    found: list[tuple[list[int], list[int]]] = []
    for tendons, over in _groups(m, pulls):
        driven = [j for j in over if m.jnt_type[j] in movable and m.jnt_bodyid[j] in kept and j not in taken]
        if len(driven) != len(over) or len(tendons) != len(over):
            continue
        if condition(_rows(m, tendons, over, pulls)) <= CONDITION:
            found.append((tendons, over))
    return _built(m, found, pulls, joints, name, findings)


def _groups(m, pulls: dict[int, int]) -> list[tuple[list[int], list[int]]]:
    """Return (tendons, joints) of each group of tendons that share joints, without tendons that an equality constrains.

    `pulls` is {tendon: actuator}.
    """
    import mujoco

    constrained: set[int] = set()
    for equality in range(m.neq):
        if m.eq_type[equality] == mujoco.mjtEq.mjEQ_TENDON:
            constrained.add(int(m.eq_obj1id[equality]))
    groups: list[tuple[list[int], list[int]]] = []
    for tendon in sorted(pulls, key=pulls.__getitem__):
        if tendon in constrained:
            continue
        # The tendon joins all groups with which it shares a joint.
        tendons: list[int] = []
        over = set(fixed_tendon(m, tendon))
        separate: list[tuple[list[int], list[int]]] = []
        shared: set[int] = set()
        for group in groups:
            if over.isdisjoint(group[1]):
                separate.append(group)
            else:
                tendons += group[0]
                shared.update(group[1])
        groups = [*separate, ([*tendons, tendon], sorted(over | shared))]
    return groups


def _rows(m, tendons: Sequence[int], over: Sequence[int], pulls: dict[int, int]) -> np.ndarray:
    """Return the matrix (n, n) from joint to motor coordinates. A motor coordinate is gear x tendon length."""
    rows: list[list[float]] = []
    for tendon in tendons:
        gear = float(m.actuator_gear[pulls[tendon], 0])
        coefficients = fixed_tendon(m, tendon)
        rows.append([gear * coefficients.get(joint, 0.0) for joint in over])
    return np.array(rows)


def _built(m, found, pulls: dict[int, int], joints: Sequence[str], name: Name, findings: Findings) -> Motors:
    used: list[int] = []
    moved: set[int] = set()
    for tendons, over in found:
        used += tendons
        moved.update(over)
    numbers = {tendon: pulls[tendon] for tendon in used}
    wanted = [(tendon, name("ACTUATOR", number)) for tendon, number in numbers.items()]
    labels = named_apart("motor", wanted, joints, findings)
    texts = {name("TEXT", i): _text(m, i) for i in range(m.ntext)}
    actuators: list[Actuator] = []
    transmissions: list[Transmission] = []
    taken: set[str] = set()
    for tendons, over in found:
        label, tendons, over = _grouped(m, tendons, over, pulls, name)
        while label in taken:
            label += "_more"
        taken.add(label)
        for tendon in tendons:
            number = pulls[tendon]
            text = texts.get(name("ACTUATOR", number))
            actuators.append(_actuator(m, labels[tendon], tendon, number, text, over))
        matrix = np.linalg.inv(_rows(m, tendons, over, pulls))
        matrix[np.abs(matrix) < 1e-12 * np.abs(matrix).max()] = 0.0  # zero up to rounding
        moved_joints = tuple(joints[j] for j in over)
        motors = tuple(labels[tendon] for tendon in tendons)
        transmissions.append(Transmission(label, moved_joints, motors, matrix))
    return Motors(
        tuple(actuators), tuple(transmissions), frozenset(moved), frozenset(numbers.values()), frozenset(used)
    )


def _grouped(
    m, tendons: list[int], over: list[int], pulls: dict[int, int], name: Name
) -> tuple[str, list[int], list[int]]:
    """Return (name, tendons, joints) of a group, ordered as in its <tuple>; without a <tuple>, in file order."""
    import mujoco

    by_actuator = {pulls[tendon]: tendon for tendon in tendons}
    for i in range(m.ntuple):
        joints: list[int] = []
        actuators: list[int] = []
        first_row = m.tuple_adr[i]
        for row in range(first_row, first_row + m.tuple_size[i]):
            kind = int(m.tuple_objtype[row])
            if kind == int(mujoco.mjtObj.mjOBJ_JOINT):
                joints.append(int(m.tuple_objid[row]))
            elif kind == int(mujoco.mjtObj.mjOBJ_ACTUATOR):
                actuators.append(int(m.tuple_objid[row]))
        if sorted(joints) == over and set(actuators) == set(by_actuator) and len(actuators) == len(over):
            ordered = [by_actuator[actuator] for actuator in actuators]
            return identifier(name("TUPLE", i)), ordered, joints
    first = identifier(name("ACTUATOR", pulls[tendons[0]]))
    return f"{first}_transmission", tendons, over


def _text(m, i: int) -> str:
    start = int(m.text_adr[i])
    end = start + int(m.text_size[i])
    characters = bytes(m.text_data[start:end])
    text, _, _ = characters.partition(b"\0")  # MuJoCo ends texts with a zero byte
    return text.decode("utf-8", "replace")


def _actuator(m, label: str, tendon: int, a: int, told: str | None, over: Sequence[int]) -> Actuator:
    import mujoco

    kind: Coordinate = "angle"
    if told == "length":
        kind = "length"
    elif told != "angle":
        # Without a text about it, a motor of slides alone counts as one that pulls lengths.
        slides = [joint for joint in over if m.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE]
        if len(slides) == len(over):
            kind = "length"
    gear = float(m.actuator_gear[a, 0])
    limits = None
    if m.tendon_limited[tendon]:
        low, high = sorted(float(length) * gear for length in m.tendon_range[tendon])
        limits = (low, high)
    max_effort = None
    if m.actuator_forcelimited[a]:
        max_effort = float(np.abs(m.actuator_forcerange[a]).max())
    # An actuator is a position servo if its force is kp (control - length) - kv speed: its bias has -kp and -kv.
    kp = float(m.actuator_gainprm[a, 0])
    bias = m.actuator_biasprm[a]
    stiffness = None
    damping = 0.0
    if kp > 0 and bias[1] < 0 and np.isclose(-bias[1], kp):
        stiffness = kp
        damping = max(0.0, float(-bias[2]))
    rotor_inertia = float(m.tendon_armature[tendon]) / gear**2
    return Actuator(
        label,
        kind,
        limits,
        max_effort=max_effort,
        rotor_inertia=rotor_inertia or None,
        stiffness=stiffness,
        damping=damping,
    )
