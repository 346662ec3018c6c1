"""Findings tell the difference that was found: its kind, its unit and its size."""

from __future__ import annotations

import numpy as np
import pytest

from twin.exchange.audit.compared_quantities import QUANTITIES, difference_text
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_comparison import compare_mechanisms
from twin.exchange.audit.mechanism_data import FileFrame, FileMass, FileMechanism
from twin.exchange.audit.poses import about, pose


def findings(right: FileMechanism, own: FileMechanism) -> list:
    """Return the findings on b.xml, which states `own`, with the mechanism `right`."""
    right.links = own.links = ("base", "arm")
    ledger = Ledger("b.xml")
    compare_mechanisms([Content(ledger, "mjcf", mechanism=own)], right)
    return ledger.findings


def message(right: FileMechanism, own: FileMechanism) -> str:
    (finding,) = findings(right, own)
    return finding.message


@pytest.mark.parametrize(
    ("angle", "shift", "told"),
    [(0.1, 0.0, "5.73 deg"), (0.0, 0.01, "10 mm"), (0.1, 0.01, "10 mm and 5.73 deg"), (1e-6, 0.01, "10 mm")],
)
def test_a_turned_frame_is_told_in_degrees(angle, shift, told):
    right = FileMechanism(frames={"tip": FileFrame("arm", pose())})
    own = FileMechanism(frames={"tip": FileFrame("arm", pose(about([0, 0, 1], angle), [shift, 0, 0]))})
    assert message(right, own) == (f"frame 'tip': pose of the frame on its link differs by {told} from the mechanism.")


@pytest.mark.parametrize(
    ("moments", "told"),
    [
        ((1.0, 1.0, 1.05e-4), "moment of inertia about one axis differs from the mechanism by 5 %"),
        ((1.1, 1.0, 1e-4), "inertia differs from the mechanism by 9.09 %"),
    ],
)
def test_the_small_moment_of_a_slender_link_is_told_by_its_own_size(moments, told):
    def mechanism(diagonal):
        return FileMechanism(masses={"arm": FileMass(1.0, np.zeros(3), np.diag(diagonal))})

    assert message(mechanism((1.0, 1.0, 1e-4)), mechanism(moments)) == f"link 'arm': {told}."


def test_an_opening_may_be_an_angle():
    text = message(FileMechanism(opening=0.0), FileMechanism(opening=0.002))
    assert "open by 0.002 m or rad" in text
    assert "mm" not in text


def test_text_and_size_are_one_difference():
    """The distance of a point from a line depends on which of two lines that are not parallel is the line."""
    right = (np.zeros(3), np.array([0.0, 0.0, 1.0]))
    own = (np.array([0.0, 0.01, 0.02]), np.array([0.0, 0.6, 0.8]))
    size = QUANTITIES["place"].difference(right, own)
    text = difference_text("joint 'q1' on 'arm'", "place", own, right, size, "a.usda")
    assert text == "joint 'q1' on 'arm': axis or centre of the joint differs by 10 mm from a.usda."
