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
    gain = model.gains(states)
    poses, J = tree.update(states, closing_only=True)
    tool = tree.tool_jacobian(poses, J) @ gain
    tool = np.concatenate([tool[:, :3] / length, tool[:, 3:]], axis=1)
    slides = np.array([not j.is_angle for j in model.mechanism.active])
    tool = np.where(slides, length, 1.0) * tool  # rates of sliding joints in units of `length`
    auxiliary = model.mechanism.auxiliary
    tool = tool[..., [j not in auxiliary for j in model.mechanism.active]]  # a jaw never moves the tool
    values = np.linalg.svd(tool, compute_uv=False)
    passive = np.ones(tree.model.nv)
    passive[[tree.coordinate[j.name] for j in model.mechanism.tree if j.type == "prismatic"]] = 1 / length
    answers = np.where(slides, length, 1.0) * (passive[:, None] * gain)[:, tree.passive]
    largest = np.linalg.norm(answers, ord=2, axis=(1, 2)) if answers.shape[1] else np.zeros(len(states))
    most = values[:, 0]
    stands = np.divide(values[:, -1], most, out=np.full(len(states), np.nan), where=most > 0)
    return Conditioning(stands, 1.0 / np.maximum(largest, 1.0))
