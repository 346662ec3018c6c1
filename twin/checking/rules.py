"""The rules of `twin check`. Their identifiers are stable: baselines and the settings of other programs name them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["note", "warning", "error"]

LEVELS: tuple[Level, ...] = ("note", "warning", "error")
"""Levels of findings, least severe first."""


@dataclass(frozen=True)
class Rule:
    """A rule.

    Attributes:
        id: "group/name"; stable.
        level: level of its findings: "error" is a defect, "warning" is implausible, "note" is for information.
        title: what is wrong, a few words.
        help: what a program does with it, and the way out.
    """

    id: str
    level: Level
    title: str
    help: str


_ALL = (
    Rule(
        "file/malformed",
        "error",
        "The file cannot be read as a robot",
        "Readers refuse the file, or read another robot. Correct the element that the message names.",
    ),
    Rule(
        "file/unjudged",
        "error",
        "The file could not be judged",
        "It exceeds the time, the memory or the size for a check, or needs code that is not allowed. Exit code 2.",
    ),
    Rule(
        "file/incomplete",
        "note",
        "The file needs arguments or packages that are not here",
        "State them by --arg and --packages to have the file checked.",
    ),
    Rule(
        "mesh/missing",
        "error",
        "A mesh file does not exist",
        "The link is invisible, or the file is refused. Add the mesh, or correct its path (case counts).",
    ),
    Rule(
        "mesh/outside",
        "note",
        "A mesh is in a package that is not in the folder",
        "State the folder of the package by --packages to have its meshes checked.",
    ),
    Rule(
        "file/unsupported",
        "note",
        "The file has something that twin does not read",
        "Joints, loops and masses of this file were not checked.",
    ),
    Rule("mesh/unreadable", "error", "A mesh file cannot be read", "Export the mesh again."),
    Rule(
        "inertia/mass",
        "error",
        "A mass is negative, or zero although the link has moments",
        "Engines refuse the link or become unstable. State the mass in kg, or remove <inertial>.",
    ),
    Rule(
        "inertia/positive",
        "error",
        "An inertia tensor is not positive definite",
        "No body has such a tensor. Compute it again, about the centre of mass; the sign of the products counts.",
    ),
    Rule(
        "inertia/triangle",
        "error",
        "Principal moments violate the triangle inequality",
        "No body has such moments: one is larger than the sum of the others. Compute the tensor again.",
    ),
    Rule(
        "inertia/rounded",
        "warning",
        "An inertia tensor is impossible, by no more than the rounding of its numbers",
        "MuJoCo and Gazebo refuse such a tensor. Print more digits.",
    ),
    Rule(
        "inertia/zero",
        "note",
        "A link states a mass or moments of zero",
        "Engines refuse a moving link without mass. Remove <inertial>, or state small positive numbers.",
    ),
    Rule(
        "inertia/centre",
        "warning",
        "A centre of mass is far outside of its link",
        "Often millimetres, or the frame of the CAD. State the centre in m, in the frame of the link.",
    ),
    Rule(
        "inertia/size",
        "warning",
        "The moments do not fit the size of the link",
        "Often g mm2 or kg mm2. State the tensor in kg m2.",
    ),
    Rule(
        "inertia/density",
        "warning",
        "The link is heavier than any metal of its size",
        "Often grams. State the mass in kg.",
    ),
    Rule(
        "limits/order",
        "error",
        "A lower limit is not below the upper limit",
        "The joint cannot move, or readers refuse the file. Exchange the limits, or make the joint fixed.",
    ),
    Rule(
        "limits/fixed",
        "warning",
        "The limits of a joint are equal",
        "The joint cannot move. State its range, or make it fixed.",
    ),
    Rule(
        "limits/missing",
        "error",
        "A joint lacks limits that its format requires",
        "The readers of ROS refuse the file. State lower, upper, velocity and effort, or make the joint continuous.",
    ),
    Rule(
        "limits/velocity",
        "warning",
        "The maximum speed of a joint is not positive",
        "Some programs take 0 as no limit, others never move the joint. State the speed in rad/s or m/s.",
    ),
    Rule(
        "limits/effort", "error", "The maximum effort of a joint is negative", "State the effort as a positive number."
    ),
    Rule(
        "limits/degrees",
        "warning",
        "Limits of an angle look like degrees",
        "The joint would make many turns. State the limits in rad, or make the joint continuous.",
    ),
    Rule(
        "limits/zero",
        "note",
        "Zero is outside the limits of a joint",
        "Programs that begin at zero violate the limits; state a posture in them.",
    ),
    Rule(
        "limits/soft",
        "warning",
        "The soft limits are not inside the limits",
        "Controllers stop the joint outside of its range. Correct safety_controller.",
    ),
    Rule("origin/degrees", "warning", "Angles of an origin look like degrees", "State rpy in rad."),
    Rule("axis/zero", "error", "The axis of a joint has length 0", "The joint has no direction. State a unit vector."),
    Rule(
        "mimic/leader",
        "error",
        "A mimic joint follows itself or a joint that does not exist",
        "Correct the name of the joint in <mimic>.",
    ),
    Rule(
        "names/duplicate",
        "error",
        "A name is used twice",
        "Readers keep one of the two elements, or refuse the file. Rename one.",
    ),
    Rule(
        "names/unknown",
        "error",
        "A joint names a link that does not exist",
        "Correct the name of the link, or add it.",
    ),
    Rule(
        "names/tree",
        "error",
        "The links do not form a tree",
        "A URDF has one root, and each other link one parent. Correct the parent or child of the joint.",
    ),
    Rule(
        "loops/open",
        "warning",
        "A loop does not close",
        "The two ends of a loop joint do not meet in any state near the drawn one. Correct the anchors.",
    ),
    Rule(
        "audit/fault",
        "warning",
        "An independent reader finds a fault",
        "`twin audit` of the file tells more.",
    ),
    Rule(
        "compare/kinematics",
        "warning",
        "Two descriptions of one robot differ in a link",
        "`twin compare` of the two files tells more. It is not known which of them is right.",
    ),
    Rule(
        "compare/property",
        "warning",
        "Two descriptions of one robot differ in limits, masses or drives",
        "`twin compare` of the two files tells more. It is not known which of them is right.",
    ),
    Rule(
        "compare/variant",
        "note",
        "Two files for one robot with different file names differ, as variants do",
        "If they should be the same, see `twin compare` of the two files.",
    ),
    Rule(
        "compare/different",
        "note",
        "Two files with the same names describe different robots",
        "If they should be one robot, see `twin compare` of the two files.",
    ),
    Rule(
        "compare/skipped",
        "note",
        "Two files for one robot cannot be compared, or not within the time for a pair",
        "Give more time by --seconds, or see `twin compare` of the two files.",
    ),
)

RULES = {rule.id: rule for rule in _ALL}
"""All rules by identifier."""
