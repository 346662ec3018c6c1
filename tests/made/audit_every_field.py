"""A campaign against the audit: every declared field of every file of an export, changed one at a time.

The fields are not listed here: they are what a file contains. Of a JSON document that is every entry of every object,
of a table every header and column, of a binary file every accessor, of a text every number and name, of a script every
constant, sign, index and brace. Of each field one place is drawn, and of each operation on its value one change.

    python tests/made/audit_every_field.py --robots pa10,sils --parts glb,tracks --per 1 --seed 3

counts what the audit found by its cause, what it refused to read, and prints what it missed. A change that does not
alter scene and motion of the robot as `glb_by_pygltflib` reads them is counted apart.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import random
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from made.glb_apart import Glb

Place = tuple[str | int, ...]
"""Keys and indices from the root of a JSON document to a value."""


@dataclass(frozen=True)
class Change:
    """One change of one field.

    Attributes:
        part: which files it belongs to: "glb", "tracks", ...
        field: the field, with [] for any index.
        operation: what is done to the value.
        file: the changed file, relative to the export folder.
        edit: makes the change in a folder; False if the folder has nothing to change.
        says: regular expression of the cause in a finding, see `caused`.
    """

    part: str
    field: str
    operation: str
    file: str
    edit: Callable[[Path], bool | None]
    says: str

    @property
    def name(self) -> str:
        return f"{self.file}: {self.field}: {self.operation}"


def written(path: Path, data: bytes | str) -> None:
    """Replace a file, which may be a hard link to the right one."""
    path.unlink()
    path.write_bytes(data.encode("utf-8") if isinstance(data, str) else data)


# ------------------------------------------------------------------------------------------------- JSON documents


def places(value: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield (place, value) of all values of a document, the document first."""
    yield place, value
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from places(entry, (*place, key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from places(entry, (*place, i))


def pattern(place: Place) -> str:
    """Return a place with [] for its indices."""
    return ".".join("[]" if isinstance(step, int) else step for step in place)


def at(document: Any, place: Place) -> Any:
    for step in place:
        document = document[step]
    return document


def put(document: Any, place: Place, value: Any) -> None:
    at(document, place[:-1])[place[-1]] = value


def _number_changes(value: float, whole: bool) -> Iterator[tuple[str, Any]]:
    if whole:
        yield "plus 1", value + 1
        if value > 0:
            yield "minus 1", value - 1
        return
    yield "small", value * 1.01 if abs(value) > 0.05 else value + 0.0005
    if value:
        yield "sign", -value
        yield "zero", 0.0


def _list_changes(value: list[Any], rng: random.Random) -> Iterator[tuple[str, Any]]:
    yield "last entry gone", value[:-1]
    yield "an entry twice", [*value, copy.deepcopy(value[-1])]
    different = [i for i in range(1, len(value)) if value[i] != value[0]]
    if different:
        i = rng.choice(different)
        swapped = list(value)
        swapped[0], swapped[i] = swapped[i], swapped[0]
        yield "two entries exchanged", swapped
        if value[::-1] != value:
            yield "reversed", value[::-1]


def value_changes(value: Any, rng: random.Random, whole: bool = False) -> Iterator[tuple[str, Any]]:
    """Yield (operation, changed value)."""
    if isinstance(value, bool):
        yield "not", not value
    elif isinstance(value, int | float):
        yield from _number_changes(value, whole or isinstance(value, int))
    elif isinstance(value, str):
        yield "renamed", f"{value}x"
        if value:
            yield "empty", ""
    elif isinstance(value, list) and value:
        yield from _list_changes(value, rng)


def document_changes(document: Any, rng: random.Random, per: int) -> Iterator[tuple[str, str, Callable[[Any], None]]]:
    """Yield (field, operation, edit of the document) for `per` places of each field."""
    by_field: dict[str, list[Place]] = {}
    for place, _ in places(document):
        if place:
            by_field.setdefault(pattern(place), []).append(place)
    for field, found in by_field.items():
        for place in rng.sample(found, min(per, len(found))):
            value = at(document, place)
            whole = isinstance(value, int)
            for operation, new in value_changes(value, rng, whole):
                yield field, operation, _putting(place, new)
            if isinstance(place[-1], str):
                yield field, "gone", _removing(place)


def _putting(place: Place, new: Any) -> Callable[[Any], None]:
    return lambda document: put(document, place, new)


def _removing(place: Place) -> Callable[[Any], None]:
    def edit(document: Any) -> None:
        del at(document, place[:-1])[place[-1]]

    return edit


def json_edit(file: str, change: Callable[[Any], None]) -> Callable[[Path], bool]:
    def edit(folder: Path) -> bool:
        path = folder / file
        document = json.loads(path.read_text("utf-8"))
        change(document)
        written(path, json.dumps(document))
        return True

    return edit


def json_changes(
    part: str, file: str, folder: Path, rng: random.Random, per: int, causes: dict[str, str]
) -> list[Change]:
    document = json.loads((folder / file).read_text("utf-8"))
    changes = []
    for field, operation, change in document_changes(document, rng, per):
        says = cause(field, causes)
        changes.append(Change(part, field, operation, file, json_edit(file, change), says))
    return changes


def cause(field: str, causes: dict[str, str]) -> str:
    """Return the words of the cause of a field: those of `causes`, or the field's own name."""
    for key, words in causes.items():
        if re.fullmatch(key, field):
            return words
    names = [step for step in field.split(".") if step != "[]"]
    return "|".join(re.escape(name) for name in names[-2:])


# ------------------------------------------------------------------------------------------------------------ GLB

GLB_CAUSES = {
    r"asset\.version": "version|glTF",
    r"asset(\..*)?": "asset|hash|units|robot|frame|schema|version|generator",
    r"scene(s.*)?": "scene|reference",
    r"nodes\.\[\]\.name": "name|link|frame|node",
    r"nodes\.\[\]\.(translation|rotation|scale|matrix)(\.\[\])?": "rest|link|frame|joint|quaternion|scale|axis|numbers",
    r"nodes(\.\[\])?": "node|link|frame|parent|reference",
    r"nodes\.\[\]\.children.*": "parent|scene|link|frame|node|ancestor",
    r"nodes\.\[\]\.mesh": "mesh|bounding box|volume|colour|surface|reference",
    r"nodes\.\[\]\.extras.*": "link|mass|joint|frame|whole|mesh",
    r"meshes.*": "mesh|surface|colour|bounding|volume|normal|points|POSITION|triangle|reference|material|node",
    r"materials.*": "material|colour|alpha|reference|metallic|roughness",
    r"accessors.*": "accessor|mesh|link|quaternion|clip|key|time|colour|volume|box|bufferView|normal|frame",
    r"bufferViews.*": "bufferView|buffer|accessor|mesh|byte",
    r"buffers.*": "buffer|byte",
    r"animations\.\[\]\.name": "clip|motion",
    r"animations.*": "clip|link|channel|sampler|interpol|animat|quaternion|key|time|title|rate|between|gap",
}


def glb_edit(file: str, change: Callable[[Glb], bool | None]) -> Callable[[Path], bool]:
    def edit(folder: Path) -> bool:
        data = Glb((folder / file).read_bytes())
        if change(data) is False:
            return False
        written(folder / file, data.bytes())
        return True

    return edit


def roles(glb: Glb) -> Iterator[tuple[str, int]]:
    """Yield (role, accessor) of all accessors that something uses."""
    for mesh in glb.document.get("meshes", []):
        for primitive in mesh["primitives"]:
            for attribute, accessor in primitive["attributes"].items():
                yield f"mesh {attribute}", accessor
            yield "mesh indices", primitive["indices"]
    for animation in glb.document.get("animations", []):
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            yield "key times", sampler["input"]
            yield f"keys of {channel['target']['path']}", sampler["output"]


def _told(glb: Glb, accessor: int) -> None:
    """State the minimum and maximum of an accessor that has them."""
    spec = glb.document["accessors"][accessor]
    if "min" in spec:
        values = glb.numbers(accessor)
        spec["min"] = values.min(axis=0).tolist()
        spec["max"] = values.max(axis=0).tolist()


def _array_edits(role: str, rng: random.Random) -> Iterator[tuple[str, Callable[[np.ndarray], bool | None]]]:
    draw = rng.random

    def row(values: np.ndarray) -> int:
        return int(draw() * len(values))

    def moved(values: np.ndarray) -> None:
        k = row(values)
        size = 5e-4 if "POSITION" in role or "translation" in role else 0.01
        if "POSITION" in role:
            same = np.all(values == values[k], axis=1)
            values[same, int(draw() * 3)] += size
            return
        values[k, -1] += size

    def negated(values: np.ndarray) -> bool | None:
        k = int(np.argmax(np.abs(values).sum(axis=1)))
        values[k] = -values[k]
        return None

    def mirrored(values: np.ndarray) -> None:
        values[:, int(draw() * values.shape[1])] *= -1

    def exchanged(values: np.ndarray) -> bool | None:
        other = np.flatnonzero(np.any(values != values[0], axis=1))
        if not len(other):
            return False
        k = int(other[len(other) // 2])
        values[[0, k]] = values[[k, 0]]
        return None

    def repeated(values: np.ndarray) -> bool | None:
        differ = np.flatnonzero(np.any(values[1:] != values[:-1], axis=1))
        if not len(differ):
            return False
        k = int(differ[len(differ) // 2])
        values[k + 1] = values[k]
        return None

    def scaled(values: np.ndarray) -> None:
        values[:] = values * 1.01

    yield "two rows exchanged", exchanged
    yield "a row repeated", repeated
    if role == "mesh indices":
        yield (
            "a triangle turned",
            lambda values: values.reshape(-1, 3).__setitem__(0, values.reshape(-1, 3)[0, ::-1].copy()),
        )
        yield "all triangles turned", lambda values: values.__setitem__(slice(None), values[::-1].copy())
        return
    yield "a number moved", moved
    yield "a row negated", negated
    yield "all scaled by 1.01", scaled
    if role != "key times":
        yield "a column negated", mirrored


def binary_changes(file: str, folder: Path, rng: random.Random, per: int) -> list[Change]:
    glb = Glb((folder / file).read_bytes())
    by_role: dict[str, list[int]] = {}
    for role, accessor in roles(glb):
        by_role.setdefault(role, []).append(accessor)
    changes = []
    for role, found in by_role.items():
        for accessor in rng.sample(found, min(per, len(found))):
            for operation, change in _array_edits(role, random.Random(rng.random())):
                changes.append(
                    Change("glb", role, operation, file, _array_edit(file, accessor, change), _BINARY[role.split()[0]])
                )
    return changes


_BINARY = {
    "mesh": "mesh|surface|volume|bounding box|normal|colour|closed",
    "key": "time|key|rate|start",
    "keys": "link|quaternion|frame",
}


def _array_edit(file: str, accessor: int, change: Callable[[np.ndarray], bool | None]) -> Callable[[Path], bool]:
    def edit(glb: Glb) -> bool | None:
        if change(glb.numbers(accessor)) is False:
            return False
        _told(glb, accessor)
        return None

    return glb_edit(file, edit)


def glb_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    file = next(path.name for path in folder.glob("*.glb"))
    glb = Glb((folder / file).read_bytes())
    changes = []
    for field, operation, change in document_changes(glb.document, rng, per):
        edit = glb_edit(file, lambda data, change=change: change(data.document))
        changes.append(Change("glb", field, operation, file, edit, cause(field, GLB_CAUSES)))
    return [*changes, *binary_changes(file, folder, rng, per)]


# ---------------------------------------------------------------------------------------------------------- tracks

TRACK_CAUSES = {
    r"schema": "schema|read|cannot be|track",
    r"protocol": "clip|motion|protocol|track",
    r"model_hash": "hash|model",
    r"times.*": "time|key|rate|start|lasts|between",
    r"frames": "frames",
    r"rate": "rate",
    r"links.*": "link|name",
    r"poses.*": "link|quaternion|poses|between|RCM",
    r"positions.*": "joint|positions|link|limit",
    r"joints.*": "joint|name|link|positions",
    r"joint_types.*": "joint|kind|prismatic|revolute",
    r"joint_active.*": "joint_active|driven|passive",
    r"joint_(lower|upper).*": "limit|joint_",
    r"phases.*": "phase",
    r"phase_(start|end).*": "phase",
    r"phase_.*": "RCM|phase|lengths",
    r"tool_.*": "tool|frame",
    r"moved_frame": "moved_frame|frame|RCM",
    r"shaft_axis.*": "shaft|RCM",
    r"frame.*": "frame|lengths|RCM",
    r"rcm.*": "rcm|RCM",
    r"between_.*": "between",
    r"joint_gap": "gap",
    r"assumed.*": "assum",
    r"title": "title",
}


def tracks(folder: Path) -> list[str]:
    return [f"tracks/{path.name}" for path in sorted((folder / "tracks").glob("*.json")) if "schema" not in path.name]


def track_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    return json_changes("tracks", tracks(folder)[0], folder, rng, per, TRACK_CAUSES)


def csv_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    """Return the changes of header, column names and cells of the CSV track."""
    file = tracks(folder)[0].replace(".json", ".csv")
    lines = (folder / file).read_text("utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    head = {}
    for line in lines[:first]:
        key, _, value = line.lstrip("# ").partition(":")
        try:
            head[key.strip()] = json.loads(value)
        except ValueError:
            head[key.strip()] = value.strip()
    changes = []

    def add(field: str, operation: str, says: str, change: Callable[[list[str]], None]) -> None:
        changes.append(Change("csv", field, operation, file, _lines_edit(file, change), says))

    for field, operation, change in document_changes(head, rng, per):
        add(f"# {field}", operation, cause(field, TRACK_CAUSES) + "|in tracks/|column", _head_edit(head, change, first))
    columns = lines[first].split(",")
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(columns):
        groups.setdefault(name.rsplit("_", 1)[-1], []).append(i)
    for group, found in groups.items():
        i = rng.choice(found)
        for operation, new in value_changes(columns[i], rng):
            add(f"column {group}", operation, "column", _cell_edit(first, i, new))
        k = rng.randrange(first + 1, len(lines))
        cell = float(lines[k].split(",")[i])
        for operation, new in value_changes(cell, rng):
            add(
                f"cell {group}",
                operation,
                "link|joint|time|key|quaternion|rate|column|frames|limit",
                _cell_edit(k, i, repr(new)),
            )
    add("rows", "a row twice", "key|time|frames|rate", lambda rows: rows.insert(first + 4, rows[first + 3]))
    add("rows", "a row gone", "key|time|frames|rate", lambda rows: rows.__delitem__(first + 5))
    return changes


def _head_edit(head: dict[str, Any], change: Callable[[Any], None], first: int) -> Callable[[list[str]], None]:
    def edit(lines: list[str]) -> None:
        new = copy.deepcopy(head)
        change(new)
        shown = []
        for key, value in new.items():
            shown.append(f"# {key}: {value if isinstance(value, str) else json.dumps(value)}")
        lines[:first] = shown

    return edit


def _cell_edit(row: int, column: int, new: str) -> Callable[[list[str]], None]:
    def edit(lines: list[str]) -> None:
        cells = lines[row].split(",")
        cells[column] = new
        lines[row] = ",".join(cells)

    return edit


def _lines_edit(file: str, change: Callable[[list[str]], None]) -> Callable[[Path], bool]:
    def edit(folder: Path) -> bool:
        path = folder / file
        old = path.read_text("utf-8")
        lines = old.splitlines()
        change(lines)
        new = "\n".join(lines) + "\n"
        if new == old:
            return False
        written(path, new)
        return True

    return edit


# ------------------------------------------------------------------------------- texts, scripts, and the whole files


def text_edit(file: str, span: tuple[int, int], new: str) -> Callable[[Path], bool]:
    def edit(folder: Path) -> bool:
        path = folder / file
        old = path.read_text("utf-8")
        changed = old[: span[0]] + new + old[span[1] :]
        if changed == old:
            return False
        written(path, changed)
        return True

    return edit


def _text_changes(
    part: str, file: str, text: str, rng: random.Random, kinds: dict[str, str], per: int, says: str
) -> Iterator[Change]:
    """Yield changes of `per` matches of each kind: numbers become other numbers, other matches are left out."""
    for kind, expression in kinds.items():
        matches = list(re.finditer(expression, text))
        for match in rng.sample(matches, min(per, len(matches))):
            whole = match.span()
            found = match[0]
            field = f"{kind} '{text[max(0, whole[0] - 12) : whole[1]].strip()}'".replace("\n", " ")
            if re.fullmatch(r"-?[\d.]+(e-?\d+)?", found):
                yield Change(part, field, "number", file, text_edit(file, whole, _other_number(found)), says)
                yield Change(part, field, "sign", file, text_edit(file, whole, f"-{found}".replace("--", "")), says)
            else:
                yield Change(part, field, "gone", file, text_edit(file, whole, ""), says)


def _other_number(found: str) -> str:
    """Return a number with its last digit changed."""
    i = max(k for k, letter in enumerate(found.split("e")[0]) if letter.isdigit())
    return found[:i] + str((int(found[i]) + 1) % 10) + found[i + 1 :]


SCRIPT = {
    "number": r"(?<![\w.])\d+\.\d+(e-?\d+)?|(?<=[ \[(])\d+(?=[\]),; ])",
    "sign": r"(?<=[ (])-(?=[\w(])",
    "brace": r"[{}]",
    "index": r"\[\d+\]",
    "name": r'"[^"\n]+"',
    "word": r"\b(true|false|readonly|static|return)\b",
    "comparison": r"[<>]=?(?= )",
    "statement": r"\n +\w[^\n{}]*;",
    "comment": r"//[^\n]*",
}


def unity_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    """Return changes of scripts, .meta files, assemblies, package.json and golden vectors."""
    changes: list[Change] = []
    files = sorted(path for path in (folder / "unity").rglob("*") if path.is_file())
    by_suffix: dict[str, list[Path]] = {}
    for path in files:
        suffix = path.suffix if "Robots" not in path.parts else f"Robots {path.suffix}"
        by_suffix.setdefault(suffix, []).append(path)
    for suffix, found in by_suffix.items():
        for path in rng.sample(found, min(per, len(found))):
            file = path.relative_to(folder).as_posix()
            said = re.escape(path.name.removesuffix(".meta"))
            changes.append(Change("unity", f"{suffix} file", "removed", file, _removed(file), said))
            changes.append(Change("unity", f"{suffix} file", "emptied", file, text_edit(file, (0, 10**9), "\n"), said))
            if suffix.endswith((".json", ".asmdef")):
                changes += json_changes("unity", file, folder, rng, 1, {".*": said})
            else:
                text = path.read_text("utf-8")
                kinds = SCRIPT
                if suffix.endswith(".meta"):
                    kinds = {"value": r"(?<=: )[^\n]+", "line": r"\n[^\n]+", "key": r"(?<=\n)\w+(?=:)"}
                count = 6 * per if "Robots" in suffix else per
                changes += _text_changes("unity", file, text, rng, kinds, count, said)
    return changes


def _removed(file: str) -> Callable[[Path], None]:
    return lambda folder: (folder / file).unlink()


def proof_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    return json_changes("proof", "proof.json", folder, rng, per, {".*": "proof|."})


def schema_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    every = json_changes("schema", "tracks/track.schema.json", folder, rng, per, {".*": "schema"})
    return rng.sample(every, min(20 * per, len(every)))


def file_changes(folder: Path, rng: random.Random, per: int) -> list[Change]:
    """Return changes of whole files: emptied, cut off.

    A file that is removed is missed only by proof.json, which the copies do not have.
    """
    changes = []
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        file = path.relative_to(folder).as_posix()
        if file.startswith(("unity/", "meshes/")) or path.suffix in (".xml", ".urdf", ".yaml"):
            continue
        if path.suffix.startswith(".usd") or file in ("proof.json", "README.txt"):
            continue
        said = f"{re.escape(path.stem)}|{re.escape(path.name)}"
        changes.append(Change("files", path.suffix, "emptied", file, lambda f, n=file: written(f / n, b""), said))
        changes.append(Change("files", path.suffix, "cut off", file, _cut(file), said))
    return changes


def _cut(file: str) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        data = (folder / file).read_bytes()
        written(folder / file, data[: int(len(data) * 0.7)])

    return edit


PARTS: dict[str, Callable[[Path, random.Random, int], list[Change]]] = {
    "glb": glb_changes,
    "tracks": track_changes,
    "csv": csv_changes,
    "unity": unity_changes,
    "proof": proof_changes,
    "schema": schema_changes,
    "files": file_changes,
}

HARMLESS: tuple[tuple[str, str, str], ...] = (
    (
        r"glb",
        r"materials\.\[\]\.pbrMetallicRoughness\.(baseColorFactor\.\[\]|.*Factor): small",
        "below the rounding of 8 bits",
    ),
    (r"glb", r"materials\.\[\]\.doubleSided: not", "the inner sides of closed meshes are not seen"),
    (r"glb", r"animations\.\[\]\.extras: gone", "other programs save no extras; the tracks state the same"),
    (r"glb", r"mesh NORMAL: (a number moved|two rows exchanged|a row repeated)", "a shade of one point differs"),
    (r"glb", r"nodes\.\[\]\.extras\.joints: reversed", "the names of a link's joints have no order"),
    (
        r"proof",
        r"(inputs|files|checks|findings|clips): (two entries exchanged|reversed)",
        "the entries have names: their order says nothing",
    ),
    (r"unity", r"\.meta: .*serializedVersion", "the Unity editor changes it when it writes the file again"),
)
"""(part, regular expression of field and operation, why the change does no harm) where no reader can show it."""

WARNED = r"(metallic|roughness)Factor|attributes\.NORMAL: gone|mesh NORMAL: |^proof\.json: files: last entry gone"
"""Fields and operations for which a warning suffices: motion and shape are right, or compared in any case."""


# ------------------------------------------------------------------------------------------------------- judging


def copied(good: Path, target: Path, change: Change) -> bool:
    """Copy an export by hard links and change the copy; return whether it has what is changed.

    A copy has no proof.json, whose hashes show every change, unless the change is of what proof.json states.
    """
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(good, target, copy_function=os.link)
    if change.part != "proof":
        (target / "proof.json").unlink(missing_ok=True)
    return change.edit(target) is not False


def caused(report: Any, change: Change) -> str:
    """Return "found" if a finding names file and cause, "refused" if the file cannot be read, else what was said."""
    other = ""
    last = change.file.rsplit("/", 1)[-1]
    for f in report.findings:
        told = f"{f.code} {f.message} {f.where}"
        if f.severity == "info":
            continue
        if f.severity == "warning" and not re.search(WARNED, change.name):
            other = f"warned {told}"
            continue
        here = f.where.startswith(change.file) or last in told or "One of the two" in f.message
        if change.part == "unity" and f.where.startswith("unity"):
            here = True
        if change.part == "proof" and f.where.startswith("proof.json"):
            here = True
        if not here:
            other = other or f"elsewhere {told}"
            continue
        if f.severity == "error":
            return "refused"
        if re.search(change.says, told, re.IGNORECASE):
            return "found"
        other = f"otherwise {told}"
    return other or "missed"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--good", type=Path, help="folder of exports, by robot; they are written if it does not exist")
    parser.add_argument("--robots", default="pa10,sils,sher,davinci_psm,raven_left")
    parser.add_argument("--parts", default=",".join(PARTS))
    parser.add_argument("--per", type=int, default=1, help="places of each field")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robot", action="store_true", help="compare with the mechanism, too")
    parser.add_argument("--most", type=int, default=10**9, help="changes of a part of a robot, drawn from all")
    parser.add_argument("--only", default="", help="regular expression of the names of changes")
    given = parser.parse_args()
    from made.audit_every_field_run import campaign

    campaign(given)


if __name__ == "__main__":
    main()
