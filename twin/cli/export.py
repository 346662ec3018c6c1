"""`twin export`: one folder for headsets, game engines and simulators, read again and proven."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from twin import api
from twin.cli import scene as scenes
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.findings import by_severity
from twin.core.units import DEG, UM
from twin.exchange.write.bundle import Bundle, chosen_formats
from twin.exchange.write.clip import Budget

_VERDICTS = {
    "agree": "AGREE: readers of their own see the same robot in every file, at every key",
    "disagree": "DISAGREE: the exported files disagree; see the findings",
    "unchecked": "UNCHECKED: something could not be read again",
}


def export(args: argparse.Namespace) -> int:
    """Write the bundle, let the audit read it, print what is where; exit 1 if the audit sees something else."""
    formats = chosen_formats(None if args.to is None else [f.strip() for f in args.to.split(",") if f.strip()])
    budget = Budget()
    if args.budget_um is not None:
        if not (math.isfinite(args.budget_um) and args.budget_um > 0):
            raise TwinError(f"--budget-um {args.budget_um:g}: give a positive number of micrometres")
        budget = Budget(
            args.budget_um * UM, budget.rotation * args.budget_um * UM / budget.position, args.budget_um * UM
        )
    if (scene := scenes.find(args.robot)) is not None:
        from twin.cli.scene_export import export_scene

        return export_scene(scene, args, formats, budget)
    robot = api.load(args.robot, tool=args.tool)
    show.told(robot, args.quiet)
    with show.progress(args.quiet or args.json) as progress:
        bundle = api.export(
            robot,
            folder=Path(args.out) if args.out else None,
            formats=formats,
            protocols=args.protocol or None,
            budget=budget,
            progress=progress,
        )
    print(show.as_json(_data(bundle)) if args.json else _text(bundle, formats))
    return bundle.exit_code


def _data(bundle: Bundle) -> dict:
    return {
        "verdict": bundle.verdict,
        "folder": str(bundle.folder),
        "files": [f.as_posix() for f in bundle.files],
        "bytes": bundle.size,
        "clips": [
            {
                "protocol": c.name,
                "rate": c.rate,
                "keys": len(c.times),
                "between_position": c.between_position,
                "between_rotation": c.between_rotation,
                "joint_gap": c.joint_gap,
            }
            for c in bundle.order.clips
        ],
        "checks": list(bundle.checks),
        "findings": [f.as_dict() for f in bundle.findings],
    }


def _text(bundle: Bundle, formats: tuple[str, ...]) -> str:
    lines = [f"{bundle.order.mechanism.name} · {', '.join(formats)}", "", f"  {_VERDICTS[bundle.verdict]}", ""]
    shown = [f for f in by_severity(bundle.findings) if f.severity != "info"]
    lines += [*(show.finding(f) for f in shown), ""] if shown else []
    rows = [
        (
            c.name,
            f"{c.times[-1]:.3f}",
            f"{c.rate:g}",
            f"{c.between_position / UM:.1f}",
            f"{c.between_rotation / DEG:.4f}",
            f"{c.joint_gap / UM:.1f}",
        )
        for c in bundle.order.clips
    ]
    if rows:
        header = ("motion", "s", "keys a second", "between keys µm", "degrees", "joints open µm")
        lines += [show.table(rows, header), ""]
    top: dict[str, int] = {}
    for file in bundle.files:
        name = f"{file.parts[0]}/" if len(file.parts) > 1 else file.name
        top[name] = top.get(name, 0) + (bundle.folder / file).stat().st_size
    lines.append(
        show.table([(f"{bundle.folder / n}{'/' * n.endswith('/')}", f"{size / 1e3:.0f} kB") for n, size in top.items()])
    )
    assumed = len(bundle.order.assumed) + sum(len(c.assumed) for c in bundle.order.clips)
    lines.append(
        f"\n  {bundle.size / 1e6:.1f} MB in {len(bundle.files)} files; {len(bundle.checks)} checks in proof.json"
    )
    if assumed:
        lines.append(f"  {assumed} assumed values (unpublished) are listed in README.txt.")
    return "\n".join(lines)
