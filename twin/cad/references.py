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


def check(path: Path, description: Description) -> None:
    """Raise `DescriptionError` for the first unknown name, or the first unit that does not suit its joint's type."""
    for keys, message in (
        *_bodies(description),
        *_features(description),
        *_limits(description),
        *_motors(description),
        *_postures(description),
    ):
        raise error_at(path, keys, message)


def _bodies(description: Description) -> Iterator[tuple[Keys, str]]:
    references: list[tuple[Keys, str]] = [(("base",), description.base)]
    for number, joint in enumerate(description.joint):
        references.append((("joint", number, "parent"), joint.parent))
        references.append((("joint", number, "child"), joint.child))
    for body in description.feature:
        references.append((("feature", body), body))
    for name, frame in description.frame.items():
        references.append((("frame", name, "body"), frame.body))
    for name, point in description.point.items():
        references.append((("point", name, "body"), point.body))
    for number, length in enumerate(description.length):
        references.append((("length", number, "body"), length.body))
    for keys, body in references:
        if body not in description.body:
            yield keys, unknown("body", body, description.body)
    joints = [joint.name for joint in description.joint]
    trocars: list[tuple[Keys, str]] = []
    if description.trocar:
        trocars.append((("trocar",), description.trocar))
    for number, name in enumerate(description.trocars):
        trocars.append((("trocars", number), name))
    for keys, name in trocars:
        if name not in joints:
            yield keys, unknown("joint", name, joints)
    if description.tool not in description.frame:
        yield ("tool",), unknown("frame", description.tool, description.frame)
    for body, spec in description.body.items():
        frames_of_body = [name for name, frame in description.frame.items() if frame.body == body]
        if spec.frame is not None and spec.frame not in frames_of_body:
            yield ("body", body, "frame"), f"body '{body}': {unknown('frame', spec.frame, frames_of_body)}"


def _features(description: Description) -> Iterator[tuple[Keys, str]]:
    for number, joint in enumerate(description.joint):
        yield from _features_of_frame(description, ("joint", number, "on_parent"), joint.parent, joint.on_parent)
        yield from _features_of_frame(description, ("joint", number, "on_child"), joint.child, joint.on_child)
    for name, spec in description.frame.items():
        yield from _features_of_frame(description, ("frame", name, "at"), spec.body, spec.at)
    for name, point in description.point.items():
        yield from _features_of_body(description, ("point", name, "origin"), point.body, point.origin)
        yield from _features_of_body(description, ("point", name, "at"), point.body, point.at)
    for number, length in enumerate(description.length):
        yield from _features_of_body(description, ("length", number, "between"), length.body, list(length.between))


def _features_of_frame(description: Description, keys: Keys, body: str, spec: FrameSpec) -> Iterator[tuple[Keys, str]]:
    """Yield the faults of the features from which a frame of a body is computed."""
    for key in ("origin", "at", "z", "x_towards", "y_towards", "x_along"):
        yield from _features_of_body(description, (*keys, key), body, getattr(spec, key))


def _features_of_body(
    description: Description, keys: Keys, body: str, names: str | list[str] | None
) -> Iterator[tuple[Keys, str]]:
    """Yield the names of features that a body does not have."""
    features: Iterable[str] = description.feature.get(body, {})
    if isinstance(names, str):
        names = [names]
    for name in names or []:
        if name not in features:
            yield keys, f"body '{body}': {unknown('feature', name, features)}"


def _limits(description: Description) -> Iterator[tuple[Keys, str]]:
    types = {joint.name: joint.type for joint in description.joint}
    for kind, entries in (("limit", description.limit), ("drive", description.drive)):
        first: dict[str, int] = {}
        for number, entry in enumerate(entries):
            for joint in entry.joints:
                if joint not in types:
                    yield (kind, number, "joints"), unknown("joint", joint, types)
                elif first.get(joint) == number:
                    yield (kind, number, "joints"), f"joint '{joint}' is named twice in this entry; keep only one"
                elif joint in first:
                    text = f"joint '{joint}' has another [[{kind}]] entry{_contradiction(entries[first[joint]], entry)}"
                    yield (kind, number, "joints"), f"{text}; keep only one"
                first[joint] = number
    for number, limit in enumerate(description.limit):
        stated_keys = [key for key in type(limit).model_fields if getattr(limit, key) is not None]
        for joint in limit.joints:
            for key in stated_keys:
                text = _wrong_unit(joint, types.get(joint, "fixed"), key)
                if text:
                    yield ("limit", number, key), text
    yield from _couplings(description, types)
    yield from _gaps(description, types)


def _couplings(description: Description, types: Mapping[str, str]) -> Iterator[tuple[Keys, str]]:
    for number, coupling in enumerate(description.coupling):
        wrong = "deg"
        right = "mm"
        if coupling.sum_deg is None:
            wrong = "mm"
            right = "deg"
        # The sum has the unit of the first joint; the ratios of joints of the other kind are in m/rad or rad/m.
        for joint in coupling.joints[:1]:
            if UNITS.get(types.get(joint, "")) == right:
                yield ("coupling", number, f"sum_{wrong}"), f"joint '{joint}' is {types[joint]}; write sum_{right}"


def _gaps(description: Description, types: Mapping[str, str]) -> Iterator[tuple[Keys, str]]:
    for number, gap in enumerate(description.gap):
        for key in ("lower", "upper"):
            joint = getattr(gap, key)
            if joint not in types:
                yield ("gap", number, key), unknown("joint", joint, types)
            elif types[joint] != "prismatic":
                yield ("gap", number, key), f"joint '{joint}' is {types[joint]}; a gap requires prismatic joints"


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


def _motors(description: Description) -> Iterator[tuple[Keys, str]]:
    names: list[str] = []
    active: list[str] = []
    for joint in description.joint:
        names.append(joint.name)
        if joint.active:
            active.append(joint.name)
    driven = set()
    for drive in description.drive:
        driven |= set(drive.joints)
    for kind, name, key, text in faults(actuators(description), transmissions(description), active, names, driven):
        entries: list = getattr(description, kind)
        entry_names = [entry.name for entry in entries]
        index = entry_names.index(name)
        yield (kind, index, key), text


def _postures(description: Description) -> Iterator[tuple[Keys, str]]:
    types = {joint.name: joint.type for joint in description.joint if joint.active}
    for posture, values in description.posture.items():
        yield from _joint_values(("posture", posture), values, types)
    if description.start:
        yield from _joint_values(("start",), description.start, types)


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
