"""A joint with only a lower or only an upper limit, as SDF and USD state it, in descriptions and in exports."""

import math

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import twin
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.mjcf.audit.model_checks import check_limits, check_model
from twin.exchange.formats.mjcf.write import mjcf_findings, mjcf_text
from twin.exchange.formats.tracks.write import NO_LIMIT, track
from twin.exchange.formats.urdf.audit import Urdf
from twin.exchange.formats.urdf.read import read_urdf
from twin.exchange.formats.urdf.write import urdf_findings, write_urdf
from twin.exchange.write.clip import Clip, InterpolationErrors
from twin.model.body import Body, Frame
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint
from twin.model.mechanism import Mechanism

SDF = """<sdf version="1.9"><model name="arm"><static>true</static><link name="base"/>
<link name="arm"><pose>0 0 0.1 0 0 0</pose><inertial><mass>1</mass></inertial></link>
<joint name="q" type="revolute"><parent>base</parent><child>arm</child>
<axis><xyz>0 1 0</xyz><limit><lower>-1</lower></limit></axis></joint></model></sdf>"""


def arm(kind="revolute", limits=(-1.0, math.inf)):
    inertia = Inertia(1.0, np.zeros(3), 1e-3 * np.eye(3))
    joint = Joint("q", kind, "base", "link", active=True, limits=limits, drive=Drive(100.0, 10.0))
    frame = Frame("tool", "link", np.eye(4))
    return Mechanism("arm", "base", (Body("base"), Body("link", inertia=inertia)), (joint,), (frame,))


def test_a_robot_folder_made_from_such_a_file_can_be_read(tmp_path):
    (tmp_path / "arm.sdf").write_text(SDF)
    twin.new(str(tmp_path / "arm.sdf"), out=str(tmp_path / "arm"))
    low, high = twin.load(str(tmp_path / "arm")).mechanism.joint("q").limits
    assert low == pytest.approx(-1.0)
    assert high == math.inf


@pytest.mark.parametrize("limits", [(-1.0, math.inf), (-math.inf, 0.5)])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_urdf_keeps_the_limit_and_programs_read_it(kind, limits, tmp_path):
    mechanism = arm(kind, limits)
    path = write_urdf(mechanism, tmp_path)
    assert [f.where for f in urdf_findings(mechanism) if "URDF requires both limits" in f.message] == ["q"]
    assert pin.buildModelFromUrdf(str(path)).nq == 1
    assert read_urdf(path).mechanism.joint("q").limits == limits
    audited = Urdf(path, Ledger("arm.urdf")).content.mechanism
    assert audited is not None
    assert audited.joints[0].drive.limits == limits


def test_limits_of_a_joint_with_two_coordinates_limit_neither(tmp_path):
    """A slide in m and a hinge in rad would get the same numbers."""
    inertia = Inertia(1.0, np.zeros(3), 1e-3 * np.eye(3))
    joint = Joint("q", "cylindrical", "base", "link", limits=(-1.0, 1.0))
    frame = Frame("tool", "link", np.eye(4))
    mechanism = Mechanism("arm", "base", (Body("base"), Body("link", inertia=inertia)), (joint,), (frame,))
    imported = read_urdf(write_urdf(mechanism, tmp_path)).mechanism
    assert [(joint.name, joint.limits) for joint in imported.joints if joint.type != "fixed"] == [
        ("q_slide", None),
        ("q", None),
    ]
    assert not mujoco.MjModel.from_xml_string(mjcf_text(mechanism)).jnt_limited.any()
    for findings in (urdf_findings(mechanism), mjcf_findings(mechanism)):
        assert "the limits of q are left out" in " ".join(f.message for f in findings)


def test_a_urdf_with_two_limits_says_nothing_of_one_side():
    assert not [f for f in urdf_findings(arm(limits=(-1.0, 1.0))) if "both limits" in f.message]


def test_a_track_states_no_limit_on_the_other_side():
    times = np.array([0.0, 1.0])
    links = {name: np.tile(np.eye(4), (2, 1, 1)) for name in ("base", "link")}
    errors = InterpolationErrors(0.0, 0.0, 0.0)
    clip = Clip("go", "go", times, links, {"q": np.zeros(2)}, ("q",), (("go", 0.0, 1.0),), 1.0, errors)
    data = track(arm(), clip)
    assert data["joint_lower"] == [-1]
    assert data["joint_upper"] == [NO_LIMIT]


def test_the_audit_of_an_mjcf_compares_the_limit_that_there_is():
    mechanism = arm()
    model = mujoco.MjModel.from_xml_string(mjcf_text(mechanism))
    ledger = Ledger("arm.xml")
    check_model(model, ledger, from_home=True)
    check_limits(model, "track", {"q": -1.0}, {"q": NO_LIMIT}, ledger)
    assert not ledger.findings
    check_limits(model, "track", {"q": -NO_LIMIT}, {"q": 2.0}, ledger)
    assert [f.code for f in ledger.findings] == ["mjcf.limits"]
