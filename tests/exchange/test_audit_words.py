"""What the audit says of a right finding: the thing, in a unit that can be read, and no cause that is none."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from twin.exchange.audit import audit
from twin.exchange.audit.pose_mistakes import mistake_behind
from twin.exchange.audit.poses import about, pose
from twin.exchange.audit.value_text import distinguishable, quantity

HERE = Path(__file__).parents[1]
from made import bundle as base


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return base.write_good(tmp_path_factory.mktemp("good") / "bars")


@pytest.fixture
def tables(good, tmp_path) -> Path:
    """Return a folder with the GLB and the tracks alone."""
    shutil.copytree(good / "tracks", tmp_path / "tracks")
    shutil.copy(good / "bars.glb", tmp_path)
    return tmp_path


def motion(k: int = 400) -> dict[str, np.ndarray]:
    t = np.linspace(0, 1, k)
    return {n: pose(about([0, 0, 1], t + i), np.stack([t, t * i, 0 * t + i], axis=1)) for i, n in enumerate("abc")}


@pytest.mark.parametrize("key", [0, 1, 137, 398, 399])
def test_one_key_of_one_link_is_not_the_whole_robot(key):
    found, meant = motion(), motion()
    found["b"][key, 0, 3] += 1e-3
    assert mistake_behind(found, meant) == "only this link differs, at one key of 400"


def test_a_displacement_of_all_is_the_whole_robot():
    meant = motion()
    assert mistake_behind({n: pose(p=[0.2, 0, 0]) @ T for n, T in meant.items()}, meant).startswith(
        "the whole robot is moved by 200 mm"
    )
    assert mistake_behind(meant, meant) == ""


def drop_row(folder: Path, which: int) -> None:
    file = folder / "tracks/swing.csv"
    lines = file.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("time_s"))
    lines.pop(first + 1 + which)
    file.write_text("\n".join(lines).replace("# frames: 41", "# frames: 40") + "\n")


def test_a_dropped_key_is_called_one(tables):
    drop_row(tables, 20)
    (told,) = [f.message for f in audit(tables).findings if f.code == "compare.times"]
    assert told == "clip 'swing': keys of tracks/swing.json missing in this clip: one key, at 1 s (both last 2 s)."


def test_lengths_that_differ_are_told_with_digits_that_differ(tables):
    file = tables / "tracks/swing.csv"
    text = file.read_text().splitlines()
    text[-1] = text[-1].replace("2,", "2.0004,", 1)
    file.write_text("\n".join(text) + "\n")
    (told,) = [f.message for f in audit(tables).findings if f.code == "compare.times"]
    assert "the clip lasts 2.0004 s; in tracks/swing.json it lasts 2 s" in told
    assert distinguishable(17.07, 17.0700001) == ("17.07", "17.0700001")


@pytest.mark.parametrize(
    ("value", "shown"),
    [(830.4, "830.4 m"), (0.0123, "12.3 mm"), (7.7e-8, "0.077 um"), (0.0, "0 um"), (np.inf, "inf m")],
)
def test_lengths_have_units_that_keep_them_short(value, shown):
    assert quantity(value, "m") == shown


def test_poses_in_millimetres_are_not_told_in_micrometres(tables):
    file = tables / "tracks/swing.json"
    data = json.loads(file.read_text())
    data["poses"] = [1e3 * v if i % 7 < 3 else v for i, v in enumerate(data["poses"])]
    file.write_text(json.dumps(data))
    told = " ".join(f.message for f in audit(tables).findings)
    assert " m and " in told
    assert "e+0" not in told


@pytest.mark.slow
def test_links_of_a_usdz_are_counted_as_those_of_the_others(good):
    links = {f["format"]: f["links"] for f in audit(good).files}
    assert links["usdz"] == links["glb"] == links["tracks"]


@pytest.mark.slow
def test_nodes_of_a_usdz_alone_are_not_called_links(good, capsys):
    from twin.cli import main

    assert main(["audit", str(good / "bars_ar.usdz"), "--quiet"]) == 0
    assert " nodes " in capsys.readouterr().out


@pytest.mark.parametrize("name", ["", " ", "a\nb", "a\tb", " crank", "crank\x00"])
@pytest.mark.parametrize("kind", ["links", "joints"])
def test_names_that_no_program_can_go_by_are_told(name, kind, tables):
    file = tables / "tracks/swing.json"
    data = json.loads(file.read_text())
    data[kind][0] = name
    file.write_text(json.dumps(data))
    told = [f.message for f in audit(file).findings if f.code == "tracks.name"]
    assert told
    assert repr(name) in told[0]
