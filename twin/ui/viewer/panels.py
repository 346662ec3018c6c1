"""The panels of the page for play, move, scene, readings and curves; the module `design_panel` has the design panel."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path

import numpy as np
import viser
from viser import uplot

from twin.core.errors import AssemblyError, TwinError
from twin.core.sampling import spread
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM
from twin.ui.session.readings import RobotReading
from twin.ui.session.timeline import SPEEDS, Playback, protocols_of
from twin.ui.viewer import readout
from twin.ui.viewer.design_panel import DesignPanel
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.record_panel import RecordPanel

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#999999")
MOST_POSTURES = 64
"""Maximum number of postures in the list; the button "keep here" adds no posture to a full list."""

TYPING = 0.6
"""Time in s after the last change of a text at which it counts as complete."""

CURVES = ("displacement", "speed", "acceleration", "tip", "RCM error")
_POINTS = 400
"""Maximum number of points sent for a curve."""


class Panels:
    """All controls and displays of the page."""

    def __init__(self, front: Front) -> None:
        self.front = front
        self.gui = front.server.gui
        self.why = ""
        gui = self.gui
        gui.set_panel_label(front.title)
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._side = gui.add_panel()
        with self._side.add_tab("Instruments"):
            self._readout = gui.add_html("")
        self._curves_tab = self._side.add_tab("Curves")
        self._side.dock_left()
        self._side.set_width(330)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(350)
        self._headline = gui.add_html("")
        if len(front.robots) > 1:
            names = [robot.name for robot in front.robots]
            chosen = gui.add_dropdown("active robot", names, initial_value=names[0])
            chosen.on_update(lambda e: front.ask("take", lambda: front.set_active(chosen.value)))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Play"):
            self._play()
        self._move_tab = tabs.add_tab("Move")
        self.design = DesignPanel(front, tabs.add_tab("Design"))
        with tabs.add_tab("Scene"):
            front.scenery.panel()
        self._sliders: list[viser.GuiInputHandle] = []
        self.record: RecordPanel | None = None
        self._move()
        with self._curves_tab:
            self._what = gui.add_dropdown("curve", CURVES, initial_value=CURVES[0])
            self._what.on_update(lambda _: self.front.ask("curves", lambda: self._draw_curves(force=True)))
            self._legend = gui.add_html("")
        self._plot: viser.GuiUplotHandle | None = None
        self._plotted: tuple[str, str, Playback | None] = ("", "", None)

    def close(self) -> None:
        """End the processes of the panels."""
        self.design.close()

    # -- play -----------------------------------------------------------------------------------------

    def _play(self) -> None:
        gui, front = self.gui, self.front
        self._protocols: dict[str, dict[str, str]] = {}
        for robot in front.robots:
            self._protocols[robot.name] = protocols_of(robot.movable.robot, robot.protocol or None)
        self._protocol = gui.add_dropdown("protocol", ["none"])
        self._list_protocols()
        self._state = gui.add_markdown("_not planned yet_")
        self._run = gui.add_button("▶ Play", disabled=True)
        undo = gui.add_button("↶ Undo the last drag", color="gray", hint="Ctrl-Z")
        self._time: viser.GuiSliderHandle | None = None
        self._folder = gui.add_folder("Timeline")
        with self._folder:
            self._phases = gui.add_html("", order=1e9)
        self._speed = gui.add_dropdown("speed", [f"{s:g} x" for s in SPEEDS], initial_value="1 x")
        self._loop = gui.add_checkbox("loop", True)
        self._trail = gui.add_checkbox("trail of the tip, RCM and shaft", True)
        self._ghost = gui.add_checkbox(
            "ghost of the mechanism",
            False,
            hint="Show the mechanism at the requested tool pose, as solved by the independent model",
        )
        self._equations = gui.add_checkbox(
            "points of the equations",
            True,
            hint="Lines connect points of one body; in correct equations their lengths are constant",
        )
        self._times = gui.add_dropdown(
            "error magnification", ("1 x", "10 x", "30 x"), initial_value="10 x",
            hint="Factor by which the errors of the points of the equations are drawn larger",
        )  # fmt: skip
        self._link = gui.add_text(
            "posture link", "", hint="q=308,502.5,...&t=3.2: joint values in mm or degrees, and the time in s"
        )
        undo.on_click(lambda _: front.ask("undo", self._undo))
        self._connect_play()

    def _connect_play(self) -> None:
        """Connect the controls of `_play` to what they do."""
        front = self.front
        self._link_changed: float | None = None

        def change_link(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._link_changed = front.now

        def load(event: viser.GuiEvent) -> None:
            if event.client is None:  # the list of another robot is shown
                return
            robot = front.active
            protocol = self._chosen()
            front.ask("load", lambda: front.load(robot, protocol))

        def change_speed(_: object) -> None:
            number, _sign = self._speed.value.split()
            front.clock.speed = float(number)

        self._link.on_update(change_link)
        front.after_frame.append(self._follow_link)
        self._protocol.on_update(load)
        self._run.on_click(lambda _: front.ask("run", self._toggle))
        self._speed.on_update(change_speed)
        self._loop.on_update(lambda _: setattr(front.clock, "loop", self._loop.value))
        self._trail.on_update(lambda _: front.ask("trail", lambda: front.scenery.trail(self._trail.value)))
        self._ghost.on_update(lambda _: front.ask("ghost", lambda: front.show_ghost(self._ghost.value)))
        for handle in (self._equations, self._times):
            handle.on_update(lambda _: front.ask("equations", lambda: None))

    def _follow_link(self) -> None:
        """Move the robot to the posture of the link, when nobody types in its field any more."""
        if self._link_changed is None or self.front.now - self._link_changed < TYPING:
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

    def _chosen(self) -> str | None:
        """Return the argument of `Robot.protocol` for the selected protocol; None if none is selected."""
        return self._protocols[self.front.active.name].get(self._protocol.value)

    def _toggle(self) -> None:
        clock = self.front.clock
        if clock.playing:
            clock.playing = False
        else:
            clock.play()

    def _undo(self) -> None:
        self.front.clock.playing = False
        self.front.active.movable.undo()

    def preparing(self, robot: ShownRobot, protocol: str | None) -> None:
        """Show that a protocol of a robot is being planned; None: its default protocol."""
        self._run.disabled = True
        name = "the default protocol"
        if protocol:
            name = Path(protocol).stem
        self._state.content = f"planning **{name}** of {robot.name} …"

    def failed(self, robot: ShownRobot, error: str) -> None:
        """Show why the protocol of a robot cannot be played."""
        self.why = error
        self._state.content = f"<span style='color:#d62f2f'>{robot.name}: {escape(error)}</span>"

    def ready(self, robot: ShownRobot) -> None:
        """Show the timeline of the planned protocol of a robot."""
        front = self.front
        if robot is front.active and robot.playback is not None:
            if self._time is not None:
                self._time.remove()
            duration = round(front.clock.duration, 3)
            marks = tuple(round(t0, 3) for _, t0, _ in robot.playback.phases)
            with self._folder:
                self._time = self.gui.add_slider("t [s]", 0.0, duration, 0.001, 0.0, marks=marks)
            time = self._time
            self._phases.content = ""

            def scrub(event: viser.GuiEvent) -> None:
                if event.client is None:
                    return
                front.clock.playing = False
                value = time.value

                def go() -> None:
                    front.clock.seek(value)
                    front.move_to_clock()

                front.ask("scrub", go)

            time.on_update(scrub)
            self._draw_curves(force=True)
        elif self._time is not None:  # a longer protocol of another robot extends the timeline
            self._time.max = round(front.clock.duration, 3)
        self._run.disabled = any(b.playback is None for b in front.robots)
        front.scenery.trail(self._trail.value)

    # -- move -----------------------------------------------------------------------------------------

    def rebuild(self) -> None:
        """Rebuild the panels for another active robot, or for another build of the active robot."""
        robot = self.front.active
        try:
            self._protocols[robot.name] = protocols_of(robot.movable.robot, robot.protocol or None)
        except TwinError:
            # a protocol that is being edited may be malformed; the error is shown when it is planned
            self._protocols[robot.name] = protocols_of(robot.movable.robot, None)
        self._list_protocols()
        self._move()
        self.design.rebuild()
        if robot.playback is not None:
            self.ready(robot)
        else:
            self._unready()

    def _unready(self) -> None:
        """Show that the active robot has no planned protocol."""
        self._run.disabled = True
        if not self.front.planning:
            self._state.content = "_not planned yet_"
        self._phases.content = ""
        self._legend.content = ""
        self._remove_plot()
        if self._time is not None and all(b.playback is None for b in self.front.robots):
            self._time.remove()
            self._time = None

    def _move(self) -> None:
        gui = self.gui
        front = self.front
        robot = front.active
        for handle in self._sliders:
            handle.remove()
        self._sliders = []
        if self.record is not None:
            self.record.close()
        self._joint: list[viser.GuiSliderHandle] = []
        with self._move_tab:
            note = gui.add_markdown(
                "Drag the **arrows** at the tool; **shift-drag** any link; or set a joint. "
                "If the target cannot be reached, the robot stops and the reason is shown."
            )
            postures = gui.add_dropdown("posture", robot.movable.postures or ("drawn",))
            go = gui.add_button_group(" ", ("go", "keep here"))
            self._sliders += [note, postures, go]
            for index, joint in enumerate(robot.movable.joints):
                scale = MM
                unit = "mm"
                low = -0.5
                high = 0.5
                if joint.is_angle:
                    scale = DEG
                    unit = "°"
                    low = -np.pi
                    high = np.pi
                if joint.limits is not None:
                    low, high = joint.limits
                low /= scale
                high /= scale
                value = round(float(np.clip(robot.movable.assembly.q[index] / scale, low, high)), 2)
                slider = gui.add_slider(f"{joint.name} [{unit}]", round(low, 2), round(high, 2), 0.01, value)
                slider.on_update(self._mover(index, scale, slider))
                self._joint.append(slider)
                self._sliders.append(slider)

        def posture(_: object) -> None:
            if go.value == "go":
                front.clock.playing = False
                front.ask("posture", lambda: robot.movable.go_to_posture(postures.value))
            elif len(robot.movable.postures) < MOST_POSTURES:
                number = 1 + sum(name.startswith("kept") for name in robot.movable.postures)
                name = f"kept {number}"
                robot.movable.keep(name)
                postures.options = robot.movable.postures
                postures.value = name
                front.say(f"stored as '{name}'")
            else:
                front.say(f"not stored: the list has {MOST_POSTURES} postures, which is the maximum")

        go.on_click(posture)
        self.record = RecordPanel(front, robot, self._move_tab, self._sliders)

    def _mover(self, index: int, scale: float, slider: viser.GuiSliderHandle) -> Callable[[viser.GuiEvent], None]:
        front = self.front

        def moved(event: viser.GuiEvent) -> None:
            if event.client is None:
                return
            front.clock.playing = False
            value = slider.value * scale
            movable = front.active.movable
            front.continue_move(f"joint {index}", lambda: movable.move_joint(index, value))

        return moved

    # -- reading --------------------------------------------------------------------------------------

    def equations_shown(self) -> bool:
        """Return whether the user has chosen to show the named points that the equations compute."""
        return self._equations.value

    def ghost(self, visible: bool) -> None:
        """Show or hide the ghost, and set its checkbox."""
        self._ghost.value = visible
        self.front.show_ghost(visible)

    def exaggeration(self) -> float:
        """Return the factor by which differences between points of equations and mechanism are drawn larger."""
        return float(self._times.value.split()[0])

    def ghost_poses(self, robot: ShownRobot) -> dict[str, Array] | None:
        """Return the link poses T_base_body (4, 4) of a robot's ghost, by body; None if the poses cannot be computed.

        If the mechanism is edited, the ghost is the unedited mechanism at the same joint values. Otherwise, the ghost
        is the mechanism at the requested tool pose.
        """
        ghost_poses = self.design.unedited_poses(robot)
        if ghost_poses is not None:
            return ghost_poses
        movable = robot.movable
        if movable.requested_pose is None:
            return movable.assembly.link_poses
        try:
            return movable.model.solve_pose(movable.requested_pose, movable.assembly).link_poses
        except AssemblyError:
            return None

    def show(self, reading: RobotReading) -> None:
        """Show the readings of the active robot, the time, and the curves."""
        front = self.front
        movable = front.active.movable
        variants = []
        if movable.kin is not None:
            for equation, variant in movable.kin.variants.items():
                if len(movable.kin.choices.get(equation, ())) > 1:
                    variants.append(f"{equation}: {variant}")
        text = readout.table(reading, ", ".join(variants))
        if text != self._readout.content:
            self._readout.content = text
        headline = readout.headline(reading)
        if headline != self._headline.content:
            self._headline.content = headline
        for slider, joint, q in zip(self._joint, movable.joints, movable.assembly.q, strict=True):
            scale = DEG if joint.is_angle else MM
            value = float(np.clip(round(q / scale, 2), slider.min, slider.max))
            # a slider that a user drags is not moved
            if abs(slider.value - value) > 0.005 and not front.wished("joint"):
                slider.value = value
        clock = front.clock
        playback = front.active.playback
        if self._time is not None and playback is not None:
            if abs(self._time.value - clock.time) > 5e-4:
                self._time.value = round(min(clock.time, self._time.max), 3)
            phase = playback.phase(clock.time)
            state = f"**{escape(playback.title)}** · phase **{phase}** · {clock.time:.2f} of {clock.duration:.2f} s"
            if state != self._state.content:
                self._state.content = state
                self._phases.content = readout.phases(playback.phases, phase)
            label = "❚❚ Pause" if clock.playing else "▶ Play"
            if self._run.label != label:
                self._run.label = label
        self._draw_curves()
        self.design.show(reading)

    def _remove_plot(self) -> None:
        if self._plot is not None:
            self._plot.remove()
            self._plot = None

    def _draw_curves(self, force: bool = False) -> None:
        """Draw the chosen curves of the protocol, with a vertical line at the clock's time."""
        playback = self.front.active.playback
        if playback is None:
            return
        joints = []
        angles = []
        for joint in self.front.active.movable.joints:
            joints.append(joint.name)
            angles.append(joint.is_angle)
        names, values = curves(playback, self._what.value, joints, angles)
        chosen = plotted_samples(values)
        if not len(chosen):
            self._remove_plot()
            self._legend.content = "no RCM is registered in this protocol"
            return
        t = playback.t[chosen]
        rows = values[:, chosen]
        k = int(np.argmin(np.abs(t - self.front.clock.time)))
        low = float(rows.min())
        high = float(rows.max())
        clock_time = np.full(len(t), low)  # a separate curve that is a vertical line at the clock's time
        clock_time[k] = max(high, low + LEAST_SPAN)
        data = (t, *rows, clock_time)
        key = (self._what.value, self.front.active.name, playback)
        if self._plot is not None and not force and key == self._plotted:
            self._plot.data = data
            return
        self._remove_plot()
        series = [uplot.Series(label="t")]
        for i, name in enumerate(names):
            color = PALETTE[i % len(PALETTE)]
            series.append(uplot.Series(label=name, stroke=color, width=1.5))
        series.append(uplot.Series(label="now", stroke="#888888", width=1.0))
        self._legend.content = readout.legend(names, PALETTE)
        with self._curves_tab:
            self._plot = self.gui.add_uplot(
                data, tuple(series), scales={"x": uplot.Scale(time=False)},
                cursor=uplot.Cursor(show=True), height=300,
                axes=(uplot.Axis(label="time [s]"), uplot.Axis(size=58)), legend=uplot.Legend(show=False),
            )  # fmt: skip
        self._plotted = key


