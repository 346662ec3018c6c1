"""Export a robot again, so that an audit can compare the files of an export with what twin writes for the robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from twin.api.clip_protocols import clip_of_no_protocol, played_protocols
from twin.api.protocol_plan import plan
from twin.api.robot import Robot
from twin.api.robot_loading import load, names
from twin.core.errors import TwinError
from twin.core.progress import Progress
from twin.core.spatial import Array
from twin.core.version import __version__
from twin.exchange.audit import SCENE, ExportStatement, NewExport
from twin.exchange.audit.folder_files import find_files
from twin.exchange.formats import export_formats
from twin.exchange.write.bundle import PROOF, README, write_files
from twin.exchange.write.home_poses import home_poses
from twin.exchange.write.model_hash import model_hash
from twin.exchange.write.order_of_robot import order_of_robot

_QUICK_LOOKS = "*_ar.usdz"
"""Pattern of the files of AR Quick Look: an export of chosen protocols has one for each, another one only one."""

_HOME_DIFFERENCE = 1e-5
"""Maximum difference of two matrices of the pose of a link at rest, in m or without a unit."""

_NO_EXPORT = NewExport(None)
"""For files that are no export of the robot as it is: that they are not compared with one surprises nobody."""


class ReferenceExport:
    """Makes the new export of the robot that the files of an export state, or of a given robot."""

    def __init__(self, path: Path, robot: Robot | None, folder: Path, progress: Progress) -> None:
        """Keep what is needed; nothing is written before the call.

        Args:
            path: the audited folder or file.
            robot: the robot; None: the built-in robot that the files state.
            folder: an empty folder for the new export.
            progress: see `twin.api.Progress`.
        """
        self.path = path
        self.robot = robot
        self.folder = folder
        self.progress = progress

    def __call__(self, statement: ExportStatement) -> NewExport:
        """Return the new export, which has no folder if the files are not an export of the robot by this version.

        The files are one if they state the hash of the robot's mechanism and have its rest pose. So a robot of the same
        name with other numbers is never compared field by field, nor is a robot of a scene, which rests elsewhere.
        """
        if not _is_of_this_version(self.path):
            return _NO_EXPORT
        if (self.path / SCENE).is_file():
            # Loaded by name: only a scene needs the simulation of its organs.
            export_again = import_module("twin.api.scene_reference_export").export_scene_again
            return export_again(self.path, statement, self.folder, self._formats(), self.progress)
        for folder in (self.path.parent, self.path.parent.parent):
            if (folder / SCENE).is_file():
                return _NO_EXPORT  # robots of a scene have the rest pose and the motion that the scene gives them
        robot = self.robot or _built_in(statement)
        if robot is None or robot.files is None:
            return _NO_EXPORT
        own_protocols = list(robot.files.protocols())
        robot = robot.weighed()
        hashes = statement.model_hashes
        if hashes and model_hash(robot.mechanism) not in hashes:
            return _NO_EXPORT
        if hashes and statement.rests and not _one_rests_at(home_poses(robot.mechanism), statement.rests):
            return _NO_EXPORT
        return self._export_again(robot, own_protocols, statement)

    def _export_again(self, robot: Robot, own_protocols: Sequence[str], statement: ExportStatement) -> NewExport:
        """Export a robot with the protocols and the formats of the audited files."""
        other_clip = clip_of_no_protocol(statement.clip_formats, own_protocols, robot.name)
        if other_clip:
            return NewExport(None, f"clip '{other_clip}' has the name of no protocol of {robot.name}")
        protocols: Sequence[str] | None = played_protocols(statement.clip_formats, own_protocols)
        quick_look_count = len(list(self.path.glob(_QUICK_LOOKS)))
        if len(protocols) == len(own_protocols) and quick_look_count < 2:
            protocols = None  # all protocols, but not each by its name
        try:
            ordered = order_of_robot(robot, None, protocols, None, plan, self.progress)
        except TwinError as error:
            return NewExport(None, f"{robot.name} cannot be exported now: {error}")
        for clip in ordered.clips:
            reason = statement.reason_of_other_keys(clip.name, len(clip.times))
            if reason:
                return NewExport(None, reason)
        write_files(ordered, self.folder, self._formats(), self.progress)
        if not statement.key_counts:
            # README.txt lists the motions of the export, of which the other files say nothing
            (self.folder / README).unlink()
        return NewExport(self.folder)

    def _formats(self) -> list[str]:
        """Return the names of the formats of the audited files, in the order of an export."""
        audited: set[str] = set()
        folders = [self.path]
        if (self.path / SCENE).is_file():
            folders = [file.parent for file in self.path.glob(f"*/{README}")]
            # A robot without motion has no tracks, but the README.txt of its scene names the format.
            readme = self.path / README
            if readme.is_file():
                text = readme.read_text("utf-8", errors="replace")
                named = re.search(r"^Formats: ([\w, ]+)\.", text, re.MULTILINE)
                if named is not None:
                    audited.update(named[1].split(", "))
        for folder in folders:
            for name, files in find_files(folder).files.items():
                if files:
                    audited.add(name)
        return [format.name for format in export_formats() if format.name in audited]


def _built_in(statement: ExportStatement) -> Robot | None:
    """Return the built-in robot that most files state; None if there is none, or none states the mechanism."""
    if not statement.model_hashes:
        return None
    for name in sorted(statement.robots):
        if name in names():
            return load(name)
    return None


def _one_rests_at(home: Mapping[str, Array], rests: Iterable[Mapping[str, Array]]) -> bool:
    """Return whether one of several rest poses has the links at home."""
    for rest in rests:
        distances = [0.0]
        for link in home.keys() & rest.keys():
            distances.append(float(np.abs(home[link] - rest[link]).max()))
        if max(distances) < _HOME_DIFFERENCE:
            return True
    return False


def _is_of_this_version(path: Path) -> bool:
    """Return whether a README.txt or proof.json states this version of twin, or none states a version."""
    folder = path if path.is_dir() else path.parent
    versions = set()
    for name in (README, PROOF):
        for file in (*folder.glob(name), *folder.glob(f"*/{name}")):
            versions.update(re.findall(r"\btwin (\d+\.\d+\.\d+)", file.read_text("utf-8", errors="replace")))
    return not versions or __version__ in versions
