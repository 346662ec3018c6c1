"""`twin export`: write files for headsets, game engines and simulators, and check them with independent readers."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.exchange.write.bundle import chosen_formats
from twin.exchange.write.clip import Budget


def export(args: argparse.Namespace) -> int:
    """Write the export folder, audit it and print the files; the exit code is 1 if the audit finds a difference."""
    formats = chosen_formats(None if args.to is None else [f.strip() for f in args.to.split(",") if f.strip()])
    budget = Budget()
    if (size := show.micrometres("--budget-um", args.budget_um)) is not None:
        budget = Budget(size, budget.rotation * size / budget.position, size)
    if (scene := assets.scene_file(args.robot)) is not None:
        return _scene(scene, args, formats, budget)
    robot = api.load(args.robot, tool=args.tool)
    show.tool_note(robot, args.quiet)
    with show.progress(args.quiet or args.json) as progress:
        bundle = api.export(
            robot,
            folder=Path(args.out) if args.out else None,
            formats=formats,
            protocols=args.protocol or None,
            budget=budget,
            progress=progress,
        )
    return show.finish(bundle, args)


def _scene(file: Path, args: argparse.Namespace, formats: tuple[str, ...], budget: Budget) -> int:
    from twin.api.scene_export import export_scene

    if args.tool is not None or args.protocol:
        raise TwinError(
            f"{args.robot} is a scene: its file defines the tools and protocols; omit --tool and --protocol"
        )
    folder = Path(args.out) if args.out else Path("twin-out") / file.parent.name / "export"
    with show.progress(args.quiet or args.json) as progress:
        found = export_scene(file, folder, formats, budget=budget, progress=progress)
    return show.finish(found, args, folder, [""])
