"""A scene in the stream: several robots on one clock, each with its own holder, and fields of vertices beside them."""

from __future__ import annotations

import asyncio
import base64
import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twin
from made.cloth import Cloth
from made.streaming import Planned, http, joined, serving, unpack_any
from twin.cad.build import read_mechanism
from twin.cli import scenes
from twin.core import spatial
from twin.core.errors import TwinError
from twin.exchange.write.home_poses import home_poses
from twin.model.scene import load_scene
from twin.simulation.frame import WorldFrame
from twin.ui.headset import live_robot, scene_frame, served_content
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.replay import Replay
from twin.ui.headset.scene_frame import pack_field, pack_scene, unpack_scene
from twin.ui.headset.server_files import page_files
from twin.ui.session.deformable_feed import vertices_of
from twin.ui.session.loaded_scene import LoadedScene
from twin.ui.session.timeline import TICK_RATE, prepare

# --------------------------------------------------------------------------------------------------- frames


def a_robot(rng, links, joints, ghost=False):
    body = wire.pack_body(rng.normal(size=(links, 7)), rng.normal(size=joints), rng.normal(size=7) if ghost else None)
    return wire.pack(3, 1.5, 0.25, wire.HELD_FLAG | wire.GHOST_FLAG * ghost, body, links, joints)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 12), st.integers(0, 7), st.booleans()), max_size=4),
       st.lists(st.integers(0, 40), max_size=3), st.integers(0, 2**32))  # fmt: skip
def test_a_scene_comes_back_whole_and_its_robots_to_the_bit(robots, fields, seed):
    rng = np.random.default_rng(seed)
    parts = [a_robot(rng, *r) for r in robots]
    vertices = [rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-4, 2, 3) for n in fields]
    data = pack_scene(seed, 1.5, 2.5, wire.PLAYING_FLAG, parts, [pack_field(v) for v in vertices])
    assert len(data) % 4 == 0
    frame = unpack_any(data)
    assert isinstance(frame, scene_frame.SceneFrame)
    assert (frame.seq, frame.server_time, frame.time, frame.flags) == (seed % 2**32, 1.5, 2.5, wire.PLAYING_FLAG)
    for part, robot in zip(parts, frame.robots, strict=True):
        alone = wire.unpack(part)
        assert (alone.poses.tobytes(), alone.q.tobytes(), alone.flags) == (
            robot.poses.tobytes(), robot.q.tobytes(), robot.flags,
        )  # fmt: skip
    for wanted, got in zip(vertices, frame.fields, strict=True):
        assert got.shape == wanted.shape
        if len(wanted):  # half a step of the box, and what float32 rounds
            limit = 0.5 * np.ptp(wanted, axis=0) / scene_frame.QUANTISATION_STEPS + 4e-7 * np.abs(wanted).max()
            assert (np.abs(got - wanted) <= limit).all()
    for cut in {len(data) - 4, 40} - {len(data)}:
        if cut < len(data):
            with pytest.raises(TwinError, match="frame"):
                unpack_scene(data[:cut])
    with pytest.raises(TwinError, match="frame"):
        unpack_scene(data + bytes(4))


def test_a_scene_lies_as_the_documentation_says(rng):
    robot, corner = a_robot(rng, 2, 3), np.array([[0.0, 1, 2], [1, 1, 4]])
    data = pack_scene(5, 1.5, 2.5, wire.HELD_FLAG, [robot], [pack_field(corner)])
    for offset, kind, value in [
        (0, "<4s", b"TWN2"), (4, "<I", 5), (8, "<d", 1.5), (16, "<d", 2.5), (24, "<H", 1), (26, "<H", 1), (28, "<I", 8),
        (32, "<4s", b"TWN1"),
    ]:  # fmt: skip
        assert struct.unpack_from(kind, data, offset) == (value,)
    at = 32 + len(robot)
    n, *box = struct.unpack_from("<I3f3f", data, at)
    assert (n, box[:3]) == (2, [0.0, 1.0, 2.0])
    assert np.allclose(box[3:], [1 / 65535, 0, 2 / 65535])
    assert struct.unpack_from("<6H", data, at + 28) == (0, 0, 0, 65535, 0, 65535)
    assert len(data) == at + 28 + 12


