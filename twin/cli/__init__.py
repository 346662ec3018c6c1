"""The command line: `twin <command> ...`.

The exit code is 0 for agreement or success, 1 for a disagreement, 2 if the check was impossible or the usage is wrong,
130 after Ctrl-C.
"""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # as in `typing`, whose import takes a while
if TYPE_CHECKING:
    from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    try:
        from twin.cli.command_line import run  # imported here, so that Ctrl-C during the import prints no traceback

        return run(argv)
    except KeyboardInterrupt:
        print("twin: interrupted", file=sys.stderr)
        return 130
