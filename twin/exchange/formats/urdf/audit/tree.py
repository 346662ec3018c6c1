"""The links of a URDF as a tree of joints, and the paths in it along which poses are computed."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.exchange.audit.chain_poses import ChainStep, chain_end
from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger, ReadError
from twin.exchange.audit.poses import Array
from twin.exchange.formats.urdf.audit.joint_elements import UrdfJoint


@dataclass(frozen=True)
class TreePath:
    """The joints from the link `ancestor` to a link below it, starting at the ancestor; none for the link itself."""

    ancestor: str
    joints: tuple[UrdfJoint, ...]

    @property
    def steps(self) -> list[ChainStep]:
        """The joints as steps of a chain."""
        return [joint.step for joint in self.joints]

    @property
    def has_free_joint(self) -> bool:
        """Whether one of the joints allows every pose."""
        return any(joint.step.kind == "free" for joint in self.joints)

    @property
    def moving_count(self) -> int:
        """Number of the joints that can move."""
        count = 0
        for joint in self.joints:
            if joint.step.kind != "fixed":
                count += 1
        return count

    def values(self, clip: FileClip) -> list[Array | None]:
        """Return the values (k,) in a clip of each joint, in rad or m; None for joints without values."""
        return [joint.values(clip) for joint in self.joints]


class UrdfTree:
    """The tree of a URDF.

    Attributes:
        links: names of the links, in file order.
        joint_above: {link: the joint whose child it is}, for all links but the root.
        root: name of the link that is the child of no joint.
    """

    def __init__(self, links: Sequence[str], joints: Iterable[UrdfJoint], ledger: Ledger) -> None:
        """Build the tree. The second joint above a link is reported, and left out.

        Raises:
            ReadError: there is not one root, or a link is its own ancestor.
        """
        self.links = links
        self.joint_above: dict[str, UrdfJoint] = {}
        for joint in joints:
            first = self.joint_above.setdefault(joint.child, joint)
            if first is not joint:
                text = (
                    f"link '{joint.child}' is the child of two joints, {first.name} and {joint.name}, but a URDF must "
                    "be a tree."
                )
                ledger.wrong("urdf.tree", text, joint.child)
        roots = [link for link in links if link not in self.joint_above]
        if len(roots) != 1:
            raise ReadError(f"the file has {len(roots)} root links ({', '.join(roots[:3])}), expected one")
        self.root = roots[0]
        for link in links:
            self.path_from_root(link)  # raises an error for a cycle

    @property
    def joints(self) -> Collection[UrdfJoint]:
        """The joints, in file order."""
        return self.joint_above.values()

    @property
    def joint_names(self) -> set[str]:
        """The names of the joints."""
        return {joint.name for joint in self.joints}

    def path_from_root(self, link: str) -> TreePath:
        """Return the path from the root to a link.

        Raises:
            ReadError: the link is its own ancestor.
        """
        upwards: list[UrdfJoint] = []
        while link != self.root:
            if link not in self.joint_above or len(upwards) > len(self.joint_above):
                raise ReadError(f"link '{link}' is its own ancestor")
            upwards.append(self.joint_above[link])
            link = upwards[-1].parent
        return TreePath(self.root, tuple(reversed(upwards)))

    def path_from(self, link: str, placed: Collection[str]) -> TreePath:
        """Return the path to a link from its nearest ancestor among the links `placed`, which contain the root."""
        upwards: list[UrdfJoint] = []
        while not upwards or link not in placed:
            upwards.append(self.joint_above[link])
            link = upwards[-1].parent
        return TreePath(link, tuple(reversed(upwards)))

    def parents_first(self) -> list[str]:
        """Return the links, each after its parent."""
        return sorted(self.links, key=lambda link: len(self.path_from_root(link).joints))

    def link_pose(self, link: str, values: Mapping[str, float]) -> Array:
        """Return T_root_link (1, 4, 4) at joint values in rad or m; other joints are at zero."""
        path = self.path_from_root(link)
        path_values: list[Array] = []
        for joint in path.joints:
            path_values.append(np.array([values.get(joint.name, 0.0)]))
        return chain_end(path.steps, path_values, 1)
