"""A file whose links and joints get the names of the mechanism gets them everywhere, so that all is compared."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

from twin.exchange.audit.file_content import Content, FileClip, LinkShape
from twin.exchange.audit.file_drives import FileMotor
from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.ledger import Ledger
from twin.exchange.audit.mechanism_data import FileFrame, FileMass, FileMechanism

LINKS = {"old link": "link", "old base": "base"}
JOINTS = {"old joint": "joint"}

POSE = np.eye(4)
SHAPE = LinkShape(np.zeros(3), np.ones(3), 1.0, True, True, np.zeros((0, 3)), np.zeros((0, 3), int), 6.0)

MECHANISM = {
    "links": ("old base", "old link"),
    "masses": {"old link": FileMass(1.0)},
    "shown": {"old link": True},
    "collides": {"old link": True},
    "assumed": frozenset({"old link"}),
    "partly_shown": frozenset({"old link"}),
    "joints": [FileJoint(("old joint",), "old base", "old link", POSE)],
    "frames": {"tip": FileFrame("old link", POSE)},
    "points": {"tip": FileFrame("old link", POSE)},
    "fixed_to_world": frozenset({"old base"}),
    "trocars": frozenset({"old joint"}),
    "couplings": {"coupling": ({"old joint": 1.0}, 0.0)},
    "motors": {"motor": FileMotor({"old joint": 2.0}), "other motor": FileMotor()},
    "reductions": {"old joint": 2.0},
    "weight_shares": {"old link": 0.5},
    "postures": {"home": {"old joint": 0.1}},
    "home_posture": {"old joint": 0.1},
    "home": {"old joint": 0.1},
}
"""Fields of `FileMechanism` with names of links and joints."""

NO_MECHANISM_NAMES = {
    *("fully_listed", "gravity", "medium", "self_collision", "tool", "couples_pairs", "all_motors", "opening", "robot"),
    *("motion_declarations", "contact_declarations", "program_settings", "complete"),
}
"""Its other fields; what is declared beside all else is text of the file."""

CONTENT = {
    "clips": [FileClip("swing", np.zeros(1), {"old link": POSE[None]}, {"old joint": np.zeros(1)}, {"old link": POSE})],
    "rest": {"old link": POSE},
    "declared": ("old base", "old link"),
    "shapes": {"old link": SHAPE},
    "colors": {"old link": {(1.0, 0.0, 0.0, 1.0): 1.0}},
    "finishes": {"old link": {(0.5, 0.5, 0.0, 1.0): 1.0}},
    "mechanism": FileMechanism(**MECHANISM),
}
"""Fields of `Content` with names of links and joints."""

NO_CONTENT_NAMES = {"ledger", "format", "model_hash", "stated", "facts", "extra", "known"}
"""Its other fields; `known` has the names of the folder."""


def names_in(value: Any) -> set[str]:
    """Return all texts in a value."""
    if isinstance(value, str):
        return {value}
    if is_dataclass(value):
        return set().union(*(names_in(getattr(value, f.name)) for f in fields(value)))
    if isinstance(value, dict):
        return names_in(list(value.keys())) | names_in(list(value.values()))
    if isinstance(value, list | tuple | frozenset):
        return set().union(*(names_in(entry) for entry in value))
    return set()


@pytest.mark.parametrize(
    ("kind", "named", "others"),
    [(FileMechanism, MECHANISM, NO_MECHANISM_NAMES), (Content, CONTENT, NO_CONTENT_NAMES)],
)
def test_every_field_says_whether_it_has_names(kind, named, others):
    assert named.keys() | others == {field.name for field in fields(kind)}
    for name, value in named.items():
        assert any(text.startswith("old ") for text in names_in(value)), name


def test_links_and_joints_get_their_new_names_everywhere():
    content = Content(Ledger("robot.usd", "test", "1"), "usd", **deepcopy(CONTENT))
    before = {name: names_in(getattr(content, name)) for name in CONTENT}
    content.rename(LINKS, JOINTS)
    for name, old_names in before.items():
        expected = {LINKS.get(text, JOINTS.get(text, text)) for text in old_names}
        assert names_in(getattr(content, name)) == expected
    assert not {text for text in names_in(content.mechanism) if text.startswith("old ")}
