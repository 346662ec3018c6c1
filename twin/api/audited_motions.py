"""Check bounds along protocols, as a certificate of a proof states them, at sampled times."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin.api.motion_proof import timed_path
from twin.api.path_samples import sampled
from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.json_types import JsonMapping
from twin.core.progress import Progress, silent
from twin.proof.motion import value_groups as groups
from twin.reference import ReferenceModel

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from twin.core.spatial import Array
    from twin.model.joint import Joint
    from twin.model.mechanism import Mechanism
    from twin.proof.motion.path import TimedPath, TimedPhase


class SampledMotions:
    """Plans the protocols of a certificate and samples their values, without the prover; see `MotionSampler`."""

    def __init__(self, robot: Robot, progress: Progress = silent) -> None:
        """Keep the robot, whose protocols are planned."""
        self.robot = robot
        self.progress = progress

    def extremes(self, entry: JsonMapping) -> dict[tuple[str, str], tuple[float, float, int]]:
        """Return {(kind, value): (smallest, largest sample, number of those without a value)} of an entry's protocol.

        Both are NaN if no sample is a number, as the distance from an RCM that no phase has.

        Raises:
            TwinError: the robot has no such protocol, or it cannot be planned; or its file, the path or the joints in
                the entry are not those that were proved.
        """
        name = str(entry["protocol"])
        protocol = self.robot.protocol(name)
        if self.robot.files is not None:
            file = self.robot.files.protocol(name)
            if hashlib.sha256(file.read_bytes()).hexdigest() != entry["protocol_sha256"]:
                raise TwinError(f"{file.name} is not the file of the protocol that was proved: its SHA-256 is another")
        robot = self.robot.bound(protocol)
        trajectory = plan(robot, protocol, self.progress)
        mechanism = robot.mechanism
        T_tool_frame = mechanism.frame_in_tool(trajectory.frame)
        path = timed_path(trajectory, protocol, robot.path_kinematics(), T_tool_frame)
        if "path" in entry:
            _compare_path(entry["path"]["phases"], path)
            _compare_moved_frame(entry["path"], path)
            _compare_joints(entry["mechanism"], mechanism)
            _compare_driven(entry["mechanism"], mechanism)
        values = sampled(ReferenceModel(mechanism), trajectory, path).values
        extremes = {}
        for (group, name), numbers in values.items():
            finite_numbers = numbers[~np.isnan(numbers)]
            missing_count = len(numbers) - len(finite_numbers)
            if group == groups.RCM:
                # outside the phases with an RCM there is no distance to know
                missing_count = 0
            smallest = math.nan
            largest = math.nan
            if len(finite_numbers):
                smallest = float(finite_numbers.min())
                largest = float(finite_numbers.max())
            extremes[group, name] = (smallest, largest, missing_count)
        return extremes


def _compare_path(phases: Sequence[JsonMapping], path: TimedPath) -> None:
    """Raise an error unless the phases of a certificate are those of a planned path."""
    stated_names = [phase["name"] for phase in phases]
    planned_names = [phase.name for phase in path.phases]
    if stated_names != planned_names:
        raise TwinError("its phases are not those of the plan")
    for stated, phase in zip(phases, path.phases, strict=True):
        if not _is_same_phase(stated, phase):
            raise TwinError(f"phase '{phase.name}' is not that of the plan")


def _is_same_phase(stated: JsonMapping, phase: TimedPhase) -> bool:
    """Return whether a phase of a certificate has the path, the timing and the RCM of a planned phase."""
    rcm = stated["rcm"]
    if stated["enforced"] != phase.enforced or (rcm is None) != (phase.rcm is None):
        return False
    # (stated in the certificate, planned)
    pairs = [
        (np.array(stated["series"], float).T, phase.coefficients),
        (stated["grid"], phase.grid),
        (stated["rates"], phase.rates),
        ([stated["tip_speed"], stated["rotation_speed"]], [phase.tip_speed, phase.rotation_speed]),
        (stated["averaged_s"], phase.smoothing),
    ]
    if phase.rcm is not None:
        pairs.append((rcm, phase.rcm))
    for stated_values, planned_values in pairs:
        stated_array = np.array(stated_values, float)
        planned_array = np.array(planned_values, float)
        if stated_array.shape != planned_array.shape:
            return False
        # the search for a path may end in other last digits on another processor
        if not np.allclose(stated_array, planned_array, rtol=_PLANNED_DIFFERENCE, atol=_PLANNED_DIFFERENCE):
            return False
    return True


def _compare_moved_frame(stated: JsonMapping, path: TimedPath) -> None:
    """Raise an error unless the moved frame and the shaft of a certificate are those of a planned path."""
    pairs = (
        ("the moved frame", stated["frame_in_tool"], path.T_tool_frame[:3]),
        ("the shaft", stated["shaft"], path.shaft_axis),
    )
    for subject, stated_numbers, planned_numbers in pairs:
        if not _equal(stated_numbers, planned_numbers, _PLANNED_DIFFERENCE):
            raise TwinError(f"{subject} is not that of the plan")


def _compare_joints(stated: JsonMapping, mechanism: Mechanism) -> None:
    """Raise an error unless the joints, the base and the tool of a certificate are those of a mechanism."""
    joints = [*stated["tree"], *stated["loops"]]
    stated_names = [joint["name"] for joint in joints]
    cad_names = [joint.name for joint in (*mechanism.tree, *mechanism.loops)]
    if stated_names != cad_names or len(stated["tree"]) != len(mechanism.tree):
        raise TwinError("its joints are not those of the CAD")
    for joint in joints:
        cad_joint = mechanism.joint(joint["name"])
        if not _is_same_joint(joint, cad_joint):
            raise TwinError(f"joint {cad_joint.name} is not that of the CAD")
    tool = mechanism.frame(mechanism.tool)
    if stated["base"] != mechanism.base:
        raise TwinError(f"its base is not {mechanism.base}")
    if stated["tool"]["body"] != tool.body or not _equal(stated["tool"]["frame"], tool.T_body_frame[:3]):
        raise TwinError("its tool is not that of the CAD")


def _is_same_joint(stated: JsonMapping, cad_joint: Joint) -> bool:
    """Return whether a joint of a certificate has the type, the bodies and the frames of a joint of the CAD."""
    bodies = (cad_joint.parent, cad_joint.child)
    if stated["type"] != cad_joint.type or (stated["parent"], stated["child"]) != bodies:
        return False
    # frames are copied into the certificate, so they are equal; only the inverse was computed, by other code
    T_joint_child = spatial.inverse(cad_joint.T_child_joint)
    return (
        _equal(stated["on_parent"], cad_joint.T_parent_joint[:3])
        and _equal(stated["on_child"], cad_joint.T_child_joint[:3])
        and _equal(stated["child_in_joint"], T_joint_child[:3], _COMPUTED_DIFFERENCE)
    )


def _compare_driven(stated: JsonMapping, mechanism: Mechanism) -> None:
    """Raise an error unless the driven coordinates and the couplings of a certificate are those of a mechanism."""
    first: dict[str, int] = {}  # coordinate of each joint, or the first of them
    count = 0
    for joint in mechanism.tree:
        first[joint.name] = count
        count += _COORDINATES_OF_TYPE[joint.type]
    driven = [first[joint.name] for joint in mechanism.active]
    if list(stated["driven"]) != driven:
        raise TwinError("its driven joints are not those of the CAD")
    if len(stated["couplings"]) != len(mechanism.couplings):
        raise TwinError("its couplings are not those of the CAD")
    for row, coupling in zip(stated["couplings"], mechanism.couplings, strict=True):
        scale = 1.0
        if mechanism.joint(coupling.joints[0]).is_angle:
            scale = _COUPLING_LENGTH  # the certificate states couplings of turns as lengths
        cad_row = scale * np.array([*coupling.ratios, coupling.total])
        coordinates = [first[name] for name in coupling.joints]
        has_same_joints = list(row["coordinates"]) == coordinates
        if not has_same_joints or not _equal([*row["ratios"], row["total"]], cad_row, _COMPUTED_DIFFERENCE):
            raise TwinError(f"coupling {coupling.name} is not that of the CAD")


def _equal(stated: ArrayLike, expected: Array, tolerance: float = 0.0) -> bool:
    """Return whether numbers of a certificate are those of the CAD or the plan."""
    numbers = np.array(stated, float)
    return numbers.shape == expected.shape and bool(np.abs(numbers - expected).max(initial=0.0) <= tolerance)


_COORDINATES_OF_TYPE = {"revolute": 1, "prismatic": 1, "cylindrical": 2, "spherical": 3, "fixed": 0}
"""{type of a joint: number of its coordinates}."""

_COMPUTED_DIFFERENCE = 1e-14
"""Largest difference, in m or without a unit, of numbers that are computed: of inverses and of scaled ratios."""

_PLANNED_DIFFERENCE = 1e-9
"""Largest difference of numbers that are planned anew."""

_COUPLING_LENGTH = 0.1
"""Length in m by which a certificate multiplies couplings of turns."""
