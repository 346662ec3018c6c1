"""Build the page: the front end with surroundings and panels."""

from __future__ import annotations

from typing import Any

import viser

from twin.model.mechanism import Mechanism
from twin.ui.viewer.front import Front, ShownRobot
from twin.ui.viewer.panels import Panels
from twin.ui.viewer.scenery import Scenery


def open_page(
    title: str, robots: list[ShownRobot], props: Mechanism | None, server: viser.ViserServer, **more: Any
) -> Front:
    """Return the front end of a page, ready to run.

    Args:
        title: title of the page.
        robots: the robots; the first is active.
        props: props of the scene; None: no props, but the user can show table and patient of the protocol.
        server: the server of viser.
        more: further arguments of `Front`.
    """
    front = Front(title, robots, server, **more)
    front.build_panels(lambda f: Scenery(f, props), Panels)
    return front
