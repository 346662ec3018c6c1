"""`twin track`: simulate computed-torque control along a protocol, and the tip error caused by model mismatch."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command

EXAMPLES = """\
  twin track pa10
  twin track pa10 circle --mismatch 10 --curve
  twin track pa10 --inertia cad --plant pinocchio --json"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin track`."""
    command.robot()
    command.protocol()
    command.timing()
    command.out("./twin-out/<robot>/<protocol>-track/")
    text = "error of masses and inertia tensors in the controller's model in percent"
    command.number("--mismatch", "PERCENT", text, 5.0)
    command.choice("--plant", ("mujoco", "pinocchio"), "simulator of the robot (default mujoco)", "mujoco")
    text = (
        "source of masses and inertia tensors: cited in inertia.toml (default if it exists), or computed from the CAD"
    )
    command.choice("--inertia", ("cited", "cad"), text)
    command.flag("--curve", "also compute the tip error for model errors of -20..20 %%")


def run(args: argparse.Namespace) -> int:
    """Simulate the control, print errors and efforts, and write page, pictures and data.

    The exit code is 1 if the tip error exceeds 1 mm.
    """
    from twin import api
    from twin.cli import show

    robot = api.load(args.robot).with_timing(args.timing)
    # loaded here, because its name, not its path, is part of the folder
    protocol = robot.protocol(args.protocol)
    folder = show.folder(args, robot.name, f"{protocol.name}-track")
    with show.progress(args.quiet or args.json) as progress:
        result = api.track(
            robot,
            protocol,
            mismatch=args.mismatch / 100,
            plant=args.plant,
            inertia=args.inertia,
            curve=args.curve,
            progress=progress,
        )
    return show.store(result, args, folder)
