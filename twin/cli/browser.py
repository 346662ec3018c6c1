"""Open a written page in the user's browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path


def open_file(page: Path) -> str:
    """Open a file in a browser; return "" or the reason why this is not possible.

    Without a display, Python would start a browser of the terminal, which waits for keys; none is opened then.
    """
    linux = sys.platform.startswith("linux")
    if linux and not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        return f"there is no display to open it on; open {page} in a browser"
    if not webbrowser.open(page.resolve().as_uri()):
        return f"no browser was found; open {page} in one"
    return ""