def test_fields_that_cannot_be_sent_are_told():
    cloth = Cloth(n=3)
    surface = cloth.surfaces["cloth"]
    for field, message in [
        (np.full((9, 3), np.nan), "9 of 9 vertices are not finite"), (np.zeros((8, 3)), r"need \(9, 3\)"),
        (np.zeros(9), r"shape \(9,\)"), (None, "is missing in the frame"),
    ]:  # fmt: skip
        with pytest.raises(TwinError, match=message):
            vertices_of(WorldFrame(0.5, {}, {} if field is None else {"cloth": field}), "cloth", surface)
    with pytest.raises(TwinError, match="the maximum of 65536"):
        pack_field(np.zeros((scene_frame.MAX_VERTICES + 1, 3)))


@pytest.mark.slow
def test_the_cloth_of_the_test_room_is_a_cloth():
    """It hangs where it is held, keeps its edges, swings, and is the same in another run."""
    one, two = Cloth(), Cloth()
    start, end = one.at(0.0).fields["cloth"], one.at(one.duration).fields["cloth"]
    assert np.array_equal(start[[0, 12]], end[[0, 12]])
    long = np.linalg.norm(np.diff(end[one.edges], axis=1)[:, 0], axis=1) / one.rest
    assert long.min() > 0.9
    assert long.max() < 1.25
    assert end[:, 2].min() < 0.75
    assert np.ptp([one.at(t).fields["cloth"][-1, 1] for t in np.linspace(0, 2, 30)]) > 0.2
    assert two.at(1.3).fields["cloth"].tobytes() == one.at(1.3).fields["cloth"].tobytes()


# --------------------------------------------------------------------------------------------------- a scene, live


@pytest.fixture(scope="module")
def scene():
    file = scenes.find("vsrs")
    assert file is not None
    return load_scene(file)


@pytest.fixture(scope="module")
def robots(scene):
    return {p.name: twin.load(p.name) for p in scene.places}


@pytest.fixture(scope="module")
def props(scene):
    return read_mechanism(scene.props, with_mass=False).mechanism


@pytest.fixture(scope="module")
def playback(scene):
    """One of the three is played: it makes the clock run for all."""
    place = min(scene.places, key=lambda p: p.name)
    return place.name, prepare(place.name, place.protocol)


@pytest.fixture
def planned(monkeypatch, playback):
    class OnlyOne(Planned):
        def __init__(self, robot, protocol):
            self.done, self.answer = True, playback[1] if robot == playback[0] else "it stays at home in this test"

    monkeypatch.setattr(live_robot, "Planner", OnlyOne)


def shown(scene, robots, props=None, plans=False, feed=None):
    return lambda: served_content.of_scene(LoadedScene(scene, robots, props, feed), plans)


