"""`twin info --inertia`: can bodies have the masses that are stated of them."""

from __future__ import annotations

import argparse
import math

from twin import api
from twin.cli import show
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES, by_severity, verdict


def run(robot: api.Robot, args: argparse.Namespace) -> int:
    """Print the audit of every place where masses of the robot are stated; exit 1 if one of them cannot be."""
    from twin.validation.masses import collect

    sources = []
    with show.progress(args.quiet or args.json) as progress:
        progress("weigh parts", 0.0)
        if robot.files is None:
            sources.append(collect.of_mechanism(robot.mechanism, "stage"))
        else:
            from twin.cad.build import read_mechanism

            weighed = read_mechanism(robot.files.description).mechanism
            sources.append(collect.of_mechanism(weighed, "weighed on the CAD"))
            if robot.files.stage.is_file():
                from twin.usd.read import read_stage

                progress("USD stage", 0.0)
                sources.append(collect.of_mechanism(read_stage(robot.files.stage), f"stage {robot.files.stage.name}"))
            if (robot.files.cad / "inertia.toml").is_file():
                sources.append(collect.of_table(robot.files.cad, weighed))
            if (robot.files.cad / "exhibit.toml").is_file():
                sources.append(collect.of_exhibit(robot.files.cad / "exhibit.toml"))
    if not any(s.bodies for s in sources):
        raise TwinError(f"{robot.name}: nobody states a mass; give materials with densities, or an inertia.toml")
    findings = [f for s in sources for f in s.all_findings]
    if args.json:
        data = [{"title": s.title, "bodies": [b.as_dict() for b in s.bodies]} for s in sources]
        said = [f.as_dict() for f in findings]
        print(show.as_json({"name": robot.name, "verdict": verdict(findings), "sources": data, "findings": said}))
        return EXIT_CODES[verdict(findings)]
    for source in sources:
        print(f"{robot.name}: {source.title}")
        rows = [
            (
                b.name,
                "-" if b.mass is None else f"{b.mass:.4g}",
                f"{b.least:.4g}",
                f"{b.slack:.3g}",
                f"{b.definite:.1e}",
                "-" if math.isnan(b.density) else f"{b.density:.0f}",
                "-" if math.isnan(b.outside) else "inside" if b.outside == 0 else f"{1e3 * b.outside:.1f} mm out",
                "" if not b.findings else "CANNOT BE" if verdict(b.findings) != "agree" else "odd",
            )
            for b in source.bodies
        ]
        least = sum(b.least for b in source.bodies)
        stated = sum(b.mass or 0.0 for b in source.bodies)
        rows.append(("sum", f"{stated:.4g}" if stated else "-", f"{least:.4g}", "", "", "", "", ""))
        head = ("body", "mass kg", "minimum kg", "slack kg m2", "definite", "kg/m3", "mass centre", "")
        print(show.table(rows, head), "\n")
        for f in by_severity(source.all_findings):
            print(show.finding(f))
        if source.all_findings:
            print()
    return EXIT_CODES[verdict(findings)]
