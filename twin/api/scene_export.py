"""Export a scene: a checked bundle for each robot with its base pose, and one USD stage with all robots.

Files in formats other than USD contain one robot with its motion. `scene.json` contains the pose of each robot's base.
A player places the bases, and starts all motions at the same time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.api.make import export
from twin.api.robot import Progress, load, silent
from twin.core import assets
from twin.core.findings import Finding, by_severity, disagreement
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, Table
from twin.core.units import UM
from twin.exchange.write.bundle import Bundle, chosen_formats
from twin.exchange.write.clip import Budget
from twin.model.scene import Scene, load_scene

_TOLERANCE = 1 * UM
"""Maximum difference in m between the world position of a link in the scene's stage and in its robot's bundle."""


@dataclass(frozen=True)
class SceneBundle(Result):
    """The files written for a scene.

    Attributes:
        scene: the scene.
        formats: the formats written.
        bundles: bundle of each robot, by name.
        checks: results of the checks of the scene's stage; empty without USD.
    """

    scene: Scene
    formats: tuple[str, ...]
    bundles: Mapping[str, Bundle]
    checks: tuple[dict[str, Any], ...]

    kind = "scene-export"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the bundles and of the scene's stage."""
        own = [f for b in self.bundles.values() for f in b.findings]
        return (*own, *(_finding(c) for c in self.checks if c["verdict"] != "agree"))

    def content(self) -> dict[str, Any]:
        """Return plain data."""
        bundles = self.bundles
        return {
            "scene": self.scene.name,
            "title": self.scene.title,
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
                for p in self.scene.places
            ],
            "checks": list(self.checks),
            "parameters": [
                {"name": p.name, "value": p.shown, "unit": p.unit, "provenance": p.provenance}
                for p in self.scene.parameters
            ],
        }

    def text(self) -> Iterator[Part]:
        """Yield the verdict, findings, a row for each robot, and the deviation of the stage."""
        yield f"{self.scene.name} · {self.scene.title}\n\n  {self.verdict.upper()}\n"
        yield from (f for f in by_severity(self.findings) if f.severity != "info")
        bundles = self.bundles
        rows = [
            (p.name, p.protocol, f"{bundles[p.name].order.clips[0].times[-1]:.1f} s", str(len(bundles[p.name].checks)))
            for p in self.scene.places
        ]
        yield Table(("robot", "protocol", "takes", "checks"), rows)
        yield ""
        for c in self.checks:
            if c["worst"] is not None:
                off, limit = f"{c['worst'] / UM:.3f} µm", f"{c['tolerance'] / UM:g} µm"
                yield f"  the scene's stage: maximum deviation from the bundles {off}, limit {limit}"


def export_scene(
    file: Path,
    folder: Path | None = None,
    formats: Sequence[str] | None = None,
    *,
    budget: Budget | None = None,
    progress: Progress = silent,
) -> SceneBundle:
    """Write a bundle for each robot of a scene and one USD stage with all robots, and check the written files.

    Args:
        file: scene.toml.
        folder: folder to write; default: ./twin-out/<scene>/export/.
        formats: see `twin.export`.
        budget: see `twin.export`.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: an input is missing or malformed; the folder stays unchanged.
    """
    scene, kinds = load_scene(file), chosen_formats(formats)
    root = folder or Path("twin-out") / scene.name / "export"
    scene.require_protocols()
    assets.require_writable(root)
    bundles: dict[str, Bundle] = {}
    with assets.atomic_folder(root) as work:
        for place in scene.places:
            bundles[place.name] = export(
                load(place.robot),
                folder=work / place.name,
                formats=kinds,
                protocols=[place.protocol],
                budget=budget,
                progress=lambda label, part, name=place.name: progress(f"{name}: {label}", part),
            )
        checks = (_check(_write_stage(scene, bundles, work / "usd"), scene, bundles),) if "usd" in kinds else ()
        found = SceneBundle(scene, kinds, bundles, checks)
        (work / "scene.json").write_text(found.to_json() + "\n", encoding="utf-8")
        (work / "README.txt").write_text(_readme(scene, kinds), encoding="utf-8")
    return found


def _write_stage(scene: Scene, bundles: Mapping[str, Bundle], folder: Path) -> Path:
    from twin.cad.build import read_mechanism
    from twin.simulation.scene_stage import write_scene

    stages = {p.name: Path("..") / p.name / "usd" / f"{p.robot}_{p.protocol}.usda" for p in scene.places}
    mechanisms = {n: b.order.mechanism for n, b in bundles.items()}
    props = None if scene.props is None else read_mechanism(scene.props, with_mass=False).mechanism
    return write_scene(scene, folder, stages, mechanisms, props, _duration(bundles))


def _duration(bundles: Mapping[str, Bundle]) -> float:
    return max(float(c.times[-1]) for b in bundles.values() for c in b.order.clips)


def _check(stage: Path, scene: Scene, bundles: Mapping[str, Bundle]) -> dict[str, Any]:
    """Return the maximum deviation of the links in the composed USD stage, at points up to 0.1 m from their origins."""
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
    off = None if check["worst"] is None else Quantity(check["worst"], "m")
    what = f"the scene's stage: {check['where']}" + ("" if off is None else ", displacement of a link")
    return disagreement("export.scene", check["where"], what, off, _TOLERANCE if off else None, word="tolerance")


def _readme(scene: Scene, formats: Sequence[str]) -> str:
    lines = [
        f"{scene.title}",
        "",
        "One folder for each robot, with its own README.txt and proof.json:",
        f"  {', '.join(p.name for p in scene.places)}.",
        f"Formats: {', '.join(formats)}. Each file contains one robot with its motion, in its base frame, z up, in m.",
        "scene.json   T_world_base of each robot (4 x 4, row by row), and its protocol; all motions start together.",
    ]
    if "usd" in formats:
        lines.append(f"usd/{scene.name}.usda   all robots at their base poses with their motions, and the props.")
    return "\n".join(lines) + "\n"
