"""A mechanism whose numbers have exact forms; nothing here is taken from the equations."""

from __future__ import annotations

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.proof.drawing import Drawing
from twin.proof.transforms import Matrix
from twin.proof.values import ExactValue


class ExactMechanism:
    """A mechanism whose numbers have exact forms.

    A body is represented by the frame of the first joint that holds it, or by this frame with its origin at a
    point of the body: by the one from which most joints and points are at lengths and angles of a drawing.

    Attributes:
        mechanism: the mechanism.
        drawing: the exact forms of its numbers.
        states: number k of states.
    """

    def __init__(self, mechanism: Mechanism, drawing: Drawing) -> None:
        self.mechanism = mechanism
        self.drawing = drawing
        self.states = drawing.states
        self._frames: dict[tuple[str, bytes], Matrix] = {}
        self._references: dict[str, Array] = {}
        for body in mechanism.bodies:
            self._references[body.name] = self._reference(body.name)

    def frame(self, body: str, T_body_frame: Array, what: str) -> Matrix:
        """Return the pose of a frame of a body, given in the frame of the CAD, in that which represents the body."""
        key = (body, T_body_frame.tobytes())
        if key not in self._frames:
            T = spatial.inverse(self._references[body]) @ T_body_frame
            self._frames[key] = self.drawing.pose(T, f"{what} on {body}")
        return self._frames[key]

    def joint_frame(self, joint: Joint, body: str) -> Matrix:
        """Return the frame of a joint on one of its two bodies, in the frame that represents this body."""
        return self.frame(body, frame_on(joint, body), f"joint {joint.name}")

    def point(self, body: str, p_body: Array, what: str) -> list[ExactValue]:
        """Return a point (3,) of a body, given in the frame of the CAD, in the frame that represents the body."""
        T = spatial.inverse(self._references[body])
        return self.drawing.point(T[:3, :3] @ p_body + T[:3, 3], f"point {what} on {body}")

    def _reference(self, body: str) -> Array:
        """Return the frame that represents a body, in the frame of the CAD."""
        if body == self.mechanism.base:
            return np.eye(4)
        frames = []
        for joint in self.mechanism.joints:
            if body == joint.child:
                frames.append(joint.T_child_joint)
            elif body == joint.parent:
                frames.append(joint.T_parent_joint)
        references = frames[:1]
        points = []
        for point in self.mechanism.points:
            if point.body == body:
                points.append(point.p_body)
                at_point = np.array(references[0])
                at_point[:3, 3] = point.p_body
                references.append(at_point)
        best = np.eye(4)
        fewest = np.inf  # numbers of the body's joints and points without an exact form
        for reference in references:
            inverse_reference = spatial.inverse(reference)
            trial = self.drawing.for_one_state()
            for frame in frames:
                trial.steps(inverse_reference @ frame, body)
            for p in points:
                trial.point(inverse_reference[:3, :3] @ p + inverse_reference[:3, 3], body)
            if len(trial.unrecognised_numbers) < fewest:
                best = reference
                fewest = len(trial.unrecognised_numbers)
            if not fewest:
                break
        return best


def frame_on(joint: Joint, body: str) -> Array:
    """Return the frame (4, 4) of a joint on one of its two bodies, in the frame of the CAD."""
    if joint.child == body:
        return joint.T_child_joint
    return joint.T_parent_joint
