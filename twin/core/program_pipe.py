"""A pipe whose only writing end the process has that supervises this program; it closes when that process ends."""

from __future__ import annotations

reading: int | None = None
"""File descriptor of the reading end, set by `twin.cli.supervisor`; None: this process is not supervised."""
