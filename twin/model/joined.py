"""Combine the mechanisms of several arms into one mechanism, in which each name begins with the name of its arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin.core.spatial import Array
from twin.model.body import Body, Frame
from twin.model.joint import Joint
from twin.model.mechanism import WORLD, Mechanism


def joined(arms: Mapping[str, tuple[Mechanism, Array]]) -> Mechanism:
    """Return one mechanism with all arms; its active joints are those of the first arm, then of the second, and so on.

    Motors are omitted: all active joints count as driven directly. The tool is the tool of the last arm.

    Args:
        arms: {name of the arm: (its mechanism, T_world_base (4, 4))}.
    """
    bodies, joints, couplings, frames, rest = [Body(WORLD)], [], [], (), {WORLD: np.eye(4)}
    for name, (mechanism, T_world_base) in arms.items():

        def own(inner: str, name: str = name) -> str:
            return f"{name}_{inner}"

        for body in mechanism.bodies:
            meshes = tuple(replace(m, name=own(m.name)) for m in body.meshes)
            bodies.append(replace(body, name=own(body.name), meshes=meshes))
        joints.append(Joint(own("stand"), "fixed", WORLD, own(mechanism.base), T_world_base))
        for joint in mechanism.joints:
            ends = {"parent": own(joint.parent), "child": own(joint.child)}
            mating = tuple(own(m) for m in joint.mating)
            joints.append(replace(joint, name=own(joint.name), **ends, mating=mating))
        couplings += [replace(c, name=own(c.name), joints=tuple(map(own, c.joints))) for c in mechanism.couplings]
        rest |= {own(body): T_world_base @ T for body, T in mechanism.rest.items()}
        tool = mechanism.frame(mechanism.tool)
        frames = (Frame(mechanism.tool, own(tool.body), tool.T_body_frame),)
    homes = [(n, m, m.home) for n, (m, _) in arms.items() if m.home is not None]
    home = {f"{n}_{j.name}": x for n, m, q in homes for j, x in zip(m.active, q, strict=True)}
    last = next(reversed(list(arms.values())))[0]
    return Mechanism(
        "_".join(arms),
        WORLD,
        tuple(bodies),
        tuple(joints),
        frames,
        rest=rest,
        postures={"home": home} if len(homes) == len(arms) else {},
        tool=last.tool,
        couplings=tuple(couplings),
    )


def owners(arms: Mapping[str, tuple[Mechanism, Array]]) -> dict[str, str]:
    """Return {name of a body in `joined(arms)`: name of the arm to which the body belongs}."""
    return {f"{name}_{body.name}": name for name, (mechanism, _) in arms.items() for body in mechanism.bodies}
