"""Score `twin compare` on the published errors of this folder (docs/kinerrata.md), or write their files.

python tests/kinerrata/score.py                  the table in Markdown; exit code 1 below a required figure
python tests/kinerrata/score.py --json           the same as data, entry by entry
python tests/kinerrata/score.py --write FOLDER   before, after and second of each entry, and index.json
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1]))

from made import errata
from made.errata import Entry, EntryFiles, Table, WrongNumber
from twin.api.comparison import compare
from twin.api.equation_checks import explain
from twin.api.robot_loading import load
from twin.comparison.compared_items import NumberEdit
from twin.comparison.side_pair import SidePair
from twin.core.errors import TwinError
from twin.exchange.read import read

CONFIRMED = ("maintainer", "vendor", "datasheet")
"""Values of `by` of an entry whose error somebody who must know has confirmed."""

WRONG = 60
CONFIRMED_WRONG = 25
RIGHT = 15
"""Required numbers of wrong robots, of those of them that are confirmed, and of false-alarm entries."""

REQUIRED = {"detected": 0.95, "edit": 0.70}
"""Required share of the wrong robots that are detected, and for which the right edit is named."""

TOLERANCE = {"xyz": 1e-5, "a": 1e-5, "d": 1e-5, "mass": 0.0, "centre": 1e-4}
ANGLE = 2e-5
RELATIVE = 1e-3
LIMIT = 1e-4
"""Differences of lengths in m, angles in rad, speeds and the like (relative), and limits, which compare calls equal."""

ROWS = {
    **{"lower": "limits", "upper": "limits", "velocity": "speeds", "effort": "efforts", "mass": "masses"},
    **{"centre": "centres of mass", "inertia": "inertias", "multiplier": "couplings"},
}
"""{key of a number: kind of the property that has it}."""

UNTOLD = ("import.tool",)
"""Codes of warnings that say nothing against a file: it names no tool."""

_WHAT = re.compile(r"(?P<noun>\w+) '(?P<owner>[^']+)'(?P<rest>[^\[]*)(?:\[(?P<component>\d)\])?$")


@dataclass
class Outcome:
    """What was found for one entry.

    Attributes:
        entry, kind, by, accused: of the entry.
        detected: how the wrong robot was detected: "difference", "convention" (two files cannot tell an error from
            another convention), "finding" (in the wrong file alone), "refused" (both cannot be one robot), or "".
        located: whether all joints, links and rows with a wrong number are named.
        edit: "rank 1" if the first edit of a place is the right one for all wrong numbers, "tie" if it stands among
            those that are told as equally good, or "".
        alarms: what is said against the corrected robot, beside itself in another format; None if it is not known.
        accusations: for two right robots: what is said against one of them.
        told: all that is said of the two robots.
        seconds: processor time.
    """

    entry: str
    kind: str
    by: str
    accused: bool
    detected: str = ""
    located: bool = False
    edit: str = ""
    alarms: list[str] | None = None
    accusations: list[str] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    seconds: float = 0.0


def score(entry: Entry, folder: Path) -> Outcome:
    """Return the outcome of an entry; its files are written into a new folder."""
    start = time.process_time()
    outcome = Outcome(entry.name, entry.kind, entry.data["by"], entry.accused)
    if entry.equation:
        _formula(entry, folder, outcome)
        outcome.seconds = round(time.process_time() - start, 2)
        return outcome
    files = errata.write(entry, folder)
    if wrong(entry):
        _detect(entry, files, outcome)
    elif entry.kind == "false alarm":
        _accusations(entry, files, outcome)
    if files.after is not None and files.second is not None:
        outcome.alarms = _alarms(files.after, files.second)
        if outcome.detected == "finding":
            outcome.alarms += [f"{code}: {place}" for code, place in _findings(files.after)]
    outcome.seconds = round(time.process_time() - start, 2)
    return outcome


def wrong(entry: Entry) -> bool:
    """Return whether a robot of the entry is wrong, or may be: what nobody has decided is to be told as well."""
    return entry.kind != "false alarm"


# -- the wrong robot ----------------------------------------------------------------------------------


def _detect(entry: Entry, files: EntryFiles, outcome: Outcome) -> None:
    """Compare the wrong robot with the corrected one, and read it alone."""
    assert files.before is not None
    found = _findings(files.before)
    named: set[str] = set()
    if files.after is not None:
        known = _findings(files.after)
        found = [finding for finding in found if finding not in known]
        try:
            pair = compare(files.before, files.after).pairs[0]
        except TwinError as error:
            outcome.detected = "refused"
            outcome.told.append(str(error))
            named = set(re.findall("'([^']+)'", str(error)))
        else:
            outcome.told += _told(pair)
            named = _named(pair)
            outcome.edit = _edit(entry, files.before.name, pair)
            if pair.differences or _stated(pair) or pair.kinematics == "unexplained":
                outcome.detected = "difference"
            elif pair.items:
                outcome.detected = "convention"
    for code, place in found:
        outcome.told.append(f"{code}: {place}")
        named.add(place)
        outcome.detected = outcome.detected or "finding"
    names = {_plain(name) for name in named}
    owners = _owners(entry)
    outcome.located = bool(owners) and all(names & owner for owner in owners)


def _findings(path: Path) -> list[tuple[str, str]]:
    """Return code and place of each warning of the reader."""
    found = []
    for finding in read(path).findings:
        if finding.severity != "info" and finding.code not in UNTOLD:
            found.append((finding.code, finding.where))
    return found


def _owners(entry: Entry) -> list[set[str]]:
    """Return for each joint, body or row with a wrong number its names; a joint has that of the link it places too."""
    joints = {joint["name"]: joint for joint in entry.data.get("joint", [])}
    owners = [number.owner for number in entry.numbers if _shows(number)]
    owners += [name for name, before in zip(joints, entry.data.get("order_before", ()), strict=False) if name != before]
    if entry.alone:
        owners += [body["name"] for body in entry.data.get("body", [])]
    found = []
    for owner in dict.fromkeys(owners):
        names = {_plain(owner)}
        if owner in joints:
            names.add(_plain(joints[owner]["child"]))
        found.append(names)
    return found


def _shows(number: WrongNumber) -> bool:
    """Return whether a number changes by more than what compare calls equal."""
    change = abs(number.after - number.before)
    if number.key in ("lower", "upper"):
        return change > LIMIT * 1.001
    if number.key in ("velocity", "effort", "mass", "inertia", "multiplier"):
        return change > RELATIVE * max(abs(number.after), abs(number.before))
    return change > TOLERANCE.get(number.key, ANGLE)


def _named(pair: SidePair) -> set[str]:
    """Return the names of joints, links and rows at which something is told."""
    names = set()
    for item in pair.items:
        names |= {item.joint, item.link}
        for edit in item.edits:
            matched = _WHAT.match(edit.what)
            if matched:
                names.add(matched["owner"])
        names |= set(re.findall("'([^']+)'", item.text.split("(")[0]))
    for row in _stated(pair):
        names.add(row.where)
    return names


def _stated(pair: SidePair) -> list:
    if pair.properties is None:
        return []
    return [row for row in pair.properties.rows if row.stated]


def _told(pair: SidePair) -> list[str]:
    told = []
    if pair.kinematics == "unexplained":
        told.append("unexplained")
    for item in pair.items:
        told.append(f"{item.kind}: {item.text}")
    for row in _stated(pair):
        told.append(f"{row.kind} of {row.where}: {row.first}, {row.second}")
    return told


def _plain(name: str) -> str:
    return re.sub("[^a-z0-9]", "", name.lower())


# -- the right edit -----------------------------------------------------------------------------------


def _edit(entry: Entry, side: str, pair: SidePair) -> str:
    """Return "rank 1", "tie" or "": whether the edits of the wrong file give it all right numbers."""
    owners = {}
    for owner in (*entry.data.get("joint", []), *entry.data.get("body", []), *entry.data.get("dh", [])):
        owners[owner["name"]] = owner
    shown = [number for number in entry.numbers if _shows(number)]
    if not shown:
        return ""
    ranks = [_rank(number, owners[number.owner], side, pair) for number in shown]
    if any(rank is None for rank in ranks):
        return ""
    if any(rank for rank in ranks):
        return "tie"
    return "rank 1"


def _rank(number: WrongNumber, owner: Table, side: str, pair: SidePair) -> int | None:
    """Return how many edits of the wrong file stand before the one that gives it the right number; None without it."""
    ranks = []
    for edits in _edit_lists(pair):
        own = [edit for edit in edits if edit.side == side]
        for i, edit in enumerate(own):
            if _rights(edit, number, owner):
                ranks.append(i)
    if number.key in ROWS:
        for row in _stated(pair):
            if row.kind == ROWS[number.key] and _plain(row.where) == _plain(number.owner):
                ranks.append(0)
    return min(ranks, default=None)


def _edit_lists(pair: SidePair) -> Iterator[Sequence[NumberEdit]]:
    for item in pair.items:
        yield item.edits


def _rights(edit: NumberEdit, number: WrongNumber, owner: Table) -> bool:
    """Return whether an edit writes the right value of a number."""
    matched = _WHAT.match(edit.what)
    if matched is None or _plain(matched["owner"]) not in (_plain(number.owner), _plain(owner.get("child", ""))):
        return False
    key = _key(matched["rest"])
    new = [float(word) for word in edit.new.split()]
    if key == "origin" and number.key in ("xyz", "rpy"):
        key = number.key
        new = new[:3] if key == "xyz" else new[3:]
    if key != number.key:
        return False
    if matched["component"] is None and number.component is not None:
        right = np.asarray(owner[number.key], float)
        if number.key == "rpy":
            turn = Rotation.from_euler("xyz", new).inv() * Rotation.from_euler("xyz", right)
            return bool(turn.magnitude() < ANGLE)
        return bool(np.abs(np.asarray(new) - right).max() < TOLERANCE.get(number.key, ANGLE))
    component = matched["component"]
    if component is not None and int(component) != number.component:
        return False
    gap = abs(new[0] - number.after)
    if number.key in ("rpy", "alpha", "theta"):
        gap = abs((new[0] - number.after + np.pi) % (2 * np.pi) - np.pi)
    return gap < TOLERANCE.get(number.key, ANGLE)


def _key(rest: str) -> str:
    """Return the key of an entry's number for the words behind the name in an edit: " origin rpy" is "rpy"."""
    words = rest.split()
    if not words:
        return ""
    if "axis" in words:
        return "axis"
    return {"pos": "xyz", "quat": "rpy", "euler": "rpy"}.get(words[-1], words[-1])


