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
        type1: (k,) smallest divided by largest singular value of the tool Jacobian (twist per rate of the active
            joints that can move the tool); 0 at a type I singularity, where the joints can move while the tool is at
            rest; NaN where no active joint moves the tool.
        type2: (k,) inverse of the largest rate of the passive joints per unit rate of the active joints, at most 1; 0
            at a type II singularity, where the mechanism can move while all active joints are at rest.
    """

    type1: Array
    type2: Array


def conditioning(model: ReferenceModel, states: Array, length: float) -> Conditioning:
    """Return the conditioning at configurations (k, nq); `length` in m makes lengths comparable with angles."""
    tree = model.tree
    mechanism = model.mechanism
    active = mechanism.active
    gain = model.gains(states)
    poses, J = tree.update(states, closing_only=True)
    J_tool = tree.tool_jacobian(poses, J) @ gain
    dimensionless = np.concatenate([J_tool[:, :3] / length, J_tool[:, 3:]], axis=1)
    active_unit = np.where(tree.are_angles, 1.0, length)  # rates of sliding joints in units of `length`
    dimensionless = active_unit * dimensionless
    moves_tool = [joint not in mechanism.auxiliary for joint in active]
    dimensionless = dimensionless[..., moves_tool]  # a jaw never moves the tool
    values = np.linalg.svd(dimensionless, compute_uv=False)
    largest = values[:, 0]
    smallest = values[:, -1]
    # where no active joint moves the tool, the quotient stays NaN
    type1 = np.full(len(states), np.nan)
    np.divide(smallest, largest, out=type1, where=largest > 0)

    tree_unit = np.ones(tree.model.nv)
    for joint in mechanism.tree:
        if joint.type == "prismatic":
            column = tree.coordinate[joint.name]
            tree_unit[column] = 1 / length
    scaled_gain = tree_unit[:, None] * gain
    passive_rates = active_unit * scaled_gain[:, tree.passive]
    fastest = np.zeros(len(states))
    if passive_rates.shape[1]:
        fastest = np.linalg.norm(passive_rates, ord=2, axis=(1, 2))
    type2 = 1.0 / np.maximum(fastest, 1.0)
    return Conditioning(type1, type2)