@pytest.mark.slow
def test_every_robot_stands_in_its_place_and_what_stands_around_is_told(scene, robots, props):
    async def go():
        async with serving(shown(scene, robots, props, feed=Cloth()), plans=False) as s, joined(s.port) as peer:
            hello = peer.last("hello")
            assert (hello["protocol"], hello["scene"]) == (2, scene.name)
            _, _, body = await http(s.port, "GET /scene.json HTTP/1.1")
            about = json.loads(body)
            assert about["model_hash"] == hello["model_hash"]
            assert [r["name"] for r in about["robots"]] == [p.name for p in scene.places]
            frame = peer.frames[-1]
            names = iter(s.live.links)
            for place, told, part in zip(scene.places, about["robots"], frame.robots, strict=True):
                assert np.allclose(wire.pose_of(told["T_world_base"]), place.T_world_base, atol=1e-12)
                truth = robots[place.name].reference().solve(part.q).link_poses
                for link, pose in zip(told["links"], part.poses, strict=True):
                    assert next(names) == f"{place.name}/{link}"
                    np.testing.assert_allclose(wire.pose_of(pose), truth[link], atol=1e-5)
                for port in told["ports"]:
                    at = (place.T_world_base @ np.append(port["at"], 1))[:3]
                    assert np.allclose(at, place.p_world_ports[port["trocar"]], atol=1e-12)
                    assert place.ports[port["trocar"]] == port["name"]
                assert told["scenery"] is None  # the patient is among what stands around
                assert next(p["name"] for p in told["protocols"] if p["is_default"]) == place.protocol
                for file in ("robot.glb", "robot.json"):
                    assert (await http(s.port, f"GET /{told['files']}{file} HTTP/1.1"))[0] == 200
            assert (await http(s.port, f"GET /{about['props']['file']} HTTP/1.1"))[0] == 200
            assert set(home_poses(props)) == {b.name for b in props.bodies}
            for camera in about["cameras"]:
                assert scene.cameras[camera["name"]].robot == camera["robot"]
                assert camera["link"] in robots[camera["robot"]].reference().home().link_poses
                assert np.isclose(np.rad2deg(camera["view"]), scene.cameras[camera["name"]].view_deg)
            triangles = np.frombuffer(base64.b64decode(about["fields"][0]["triangles"]), "<u4").reshape(-1, 3)
            assert np.array_equal(triangles, Cloth().surfaces["cloth"].triangles)
            assert len(about["assumed"]) > 3

    asyncio.run(go())


def test_all_play_on_one_clock_and_fields_bend_with_it(scene, robots, planned, playback):
    name, played = playback
    cloth = Cloth()

    async def go():
        async with serving(shown(scene, robots, None, True, cloth)) as s, joined(s.port) as peer:
            await peer.until(lambda: s.live.twins[name].duration > 0)
            assert s.live.clock.duration == max(played.duration, cloth.duration)
            assert (await peer.ask("play", on=True))["type"] == "ack"
            peer.frames.clear()

            def shapes():
                return len({f.fields[0].tobytes() for f in peer.frames})

            for _ in range(20):  # a computer that stands still for a while leaves frames out, until the end perhaps
                wanted = len(peer.frames) + 40
                await peer.until(lambda: len(peer.frames) > wanted or not s.live.clock.playing)  # noqa: B023
                if shapes() > 20:
                    break
                await peer.ask("seek", t=0.0)
                await peer.ask("play", on=True)
            await peer.ask("play", on=False)
            i = [p.name for p in scene.places].index(name)
            for frame in peer.frames:
                k = int(np.argmin(abs(played.t - frame.robots[i].clip_time)))
                assert abs(played.t[k] - min(frame.time, played.duration)) <= 0.6 / TICK_RATE
                truth = cloth.at(frame.time).fields["cloth"]
                assert np.abs(frame.fields[0] - truth).max() < 0.3 / scene_frame.QUANTISATION_STEPS
                assert frame.robots[i].server_time == frame.server_time
            assert shapes() > 20
            others = [p.name for p in scene.places if p.name != name]
            state = await peer.until(lambda: peer.last("state"))
            robots_ = {r["name"]: r for r in state["robots"]}
            assert robots_[name]["phase"] is not None
            assert all("stays at home" in robots_[n]["reason"] for n in others)

    asyncio.run(go())