# -- formulas -----------------------------------------------------------------------------------------


def _formula(entry: Entry, folder: Path, outcome: Outcome) -> None:
    """Explain the wrong and the corrected formula: their robot is right."""
    before = explain(load(errata.write_formula(entry, folder / "before", corrected=False)))
    after = explain(load(errata.write_formula(entry, folder / "after", corrected=True)))
    outcome.alarms = [row.text for row in after.rows]
    if after.verdict != "agree":
        outcome.alarms.append(after.verdict)
    outcome.told = [row.text for row in before.rows]
    if before.verdict == "disagree":
        outcome.detected = "difference"
    equation = entry.data["equation"]
    for repair in before.repairs[:1]:
        readings = [reading for cure in repair.cures for reading in cure]
        for i, reading in enumerate(readings):
            for change in reading.changes:
                outcome.told.append(f"{change.before}: {change.after}")
                outcome.located |= change.before == equation["before"]
                if len(reading.changes) == 1 and _same_statement(change.after, equation["after"]):
                    outcome.edit = outcome.edit or ("tie" if i else "rank 1")


def _same_statement(first: str, second: str) -> bool:
    """Return whether two assignments of a formula give one variable the same value, for some values of the others."""
    name, expression = first.split(" = ")
    other_name, other = second.split(" = ")
    if name != other_name:
        return False
    rng = np.random.default_rng(1)
    names = set(re.findall(r"\b[A-Za-z]\w*\b", f"{expression} {other}")) - {"np", "sqrt"}
    for _ in range(8):
        values = {free: float(rng.uniform(-0.9, 0.9)) for free in sorted(names)}
        results = [eval(text, {"np": np}, values) for text in (expression, other)]
        if not abs(results[0] - results[1]) < 1e-9:
            return False
    return True


