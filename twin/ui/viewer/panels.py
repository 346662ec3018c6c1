"""The panels of the page: readings and curves on the left, the tabs Play, Move, Design and Scene on the right."""

from __future__ import annotations

from twin.core.errors import AssemblyError
from twin.core.spatial import Array
from twin.ui.session.readings import RobotReading
from twin.ui.viewer import readout
from twin.ui.viewer.curves_panel import CurvesPanel
from twin.ui.viewer.design_panel import DesignPanel
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.move_panel import MovePanel
from twin.ui.viewer.play_panel import PlayPanel


class Panels:
    """All controls and displays of the page; the module of each panel has what is inside it.

    Attributes:
        play, move, design, curves: the panels.
    """

    def __init__(self, front: Front) -> None:
        self.front = front
        gui = front.server.gui
        gui.set_panel_label(front.title)
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        side = gui.add_panel()
        with side.add_tab("Instruments"):
            self._readout = gui.add_html("")
        curves_tab = side.add_tab("Curves")
        side.dock_left()
        side.set_width(330)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(350)
        self._headline = gui.add_html("")
        if len(front.robots) > 1:
            names = [robot.name for robot in front.robots]
            chosen = gui.add_dropdown("active robot", names, initial_value=names[0])
            chosen.on_update(lambda e: front.ask("take", lambda: front.set_active(chosen.value)))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Play"):
            self.play = PlayPanel(front)
        move_tab = tabs.add_tab("Move")
        self.design = DesignPanel(front, tabs.add_tab("Design"))
        with tabs.add_tab("Scene"):
            front.scenery.panel()
        self.move = MovePanel(front, move_tab)
        self.curves = CurvesPanel(front, curves_tab)

    @property
    def why(self) -> str:
        """Why the last planning of a protocol failed; "" if none has failed."""
        return self.play.why

    def close(self) -> None:
        """End the processes of the panels."""
        self.design.close()

    def rebuild(self) -> None:
        """Rebuild the panels for another active robot, or for another build of the active robot."""
        robot = self.front.active
        self.play.rebuild()
        self.move.rebuild()
        self.design.rebuild()
        if robot.playback is not None:
            self.show_planned(robot)
        else:
            self.play.show_unplanned()
            self.curves.clear()

    # -- protocols ------------------------------------------------------------------------------------

    def show_planning(self, robot: ShownRobot, protocol: str | None) -> None:
        """Show that a protocol of a robot is being planned; None: its default protocol."""
        self.play.show_planning(robot, protocol)

    def show_failure(self, robot: ShownRobot, error: str) -> None:
        """Show why the protocol of a robot cannot be played."""
        self.play.show_failure(robot, error)

    def show_planned(self, robot: ShownRobot) -> None:
        """Show timeline and curves of the planned protocol of a robot."""
        self.play.show_planned(robot)
        if robot is self.front.active:
            self.curves.draw(force=True)

    # -- what is drawn in the picture -----------------------------------------------------------------

    def shows_equation_points(self) -> bool:
        """Return whether the user has chosen to show the named points that the equations compute."""
        return self.play.shows_equation_points

    def error_magnification(self) -> float:
        """Return the factor by which differences between points of equations and mechanism are drawn larger."""
        return self.play.error_magnification

    def show_ghost(self, visible: bool) -> None:
        """Show or hide the ghost, and set its checkbox."""
        self.play.show_ghost(visible)

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

    # -- readings -------------------------------------------------------------------------------------

    def show(self, reading: RobotReading) -> None:
        """Show the readings of the active robot, its joint values, the time, and the curves."""
        movable = self.front.active.movable
        variants = []
        if movable.kin is not None:
            for equation, variant in movable.kin.variants.items():
                if len(movable.kin.choices.get(equation, ())) > 1:
                    variants.append(f"{equation}: {variant}")
        text = readout.table(reading, ", ".join(variants))
        if text != self._readout.content:  # every change is sent to the browser
            self._readout.content = text
        headline = readout.headline(reading)
        if headline != self._headline.content:
            self._headline.content = headline
        self.move.show_joints()
        self.play.show_time()
        self.curves.draw()
        self.design.show(reading)
