"""Seed faults into the CAD: moved or rotated joint frames, exchanged axes and bodies, wrong limits and meshes.

The mechanism with the fault is assembled again by least squares, which minimises the gaps at the joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from twin.analysis.mutation.fault import Fault, Made, drawn, some
from twin.core import spatial
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.model.body import Body, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism

KINDS = (
    *("moved", "turned", "moved", "turned", "limit", "moved", "turned"),
    *("axis", "swapped", "limit", "scale", "inside out"),
)
"""Kinds of faults in the order of seeding; small errors of joint frames are the most frequent."""


def faults(mechanism: Mechanism, rng: np.random.Generator, count: int) -> Iterator[Fault]:
    """Yield `count` faults of a mechanism, with the kinds in the order of `KINDS`, repeated as often as necessary."""
    for kind, (what, make) in drawn(KINDS, _MAKERS, mechanism, rng, count):
        yield Fault("cad", kind, what, mechanism=make)


def _changed(m: Mechanism, joint: Joint, **values: object) -> Mechanism:
    return replace(m, joints=tuple(replace(j, **values) if j.name == joint.name else j for j in m.joints))


def drawn_anew(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with rest poses assembled by least squares, as if the CAD were drawn with the fault."""
    from twin.reference import ReferenceModel

    return mechanism.with_rest(ReferenceModel(mechanism).home().link_poses)


def _on(m: Mechanism, rng: np.random.Generator, step: Array, text: str) -> Made:
    joint = some(m.joints, rng)
    side, body = some((("T_parent_joint", joint.parent), ("T_child_joint", joint.child)), rng)
    what = f"joint {joint.name} on {body} {text}"
    return what, lambda: drawn_anew(_changed(m, joint, **{side: getattr(joint, side) @ step}))


def _moved(m: Mechanism, rng: np.random.Generator) -> Made:
    size, direction = rng.uniform(0.1, 1.0) * MM, rng.normal(size=3)
    p = size * direction / np.linalg.norm(direction)
    return _on(m, rng, spatial.pose(p=p), f"moved by {size / MM:.2f} mm")


def _turned(m: Mechanism, rng: np.random.Generator) -> Made:
    size, axis = rng.uniform(0.1, 1.0) * DEG, rng.normal(size=3)
    R = spatial.exp_so3(size * axis / np.linalg.norm(axis))
    return _on(m, rng, spatial.pose(R), f"turned by {size / DEG:.2f} deg")


def _axis(m: Mechanism, rng: np.random.Generator) -> Made:
    joint = some([j for j in m.joints if len(j.free_axes) == 1], rng)
    R = spatial.pose(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))  # the old x axis becomes the z axis

    def make() -> Mechanism:
        both = {"T_parent_joint": joint.T_parent_joint @ R, "T_child_joint": joint.T_child_joint @ R}
        return drawn_anew(_changed(m, joint, **both))

    return f"joint {joint.name} turns about another axis of its frame", make


def _swapped(m: Mechanism, rng: np.random.Generator) -> Made:
    groups: dict[str, list[Joint]] = {}
    for j in m.joints:
        groups.setdefault(j.type, []).append(j)
    alike = [g for g in groups.values() if len(g) > 1]
    first, second = rng.permutation(len(group := some(alike, rng)))[:2]
    a, b = group[first], group[second]

    def make() -> Mechanism:
        swapped = {a.name: replace(a, child=b.child), b.name: replace(b, child=a.child)}
        return drawn_anew(replace(m, joints=tuple(swapped.get(j.name, j) for j in m.joints)))

    return f"bodies {a.child} and {b.child} exchanged in {a.name} and {b.name}", make


def _limit(m: Mechanism, rng: np.random.Generator) -> Made:
    limited = [j for j in m.active if j.limits is not None]
    if not limited:
        return _moved(m, rng)
    joint = some(limited, rng)
    assert joint.limits is not None
    low, high = joint.limits
    unit = 180 / np.pi if joint.is_angle else 1000.0
    name, limits = some(
        (
            ("given in another unit, too wide", (low * unit, high * unit)),
            ("given in another unit, too narrow", (low / unit, high / unit)),
            ("mirrored at zero", (-high, -low)),
            ("shifted by their range", (high, 2 * high - low)),
        ),
        rng,
    )
    if np.allclose(limits, joint.limits):  # symmetric limits do not change when mirrored
        name, limits = "shifted by their range", (high, 2 * high - low)
    soft = None if joint.soft_limits is None else limits
    return f"limits of {joint.name} {name}", lambda: _changed(m, joint, limits=limits, soft_limits=soft)


def _shaped(m: Mechanism, rng: np.random.Generator, text: str, of: Callable[[Mesh], Mesh]) -> Made:
    mated = {b for j in m.joints if j.mating for b in (j.parent, j.child)}
    body = some([b for b in m.bodies if b.meshes and b.name in mated] or [b for b in m.bodies if b.meshes], rng)

    def make() -> Mechanism:
        def new(b: Body) -> Body:
            return replace(b, meshes=tuple(of(x) for x in b.meshes)) if b.name == body.name else b

        return replace(m, bodies=tuple(new(b) for b in m.bodies))

    return f"the shapes of {body.name} {text}", make


def _scale(m: Mechanism, rng: np.random.Generator) -> Made:
    factor = float(some((1000.0, 0.001, 25.4, 1 / 25.4, 1.05), rng))
    return _shaped(m, rng, f"scaled by {factor:.4g}", lambda x: replace(x, vertices=factor * x.vertices))


def _inside_out(m: Mechanism, rng: np.random.Generator) -> Made:
    return _shaped(
        m, rng, "turned inside out", lambda x: replace(x, triangles=np.ascontiguousarray(x.triangles[:, ::-1]))
    )


_MAKERS: dict[str, Callable[[Mechanism, np.random.Generator], Made]] = {
    "moved": _moved,
    "turned": _turned,
    "axis": _axis,
    "swapped": _swapped,
    "limit": _limit,
    "scale": _scale,
    "inside out": _inside_out,
}
