"""Seed faults into the CAD: moved or rotated joint frames, exchanged axes and bodies, wrong limits and meshes.

The mechanism with the fault is assembled again by least squares, which minimises the gaps at the joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twin.analysis.mutation.fault import SeededFault, faults_in_turn, random_item
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.body import Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

KINDS = (
    *("moved", "turned", "moved", "turned", "limit", "moved", "turned"),
    *("axis", "swapped", "limit", "scale", "inside out"),
)
"""Kinds of faults in the order of seeding; small errors of joint frames are the most frequent."""


MechanismFault = tuple[str, Callable[[], Mechanism]]
"""(what the fault changes, as text; function that returns the mechanism with the fault)."""


def faults(mechanism: Mechanism, rng: np.random.Generator, count: int) -> Iterator[SeededFault]:
    """Yield `count` faults of a mechanism, with the kinds in the order of `KINDS`, repeated as often as necessary."""
    for kind, (what, make) in faults_in_turn(KINDS, _FAULT_OF_KIND, subject=mechanism, rng=rng, count=count):
        yield SeededFault("cad", kind, what, mechanism=make)


def _with_joints(mechanism: Mechanism, *replacements: Joint) -> Mechanism:
    """Return the mechanism with these joints instead of its joints of the same names."""
    replacement_of = {}
    for joint in replacements:
        replacement_of[joint.name] = joint
    joints = []
    for joint in mechanism.joints:
        joints.append(replacement_of.get(joint.name, joint))
    return replace(mechanism, joints=tuple(joints))


def drawn_anew(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with rest poses assembled by least squares, as if the CAD were drawn with the fault."""
    from twin.reference import ReferenceModel

    return mechanism.with_rest(ReferenceModel(mechanism).home().link_poses)


def _frame_fault(mechanism: Mechanism, rng: np.random.Generator, T_change: Array, text: str) -> MechanismFault:
    """Multiply the frame of a joint on one of its bodies by a pose (4, 4); `text` says what this does."""
    joint = random_item(mechanism.joints, rng)
    sides = (("T_parent_joint", joint.parent), ("T_child_joint", joint.child))
    side, body = random_item(sides, rng)
    what = f"joint {joint.name} on {body} {text}"

    def make() -> Mechanism:
        frame = getattr(joint, side) @ T_change
        return drawn_anew(_with_joints(mechanism, replace(joint, **{side: frame})))

    return what, make


