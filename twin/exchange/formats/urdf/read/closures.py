"""Read the closure YAML of a URDF: pairs of frames that close loops, driven joints, and replaced joint types.

closed_loop: [[frame_a, frame_b], ...]
type: [6d, ...]              6d: welded; 3d: the origins coincide, as in a ball joint
name_mot: [joint, ...]
joint_name: [joint, ...]     joints of the URDF whose type is replaced, because a URDF joint has only one axis
joint_type: [SPHERICAL, ...] new types of these joints: SPHERICAL (ball), FIXED (fixed at zero), UJOINT_XY (hinges
                             about x, then y, of the joint's frame)
home: {joint: 0.5, ...}      values in rad and m at which the loops are closed; without it, all are zero
coupling: {name: {joints: [...], ratios: [...], sum: 0}}   sum of ratio times joint value

If every line is a key with its value in JSON, as twin writes it, PyYAML is not needed.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from twin.core.errors import SourceError, unknown
from twin.core.extras import require
from twin.core.foreign.text import read_text
from twin.core.json_types import JsonObject
from twin.model.joint import JointType

TYPES: dict[str, JointType] = {"6d": "fixed", "3d": "spherical"}
"""Type of the joint that closes a loop, for each value of `type` in the closure YAML."""

_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type", "home", "coupling")

RETYPED = ("SPHERICAL", "FIXED", "UJOINT_XY", "UJOINT_XZ", "UJOINT_YX", "UJOINT_YZ", "UJOINT_ZX", "UJOINT_ZY")
"""Joint types that can replace the type of a URDF joint."""


@dataclass(frozen=True)
class Closures:
    """Content of a closure YAML.

    `loops` contains (frame, frame, type of the joint between the two frames). `motors` contains the names of the driven
    joints. `retyped` maps the names of URDF joints to their new types. `home` contains values of joints in rad and m
    at which the loops are closed. `couplings` are (name, joints, ratios, sum in rad or m) for each coupling.
    """

    loops: tuple[tuple[str, str, JointType], ...]
    motors: tuple[str, ...]
    retyped: dict[str, str]
    home: dict[str, float]
    couplings: tuple[tuple[str, tuple[str, ...], tuple[float, ...], float], ...]


def read_closures(path: Path) -> Closures:
    """Read a closure YAML.

    Raises:
        SourceError: the file is invalid; the message names file, key and expected form.
    """
    data = _parse(path)
    if not isinstance(data, dict):
        raise SourceError(f"{path}: expected the keys closed_loop, type and name_mot")
    for key in data:
        if key not in _KEYS:
            raise SourceError(f"{path}: {unknown('key', str(key), _KEYS)}")
    pairs = _list(path, data, "closed_loop")
    types = _list(path, data, "type")
    motors = _list(path, data, "name_mot")
    if len(types) != len(pairs):
        text = f"closed_loop has {len(pairs)} pairs, but type has {len(types)} entries; give one type for each pair"
        raise SourceError(f"{path}: {text}")
    loops = []
    for pair, kind in zip(pairs, types, strict=True):
        if not _is_pair_of_names(pair):
            raise SourceError(f"{path}: closed_loop: {str(pair)[:80]} is not a pair of names")
        if pair[0] == pair[1]:
            raise SourceError(f"{path}: closed_loop: '{pair[0]}' is paired with itself")
        if not isinstance(kind, str) or kind.lower() not in TYPES:
            raise SourceError(f"{path}: type: {unknown('closure type', str(kind)[:40], TYPES)}")
        loops.append((pair[0], pair[1], TYPES[kind.lower()]))
    _distinct(path, "name_mot", motors)
    if not motors:
        raise SourceError(f"{path}: name_mot is empty; name at least one driven joint")
    names = _list(path, data, "joint_name")
    kinds = _list(path, data, "joint_type")
    _distinct(path, "joint_name", names)
    if len(kinds) != len(names):
        raise SourceError(
            f"{path}: joint_name has {len(names)} names, but joint_type has {len(kinds)} entries; give one type for "
            "each name"
        )
    for kind in kinds:
        if not isinstance(kind, str) or kind.upper() not in RETYPED:
            raise SourceError(f"{path}: joint_type: {unknown('joint type', str(kind)[:40], RETYPED)}")
    retyped = {}
    for name, kind in zip(names, kinds, strict=True):
        retyped[name] = kind.upper()
    return Closures(tuple(loops), tuple(motors), retyped, _home(path, data), _couplings(path, data))


def _home(path: Path, data: dict) -> dict[str, float]:
    home = {}
    for name, value in _table(path, data, "home").items():
        if not _is_number(value):
            raise SourceError(f"{path}: home: the value of '{name[:40]}' is {str(value)[:40]!r}, not a number")
        home[name] = float(value)
    return home


def _couplings(path: Path, data: dict) -> tuple[tuple[str, tuple[str, ...], tuple[float, ...], float], ...]:
    couplings = []
    for name, entry in _table(path, data, "coupling").items():
        where = f"{path}: coupling '{name[:40]}'"
        if not isinstance(entry, dict) or set(entry) != {"joints", "ratios", "sum"}:
            raise SourceError(f"{where}: expected the keys joints, ratios and sum")
        joints = _list(path, entry, "joints")
        ratios = _list(path, entry, "ratios")
        _distinct(path, "joints", joints)
        numbers = (*ratios, entry["sum"])
        if len(joints) != len(ratios) or len(joints) < 2 or not all(map(_is_number, numbers)):
            raise SourceError(f"{where}: expected two or more joints, a number in ratios for each of them, and a sum")
        if not all(ratios):
            raise SourceError(f"{where}: a ratio is 0; omit its joint")
        couplings.append((name, tuple(joints), tuple(map(float, ratios)), float(entry["sum"])))
    return tuple(couplings)


def _is_pair_of_names(value: object) -> bool:
    if not isinstance(value, list) or len(value) != 2:
        return False
    first, second = value
    return isinstance(first, str) and isinstance(second, str)


def _is_number(value: object) -> bool:
    # YAML reads yes and on as True, which is an int in Python.
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _table(path: Path, data: dict, key: str) -> JsonObject:
    value = data.get(key, {})
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        raise SourceError(f"{path}: {key}: expected names with their values, found {str(value)[:40]!r}")
    return value


def _distinct(path: Path, key: str, names: list) -> None:
    """Raise `SourceError` if an entry of `names` is not a name, or if a name is listed twice."""
    for name in names:
        if not isinstance(name, str):
            raise SourceError(f"{path}: {key}: {str(name)[:40]} is not a name")
        if names.count(name) > 1:
            raise SourceError(f"{path}: {key}: '{name}' is listed twice")


def _parse_json_lines(text: str) -> JsonObject | None:
    """Return the content of a text whose lines are `key: value` with values in JSON; None if it has other lines."""
    content: JsonObject = {}
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        key, colon, value = line.partition(": ")
        if not colon or key in content or not key.isidentifier():  # nested lines, for example, are for PyYAML
            return None
        try:
            content[key] = json.loads(value)
        except (ValueError, RecursionError):
            return None
    return content


def _parse(path: Path) -> object:
    try:
        text = read_text(path, "YAML")
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise SourceError(_not_yaml(path, error)) from error
    content = _parse_json_lines(text)
    if content:  # without the package yaml, which is optional
        return content
    yaml = require("yaml", f"{path}: a closure YAML")
    try:
        # Repeated aliases may expand to data far larger than the file.
        for token in yaml.scan(text, yaml.SafeLoader):
            if isinstance(token, yaml.AliasToken):
                raise SourceError(f"{path}: aliases (*name) are not supported; write the full list instead")
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError, TypeError) as error:
        raise SourceError(_not_yaml(path, error)) from error


def _not_yaml(path: Path, error: Exception) -> str:
    reason = " ".join(str(error).split())
    return f"{path}: the file is not YAML: {reason[:200]}"


def _list(path: Path, data: dict, key: str) -> list:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise SourceError(f"{path}: {key}: expected a list, found {str(value)[:40]!r}")
    return value
