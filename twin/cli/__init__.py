"""The command line: `twin <command> ...`.

The exit code is 0 for agreement or success, 1 for a disagreement, 2 if the check was impossible or the usage is wrong,
130 after Ctrl-C.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # as in `typing`, whose import takes a while
if TYPE_CHECKING:
    from collections.abc import Sequence

_STDERR = 2
"""File descriptor of the standard error."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; without `argv`, that of the command line, in a supervised process."""
    if argv is not None:
        return _command(argv)
    if sys.stderr is None:
        _open_stderr()
    if sys.getfilesystemencoding() == "ascii":
        # With LC_ALL=C and PYTHONUTF8=0, USD and mesh libraries cannot read file names that are not ASCII.
        os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])
    from twin.cli.supervisor import supervised

    return supervised(lambda: _command(sys.argv[1:]))


def _open_stderr() -> None:
    """Open a standard error that was closed, as by `twin ... 2>&-`: `print` would write errors to the standard output.

    A pipe or file that this program opens would otherwise take its place, and get what native libraries print.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    if null != _STDERR:
        os.dup2(null, _STDERR)
        os.close(null)
    sys.stderr = os.fdopen(_STDERR, "w", closefd=False)


def _command(argv: Sequence[str]) -> int:
    try:
        from twin.cli.command_line import run  # imported here, so that Ctrl-C during the import prints no traceback

        return run(argv)
    except KeyboardInterrupt:
        print("twin: interrupted", file=sys.stderr)
        return 130
