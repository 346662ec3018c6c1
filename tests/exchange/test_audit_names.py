"""Clips are compared by their names, and tracks are recognised by what they say, not by where they say it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from made import mechanisms as made
from made.bundle import grave, swing
from twin.exchange.audit import audit


def other():
    """Return a clip as long as the swing, between other poses."""
    clip = swing()

    quarter = {n: T[np.minimum(np.arange(41) + 10, 40)].copy() for n, T in clip.links.items()}
    joints = {n: q[np.minimum(np.arange(41) + 10, 40)].copy() for n, q in clip.joints.items()}
    return replace(clip, name="reach", links=quarter, joints=joints)


@pytest.fixture(scope="module")
def two(tmp_path_factory) -> Path:
    """Return a folder with two motions of the four-bar linkage in tracks, GLB, USD and USDZ."""
    from twin.exchange.formats.glb.write import glb_bytes
    from twin.exchange.formats.tracks.write import write_tracks
    from twin.exchange.formats.usd.write import write_usd
    from twin.exchange.formats.usdz.write import write_usdz

    robot, clips = made.four_bar(), [swing(), other()]
    folder = tmp_path_factory.mktemp("two") / "bars"
    folder.mkdir()
    for clip in clips:
        write_tracks(robot, clip, folder / "tracks")
    (folder / "bars.glb").write_bytes(glb_bytes(robot, clips, {n: T[0] for n, T in clips[0].links.items()}))
    write_usd(robot, clips, folder / "usd")
    write_usdz(robot, clips[0], folder / "bars_ar.usdz")
    return folder


def faults(folder: Path) -> list[tuple[str, str]]:
    return [
        (f.code, f.where.partition(":")[0]) for f in audit(folder).findings if f.severity in ("disagreement", "error")
    ]


@pytest.mark.parametrize("name", ["swing", "reach"])
def test_a_duplicated_time_in_a_track_accuses_only_this_track(name, two, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(two, folder)
    before = set(faults(folder))
    file = folder / f"tracks/{name}.json"
    track = json.loads(file.read_text())
    track["times"][7] = track["times"][6]
    file.write_text(json.dumps(track))
    told = [f for f in faults(folder) if f not in before]
    assert ("tracks.times", f"tracks/{name}.json") in told
    assert {where for _, where in told} == {f"tracks/{name}.json"}


def test_an_unreadable_track_leaves_the_clip_of_its_name_alone(two, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(two, folder)
    file = folder / "tracks/reach.json"
    file.write_text(file.read_text()[:-200])
    (folder / "tracks/reach.csv").unlink()
    accused = {where for code, where in faults(folder) if code == "compare.pose"}
    assert not {w for w in accused if "reach" in w}


@pytest.mark.parametrize("order", ["sorted", "reversed", "schema last"])
def test_the_order_of_the_keys_of_a_track_has_no_meaning(order, two, tmp_path):
    folder = tmp_path / "bars"
    shutil.copytree(two, folder)
    before = {(f.code, f.where) for f in grave(audit(folder).findings)}
    for file in folder.glob("tracks/*.json"):
        track = json.loads(file.read_text())
        keys = sorted(track) if order == "sorted" else list(track)[::-1]
        if order == "schema last":
            keys = [k for k in track if k != "schema"] + ["schema"]
        file.write_text(json.dumps({k: track[k] for k in keys}))
    assert {(f.code, f.where) for f in grave(audit(folder).findings)} == before