def _moved_frame(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Move a joint frame by 0.1 to 1 mm."""
    size = rng.uniform(0.1, 1.0) * MM
    direction = rng.normal(size=3)
    p = size * direction / np.linalg.norm(direction)
    return _frame_fault(mechanism, rng, spatial.pose(p=p), f"moved by {size / MM:.2f} mm")


def _turned_frame(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Rotate a joint frame by 0.1 to 1 degree."""
    size = rng.uniform(0.1, 1.0) * DEG
    axis = rng.normal(size=3)
    R = spatial.exp_so3(size * axis / np.linalg.norm(axis))
    return _frame_fault(mechanism, rng, spatial.pose(R), f"turned by {size / DEG:.2f} deg")


def _wrong_axis(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Let a joint move about, or along, another axis of its frame."""
    # a ball turns about all axes of its frame: another axis would change nothing
    single_axis_joints = []
    for joint in mechanism.joints:
        if len(joint.free_axes) == 1:
            single_axis_joints.append(joint)
    joint = random_item(single_axis_joints, rng)
    T_exchange = spatial.pose(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))  # the old x axis becomes the z axis
    motion = "turns about" if joint.is_angle else "slides along"

    def make() -> Mechanism:
        T_parent_joint = joint.T_parent_joint @ T_exchange
        T_child_joint = joint.T_child_joint @ T_exchange
        turned = replace(joint, T_parent_joint=T_parent_joint, T_child_joint=T_child_joint)
        return drawn_anew(_with_joints(mechanism, turned))

    return f"joint {joint.name} {motion} another axis of its frame", make


def _swapped_bodies(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Exchange the children of two joints of one type."""
    groups: dict[str, list[Joint]] = {}
    for joint in mechanism.joints:
        groups.setdefault(joint.type, []).append(joint)
    exchangeable_groups = []
    for joints in groups.values():
        if len(joints) > 1:
            exchangeable_groups.append(joints)
    group = random_item(exchangeable_groups, rng)
    i, j = rng.permutation(len(group))[:2]
    first = group[i]
    second = group[j]

    def make() -> Mechanism:
        first_changed = replace(first, child=second.child)
        second_changed = replace(second, child=first.child)
        return drawn_anew(_with_joints(mechanism, first_changed, second_changed))

    return f"bodies {first.child} and {second.child} exchanged in {first.name} and {second.name}", make


def _wrong_limit(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Give limits in another unit, mirror or shift them; without limits, move a joint frame."""
    limited_joints = []
    for joint in mechanism.active:
        if joint.limits is not None:
            limited_joints.append(joint)
    if not limited_joints:
        return _moved_frame(mechanism, rng)
    joint = random_item(limited_joints, rng)
    assert joint.limits is not None
    low, high = joint.limits
    unit = 180 / np.pi if joint.is_angle else 1000.0  # degrees taken for radians, mm for m
    shift = ("shifted by their range", (high, 2 * high - low))
    changes = (
        ("given in another unit, too wide", (low * unit, high * unit)),
        ("given in another unit, too narrow", (low / unit, high / unit)),
        ("mirrored at zero", (-high, -low)),
        shift,
    )
    text, limits = random_item(changes, rng)
    if np.allclose(limits, joint.limits):  # symmetric limits do not change when mirrored
        text, limits = shift
    # soft limits outside the faulty ones would be a second fault
    soft = None
    if joint.soft_limits is not None:
        soft = limits
    changed = replace(joint, limits=limits, soft_limits=soft)
    return f"limits of {joint.name} {text}", lambda: _with_joints(mechanism, changed)


def _mesh_fault(
    mechanism: Mechanism, rng: np.random.Generator, text: str, change: Callable[[Mesh], Mesh]
) -> MechanismFault:
    """Change the meshes of one body: of a body with a mated joint if there is one, because mating is checked."""
    mated_names = set()
    for joint in mechanism.joints:
        if joint.mating:
            mated_names |= {joint.parent, joint.child}
    meshed_bodies = []
    mated_bodies = []
    for body in mechanism.bodies:
        if not body.meshes:
            continue
        meshed_bodies.append(body)
        if body.name in mated_names:
            mated_bodies.append(body)
    changed_body = random_item(mated_bodies or meshed_bodies, rng)

    def make() -> Mechanism:
        meshes = [change(mesh) for mesh in changed_body.meshes]
        bodies = []
        for body in mechanism.bodies:
            if body is changed_body:
                body = replace(body, meshes=tuple(meshes))
            bodies.append(body)
        return replace(mechanism, bodies=tuple(bodies))

    return f"the shapes of {changed_body.name} {text}", make


def _wrong_scale(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Scale the shapes of a body, as mistakes of units do."""
    factor = float(random_item((1000.0, 0.001, 25.4, 1 / 25.4, 1.05), rng))

    def scaled(mesh: Mesh) -> Mesh:
        return replace(mesh, vertices=factor * mesh.vertices)

    return _mesh_fault(mechanism, rng, f"scaled by {factor:.4g}", scaled)


def _inverted_mesh(mechanism: Mechanism, rng: np.random.Generator) -> MechanismFault:
    """Turn the shapes of a body inside out."""

    def inverted(mesh: Mesh) -> Mesh:
        return replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))

    return _mesh_fault(mechanism, rng, "turned inside out", inverted)


_FAULT_OF_KIND: dict[str, Callable[[Mechanism, np.random.Generator], MechanismFault]] = {
    "moved": _moved_frame,
    "turned": _turned_frame,
    "axis": _wrong_axis,
    "swapped": _swapped_bodies,
    "limit": _wrong_limit,
    "scale": _wrong_scale,
    "inside out": _inverted_mesh,
}
