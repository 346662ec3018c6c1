"""The tab Move: a slider for each joint, named postures, and below them the controls that record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from twin.core.units import DEG, MM
from twin.model.joint import Joint
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.record_panel import RecordPanel

_MAX_POSTURES = 64
"""Maximum number of postures in the list; the button "keep here" adds no posture to a full list."""

_UNLIMITED_RANGES = {False: (-0.5, 0.5), True: (-np.pi, np.pi)}
"""Range of the slider of a joint without limits, in m or, if the joint is an angle, in rad."""

_SLIDER_TOLERANCE = 0.005
"""Difference in mm or degrees from the joint at which a slider is moved: half of its step."""


class MovePanel:
    """Controls that move the active robot; they are built again when another robot becomes active.

    Attributes:
        sliders: the slider of each joint, in the order of q, in mm or degrees.
        record: the controls below, which record postures.
    """

    sliders: list[viser.GuiSliderHandle]
    record: RecordPanel | None = None

    def __init__(self, front: Front, tab: viser.GuiTabHandle) -> None:
        self.front = front
        self.gui = front.server.gui
        self._tab = tab
        self._handles: list = []  # all controls of the tab
        self.rebuild()

    def rebuild(self) -> None:
        """Build the controls for the active robot."""
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if self.record is not None:
            self.record.close()
        robot = self.front.active
        self.sliders = []
        with self._tab:
            note = self.gui.add_markdown(
                "Drag the **arrows** at the tool; **shift-drag** any link; or set a joint. "
                "If the target cannot be reached, the robot stops and the reason is shown."
            )
            self._handles.append(note)
            self._add_postures(robot)
            for index, joint in enumerate(robot.movable.joints):
                slider = self._add_slider(index, joint, robot.movable.assembly.q[index])
                self.sliders.append(slider)
                self._handles.append(slider)
        self.record = RecordPanel(self.front, robot, self._tab, self._handles)

    def _add_postures(self, robot: ShownRobot) -> None:
        front = self.front
        movable = robot.movable
        postures = self.gui.add_dropdown("posture", movable.postures or ("drawn",))
        buttons = self.gui.add_button_group(" ", ("go", "keep here"))
        self._handles += [postures, buttons]

        def go_or_keep(_: object) -> None:
            if buttons.value == "go":
                front.clock.playing = False
                front.ask("posture", lambda: movable.go_to_posture(postures.value))
            elif len(movable.postures) < _MAX_POSTURES:
                number = 1 + sum(name.startswith("kept") for name in movable.postures)
                name = f"kept {number}"
                movable.keep(name)
                postures.options = movable.postures
                postures.value = name
                front.say(f"stored as '{name}'")
            else:
                front.say(f"not stored: the list has {_MAX_POSTURES} postures, which is the maximum")

        buttons.on_click(go_or_keep)

    def _add_slider(self, index: int, joint: Joint, q: float) -> viser.GuiSliderHandle:
        """Add the slider of a joint, by its index in q, at its value in m or rad."""
        unit = "°" if joint.is_angle else "mm"
        scale = _scale(joint)
        low, high = joint.limits or _UNLIMITED_RANGES[joint.is_angle]
        low /= scale
        high /= scale
        value = round(float(np.clip(q / scale, low, high)), 2)
        slider = self.gui.add_slider(f"{joint.name} [{unit}]", round(low, 2), round(high, 2), 0.01, value)
        slider.on_update(self._mover(index, scale, slider))
        return slider

    def _mover(self, index: int, scale: float, slider: viser.GuiSliderHandle) -> Callable[[viser.GuiEvent], None]:
        """Return the function that moves a joint when a user moves its slider, whose unit is `scale` (m or rad)."""
        front = self.front

        def move(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            front.clock.playing = False
            value = slider.value * scale
            movable = front.active.movable
            front.continue_move(f"joint {index}", lambda: movable.move_joint(index, value))

        return move

    def show_joints(self) -> None:
        """Move the sliders to the joint values of the active robot; a slider that a user drags stays."""
        movable = self.front.active.movable
        for slider, joint, q in zip(self.sliders, movable.joints, movable.assembly.q, strict=True):
            value = float(np.clip(round(q / _scale(joint), 2), slider.min, slider.max))
            if abs(slider.value - value) > _SLIDER_TOLERANCE and not self.front.has_requests("joint"):
                slider.value = value


def _scale(joint: Joint) -> float:
    """Return the unit of a joint's slider in rad or m: a degree, or a millimetre."""
    return DEG if joint.is_angle else MM
