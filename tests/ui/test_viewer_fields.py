"""What bends in the viewer, without a browser: vertices follow the clock, and what breaks is told and not drawn."""

from __future__ import annotations

import time

import numpy as np
import pytest

import twin
from made.cloth import Cloth
from twin.simulation.frame import WorldFrame
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.viewer.field_nodes import FieldNodes
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve


class Torn(Cloth):
    """Its vertices are lost after a second, and after a second and a half it fails."""

    def at(self, t):
        if t > 1.5:
            raise ZeroDivisionError
        return super().at(t) if t <= 1.0 else WorldFrame(t, {}, {"cloth": np.full((self.n**2, 3), np.nan)})


@pytest.fixture
def front():
    robot = twin.load("hibou")
    feed = Torn(n=5)
    front = open_page(
        "test",
        [ShownRobot(robot.name, robot.name, MovableRobot(robot))],
        None,
        serve("test", "127.0.0.1", 0),
        feed=feed,
    )
    yield front
    front.close()


@pytest.mark.slow
def test_a_field_follows_the_clock_and_one_that_breaks_is_told_once(front, monkeypatch):
    said = []
    monkeypatch.setattr(front, "say", lambda text, bad=False: said.append(text))
    assert front.clock.duration == front.feed.duration
    for t in (0.0, 0.5, 1.0):
        front.clock.seek(t)
        front.draw()
        mesh = front._fields._meshes["cloth"]
        wanted = front.feed.at(t).fields["cloth"]
        assert mesh.visible
        assert np.abs(np.asarray(mesh.vertices) - wanted).max() < 1e-5  # viser leaves out what moves less
        assert np.array_equal(mesh.faces, front.feed.surfaces["cloth"].triangles)
    front.clock.play()
    front._last = time.perf_counter() - 0.2
    front.step()  # time goes on: its vertices are lost
    assert not mesh.visible
    for t in (1.4, 1.8):
        front.clock.seek(t)
        front.draw()
    assert len(said) == 1
    assert "not finite" in said[0]
    front.clock.seek(0.5)
    front.draw()
    assert mesh.visible


class Stuck(Cloth):
    """It fails as soon as it follows a link."""

    touching = {"robot": ("tool",)}  # noqa: RUF012

    def follow(self, links, passed):
        raise ZeroDivisionError("no depth")


def test_an_error_in_following_links_is_told_once():
    server = serve("test", "127.0.0.1", 0)
    try:
        fields = FieldNodes(server, Stuck(n=5, duration=0.1))
        assert fields.show(0.0) == ""
        assert fields.follow(lambda _: {"tool": np.eye(4)}, 0.02)
        assert fields.show(0.0) == "ZeroDivisionError: no depth"
        assert not fields.follow(lambda _: {"tool": np.eye(4)}, 0.02)
        assert fields.show(0.0) == ""
    finally:
        server.stop()
