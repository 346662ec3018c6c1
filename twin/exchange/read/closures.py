"""Read the closure YAML of a URDF: pairs of frames that close loops, driven joints, and replaced joint types.

closed_loop: [[frame_a, frame_b], ...]
type: [6d, ...]              6d: welded; 3d: the origins coincide, as in a ball joint
name_mot: [joint, ...]
joint_name: [joint, ...]     joints of the URDF whose type is replaced, because a URDF joint has only one axis
joint_type: [SPHERICAL, ...] new types of these joints: SPHERICAL (ball), FIXED (fixed at zero), UJOINT_XY (hinges
                             about x, then y, of the joint's frame)
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin.core.errors import SourceError, unknown
from twin.core.extras import require
from twin.core.foreign.text import read_text
from twin.model.joint import JointType

TYPES: dict[str, JointType] = {"6d": "fixed", "3d": "spherical"}
"""Type of the joint that closes a loop, for each value of `type` in the closure YAML."""

_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")

RETYPED = ("SPHERICAL", "FIXED", *(f"UJOINT_{a}{b}" for a in "XYZ" for b in "XYZ" if a != b))
"""Joint types that can replace the type of a URDF joint."""


@dataclass(frozen=True)
class Closures:
    """Content of a closure YAML.

    `loops` contains (frame, frame, type of the joint between the two frames). `motors` contains the names of the driven
    joints. `retyped` maps the names of URDF joints to their new types.
    """

    loops: tuple[tuple[str, str, JointType], ...]
    motors: tuple[str, ...]
    retyped: dict[str, str]


def read_closures(path: Path) -> Closures:
    """Read a closure YAML.

    Raises:
        SourceError: the file is invalid; the message names file, key and expected form.
    """
    data = _data(path)
    if not isinstance(data, dict):
        raise SourceError(f"{path}: expected the keys closed_loop, type and name_mot")
    for key in data:
        if key not in _KEYS:
            raise SourceError(f"{path}: {unknown('key', str(key), _KEYS)}")
    pairs, types, motors = (_list(path, data, k) for k in ("closed_loop", "type", "name_mot"))
    if len(types) != len(pairs):
        text = f"closed_loop has {len(pairs)} pairs, but type has {len(types)} entries; give one type for each pair"
        raise SourceError(f"{path}: {text}")
    loops = []
    for pair, kind in zip(pairs, types, strict=True):
        if not (isinstance(pair, list) and len(pair) == 2 and all(isinstance(p, str) for p in pair)):
            raise SourceError(f"{path}: closed_loop: {str(pair)[:80]} is not a pair of names")
        if pair[0] == pair[1]:
            raise SourceError(f"{path}: closed_loop: '{pair[0]}' is paired with itself")
        if not isinstance(kind, str) or kind.lower() not in TYPES:
            raise SourceError(f"{path}: type: {unknown('closure type', str(kind)[:40], TYPES)}")
        loops.append((pair[0], pair[1], TYPES[kind.lower()]))
    _distinct(path, "name_mot", motors)
    if not motors:
        raise SourceError(f"{path}: name_mot is empty; name at least one driven joint")
    names, kinds = (_list(path, data, k) for k in ("joint_name", "joint_type"))
    _distinct(path, "joint_name", names)
    if len(kinds) != len(names):
        raise SourceError(
            f"{path}: joint_name has {len(names)} names, but joint_type has {len(kinds)} entries; give one type for "
            "each name"
        )
    for kind in kinds:
        if not isinstance(kind, str) or kind.upper() not in RETYPED:
            raise SourceError(f"{path}: joint_type: {unknown('joint type', str(kind)[:40], RETYPED)}")
    retyped = {n: k.upper() for n, k in zip(names, kinds, strict=True)}
    return Closures(tuple(loops), tuple(motors), retyped)


def _distinct(path: Path, key: str, names: list) -> None:
    """Raise `SourceError` if an entry of `names` is not a name, or if a name is listed twice."""
    for name in names:
        if not isinstance(name, str):
            raise SourceError(f"{path}: {key}: {str(name)[:40]} is not a name")
        if names.count(name) > 1:
            raise SourceError(f"{path}: {key}: '{name}' is listed twice")


def _data(path: Path) -> Any:
    yaml = require("yaml", f"{path}: a closure YAML")
    try:
        text = read_text(path, "YAML")
        # Repeated aliases may expand to data far larger than the file.
        if any(isinstance(t, yaml.AliasToken) for t in yaml.scan(text, yaml.SafeLoader)):
            raise SourceError(f"{path}: aliases (*name) are not supported; write the full list instead")
        return yaml.safe_load(text)
    except OSError as error:
        raise SourceError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError, TypeError) as error:
        raise SourceError(f"{path}: the file is not YAML: {' '.join(str(error).split())[:200]}") from error


def _list(path: Path, data: dict, key: str) -> list:
    value = data.get(key, [])
    if not isinstance(value, list):
        raise SourceError(f"{path}: {key}: expected a list, found {str(value)[:40]!r}")
    return value
