"""Seed unit faults: one parameter of the equations, or numbers of the protocol, are given in a wrong unit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from twin.analysis.mutation.fault import Fault, some
from twin.api.robot import Robot
from twin.planning.protocol import Protocol, load_protocol

KINDS = (
    *("parameter", "position", "parameter", "angles", "parameter", "speed", "parameter"),
    *("depth", "turning", "trocar"),
)
"""Kinds of faults in the order of seeding; kinds that do not apply to the robot are skipped."""


def faults(robot: Robot, protocol: Path, rng: np.random.Generator, count: int) -> Iterator[Fault]:
    """Yield unit faults of a robot's parameters and of a protocol file."""
    text = protocol.read_text(encoding="utf-8")
    seen: set[str] = set()
    for i in range(10 * count):
        if len(seen) == count:
            return
        kind = KINDS[i % len(KINDS)]
        if kind == "parameter":
            fault = _parameter(robot, rng)
        else:
            done = _MAKERS[kind](tomlkit.parse(text), rng)
            if done is None:
                continue
            fault = Fault("units", kind, done[0], protocol=_reader(protocol, done[1]))
        if fault.what not in seen:
            seen.add(fault.what)
            yield fault


Done = tuple[str, Any] | None


def _reader(original: Path, document: Any) -> Callable[[Path], Protocol]:
    def read(folder: Path) -> Protocol:
        path = folder / original.name
        path.write_text(tomlkit.dumps(document), encoding="utf-8")
        return load_protocol(path, folder=original.parent)

    return read


def _parameter(robot: Robot, rng: np.random.Generator) -> Fault:
    assert robot.files is not None
    p = some([p for p in robot.formula.parameters if p.value and p.name not in robot.parameters], rng)
    angle = p.unit in ("deg", "rad")
    factor = float(rng.choice((180 / np.pi, np.pi / 180) if angle else (1000.0, 0.001)))
    word = (
        ("degrees instead of radians" if factor > 1 else "radians instead of degrees")
        if angle
        else ("mm instead of m" if factor > 1 else "m instead of mm")
    )

    def make(folder: Path) -> Robot:
        return robot.with_parameters({p.name: factor * p.value})

    return Fault("units", "parameter", f"{p.name} with {word}", robot=make)


def _scaled(values: Any, factor: float) -> list[float]:
    # five significant digits, as in a hand-written file
    return [float(f"{factor * float(v):.5g}") for v in values]


def _waypoint(document: Any, rng: np.random.Generator, key: str, least: float, factor: float, unit: str) -> Done:
    """Multiply the values of `key` by `factor` in a random waypoint, of those with a magnitude above `least`."""
    found = [n for n, w in document["waypoints"].items() if np.abs(np.array(w.get(key, 0.0), float)).max() > least]
    if not found:
        return None
    name = some(found, rng)
    w = document["waypoints"][name]
    w[key] = _scaled(w[key], factor)
    return f"{key.partition('_')[0]} of waypoint '{name}' in {unit}", document


def _depth(document: Any, rng: np.random.Generator) -> Done:
    deep = [w for w in document["waypoints"].values() if w.get("depth_mm")]
    deep += [p for p in document["phases"] if p.get("depth_mm") and p["type"] == "insertion"]
    if not deep:
        return None
    one = some(deep, rng)
    depth = float(one["depth_mm"])
    one["depth_mm"] = float(f"{1e-3 * depth:.5g}")
    return f"a depth of {depth:g} mm in metres", document


def _limits(document: Any, rng: np.random.Generator, name: str, factor: float, unit: str) -> Done:
    kind = some(list(document["limits"]), rng)
    keys = [k for k in document["limits"][kind] if k.startswith(name)]
    both = rng.integers(2) == 0
    for key in keys if both else keys[:1]:
        document["limits"][kind][key] = float(f"{factor * float(document['limits'][kind][key]):.5g}")
    return f"{name} {'speed and acceleration' if both else 'speed'} of {kind} in {unit}", document


def _trocar(document: Any, rng: np.random.Generator) -> Done:
    named = document.get("trocars_mm", {})
    places = [(document, k, k) for k in ("trocar_mm", "rcm_mm") if k in document]
    places += [(named, n, f"trocar '{n}'") for n in named]
    if not places:
        return None
    table, key, what = places[rng.integers(len(places)) if named else 0]
    table[key] = _scaled(table[key], 1e-3)
    return f"{what} in metres", document


_MAKERS: dict[str, Callable[[Any, np.random.Generator], Done]] = {
    "position": lambda d, rng: _waypoint(d, rng, "position_mm", 1.0, 1e-3, "metres"),
    "angles": lambda d, rng: _waypoint(d, rng, "angles_deg", 0.0, np.pi / 180, "radians"),
    "depth": _depth,
    "speed": lambda d, rng: _limits(d, rng, "tip", 1e-3, "m/s"),
    "turning": lambda d, rng: _limits(d, rng, "rotation", np.pi / 180, "rad/s"),
    "trocar": _trocar,
}
