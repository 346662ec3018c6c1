"""Check a Unity package against the import requirements of the Unity editor, without running the editor."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from twin.core.json_types import JsonObject
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.reader_context import Context
from twin.exchange.formats.unity.audit.golden import check_golden
from twin.exchange.formats.unity.audit.kinematics import ROBOTS, read_classes
from twin.exchange.formats.unity.audit.shipped_files import check_shipped, is_shipped

REQUIRED = ("name", "version", "displayName", "unity")
"""Entries of package.json without which Unity does not import a package."""

_GUID = re.compile(r"^guid:\s*([0-9a-f]{32})\s*$", re.MULTILINE)
_NAME = re.compile(r"^[a-z0-9-]+(\.[a-z0-9-]+){2,}$")
_BEHAVIOUR = re.compile(r"class\s+(\w+)\s*:[^{]*\b(?:MonoBehaviour|ScriptableObject)\b")


def check_package(folder: Path, ledger: Ledger) -> Content | None:
    """Report faults that prevent Unity from importing a package: fields, assemblies, .meta files, GUIDs, scripts.

    Return the robot whose kinematics the package contains; None if there is none.
    """
    data = _read_json(folder / "package.json", folder, ledger)
    if data is None:
        return None
    _check_fields(folder, data, ledger)
    assets = list(_imported_assets(folder))
    guids = _check_metas(folder, assets, ledger)
    _check_assemblies(folder, assets, guids, ledger)
    _check_scripts(folder, assets, ledger)
    check_shipped(folder, data, ledger)
    for file in assets:
        if file.name == "twin-golden.json":
            check_golden(file, file.relative_to(folder).as_posix(), ledger)
    content = read_classes(folder, ledger)
    faults = 0
    for finding in ledger.found:
        if finding.severity != "info":
            faults += 1
    ledger.row(f"package: {len(assets)} files, {len(guids)} GUIDs", float(faults), "found", 0.0)
    return content


def _read_json(file: Path, folder: Path, ledger: Ledger) -> JsonObject | None:
    name = file.relative_to(folder).as_posix()
    try:
        # Editors on Windows write a byte order mark, which Unity ignores.
        data = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        ledger.add("unity.json", "error", f"{name} cannot be read: {str(error)[:120]}.", name)
        return None
    if not isinstance(data, dict):
        ledger.add("unity.json", "error", f"{name} is not a JSON object.", name)
        return None
    return data


def _check_fields(folder: Path, data: JsonObject, ledger: Ledger) -> None:
    for key in REQUIRED:
        if not isinstance(data.get(key), str) or not data[key]:
            ledger.wrong("unity.package", f"package.json lacks '{key}'.", "package.json")
    if isinstance(data.get("name"), str) and not _NAME.match(data["name"]):
        text = f"package name '{data['name']}' does not have the form com.company.package."
        ledger.wrong("unity.package", text, "package.json")
    if not re.match(r"^\d+\.\d+\.\d+", str(data.get("version", "0.0.0"))):
        ledger.wrong("unity.package", f"version {data['version']} does not have the form x.y.z.", "package.json")
    if not re.match(r"^\d+\.\d+$", str(data.get("unity", "2022.3"))):
        ledger.wrong("unity.package", f"unity {data['unity']} does not have the form year.release.", "package.json")
    for sample in data.get("samples", []):
        path = sample.get("path", "") if isinstance(sample, dict) else ""
        if not path or not (folder / path).is_dir():
            text = f"sample '{path}' does not exist."
            ledger.wrong("unity.sample", text, "package.json")


def _imported_assets(folder: Path) -> Iterator[Path]:
    """Yield the files and folders that Unity imports. Hidden paths, `*~` and `*.tmp` are skipped."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        # Unity's manual, "Special folder names": these are left out of the import, so that they need no .meta files.
        is_hidden = any(part.endswith("~") or part.startswith(".") for part in parts)
        if not is_hidden and path.suffix != ".tmp":
            yield path


def _check_metas(folder: Path, paths: list[Path], ledger: Ledger) -> dict[str, Path]:
    """Check that every asset has a .meta file with a unique GUID; return {GUID: asset}."""
    assets = {path for path in paths if path.suffix != ".meta"}
    guids: dict[str, Path] = {}
    for asset in sorted(assets):
        name = asset.relative_to(folder).as_posix()
        meta = asset.with_name(asset.name + ".meta")
        if not meta.is_file():
            text = f"'{name}' has no .meta file: Unity ignores such files, because an installed package is read-only."
            ledger.wrong("unity.meta_missing", text, name, suggestion="write a .meta file with a constant GUID")
            continue
        match = _GUID.search(meta.read_text(encoding="utf-8", errors="replace"))
        if match is None:
            text = f"'{name}.meta' has no GUID of 32 hexadecimal digits."
            ledger.wrong("unity.guid", text, f"{name}.meta")
            continue
        first = guids.setdefault(match[1], asset)
        if first != asset:
            first_name = first.relative_to(folder).as_posix()
            text = (
                f"'{name}' and '{first_name}' have the same GUID {match[1]}: Unity "
                "ignores one of them or changes its GUID, which breaks references to it."
            )
            ledger.wrong("unity.guid_twice", text, name, suggestion="use the hash of the path as GUID")
    for meta in paths:
        if meta.suffix == ".meta" and meta.with_suffix("") not in assets:
            name = meta.relative_to(folder).as_posix()
            text = f"'{name}' describes a file or folder that does not exist."
            ledger.add("unity.meta_orphan", "warning", text, name)
    return guids


