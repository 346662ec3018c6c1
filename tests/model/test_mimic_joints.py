"""Joints that follow others by couplings of two joints: whom, how far, and how a stage and a URDF hold it."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdPhysics

from made.loops import ALONG_X, mechanism
from twin.core import spatial
from twin.core.errors import SourceError
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_comparison import compare_mechanisms
from twin.exchange.audit.mechanism_truth import mechanism_truth
from twin.exchange.audit.reduced_couplings import reduced_couplings
from twin.exchange.formats.urdf.write import write_urdf
from twin.exchange.formats.usd.audit.mechanism import stage_mechanism
from twin.exchange.formats.usd.write import write_usd
from twin.exchange.read import read
from twin.model.joint import Joint
from twin.model.mechanism import Coupling
from twin.model.mimic_joints import following

ENDS = (-1.0, 1.0)
BANDS = (Coupling("second", ("b", "c"), (1.0, 1.0)), Coupling("first", ("a", "b"), (1.0, 2.0)))
MIMIC = ["PhysxMimicJointAPI"]
TELESCOPE = Coupling("telescope", ("whole", "half"), (1.0, -2.0))


def arm(*couplings, **more):
    """Three links in a row, of which the first is driven; on the last one a driven slide, and one beside it."""
    joints = (
        Joint("a", "revolute", "base", "upper", active=True, limits=ENDS),
        Joint("b", "revolute", "upper", "fore", spatial.pose(p=[0.3, 0, 0]), limits=ENDS),
        Joint("c", "revolute", "fore", "hand", spatial.pose(p=[0.2, 0, 0]), limits=more.pop("last", ENDS)),
        Joint("whole", "prismatic", "hand", "tip", ALONG_X, ALONG_X, active=True, limits=ENDS),
        Joint("half", "prismatic", "hand", "stage", ALONG_X, ALONG_X, limits=ENDS),
    )
    return mechanism(*joints, tool="tip", couplings=couplings, **more)


def names(m):
    return {j.name for j in m.joints}


def test_a_chain_follows_its_driver(rng):
    for _ in range(20):
        r, totals = rng.uniform(0.5, 2, (2, 2)) * rng.choice([-1, 1], (2, 2)), rng.uniform(-1, 1, 2)
        m = arm(
            Coupling("second", ("c", "b"), tuple(r[0]), totals[0]),
            Coupling("first", ("a", "b"), tuple(r[1]), totals[1]),
        )
        found = following(m, names(m))
        assert {c: (f.joint, f.leader) for c, f in found.items()} == {"first": ("b", "a"), "second": ("c", "a")}
        q = {"a": rng.uniform(-1, 1)}
        q |= {f.joint: f.multiplier * q[f.leader] + f.offset for f in found.values()}
        for c in m.couplings:
            assert sum(k * q[n] for n, k in zip(c.joints, c.ratios, strict=True)) == pytest.approx(c.total, abs=1e-12)


def test_what_makes_no_joint_follow_is_left_out():
    of_three = Coupling("of_three", ("a", "b", "c"), (1.0, 1.0, 1.0))
    again = Coupling("again", ("a", "c"), (2.0, -1.0))
    m = arm(*BANDS)
    assert following(arm(of_three), names(m)) == {}
    assert following(replace(m, joints=tuple(replace(j, active=True) for j in m.joints)), names(m)) == {}
    assert set(following(arm(*BANDS, again), names(m))) == {"second", "first"}
    assert set(following(m, names(m) - {"c"})) == {"first"}
    (alone,) = following(arm(BANDS[0]), names(m)).values()
    assert (alone.joint, alone.leader, alone.multiplier) == ("b", "c", -1.0)


def test_a_urdf_names_the_driver(tmp_path):
    root = ET.parse(write_urdf(arm(*BANDS, TELESCOPE), tmp_path)).getroot()
    said = {j.get("name"): j.find("mimic") for j in root.findall("joint")}
    mimics = {n: (m.get("joint"), float(m.get("multiplier"))) for n, m in said.items() if m is not None}
    assert mimics == {"b": ("a", -0.5), "c": ("a", 0.5), "half": ("whole", 0.5)}


def staged(m, folder):
    write_usd(m, [], folder)
    return folder / f"{m.name}.usda"


def opened(path):
    """Return the stage, its physics layer to edit."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(next(x for x in stage.GetLayerStack() if x.identifier.endswith("physics.usda")))
    return stage


def mechanism_on(stage):
    return stage_mechanism(stage, [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)], 1.0, "Z")


