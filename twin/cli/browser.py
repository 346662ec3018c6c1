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
    is_linux = sys.platform.startswith("linux")
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if is_linux and not has_display:  # other systems always have one
        return f"there is no display to open it on; open {page} in a browser"
    if not webbrowser.open(page.resolve().as_uri()):
        return f"no browser was found; open {page} in one"
    return ""
