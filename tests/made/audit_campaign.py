"""Audit every change of a campaign in a process of its own, forked from one that has read all other files.

    PYTHONPATH=tests python -m made.audit_campaign FOLDER ROBOT --format urdf --each 1 --seed 1

FOLDER is an export with proof.json; ROBOT the robot's name or folder. Each line of the output is the class of one
change: found, elsewhere (a finding, but none that names the cause), refused, none (no effect), missed.
"""

from __future__ import annotations

import os

os.environ.setdefault("PXR_WORK_THREAD_LIMIT", "1")  # a forked process has no threads of its parent

import argparse
import json
import re
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

import twin
from made import audit_added, audit_effects, audit_fields, bundle, mechanisms
from made import audit_fields_usd as fields_usd
from made.audit_fields import FieldChange
from twin.core.findings import Finding
from twin.exchange import audit as auditing
from twin.exchange.audit.folder_files import find_files
from twin.exchange.xacro import XacroSettings

SINGLE = r"twin:(maxAcceleration|maxJerk|softLimits|tool|base)|twin/postures"
"""Kinds of values that one file of an export alone states: without the mechanism there is nothing to compare with."""

FOUND = ("found", "refused", "none", "single")
"""Classes of changes that are no miss."""

WORDS = {
    "rgba": ("colour",),
    "material": ("colour",),
    "scale": ("mesh", "shape"),
    "mesh": ("shape",),
    "file": ("mesh",),
    "filename": ("mesh",),
    "angle": ("limit", "range", "ctrlrange"),
    "compiler": ("limit", "range", "ctrlrange", "keyframe"),
    "ctrlrange": ("control",),
    "displayColor": ("colour",),
    "diffuseColor": ("colour", "displayColor"),
    "defaultPrim": ("default prim",),
    "startTimeCode": ("time code",),
    "endTimeCode": ("time code",),
    "timeCodesPerSecond": ("time code",),
    "metersPerUnit": ("unit", "larger", "smaller"),
    "points": ("mesh", "bounding box", "surface"),
    "subLayers": ("layer",),
    "site": ("frame", "point"),
    "equality": ("joint", "coupling"),
    "key": ("keyframe",),
    "twin:kind": ("frame", "point"),
    "materials": ("material",),
    "geom": ("collision", "shape", "bounding box"),
    "density": ("medium",),
    "viscosity": ("medium",),
    "dyntype": ("delayed",),
    "settotalmass": ("mass",),
    "boundmass": ("mass",),
    "gravity": ("weight", "hold"),
    "actuation": ("driven",),
    "boundinertia": ("inertia",),
    "root_joint": ("fixed to the world",),
    "physics:excludeFromArticulation": ("articulation",),
    "PhysicsScene": ("scene",),
}
"""Words of findings for names of fields."""

GRAVE = ("warning", "disagreement", "error")


@dataclass(frozen=True)
class Outcome:
    """What the audit said of one change, with (`mechanism`) or without the robot."""

    file: str
    kind: str
    place: str
    mechanism: bool
    verdict: str
    effect: str
    told: list[str]