def _check_assemblies(folder: Path, assets: list[Path], guids: dict[str, Path], ledger: Ledger) -> None:
    names: dict[str, str] = {}
    references: list[tuple[str, str]] = []
    for file in assets:
        if file.suffix != ".asmdef":
            continue
        name = file.relative_to(folder).as_posix()
        data = _read_json(file, folder, ledger)
        if data is None:
            continue
        assembly = data.get("name")
        if not isinstance(assembly, str) or not assembly:
            ledger.wrong("unity.asmdef", f"{name} has no name.", name)
            continue
        if assembly in names:
            text = f"{name} and {names[assembly]} both define the assembly '{assembly}'."
            ledger.wrong("unity.asmdef", text, name)
        names[assembly] = name
        for reference in data.get("references", []):
            references.append((name, str(reference)))
        if "Editor" in file.relative_to(folder).parts and data.get("includePlatforms") != ["Editor"]:
            text = f"{name} is in Editor/, but is not limited to the platform Editor: player builds fail."
            ledger.wrong("unity.asmdef", text, name, suggestion='"includePlatforms": ["Editor"]')
    # References to assemblies of other packages, whose names begin with another word, cannot be checked here.
    package_words = {name.split(".")[0] for name in names}
    for name, reference in references:
        # The editor writes references by name or by the GUID of the .asmdef, as its "Use GUIDs" says.
        if reference.startswith("GUID:"):
            missing = reference.removeprefix("GUID:") not in guids
        else:
            missing = reference not in names and reference.split(".")[0] in package_words
        if missing:
            text = f"{name} references '{reference}', which is not in the package."
            ledger.wrong("unity.asmdef", text, name)


def _check_scripts(folder: Path, assets: list[Path], ledger: Ledger) -> None:
    scripts: list[Path] = []
    assembly_folders: list[Path] = []
    for path in assets:
        if path.suffix == ".cs":
            scripts.append(path)
        elif path.suffix == ".asmdef":
            assembly_folders.append(path.parent)
    if not scripts:
        ledger.wrong("unity.scripts", "the package has no C# file.", "Runtime")
    for script in scripts:
        name = script.relative_to(folder).as_posix()
        text = script.read_text(encoding="utf-8", errors="replace")
        if not any(map(script.is_relative_to, assembly_folders)):
            message = f"{name} belongs to no assembly definition: Unity does not compile such a script of a package."
            ledger.wrong("unity.asmdef", message, name)
        # A component in a comment is none; scripts in #if UNITY_EDITOR may use the editor anywhere.
        code = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)  # without comments
        behaviours = _BEHAVIOUR.findall(code)
        if behaviours and script.stem not in behaviours:
            message = f"{name} contains component {behaviours[0]}: Unity requires that the file has the same name."
            ledger.wrong("unity.script", message, name)
        in_editor = "Editor" in script.relative_to(folder).parts or "#if UNITY_EDITOR" in text
        if not in_editor and "UnityEditor" in code:
            message = f"{name} uses UnityEditor, but is outside Editor/: player builds fail."
            ledger.wrong("unity.script", message, name)


def read(path: Path, ledger: Ledger, context: Context) -> Content | None:
    """Report faults of the package in a folder, and return the robot whose kinematics it contains.

    A package of twin beside tracks of a robot has the class of this robot, unless a README.txt says why it has none.
    """
    ledger.tool = "twin.exchange.audit unity"
    ledger.version = "1"
    content = check_package(path, ledger)
    robots: set[str] = set()
    for track in context.tracks:
        if ROBOT in track.stated:
            robots.add(str(track.stated[ROBOT]))
    has_class = (path / ROBOTS).is_dir() or (path / f"{ROBOTS}.meta").is_file()
    if robots and not has_class and not (path.parent / "README.txt").is_file() and is_shipped(path):
        name = ", ".join(sorted(robots))
        text = (
            f"the package has no class with the kinematics of {name}, and there is no README.txt that says why: the "
            "class of an export may have been lost."
        )
        advice = "export the package again; without the class, the robot moves on the device only by a server"
        ledger.add("unity.no_kinematics", "error", text, ROBOTS, suggestion=advice)
    return content
