"""Write the files of a result: page, pictures, JSON.

`twin.ui.report`, which draws them, is imported by name when the first is written. So a command that judges does not
depend on the user interface.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from twin.core.result import Result

if TYPE_CHECKING:
    from twin.api.robot import Robot
    from twin.validation.result import Report

_FOLDER_MODULE = "twin.ui.report.report_folder"
_PICTURE_MODULE = "twin.ui.report.robot_picture"
_SELFTEST_MODULE = "twin.ui.report.selftest_score"


def write_report(report: Report, folder: Path, selftest: Path, robot: Robot) -> None:
    """Write a report of a robot into a folder; it includes the score in the file `selftest` if that is of the robot."""
    scored = import_module(_SELFTEST_MODULE).with_selftest(report, selftest)

    def picture() -> object:
        return import_module(_PICTURE_MODULE).picture_of(robot, scored)

    import_module(_FOLDER_MODULE).write_report(scored, folder, robot=picture)


def write_result(result: Result, folder: Path, name: str = "") -> list[str]:
    """Write a result into a folder as `report_folder.write_result` does; return the names of page and picture."""
    return import_module(_FOLDER_MODULE).write_result(result, folder, name)
