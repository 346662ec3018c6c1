"""Equations and compiled loops drive the joints of the stages; the reference model judges the motion."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

import twin
from made.lanes import nightly
from twin.core import assets
from twin.core.units import DEG
from twin.planning.link_motion import BY_EQUATIONS, BY_PLAN
from twin.planning.trajectory import key_times
from twin.validation.baked_motion import KEY_RATE, baked_rows, measure_motion, sampled_motion
from twin.validation.case import phase_summaries
from twin.validation.residual_rows import Tolerances

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "tests" / "data" / "short.toml"

SINGLE = 1.2e-7
"""Rounding of a value and of its unit to single precision, relative."""


def joint_values(stage):
    """Return {joint: (time codes (k,), values (k,) in rad or m)} of all joint states with samples, read by pxr."""
    out = {}
    for prim in stage.Traverse():
        if not prim.IsA(UsdPhysics.Joint):
            continue
        for kind, unit in (("angular", DEG), ("linear", 1.0)):
            attribute = prim.GetAttribute(f"state:{kind}:physics:position")
            if attribute and attribute.GetTimeSamples():
                codes = np.array(attribute.GetTimeSamples())
                out[prim.GetName()] = codes, unit * np.array([attribute.Get(c) for c in codes])
    return out


def tool_poses(stage, mechanism, codes):
    """Return T_base_tool (k, 4, 4) at time codes (k,), from the baked poses of the tool's body, read by pxr."""
    frame = mechanism.frame(mechanism.tool)
    prim = UsdGeom.Xformable(stage.GetPrimAtPath(f"/{mechanism.name}/{frame.body}"))
    rows = [np.array(prim.GetLocalTransformation(Usd.TimeCode(c))).T for c in codes]
    return np.array(rows) @ frame.T_body_frame


@pytest.mark.parametrize("name", nightly(assets.names(), 4))
def test_the_joints_of_a_stage_have_the_values_of_the_inverse(name):
    robot = twin.load(name)
    for protocol in robot.files.protocols():
        stage = Usd.Stage.Open(str(robot.files.usd / f"{name}_{protocol}.usda"))
        values = joint_values(stage)
        bound = robot.bound(robot.protocol(protocol))
        trajectory = twin.plan(robot, protocol)
        codes, _ = values[robot.joints[0]]
        times = np.clip(codes / stage.GetTimeCodesPerSecond(), 0, trajectory.duration)
        planned = trajectory.joints(times)
        solved = bound.inverse(tool_poses(stage, bound.mechanism, codes))
        for i, joint in enumerate(bound.mechanism.active):
            got = values[joint.name][1]
            want = planned[:, i] if joint in bound.mechanism.auxiliary else solved[:, i]
            difference = got - want
            if joint.is_angle:
                difference -= 2 * np.pi * np.round(difference / (2 * np.pi))
            assert np.abs(difference).max() <= SINGLE * max(1.0, np.abs(got).max()), (protocol, joint.name)
        for joint in bound.mechanism.passive:
            assert len(values[joint.name][1]) == len(codes)


@pytest.mark.slow
def test_an_edited_key_of_a_stage_is_found_and_the_report_names_driver_and_judge(tmp_path):
    folder = tmp_path / "hibou"
    shutil.copytree(ROOT / "usd" / "hibou", folder)
    layer = Sdf.Layer.FindOrOpen(str(folder / "motion" / "cavity.usdc"))
    places: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, lambda path: places.append(path))
    path = next(p for p in places if p.name == "xformOp:translate" and layer.GetNumTimeSamplesForPath(p) > 40)
    code = layer.ListTimeSamplesForPath(path)[40]
    layer.SetTimeSample(path, code, layer.QueryTimeSample(path, code) + Gf.Vec3d(0, 0, 2e-9))
    layer.Save()
    report = twin.validate(twin.load("hibou"), stage=folder / "hibou.usda", baked=True)
    (finding,) = [f for f in report.findings if f.severity == "disagreement"]
    assert finding.code == "baked.written"
    said = report.facts["baked motion"]
    assert said["driven by"].split("; ")[0].split(": ")[1] in (BY_EQUATIONS, BY_PLAN)
    assert said["judged by"] == "reference model (Pinocchio)"


def test_a_motion_by_wrong_equations_disagrees_with_the_mechanism():
    """The printed equation (1) drives the joints; the mechanism is judged at the planned poses."""
    sils = twin.load("sils")
    trajectory = twin.plan(sils, SHORT)
    motion = sils.link_motion(trajectory, key_times(trajectory.duration, KEY_RATE))
    assert not motion.by_plan
    assert np.array_equal(sils.link_motion(trajectory, motion.times).q, motion.q)
    phases = phase_summaries(trajectory)

    def judged(motion):
        looked = sampled_motion(trajectory, motion)
        return baked_rows(measure_motion(bare, looked), looked, phases, Tolerances())

    bare = replace(sils.mechanism, bodies=tuple(replace(b, meshes=()) for b in sils.mechanism.bodies))
    rows, findings = judged(motion)
    assert not findings
    assert rows[0].note.startswith(f"driven joints: {BY_EQUATIONS}")
    q = sils.kinematics({"eq1": "printed"}).inverse_many(trajectory.poses(motion.times))
    links = sils.loops.link_poses(q, sils.loops.forward_many(q).states)
    rows, findings = judged(replace(motion, q=q, links=links))
    assert {f.code for f in findings} == {"baked.differs"}
    assert rows[0].worst > 1e-4
