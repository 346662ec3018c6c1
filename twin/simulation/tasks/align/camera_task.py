"""Measures of the camera task: time, angle (by projection and in the picture), path lengths of lens and hands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.core.quantity import Quantity
from twin.core.spatial import Array
from twin.core.units import DEG
from twin.model.body import Body
from twin.simulation.console_scene import HANDS
from twin.simulation.controllers.pedals import CAMERA
from twin.simulation.session import movement
from twin.simulation.tasks.align import picture, projected_side, upper_side
from twin.simulation.tasks.align.picture import ColouredSurface
from twin.simulation.tasks.align.task import RECTANGLE, Alignment
from twin.simulation.world import Recording
from twin.simulation.world.signal_kinds import CONSOLE_MODE, HAND_POSE

ANGLE_AGREEMENT = 0.05 * DEG
"""Largest difference in rad between the angle by projection and the angle in the picture."""

_LARGEST_COVERED = 0.002
"""Maximum fraction of the rectangle that may be covered when its angle is measured in a picture."""


@dataclass(frozen=True)
class AlignMeasures:
    """Measures of the camera task.

    Attributes:
        time: time in s from the first press of the camera pedal to the end of the last motion of the camera.
        angle: AlignErr in rad by projection, at the end: angle of the upper side against the line, counter-clockwise
            positive; NaN if the rectangle is behind the lens.
        off: largest distance of an end of the upper side from the corresponding end of the line, divided by the length
            of the line; NaN if the rectangle is behind the lens.
        seen: AlignErr in rad in the drawn picture at the end; None: the angle could not be measured.
        refusal: reason why `seen` is None; "" otherwise.
        path: length in m of the path of the lens.
        hands: {hand: length in m of its path while it moved the camera}.
        course: (k, 2, 2) ends of the upper side in the picture over time, see `projected_side.seen_ends`; NaN behind
            the lens.
    """

    time: float
    angle: float
    off: float
    seen: float | None
    refusal: str
    path: float
    hands: Mapping[str, float]
    course: Array = field(compare=False)

    def done(self, alignment: Alignment) -> bool:
        """Return whether the upper side is aligned with the line within the tolerances."""
        return abs(self.angle) <= alignment.tolerance and self.off <= alignment.off


def measure(
    recording: Recording, alignment: Alignment, Ts_world_picture: Array, view: float, sight: CameraView, lens: Array
) -> AlignMeasures:
    """Return the measures of a session of the camera task.

    Args:
        recording: signals of the session.
        alignment: the task.
        Ts_world_picture: (k, 4, 4) frame of the picture over time, from the equations of the camera's arm.
        view: angle of view over the height of the picture, in rad.
        sight: all surfaces, and the pose of the camera, at the end of the session; computed from the mechanisms.
        lens: (k, 3) position of the lens in m.
    """
    is_driven = recording[CONSOLE_MODE.name][:, 0] == CAMERA
    time = _time(recording.t, is_driven, lens)
    course = np.array([projected_side.seen_ends(alignment, T, view) for T in Ts_world_picture])
    angle = projected_side.angle(course[-1])
    off_line = projected_side.off(course[-1], alignment.line)
    seen, refusal = in_picture(sight, view)
    # a step from one sample to the next counts if the pedal is down at both of them
    is_driven_step = is_driven[1:] & is_driven[:-1]
    hands = {}
    for hand in HANDS:
        p = recording[HAND_POSE.of(hand)].reshape(-1, 4, 4)[:, :3, 3]
        steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
        hands[hand] = float(steps[is_driven_step].sum())
    path = movement.path_length(lens)
    return AlignMeasures(time, angle, off_line, seen, refusal, path, hands, course)


def _time(t: Array, is_driven: np.ndarray, lens: Array) -> float:
    """Return the time in s from the first press of the camera pedal to the end of the last motion; lens (k, 3)."""
    presses = np.flatnonzero(is_driven)
    steps = np.linalg.norm(np.diff(lens, axis=0), axis=1)
    moving_steps = np.flatnonzero(steps > 0)
    start = 0.0
    if len(presses):
        start = t[presses[0]]
    end = start
    if len(moving_steps):
        end = t[moving_steps[-1] + 1]
    # a recorded lens may have moved only before the first press
    return max(0.0, float(end - start))


@dataclass(frozen=True)
class CameraView:
    """Surfaces in the World, and the pose of a camera that looks at them.

    Attributes:
        surfaces: all surfaces in the World.
        T_world_camera: (4, 4) pose of the camera: z along the view, y down in the picture.
    """

    surfaces: Sequence[ColouredSurface]
    T_world_camera: Array


def in_picture(sight: CameraView, view: float) -> tuple[float | None, str]:
    """Return (AlignErr in rad in the drawn picture, ""), or (None, reason) if this angle cannot be measured."""
    rendered = picture.draw(sight.surfaces, RECTANGLE, sight.T_world_camera, view)
    if sum(rendered.covered.values()) > _LARGEST_COVERED:
        owners = []
        parts = []
        for owner, fraction in rendered.covered.items():
            if fraction > _LARGEST_COVERED / 4:  # a robot that covers almost nothing need not be moved
                owners.append(owner)
                parts.append(f"{owner} covers {Quantity(100 * fraction, '%')}")
        return None, f"{' and '.join(parts)} of the rectangle: move {' and '.join(owners)} aside"
    try:
        return upper_side.angle(rendered.rgb), ""
    except upper_side.UnmeasuredError as error:
        return None, str(error)


def surfaces(owner: str, bodies: Sequence[Body], Ts_world_body: Mapping[str, Array]) -> list[ColouredSurface]:
    """Return the surfaces of bodies at poses (4, 4) in the World."""
    placed = []
    for body in bodies:
        T = Ts_world_body[body.name]
        for mesh in body.meshes:
            vertices = mesh.vertices @ T[:3, :3].T + T[:3, 3]
            placed.append(ColouredSurface(owner, mesh.name, vertices, np.asarray(mesh.triangles), mesh.color_rgba[:3]))
    return placed