LEAST_SPAN = 0.01
"""Minimum range of the y axis of a plot, so that ten labels with three decimals are all different."""

_SMALL = (("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9), ("pm", 1e-12))
"""(Name, size in m) of the units of a distance, which may be a rounding error or some centimetres."""


def curves(playback: Playback, what: str, joints: list[str], angles: list[bool]) -> tuple[list[str], Array]:
    """Return (names with units, values (m, k)) of the m curves of a playback with k samples; `what`: see `CURVES`.

    `joints` are the names of the active joints; `angles` states for each active joint whether its value is an angle.
    """
    if what == "tip":
        return ["x [mm]", "y [mm]", "z [mm]"], playback.tip.T / MM
    if what == "RCM error":
        worst = float(np.nanmax(playback.rcm_error, initial=0.0))
        unit, scale = _unit_of(worst)
        return [f"shaft to RCM [{unit}]"], playback.rcm_error[None] / scale
    per, values = {
        "displacement": ("", playback.q),
        "speed": ("/s", playback.qd),
        "acceleration": ("/s²", playback.qdd),
    }[what]
    names = []
    scales = []
    for joint, is_angle in zip(joints, angles, strict=True):
        unit = "°" if is_angle else "mm"
        names.append(f"{joint} [{unit}{per}]")
        scales.append(DEG if is_angle else MM)
    return names, (values / np.array(scales)).T


def plotted_samples(values: Array) -> Index:
    """Return the indices of the samples of curves (m, k) that are plotted, at most `_POINTS`; none if all are left out.

    Samples without a value, as those of the RCM error while no RCM is registered, are left out.
    """
    has_values = np.isfinite(values).all(axis=0)
    samples = np.flatnonzero(has_values)
    return samples[spread(len(samples), _POINTS)]


def _unit_of(distance: float) -> tuple[str, float]:
    """Return the largest unit, with its size in m, in which a distance is at least 1; otherwise the smallest unit."""
    for unit, size in _SMALL:
        if distance >= size:
            return unit, size
    return _SMALL[-1]
