"""Content of an export: the mechanism with masses, its clips, and their sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.core.findings import Finding
from twin.core.provenance import AssumedCounts, Parameter, count_assumed
from twin.core.spatial import Array
from twin.exchange.write.clip import Clip
from twin.kinematics.compile import Kinematics
from twin.model.mechanism import Mechanism


@dataclass(frozen=True)
class ExportedScene:
    """A clip, and what judges it.

    Attributes:
        clip: the motion to write.
        mechanism: the mechanism with the trocar positions of the clip's protocol.
        judged: {link: T_world_link (k, 4, 4)} at the times of the clip by the reference model, which did not make the
            clip. For the motion of a stage, those of the stage.
    """

    clip: Clip
    mechanism: Mechanism
    judged: Mapping[str, Array]


@dataclass(frozen=True)
class Order:
    """All data for the writers and the README.

    Attributes:
        mechanism: the robot as in the CAD, with masses.
        scenes: for each protocol, a clip and its mechanism.
        quick_looks: names of the clips that are written as .usdz: the first as <robot>_ar.usdz, all others as
            <robot>_<clip>_ar.usdz.
        inputs: (displayed path, sha256) of every source file.
        assumed: "name: reason" for each assumed (unpublished) number of the robot; numbers of protocols are in clips.
        title, source: title and source of the robot.
        findings: findings on the robot.
        equations: the compiled equations; None if there are none.
        gaps: (lower joint, upper joint, minimum distance in m) of joints on one rail.
        numbers: parameters of the robot and of its drawing.
    """

    mechanism: Mechanism
    scenes: tuple[ExportedScene, ...]
    quick_looks: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    title: str
    source: str
    findings: tuple[Finding, ...]
    equations: Kinematics | None = None
    gaps: tuple[tuple[str, str, float], ...] = ()
    numbers: tuple[Parameter, ...] = ()

    @property
    def assumed_counts(self) -> AssumedCounts:
        """Numbers of assumed values, as all pages and commands count them."""
        of_protocols = 0
        for clip in self.clips:
            of_protocols += len(clip.assumed)
        return replace(count_assumed(self.numbers), protocol=of_protocols)

    @property
    def clips(self) -> tuple[Clip, ...]:
        """The clips of all scenes, one for each protocol."""
        return tuple(scene.clip for scene in self.scenes)

    @property
    def elsewhere(self) -> tuple[ExportedScene, ...]:
        """Scenes whose trocar positions differ from the CAD; each of these scenes needs a separate file."""
        return tuple(filter(self._is_elsewhere, self.scenes))

    def _is_elsewhere(self, scene: ExportedScene) -> bool:
        for name, position in self.mechanism.trocar_places.items():
            in_scene = scene.mechanism.trocar_at(name)
            if not np.array_equal(in_scene, position):
                return True
        return False
