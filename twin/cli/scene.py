"""Scenes: `twin run` plays all robots of one at once, with their distances; `twin info` shows one."""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError, unknown
from twin.core.findings import EXIT_CODES, by_severity, verdict
from twin.core.units import MM


def names() -> list[str]:
    """Return the names of the built-in scenes: every cad/<name>/scene.toml."""
    return sorted(p.parent.name for p in assets.data_folder().glob("cad/*/scene.toml"))


def find(name: str) -> Path | None:
    """Return the scene file of a built-in scene, or of a path to one or to its folder; None if it is no scene."""
    if name in names():
        return assets.data_folder() / "cad" / name / "scene.toml"
    path = Path(name)
    path = path / "scene.toml" if path.is_dir() else path
    return path if path.name == "scene.toml" and path.is_file() else None


COMMANDS = ("info", "run", "view", "export")
"""Commands that take a scene."""


def refuse(args: argparse.Namespace) -> None:
    """Do nothing, unless a scene is given to a command that takes one robot, or in another case.

    Raises:
        TwinError: it is; what works with the scene, and which robots are in it.
    """
    from twin.model.scene import load_scene

    name = getattr(args, "robot", None)
    if not isinstance(name, str):
        return
    if name not in names() and name.casefold() in names() and not Path(name).exists():
        raise TwinError(unknown("robot or scene", name, [*assets.names(), *names()]))
    if args.command in COMMANDS or (file := find(name)) is None:
        return
    robots = [p.name for p in load_scene(file).places]
    raise TwinError(
        f"'{name}' is a scene, not a robot. With a scene work {', '.join(f'twin {c} {name}' for c in COMMANDS)}; "
        f"`twin {args.command}` takes one of its robots: {', '.join(robots)}."
    )


def listed() -> list[dict[str, Any]]:
    """Return the built-in scenes for `twin list`."""
    from twin.model.scene import load_scene

    scenes = [load_scene(assets.data_folder() / "cad" / n / "scene.toml") for n in names()]
    return [{"name": s.name, "title": s.title, "robots": [p.name for p in s.places]} for s in scenes]


def info(file: Path, args: argparse.Namespace) -> int:
    """Print what stands where in a scene, and which numbers are assumed."""
    from twin.model.scene import load_scene

    scene = load_scene(file)
    data = {
        "name": scene.name,
        "title": scene.title,
        "source": scene.source,
        "robots": [
            {
                "name": p.name,
                "protocol": p.protocol,
                "port": p.port,
                "port_mm": (next(iter(p.p_world_ports.values())) / MM).tolist(),
                "position_mm": (p.T_world_base[:3, 3] / MM).tolist(),
            }
            for p in scene.places
        ],
        "cameras": {n: {"robot": c.robot, "frame": c.frame} for n, c in scene.cameras.items()},
        "surroundings": None if scene.props is None else scene.props.stem,
        "clearance_mm": scene.clearance / MM,
        "touching": sorted(sorted(t) for t in scene.touching),
        "parameters": [vars(p) for p in scene.parameters],
        "commands": [f"twin {c} {args.robot}" for c in COMMANDS],
    }
    if args.json:
        print(show.as_json(data))
        return 0
    print(f"{scene.name}: {scene.title}\n  {scene.source}\n")
    rows = [
        (r["name"], r["protocol"], r["port"], _point(r["port_mm"]), _point(r["position_mm"])) for r in data["robots"]
    ]
    print(show.table(rows, ("robot", "protocol", "port", "port at [mm]", "base at [mm]")))
    print(f"\n  surroundings: {data['surroundings'] or 'none'}; required clearance: {data['clearance_mm']:g} mm")
    print(*(f"  camera {n}: {c['robot']}, frame {c['frame']}" for n, c in data["cameras"].items()), sep="\n")
    print("\n  parameters (* assumed: nobody has published it)")
    rows = [
        (("*" if p.provenance == "ASSUMED" else " ") + p.name, f"{p.shown:g} {p.unit}", p.provenance, p.note)
        for p in scene.parameters
    ]
    print(show.table(rows, fit=True))
    print(f"\n  with it work: {', '.join(data['commands'])}")
    return 0


def _point(mm: list[float]) -> str:
    return ", ".join(f"{v:.1f}" for v in mm)


