"""`twin track`: simulate computed-torque control along a protocol, and the tip error caused by model mismatch."""

from __future__ import annotations

import argparse

from twin import api
from twin.cli import show


def track(args: argparse.Namespace) -> int:
    """Simulate the control, print errors and efforts, and write files.

    The exit code is 1 if the tip error exceeds 1 mm.
    """
    robot = api.load(args.robot)
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
