"""What a supervised process has from the process that supervises it; `twin.cli.supervisor` sets both numbers.

None: this process is not supervised.
"""

from __future__ import annotations

reading: int | None = None
"""Reading end of a pipe whose only writing end the supervisor has; it closes when that process ends."""

interrupts: int | None = None
"""Counter (eventfd) of the interrupts (SIGINT) that the supervisor received from elsewhere than this program."""