# -- right robots -------------------------------------------------------------------------------------


def _accusations(entry: Entry, files: EntryFiles, outcome: Outcome) -> None:
    """Collect what is said against one of two right robots.

    A convention is no accusation. A difference is one unless the entry itself names it, as the two robots truly differ
    there, and no side is told to be the wrong one: edits are offered for both or for none.
    """
    assert files.after is not None
    paths = [files.after]
    if files.before is not None:
        paths.insert(0, files.before)
    for path in paths:
        outcome.accusations += [f"{path.name}: {code}: {place}" for code, place in _findings(path)]
    if files.before is None:
        assert files.second is not None
        outcome.accusations += _alarms(files.after, files.second)
        return
    try:
        pair = compare(files.before, files.after).pairs[0]
    except TwinError as error:
        outcome.accusations.append(str(error))
        return
    outcome.told += _told(pair)
    owners: set[str] = set()
    for names in _owners(entry):
        owners |= names
    for item in pair.differences:
        sides = {edit.side for edit in item.edits}
        if _plain(item.joint) not in owners or len(sides) == 1:
            outcome.accusations.append(item.text)
    for row in _stated(pair):
        if _plain(row.where) not in owners:
            outcome.accusations.append(f"{row.kind} of {row.where}: {row.first}, {row.second}")
    if pair.kinematics == "unexplained" and not owners:
        outcome.accusations.append("unexplained")


