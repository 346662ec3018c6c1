"""The tab Play: choose and play a protocol, and what is drawn of it in the picture; a field for posture links."""

from __future__ import annotations

from html import escape
from pathlib import Path

import viser

from twin.core.errors import TwinError
from twin.ui.session.timeline import PLAYBACK_SPEEDS, protocols_of
from twin.ui.viewer import readout
from twin.ui.viewer.front import Front, ShownRobot

_TYPING_PAUSE = 0.6
"""Time in s after the last change of a text at which it counts as complete."""

_SEEK_TOLERANCE = 5e-4
"""Difference in s from the clock at which the slider of the time is moved: half of its step."""


class PlayPanel:
    """Controls of the protocols of all robots, which play on one clock; the list of protocols is of the active robot.

    Attributes:
        why: why the last planning of a protocol failed; "" if none has failed.
    """

    def __init__(self, front: Front) -> None:
        """Build the controls in the present container of viser, such as a tab."""
        self.front = front
        self.gui = front.server.gui
        self.why = ""
        self._link_changed: float | None = None  # when the user has last typed in the link
        self._protocols: dict[str, dict[str, str]] = {}  # {robot: {listed name: argument of `Robot.protocol`}}
        for robot in front.robots:
            self._protocols[robot.name] = protocols_of(robot.movable.robot, robot.protocol or None)
        gui = self.gui
        self._protocol = gui.add_dropdown("protocol", ["none"])
        self._list_protocols()
        self._status = gui.add_markdown("_not planned yet_")
        self._play_button = gui.add_button("▶ Play", disabled=True)
        undo = gui.add_button("↶ Undo the last drag", color="gray", hint="Ctrl-Z")
        self._time: viser.GuiSliderHandle | None = None  # there is none before a protocol is planned
        self._timeline = gui.add_folder("Timeline")
        with self._timeline:
            self._phases = gui.add_html("", order=1e9)
        self._speed = gui.add_dropdown("speed", [f"{speed:g} x" for speed in PLAYBACK_SPEEDS], initial_value="1 x")
        self._loop = gui.add_checkbox("loop", True)
        self._add_display_options()
        self._link = gui.add_text(
            "posture link", "", hint="q=308,502.5,...&t=3.2: joint values in mm or degrees, and the time in s"
        )
        undo.on_click(lambda _: front.ask("undo", self._undo))
        self._connect()

    def _add_display_options(self) -> None:
        gui = self.gui
        self._trail = gui.add_checkbox("trail of the tip, RCM and shaft", True)
        self._ghost = gui.add_checkbox(
            "ghost of the mechanism",
            False,
            hint="Show the mechanism at the requested tool pose, as solved by the independent model",
        )
        self._equation_points = gui.add_checkbox(
            "points of the equations",
            True,
            hint="Lines connect points of one body; in correct equations their lengths are constant",
        )
        self._magnification = gui.add_dropdown(
            "error magnification", ("1 x", "10 x", "30 x"), initial_value="10 x",
            hint="Factor by which the errors of the points of the equations are drawn larger",
        )  # fmt: skip

    def _connect(self) -> None:
        """Connect the controls to what they do."""
        front = self.front

        def note_typing(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._link_changed = front.now

        def load(event: viser.GuiEvent) -> None:
            if event.client is None:  # the list of another robot is shown
                return
            robot = front.active
            protocol = self.chosen_protocol
            front.ask("load", lambda: front.load(robot, protocol))

        def change_speed(_: object) -> None:
            number, _sign = self._speed.value.split()
            front.clock.speed = float(number)

        self._link.on_update(note_typing)
        front.after_frame.append(self._follow_link)
        self._protocol.on_update(load)
        self._play_button.on_click(lambda _: front.ask("run", self._play_or_pause))
        self._speed.on_update(change_speed)
        self._loop.on_update(lambda _: setattr(front.clock, "loop", self._loop.value))
        self._trail.on_update(lambda _: front.ask("trail", lambda: front.scenery.trail(self._trail.value)))
        self._ghost.on_update(lambda _: front.ask("ghost", lambda: front.show_ghost(self._ghost.value)))
        for handle in (self._equation_points, self._magnification):
            # the request alone lets the front draw the points again
            handle.on_update(lambda _: front.ask("equations", lambda: None))

    def _follow_link(self) -> None:
        """Move the robot to the posture of the link, when nobody types in its field any more."""
        if self._link_changed is None or self.front.now - self._link_changed < _TYPING_PAUSE:
            return
        self._link_changed = None
        text = self._link.value
        if text.strip():
            self.front.ask("link", lambda: self.front.follow_link(text))

    def _list_protocols(self) -> None:
        """List the protocols of the active robot, and select the one that was loaded last."""
        robot = self.front.active
        protocols = self._protocols[robot.name]
        loaded = robot.protocol
        if not loaded and robot.movable.robot.files is not None:
            loaded = robot.movable.robot.source.description.default_protocol
        names = list(protocols) or ["none"]
        selected = names[0]
        for name, source in protocols.items():
            if source == loaded:
                selected = name
                break
        self._protocol.options = names
        self._protocol.disabled = not protocols
        self._protocol.value = selected

    @property
    def chosen_protocol(self) -> str | None:
        """The argument of `Robot.protocol` for the selected protocol; None if none is selected."""
        return self._protocols[self.front.active.name].get(self._protocol.value)

    def _play_or_pause(self) -> None:
        clock = self.front.clock
        if clock.playing:
            clock.playing = False
        else:
            clock.play()

    def _undo(self) -> None:
        self.front.clock.playing = False
        self.front.active.movable.undo()

    # -- what is drawn in the picture -----------------------------------------------------------------

    @property
    def shows_equation_points(self) -> bool:
        """Whether the user has chosen to show the named points that the equations compute."""
        return self._equation_points.value

    @property
    def error_magnification(self) -> float:
        """Factor by which differences between points of equations and mechanism are drawn larger."""
        number, _sign = self._magnification.value.split()
        return float(number)

    def show_ghost(self, visible: bool) -> None:
        """Show or hide the ghost, and set its checkbox."""
        self._ghost.value = visible
        self.front.show_ghost(visible)

    # -- the protocol ---------------------------------------------------------------------------------

    def rebuild(self) -> None:
        """List the protocols again, for another active robot or for another build of it."""
        robot = self.front.active
        try:
            self._protocols[robot.name] = protocols_of(robot.movable.robot, robot.protocol or None)
        except TwinError:
            # a protocol that is being edited may be malformed; the error is shown when it is planned
            self._protocols[robot.name] = protocols_of(robot.movable.robot, None)
        self._list_protocols()

    def show_planning(self, robot: ShownRobot, protocol: str | None) -> None:
        """Show that a protocol of a robot is being planned; None: its default protocol."""
        self._play_button.disabled = True
        name = "the default protocol"
        if protocol:
            name = Path(protocol).stem
        self._status.content = f"planning **{name}** of {robot.name} …"

    def show_failure(self, robot: ShownRobot, error: str) -> None:
        """Show why the protocol of a robot cannot be played."""
        self.why = error
        self._status.content = f"<span style='color:#d62f2f'>{robot.name}: {escape(error)}</span>"

    def show_planned(self, robot: ShownRobot) -> None:
        """Show the timeline of the planned protocol of a robot; of another than the active one, only its duration."""
        front = self.front
        if robot is front.active and robot.playback is not None:
            marks = tuple(round(t0, 3) for _, t0, _ in robot.playback.phases)
            self._replace_time_slider(marks)
        elif self._time is not None:  # a longer protocol of another robot extends the timeline
            self._time.max = round(front.clock.duration, 3)
        self._play_button.disabled = any(shown.playback is None for shown in front.robots)
        front.scenery.trail(self._trail.value)

    def show_unplanned(self) -> None:
        """Show that the active robot has no planned protocol."""
        self._play_button.disabled = True
        if not self.front.planning:
            self._status.content = "_not planned yet_"
        self._phases.content = ""
        if self._time is not None and all(shown.playback is None for shown in self.front.robots):
            self._time.remove()
            self._time = None

    def _replace_time_slider(self, marks: tuple[float, ...]) -> None:
        """Make the slider of the time for the present duration of the clock; `marks` are the begins of phases in s."""
        front = self.front
        if self._time is not None:
            self._time.remove()
        duration = round(front.clock.duration, 3)
        with self._timeline:
            slider = self.gui.add_slider("t [s]", 0.0, duration, 0.001, 0.0, marks=marks)
        self._time = slider
        self._phases.content = ""

        def scrub(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            front.clock.playing = False
            value = slider.value

            def seek() -> None:
                front.clock.seek(value)
                front.move_to_clock()

            front.ask("scrub", seek)

        slider.on_update(scrub)

    def show_time(self) -> None:
        """Show time and phase of the active robot's protocol."""
        clock = self.front.clock
        playback = self.front.active.playback
        if self._time is None or playback is None:
            return
        if abs(self._time.value - clock.time) > _SEEK_TOLERANCE:
            self._time.value = round(min(clock.time, self._time.max), 3)
        phase = playback.phase(clock.time)
        status = f"**{escape(playback.title)}** · phase **{phase}** · {clock.time:.2f} of {clock.duration:.2f} s"
        if status != self._status.content:
            self._status.content = status
            self._phases.content = readout.phase_bar(playback.phases, phase)
        label = "❚❚ Pause" if clock.playing else "▶ Play"
        if self._play_button.label != label:
            self._play_button.label = label
