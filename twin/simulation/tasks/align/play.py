"""How the camera is aligned: the simulated surgeon, the referee, and AlignErr at the end of a session."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import Quantity, mm
from twin.core.result import Part, TextTable
from twin.core.units import DEG, MM
from twin.model.task import ConsoleTask, required_goal
from twin.reference import ReferenceModel
from twin.simulation import console_scene
from twin.simulation.devices.surgeon_hands import Seat, SurgeonHands
from twin.simulation.operating_scene import plain
from twin.simulation.session.task_play import ArmPath, Play, TaskOutcome
from twin.simulation.setup import Setup
from twin.simulation.tasks.align import camera_task
from twin.simulation.tasks.align.camera_referee import CameraReferee
from twin.simulation.tasks.align.camera_surgeon import CameraSurgeon
from twin.simulation.tasks.align.camera_task import AlignMeasures, CameraView
from twin.simulation.tasks.align.task import BODY, Alignment
from twin.simulation.world import Recording


@dataclass(frozen=True)
class AlignOutcome(TaskOutcome):
    """Measures of the camera task `name` with the required alignment."""

    name: str
    required: Alignment
    aligned: AlignMeasures

    success = "The endoscope is aligned"
    failure = "The endoscope is not aligned"

    def findings(self) -> Iterator[Finding]:
        """Yield findings on the alignment.

        The camera is not aligned, AlignErr cannot be measured in the picture, or AlignErr in the picture differs from
        AlignErr by projection.
        """
        aligned = self.aligned
        required = self.required
        if np.isnan(aligned.angle):
            yield disagreement("task.missed", self.name, "at the end, the rectangle is behind the lens")
        elif not aligned.done(required):
            yield disagreement(
                "task.missed",
                self.name,
                f"the upper side of the rectangle is not aligned: its ends are up to {aligned.off:.0%} of the line's "
                f"length from the line's ends (allowed: {required.off:.0%}); AlignErr",
                Quantity(abs(aligned.angle) / DEG, "deg"),
                required.tolerance / DEG,
                word="allowed",
            )
        if aligned.seen is None:
            text = f"AlignErr cannot be measured in the picture: {aligned.refusal}"
            yield warning("task.unseen", self.name, text)
            return
        # NaN, if the rectangle is behind the lens, is reported above and is no difference
        difference = abs(aligned.seen - aligned.angle)
        if difference > camera_task.ANGLE_AGREEMENT:
            seen_deg = aligned.seen / DEG
            projected_deg = aligned.angle / DEG
            yield disagreement(
                "task.angles",
                self.name,
                f"AlignErr is {seen_deg:.3f} deg in the picture and {projected_deg:.3f} deg by projection; difference",
                Quantity(difference / DEG, "deg"),
                camera_task.ANGLE_AGREEMENT / DEG,
            )

    def content(self) -> JsonObject:
        """Return the measures of the alignment."""
        aligned = self.aligned
        # JSON has no NaN, which the measures have if the rectangle is behind the lens
        angle = None
        if np.isfinite(aligned.angle):
            angle = aligned.angle / DEG
        angle_in_picture = None
        if aligned.seen is not None:
            angle_in_picture = aligned.seen / DEG
        off_line = None
        if np.isfinite(aligned.off):
            off_line = aligned.off
        measures = {
            "time_s": aligned.time,
            "align_err_deg": angle,
            "align_err_in_picture_deg": angle_in_picture,
            "not_in_picture": aligned.refusal or None,
            "off_line": off_line,
            "lens_path_mm": aligned.path / MM,
            "hand_paths_mm": {hand: path / MM for hand, path in aligned.hands.items()},
        }
        return {"alignment": measures}

    def text(self) -> Iterator[Part]:
        """Yield the measures, one in a row."""
        aligned = self.aligned
        projected = "-"
        if not np.isnan(aligned.angle):
            projected = f"{aligned.angle / DEG:+.3f} deg"
        in_picture = "-"
        if aligned.seen is not None:
            in_picture = f"{aligned.seen / DEG:+.3f} deg"
        off_line = "-"
        if not np.isnan(aligned.off):
            off_line = f"{aligned.off:.1%} of its length"
        rows = [
            ("AlignErr by projection", projected),
            ("AlignErr in the picture", in_picture),
            ("distance between the ends of the rectangle's upper side and of the line", off_line),
            ("time from the first press of the camera pedal to the last motion", f"{aligned.time:.1f} s"),
            ("path of the lens", str(mm(aligned.path))),
        ]
        for hand, path in aligned.hands.items():
            rows.append((f"path of the {hand} hand while it moved the camera", str(mm(path))))
        yield TextTable((), rows)


class _AlignPlay(Play):
    def surgeon(self, setup: Setup, task: ConsoleTask, seat: Seat, mistake: str) -> SurgeonHands:
        goal = required_goal(task, Alignment)
        return CameraSurgeon(seat, task.name, goal.upper, goal.line)

    def referee(self, setup: Setup, task: ConsoleTask, period: float) -> CameraReferee:
        camera = console_scene.console_of(setup.scene).camera
        return CameraReferee(setup.scene.cameras[camera].robot, period)

    def outcome(
        self, setup: Setup, task: ConsoleTask, recording: Recording, arms: Mapping[str, ArmPath]
    ) -> AlignOutcome:
        goal = required_goal(task, Alignment)
        return AlignOutcome(task.name, goal, _measured(setup, goal, recording, arms))

    def identity(self, setup: Setup, task: ConsoleTask) -> list[object]:
        goal = required_goal(task, Alignment)
        camera = setup.scene.cameras[console_scene.console_of(setup.scene).camera]
        plate = [plain(goal.T_world_plate), plain(goal.size), plain(goal.plate), plain(goal.line), camera.view_deg]
        return [plate, [plain(goal.tolerance), plain(goal.off)]]


def _measured(setup: Setup, goal: Alignment, recording: Recording, arms: Mapping[str, ArmPath]) -> AlignMeasures:
    """Return the measures of an alignment, from the camera's equations and from a picture of the mechanisms."""
    scene = setup.scene
    props = setup.props
    camera = scene.cameras[console_scene.console_of(scene).camera]
    arm = arms[camera.robot]
    kin = setup.members[camera.robot].kin
    T_tool_picture = console_scene.picture_in_tool(camera, arm.mechanism)
    Ts_world_picture = arm.place.T_world_base @ kin.forward_many(arm.q) @ T_tool_picture
    frame = arm.mechanism.frame(camera.frame)
    Ts_world_camera = arm.place.T_world_base @ arm.links[frame.body] @ frame.T_body_frame @ camera.in_frame
    surfaces = camera_task.surfaces(BODY, [goal.body()], {BODY: np.eye(4)})
    if props is not None:
        home = ReferenceModel(props).home()
        surfaces += camera_task.surfaces(props.name, props.bodies, home.link_poses)
    for name, other_arm in arms.items():
        poses_at_end = {link: other_arm.place.T_world_base @ Ts[-1] for link, Ts in other_arm.links.items()}
        bodies = []
        for body in other_arm.mechanism.bodies:
            if name == camera.robot and body.name == frame.body:
                continue  # the lens does not see its own link
            bodies.append(body)
        surfaces += camera_task.surfaces(name, bodies, poses_at_end)
    sight = CameraView(surfaces, Ts_world_camera[-1])
    view = camera.view_deg * DEG
    return camera_task.measure(recording, goal, Ts_world_picture, view, sight, Ts_world_camera[:, :3, 3])


PLAY = _AlignPlay()
