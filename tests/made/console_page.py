"""Helpers for tests of the console's page: joints, tips in the picture, waiting for rest."""

from __future__ import annotations

import time

import numpy as np

from made import headset_page as headset

ARMS = {"right": "psm1", "left": "psm2"}
NAMES = ("psm1", "psm2", "ecm")
JAW = 6
PAD = """
window.felt = [];
window.pad = {id: 'a pad of the test', connected: false, mapping: 'standard', axes: [0, 0, 0, 0],
  buttons: Array.from({length: 17}, () => ({pressed: false, value: 0})),
  vibrationActuator: {playEffect: (kind) => { window.felt.push(kind); return Promise.resolve('complete'); }}};
navigator.getGamepads = () => [null, window.pad];
"""
"""Script of a page with a gamepad that the test moves."""


def joints(page):
    """Return the joint values of each robot in the newest drawn frame."""
    return [np.array(q) for q in page("twin.app.model.robots.map(r => [...r.frame.q])")]


def moved(before, after):
    """Return the names of the robots whose joints have moved; jaws are ignored."""
    pairs = zip(NAMES, before, after, strict=True)
    return {n for n, a, b in pairs if np.abs(a - b)[: JAW if n != "ecm" else 4].max() > 1e-3}


def rest(page):
    """Wait until no joint moves; return the joint values of each robot."""
    last = joints(page)
    for _ in range(200):
        seq = page("twin.app.model.newest.seq")
        time.sleep(0.3)
        page.until(f"twin.app.model.newest.seq > {seq + 3}", "frames that are newer")  # a busy page draws few frames
        now = joints(page)
        if all(np.array_equal(a, b) for a, b in zip(last, now, strict=True)):
            return now
        last = now
    raise AssertionError("the robots do not come to rest")


def let_go(page):
    """Release both hands; return the joint values of each robot at rest."""
    page("twin.app.console.pens.drop()")
    page.until("twin.app.model.console.owner === null", "the hands are free")
    return rest(page)


def tips(page):
    """Return (x, y in pixels of the endoscope's picture, depth in m) of each tip, by side."""
    return {
        side: page(
            f"(() => {{const c = twin.app.console, t = c.tip('{side}'), v = c.views.project(t, 'scope');"
            " return [v.x, v.y, -t.applyMatrix4(c.views.scope.matrixWorld.clone().invert()).z]})()"
        )
        for side in ARMS
    }


def seen(page, side):
    """Return the position (3,) in m of a tip in the frame of the lens: right, up, towards the lens."""
    return np.array(
        page(
            f"(() => {{const c = twin.app.console; c.views.scope.updateWorldMatrix(true, false);"
            f" return c.tip('{side}').applyMatrix4(c.views.scope.matrixWorld.clone().invert()).toArray()}})()"
        )
    )


@headset.contextmanager
def console(browser, url, **options):
    """Yield the page of a console that has received its first state."""
    with headset.shown(browser, url, **options) as page:
        page.until("twin.app.model.console !== null && twin.app.console?.tip('right') != null", "the console")
        yield page
