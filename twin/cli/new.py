"""`twin new`: a robot folder from a foreign description."""

from __future__ import annotations

import argparse
from pathlib import Path

from twin.cli import show
from twin.errors import TwinError


def new(args: argparse.Namespace) -> int:
    """Read a foreign description and write the robot folder."""
    from twin.importing import read
    from twin.importing.closing import close
    from twin.importing.folder import write_folder
    from twin.reference import ReferenceModel
    from twin.stage.read.names import identifier

    if identifier(args.name) != args.name:
        raise TwinError(f"'{args.name}' is no name for a robot; use [a-z][a-z0-9_]*, as in {identifier(args.name)}")
    source = Path(args.source)
    closures = Path(args.closures) if args.closures else None
    with show.progress(args.quiet or args.json) as progress:
        progress(f"read {source.name}", 0.0)
        imported = read(source, closures, args.root)
        progress("close loops", 0.5)
        imported = close(imported)
        target = Path(args.out or args.name)
        written = write_folder(imported, args.name, target, source)
    m = imported.mechanism
    worst = ReferenceModel(m).home().worst_gap
    data = {
        "robot": args.name,
        "files": [str(p) for p in written],
        "bodies": len(m.bodies),
        "joints": len(m.joints),
        "active": [j.name for j in m.active],
        "loops": len(m.loops),
        "worst_gap_m": worst,
        "findings": [f.as_dict() for f in imported.findings],
    }
    if args.json:
        print(show.as_json(data))
        return 0
    for finding in imported.findings:
        if finding.severity != "info":
            print(f"  {finding.severity}: {finding.message}")
    print(
        f"  {target}/: {len(m.bodies)} bodies, {len(m.joints)} joints, {len(m.loops)} loops closed to {worst:.2g} m, "
        f"{len(m.active)} driven\n  next: twin info {target}/, twin build {target}/, twin view {target}/; "
        "your equations and first protocol go from templates/ to formula.py and trajectories/first.toml"
    )
    return 0
