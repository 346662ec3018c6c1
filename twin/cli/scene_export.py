"""`twin export` of a scene: each robot's bundle, proven by itself, and where it stands; one USD stage with all of them.

Formats other than USD hold one robot with its motion. `scene.json` places them: every player puts a robot's base at
its place and starts all motions at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from twin import api
from twin.cli import show
from twin.core import assets
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES, Finding, by_severity, verdict
from twin.core.units import UM
from twin.exchange.write.bundle import Bundle
from twin.exchange.write.clip import Budget
from twin.model.scene import Scene, load_scene

_TOLERANCE = 1 * UM
"""Between a link in the scene's stage and its place times the link of its bundle, in m."""


def export_scene(file: Path, args: argparse.Namespace, formats: tuple[str, ...], budget: Budget) -> int:
    """Write a scene's bundles and its stage, read the stage again; exit 1 if a reader sees something else."""
    if args.tool is not None or args.protocol:
        raise TwinError(f"{args.robot} is a scene: its file says the tools and protocols; leave --tool, --protocol out")
    scene = load_scene(file)
    root = Path(args.out) if args.out else Path("twin-out") / scene.name / "export"
    assets.require_writable(root)
    bundles: dict[str, Bundle] = {}
    with show.progress(args.quiet or args.json) as progress, assets.atomic_folder(root) as work:
        for place in scene.places:
            bundles[place.name] = api.export(
                api.load(place.name),
                folder=work / place.name,
                formats=formats,
                protocols=[place.protocol],
                budget=budget,
                progress=lambda label, part, name=place.name: progress(f"{name}: {label}", part),
            )
        findings = [f for b in bundles.values() for f in b.findings]
        checks: list[dict[str, Any]] = []
        if "usd" in formats:
            stage = _write_stage(scene, bundles, work / "usd")
            checks = [_check(stage, scene, bundles)]
            findings += [_finding(c) for c in checks if c["verdict"] != "agree"]
        data = _data(scene, bundles, checks, findings)
        (work / "scene.json").write_text(show.as_json(data) + "\n", encoding="utf-8")
        (work / "README.txt").write_text(_readme(scene, formats), encoding="utf-8")
    if args.json:
        print(show.as_json({**data, "folder": str(root)}))
    else:
        print(_text(scene, bundles, checks, findings, root))
    return EXIT_CODES[verdict(findings)]


def _write_stage(scene: Scene, bundles: dict[str, Bundle], folder: Path) -> Path:
    from twin.cad.build import read_mechanism
    from twin.simulation.scene_stage import write_scene

    stages = {p.name: Path("..") / p.name / "usd" / f"{p.name}_{p.protocol}.usda" for p in scene.places}
    mechanisms = {n: b.order.mechanism for n, b in bundles.items()}
    props = None if scene.props is None else read_mechanism(scene.props, with_mass=False).mechanism
    return write_scene(scene, folder, stages, mechanisms, props, _duration(bundles))


def _duration(bundles: dict[str, Bundle]) -> float:
    return max(float(c.times[-1]) for b in bundles.values() for c in b.order.clips)