def test_each_robot_has_a_holder_of_its_own(scene, robots):
    one, two, three = (p.name for p in scene.places)

    async def go():
        async with serving(shown(scene, robots)) as s, joined(s.port) as a, joined(s.port) as b:
            ca, cb = a.last("hello")["client"], b.last("hello")["client"]
            assert "name one of" in (await a.ask("grab", target="tool"))["message"]
            assert (await a.ask("grab", robot="nobody", target="tool"))["code"] == "unknown"
            assert (await a.ask("drag", value=0.0))["code"] == "not_held"
            assert (await a.ask("grab", robot=one, target="tool"))["type"] == "ack"
            assert (await b.ask("grab", robot=two, target="tool"))["type"] == "ack"
            refused = await b.ask("grab", robot=one, target="tool")
            assert (refused["code"], refused["message"]) == ("held", f"{ca} holds {one}")
            assert (await b.ask("play", on=True))["code"] == "held"  # it would move what a holds
            await a.until(lambda: [r["holder"] for r in a.last("state")["robots"]] == [ca, cb, None])
            assert (await b.ask("posture", robot=three, name=s.live.twins[three].movable.postures[0]))["type"] == "ack"
            before = {n: t.movable.assembly.T_base_tool.copy() for n, t in s.live.twins.items()}
            for peer, name in ((a, one), (b, two)):  # both at once, each in the robot's base; no name is needed
                goal = wire.sevens(before[name] @ spatial.pose(np.eye(3), np.array([0, 0, -0.002])))
                assert (await peer.ask("drag", pose=goal.tolist()))["type"] == "ack"
            for name in (one, two):
                twin_ = s.live.twins[name]
                await a.until(
                    lambda t=twin_, n=name: np.linalg.norm((t.movable.assembly.T_base_tool - before[n])[:3, 3]) > 1e-3
                )
            assert np.allclose(s.live.twins[three].movable.assembly.T_base_tool, before[three], atol=1e-9)
            await a.until(
                lambda: (
                    [bool(r.flags & wire.HELD_FLAG) for r in a.frames[-1].robots] == [True, True, False]
                    and a.frames[-1].flags & wire.HELD_FLAG
                )
            )
            assert (await a.ask("grab", robot=three, target="tool"))["type"] == "ack"  # a second hand
            assert "name one of" in (await a.ask("drag", pose=[0, 0, 0, 0, 0, 0, 1]))["message"]
            await a.ask("release", robot=one)
            await a.until(lambda: [r["holder"] for r in a.last("state")["robots"]] == [None, cb, ca])
            await a.ask("release")
            await b.ask("release")
            await a.until(lambda: not any(r["holder"] for r in a.last("state")["robots"]))

    asyncio.run(go())


def test_variants_and_documents_are_of_one_robot(scene, robots, planned, playback):
    name, _ = playback

    async def go():
        async with serving(shown(scene, robots, plans=True)) as s, joined(s.port) as peer:
            await peer.until(lambda: any(d["type"] == "path" and d["protocol"] for d in peer.documents))
            await peer.until(lambda: {d["robot"] for d in peer.documents if d["type"] == "path"} == set(robots))
            variants = s.live.twins[name].description["variants"]
            if variants:
                assert (await peer.ask("variant", robot=name, name=variants[0]))["type"] == "ack"
                i = list(robots).index(name)
                await peer.until(lambda: peer.frames[-1].robots[i].ghost is not None)
                assert [r.ghost is not None for r in peer.frames[-1].robots].count(True) == 1

    asyncio.run(go())


def test_a_robot_with_a_field_is_a_scene_and_one_alone_is_not(robots):
    robot = next(iter(robots.values()))

    async def go(feed, version):
        async with (
            serving(lambda: served_content.of_robot(robot, robot.name, None, False, feed)) as s,
            joined(s.port) as peer,
        ):
            assert peer.last("hello")["protocol"] == s.live.version == version
            assert peer.raw[-1][:4] == (b"TWN1" if feed is None else b"TWN2")
            about = json.loads((await http(s.port, "GET /scene.json HTTP/1.1"))[2])
            assert [r["files"] for r in about["robots"]] == [""]
            assert about["robots"][0]["scenery"] is not None
            assert len(about["fields"]) == (feed is not None)

    asyncio.run(go(None, wire.ROBOT_VERSION))
    asyncio.run(go(Cloth(n=4, duration=0.1), wire.SCENE_VERSION))


