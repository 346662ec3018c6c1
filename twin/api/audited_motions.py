"""Check bounds along protocols, as a certificate of a proof states them, at sampled times."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.api.judge import plan
from twin.api.motion_proof import timed_path
from twin.api.path_samples import sampled
from twin.api.robot import Progress, Robot, silent
from twin.core.errors import TwinError
from twin.reference import ReferenceModel


class SampledMotions:
    """Plans the protocols of a certificate and samples their values, without the prover; see `MotionSamples`."""

    def __init__(self, robot: Robot, progress: Progress = silent) -> None:
        """Keep the robot, whose protocols are planned."""
        self.robot = robot
        self.progress = progress

    def extremes(self, entry: Mapping[str, Any]) -> dict[tuple[str, str], tuple[float, float, int]]:
        """Return {(kind, value): (smallest, largest sample, number of those without a value)} of an entry's protocol.

        Both are NaN if no sample is a number, as the distance from an RCM that no phase has.

        Raises:
            TwinError: the robot has no such protocol, or it cannot be planned; or its file is not the one that was
                proved.
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
        values = sampled(ReferenceModel(mechanism), trajectory, path).values
        found = {}
        for key, numbers in values.items():
            # outside the phases with an RCM there is no distance, which is nothing unknown
            known = numbers[~np.isnan(numbers)]
            unknown = 0 if key[0] == "RCM" else len(numbers) - len(known)
            smallest, largest = (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)
            found[key] = smallest, largest, unknown
        return found
