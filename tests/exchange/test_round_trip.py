"""The built-in robots read back by `twin new`: the same driven joints, limits and poses, from URDF, MJCF, USD and SDF.

twin writes no SDF; `made.sdf` does. With TWIN_ROUND_TRIPS=all, the commands themselves export, read and validate every
robot in every format.
"""

from __future__ import annotations

import itertools
import os
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from made import mechanisms as made
from made.sdf import write_sdf
from twin import api
from twin.cli import main
from twin.core import assets, spatial
from twin.exchange.audit import audit
from twin.exchange.formats.mjcf.write import write_mjcf
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.read import read
from twin.exchange.read.loop_closing import close
from twin.reference import ReferenceModel

PRECISION = {"urdf": 1e-9, "mjcf": 1e-9, "usd": 2e-6, "sdf": 1e-9}
"""Maximum difference of poses in m and rad: URDF and MJCF have 12 digits, joint frames of a stage 24 bits."""


def written(kind, mechanism, folder):
    """Write a mechanism in a format, and return the path of the file that `twin new` reads."""
    if kind == "urdf":
        return write_urdf(mechanism, folder)
    if kind == "mjcf":
        return write_mjcf(mechanism, folder)
    if kind == "sdf":
        return write_sdf(mechanism, folder)
    write_usd(mechanism, [], folder)
    return folder / f"{mechanism.name}.usda"


def drawn(mechanism, home, rng):
    """Return values of the driven joints near `home`, within the limits."""
    q = np.array(home)
    for i, joint in enumerate(mechanism.active):
        low, high = joint.limits or (-np.inf, np.inf)
        step = 0.1 if joint.is_angle else 0.005
        q[i] = np.clip(q[i] + rng.uniform(-step, step), low, high)
    return q


EVERY = os.environ.get("TWIN_ROUND_TRIPS") == "all"
KINDS = ("urdf", "mjcf", "usd", "sdf")
SUITE = (("sils", "urdf"), ("sils", "mjcf"), ("sils", "usd"), ("sils", "sdf"), ("lapbot", "urdf"))
"""Loops closed by hinges and balls, in every format; a coupling of three joints, which URDF cannot hold."""

SLOW = (("davinci_psm_si", "urdf"), ("sher", "usd"))
"""A slide that closes a loop, with motors and mimics; loops closed by balls and hinges in single precision."""


def cases():
    """Return every robot in every format, each case in its lane."""
    found: list[Any] = list(SUITE)
    for case in itertools.product(assets.names(), KINDS):
        if case in SLOW:
            found.append(pytest.param(*case, marks=pytest.mark.slow))
        elif case not in SUITE:
            found.append(pytest.param(*case, marks=pytest.mark.nightly))
    return found


@pytest.mark.parametrize(("robot", "kind"), cases())
def test_a_robot_survives_its_own_export(robot, kind, tmp_path, rng):
    first = api.load(robot).weighed().mechanism
    second = close(read(written(kind, first, tmp_path), guarded=False)).mechanism
    models = [ReferenceModel(m) for m in (first, second)]
    states = [m.home() for m in models]
    both = {j.name for j in first.joints if len(j.free_axes) == 1} & {j.name for j in second.joints}
    zero = dict.fromkeys(both, 0.0)
    if kind == "sdf":  # zero of an SDF is its home
        zero = {name: coordinate(first, name, states[0]) for name in both}
    more = {j.name for j in second.active} - {j.name for j in first.active}
    if kind == "sdf":
        assert len(more) == sum(len(c.joints) > 2 for c in first.couplings)
    else:
        assert not more
    assert {j.name for j in second.active} - more == {j.name for j in first.active}
    for name in both:
        ends = [m.joint(name).limits or (-np.inf, np.inf) for m in (first, second)]
        assert np.add(ends[1], zero[name]) == pytest.approx(ends[0], abs=1e-6), name
    freedom = [m.mobility(s.x).freedom for m, s in zip(models, states, strict=True)]
    assert freedom[1] == freedom[0] + len(more)
    for _ in range(3):
        state = models[0].solve(drawn(first, states[0].q, rng))
        one = state.link_poses
        q = [coordinate(first, j.name, state) - zero[j.name] for j in second.active]
        two = models[1].solve(np.array(q)).link_poses
        T_base = spatial.inverse(two[first.base])
        for body in first.bodies:
            assert np.allclose(T_base @ two[body.name], one[body.name], atol=PRECISION[kind]), body.name


def coordinate(mechanism, name, state):
    """Return the coordinate of a joint in a state of the reference model."""
    joint = mechanism.joint(name)
    return float(joint.coordinate(state.link_poses[joint.parent], state.link_poses[joint.child]))