def run(file: Path, args: argparse.Namespace) -> int:
    """Plan every robot's protocol, play them together, write stage, table and picture; exit 1 if they meet."""
    from twin.cad.build import read_mechanism
    from twin.model.scene import load_scene
    from twin.simulation.scene_play import Actor, play, trocars_of
    from twin.simulation.scene_stage import write_scene
    from twin.ui.report.scene import figure
    from twin.ui.report.style import png

    scene = load_scene(file)
    root = Path(args.out) if args.out else Path("twin-out") / scene.name
    assets.require_writable(root)
    with show.progress(args.quiet or args.json) as progress:
        actors, robots = [], {}
        for i, place in enumerate(scene.places):
            progress(f"plan {place.name}", i / (2 * len(scene.places)))
            robot = api.load(place.name)
            protocol = robot.protocol(place.protocol)
            trajectory = api.plan(robot, protocol)
            mechanism = robot.bound(protocol).mechanism
            robots[place.name] = robot
            actors.append(Actor(place, mechanism, trajectory, trocars_of(place, mechanism, trajectory)))
        props = None if scene.props is None else read_mechanism(scene.props, with_mass=False).mechanism
        played = play(scene, actors, props, lambda label, f: progress(label, 0.5 + f / 2))
        with assets.atomic_folder(root) as work:
            stages = {}
            for a in actors:
                own = robots[a.place.name].files.usd
                if not (own / f"{a.place.name}_{a.place.protocol}.usda").is_file():
                    raise TwinError(f"{a.place.name} has no stage with its motion: `twin build {a.place.name}` first")
                shutil.copytree(own, work / "usd" / a.place.name)
                stages[a.place.name] = Path("..") / a.place.name / f"{a.place.name}_{a.place.protocol}.usda"
            duration = max(a.trajectory.duration for a in actors)
            mechanisms = {a.place.name: a.mechanism for a in actors}
            write_scene(scene, work / "usd" / scene.name, stages, mechanisms, props, duration)
            data = _data(scene, actors, played, root)
            (work / "scene.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
            (work / "scene.png").write_bytes(png(figure(scene, actors, played)))
            pairs = list(played.by_pair)
            head = ",".join(["t_s", *(f"{a}_{b}_mm" for a, b in pairs)])
            body = np.column_stack([played.t, *(played.by_pair[p].distance / MM for p in pairs)])
            np.savetxt(work / "scene.csv", body, "%.6g", ",", header=head, comments="")
    if args.json:
        print(show.as_json(data))
    else:
        print(f"{scene.name} · {scene.title}\n")
        rows = [(a.place.name, a.place.protocol, a.place.port, f"{a.trajectory.duration:.1f} s") for a in actors]
        print(show.table(rows, ("robot", "protocol", "port", "takes")), "\n")
        lines = []
        for (a, b), c in played.by_pair.items():
            k = int(np.argmin(c.distance))
            near = " - ".join(name.split("/")[1] for name in c.pair[k])
            lines.append((f"{a} - {b}", f"{c.distance[k] / MM:.1f} mm", near, f"t = {played.t[k]:.1f} s"))
        print(show.table(lines, ("pair", "minimum clearance", "between", "")), "\n")
        for f in by_severity(played.findings):
            print(show.finding(f))
        if not played.findings:
            least = min(float(c.distance.min()) for c in played.by_pair.values())
            print(f"  no collision: minimum clearance {least / MM:.1f} mm (required {scene.clearance / MM:g} mm)")
        print(f"\n  {root / 'scene.png'}\n  stage: {root / 'usd' / scene.name / (scene.name + '.usda')}")
    return EXIT_CODES[verdict(played.findings)]


def _data(scene, actors, played, root: Path) -> dict:
    pairs = {}
    for (a, b), c in played.by_pair.items():
        k = int(np.argmin(c.distance))
        pairs[f"{a}-{b}"] = {"least_mm": c.distance[k] / MM, "between": list(c.pair[k]), "t_s": float(played.t[k])}
    return {
        "verdict": verdict(played.findings),
        "scene": scene.name,
        "robots": [
            {
                "name": a.place.name,
                "protocol": a.place.protocol,
                "port": a.place.port,
                "duration_s": a.trajectory.duration,
            }
            for a in actors
        ],
        "clearance_mm": scene.clearance / MM,
        "pairs": pairs,
        "parameters": [
            {"name": p.name, "value": p.shown, "unit": p.unit, "provenance": p.provenance} for p in scene.parameters
        ],
        "findings": [f.as_dict() for f in played.findings],
        "folder": os.fspath(root),
    }
