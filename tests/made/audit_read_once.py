"""Audits of many changed copies of one export: the files that a copy shares with the export are read only once.

A copy has hard links to the files that are not changed, so that these are known by their inodes.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import twin
import twin.api.export_audit
import twin.exchange.audit as audits
from twin.api.reference_export import ReferenceExport
from twin.core.foreign import admit as admission
from twin.core.foreign.admit import admit_together
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.folder_files import FolderFiles
from twin.exchange.audit.ledger import Ledger, guarded
from twin.exchange.audit.reader_context import Context
from twin.exchange.audit.report import AuditReport
from twin.exchange.formats import audit_formats
from twin.exchange.xacro import XacroSettings

FOLLOWING = ("urdf", "mjcf", "sdf")
"""Formats whose readers play the joint values of the tracks: they are read again if a track is another."""


class ReadOnce:
    """Reader of copies of one export.

    Attributes:
        good: the folder of the export.
    """

    def __init__(self, good: Path) -> None:
        self.good = good
        self._read: dict[tuple[Any, ...], bytes] = {}
        self._own = {_identity(file) for file in good.rglob("*") if file.is_file()}

    def audit(self, folder: Path, robot: str | None) -> AuditReport:
        """Return what `twin.audit` returns for a copy of the export, without the comparison with a new export.

        That one finds every change by itself, and would hide what the other checks do not find.
        """
        with (
            mock.patch.object(audits, "_read", self._read_folder),
            mock.patch.object(ReferenceExport, "__call__", return_value=audits.NewExport(None)),
        ):
            if robot is None:
                return twin.audit(folder)
            with (
                mock.patch.object(twin.api.export_audit, "_truth", _truth_once),
                mock.patch.object(twin.api.export_audit, "_states", _states_once),
            ):
                return twin.audit(folder, _loaded_once(robot))

    def _read_folder(
        self, found: FolderFiles, tell: Any, states: Any, xacro: XacroSettings
    ) -> Iterator[tuple[Ledger, Content | None]]:
        """Yield (ledger, content) of each file, as `twin.exchange.audit` does."""
        tracks = _inodes(found.root, "tracks")
        context = Context(states=states, xacro=xacro)
        for format in audit_formats():
            for path in found.files.get(format.name, []):
                key: tuple[Any, ...] = (found.name(path), _inodes(path) if path.is_dir() else _identity(path))
                if path.suffix.startswith(".usd") and path.suffix != ".usdz":
                    key += _inodes(path.parent)  # a stage reads its layers
                if format.name in FOLLOWING:
                    key += (tracks, states is None)
                if path.parent.name == "tracks":
                    key += (_inodes(path.parent),)
                if key not in self._read:
                    if format.guard:
                        context.admitted = admit_together([path])
                    ledger = Ledger(found.name(path), code=format.code)
                    context.models = [file.stem for file in found.files[format.name]]
                    unchanged = self._is_unchanged(path)
                    admitting = admission.run
                    if unchanged and not path.suffix.startswith(".usd") and found.root != self.good:
                        admitting = _admitted  # its parser has read the file in another process before
                    with np.errstate(all="ignore"), mock.patch.object(admission, "run", admitting):
                        content = guarded(partial(audits._filled, format, context), path, ledger)
                    if unchanged:
                        self._read[key] = pickle.dumps((ledger, content))
                else:
                    ledger, content = pickle.loads(self._read[key])
                if content is not None and content.is_track:
                    context.tracks.append(content)
                yield ledger, content

    def _is_unchanged(self, path: Path) -> bool:
        files = [path]
        if path.is_dir():
            files = [file for file in path.rglob("*") if file.is_file()]
        return all(_identity(file) in self._own for file in files)


def _admitted(path: Path, format: str) -> None:
    """Read no file in another process."""


@cache
def _loaded_once(robot: str) -> Any:
    return twin.load(robot)


@cache
def _planned_once(robot: Any, protocol: str) -> Any:
    return _PLAN(robot, robot.protocol(protocol))


_PLAN = twin.api.export_audit.plan
_STATES = twin.api.export_audit._states
_TRUTH = twin.api.export_audit._truth
_drawn: dict[str, Any] = {}
_truths: dict[tuple[Any, ...], Any] = {}


def _states_once(mechanism: Any) -> Any:
    """Return the states of a mechanism, drawn once."""
    if mechanism.name not in _drawn:
        _drawn[mechanism.name] = _STATES(mechanism)
    return _drawn[mechanism.name]


def _truth_once(robot: Any, path: Path, progress: Any, xacro: Any) -> Any:
    """Return the expected motions at the times in a folder, computed once for each set of times."""
    times = audits.key_times(path, xacro)
    key = (robot.name, *((clip, instants.tobytes()) for clip, instants in times.items()))
    if key not in _truths:
        with mock.patch.object(twin.api.export_audit, "plan", lambda r, p, _: _planned_once(r, p.name)):
            _truths[key] = _TRUTH(robot, path, progress, xacro)
    return _truths[key]


def _identity(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_ino, stat.st_mtime_ns


def _inodes(*parts: str | Path) -> tuple[Any, ...]:
    folder = Path(*parts)
    return tuple((p.relative_to(folder).as_posix(), *_identity(p)) for p in sorted(folder.rglob("*")) if p.is_file())