@pytest.mark.slow
@pytest.mark.parametrize(("how", "message"), [("nan", "not finite"), ("raise", "ZeroDivisionError")])
def test_a_field_that_breaks_is_told_once_and_the_robots_stay(robots, how, message):
    robot = next(iter(robots.values()))

    class Torn(Cloth):
        def at(self, t):
            if how == "raise" and t >= 0.1:
                raise ZeroDivisionError
            return super().at(t) if t < 0.1 else WorldFrame(t, {}, {"cloth": np.full((16, 3), np.nan)})

    async def go():
        torn = Torn(n=4, duration=1.0)
        async with (
            serving(lambda: served_content.of_robot(robot, robot.name, None, False, torn)) as s,
            joined(s.port) as peer,
        ):
            assert len(peer.frames[-1].fields[0]) == 16
            await peer.ask("seek", t=0.5)
            await peer.until(lambda: len(peer.frames[-1].fields[0]) == 0)
            await peer.ask("play", on=True)
            await asyncio.sleep(0.3)
            told = [d for d in peer.documents if d["type"] == "error"]
            assert len(told) == 1
            assert message in told[0]["message"]
            await peer.ask("seek", t=0.0)
            await peer.until(lambda: len(peer.frames[-1].fields[0]) == 16)

    asyncio.run(go())


@pytest.mark.slow
def test_a_session_of_a_scene_replays_byte_for_byte(scene, robots, planned, playback, tmp_path):
    file = tmp_path / "session.json"
    feed = Cloth()

    async def record():
        async with serving(shown(scene, robots, None, True, feed), record=file) as s, joined(s.port) as peer:
            await peer.until(lambda: s.live.clock.duration > feed.duration)
            await peer.ask("play", on=True)
            await asyncio.sleep(0.3)
            name = scene.places[0].name
            await peer.ask("grab", robot=name, target="joint", name=robots[name].joints[0])
            await peer.ask("drag", robot=name, value=0.05)
            await asyncio.sleep(0.2)
            await peer.ask("record", on=False)
            await peer.until(lambda: file.exists())
            return list(peer.raw), s.live.links

    sent, links = asyncio.run(record())
    data = json.loads(file.read_text())
    assert (data["version"], data["robot"]) == (2, scene.name)
    assert data["links"] == list(links)
    kept = [base64.b64decode(f["frame"]) for f in data["frames"]]
    assert kept[kept.index(sent[0]) :] == sent[: len(kept) - kept.index(sent[0])]
    source = Replay(file, scene.name, data["model_hash"])
    again = [f for tick in range(10 * len(kept)) if (f := (source.welcome(), source.frame(tick, 0.0))[1]) is not None]
    assert again == kept
    assert {d["robot"] for d in source.welcome()} == {playback[0]}  # the only one that was planned
    for spoil, message in [({"version": 1}, "frame: begins with"), ({"robot": "sils"}, "of 'sils'")]:
        file.write_text(json.dumps({**data, **spoil}))
        with pytest.raises(TwinError, match=message):
            Replay(file, scene.name, data["model_hash"])


# --------------------------------------------------------------------------------------------------- files and commands


def test_the_page_is_told_what_to_fetch_first(tmp_path):
    (tmp_path / "index.html").write_text("<head>\n<script src='a.js'></script></head>")
    found = page_files(tmp_path, ("robots/a/robot.glb",))["/"].content.decode()
    assert found.index('href="robots/a/robot.glb" as="fetch"') < found.index("<script")
    assert page_files(tmp_path)["/"].content == (tmp_path / "index.html").read_bytes()


@pytest.mark.slow
def test_a_scene_says_itself_what_is_played():
    done = subprocess.run(
        [sys.executable, "-m", "twin", "serve", "vsrs", "scan", "--port", "0", "--no-browser"],
        capture_output=True, text=True, timeout=120, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 2
    assert "is a scene: its file defines the protocol of each robot" in done.stderr
