"""The job of judging one file, as a process receives it."""

from __future__ import annotations

from dataclasses import dataclass

from twin.checking.descriptions import DescriptionFile, FolderContent
from twin.exchange.xacro import XacroSettings


@dataclass(frozen=True)
class JudgeJob:
    """A file to judge.

    Attributes:
        description: the file.
        tree: what the checked folder contains: packages with meshes, and files that others include.
        xacro: how a xacro is expanded.
    """

    description: DescriptionFile
    tree: FolderContent
    xacro: XacroSettings
