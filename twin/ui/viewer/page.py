"""The whole page: the front with what surrounds its robots and with its panels."""

from __future__ import annotations

from typing import Any

import viser

from twin.model.mechanism import Mechanism
from twin.ui.viewer.front import Actor, Front
from twin.ui.viewer.panels import Panels
from twin.ui.viewer.scenery import Scenery


def open_page(
    title: str, actors: list[Actor], props: Mechanism | None, server: viser.ViserServer, **more: Any
) -> Front:
    """Return the front of a page, ready to run.

    Args:
        title: of the page.
        actors: the robots; the first is in hand.
        props: what stands around them; None: table and patient, on demand.
        server: viser's.
        more: see `Front`.
    """
    front = Front(title, actors, server, **more)
    front.furnish(lambda f: Scenery(f, props), Panels)
    return front
