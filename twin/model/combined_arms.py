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
    bodies = [Body(WORLD)]
    joints = []
    couplings = []
    rest = {WORLD: np.eye(4)}
    home: dict[str, float] = {}
    have_homes = True
    for arm, (mechanism, T_world_base) in arms.items():
        for body in mechanism.bodies:
            meshes = []
            for mesh in body.meshes:
                meshes.append(replace(mesh, name=_name_in_combination(arm, mesh.name)))
            bodies.append(replace(body, name=_name_in_combination(arm, body.name), meshes=tuple(meshes)))
        # The base of an arm keeps its own frame: where the arm stands is a joint, as for a robot on a mount.
        joints.append(
            Joint(
                _name_in_combination(arm, "stand"),
                "fixed",
                WORLD,
                _name_in_combination(arm, mechanism.base),
                T_world_base,
            )
        )
        for joint in mechanism.joints:
            mating = [_name_in_combination(arm, name) for name in joint.mating]
            renamed = replace(
                joint,
                name=_name_in_combination(arm, joint.name),
                parent=_name_in_combination(arm, joint.parent),
                child=_name_in_combination(arm, joint.child),
                mating=tuple(mating),
            )
            joints.append(renamed)
        for coupling in mechanism.couplings:
            coupled = [_name_in_combination(arm, name) for name in coupling.joints]
            couplings.append(replace(coupling, name=_name_in_combination(arm, coupling.name), joints=tuple(coupled)))
        for body_name, T_base_body in mechanism.rest.items():
            rest[_name_in_combination(arm, body_name)] = T_world_base @ T_base_body
        q = mechanism.home
        if q is None:
            have_homes = False
        else:
            for joint, value in zip(mechanism.active, q, strict=True):
                home[_name_in_combination(arm, joint.name)] = value
    last_arm, (last, _) = list(arms.items())[-1]
    tool = last.frame(last.tool)
    postures = {}
    if have_homes:  # a posture needs a value of each active joint
        postures["home"] = home
    return Mechanism(
        "_".join(arms),
        WORLD,
        tuple(bodies),
        tuple(joints),
        (Frame(last.tool, _name_in_combination(last_arm, tool.body), tool.T_body_frame),),
        rest=rest,
        postures=postures,
        tool=last.tool,
        couplings=tuple(couplings),
    )


def _name_in_combination(arm: str, name: str) -> str:
    """Return the name, in the joined mechanism, of a part of an arm."""
    return f"{arm}_{name}"


def owners(arms: Mapping[str, tuple[Mechanism, Array]]) -> dict[str, str]:
    """Return {name of a body in `joined(arms)`: name of the arm to which the body belongs}."""
    arm_of_body = {}
    for arm, (mechanism, _) in arms.items():
        for body in mechanism.bodies:
            arm_of_body[_name_in_combination(arm, body.name)] = arm
    return arm_of_body
