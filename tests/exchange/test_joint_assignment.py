"""Joints of a file whose names are not those of the mechanism."""

from __future__ import annotations

import numpy as np

from twin.exchange.audit.file_joints import FileJoint
from twin.exchange.audit.joint_assignment import base_link, joint_assignments
from twin.exchange.audit.mechanism_data import FileMechanism
from twin.exchange.audit.motion_lines import motion_lines


def chain(*kinds: str) -> FileMechanism:
    """Return a chain of joints j0, j1, … between links l0, l1, …"""
    joints = []
    for i, kind in enumerate(kinds):
        joints.append(FileJoint((f"j{i}",), f"l{i}", f"l{i + 1}", np.eye(4), motion_lines(kind, np.eye(4))))
    links = tuple(f"l{i}" for i in range(len(kinds) + 1))
    return FileMechanism(links=links, joints=joints)


def test_the_first_of_several_held_links_is_the_base():
    """The order of a set of names is another one in each process."""
    links = [f"link{i}" for i in range(30)]
    mechanism = FileMechanism(links=("loose", *links), fixed_to_world=frozenset(links))
    assert base_link(mechanism) == "link0"


def test_joints_are_assigned_by_name_or_structure_or_not_at_all():
    mechanism = chain("revolute", "prismatic", "revolute")
    assert joint_assignments(mechanism, mechanism) == [{"j0": "j0", "j1": "j1", "j2": "j2"}]
    renamed = chain("revolute", "prismatic", "revolute")
    renamed.rename({}, {"j0": "a", "j1": "b", "j2": "c"})
    assert joint_assignments(renamed, mechanism) == [{"a": "j0", "b": "j1", "c": "j2"}]
    renamed = chain("revolute", "revolute", "revolute")
    renamed.rename({}, {"j0": "a", "j1": "b", "j2": "c"})
    assert joint_assignments(renamed, mechanism) == []