def test_the_loops_of_an_export_are_read_without_an_extra(tmp_path, monkeypatch):
    """A plain install has no PyYAML."""
    monkeypatch.setitem(sys.modules, "yaml", None)
    monkeypatch.chdir(tmp_path)
    file = write_urdf(made.four_bar(), tmp_path)
    assert main(["new", "again", file.name]) == 0
    assert main(["info", "again/"]) == 0
    again = api.load("again/").mechanism
    assert [j.name for j in again.active] == ["crank_joint"]
    assert len(again.loops) == 1


@pytest.mark.parametrize("suffix", ["urdf", "xml", "usda", "sdf"])
def test_a_file_can_follow_the_name(suffix, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    kind = {"xml": "mjcf", "usda": "usd"}.get(suffix, suffix)
    file = written(kind, made.four_bar(), tmp_path).name
    assert main(["new", "again", file, "--out", "one"]) == 0
    assert main(["new", "again", "--from", file, "--out", "two"]) == 0
    folders = [tmp_path / "one", tmp_path / "two"]
    ones, twos = ({p.relative_to(f): p.read_bytes() for p in f.rglob("*") if p.is_file()} for f in folders)
    assert ones == twos
    assert any(path.name == "again.toml" for path in ones)


def test_two_files_and_a_wrong_name_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_urdf(made.four_bar(), tmp_path)
    assert main(["new", "again", "four_bar.urdf", "--from", "four_bar.urdf"]) == 2
    assert "two files" in capsys.readouterr().err
    assert main(["new", "An arm", "four_bar.urdf"]) == 2
    assert "not a valid robot name" in capsys.readouterr().err
    assert main(["new", "again", "missing.urdf"]) == 2
    assert "missing.urdf" in capsys.readouterr().err
    assert not (tmp_path / "again").exists()


def joined(kind):
    """Return a four-bar linkage whose loop is closed by a joint of the given type."""
    robot = made.four_bar()
    free = None if kind in ("spherical", "fixed") else (-3.0, 3.0)
    joints = [replace(j, type=kind, limits=free) if j.name == "closing" else j for j in robot.joints]
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "spherical"])
def test_a_loop_closed_by_any_joint_survives(kind, tmp_path):
    if kind == "cylindrical":
        robot = replace(joined(kind), joints=tuple(replace(j, limits=None) for j in joined(kind).joints))
    else:
        robot = joined(kind)
    again = close(read(written("urdf", robot, tmp_path))).mechanism
    assert {(j.name, j.type) for j in again.joints} == {(j.name, j.type) for j in robot.joints} or kind == "cylindrical"
    states = [ReferenceModel(m).home() for m in (robot, again)]
    for body in robot.bodies:
        assert np.allclose(states[0].link_poses[body.name], states[1].link_poses[body.name], atol=1e-9)


def edited(old, new, suffix=".yaml"):
    def edit(folder):
        file = next(folder.glob(f"*{suffix}"))
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    return edit


DEFECTS = {
    "a loop is missing": (edited('["closing_a", "closing_b"]', ""), "urdf.closures"),
    "other links": (edited('"closing_b"', '"coupler"'), "urdf.loop"),
    "unknown link": (edited('"closing_b"', '"closing_c"'), "urdf.closures"),
    "unknown type": (edited('"6d"', '"5d"'), "urdf.closures"),
    "another driven joint": (edited('name_mot: ["crank_joint"]', 'name_mot: ["elbow"]'), "urdf.driven"),
    "home elsewhere": (edited('"elbow": -0.757', '"elbow": -0.758'), "urdf.loop"),
    "no JSON": (edited("]", ""), "urdf.closures"),
    "end of the loop moved": (edited('<origin xyz="0.28 0 ', '<origin xyz="0.2801 0 ', ".urdf"), "urdf.loop"),
    "transmission lost": (edited('<joint name="crank_joint">', '<joint name="elbow">', ".urdf"), "urdf.driven"),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_defects_of_a_closure_file_are_found(name, tmp_path):
    spoil, code = DEFECTS[name]
    write_urdf(made.four_bar(), tmp_path)
    assert audit(tmp_path).exit_code == 0
    spoil(tmp_path)
    report = audit(tmp_path)
    assert code in {f.code for f in report.findings}, [(f.code, f.message) for f in report.findings]
    assert report.exit_code > 0


@pytest.mark.skipif(not EVERY, reason="minutes: set TWIN_ROUND_TRIPS=all")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("robot", assets.names())
def test_a_robot_read_back_validates(robot, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", robot, "--to", kind, "--out", "first"]) == 0
    file = {"urdf": f"first/{robot}.urdf", "mjcf": f"first/{robot}.xml", "usd": f"first/usd/{robot}.usda"}[kind]
    assert main(["new", "again", "--from", file]) == 0
    for command in ("info", "validate"):
        assert main([command, "again/"]) == 0, command