def _alarms(first: Path, second: Path) -> list[str]:
    """Return what is told of one robot in two formats; names and the order of joints are those of the format."""
    try:
        pair = compare(first, second).pairs[0]
    except TwinError as error:
        return [str(error)]
    alarms = []
    if pair.kinematics == "unexplained":
        alarms.append("unexplained")
    for item in pair.items:
        if item.kind not in ("name", "order"):
            alarms.append(f"{item.kind}: {item.text}")
    for row in _stated(pair):
        alarms.append(f"{row.kind} of {row.where}: {row.first}, {row.second}")
    return alarms


# -- tables -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Totals:
    """Counts of the entries of one kind, or of all.

    Attributes:
        wrong, confirmed: wrong robots, and those of them that maintainer, vendor or datasheet confirm.
        detected, as_convention, located, rank_1, tie: of the wrong robots.
        corrected, alarms: corrected robots, and those against which something is said.
        right, accused: false-alarm entries, and those of which one robot is accused.
    """

    wrong: int
    confirmed: int
    detected: int
    as_convention: int
    located: int
    rank_1: int
    tie: int
    corrected: int
    alarms: int
    right: int
    accused: int


def totals(outcomes: Sequence[Outcome]) -> Totals:
    """Return the counts of some outcomes."""
    wrong_ones = [outcome for outcome in outcomes if outcome.kind != "false alarm"]
    return Totals(
        wrong=len(wrong_ones),
        confirmed=sum(outcome.by in CONFIRMED for outcome in wrong_ones),
        detected=sum(bool(outcome.detected) for outcome in wrong_ones),
        as_convention=sum(outcome.detected == "convention" for outcome in wrong_ones),
        located=sum(outcome.located for outcome in wrong_ones),
        rank_1=sum(outcome.edit == "rank 1" for outcome in wrong_ones),
        tie=sum(outcome.edit == "tie" for outcome in wrong_ones),
        corrected=sum(outcome.alarms is not None for outcome in outcomes),
        alarms=sum(bool(outcome.alarms) for outcome in outcomes),
        right=len(outcomes) - len(wrong_ones),
        accused=sum(bool(outcome.accusations) for outcome in outcomes),
    )


def missed(total: Totals) -> list[str]:
    """Return the required figures that are not reached."""
    texts = []
    if total.wrong < WRONG or total.confirmed < CONFIRMED_WRONG or total.right < RIGHT:
        counts = f"{total.wrong} wrong robots, {total.confirmed} confirmed, {total.right} right ones"
        texts.append(f"{counts}: {WRONG}, {CONFIRMED_WRONG} and {RIGHT} are required")
    if total.detected < REQUIRED["detected"] * total.wrong:
        texts.append(f"{total.detected} of {total.wrong} detected: {REQUIRED['detected']:.0%} are required")
    if total.rank_1 + total.tie < REQUIRED["edit"] * total.wrong:
        texts.append(f"{total.rank_1 + total.tie} of {total.wrong} right edits: {REQUIRED['edit']:.0%} are required")
    if total.alarms:
        texts.append(f"{total.alarms} corrected robots with an alarm: 0 are required")
    if total.accused:
        texts.append(f"{total.accused} right robots accused: 0 are required")
    return texts


