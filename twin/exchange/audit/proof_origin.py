"""Compare what a proof.json was made from with the files: robot, model, version of twin, inputs, motions."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from twin.core.json_types import JsonMapping
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.proof_form import WRITER, is_number, is_same_number

_SHA_FORM = re.compile(r"[0-9a-f]{64}")
"""Form of a sha256, in hexadecimal digits."""

_MADE_BY_FORM = re.compile(r"twin \d+\.\d+\.\d+[\w.+-]*")
"""Form of the name of a version of twin."""

_PROTOCOLS = "trajectories"
"""Folder of a robot's protocols, each a file with the name of its motion."""

_BUDGET_CHECKS = (
    ("any point of a link, between keys", "m", "between_position_m", "budget_position_m"),
    ("rotation of a link, between keys", "rad", "between_rotation_rad", "budget_rotation_rad"),
    ("gap of a joint, between keys", "m", "joint_gap_m", "budget_joint_gap_m"),
)
"""(check, its unit, measured entry of a clip, entry with its limit)."""

_CLIP_NUMBERS = ("rate", "keys", "duration_s", "between_position_m", "between_rotation_rad", "joint_gap_m")
"""Entries that each clip has, with numbers."""


def check_origin(proof: JsonMapping, contents: Sequence[Content], ledger: Ledger) -> None:
    """Compare the robot, the hash of its model and the version of twin with those that the files state."""
    robot = proof["robot"]
    names: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for content in contents:
        if content.stated.get(ROBOT):
            names.setdefault(str(content.stated[ROBOT]), content.file)
        if content.model_hash:
            hashes.setdefault(content.model_hash, content.file)
    if not robot or (names and robot not in names):
        stated_names = []
        for name, file in names.items():
            stated_names.append(f"'{name}' in {file}")
        real = ", ".join(stated_names) or "not stated in a file"
        ledger.wrong("proof.robot", f"proof.json is of the robot '{robot}'; its name is {real}.", "robot")
    stated = proof["model_hash"]
    if not _SHA_FORM.fullmatch(stated.removeprefix("sha256:")):
        # Texts of a changed proof.json are quoted in part only: they may be of any length.
        ledger.wrong("proof.model_hash", f"model_hash '{stated[:80]}' is not a sha256 of 64 digits.", "model_hash")
    elif hashes and stated not in hashes:
        real, file = next(iter(hashes.items()))
        text = f"proof.json is of the model {stated[:23]}…, {file} of {real[:23]}…."
        ledger.wrong("proof.model_hash", text, "model_hash")
    made_by = proof["made_by"]
    if not _MADE_BY_FORM.fullmatch(made_by):
        ledger.wrong("proof.made_by", f"made_by '{made_by[:80]}' is not 'twin' with its version.", "made_by")


def check_inputs(rows: Sequence[JsonMapping], folder: Path, ledger: Ledger) -> None:
    """Report inputs without name or hash; compare the hashes of those that are in the folder, and name the others."""
    names = set()
    absent = []
    for row in rows:
        name = row.get("file")
        sha = row.get("sha256")
        if not isinstance(name, str) or not name or not isinstance(sha, str):
            ledger.wrong("proof.input", "an input in proof.json lacks its name or its sha256.", "inputs")
            continue
        if name in names:
            ledger.wrong("proof.doubled", f"proof.json lists the input '{name}' twice.", "inputs")
        names.add(name)
        digits = sha.removeprefix("sha256:")
        if not _SHA_FORM.fullmatch(digits):
            text = f"the sha256 of the input '{name}' has not 64 hexadecimal digits."
            ledger.wrong("proof.input", text, name)
            continue
        file = _file_in(folder, name)
        if file is None:
            absent.append(name)
        elif hashlib.sha256(file.read_bytes()).hexdigest() != digits:
            ledger.wrong("proof.input", f"the input '{name}' has another sha256 than proof.json states.", name)
    # An export has no inputs beside it. Who has put them there learns which of them are missing.
    if absent and len(absent) < len(rows):
        text = f"{len(absent)} inputs in proof.json were not compared, because they are not in the folder: {absent[0]}"
        if len(absent) > 1:
            text += ", …"
        ledger.add("proof.inputs_absent", "info", f"{text}.", "inputs")


