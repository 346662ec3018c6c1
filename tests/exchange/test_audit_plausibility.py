"""Numbers that are not finite are found in one file alone: they exceed no limit."""

from __future__ import annotations

import numpy as np
import pytest

from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileMass, FileMechanism
from twin.exchange.audit.plausibility import check_sense

INERTIA = 1e-3 * np.eye(3)


def judged(mass: FileMass, drive: FileDrive) -> list[str]:
    joint = FileJoint(("q",), "base", "arm", np.eye(4), drive=drive)
    content = Content(Ledger("arm.urdf"), "urdf", mechanism=FileMechanism(masses={"arm": mass}, joints=[joint]))
    check_sense(content)
    return [finding.code for finding in content.ledger.findings]


def test_a_usual_arm_is_possible():
    assert judged(FileMass(1.0, np.zeros(3), INERTIA), FileDrive((0.0, 1.0), stiffness=1.0, effort=np.inf)) == []


@pytest.mark.parametrize(
    ("mass", "drive", "code"),
    [
        (FileMass(1.0, np.array([np.nan, 0.0, 0.0]), INERTIA), FileDrive(), "physics.mass_centre_not_finite"),
        (FileMass(1.0), FileDrive(stiffness=np.nan), "physics.drive_negative"),
        (FileMass(1.0), FileDrive(damping=-1.0), "physics.drive_negative"),
        (FileMass(1.0), FileDrive(limits=(np.nan, 1.0)), "physics.limits"),
    ],
)
def test_what_no_arm_has_is_found(mass, drive, code):
    assert judged(mass, drive) == [code]
