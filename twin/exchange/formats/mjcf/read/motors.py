"""Read the transmissions of an MJCF: n actuators that pull n fixed tendons over n joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.read.source import Findings, named_apart
from twin.model.transmission import CONDITION, Actuator, Transmission, condition
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

    rows = range(m.tendon_adr[tendon], m.tendon_adr[tendon] + m.tendon_num[tendon])
    if any(int(m.wrap_type[w]) != int(mujoco.mjtWrap.mjWRAP_JOINT) for w in rows):
        return {}
    return {int(m.wrap_objid[w]): float(m.wrap_prm[w]) for w in rows}


def read_motors(m, kept: Sequence[int], joints: Sequence[str], name: Name, findings: Findings) -> Motors:
    """Return the transmissions that drive the joints of the robot's bodies.

    A group of tendons that share joints is a transmission if it meets six conditions: each tendon has an actuator;
    there are as many tendons as joints; the joints belong to the robot; no other actuator drives these joints; no
    equality constrains the tendons; the matrix is invertible. `kept` contains the numbers of the robot's bodies;
    `joints[i]` is the name of the joint with number i.
    """
    import mujoco

    transmission, equality = mujoco.mjtTrn, mujoco.mjtEq
    pulls: dict[int, int] = {}  # tendon -> actuator
    taken: set[int] = set()  # joints that an actuator drives directly, or whose tendon has two actuators
    for a in range(m.nu):
        kind, target = int(m.actuator_trntype[a]), int(m.actuator_trnid[a, 0])
        if kind in (int(transmission.mjTRN_JOINT), int(transmission.mjTRN_JOINTINPARENT)):
            taken.add(target)
        elif kind == int(transmission.mjTRN_TENDON) and m.actuator_gear[a, 0]:
            taken |= set(fixed_tendon(m, target)) if target in pulls else set()
            pulls[target] = a
    tied = {int(m.eq_obj1id[e]) for e in range(m.neq) if m.eq_type[e] == equality.mjEQ_TENDON}
    slide, hinge = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
    groups: list[tuple[list[int], list[int]]] = []  # (tendons, joints) of each group
    for tendon in (t for t in sorted(pulls, key=pulls.__getitem__) if t not in tied):
        over = fixed_tendon(m, tendon)
        joined = [g for g in groups if set(g[1]) & set(over)]
        groups = [g for g in groups if g not in joined]
        tendons = [t for g in joined for t in g[0]]
        groups.append(([*tendons, tendon], sorted({j for g in joined for j in g[1]} | set(over))))
    found = []
    for tendons, over in groups:
        good = len(tendons) == len(over) and not taken & set(over)
        good &= all(m.jnt_type[j] in (slide, hinge) and m.jnt_bodyid[j] in kept for j in over)
        if good and condition(_rows(m, tendons, over, pulls)) <= CONDITION:
            found.append((tendons, over))
    return _built(m, found, pulls, joints, name, findings)


def _rows(m, tendons: Sequence[int], over: Sequence[int], pulls: dict[int, int]) -> np.ndarray:
    """Return the matrix (n, n) from joint to motor coordinates. A motor coordinate is gear x tendon length."""
    gears = [float(m.actuator_gear[pulls[t], 0]) for t in tendons]
    lengths = [fixed_tendon(m, t) for t in tendons]
    return np.array([[g * row.get(j, 0.0) for j in over] for g, row in zip(gears, lengths, strict=True)])


def _built(m, found, pulls: dict[int, int], joints: Sequence[str], name: Name, findings: Findings) -> Motors:
    used = [t for tendons, _ in found for t in tendons]
    own = named_apart("motor", ((t, name("ACTUATOR", pulls[t])) for t in used), joints, findings)
    told = {name("TEXT", i): _text(m, i) for i in range(m.ntext)}
    actuators, transmissions = [], []
    for tendons, over in found:
        label, tendons, over = _grouped(m, tendons, over, pulls, name)
        while label in {t.name for t in transmissions}:
            label += "_more"
        actuators += [_actuator(m, own[t], t, pulls[t], told.get(name("ACTUATOR", pulls[t])), over) for t in tendons]
        matrix = np.linalg.inv(_rows(m, tendons, over, pulls))
        matrix[np.abs(matrix) < 1e-12 * np.abs(matrix).max()] = 0.0  # zero up to rounding
        transmissions.append(
            Transmission(label, tuple(joints[j] for j in over), tuple(own[t] for t in tendons), matrix)
        )
    return Motors(
        tuple(actuators),
        tuple(transmissions),
        frozenset(j for _, over in found for j in over),
        frozenset(pulls[t] for t in used),
        frozenset(used),
    )


def _grouped(
    m, tendons: list[int], over: list[int], pulls: dict[int, int], name: Name
) -> tuple[str, list[int], list[int]]:
    """Return (name, tendons, joints) of a group, ordered as in its <tuple>; without a <tuple>, in file order."""
    import mujoco

    by_actuator = {pulls[t]: t for t in tendons}
    for i in range(m.ntuple):
        rows = range(m.tuple_adr[i], m.tuple_adr[i] + m.tuple_size[i])
        of = {
            kind: [int(m.tuple_objid[r]) for r in rows if int(m.tuple_objtype[r]) == int(kind)]
            for kind in (mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR)
        }
        told_joints, told = of.values()
        if sorted(told_joints) == over and set(told) == set(by_actuator) and len(told) == len(over):
            return identifier(name("TUPLE", i)), [by_actuator[a] for a in told], told_joints
    first = identifier(name("ACTUATOR", pulls[tendons[0]]))
    return f"{first}_transmission", tendons, over


def _text(m, i: int) -> str:
    start = int(m.text_adr[i])
    return bytes(m.text_data[start : start + int(m.text_size[i])]).split(b"\0")[0].decode("utf-8", "replace")


def _actuator(m, label: str, tendon: int, a: int, told: str | None, over: Sequence[int]) -> Actuator:
    import mujoco

    gear = float(m.actuator_gear[a, 0])
    ends = sorted(float(v) * gear for v in m.tendon_range[tendon])
    kp, bias = float(m.actuator_gainprm[a, 0]), m.actuator_biasprm[a]
    servo = kp > 0 and bias[1] < 0 and bool(np.isclose(-bias[1], kp))
    lengths = all(m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE for j in over)
    forces = m.actuator_forcerange[a]
    inertia = float(m.tendon_armature[tendon]) / gear**2
    return Actuator(
        label,
        "length" if told == "length" or (told != "angle" and lengths) else "angle",
        (ends[0], ends[1]) if m.tendon_limited[tendon] else None,
        max_effort=float(np.abs(forces).max()) if m.actuator_forcelimited[a] else None,
        rotor_inertia=inertia or None,
        stiffness=kp if servo else None,
        damping=max(0.0, float(-bias[2])) if servo else 0.0,
    )
