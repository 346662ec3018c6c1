"""Log of a campaign: one line of JSON for each session, so that an interrupted campaign can be resumed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin.core.errors import OutputError


class Log:
    """The log file of a campaign; its first line identifies the campaign.

    Attributes:
        rows: result of each session in the log, by the index of the session.
    """

    def __init__(self, path: Path, head: Mapping[str, Any]) -> None:
        """Open or create a log; an incomplete last line is removed.

        Raises:
            OutputError: the file is the log of another campaign, or not a log.
        """
        self.path, self.rows = path, dict[int, dict[str, Any]]()
        path.parent.mkdir(parents=True, exist_ok=True)
        data = path.read_bytes() if path.is_file() else b""
        whole = data[: data.rfind(b"\n") + 1]
        first, *lines = whole.decode("utf-8", "replace").splitlines() or [""]
        if whole:
            try:
                known = json.loads(first)
                rows = [json.loads(line) for line in lines]
                self.rows = {int(row["index"]): row for row in rows}
            except (ValueError, KeyError, TypeError) as error:
                raise OutputError(f"{path} is not the log of a campaign ({error}); give another --out") from None
            if known != dict(head):
                differ = ", ".join(k for k in head if not isinstance(known, dict) or known.get(k) != head[k])
                raise OutputError(f"{path} is the log of another campaign (other {differ}); give another --out")
        self._file = path.open("r+b" if data else "w+b")
        self._file.truncate(len(whole))
        self._file.seek(len(whole))
        if not whole:
            self._write(head)

    def add(self, row: dict[str, Any]) -> None:
        """Append the line of a session; when this function returns, the line is on the disk."""
        self.rows[int(row["index"])] = row
        self._write(row)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, row: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(row).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
