"""Names of robot files as identifiers."""

from __future__ import annotations

import pytest

from twin.core.identifiers import identifier, unique


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("FrontLeftLeg", "front_left_leg"),
        ("frontleftleg", "frontleftleg"),
        ("__left  arm__", "left_arm"),
        ("a__b", "a__b"),
        ("a_ -b", "a__b"),
        ("2nd", "n_2nd"),
        ("Öl", "l"),
        ("---", "n"),
    ],
)
def test_a_name_becomes_an_identifier(name, expected):
    assert identifier(name) == expected


def test_equal_identifiers_are_numbered_in_order():
    names = [("/a", "Arm"), ("/b", "arm"), ("/c", "ARM"), ("/d", "leg")]
    assert unique(names, reserved=["leg"]) == {"/a": "arm", "/b": "arm_2", "/c": "arm_3", "/d": "leg_2"}
