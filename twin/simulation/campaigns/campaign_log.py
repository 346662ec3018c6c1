"""Log of a campaign: one line of JSON for each session, so that an interrupted campaign can be resumed."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from pathlib import Path

from twin.core.errors import OutputError
from twin.core.json_types import JsonMapping, JsonObject


class Log:
    """The log file of a campaign; its first line identifies the campaign.

    Attributes:
        rows: result of each session in the log; the keys are the indices of the sessions.
    """

    def __init__(self, path: Path, head: JsonMapping) -> None:
        """Open or create a log; an incomplete last line is removed.

        Raises:
            OutputError: the file is the log of another campaign, or not a log; another process writes to the file; or
                the file cannot be written.
        """
        self.path = path
        self.rows: dict[int, JsonObject] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b")
        except OSError as error:
            raise OutputError(f"cannot write to {path}: {error.strerror or error}; give another --out") from error
        try:
            self._resume(head)
        except BaseException:
            self.close()
            raise

    def _resume(self, head: JsonMapping) -> None:
        """Lock the file, and read the lines that it has; write the first line of a new log."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"another campaign is running with the log {self.path}: wait for its end, or give another --out"
            ) from None
        except OSError:  # a file system without locks: only there, two campaigns could write to one log
            pass
        self._file.seek(0)
        data = self._file.read()
        # An interrupted write leaves a line without its end.
        complete = data[: data.rfind(b"\n") + 1]
        if complete:
            self._read(complete.decode("utf-8", "replace"), head)
        elif not _line(head).startswith(data):
            raise OutputError(f"{self.path} is not the log of a campaign; give another --out")
        # the next line begins where the last complete one ends
        self._file.truncate(len(complete))
        if not complete:
            self._write(head)

    def _read(self, text: str, head: JsonMapping) -> None:
        """Read the complete lines of a log; raise `OutputError` if it is not the log of the campaign `head`."""
        first, *lines = text.splitlines() or [""]
        try:
            written_head = json.loads(first)
            for line in lines:
                row = json.loads(line)
                self.rows[int(row["index"])] = row
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise OutputError(f"{self.path} is not the log of a campaign ({error}); give another --out") from None
        if written_head != dict(head):
            differences = ", ".join(_different_keys(head, written_head))
            raise OutputError(f"{self.path} is the log of another campaign (other {differences}); give another --out")

    def add(self, row: JsonObject) -> None:
        """Append the line of a session; when this function returns, the line is on the disk.

        Raises:
            OutputError: the file cannot be written.
        """
        self._write(row)
        self.rows[int(row["index"])] = row

    def close(self) -> None:
        """Close the file; a line that could not be written is lost."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, row: JsonMapping) -> None:
        try:
            self._file.write(_line(row))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError(
                f"cannot write to {self.path}: {error.strerror or error}; run the same command again to go on"
            ) from error


def _different_keys(head: JsonMapping, written_head: object) -> list[str]:
    """Return the keys with different values, in the order of `head`, then the keys that only the log has."""
    written = written_head if isinstance(written_head, dict) else {}
    keys = []
    for key in {**head, **written}:
        if key not in head or written.get(key) != head[key]:
            keys.append(key)
    return keys


def _line(row: JsonMapping) -> bytes:
    """Return a line of the log with its end."""
    return json.dumps(row).encode() + b"\n"
