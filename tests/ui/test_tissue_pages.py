"""Soft organs in the pages and in the stream: they follow the displayed links, whole and in time."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import twin
from made import organs as made
from made.streaming import http, joined, serving
from twin import api
from twin.cli import scenes
from twin.core.units import MM, srgb
from twin.simulation.frame import WorldFrame
from twin.ui.headset import served_content
from twin.ui.headset.scene_frame import SceneFrame
from twin.ui.session.deformable_feed import FieldSurface
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.organ_feeds import OrganFeed
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve

ROBOT = "hibou"
"""Any robot: one whose CAD is read fast."""


class Leaf:
    """A triangle that stays at the origin of the tool's link."""

    duration = 0.0

    def __init__(self, robot):
        mechanism = robot.mechanism
        self.touching = {robot.name: [mechanism.frame(mechanism.tool).body]}
        self.surfaces = {"leaf": FieldSurface(np.array([[0, 1, 2]]))}
        self.calls, self.v = [], np.eye(3)

    def follow(self, links, passed):
        ((robot, (link,)),) = self.touching.items()
        before, self.v = self.v, np.eye(3) + links[robot][link][:3, 3]
        self.calls.append(passed)
        return not np.array_equal(before, self.v)

    def at(self, t):
        return WorldFrame(t, {}, {"leaf": self.v})


def test_organs_in_the_stream_follow_the_displayed_links():
    robot = twin.load(ROBOT)
    leaf = Leaf(robot)

    async def go():
        async with (
            serving(lambda: served_content.of_robot(robot, ROBOT, None, False, leaf)) as s,
            joined(s.port) as peer,
        ):
            for posture in ("home", *robot.mechanism.postures):
                if posture == "home":
                    continue
                await peer.ask("posture", name=posture)
            await asyncio.sleep(0.3)
            await peer.until(lambda: sum(leaf.calls) > 0.2)
            frame = peer.frames[-1]
            assert isinstance(frame, SceneFrame)
            name = leaf.touching[robot.name][0]
            T = robot.reference().solve(frame.robots[0].q).link_poses[name]
            np.testing.assert_allclose(frame.fields[0], np.eye(3) + T[:3, 3], atol=2e-5)

    asyncio.run(go())


def test_organs_in_the_viewer_follow_the_displayed_links():
    robot = twin.load(ROBOT)
    leaf = Leaf(robot)
    front = open_page(
        "test", [ShownRobot(ROBOT, ROBOT, MovableRobot(robot))], None, serve("test", "127.0.0.1", 0), feed=leaf
    )
    try:
        name = leaf.touching[ROBOT][0]
        for posture in robot.mechanism.postures:
            front.robots[0].movable.go_to_posture(posture)
            front.step()
            front.step()
            T = front.robots[0].movable.assembly.link_poses[name]
            assert front._fields is not None
            mesh = front._fields._meshes["leaf"]
            np.testing.assert_allclose(mesh.vertices, np.eye(3) + T[:3, 3], atol=1e-6)
            assert mesh.color == tuple(round(255 * srgb(c)) for c in leaf.surfaces["leaf"].color)
    finally:
        front.close()


@pytest.mark.slow
def test_feed_of_organs_dents_them_and_lets_them_return():
    rods = made.Rods(made.abdomen())
    feed = OrganFeed(rods.tissues, rods.links)
    assert set(feed.surfaces) == {t.name for t in rods.tissues}

    def links(depth):
        return {t.name: {"rod": T} for t, T in zip(rods.tissues, rods.poses(depth), strict=True)}

    assert not feed.follow(links(0), 0.0)
    for k in range(60):
        feed.follow(links(15 * MM * k / 59), 1 / 60)
    for t in rods.tissues:
        assert np.linalg.norm(feed.at(0).fields[t.name] - t.surface.vertices, axis=1).max() > 4 * MM
    feed.follow(links(0), 10.0)  # a page that stood still for 10 s does not compute them
    for _ in range(150):
        moved = feed.follow(links(0), 1 / 60)
    assert not moved
    for t in rods.tissues:
        assert np.linalg.norm(feed.at(0).fields[t.name] - t.surface.vertices, axis=1).max() < 0.1 * MM


class Pressed(OrganFeed):
    """The organs of the scene under three rods that press them all the time."""

    def __init__(self):
        self.rods = made.Rods(made.abdomen())
        super().__init__(self.rods.tissues, {t.name: [made.rod(made.SHORT)] for t in self.rods.tissues})
        self.touching = {}
        self.t = 0.0

    def follow(self, links, passed):
        self.t += passed
        poses = self.rods.poses(15 * MM * np.sin(3 * self.t) ** 2)
        return super().follow({t.name: {"rod": T} for t, T in zip(self.rods.tissues, poses, strict=True)}, passed)


@pytest.mark.slow
@pytest.mark.alone
def test_two_pages_get_all_organs_at_60_hz_whole_and_in_time():
    feed = Pressed()
    loaded = replace(scenes.load(api.load_scene("vsrs")), feed=feed)
    count = sum(len(t.surface.vertices) for t in feed.rods.tissues)
    assert count >= 2000

    async def go():
        show = lambda: served_content.of_scene(loaded, False)  # noqa: E731
        async with serving(show, plans=False) as s, joined(s.port) as one, joined(s.port) as two:
            about = json.loads((await http(s.port, "GET /scene.json HTTP/1.1"))[2])
            assert [f["name"] for f in about["fields"]] == [t.name for t in feed.rods.tissues]
            for peer in (one, two):
                for kept in (peer.frames, peer.raw, peer.times):
                    kept.clear()
            await asyncio.sleep(5.0)
            return [(list(p.frames), list(p.raw), list(p.times)) for p in (one, two)]

    mixed = [t.surface.vertices.copy() for t in feed.rods.tissues]
    assert not made.torn(SimpleNamespace(fields=mixed))
    mixed[0][::2, 2] += 0.1 * MM
    assert made.torn(SimpleNamespace(fields=mixed))
    for frames, raw, times in asyncio.run(go()):
        late = np.array([t - f.server_time for t, f in zip(times, frames, strict=True)])
        rate, size = (len(frames) - 1) / (times[-1] - times[0]), np.mean([len(r) for r in raw])
        print(f"{count} vertices: {rate:.1f} Hz, {size:.0f} bytes a frame, {rate * size / 1e6:.2f} MB/s, "
              f"latency p50 {np.median(late) * 1e3:.1f} ms, p95 {np.percentile(late, 95) * 1e3:.1f} ms")  # fmt: skip
        assert (np.diff([f.seq for f in frames]) > 0).all()
        assert not any(made.torn(f) for f in frames)
        assert np.percentile(late, 95) < 0.05
