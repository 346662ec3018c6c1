"""Every subset of the formats that `twin export` writes passes `twin audit` of the untouched folder.

Each format is written, and each of its files read, once; each subset is composed of these files, with a README.txt and
a proof.json of its own. The suite tests one format, two formats and all formats. With TWIN_SUBSETS=all, the two
commands themselves write and read each of the 127 subsets, in about ten minutes for each robot.
"""

from __future__ import annotations

import copy
import os
import shutil
from itertools import combinations
from pathlib import Path

import pytest

import twin.exchange.audit as audits
from twin import api
from twin.cli import main
from twin.core.progress import silent
from twin.exchange.format import Holds
from twin.exchange.formats import audit_formats
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.exchange.read.robot_folder import write_folder
from twin.exchange.write import bundle as bundles
from twin.exchange.write.clip import ClipAccuracy

COARSE = ClipAccuracy(position=2e-3, rotation=0.05, joint_gap=1e-3)
"""Errors between keys that need few keys."""

FORMATS = bundles.chosen_formats(None)
SUBSETS = [s for n in range(1, len(FORMATS) + 1) for s in combinations(FORMATS, n)]
SMALL = [s for s in SUBSETS if len(s) in (1, 2, len(FORMATS))]

ROBOTS = ["imported", pytest.param("davinci_ecm", marks=pytest.mark.nightly)]

ARM = """<robot name="arm">
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual>
    <inertial><mass value="2"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"><visual><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.05 0.05"/></geometry></visual></link>
  <link name="fore"><visual><origin xyz="0.1 0 0"/><geometry><cylinder radius="0.02" length="0.2"/></geometry></visual>
    <inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="slider"><visual><geometry><sphere radius="0.03"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="10"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><origin xyz="0.2 0 0.05"/>
    <axis xyz="0 1 0"/><limit velocity="2" effort="5"/></joint>
  <joint name="reach" type="prismatic"><parent link="fore"/><child link="slider"/><origin xyz="0.25 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" velocity="0.1" effort="5"/></joint>
</robot>
"""


def imported(parent: Path) -> Path:
    """Write the robot folder of an arm that is read from a URDF, and return it."""
    source = parent / "arm.urdf"
    source.write_text(ARM, encoding="utf-8")
    write_folder(close(read(source)), "arm", parent / "arm", source)
    return parent / "arm"


def linked(source: str, target: str) -> None:
    """Link a file, unless another format has already written it (MJCF and URDF have the same meshes)."""
    if not Path(target).exists():
        os.link(source, target)


def written_once(order, folder: Path):
    """Write each format to a folder of its own; return a function that copies the files of a format."""
    findings = {}
    for name in FORMATS:
        (folder / name).mkdir(parents=True)
        findings[name] = bundles.write_format(name, order, folder / name)

    def again(name, order, work):
        shutil.copytree(folder / name, work, dirs_exist_ok=True, copy_function=linked)
        return findings[name]

    return again


def read_once(reader):
    """Return a reader of folders that reads each file once; MJCF and URDF are read with and without tracks."""
    known: dict = {}

    def again(found, tell, states, xacro):
        tracks = found.files.get("tracks", [])
        for format in audit_formats():
            files = found.files.get(format.name, [])
            key = (format.name, bool(tracks), tuple(found.name(p) for p in files))
            if key not in known:
                alone = audits.FolderFiles(found.root, {format.name: files})
                played = Holds.JOINT_TREE in format.holds
                if played:
                    alone.files["tracks"] = tracks
                rows = list(reader(alone, tell, states, xacro))
                known[key] = rows[len(tracks) if played else 0 :]
            yield from copy.deepcopy(known[key])

    return again


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_subsets_of_formats_pass_their_own_audit(robot, tmp_path, monkeypatch):
    from twin.exchange.write.order_of_robot import order_of_robot

    loaded = api.load(imported(tmp_path) if robot == "imported" else robot)
    content = order_of_robot(loaded, None, None, COARSE, api.plan, silent)
    assert content.clips
    monkeypatch.setattr(bundles, "write_format", written_once(content, tmp_path / "formats"))
    monkeypatch.setattr(audits, "_read", read_once(audits._read))
    failed = []
    for formats in SMALL:
        folder = tmp_path / "-".join(formats)
        made = bundles.write_bundle(content, folder, formats, audits.audit, silent)
        judged = audits.audit(folder)
        if (made.exit_code, judged.exit_code) != (0, 0):
            failed.append((formats, made.exit_code, judged.exit_code, [f.message for f in judged.findings][:3]))
    assert not failed, (len(failed), failed[:8])


@pytest.mark.skipif(os.environ.get("TWIN_SUBSETS") != "all", reason="minutes: set TWIN_SUBSETS=all")
@pytest.mark.parametrize("robot", ["imported", "davinci_ecm"])
def test_every_subset_of_formats_passes_both_commands(robot, tmp_path, capsys):
    name = str(imported(tmp_path)) if robot == "imported" else robot
    failed = []
    for formats in SUBSETS:
        folder = str(tmp_path / "-".join(formats))
        made = main(["export", name, "--to", ",".join(formats), "--out", folder, "--budget-um", "2000"])
        judged = main(["audit", folder])
        said = capsys.readouterr().out
        if (made, judged) != (0, 0):
            failed.append((formats, made, judged, [line for line in said.splitlines() if "✖" in line]))
    assert not failed, (len(failed), failed)
