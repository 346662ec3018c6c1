"""Define the arguments of `twin workspace`, `twin tolerance` and `twin sweep`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

Add = Callable[[str, str, str], argparse.ArgumentParser]


def add_sweeps(
    add: Add, robot: Callable[[argparse.ArgumentParser], None], out: Callable[[argparse.ArgumentParser, str], None]
) -> None:
    """Add the commands to the parser.

    Args:
        add: function that creates a command from its name, help and examples.
        robot: function that adds the argument for the robot.
        out: function that adds the option for the output folder, with its default.
    """
    sub = add(
        "workspace",
        "compute the workspace: volume, conditioning, margins to limits and singularities",
        "  twin workspace sils                              a million positions in the home orientation\n"
        "  twin workspace sils --count 1e7 --tilt-deg 20 --turns 50\n"
        "  twin workspace pa10 --joints                     by sampling the joint ranges instead\n"
        "  twin workspace my_robot/ --step-mm 2 --scheduler tcp://10.0.0.1:8786",
    )
    robot(sub)
    sub.add_argument("--protocol", metavar="NAME", help="protocol with the position of the trocar (if any)")
    sub.add_argument("--count", type=_count, default=1_000_000, metavar="N", help="total number of poses (default 1e6)")
    sub.add_argument("--step-mm", type=float, metavar="MM", help="distance between positions, instead of --count")
    sub.add_argument(
        "--tilt-deg",
        type=float,
        default=0.0,
        metavar="DEG",
        help="maximum rotation of the tool about each axis (default 0)",
    )
    sub.add_argument(
        "--turns", type=int, default=30, metavar="N", help="number of orientations at each position (default 30)"
    )
    sub.add_argument(
        "--joints",
        action="store_true",
        help="sample joint values instead of poses (always done for equations without a closed-form inverse)",
    )
    _scheduler(sub)
    out(sub, "./twin-out/<robot>/workspace/")

    sub = add(
        "tolerance",
        "compute the tool error caused by part and encoder errors, and compare it with a requirement",
        "  twin tolerance sher                              in every posture, with the robot's requirement\n"
        "  twin tolerance sher --sigma-um 2 --encoder-um 0.5 --require-um 30\n"
        "  twin tolerance sils --protocol table2 --samples 100000 --json",
    )
    robot(sub)
    sub.add_argument("--protocol", metavar="NAME", help="evaluate along this protocol instead of in every posture")
    sub.add_argument(
        "--sigma-um",
        type=float,
        default=10.0,
        metavar="UM",
        help="standard deviation of a joint frame's position (default 10)",
    )
    sub.add_argument(
        "--sigma-deg",
        type=float,
        default=0.001,
        metavar="DEG",
        help="standard deviation of a joint frame's rotation about each of its axes (default 0.001)",
    )
    sub.add_argument(
        "--encoder-um",
        type=float,
        default=1.0,
        metavar="UM",
        help="standard deviation of a slide's encoder (default 1)",
    )
    sub.add_argument(
        "--encoder-deg",
        type=float,
        default=0.001,
        metavar="DEG",
        help="standard deviation of a rotary joint's encoder (default 0.001)",
    )
    sub.add_argument(
        "--require-um",
        type=float,
        metavar="UM",
        help="required 95th-percentile position error (default: the requirement of the robot)",
    )
    sub.add_argument(
        "--samples",
        type=_count,
        default=20_000,
        metavar="N",
        help="number of Monte Carlo samples (default 20000; 0: none)",
    )
    sub.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    out(sub, "./twin-out/<robot>/tolerance/")

    sub = add(
        "sweep",
        "evaluate other designs: parameters or distances on a grid or Latin hypercube",
        "  twin sweep sils --vary l_p=120..150mm --vary l_2=180..260mm --samples 200\n"
        "  twin sweep sher --vary l4:e_a-e_d=70..77mm --grid 9     a distance in the mechanism, evaluated by "
        "tolerance\n"
        "  twin sweep sils --vary l_p=120..150mm --grid 50 --scheduler tcp://10.0.0.1:8786 --parquet",
    )
    robot(sub)
    text = "parameter of the equations, or distance body:joint-joint, with its range; may be given more than once"
    sub.add_argument("--vary", metavar="NAME=LOW..HIGH", action="append", default=[], help=text)
    sub.add_argument(
        "--samples", type=_count, default=64, metavar="N", help="number of samples of the Latin hypercube (default 64)"
    )
    sub.add_argument("--grid", type=int, metavar="N", help="number of levels of each factor: a full grid, no samples")
    sub.add_argument(
        "--objective", metavar="NAMES", help="comma-separated list of volume, conditioning, margin, tolerance"
    )
    sub.add_argument("--protocol", metavar="NAME", help="protocol with the position of the trocar (if any)")
    sub.add_argument("--seed", type=int, default=0, help="random seed of the Latin hypercube (default 0)")
    _scheduler(sub)
    sub.add_argument(
        "--workers", type=int, metavar="N", help="number of worker processes (default one for each processor)"
    )
    sub.add_argument("--parquet", action="store_true", help="also write sweep.parquet")
    sub.add_argument("--fresh", action="store_true", help="evaluate all designs again instead of reusing results")
    out(sub, "./twin-out/<robot>/sweep-<key>/, one for each sweep")


def _scheduler(sub: argparse.ArgumentParser) -> None:
    text = (
        "address of a Dask scheduler, as in tcp://10.0.0.1:8786, or `local` for Dask worker processes on this machine"
    )
    sub.add_argument("--scheduler", metavar="ADDRESS", help=text)


def _count(text: str) -> int:
    """Convert a text, such as 1000 or 1e7, to a whole number."""
    value = float(text)
    if value != round(value):
        raise ValueError
    return int(value)