def held_by(stage, joint):
    """Return which schemas of mimic joints and tendons a joint has."""
    applied = map(str, stage.GetPrimAtPath(f"/m/joints/{joint}").GetPrimTypeInfo().GetAppliedAPISchemas())
    return [s.split(":")[0] for s in applied if s.startswith(("PhysxMimic", "PhysxTendon"))]


@pytest.mark.parametrize(
    ("m", "held"),
    [
        (arm(*BANDS, TELESCOPE), {"b": MIMIC, "c": MIMIC, "half": MIMIC}),
        # a hinge without ends, and a sum: PhysX takes the one for no mimic joint, and Newton reads the other in rad
        (arm(*BANDS, last=None), {"a": [], "b": ["PhysxTendonAxisRootAPI", *MIMIC], "c": ["PhysxTendonAxisAPI"]}),
        (
            arm(Coupling("first", ("a", "b"), (1.0, 2.0), 0.1)),
            {"a": ["PhysxTendonAxisRootAPI"], "b": ["PhysxTendonAxisAPI"]},
        ),
    ],
    ids=["chain", "no ends", "sum"],
)
def test_a_stage_holds_couplings_as_mimic_joints_or_else_as_tendons(tmp_path, m, held):
    stage = opened(staged(m, tmp_path))
    assert {n: held_by(stage, n) for n in held} == held
    truth, found = (reduced_couplings(p.couplings or {}) for p in (mechanism_truth(m), mechanism_on(stage)))
    assert truth.keys() == found.keys()
    for joint, (ratios, total) in truth.items():
        assert found[joint] == (pytest.approx(ratios, abs=1e-6), pytest.approx(total, abs=1e-6))


def gearing(stage):
    attribute = stage.GetPrimAtPath("/m/joints/c").GetAttribute("physxMimicJoint:rotZ:gearing")
    attribute.Set(1.001 * attribute.Get())


def another(stage):
    leader = stage.GetPrimAtPath("/m/joints/c").GetRelationship("physxMimicJoint:rotZ:referenceJoint")
    leader.SetTargets(["/m/joints/b"])


def removed(stage):
    prim = stage.GetPrimAtPath("/m/joints/c")
    prim.SetMetadata("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["PhysicsJointStateAPI:angular"]))


@pytest.mark.parametrize(
    ("edit", "codes"),
    [
        (None, set()),
        (gearing, {"physics.ratios"}),
        (another, {"physics.ratios"}),
        (removed, {"physics.existence", "physics.links", "physics.ratios"}),
    ],
)
def test_the_audit_finds_a_mimic_joint_that_follows_otherwise_or_no_more(tmp_path, edit, codes):
    m = arm(*BANDS)
    stage, ledger = opened(staged(m, tmp_path)), Ledger("m.usda")
    if edit:
        edit(stage)
    compare_mechanisms([Content(ledger, "usda", mechanism=mechanism_on(stage))], mechanism_truth(m))
    assert {f.code for f in ledger.findings if "coupling" in f.where} == codes, ledger.findings


@pytest.mark.slow
def test_our_mimic_joints_come_back_and_those_of_others_are_refused(tmp_path):
    path = staged(arm(*BANDS), tmp_path)
    assert [c.name for c in read(path).mechanism.couplings] == ["second", "first"]
    stage = opened(path)
    stage.GetPrimAtPath("/m").ClearCustomDataByKey("twin:couplings")
    stage.Save()
    with pytest.raises(SourceError, match="joint /m/joints/b is coupled to another joint by PhysxMimicJointAPI"):
        read(path)


def test_constraints_are_equal_however_they_are_stated_and_no_others_are(rng):
    chain = {"x": ({"a": 1.0, "b": 2.0}, 0.1), "y": ({"b": 1.0, "c": -3.0}, 0.0), "z": ({"d": 2.0, "e": 1.0}, 0.0)}
    star = {"1": ({"c": 6.0, "a": 1.0}, 0.1), "2": ({"a": 2.0, "b": 4.0}, 0.2), "3": ({"e": 0.5, "d": 1.0}, 0.0)}
    one, two = reduced_couplings(chain), reduced_couplings(star)
    assert one.keys() == two.keys() == {"a", "b", "d"}
    for joint, (ratios, total) in one.items():
        assert two[joint] == (pytest.approx(ratios), pytest.approx(total))
    other = reduced_couplings(star | {"2": ({"a": 2.0, "b": 4.01}, 0.2)})
    assert other["b"][0] != pytest.approx(one["b"][0], abs=1e-5)
    assert reduced_couplings(chain | {"again": ({"a": 1.0, "c": 6.0}, 0.1)}).keys() == one.keys()
    assert reduced_couplings({"x": ({"a": np.nan, "b": 1.0}, 0.0)}) == {} == reduced_couplings({})
