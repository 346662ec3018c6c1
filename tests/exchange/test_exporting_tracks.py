"""Tracks: JSON and CSV hold the same numbers, fit the schema, and are the clip."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from twin import api
from twin.core import spatial
from twin.exchange.formats.tracks.write import schema_text, track, write_tracks
from twin.exchange.write.key_rate import make_clip
from twin.exchange.write.model_hash import model_hash
from twin.schema.track import Track

SHORT = Path(__file__).parents[1] / "data/short.toml"
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def sils():
    robot = api.load("sils")
    clip = make_clip(robot.mechanism, api.plan(robot, SHORT), "A short one", assumed=("speed = 1 mm/s: unpublished",))
    return robot.mechanism, clip


@pytest.fixture(scope="module")
def files(sils, tmp_path_factory):
    return write_tracks(*sils, tmp_path_factory.mktemp("tracks"))


@pytest.fixture(scope="module")
def data(files):
    return json.loads(files[0].read_text(encoding="utf-8"))


def test_json_fits_the_schema_and_a_wrong_one_does_not(files):
    text = files[0].read_text(encoding="utf-8")
    Track.model_validate_json(text)
    for wrong in (
        text.replace('"quaternion_order":"xyzw"', '"quaternion_order":"wxyz"'),
        text.replace('"version":1', '"version":2'),
        text.replace('"rcm":[', '"rcm":[1,'),
        text.replace('"length_unit":"m"', '"length_unit":"mm"'),
        text.replace('"rate":', '"speed":'),
    ):
        assert wrong != text
        with pytest.raises(ValidationError):
            Track.model_validate_json(wrong)


def test_schema_in_the_bundle_is_that_of_the_documentation():
    assert schema_text() == (ROOT / "docs/schemas/track.schema.json").read_text(encoding="utf-8")


def test_json_is_flat_for_unity(data):
    """JsonUtility reads no dictionaries, no arrays of arrays, no nulls."""
    for name, value in data.items():
        assert isinstance(value, str | int | float | list), name
        if isinstance(value, list):
            assert len({isinstance(v, str) for v in value}) <= 1, name
            assert all(isinstance(v, str | int | float) and not isinstance(v, bool) for v in value), name


def test_lengths_are_those_of_their_names(data):
    k, links, joints = data["frames"], len(data["links"]), len(data["joints"])
    assert len(data["times"]) == k
    assert len(data["poses"]) == k * links * 7
    assert len(data["positions"]) == k * joints
    for name in ("joint_types", "joint_active", "joint_lower", "joint_upper"):
        assert len(data[name]) == joints, name
    phases = len(data["phases"])
    assert len(data["phase_start"]) == len(data["phase_end"]) == len(data["phase_has_rcm"]) == phases
    assert len(data["phase_rcm"]) == 3 * phases
    assert len(data["phase_rcm_enforced"]) == phases
    assert len(data["frames_local"]) == 7 * len(data["frame_names"]) == 7 * len(data["frame_links"])


def test_poses_and_joints_are_the_clip(sils, data):
    mechanism, clip = sils
    k = data["frames"]
    poses = np.reshape(data["poses"], (k, -1, 7))
    for i, name in enumerate(data["links"]):
        q = poses[:, i, 3:]
        assert np.abs(poses[:, i, :3] - clip.links[name][:, :3, 3]).max() <= 0.5e-7 + 1e-12
        R = spatial.matrix_from_quat_wxyz(np.roll(q, 1, axis=1))
        assert np.abs(R - clip.links[name][:, :3, :3]).max() < 3e-7
        assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)
    values = np.reshape(data["positions"], (k, -1))
    for i, name in enumerate(n for n in data["joints"] if n in clip.joints):
        assert np.abs(values[:, i] - clip.joints[name]).max() <= 0.5e-7 + 1e-12
    assert data["joints"][len(clip.joints) :] == ["s1_x", "s1_y", "s1_z"]  # the ball in the tree of the URDF
    assert [n for n, a in zip(data["joints"], data["joint_active"], strict=True) if a] == list(clip.active)
    assert data["model_hash"] == model_hash(mechanism)
    assert data["assumed"] == ["speed = 1 mm/s: unpublished"]


def test_csv_holds_the_same_numbers_and_the_same_head(files, data):
    lines = files[1].read_text(encoding="utf-8").splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    for name, value in data.items():
        if name in ("times", "poses", "positions"):
            assert name not in head
        else:
            assert (head[name] if isinstance(value, str) else json.loads(head[name])) == value, name
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert len(rows) == data["frames"]
    k = data["frames"]
    poses, values = np.reshape(data["poses"], (k, -1, 7)), np.reshape(data["positions"], (k, -1))
    assert [float(r["time_s"]) for r in rows] == data["times"]
    for i, link in enumerate(data["links"]):
        for j, part in enumerate(("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")):
            assert [float(r[f"{link}_{part}"]) for r in rows] == poses[:, i, j].tolist()
    for i, (joint, kind) in enumerate(zip(data["joints"], data["joint_types"], strict=True)):
        unit = "rad" if kind == "revolute" else "m"
        assert [float(r[f"{joint}_{unit}"]) for r in rows] == values[:, i].tolist()
    assert len(rows[0]) == 1 + len(data["joints"]) + 7 * len(data["links"])


def test_same_bytes_twice(sils, files, tmp_path):
    again = write_tracks(*sils, tmp_path)
    assert [p.read_bytes() for p in again] == [p.read_bytes() for p in files]


def test_rcm_is_the_first_registered_one_and_each_phase_has_its_own(sils):
    mechanism, clip = sils
    a, b = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
    phases = (("one", 0.0, 0.1), ("two", 0.1, 0.2), ("three", 0.2, 0.3))
    several = replace(clip, phases=phases, phase_rcm=(None, a, b), phase_rcm_enforced=(False, True, False))
    out = track(mechanism, several)
    assert out["rcm"] == [0.1, 0.2, 0.3]
    assert out["phase_has_rcm"] == [0, 1, 1]
    assert out["phase_rcm_enforced"] == [0, 1, 0]
    assert out["phase_rcm"] == [0, 0, 0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert track(mechanism, replace(clip, phases=phases, phase_rcm=(None,) * 3, phase_rcm_enforced=()))["rcm"] == []


@pytest.mark.slow
def test_a_trocar_of_the_mechanism_is_the_rcm():
    robot = api.load("lapbot")
    clip = make_clip(robot.mechanism, api.plan(robot, "cavity"))
    assert track(robot.mechanism, clip)["rcm"] == pytest.approx(robot.mechanism.trocar_at(), abs=1e-7)
