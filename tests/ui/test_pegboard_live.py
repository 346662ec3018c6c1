"""A task with rings by hand: the scoreboard of the pages, its end, a restart, the report, the frames with rings."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import twin
from made.headset_page import until
from twin.api.console_runs import FILE, operate_console, replay_session
from twin.cli.commands import session as command
from twin.core import spatial
from twin.core.errors import DescriptionError, OutputError, TwinError, WorldError
from twin.core.units import MM
from twin.model.movable import Movable
from twin.simulation.contact_scene import Peg
from twin.simulation.devices.received_hands import HandState
from twin.simulation.session import movement
from twin.simulation.session.session_file import read_session, sizes
from twin.simulation.tasks.transfer import ring_referee
from twin.simulation.tasks.transfer.task import Transfer, Transfers
from twin.simulation.world import Recording
from twin.simulation.world.signals import columns
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client_messages import RefusedError, parse_message
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.headset.scene_frame import unpack_scene
from twin.ui.session import live_console
from twin.ui.session.exercise import Exercise
from twin.ui.session.live_console import HeldError, LiveConsole

PEG = Peg("peg", np.array([0, 0, 0.025]), np.zeros(3), 2.8e-3)
TASK = Transfers((Transfer(ring="ring", peg="peg"),))
RING = Movable("ring", "ring", (6.75 * MM, 0.7 * MM), 0.5e-3, 0.5, color_rgba=(1.0, 0.0, 0.214, 1.0))
ROBOTS = ("a", "b")


# -- one judge -----------------------------------------------------------------------------------------------


def around(Ts, radius, peg):
    """Return whether (k,) the peg is in the hole of a ring at poses Ts (k, 4, 4).

    This function shares no code with `ring_referee.around`.
    """
    n, middle, way = Ts[:, :3, 2], Ts[:, :3, 3], peg.end - peg.foot
    slope = n @ way
    s = np.sum(n * (middle - peg.foot), axis=1) / np.where(np.abs(slope) < 1e-12, np.inf, slope)
    cut = peg.foot + s[:, None] * way
    return (np.abs(slope) >= 1e-12) & (s >= 0) & (s <= 1) & (np.linalg.norm(cut - middle, axis=1) < radius)


def merged(flags, few):
    out = []
    for a, b in movement.runs(flags):
        if out and a - out[-1][1] <= few:
            out[-1] = out[-1][0], b
        else:
            out.append((a, b))
    return out


def judged_at_the_end(kept, few):
    """Return transferred time, drops and collisions, from whole signals instead of sample by sample."""
    Ts = kept["ring.pose"].reshape(-1, 4, 4)
    held = np.zeros(len(Ts), bool)
    for a, b in merged(kept["ring.holder"][:, 0] >= 0, few):
        held[a : b + 1] = True
    placed = around(Ts, RING.size[0], PEG) & ~held
    drops = sum(a > 0 and not placed[b] and Ts[a, 2, 3] - Ts[b, 2, 3] > 0.01 for a, b in movement.runs(~held))
    t = float(kept.t[movement.runs(placed)[-1][0]]) if placed[-1] else None
    met = np.any([kept[f"{n}.meets"][:, 0] > 0.5 for n in ROBOTS], axis=0)
    hits = sum(len(merged(kept[f"{n}.touches"][:, 0] > 0.5, few)) for n in ROBOTS)
    return t, drops, hits + len(merged(met, few))


def random_session(rng, k):
    """Return a recording of k samples, 0.05 s each, in which everything that is judged comes and goes."""

    def runs(low, high):
        return np.repeat(rng.integers(low, high, k), rng.integers(1, 12, k))[:k, None]

    places = np.array([(40, 0, 30), (1, 0, 1), (40, 0, 1), (0, 0, 20), (8, 0, 1), (0, 3, 12)]) * MM
    at = places[runs(0, len(places))[:, 0]]
    turns = spatial.exp_so3(rng.normal(0, 0.4, (k, 3))) if rng.random() < 0.5 else np.broadcast_to(np.eye(3), (k, 3, 3))
    poses = np.array([spatial.pose(R, p).ravel() for R, p in zip(turns, at, strict=True)])
    signals = {"ring.pose": poses, "ring.holder": runs(-1, 2)}
    signals |= {f"{n}.{what}": runs(0, 2) for n in ROBOTS for what in ("touches", "meets", "follows")}
    lengths = {n: v.shape[1] for n, v in signals.items()}
    return Recording(0.05, lengths, np.column_stack(list(signals.values())).astype(float))


def test_sample_by_sample_and_all_at_once_give_the_same_measures():
    rng, seen = np.random.default_rng(4), np.zeros(3)
    for _ in range(150):
        kept = random_session(rng, int(rng.integers(1, 80)))
        found = ring_referee.measure(kept, TASK, [RING], {"peg": PEG}, ROBOTS)
        t, drops, collisions = judged_at_the_end(kept, 5)
        assert (found.rings[0].t, found.dropped, found.collisions) == (t, drops, collisions)
        assert found.errors == drops + collisions
        seen += (t is not None, drops > 0, collisions > 0)
    assert (seen > 10).all(), "the sessions are of all kinds"


def told(places, holders, touches=None, begun=0):
    """Return the events of a ring at places (3,) in mm, 0.1 s each; an arm follows its hand from sample `begun` on."""
    k = len(places)
    referee = ring_referee.RingsReferee(TASK, [RING], {"peg": PEG}, ROBOTS, 0.1)
    for i in range(k):
        now = dict.fromkeys((f"{n}.{what}" for n in ROBOTS for what in ("touches", "meets", "follows")), np.zeros(1))
        if i >= begun:
            now["a.follows"] = np.ones(1)
        now |= {"ring.pose": spatial.pose(p=np.array(places[i]) * MM).ravel(), "ring.holder": np.array([holders[i]])}
        if touches is not None:
            now["a.touches"] = np.array([touches[i]])
        referee.see(now)
    return [(round(e.t, 1), e.tone, e.text) for e in referee.events], referee


AWAY, ON, FLOOR = (40, 0, 30), (1, 0, 1), (40, 0, 1)


def test_what_happens_is_told_once_in_words():
    events, referee = told([AWAY, AWAY, *[ON] * 6], [-1, 0, *[-1] * 6])
    assert events == [(0.4, "good", "ring is on its peg: 1 of 1")]  # not before the hand has left it for 0.25 s
    assert referee.complete
    events, referee = told([AWAY, AWAY, AWAY, *[FLOOR] * 5], [-1, 1, *[-1] * 6])
    assert events == [(0.4, "bad", "ring was dropped")]
    assert not referee.complete
    events, _ = told([AWAY, AWAY, AWAY, *[FLOOR] * 5], [-1, 1, -1, 1, 1, 1, 1, 1])
    assert events == []  # caught again
    events, _ = told([AWAY, *[ON] * 5, AWAY, AWAY], [0, -1, -1, -1, -1, -1, 0, 0])
    assert [e[2] for e in events] == ["ring is on its peg: 1 of 1", "ring has left its peg"]
    events, _ = told([AWAY] * 6, [-1] * 6, [0, 1, 0, 1, 1, 0])
    assert events == [(0.1, "bad", "a touched the board")]
    events, _ = told([AWAY] * 6, [-1] * 6, [0, 0, 0, 0, 1, 0], begun=2)
    assert events == [(0.2, "bad", "a touched the board")], "the clock starts with the first motion"


def test_the_scoreboard_is_plain_data():
    _, referee = told([AWAY, AWAY, AWAY], [-1, 1, 1])
    assert referee.content() == {
        "rows": [
            ["Time", "0.3 s"],
            ["Rings transferred", "0 of 1"],
            ["Rings dropped", "0"],
            ["Instrument collisions", "0"],
            ["Errors", "0"],
        ],
        "rings": [["ring", "held by b", "#ff007f"]],
        "next": "Bring ring over the peg with b; open the jaws there",
        "events": [],
    }
    _, referee = told([AWAY, AWAY], [-1, -1], begun=5)
    assert referee.content()["next"].startswith("Drag an instrument to begin")
    assert referee.content()["rows"][0] == ["Time", "0.0 s"]
    _, referee = told([AWAY, AWAY], [-1, -1])
    assert referee.content()["next"] == "Bring open jaws around ring, and close them"
    _, referee = told([AWAY, AWAY, *[ON] * 6], [-1, 0, *[-1] * 6])
    assert referee.content()["next"] == ""


# -- live ----------------------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def no_budget(monkeypatch):
    monkeypatch.setattr(live_console, "_STEPPING_TIME", np.inf)  # a busy machine does not make the World late


def hands(number, lift=0.0, grip=0.0):
    """Return the states of both hands; a roll of 5 deg at first shows that a person holds the right one."""
    pose = spatial.pose(spatial.rotation_z(0.1 * (number > 3)), [0.08, lift, 0])
    left = spatial.pose(p=[-0.08, 0, 0])
    return HandState(0, False, False, number, pose, grip), HandState(1, False, False, number, left, 0.0)


def row(live, name):
    return dict(live.reading["task"]["rows"])[name]


def test_an_attempt_is_ended_and_restarted(theatre, tmp_path):
    file = tmp_path / "hands.session"
    ends = []
    live = LiveConsole(
        theatre, Exercise(theatre.scene.tasks["pegboard"], file, ended=lambda: ends.append(live.attempt))
    )
    start = {n: live.world.signals[n] for n in ("ring1.pose", "psm1.q")}
    for number in range(40):
        live.give("page 1", *hands(number, lift=0.0005 * number))
        live.advance(0.01)
    assert live.reading["hands"]["right"]["follows"]
    assert not np.array_equal(live.world.signals["psm1.q"], start["psm1.q"])
    assert float(row(live, "Time").removesuffix(" s")) > 0.1
    with pytest.raises(HeldError, match="page 1 controls the hands"):
        live.end("page 2")
    live.feel("page 1", False)
    live.advance(0.01)
    assert not live.reading["haptics"]
    assert not ends
    live.end("page 1")
    assert ends == [1]
    shown, tick = live.advance(0.01) or live.reading, live.world.tick
    assert shown["task"]["over"] == "The task was ended."
    assert shown["owner"] is None
    with pytest.raises(HeldError, match="Restart the task to move the instruments"):
        live.give("page 1", *hands(50))
    live.advance(0.5)
    assert live.world.tick == tick, "nothing moves after the end"
    assert len(read_session(file).device) == tick
    live.restart("page 2")
    assert (live.attempt, live.reading["task"]["over"]) == (2, None)
    assert row(live, "Time") == "0.0 s"
    for name, value in start.items():
        np.testing.assert_array_equal(live.world.signals[name], value)
    live.advance(0.2)
    assert live.reading["haptics"], "each attempt begins with the switch of its condition"
    np.testing.assert_allclose(live.world.signals["psm1.q"], start["psm1.q"], rtol=0, atol=1e-12)
    live.close()
    assert (tmp_path / "hands-2.session").is_file()


@pytest.mark.slow
def test_a_restart_that_cannot_be_recorded_loses_nothing(theatre, tmp_path):
    (tmp_path / "hands-2.session").write_text("mine")
    live = LiveConsole(theatre, Exercise(theatre.scene.tasks["pegboard"], tmp_path / "hands.session"))
    live.advance(0.05)
    with pytest.raises(OutputError, match=r"hands-2\.session exists; sessions are not overwritten"):
        live.restart("page 1")
    live.advance(0.05)
    assert (live.attempt, live.world.tick) == (1, 100)
    live.close()
    assert len(read_session(tmp_path / "hands.session").device) == 100
    assert (tmp_path / "hands-2.session").read_text() == "mine"


def test_without_rings_there_is_nothing_to_end(bare_theatre):
    live = LiveConsole(bare_theatre)
    assert live.reading["task"] is None
    with pytest.raises(
        TwinError, match="there is no task to end or restart: start one on the page, or this program with --task"
    ):
        live.end("page 1")
    stream = ConsoleStream(bare_theatre)
    with pytest.raises(RefusedError, match="there is no task to end or restart"):
        stream.ask("c1", parse_message('{"type": "task", "do": "restart"}'))
    stream.close()


def test_an_object_inside_an_instrument_is_named(theatre):
    scene = theatre.scene
    arm = next(p for p in scene.places if p.name == "psm1")
    start = LiveConsole(replace(theatre, props=None)).tool("right")
    wire = spatial.pose(p=[scene.objects[0].size[0], 0, 0])
    first = replace(scene.objects[0], T_world_object=start @ wire)
    wrong = replace(scene, objects=(first, *scene.objects[1:]))
    thing = rf"'(ring1|{arm.name}/\w+)'"
    text = rf"{thing} and {thing} overlap by \d\.\d+ mm at the start \(allowed: 0\.1 mm\)"
    with pytest.raises(WorldError, match=text):
        LiveConsole(replace(theatre, scene=wrong), Exercise(scene.tasks["pegboard"]))


def test_a_task_without_a_goal_is_named(theatre, tmp_path):
    body = theatre.scene.file.read_text(encoding="utf-8").replace('props = "theatre.toml"\n', "")
    aimless = '[task.idle]\ntitle = "nothing to do"\nprovenance = "ASSUMED"\nnote = "x"\n'
    file = tmp_path / "scene.toml"
    file.write_text(f"{body}\n{aimless}", encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        twin.load_scene(file)
    line = file.read_text(encoding="utf-8").splitlines().index('title = "nothing to do"') + 1
    assert str(caught.value) == (
        f'{file}:{line}: task.idle.title = "nothing to do": a task needs a goal: `target` or `transfer` with at least '
        "one entry, `holes`, `guide`, `align` or `procedure`; this task has none of them"
    )


def test_frames_hold_the_rings_after_the_robots(theatre):
    stream = ConsoleStream(theatre, Exercise(theatre.scene.tasks["pegboard"]))
    frame = unpack_scene(stream.frame(0, 0.0))
    assert len(frame.robots) == 4
    names = [name for name in stream.links if name.startswith("objects/")]
    assert names == ["objects/ring1", "objects/ring2", "objects/ring3", "objects/ring4"]
    for name, seven in zip(names, frame.robots[3].poses, strict=True):
        T = stream.world.signals[f"{name.removeprefix('objects/')}.pose"].reshape(4, 4)
        np.testing.assert_allclose(wire.pose_of(seven), T, atol=1e-6)
    stream.close()


# -- the whole task --------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_hands_that_do_the_task_end_it_and_the_report_has_the_same_measures(theatre, tmp_path):
    """The hands of a simulated surgeon come 250 times a second, as those of a page do."""
    scene, task = theatre.scene, theatre.scene.tasks["pegboard"]
    few = replace(scene, tasks={"pegboard": replace(task, goal=Transfers(task.goal.transfers[:2]))})
    (tmp_path / FILE).write_bytes(operate_console(few, seed=1).recorded)
    session = read_session(tmp_path / FILE)
    at, given = columns(sizes(session.head.device)), session.device
    live = LiveConsole(theatre, Exercise(few.tasks["pegboard"], tmp_path / "own.session", command.report))
    live.rescale("page 1", float(given[0, at["pedals.scale"]][0]))
    held, grasped = set(), 0
    for number, now in enumerate(given[::4]):
        if grasped == 100:  # the device is unplugged in a grasp, for 1.5 s
            jaw = live.world.signals["psm1.q"][-1]
            for _ in range(375):
                live.advance(0.004)
            assert live.reading["silent"]
            assert live.reading["task"]["rings"][0][1] == "held by the right instrument"
            assert live.world.signals["psm1.q"][-1] == jaw
            assert row(live, "Rings dropped") == "0"
        grasped += live.reading["task"]["rings"][0][1] == "held by the right instrument"
        if live.reading["task"]["over"]:
            break
        pedals = (bool(now[at[f"pedals.{p}"]][0] > 0.5) for p in ("clutch", "camera"))
        clutch, camera = pedals
        states = [
            HandState(k, clutch, camera, number, now[at[f"{h}.pose"]].reshape(4, 4), float(now[at[f"{h}.grip"]][0]))
            for k, h in enumerate(("right", "left"))
        ]
        live.give("page 1", *states)
        live.advance(0.004)
        held |= {state for _, state, _ in live.reading["task"]["rings"]}
    for _ in range(200):
        live.advance(0.004)
    board = live.reading["task"]
    assert board["over"] == "All rings are on their pegs."
    assert {"held by the right instrument", "held by the left instrument"} <= held
    assert row(live, "Rings transferred") == "2 of 2"
    found = replay_session(tmp_path / "own.session", few)
    assert found.run.difference is None
    assert found.seed is None
    assert [list(r) for r in found.outcome.board.rows()] == board["rows"]
    until(lambda: live.report()[1] or live.report()[2], "the report")
    attempt, page, problem = live.report()
    assert (attempt, problem) == (1, "")
    assert b"Rings transferred" in page
    live.close()


# -- exports -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(theatre, tmp_path_factory):
    """A session with two rings, and the folder with its files."""
    scene, task = theatre.scene, theatre.scene.tasks["pegboard"]
    few = replace(scene, tasks={"pegboard": replace(task, goal=Transfers(task.goal.transfers[:2]))})
    found, folder = operate_console(few, seed=2), tmp_path_factory.mktemp("session")
    found.write(folder)
    return found, folder


def keys_of(found):
    """Return the samples of a session that become keys: every fourth, and the last."""
    k = len(found.t)
    return np.unique([*range(0, k, 4), k - 1])


@pytest.mark.nightly
def test_readers_of_others_find_the_rings_where_they_were(written):
    import pygltflib
    from mcap.reader import make_reader
    from pxr import Usd, UsdGeom

    found, folder = written
    kept, keys = found.run.recording, keys_of(found)
    truth = {f"ring{n}": kept[f"ring{n}.pose"].reshape(-1, 4, 4) for n in (1, 2, 3, 4)}
    assert np.linalg.norm(np.ptp(truth["ring1"][:, :3, 3], axis=0)) > 30 * MM

    gltf = pygltflib.GLTF2().load(str(folder / "objects/objects.glb"))

    def numbers(index, width):
        accessor = gltf.accessors[index]
        view = gltf.bufferViews[accessor.bufferView]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        return np.frombuffer(gltf.binary_blob(), "<f4", accessor.count * width, start).reshape(-1, width)

    (clip,) = gltf.animations
    seen = set()
    for channel in clip.channels:
        name, sampler = gltf.nodes[channel.target.node].name, clip.samplers[channel.sampler]
        t = numbers(sampler.input, 1)[:, 0]
        if channel.target.path == "translation":
            np.testing.assert_allclose(t, found.t[keys], atol=1e-4)
            np.testing.assert_allclose(numbers(sampler.output, 3), truth[name][keys, :3, 3], atol=1e-6)
            seen.add(name)
    assert {"ring1", "ring2"} <= seen

    stage = Usd.Stage.Open(str(folder / "objects/usd/objects_session.usda"))
    for k in keys[:: len(keys) // 7]:
        cache = UsdGeom.XformCache(Usd.TimeCode(found.t[k] * stage.GetTimeCodesPerSecond()))
        for name, Ts in truth.items():
            T = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(f"/objects/{name}"))).T
            np.testing.assert_allclose(T, Ts[k], atol=1e-6)

    with (folder / "session.mcap").open("rb") as file:
        messages = [json.loads(m.data) for _, _, m in make_reader(file).iter_messages(["/tf"])]
    for k, message in zip(range(0, len(found.t), 4), messages, strict=True):
        at = {x["child_frame_id"]: x["translation"] for x in message["transforms"]}
        np.testing.assert_allclose([at["ring2"][axis] for axis in "xyz"], truth["ring2"][k, :3, 3], atol=1e-6)


@pytest.mark.slow
def test_the_audit_reads_the_rings_and_finds_one_that_was_moved(written, tmp_path):
    _, folder = written
    shutil.copytree(folder / "objects", tmp_path / "objects")
    assert twin.audit(tmp_path / "objects").verdict == "agree"
    track = tmp_path / "objects/tracks/session.json"
    data = json.loads(track.read_text())
    data["poses"][-7] += 1e-4
    track.write_text(json.dumps(data))
    assert twin.audit(tmp_path / "objects").verdict != "agree"


def test_the_stage_of_the_scene_has_the_rings_as_rigid_bodies(theatre, tmp_path):
    scene = theatre.scene
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

    from twin.simulation.scene_stage import write_scene

    bare = replace(scene, places=(), cameras={}, touching=frozenset())
    stage = Usd.Stage.Open(str(write_scene(bare, tmp_path, {}, {}, None, 0.0)))
    cache = UsdGeom.XformCache()
    for item in scene.objects:
        prim = stage.GetPrimAtPath(f"/davinci/objects/{item.name}")
        np.testing.assert_allclose(np.array(cache.GetLocalToWorldTransform(prim)).T, item.T_world_object, atol=1e-12)
        assert prim.HasAPI(UsdPhysics.RigidBodyAPI)
        mass = UsdPhysics.MassAPI(prim)
        assert mass.GetMassAttr().Get() == pytest.approx(item.mass)
        (mesh,) = [p for p in prim.GetChildren() if p.IsA(UsdGeom.Mesh)]
        body = trimesh.Trimesh(UsdGeom.Mesh(mesh).GetPointsAttr().Get(), np.reshape(
            UsdGeom.Mesh(mesh).GetFaceVertexIndicesAttr().Get(), (-1, 3)))  # fmt: skip
        body.density = item.mass / body.volume
        moments = np.diag(body.moment_inertia)
        np.testing.assert_allclose(mass.GetDiagonalInertiaAttr().Get(), moments, rtol=0.03)  # of the drawn ring
        bound = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial("physics")[0]
        assert UsdPhysics.MaterialAPI(bound.GetPrim()).GetDynamicFrictionAttr().Get() == pytest.approx(item.friction)
        assert UsdPhysics.MeshCollisionAPI(mesh).GetApproximationAttr().Get() == "convexDecomposition"


@pytest.mark.parametrize("shape", ["ring", "box", "ball"])
def test_the_inertia_of_an_object_is_that_of_its_surface(shape):
    size = {"ring": (6.75 * MM, 0.7 * MM), "box": (1 * MM, 2 * MM, 3 * MM), "ball": (2 * MM,)}[shape]
    item = Movable("x", shape, size, 2e-3, 0.5)
    body = trimesh.Trimesh(item.mesh().vertices, item.mesh().triangles)
    body.density = item.mass / body.volume
    np.testing.assert_allclose(item.inertia().I_com, body.moment_inertia, rtol=0.03, atol=1e-15)
