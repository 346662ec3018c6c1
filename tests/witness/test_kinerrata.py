"""Validators of single files read the wrong and the corrected robots of tests/kinerrata (docs/kinerrata.md).

They do not claim to compare two files. What counts as detected is a finding on the wrong file that the corrected file
does not have; findings on both, such as shapes and masses that the entries do not state, count as nothing.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

pytestmark = pytest.mark.witness

from made import errata

DETECTED = {
    "simcheck": {
        *("bullet_mini_cheetah_inertia", "digit_elbow_inertia", "icub03_right_leg_inertia", "realman_rx75_inertia"),
    },
    "truerig": {
        *("bullet_mini_cheetah_inertia", "digit_elbow_inertia", "icub03_right_leg_inertia", "realman_rx75_inertia"),
    },
    "nvidia": {"digit_elbow_inertia", "icub03_right_leg_inertia"},
    "urdfvalidator": {"digit_elbow_inertia", "icub03_right_leg_inertia", "toolbox_irb140_mass_centre"},
}
"""Entries that each validator detects: inertias that no body can have, and a torque above the limit of its joint."""


@pytest.fixture(scope="module")
def pairs(tmp_path_factory) -> dict[str, tuple[errata.Entry, str, str]]:
    """Return {entry: (entry, wrong file, corrected file)} of all entries with two files of robots, false alarms too."""
    folder = tmp_path_factory.mktemp("kinerrata")
    out = {}
    for entry in errata.entries():
        if entry.left_out:
            continue
        files = errata.write(entry, folder / entry.name)
        stated = [p for p in (files.before, files.after) if p is not None and p.suffix in (".urdf", ".xml")]
        if len(stated) == 2:
            out[entry.name] = (entry, str(stated[0]), str(stated[1]))
    assert len(out) >= 100
    return out


def only_in(told: dict[str, Any], first: str, second: str) -> list[str]:
    """Return the elements with findings in the first file that the second file does not have, by element and check."""
    there = {(element, check) for element, check, _ in told[second]}
    return [element for element, check, _ in told[first] if (element, check) not in there]


def located_at(elements: list[str], entry: errata.Entry) -> bool:
    """Return whether one of the elements is named in the place of a wrong number."""
    for number in entry.data.get("number", []):
        words = number["place"].split()
        if any(element in words for element in elements):
            return True
    return False


@pytest.mark.parametrize("program", ["simcheck", "truerig", "urdfvalidator"])
def test_validators_of_single_files_see_what_no_robot_can_be(program, pairs, foreign, figures, tmp_path):
    (tmp_path / "list.json").write_text(json.dumps(files_of(pairs)))
    told = foreign.read(program, f"judge_{program}.py", tmp_path / "list.json")
    judge(program, told, pairs, figures)


@pytest.mark.nightly
@pytest.mark.witness("usdconv", "nvidia")
def test_the_validator_of_stages_sees_what_no_robot_can_be(pairs, foreign, figures, tmp_path):
    """NVIDIA's converter makes the stages that NVIDIA's validator reads."""
    urdfs = [path for path in files_of(pairs) if path.endswith(".urdf")]
    (tmp_path / "list.json").write_text(json.dumps(urdfs))
    stages = foreign.read("usdconv", "convert_urdfs.py", tmp_path / "list.json", tmp_path / "stages")
    assert None not in stages.values()
    issues = foreign.read("nvidia", "check_nvidia.py", *stages.values())
    told = {"version": issues["version"]}
    for path, stage in stages.items():
        said = []
        for issue in issues[stage]:
            prim = issue["at"].rstrip(")").rpartition("/")[2]
            said.append([prim, issue["rule"], issue["message"]])
        told[path] = said
    judge("nvidia", told, pairs, figures)


def files_of(pairs) -> list[str]:
    """Return the wrong and the corrected file of all pairs."""
    listed = []
    for _, before, after in pairs.values():
        listed += [before, after]
    return listed


def judge(program: str, told: dict[str, Any], pairs, figures) -> None:
    """Count what a validator told, and compare it with what it is known to detect."""
    detected = set()
    located = set()
    alarms = set()
    wrong = 0
    for name, (entry, before, after) in pairs.items():
        if before not in told:  # the program does not read this format
            continue
        wrong += entry.accused
        elements = only_in(told, before, after)
        if entry.accused and elements:
            detected.add(name)
            if located_at(elements, entry):
                located.add(name)
        if only_in(told, after, before) or (elements and not entry.accused):
            alarms.add(name)
    said = f"{len(detected)} detected, {len(located)} located, {len(alarms)} alarms, of {wrong} wrong"
    figures.add(told["version"], "KinErrata", "URDF, MJCF", float("nan"), float("nan"), said)
    assert detected >= DETECTED[program]
    assert not alarms
    assert {pairs[name][0].kind for name in detected} <= {"inertia", "digits swapped", "mirrored", "units"}
