"""Build the page: the front end with surroundings and panels."""

from __future__ import annotations

import threading

import viser

from twin.model.mechanism import Mechanism
from twin.ui.session.deformable_feed import Feed
from twin.ui.viewer.front import Front, QuestionTerminal, ShownRobot
from twin.ui.viewer.panels import Panels
from twin.ui.viewer.scenery import Scenery


def open_page(
    title: str,
    robots: list[ShownRobot],
    props: Mechanism | None,
    server: viser.ViserServer,
    stopping: threading.Event | None = None,
    *,
    local: bool = True,
    terminal: QuestionTerminal | None = None,
    feed: Feed | None = None,
) -> Front:
    """Return the front end of a page, ready to run.

    Args:
        title: title of the page.
        robots: the robots; the first is active.
        props: props of the scene; None: no props, but the user can show table and patient of the protocol.
        server: the server of viser.
        stopping: event that ends the loop of the page; None: only `close` ends it.
        local: whether only this machine can open the page; if not, the page may not write files.
        terminal: terminal that asks for confirmations; None: the page never changes a robot's files.
        feed: deformables; None: no deformables.
    """
    front = Front(title, robots, server, stopping, local=local, terminal=terminal, feed=feed)
    front.build_panels(lambda page_front: Scenery(page_front, props), Panels)
    return front