def _file_in(folder: Path, name: str) -> Path | None:
    """Return a file by its path in a folder; None if it does not exist, is outside, or no file can have this name."""
    try:
        file = (folder / name).resolve()
        # A name such as ../../x must not make the audit read files outside of the folder.
        if file.is_relative_to(folder.resolve()) and file.is_file():
            return file
    except (OSError, ValueError):  # too long, or with a character that paths cannot have
        return None
    return None


def check_protocols(inputs: Sequence[JsonMapping], clips: Sequence[JsonMapping], ledger: Ledger) -> None:
    """Report motions whose protocol is not among the inputs, if those of other motions are."""
    protocols = set()
    for row in inputs:
        path = PurePosixPath(str(row.get("file")))
        if path.parent.name == _PROTOCOLS:
            protocols.add(path.name)
    for row in clips:
        file = f"{row.get('protocol')}.toml"
        if protocols and file not in protocols:
            ledger.wrong("proof.input", f"the inputs in proof.json lack the protocol '{file}' of a motion.", file)


def check_clips(rows: Sequence[JsonMapping], contents: Sequence[Content], ledger: Ledger) -> None:
    """Report clips without a track, tracks without a clip, and clips that are listed twice or lack a number."""
    tracks = {}
    for content in contents:
        if content.is_track and content.clips:
            tracks[str(content.extra["data"].get("protocol"))] = content.file
    listed: set[str] = set()
    for row in rows:
        name = str(row.get("protocol"))
        if name in listed:
            ledger.wrong("proof.doubled", f"proof.json lists the clip '{name}' twice.", "clips")
        listed.add(name)
        if tracks and name not in tracks:
            ledger.wrong("proof.clip", f"proof.json lists the clip '{name}', which has no track.", name)
        for key in _CLIP_NUMBERS:
            if not is_number(row.get(key)):
                ledger.wrong("proof.clip", f"clip '{name}' in proof.json has no number '{key}'.", key)
        limits = []
        for _, _, _, limit in _BUDGET_CHECKS:
            if limit in row:
                limits.append(limit)
        if len(limits) not in (0, len(_BUDGET_CHECKS)):
            text = f"clip '{name}' in proof.json has {', '.join(limits)}, but not all limits."
            ledger.wrong("proof.clip", text, "budget")
    for name in sorted(tracks.keys() - listed):
        ledger.wrong("proof.clip", f"proof.json lacks the clip '{name}' of {tracks[name]}.", name)


def check_budgets(proof: JsonMapping, ledger: Ledger) -> None:
    """Compare the errors between keys, and their limits, in the list of clips with those in the list of checks."""
    rows = {}
    for row in proof["checks"]:
        if row.get("tool") == WRITER:
            rows[str(row.get("check")), str(row.get("file"))] = row
    for clip in proof["clips"]:
        for check, unit, measured, limit in _BUDGET_CHECKS:
            name = f"clip {clip.get('protocol')}"
            row = rows.pop((check, name), None)
            if row is None:
                ledger.wrong("proof.check", f"proof.json lacks the check '{check}' of {name}.", name)
                continue
            for entry, key in ((measured, "worst"), (limit, "tolerance")):
                if not is_same_number(clip.get(entry), row.get(key)):
                    text = f"{name}: {entry} is {clip.get(entry)}; the {key} of the check is {row.get(key)}."
                    ledger.wrong("proof.clip", text, entry)
            if row.get("unit") != unit:
                text = f"the check '{check}' of {name} is in '{row.get('unit')}', not in {unit}."
                ledger.wrong("proof.check", text, name)
            if f"twin {row.get('version')}" != proof["made_by"]:
                text = f"the check '{check}' is of version {row.get('version')}; the files are of {proof['made_by']}."
                ledger.wrong("proof.check", text, name)
    for check, name in rows:
        ledger.wrong("proof.check", f"proof.json has the check '{check}' of '{name}', which is no clip's.", "checks")
