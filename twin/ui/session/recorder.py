"""Write the ticks of a World to a session file while the World runs."""

from __future__ import annotations

import logging
from pathlib import Path

from twin.core.errors import TwinError
from twin.simulation.session.session_file import LARGEST, LONGEST, Head, SessionWriter
from twin.simulation.session.tape import Tape


class Recorder:
    """A session file to which the ticks of a World are appended.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path, head: Head, tape: Tape) -> None:
        """Create the file; `tape` is the last block of the World, and `head` describes this World.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        self.path, self._tape = path, tape
        self._writer: SessionWriter | None = SessionWriter(path, head)

    @property
    def running(self) -> bool:
        """Whether ticks are still written: the file is not closed, is not full, and no write has failed."""
        return self._writer is not None

    def write(self, ticks: int) -> None:
        """Write ticks from the tape until the file has `ticks` ticks; an error ends the recording, not the World."""
        writer, rows = self._writer, self._tape.take()
        if writer is None:
            return
        rows = rows[: ticks - writer.ticks]  # without the row of a failed tick
        try:
            if len(rows):
                writer.add(rows)
            if writer.full:
                writer.close()
                text = "the recording has reached its maximum of %g s or %g GB: %s is complete, and recording has ended"
                logging.getLogger(__name__).warning(text, LONGEST, LARGEST / 1e9, writer.path)
                self._writer = None
        except TwinError as error:
            writer.abandon()
            self._writer = None
            logging.getLogger(__name__).error("the session is no longer recorded: %s", error)

    def close(self, ticks: int) -> None:
        """Write the remaining ticks until the file has `ticks` ticks, and complete the file."""
        self.write(ticks)
        writer, self._writer = self._writer, None
        try:
            if writer is not None:
                writer.close()
        except TwinError as error:
            logging.getLogger(__name__).error("the session is incomplete: %s", error)