def _check(stage: Path, scene: Scene, bundles: dict[str, Bundle]) -> dict[str, Any]:
    """Return how far any point at 0.1 m about a link's origin is from its place, as OpenUSD composes the stage."""
    from pxr import Usd, UsdGeom

    opened = Usd.Stage.Open(str(stage))
    rate = opened.GetTimeCodesPerSecond()
    corners = np.vstack([np.zeros(3), 0.1 * np.eye(3)])
    worst, where = 0.0, ""
    for place in scene.places:
        (clip,) = bundles[place.name].order.clips
        for k in (0, len(clip.times) // 2, len(clip.times) - 1):
            cache = UsdGeom.XformCache(clip.times[k] * rate)
            for link, Ts in clip.links.items():
                prim = opened.GetPrimAtPath(f"/{scene.name}/{place.name}/{link}")
                if not prim:
                    return _row(np.inf, f"{place.name}/{link} is missing")
                T = np.array(cache.GetLocalToWorldTransform(prim)).T
                wanted = place.T_world_base @ Ts[k]
                off = corners @ (T - wanted)[:3, :3].T + (T - wanted)[:3, 3]
                distance = float(np.linalg.norm(off, axis=1).max())
                if distance >= worst:
                    worst, where = distance, f"{place.name}/{link}, t = {clip.times[k]:.3f} s"
    return _row(worst, where)


def _row(worst: float, where: str) -> dict[str, Any]:
    return {
        "check": "every link in world, first, middle and last key",
        "tool": "pxr",
        "worst": worst if np.isfinite(worst) else None,
        "unit": "m",
        "tolerance": _TOLERANCE,
        "verdict": "agree" if worst <= _TOLERANCE else "disagree",
        "where": where,
    }


def _finding(check: dict[str, Any]) -> Finding:
    off = "" if check["worst"] is None else f"a link is {check['worst']:.3g} m from its place: "
    text = f"the scene's stage: {off}{check['where']}"
    return Finding(
        "export.scene", "disagreement", text, check["where"], size=check["worst"], unit="m", limit=_TOLERANCE
    )


def _data(
    scene: Scene, bundles: dict[str, Bundle], checks: Sequence[dict[str, Any]], findings: Sequence[Finding]
) -> dict[str, Any]:
    return {
        "schema": "twin-scene-export",
        "version": 1,
        "verdict": verdict(findings),
        "scene": scene.name,
        "title": scene.title,
        "duration_s": _duration(bundles),
        "robots": [
            {
                "name": p.name,
                "folder": p.name,
                "protocol": p.protocol,
                "T_world_base": p.T_world_base.tolist(),
                "duration_s": float(bundles[p.name].order.clips[0].times[-1]),
                "verdict": bundles[p.name].verdict,
                "checks": len(bundles[p.name].checks),
            }
            for p in scene.places
        ],
        "checks": list(checks),
        "findings": [f.as_dict() for f in findings],
        "parameters": [
            {"name": p.name, "value": p.shown, "unit": p.unit, "provenance": p.provenance} for p in scene.parameters
        ],
    }


def _readme(scene: Scene, formats: Sequence[str]) -> str:
    lines = [
        f"{scene.title}",
        "",
        "One folder for each robot, with its own README.txt and proof.json:",
        f"  {', '.join(p.name for p in scene.places)}.",
        f"Formats: {', '.join(formats)}. Each file holds one robot in its base frame, z up, m, with its motion.",
        "scene.json   T_world_base of each robot (4 x 4, rows), and its protocol; all motions start together.",
    ]
    if "usd" in formats:
        lines.append(f"usd/{scene.name}.usda   all robots at their places with their motions, and what stands around.")
    return "\n".join(lines) + "\n"


def _text(
    scene: Scene,
    bundles: dict[str, Bundle],
    checks: Sequence[dict[str, Any]],
    findings: Sequence[Finding],
    root: Path,
) -> str:
    lines = [f"{scene.name} · {scene.title}", "", f"  {verdict(findings).upper()}", ""]
    lines += [show.finding(f) for f in by_severity(findings) if f.severity != "info"]
    rows = [
        (p.name, p.protocol, f"{bundles[p.name].order.clips[0].times[-1]:.1f} s", str(len(bundles[p.name].checks)))
        for p in scene.places
    ]
    lines += [show.table(rows, ("robot", "protocol", "takes", "checks")), ""]
    lines += [
        f"  the scene's stage: {c['worst'] / UM:.3f} µm off the bundles at most; limit {c['tolerance'] / UM:g} µm"
        for c in checks
        if c["worst"] is not None
    ]
    lines.append(f"  {root}/")
    return "\n".join(lines)
