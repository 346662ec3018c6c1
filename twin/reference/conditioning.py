"""Distance from singularities: singular values of the mechanism's Jacobians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.reference.model import ReferenceModel


@dataclass(frozen=True)
class Conditioning:
    """Distance from singularities at k states, with lengths divided by a characteristic length.

    Attributes:
        stands: (k,) smallest divided by largest singular value of the tool Jacobian (twist per rate of the active
            joints that can move the tool); 0 at a type I singularity, where the joints can move while the tool is at
            rest; NaN where no active joint moves the tool.
        moves: (k,) inverse of the largest rate of the passive joints per unit rate of the active joints, at most 1; 0
            at a type II singularity, where the mechanism can move while all active joints are at rest.
    """

    stands: Array
    moves: Array


def conditioning(model: ReferenceModel, states: Array, length: float) -> Conditioning:
    """Return the conditioning at configurations (k, nq); `length` in m makes lengths comparable with angles."""
    tree = model.tree
    mechanism = model.mechanism
    active = mechanism.active
    gain = model.gains(states)
    poses, J = tree.update(states, closing_only=True)
    tool = tree.tool_jacobian(poses, J) @ gain
    tool = np.concatenate([tool[:, :3] / length, tool[:, 3:]], axis=1)
    unit = np.where(tree.are_angles, 1.0, length)  # rates of sliding joints in units of `length`
    tool = unit * tool
    moves_tool = [joint not in mechanism.auxiliary for joint in active]
    tool = tool[..., moves_tool]  # a jaw never moves the tool
    values = np.linalg.svd(tool, compute_uv=False)
    largest = values[:, 0]
    smallest = values[:, -1]
    # where no active joint moves the tool, the quotient stays NaN
    stands = np.full(len(states), np.nan)
    np.divide(smallest, largest, out=stands, where=largest > 0)

    passive_unit = np.ones(tree.model.nv)
    for joint in mechanism.tree:
        if joint.type == "prismatic":
            column = tree.coordinate[joint.name]
            passive_unit[column] = 1 / length
    scaled = passive_unit[:, None] * gain
    answers = unit * scaled[:, tree.passive]
    fastest = np.zeros(len(states))
    if answers.shape[1]:
        fastest = np.linalg.norm(answers, ord=2, axis=(1, 2))
    moves = 1.0 / np.maximum(fastest, 1.0)
    return Conditioning(stands, moves)
