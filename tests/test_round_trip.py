"""twin's own exports read back by `twin new`: the same driven joints, limits and poses, from URDF, MJCF and USD.

With TWIN_ROUND_TRIPS=all, the commands themselves export, read and validate every robot in every format.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace

import numpy as np
import pytest

from made import mechanisms as made
from made.lanes import one_of_a_kind
from twin import api
from twin.cli import main
from twin.core import assets, spatial
from twin.exchange.audit import audit
from twin.exchange.read import read
from twin.exchange.read.closing import close
from twin.exchange.write.mjcf import write_mjcf
from twin.exchange.write.urdf import write_urdf
from twin.exchange.write.usd import write_usd
from twin.reference import ReferenceModel

PRECISION = {"urdf": 1e-9, "mjcf": 1e-9, "usd": 2e-6}
"""Maximum difference of poses in m and rad: URDF and MJCF have 12 digits, joint frames of a stage 24 bits."""


def written(kind, mechanism, folder):
    """Write a mechanism in a format, and return the path of the file that `twin new` reads."""
    if kind == "urdf":
        return write_urdf(mechanism, folder)
    if kind == "mjcf":
        return write_mjcf(mechanism, folder)
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


@pytest.mark.parametrize("kind", ["urdf", "mjcf", "usd"])
@pytest.mark.parametrize("robot", one_of_a_kind())
def test_a_robot_survives_its_own_export(robot, kind, tmp_path, rng):
    first = api.load(robot).weighed().mechanism
    second = close(read(written(kind, first, tmp_path), guarded=False)).mechanism
    assert {j.name for j in second.active} == {j.name for j in first.active}
    known = {j.name: j for j in second.joints}
    for joint in first.tree:
        if joint.type in ("revolute", "prismatic") and joint.name in known:
            ends = [j.limits or (-np.inf, np.inf) for j in (joint, known[joint.name])]
            assert ends[1] == pytest.approx(ends[0], abs=1e-6), joint.name
    models = [ReferenceModel(m) for m in (first, second)]
    states = [m.home() for m in models]
    assert models[1].mobility(states[1].x).freedom == models[0].mobility(states[0].x).freedom
    order = [[j.name for j in first.active].index(j.name) for j in second.active]
    for _ in range(3):
        q = drawn(first, states[0].q, rng)
        one = models[0].solve(q).link_poses
        two = models[1].solve(q[order]).link_poses
        T_base = spatial.inverse(two[first.base])
        for body in first.bodies:
            assert np.allclose(T_base @ two[body.name], one[body.name], atol=PRECISION[kind]), body.name


def test_the_loops_of_an_export_are_read_without_an_extra(tmp_path, monkeypatch):
    """A plain install has no PyYAML."""
    monkeypatch.setitem(sys.modules, "yaml", None)
    monkeypatch.chdir(tmp_path)
    write_urdf(api.load("sils").weighed().mechanism, tmp_path)
    assert main(["new", "again", "sils.urdf"]) == 0
    assert main(["info", "again/"]) == 0
    assert api.load("again/").mechanism.joint("q1").active
    assert main(["new", "more", "sils.urdf", "--from", "sils.urdf"]) == 2


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


@pytest.mark.skipif(os.environ.get("TWIN_ROUND_TRIPS") != "all", reason="minutes: set TWIN_ROUND_TRIPS=all")
@pytest.mark.parametrize("kind", ["urdf", "mjcf", "usd"])
@pytest.mark.parametrize("robot", assets.names())
def test_a_robot_read_back_validates(robot, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", robot, "--to", kind, "--out", "first"]) == 0
    file = {"urdf": f"first/{robot}.urdf", "mjcf": f"first/{robot}.xml", "usd": f"first/usd/{robot}.usda"}[kind]
    assert main(["new", "again", "--from", file]) == 0
    for command in ("info", "validate"):
        assert main([command, "again/"]) == 0, command
