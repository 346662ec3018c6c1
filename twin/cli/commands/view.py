"""`twin view`: show a robot in a browser, where it can be moved, or a scene; implemented in twin.cli.browser_viewer."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command

EXAMPLES = """\
  twin view sils
  twin view sher phantom            plan and play the protocol `phantom`
  twin view davinci                 a scene, in the page of twin serve
  twin view davinci --task pegboard       with rings to grasp
  twin view my_robot/ --port 8090 --no-browser
  twin view my_robot/ --watch       rebuild the robot whenever its files change
  twin view usd/pa10/pa10.usda      a USD stage without a robot folder
  twin view my_robot/cad/my_robot.step    click a face, copy the TOML that names it
  twin view sils --html sils.html   a recording that plays without Python"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin view`."""
    command.page(8080, "page")
    command.tool()
    command.flag("--watch", "rebuild the robot when its STEP, TOML or formula changes; camera and posture stay")
    command.text("--html", "FILE", "write a recording of the protocol and exit")


def run(args: argparse.Namespace) -> int:
    """Show a robot, a scene, a stage or a STEP file until Ctrl-C; with --html write a recording and exit."""
    from twin.cli.browser_viewer import view

    return view(args)
