"""Check the names and units in a description before any CAD is read; error messages give file and line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from twin.cad.actuators import actuators, transmissions
from twin.cad.description import Description, DriveSpec, FrameSpec, LimitSpec
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
        named.append((("joint", i, "parent"), joint.parent))
        named.append((("joint", i, "child"), joint.child))
    for body in d.feature:
        named.append((("feature", body), body))
    for name, frame in d.frame.items():
        named.append((("frame", name, "body"), frame.body))
    for name, point in d.point.items():
        named.append((("point", name, "body"), point.body))
    for i, length in enumerate(d.length):
        named.append((("length", i, "body"), length.body))
    for keys, body in named:
        if body not in d.body:
            yield keys, unknown("body", body, d.body)
    joints = [joint.name for joint in d.joint]
    trocars: list[tuple[Keys, str]] = []
    if d.trocar:
        trocars.append((("trocar",), d.trocar))
    for i, name in enumerate(d.trocars):
        trocars.append((("trocars", i), name))
    for keys, name in trocars:
        if name not in joints:
            yield keys, unknown("joint", name, joints)
    if d.tool not in d.frame:
        yield ("tool",), unknown("frame", d.tool, d.frame)
    for body, spec in d.body.items():
        own = [name for name, frame in d.frame.items() if frame.body == body]
        if spec.frame is not None and spec.frame not in own:
            yield ("body", body, "frame"), f"body '{body}': {unknown('frame', spec.frame, own)}"


def _features(d: Description) -> Iterator[tuple[Keys, str]]:
    for i, joint in enumerate(d.joint):
        yield from _of_frame(d, ("joint", i, "on_parent"), joint.parent, joint.on_parent)
        yield from _of_frame(d, ("joint", i, "on_child"), joint.child, joint.on_child)
    for name, spec in d.frame.items():
        yield from _of_frame(d, ("frame", name, "at"), spec.body, spec.at)
    for name, point in d.point.items():
        yield from _of_body(d, ("point", name, "origin"), point.body, point.origin)
        yield from _of_body(d, ("point", name, "at"), point.body, point.at)
    for i, length in enumerate(d.length):
        yield from _of_body(d, ("length", i, "between"), length.body, list(length.between))


def _of_frame(d: Description, keys: Keys, body: str, spec: FrameSpec) -> Iterator[tuple[Keys, str]]:
    """Yield the faults of the features from which a frame of a body is computed."""
    for key in ("origin", "at", "z", "x_towards", "y_towards", "x_along"):
        yield from _of_body(d, (*keys, key), body, getattr(spec, key))


def _of_body(d: Description, keys: Keys, body: str, names: str | list[str] | None) -> Iterator[tuple[Keys, str]]:
    """Yield the names of features that a body does not have."""
    known: Iterable[str] = d.feature.get(body, {})
    if isinstance(names, str):
        names = [names]
    for name in names or []:
        if name not in known:
            yield keys, f"body '{body}': {unknown('feature', name, known)}"


def _limits(d: Description) -> Iterator[tuple[Keys, str]]:
    types = {joint.name: joint.type for joint in d.joint}
    for kind, entries in (("limit", d.limit), ("drive", d.drive)):
        first: dict[str, int] = {}
        for i, entry in enumerate(entries):
            for joint in entry.joints:
                if joint not in types:
                    yield (kind, i, "joints"), unknown("joint", joint, types)
                elif first.get(joint) == i:
                    yield (kind, i, "joints"), f"joint '{joint}' is named twice in this entry; keep only one"
                elif joint in first:
                    text = f"joint '{joint}' has another [[{kind}]] entry{_contradiction(entries[first[joint]], entry)}"
                    yield (kind, i, "joints"), f"{text}; keep only one"
                first[joint] = i
    for i, limit in enumerate(d.limit):
        keys = [key for key in type(limit).model_fields if getattr(limit, key) is not None]
        for joint in limit.joints:
            for key in keys:
                text = _wrong_unit(joint, types.get(joint, "fixed"), key)
                if text:
                    yield ("limit", i, key), text
    yield from _couplings(d, types)
    yield from _gaps(d, types)


def _couplings(d: Description, types: Mapping[str, str]) -> Iterator[tuple[Keys, str]]:
    for i, coupling in enumerate(d.coupling):
        wrong = "deg"
        right = "mm"
        if coupling.sum_deg is None:
            wrong = "mm"
            right = "deg"
        # The sum has the unit of the first joint; the ratios of joints of the other kind are in m/rad or rad/m.
        for joint in coupling.joints[:1]:
            if UNITS.get(types.get(joint, "")) == right:
                yield ("coupling", i, f"sum_{wrong}"), f"joint '{joint}' is {types[joint]}; write sum_{right}"


def _gaps(d: Description, types: Mapping[str, str]) -> Iterator[tuple[Keys, str]]:
    for i, gap in enumerate(d.gap):
        for key in ("lower", "upper"):
            joint = getattr(gap, key)
            if joint not in types:
                yield ("gap", i, key), unknown("joint", joint, types)
            elif types[joint] != "prismatic":
                yield ("gap", i, key), f"joint '{joint}' is {types[joint]}; a gap requires prismatic joints"


def _contradiction(first: LimitSpec | DriveSpec, second: LimitSpec | DriveSpec) -> str:
    """Return, as the end of a sentence, the entries of which one gives limits and the other says there are none."""
    ends: dict[bool, str] = {}
    for entry in (first, second):
        for key, value in entry.model_dump(exclude_none=True).items():
            if key == "limits":
                ends[False] = 'limits = "none"'
            elif key in ("limits_mm", "limits_deg", "soft_limits_mm", "soft_limits_deg"):
                ends.setdefault(True, f"{key} = [{value[0]:g}, {value[1]:g}]")
    if len(ends) < 2:
        return ""
    return f", and {ends[False]} contradicts {ends[True]}"


def _wrong_unit(joint: str, kind: str, key: str) -> str:
    """Return the fault of the unit of the entry `key` of the limits of a joint of some kind; "" if there is none."""
    if "_mm" in key:
        unit = "mm"
    elif "_deg" in key:
        unit = "deg"
    elif key == "limits" and kind not in UNITS:
        return f"joint '{joint}' is {kind}: it has no single coordinate without limits"
    else:
        return ""
    if key == "cone_deg":
        return "" if kind == "spherical" else f"joint '{joint}' is {kind}; only a spherical joint has a cone"
    if kind not in UNITS:
        return f"joint '{joint}' is {kind}: it has no single coordinate to limit"
    if unit != UNITS[kind]:
        right = key.replace(f"_{unit}", f"_{UNITS[kind]}")
        return f"joint '{joint}' is {kind}; write {right}"
    return ""


def _motors(d: Description) -> Iterator[tuple[Keys, str]]:
    active = [joint.name for joint in d.joint if joint.active]
    names = [joint.name for joint in d.joint]
    driven = set()
    for drive in d.drive:
        driven |= set(drive.joints)
    for kind, name, key, text in faults(actuators(d), transmissions(d), active, names, driven):
        entries: list = getattr(d, kind)
        index = [entry.name for entry in entries].index(name)
        yield (kind, index, key), text


def _postures(d: Description) -> Iterator[tuple[Keys, str]]:
    types = {joint.name: joint.type for joint in d.joint if joint.active}
    for posture, values in d.posture.items():
        yield from _joint_values(("posture", posture), values, types)
    if d.start:
        yield from _joint_values(("start",), d.start, types)


def _joint_values(place: Keys, values: Mapping[str, float], types: Mapping[str, str]) -> Iterator[tuple[Keys, str]]:
    """Yield the faults of a table of joint values; `types`: type of each active joint, by name."""
    stated = set()
    for key in values:
        joint, _, unit = key.rpartition("_")
        stated.add(joint)
        if unit not in ("mm", "deg"):
            yield (*place, key), f"the unit is missing; write {key}_mm or {key}_deg"
        elif joint not in types:
            yield (*place, key), unknown("active joint", joint, types)
        elif unit != UNITS.get(types[joint], unit):
            right = f"{joint}_{UNITS[types[joint]]}"
            yield (*place, key), f"joint '{joint}' is {types[joint]}; write {right}"
    for joint, kind in types.items():
        if joint not in stated:
            right = f"{joint}_{UNITS.get(kind, 'mm')}"
            yield place, f"active joint '{joint}' is missing; write {right}"