def markdown(outcomes: Sequence[Outcome]) -> str:
    """Return the table, kind by kind and in total."""
    heads = ("kind", "wrong", "detected", "as a convention", "located", "edit at rank 1", "or tied")
    lines = ["| " + " | ".join((*heads, "alarms after", "false alarms")) + " |", "|---" + "|---:" * 8 + "|"]
    kinds = sorted({outcome.kind for outcome in outcomes} - {"false alarm"})
    for kind in (*kinds, "false alarm", ""):
        chosen = [outcome for outcome in outcomes if kind in ("", outcome.kind)]
        total = totals(chosen)
        cells: list[object] = [total.wrong, total.detected, total.as_convention, total.located, total.rank_1, total.tie]
        cells += [f"{total.alarms} of {total.corrected}", f"{total.accused} of {total.right}"]
        if kind == "false alarm":
            cells[:6] = ["-"] * 6
        elif kind:
            cells[7] = "-"
        lines.append("| " + " | ".join(str(cell) for cell in (kind or "total", *cells)) + " |")
    return "\n".join(lines)


def score_all(names: Sequence[str] = ()) -> list[Outcome]:
    """Return the outcomes of all entries with files, or of those with these names."""
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for entry in errata.entries():
            if not entry.left_out and (not names or entry.name in names):
                outcomes.append(score(entry, Path(folder) / entry.name))
    return outcomes


def left_out() -> list[dict[str, str]]:
    """Return the entries that are not scored, each with the reason."""
    found = []
    for entry in errata.entries():
        if entry.left_out:
            found.append({"entry": entry.name, "kind": entry.kind, "reason": entry.left_out})
    return found


def write(folder: Path) -> None:
    """Write the files of all entries, each in a folder with its name, and index.json, which lists them.

    `before` has the wrong numbers (of a false alarm: it is the other of two right robots), `after` the right ones,
    `second` is `after` in another format. A file that cannot be written is null.
    """
    index = []
    for entry in errata.entries():
        if entry.left_out or entry.equation:
            continue
        written = errata.write(entry, folder / entry.name)
        files = {}
        for name, path in (("before", written.before), ("after", written.after), ("second", written.second)):
            files[name] = None if path is None else str(path.relative_to(folder))
        index.append(
            {
                "entry": entry.name,
                "kind": entry.kind,
                "accused": entry.accused,
                "by": entry.data["by"],
                "places": entry.data.get("number", []),
                "files": files,
            }
        )
    without = left_out()
    for entry in errata.entries():
        if entry.equation:
            without.append({"entry": entry.name, "kind": entry.kind, "reason": "its error stands in a formula"})
    text = json.dumps({"entries": index, "left_out": without}, indent=1, ensure_ascii=False)
    (folder / "index.json").write_text(text + "\n", encoding="utf-8")


def main() -> int:
    """Run the command; the exit code is 1 if a required figure is not reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("entries", nargs="*", metavar="ENTRY", help="names of entries; all without them")
    parser.add_argument("--json", action="store_true", help="print data, entry by entry")
    parser.add_argument("--write", metavar="FOLDER", type=Path, help="write the files of all entries into a new folder")
    args = parser.parse_args()
    if args.write is not None:
        write(args.write)
        return 0
    outcomes = score_all(args.entries)
    total = totals(outcomes)
    short = [] if args.entries else missed(total)
    if args.json:
        data = {"total": asdict(total), "entries": [asdict(outcome) for outcome in outcomes], "left_out": left_out()}
        print(json.dumps(data, indent=1, ensure_ascii=False))
        return int(bool(short))
    print(markdown(outcomes))
    print(f"\n{total.confirmed} of {total.wrong} errors are confirmed by maintainer, vendor or datasheet.")
    print(f"{len(left_out())} further entries state no robot, or no wrong number.")
    for text in short:
        print(text)
    return int(bool(short))


if __name__ == "__main__":
    sys.exit(main())
