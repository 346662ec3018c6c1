"""Check the names and units in a description before any CAD is read; error messages give file and line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from twin.cad.description import Description, FrameSpec
from twin.cad.motors import actuators, transmissions
from twin.core.errors import unknown
from twin.model.transmission import faults
from twin.schema import Keys, error_at

UNITS = {"revolute": "deg", "prismatic": "mm"}
"""Unit of the joint coordinate, for the joint types that have exactly one coordinate."""


def check(path: Path, d: Description) -> None:
    """Raise `DescriptionError` for the first unknown name, or the first unit that does not suit its joint's type."""
    for keys, message in (*_bodies(d), *_features(d), *_limits(d), *_motors(d), *_postures(d)):
        raise error_at(path, keys, message)


def _bodies(d: Description) -> Iterator[tuple[Keys, str]]:
    named: list[tuple[Keys, str]] = [(("base",), d.base)]
    for i, joint in enumerate(d.joint):
        named += [(("joint", i, "parent"), joint.parent), (("joint", i, "child"), joint.child)]
    named += [(("feature", body), body) for body in d.feature]
    named += [(("frame", n, "body"), f.body) for n, f in d.frame.items()]
    named += [(("point", n, "body"), p.body) for n, p in d.point.items()]
    named += [(("length", i, "body"), spec.body) for i, spec in enumerate(d.length)]
    for keys, body in named:
        if body not in d.body:
            yield keys, unknown("body", body, d.body)
    joints = [j.name for j in d.joint]
    trocars = [(("trocars", i), name) for i, name in enumerate(d.trocars)]
    for keys, name in [(("trocar",), d.trocar), *trocars] if d.trocar else trocars:
        if name not in joints:
            yield keys, unknown("joint", name, joints)
    if d.tool not in d.frame:
        yield ("tool",), unknown("frame", d.tool, d.frame)
    for body, spec in d.body.items():
        own = [n for n, f in d.frame.items() if f.body == body]
        if spec.frame is not None and spec.frame not in own:
            yield ("body", body, "frame"), f"body '{body}': {unknown('frame', spec.frame, own)}"


def _features(d: Description) -> Iterator[tuple[Keys, str]]:
    def frame(keys: Keys, body: str, spec: FrameSpec) -> Iterator[tuple[Keys, str]]:
        for key in ("origin", "at", "z", "x_towards", "y_towards", "x_along"):
            yield from names((*keys, key), body, getattr(spec, key))

    def names(keys: Keys, body: str, value: str | list[str] | None) -> Iterator[tuple[Keys, str]]:
        known: Iterable[str] = d.feature.get(body, {})
        for name in [value] if isinstance(value, str) else value or []:
            if name not in known:
                yield keys, f"body '{body}': {unknown('feature', name, known)}"

    for i, joint in enumerate(d.joint):
        yield from frame(("joint", i, "on_parent"), joint.parent, joint.on_parent)
        yield from frame(("joint", i, "on_child"), joint.child, joint.on_child)
    for n, f in d.frame.items():
        yield from frame(("frame", n, "at"), f.body, f.at)
    for n, p in d.point.items():
        yield from names(("point", n, "origin"), p.body, p.origin)
        yield from names(("point", n, "at"), p.body, p.at)
    for i, length in enumerate(d.length):
        yield from names(("length", i, "between"), length.body, list(length.between))


def _limits(d: Description) -> Iterator[tuple[Keys, str]]:
    types = {j.name: j.type for j in d.joint}
    for kind, entries in (("limit", d.limit), ("drive", d.drive)):
        first: dict[str, int] = {}
        for i, entry in enumerate(entries):
            for joint in entry.joints:
                if joint not in types:
                    yield (kind, i, "joints"), unknown("joint", joint, types)
                elif joint in first:
                    yield (kind, i, "joints"), f"joint '{joint}' has another [[{kind}]] entry; keep only one"
                first[joint] = i
    for i, limit in enumerate(d.limit):
        for joint in limit.joints:
            for key in type(limit).model_fields:
                if getattr(limit, key) is None or not ("_mm" in key or "_deg" in key):
                    continue
                kind, unit = types.get(joint, "fixed"), "mm" if "_mm" in key else "deg"
                if key == "cone_deg":
                    if kind != "spherical":
                        yield ("limit", i, key), f"joint '{joint}' is {kind}; only a spherical joint has a cone"
                elif kind not in UNITS:
                    yield ("limit", i, key), f"joint '{joint}' is {kind}: it has no single coordinate to limit"
                elif unit != UNITS[kind]:
                    right = key.replace(f"_{unit}", f"_{UNITS[kind]}")
                    yield ("limit", i, key), f"joint '{joint}' is {kind}; write {right}"
    for i, coupling in enumerate(d.coupling):
        wrong, right = ("mm", "deg") if coupling.sum_deg is None else ("deg", "mm")
        # The sum has the unit of the first joint; the ratios of joints of the other kind are in m/rad or rad/m.
        for joint in (n for n in coupling.joints[:1] if UNITS.get(types.get(n, "")) == right):
            text = f"joint '{joint}' is {types[joint]}; write sum_{right}"
            yield ("coupling", i, f"sum_{wrong}"), text
    for i, gap in enumerate(d.gap):
        for key in ("lower", "upper"):
            joint = getattr(gap, key)
            if joint not in types:
                yield ("gap", i, key), unknown("joint", joint, types)
            elif types[joint] != "prismatic":
                yield ("gap", i, key), f"joint '{joint}' is {types[joint]}; a gap requires prismatic joints"


def _motors(d: Description) -> Iterator[tuple[Keys, str]]:
    active = [j.name for j in d.joint if j.active]
    driven = {n for entry in d.drive for n in entry.joints}
    for kind, name, key, text in faults(actuators(d), transmissions(d), active, [j.name for j in d.joint], driven):
        entries: list = getattr(d, kind)
        yield (kind, next(i for i, e in enumerate(entries) if e.name == name), key), text


def _postures(d: Description) -> Iterator[tuple[Keys, str]]:
    types = {j.name: j.type for j in d.joint if j.active}
    for posture, values in d.posture.items():
        for key in values:
            joint, _, unit = key.rpartition("_")
            if unit not in ("mm", "deg"):
                yield ("posture", posture, key), f"the unit is missing; write {key}_mm or {key}_deg"
            elif joint not in types:
                yield ("posture", posture, key), unknown("active joint", joint, types)
            elif unit != UNITS.get(types[joint], unit):
                yield (
                    ("posture", posture, key),
                    f"joint '{joint}' is {types[joint]}; write {joint}_{UNITS[types[joint]]}",
                )
        for joint, kind in types.items():
            if not any(key.rpartition("_")[0] == joint for key in values):
                yield ("posture", posture), f"active joint '{joint}' is missing; write {joint}_{UNITS.get(kind, 'mm')}"
