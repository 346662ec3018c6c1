"""`twin tolerance`: compute the tool error caused by part and encoder errors."""

from __future__ import annotations

import argparse

from twin.cli.parser import Command, count
from twin.core.errors import TwinError
from twin.core.units import DEG, MM, UM

EXAMPLES = """\
  twin tolerance sher                              in every posture, with the robot's requirement
  twin tolerance sher --sigma-um 2 --encoder-um 0.5 --require-um 30
  twin tolerance sils --protocol table2 --samples 100000 --json"""


_SAMPLES = 1_000_000_000
"""Maximum number of samples; a twentieth of them is kept, in two numbers each: 2 GB."""

_FEWEST_SAMPLES = 1000
"""Minimum number of samples: of fewer, the 95th percentile rests on less than 50."""

_LARGEST = 10 * MM
"""Maximum accepted standard deviation of a position in m."""

_WIDEST = 10 * DEG
"""Maximum accepted standard deviation of a rotation in rad."""


def arguments(command: Command) -> None:
    """Add the arguments of `twin tolerance`."""
    command.robot()
    command.text("--protocol", "NAME", "evaluate along this protocol instead of in the robot's postures")
    command.number("--sigma-um", "UM", "standard deviation of a joint frame's position", 10.0)
    command.number("--sigma-deg", "DEG", "standard deviation of a joint frame's rotation about each of its axes", 0.001)
    command.number("--encoder-um", "UM", "standard deviation of a slide's encoder", 1.0)
    command.number("--encoder-deg", "DEG", "standard deviation of a rotary joint's encoder", 0.001)
    text = "required 95th-percentile position error (default: the requirement of the robot)"
    command.number("--require-um", "UM", text)
    command.number("--samples", "N", "number of Monte Carlo samples, at least 1000, or 0 for none", 20_000, count)
    command.seed("random seed")
    command.device()
    command.out("./twin-out/<robot>/tolerance/")


def run(args: argparse.Namespace) -> int:
    """Compute and print the tool error; write its page, pictures and data.

    The exit code is 1 if a requirement is not met.
    """
    from twin import api
    from twin.analysis.error_propagation import Spread
    from twin.analysis.tolerance import tolerance as compute
    from twin.cli import show
    from twin.cli.option_values import device
    from twin.core.compute_device import computing_on

    if args.samples and args.samples < _FEWEST_SAMPLES:
        raise TwinError(
            f"--samples {args.samples}: give at least {_FEWEST_SAMPLES}, or 0 to omit the Monte Carlo check"
        )
    if args.samples > _SAMPLES:
        raise TwinError(f"--samples {args.samples}: give at most {_SAMPLES}")
    required = show.micrometres("--require-um", args.require_um)
    for option, value, most in (
        ("--sigma-um", args.sigma_um, _LARGEST / UM),
        ("--encoder-um", args.encoder_um, _LARGEST / UM),
        ("--sigma-deg", args.sigma_deg, _WIDEST / DEG),
        ("--encoder-deg", args.encoder_deg, _WIDEST / DEG),
    ):
        if value > most:
            text = "errors are propagated to first order, which holds for small errors"
            raise TwinError(f"{option} {value:g}: give at most {most:g}; {text}")
    robot = api.load(args.robot)
    folder = show.folder(args, robot.name, "tolerance")
    spread = Spread(args.sigma_um * UM, args.sigma_deg * DEG, args.encoder_um * UM, args.encoder_deg * DEG)
    with show.progress(args.quiet or args.json) as progress, computing_on(device(args)):
        budget = compute(
            robot,
            spread,
            args.protocol,
            required=required,
            samples=args.samples,
            seed=args.seed,
            progress=progress,
        )
    return show.store(budget, args, folder)
