"""The score of compare on the published errors: some entries by default, all of them in the nightly lane."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from made import errata
from twin.comparison.compared_items import NumberEdit

SCRIPT = errata.FOLDER / "score.py"


def _script() -> ModuleType:
    """Return tests/kinerrata/score.py as a module."""
    spec = importlib.util.spec_from_file_location("kinerrata_score", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


score = _script()


@pytest.mark.parametrize(
    ("name", "detected"),
    [
        ("talos_camera", "convention"),
        ("toolbox_ur5_d1", "convention"),
        ("ergocub_wrist_ratio", "difference"),
        ("unitree_h2_effort", "difference"),
    ],
)
def test_a_published_error_is_detected_located_and_its_edit_is_named(name: str, detected: str, tmp_path: Path) -> None:
    outcome = score.score(errata.entry(name), tmp_path / name)
    assert outcome.detected == detected
    assert outcome.located
    assert outcome.edit == "rank 1"
    assert outcome.alarms == []


@pytest.mark.parametrize("name", ["realman_rx75_inertia"])
def test_an_impossible_inertia_is_found_in_the_wrong_file_alone(name: str, tmp_path: Path) -> None:
    outcome = score.score(errata.entry(name), tmp_path / name)
    assert outcome.detected == "finding"
    assert outcome.located
    assert outcome.alarms == []


@pytest.mark.parametrize("name", ["ur30_noise", "panda_link1_link2", "ur10e_dh_and_urdf"])
def test_no_right_robot_is_accused(name: str, tmp_path: Path) -> None:
    outcome = score.score(errata.entry(name), tmp_path / name)
    assert outcome.accusations == []
    assert outcome.alarms == []


def test_a_published_wrong_equation_is_explained(tmp_path: Path) -> None:
    entry = errata.entry("marlin_scara_sine")
    outcome = score.score(entry, tmp_path / entry.name)
    assert outcome.detected == "difference"
    assert outcome.located
    assert outcome.edit == "rank 1"
    assert outcome.alarms == []
    assert not score._same_statement("S2 = np.sqrt(1 + C2**2)", entry.data["equation"]["after"])


@pytest.mark.nightly
def test_the_score_reaches_what_is_required() -> None:
    outcomes = score.score_all()
    assert score.missed(score.totals(outcomes)) == []


def test_a_missed_error_an_alarm_and_an_accusation_are_counted() -> None:
    found = score.Outcome("a", "length", "vendor", True, "difference", True, "rank 1", [])
    right = score.Outcome("b", "false alarm", "vendor", False, alarms=[])
    many = [replace(found) for _ in range(60)]
    many += [replace(right) for _ in range(15)]
    assert score.missed(score.totals(many)) == []
    assert [text[:31] for text in score.missed(score.totals(many[1:]))] == ["59 wrong robots, 59 confirmed, "]
    undetected = [replace(found, detected="", edit="") for _ in range(20)]
    texts = score.missed(score.totals([*many[20:], *undetected]))
    assert [text.split(":")[0] for text in texts] == ["40 of 60 detected", "40 of 60 right edits"]
    spoken = [replace(found, alarms=["zero: moved"]), replace(right, accusations=["mass of link"])]
    texts = score.missed(score.totals([*many, *spoken]))
    assert [text.split(":")[0] for text in texts] == ["1 corrected robots with an alarm", "1 right robots accused"]


@pytest.mark.parametrize(
    ("what", "new", "right"),
    [
        ("joint 'joint_5' origin xyz[0]", "1.2305", True),
        ("joint 'joint_5' origin xyz", "1.2305 0 0", True),
        ("joint 'joint_5' origin", "1.2305 0 0 0 0 0", True),
        ("joint 'joint_5' origin xyz[0]", "1.231", False),
        ("joint 'joint_5' origin xyz[1]", "1.2305", False),
        ("joint 'joint_5' axis xyz[0]", "1.2305", False),
        ("joint 'joint_4' origin xyz[0]", "1.2305", False),
    ],
)
def test_only_the_right_value_at_the_right_place_is_the_right_edit(what: str, new: str, right: bool) -> None:
    entry = errata.entry("abb_irb4600_link5")
    joints = {joint["name"]: joint for joint in entry.data["joint"]}
    edit = NumberEdit("before.urdf", "before.urdf", 1, what, "1.235", new)
    assert score._rights(edit, entry.numbers[0], joints["joint_5"]) is right


def test_the_files_of_all_entries_are_listed(tmp_path: Path) -> None:
    folder = tmp_path / "files"
    score.write(folder)
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    listed = [entry["entry"] for entry in (*index["entries"], *index["left_out"])]
    assert sorted(listed) == [entry.name for entry in errata.entries()]
    assert len(index["entries"]) >= 120
    for entry in index["left_out"]:
        assert entry["reason"]
    for entry in index["entries"]:
        wrong = entry["kind"] != "false alarm"
        assert entry["files"]["before"] or not wrong
        texts = _texts(folder, list(entry["files"].values()))
        assert len(set(texts)) == len(texts)


def _texts(folder: Path, names: Sequence[str | None]) -> list[str]:
    texts = []
    for name in names:
        if name is not None:
            texts.append((folder / name).read_text(encoding="utf-8"))
    return texts