def slim(source: Path, folder: Path, *, stages: Iterable[str]) -> None:
    """Copy an export without proof, README, GLB, USDZ and Unity, and of its stages only some, to save time."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(source, folder)
    for path in [*folder.glob("*.usdz"), *folder.glob("*.glb"), folder / "proof.json", folder / "README.txt"]:
        path.unlink(missing_ok=True)
    shutil.rmtree(folder / "unity", ignore_errors=True)
    kept = {"physics.usda", "geometry.usdc", *stages}
    for file in list((folder / "usd").rglob("*")):
        if file.is_file() and file.name not in kept:
            file.unlink()


def forked(work: Callable[[], Any]) -> Any:
    """Return what a function returns in a forked process, as JSON; a text if that ends in another way."""
    own, other = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(own)
        try:
            text = json.dumps(work())
        except BaseException:
            text = json.dumps({"error": traceback.format_exc()[-1500:]})
        with os.fdopen(other, "w") as stream:
            stream.write(text)
        os._exit(0)
    os.close(other)
    with os.fdopen(own) as stream:
        text = stream.read()
    _, status = os.waitpid(pid, 0)
    return json.loads(text) if text else {"error": f"the process ended with {status}"}


Arguments = Callable[[Path], dict[str, Any]]


def of_robot(name: str) -> Arguments:
    """Return what makes the arguments of an audit with the mechanism of a robot, by its name or folder."""

    def make(folder: Path) -> dict[str, Any]:
        make = import_module("twin.api.export_audit")
        robot = twin.load(name)
        expected = robot.weighed().mechanism
        states = make._states(expected)
        truth = make._truth(robot, folder, make.silent, None)
        return {"truth": truth, "mechanism": expected, "states": lambda: states}

    return make


def of_bars(folder: Path) -> dict[str, Any]:
    """Return the arguments of an audit with the mechanism of the small robot of `made.bundle`."""
    clip = bundle.swing()
    return {"truth": {clip.name: (clip.times, clip.links)}, "mechanism": mechanisms.four_bar()}


class Campaign:
    """Audits of changed copies of one export, in which only the changed files are read again."""

    def __init__(self, folder: Path, arguments: Arguments, touched: Callable[[str], bool]) -> None:
        """Read all files of a slim export that no change touches.

        Args:
            folder: the export, which is edited and restored.
            arguments: makes the arguments of an audit with the mechanism, for a folder.
            touched: whether a file, by its path in the folder, depends on those that are changed.
        """
        self.folder = folder
        self.touched = touched
        self.read: dict[str, tuple[Any, Any]] = {}
        self._patch()
        self.arguments = arguments(folder)
        # Comparisons add to what is read, so this process only reads.
        list(auditing._read(find_files(folder), auditing._silent, None, XacroSettings()))
        self.before: dict[bool, set[str]] = {}
        for mechanism in (False, True):
            keys = forked(lambda m=mechanism: [_key(f) for f in self._findings(m)])
            assert isinstance(keys, list), keys
            self.before[mechanism] = set(keys)

    def _patch(self) -> None:
        filled = auditing._filled
        guarded = auditing.guarded

        def read_once(work, path, ledger):
            name = ledger.file
            if name in self.read:
                content, first = self.read[name]
                ledger.__dict__.update(first.__dict__)
                if content is not None:
                    content.ledger = ledger
                return content
            content = guarded(work, path, ledger)
            if work.func is filled and not self.touched(name):
                self.read[name] = content, ledger
            return content

        auditing.guarded = read_once
        auditing.admit_together = lambda files: list(files)
        for module in list(sys.modules.values()):
            if hasattr(module, "admit") and module.__name__.startswith("twin.exchange.formats"):
                setattr(module, "admit", lambda path: None)  # noqa: B010 - modules have no such attribute for checkers

    def _findings(self, mechanism: bool) -> list[Finding]:
        """Return the findings of an audit in this process: the files read for it are kept."""
        return list(auditing.audit(self.folder, **(self.arguments if mechanism else {})).findings)

    def told(self, mechanism: bool) -> list[list[str]]:
        """Return (severity, place, text) of the new findings of an audit in a forked process."""

        def work() -> list[list[str]]:
            found = [f for f in self._findings(mechanism) if _key(f) not in self.before[mechanism]]
            return [[f.severity, f.where, f"{f.code} {f.message}"] for f in found if f.severity in GRAVE]

        return forked(work)


def _key(f: Finding) -> str:
    return f"{f.code} {f.where} {f.message}"


def classified(change: FieldChange, told: Any, effect: str, mechanism: bool) -> tuple[str, list[str]]:
    """Return the class of a change, and what the audit told."""
    if isinstance(told, dict):
        return "crash", [told["error"]]
    texts = [f"{severity} {where}: {text}" for severity, where, text in told]
    stem = change.file.rpartition("/")[2]
    layer = stem in LAYERS or stem.endswith(".usdc")  # findings name the stages that it is in
    own = [t for t in texts if stem in t or (layer and ".usd" in t)]
    words = {*change.subjects}
    for subject in change.subjects:
        words.update(WORDS.get(subject, ()))
    if any(re.search(rf"(?<!\w){re.escape(word)}(e?s)?(?!\w)", t, re.I) for t in own for word in words):
        return "found", texts
    if texts and effect.startswith("refused"):
        return "refused", texts
    if own:
        return "elsewhere", texts
    if effect == "none":
        return "none", texts
    if not mechanism and re.search(SINGLE, change.kind):
        return "single", texts
    return "missed", texts


def read_again(file: str) -> tuple[list[str], Callable[[str], bool]]:
    """Return (stages that are audited, whether a file depends on a changed file) for a path in an export."""
    if not file.startswith("usd/"):
        return [], lambda name: name == file
    return [Path(file).name], lambda name: name.startswith("usd/")


def run(source: Path, arguments: Arguments, file: str, changes: Iterable[FieldChange], out: TextIO) -> Counter:
    """Run the changes of one file of an export; write each outcome as a line of JSON, and return their counts."""
    counts: Counter = Counter()
    name = next(source.glob("*.urdf")).stem
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / source.name
        stages, touched = read_again(file)
        if "motion" in file:
            stages = [f"{name}_{Path(file).stem}.usda", *stages]
        # A stage <robot>_<clip> needs the layer of its motion.
        stages += [f"{Path(stage).stem.removeprefix(f'{name}_')}.usdc" for stage in stages]
        slim(source, folder, stages=[f"{name}.usda", *stages])
        campaign = Campaign(folder, arguments, touched)
        seen = folder / file
        if file.startswith("usd/"):
            seen = folder / "usd" / next(s for s in (*stages, f"{name}.usda") if s not in LAYERS and s.endswith("a"))
        reader = audit_effects.READERS[seen.suffix]
        before = reader(seen)
        kept = (folder / file).read_bytes()
        settled: set[str] = set()
        for change in changes:
            try:
                change.edit(folder)
            except Exception as error:
                print("not edited:", change.kind, error, file=sys.stderr)
                (folder / file).write_bytes(kept)
                continue
            effect = forked(lambda change=change: audit_effects.effect(before, seen, change.kind, change.place))
            effect = effect if isinstance(effect, str) else "refused (crash)"
            field, tried, _ = change.kind.partition(" added: ")
            if tried and "/" not in change.kind.partition("@")[2] and "<" not in change.kind:
                # Values of many forms are tried: the first with an effect is audited.
                if field in settled or effect == "none" or effect.startswith("refused"):
                    (folder / file).write_bytes(kept)
                    continue
                settled.add(field)
            for mechanism in (False, True):
                verdict, texts = classified(change, campaign.told(mechanism), effect, mechanism)
                counts[verdict, mechanism] += 1
                outcome = Outcome(file, change.kind, change.place, mechanism, verdict, effect, texts[:4])
                print(json.dumps(asdict(outcome)), file=out, flush=True)
            (folder / file).unlink()
            (folder / file).write_bytes(kept)
    return counts


LAYERS = ("physics.usda", "geometry.usdc")
"""Layers that are no stages by themselves."""


def listed_added(folder: Path, format: str) -> dict[str, list[FieldChange]]:
    """Return {file: changes} of what is added to an export: to its stage, the strongest layer has it."""
    name = next(folder.glob("*.urdf")).stem
    file = {"urdf": f"{name}.urdf", "mjcf": f"{name}.xml", "usd": f"usd/{name}.usda"}[format]
    return {file: list(audit_added.added_changes(folder, file))}


def listed(folder: Path, format: str, undeclared: bool) -> dict[str, list[FieldChange]]:
    """Return {file: changes} of an export."""
    if format in ("urdf", "mjcf"):
        file = next(folder.glob("*.urdf" if format == "urdf" else "*.xml")).name
        if not undeclared:
            return {file: list(audit_fields.declared_changes(folder, file))}
        known = audit_fields.known_fields(format)
        changes = audit_fields.undeclared_changes(folder, file, known)
        return {file: [*changes, *audit_fields.wrapped_changes(folder, file, format)]}
    name = next(folder.glob("*.urdf")).stem
    if undeclared:
        return {"usd/physics.usda": list(fields_usd.undeclared_changes(folder, f"usd/{name}.usda", "usd/physics.usda"))}
    files = [*folder.glob("usd/*.usda"), folder / "usd/geometry.usdc", *folder.glob("usd/motion/*")]
    paths = [str(file.relative_to(folder)) for file in files]
    return {path: list(fields_usd.declared_changes(folder, path)) for path in paths}


def missed_kinds(out: Path) -> set[str]:
    """Return the kinds of an earlier output that were missed, or found by another cause."""
    outcomes = [json.loads(line) for line in out.read_text().splitlines()]
    return {outcome["kind"] for outcome in outcomes if outcome["verdict"] not in FOUND}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("robot")
    parser.add_argument("--format", choices=("urdf", "mjcf", "usd"), required=True)
    parser.add_argument("--each", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default="")
    parser.add_argument("--part", default="0/1", help="which of how many parts of the changes")
    parser.add_argument("--again", type=Path, help="only the kinds that an earlier output names as missed or elsewhere")
    parser.add_argument("--undeclared", action="store_true", help="attributes that the files do not state")
    parser.add_argument("--added", action="store_true", help="elements and prims that the files have not")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    counts: Counter = Counter()
    part, parts = map(int, given.part.split("/"))
    arguments = of_bars if given.robot == "bars" else of_robot(given.robot)
    again = None if given.again is None else missed_kinds(given.again)
    with given.out.open("a") as out:
        every = listed(given.folder, given.format, given.undeclared)
        if given.added:
            every = listed_added(given.folder, given.format)
        for file, changes in every.items():
            drawn = audit_fields.drawn(changes, given.each, given.seed)
            chosen = [c for c in drawn if re.search(given.kinds, c.kind) and (again is None or c.kind in again)]
            chosen = chosen[part::parts]
            if chosen:
                counts += run(given.folder, arguments, file, chosen, out)
    for (verdict, mechanism), count in sorted(counts.items()):
        print(f"{verdict:10} {'with' if mechanism else 'without'} --robot: {count}")


if __name__ == "__main__":
    main()
