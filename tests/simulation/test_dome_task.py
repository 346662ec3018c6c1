"""A ring handed over and guided in a dome: what the scene declares, how it is judged, and a surgeon who performs it."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import trimesh

import twin
from benchmarks.guiding import judge
from made.scene_text import refused
from twin.api.console_runs import FILE, operate_console, replay_session
from twin.api.scene_obstacles import obstacles_in_base
from twin.api.scene_parts import members_of, props_of, robots_at
from twin.cli import main
from twin.core import spatial
from twin.core.errors import ProtocolError, TwinError, WorldError
from twin.core.units import DEG, MM
from twin.model.body import Mesh
from twin.model.movable import Movable
from twin.reference import ReferenceModel
from twin.simulation import contact_scene
from twin.simulation.contact_scene import WireCourse
from twin.simulation.devices.surgeon_hands import Seat, SeenArm
from twin.simulation.plants.contact import Contact, Solid
from twin.simulation.setup import Setup
from twin.simulation.tasks.guide.arm_paths import ArmPaths, _stations
from twin.simulation.tasks.guide.guiding_referee import STEPS, GuidingReferee
from twin.simulation.tasks.guide.guiding_surgeon import GuidingSurgeon
from twin.simulation.tasks.guide.task import GuideTable
from twin.ui.session.exercise import Exercise
from twin.ui.session.live_console import LiveConsole
from twin.ui.session.loaded_scene import LoadedScene


@pytest.fixture(scope="module")
def scene():
    return twin.load_scene("raven_dome")


@pytest.fixture(scope="module")
def props(scene):
    return props_of(scene)


# -- the scene -----------------------------------------------------------------------------------------------


def test_the_wire_is_where_its_dimensions_say(scene, props):
    given = tomllib.loads((scene.file.parent / "dimensions.toml").read_text(encoding="utf-8"))
    d = {name: np.array(entry["value"]) for name, entry in given.items()}
    course = contact_scene.course(scene, props, scene.tasks["ring"])
    s = (np.arange(20) + 0.5) / 20
    turn = d["wire_turn"] * DEG * np.sin(2 * np.pi * s)
    ways = d["wire_long"] / 20 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    line = (d["centre"] + d["wire_at"] + np.vstack([np.zeros(3), np.cumsum(ways, axis=0)])) * MM
    np.testing.assert_allclose(course.wire, line, atol=0.02 * MM)


def test_the_opening_is_beside_the_line_to_the_remote_centres_and_panels_are_convex(scene, props):
    course = contact_scene.course(scene, props, scene.tasks["ring"])
    centre, ports = np.array([0, 62, 880]) * MM, [p.p_world_ports[""] for p in scene.places[:2]]
    way = np.mean(ports, axis=0) - centre
    assert np.arccos(way[2] / np.linalg.norm(way)) == pytest.approx(0.477, abs=1e-3)
    assert all(course.outside(p) > 20 * MM for p in ports)
    assert course.outside(course.wire[10]) < -20 * MM
    panels = props.body("dome").meshes
    assert len(panels) == 56
    for panel in panels:
        mesh = trimesh.Trimesh(panel.vertices, panel.triangles)
        assert mesh.convex_hull.volume == pytest.approx(mesh.volume, rel=1e-6)
    corners = np.concatenate([p.vertices for p in panels])  # in the frame of the dome, whose origin is the centre
    radii = np.linalg.norm(corners, axis=1)
    np.testing.assert_allclose(radii, np.where(radii < 76.5 * MM, 75 * MM, 78 * MM), atol=0.01 * MM)
    assert corners[corners[:, 2] > 0.055, 1].min() > -1e-6  # half of the lid is cut away


def test_contacts_of_an_object_with_named_parts_are_written():
    box = trimesh.creation.box([0.04, 0.04, 0.01])
    part = Mesh("plate", np.array(box.vertices), np.array(box.faces, np.int32), (1, 1, 1, 1))
    ball = Movable("ball", "ball", (5 * MM,), 1e-3, 0.5, spatial.pose(p=[0, 0, 0.00995]))
    for rubbed, on in ((("plate",), {1.0}), ((), None)):
        contact = Contact([ball], [Solid("table", [part], 0.5)], rubbed=rubbed)
        seen = {contact.outputs.get("ball.rubs")}
        for _ in range(20):
            mujoco.mj_step(contact._model, contact._data)
        seen |= {contact._signals().get("ball.rubs")} if rubbed else set()
        assert on is None or 1.0 in seen
        assert ("ball.rubs" in contact.outputs) == bool(rubbed)


def test_stations_of_a_way_are_near_each_other():
    Ts = np.array([spatial.pose(spatial.rotation_z(a), [0.1 * s, 0, 0]) for s in np.linspace(0, 1, 200) for a in [s]])
    rows = _stations(Ts)
    assert rows[-1] == 199
    places = Ts[[0, *rows], 0, 3]
    assert np.diff(places).max() < 8.6 * MM
    assert _stations(np.broadcast_to(np.eye(4), (200, 4, 4)).copy()) == [199]


@pytest.fixture(scope="module")
def setup(scene, props):
    return Setup(scene, members_of(robots_at(scene.places)), props=props)


def test_ways_go_around_what_planning_goes_around(scene, setup):
    ring, mechanisms = scene.objects[0], {name: m.mechanism for name, m in setup.members.items()}
    q = {name: np.array(mechanism.posture("home")) for name, mechanism in mechanisms.items()}
    q["ecm"] = q["ecm"] + 0.05
    place = next(p for p in scene.places if p.name == "ecm")
    links = ReferenceModel(mechanisms["ecm"]).solve(q["ecm"]).link_poses
    poses = {"ecm": {body: place.T_world_base @ T for body, T in links.items()}}
    wanted = obstacles_in_base("raven_dome", "raven_left", twin.load, poses)
    ways = ArmPaths(setup)
    found = ways.obstacles("raven_left", q, {ring.name: ring.T_world_object})
    assert [s.name for s in found] == [*(s.name for s in wanted), ring.name]
    np.testing.assert_allclose([s.T_base_body for s in found[:-1]], [s.T_base_body for s in wanted], atol=1e-12)
    assert len(ways.obstacles("raven_left", q, {})) == len(wanted)


def test_ways_keep_the_clearance_of_the_scene_and_let_touch_what_may(scene, props, setup):
    name = next(b.name for b in props.bodies)
    pair = (f"raven_left/{setup.members['raven_left'].mechanism.bodies[-1].name}", f"{props.name}/{name}")
    touching = frozenset({frozenset(pair)})
    ways = ArmPaths(replace(setup, scene=replace(scene, clearance=3 * MM, touching=touching)))
    assert ways.clearance == 3 * MM
    touches = {s.name: s.touches for s in ways.obstacles("raven_left", {}, {})}
    assert touches.pop(pair[1]) == {pair[0].split("/")[1]}
    assert set(touches.values()) == {frozenset()}


class NoWay:
    """A planner that finds no way and keeps what it was asked."""

    clearance = 3 * MM

    def __init__(self):
        self.goals, self.clearances = [], []

    def plan(self, robot, goal, q, objects, clearance, seed=0):
        self.goals.append(goal)
        self.clearances.append(clearance)
        raise ProtocolError("there is no way")


def test_the_way_out_ends_where_the_arm_began_with_the_jaws_as_they_are():
    kin = SimpleNamespace(auxiliary=np.array([False, True, False, True]), forward=lambda q: np.eye(4))
    arms = {h: SeenArm(h, kin, np.eye(4), np.eye(4)) for h in ("right", "left")}
    ways = NoWay()
    surgeon = GuidingSurgeon(Seat("pedals", arms, "ecm", 1.0, 0.5), RING, WireCourse(WIRE, BALL), "left", ways)
    now = {"ring.pose": np.eye(4).ravel(), "right.q": np.arange(4.0), "left.q": np.zeros(4), "ecm.q": np.zeros(4)}
    surgeon._signals = now
    list(surgeon._follow("right", np.eye(4), np.full(4, 9.0)))
    np.testing.assert_array_equal(ways.goals, [[9, 1, 9, 3]] * 3)
    assert ways.clearances == [3 * MM, 1.5 * MM, 0.75 * MM]
    assert surgeon.missed == ["way of right: there is no way"]


# -- how it is judged ----------------------------------------------------------------------------------------

GUIDE = GuideTable(
    ring="ring", wire="wire", dome="dome", first="left", lifted_mm=5, end_mm=3, outside_mm=5,
    allowed={"touch_s": 0.3, "drops": 0, "collisions": 0},
)  # fmt: skip
RING = Movable("ring", "ring", (9 * MM, 1 * MM), 1e-3, 0.5, spatial.pose(p=[-30 * MM, 0, 0]))
WIRE = np.column_stack([np.linspace(0, 40, 9), np.zeros(9), np.zeros(9)]) * MM
BALL = np.array([[0, 0, 1, -0.05], [0, 0, -1, -0.05]])  # between z = -50 and 50 mm
DT = 0.05
R, L, NOBODY = 0, 1, -1  # numbers of the arms in `ring.holder`


def judged(steps, allowed=None, ring=RING):
    """Return (measures, referee) of samples (x in mm or place (3,), holder, {signal: value}), `DT` apart, five each."""
    guide = GUIDE if allowed is None else GUIDE.model_copy(update={"allowed": GUIDE.allowed.model_copy(update=allowed)})
    referee = GuidingReferee(
        guide, ring, WireCourse(WIRE, BALL), ["r", "l"], "l", {"r": lambda q: q, "l": lambda q: q}, DT
    )
    for place, holder, more in steps:
        p = np.array([place, 0, 0] if np.isscalar(place) else place) * MM
        now = {
            "ring.pose": spatial.pose(spatial.exp_so3(np.array([0, np.pi / 2, 0])), p).ravel(),
            "ring.holder": np.array([holder]),
        }
        now |= {f"{n}.{w}": np.zeros(1) for n in "rl" for w in ("touches", "meets")}
        now |= {f"{n}.follows": np.ones(1) for n in "rl"} | {f"{n}.q": np.zeros(3) for n in "rl"}
        now |= {"ring.rubs": np.zeros(1)} | {k: np.array(v, float).reshape(-1) for k, v in more.items()}
        for _ in range(6):
            referee.see(now)
    return referee.measures(), referee


OUT = {"r.q": [0, 0, 0.06], "l.q": [0, 0, 0.06]}
WELL = [
    (-30, NOBODY, {}), (-30, L, {}), (-20, L, {}), (-10, R, {}), (-3, R, {}), *((x, R, {}) for x in range(0, 40, 4)),
    (39, R, {}), (39, NOBODY, {}), (39, NOBODY, {}), (39, NOBODY, OUT),
]  # fmt: skip


def changed(at, entry):
    at %= len(WELL)
    return [*WELL[:at], entry, *WELL[at + 1 :]]


def test_a_task_done_well_has_all_steps_in_order():
    found, referee = judged(WELL)
    times = list(found.steps.values())
    assert list(found.steps) == list(STEPS)
    assert times == sorted(times)
    assert referee.complete
    assert (found.missed, found.exceeded, found.passed) == ([], [], 1.0)
    assert (found.touches, found.drops, found.collisions) == (0, 0, 0)
    assert [e.tone for e in referee.events] == ["good"] * 5
    assert referee.content()["rings"] == [["ring", "retracted", "#cbcbcb"]]
    assert referee.content()["next"] == ""


@pytest.mark.parametrize(
    ("steps", "missed", "drops"),
    [
        (WELL[:1], STEPS, 0),  # nobody took the ring
        ([(-30, L, {})] * 3, STEPS, 0),  # grasped, but not lifted
        ([(p, L if h == R else h, m) for p, h, m in WELL], STEPS[1:], 1),  # the first arm guides it
        ([(p, R if h == L else h, m) for p, h, m in WELL], STEPS, 1),  # the second arm picks it up
        (
            [*WELL[:3], (-20, NOBODY, {}), (-20, NOBODY, {}), *WELL[3:]],
            STEPS[1:],
            2,
        ),  # dropped, then taken by the second
        ([*WELL[:2], (-30, NOBODY, {}), *WELL[1:]], (), 0),  # a first grasp fails
        ([*WELL[:2], (-30, NOBODY, {}), (-20, NOBODY, {}), *WELL[2:]], (), 1),  # it falls off before it is picked up
        ([WELL[0], (-20, NOBODY, {}), *WELL[2:]], (), 0),  # moved before any hand held it
        ([*WELL[:10], (20, NOBODY, {}), (20, NOBODY, {}), (20, NOBODY, OUT)], STEPS[2:], 1),  # released in the middle
        (
            [*WELL[:4], ((-3, 20, 0), R, {}), (20, R, {}), *WELL[10:]],
            STEPS[2:],
            1,
        ),  # it came onto the wire in the middle
        ([*WELL[:10], ((20, 20, 0), R, {}), (24, R, {}), *WELL[12:]], STEPS[2:], 1),  # it left the wire on the way
        ([(p, L if p in range(8, 33) else h, m) for p, h, m in WELL], STEPS[2:], 1),  # the first arm guides it further
        ([(p, L if p == 20 else h, m) for p, h, m in WELL], (), 0),  # the first arm holds it while the second grasps
        (WELL[:-3], STEPS[3:], 0),  # never released
        (changed(-3, ((60, 0, 0), NOBODY, {}))[:-2], STEPS[3:], 0),  # released beside the wire
        (WELL[:-1], STEPS[4:], 0),  # both tools stay inside
        (changed(-1, (39, NOBODY, OUT | {"l.q": [0, 0, 0]})), STEPS[4:], 0),  # one tool stays inside
        ([*WELL, (39, NOBODY, {})], STEPS[4:], 0),  # a tool comes back
    ],
)
def test_steps_are_missed_and_drops_counted(steps, missed, drops):
    found, referee = judged(steps)
    assert found.missed == list(missed)
    assert found.drops == drops
    assert referee.complete == (not missed)


def test_each_step_has_an_instruction():
    led = []
    for k in range(len(WELL) + 1):
        _, referee = judged(WELL[:k])
        led.append(referee.content()["next"])
    assert led[0].startswith("Drag an instrument to begin")
    parts = ["Pick the ring up with l", "Grasp the ring with r too", "Put the ring over the free end", "Guide the ring"]
    parts += ["Open the jaws", "Draw both instruments out"]
    found = [next((k for k, text in enumerate(led) if text.startswith(part)), None) for part in parts]
    assert None not in found, dict(zip(parts, found, strict=True))
    assert found == sorted(found)
    assert [state for _, state, _ in referee.content()["stages"]] == ["done"] * 5


def test_after_a_drop_it_is_said_who_must_pick_the_ring_up():
    _, referee = judged([*WELL[:3], (-20, NOBODY, {}), *WELL[3:]])
    assert referee.content()["events"][1][1:] == ["bad", "ring was dropped: l must pick it up again"]
    assert referee.content()["next"] == "The ring fell: pick it up again with l"
    found, referee = judged([*WELL[:3], (-20, NOBODY, {}), *WELL[2:]])  # it does
    assert (found.missed, found.drops) == ([], 1)
    _, referee = judged([*WELL[:8], (12, NOBODY, {}), *WELL[8:]])  # after handing over any arm may
    assert "ring was dropped" in [e.text for e in referee.events]


@pytest.mark.parametrize(
    ("at", "more", "what", "value"),
    [
        (8, {"ring.rubs": 1}, "touches of the wire", 0.3),
        (8, {"r.touches": 1}, "collisions of instruments", 1),
        (8, {"r.meets": 1, "l.meets": 1}, "collisions of instruments", 1),
    ],
)
def test_errors_are_counted_and_limited(at, more, what, value):
    steps = changed(at, (WELL[at][0], WELL[at][1], more))
    found, _ = judged(steps, {"touch_s": 0.2})
    assert found.missed == []
    assert [(row[0], pytest.approx(row[1])) for row in found.exceeded] == [(what, value)]
    assert judged(steps, {"touch_s": 0.31, "collisions": 1})[0].exceeded == []


def test_a_ring_that_hangs_on_the_wire_may_touch_it():
    found, _ = judged(changed(-2, (39, NOBODY, {"ring.rubs": 1})))
    assert (found.touches, found.touching, found.missed) == (0, 0, [])


# -- bad input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('ring = "ring"', 'ring = "rign"', "there is no object 'rign'. Did you mean 'ring'?"),
        (
            'shape = "ring"\nsize_mm = [9, 1]',
            'shape = "ball"\nsize_mm = [9]',
            "'ring' is a ball; only a ring goes around",
        ),
        ('first = "left"', 'first = "middle"', "task.ring.guide.first"),
        ("end_mm = 3", "end_mm = 0", "task.ring.guide.end_mm"),
        ("end_mm = 3", "end_mm = nan", "task.ring.guide.end_mm"),
        ("outside_mm = 5\n", "", "task.ring.guide.outside_mm"),
        ("drops = 0", "drops = -1", "task.ring.guide.allowed.drops"),
        ("drops = 0", "drops = 0.5", "task.ring.guide.allowed.drops"),
        ("[contact]", "[task.contact]", "task"),
        ("[task.ring.guide]", "[task.ring.gide]", "task.ring.gide"),
        ("[task.ring.guide]", "tolerance_mm = 1\n[task.ring.guide]", "a task with `guide` takes no `tolerance_mm`"),
    ],
)
def test_a_wrong_task_is_named(scene, tmp_path, old, new, text):
    assert text in refused(scene, tmp_path, old, new)


def test_a_wrong_wire_or_dome_is_named(scene, props):
    task = scene.tasks["ring"]
    for field, value, text in (
        ("wire", "wire_peice", "there is no wire 'wire_peice'"),
        ("wire", "wire_piece01", "the wire has one part, 'wire_piece01'.* as two or more parts"),
        ("dome", "doom", r"there is no solid body 'doom'\. Did you mean 'dome'"),
    ):
        wrong = replace(task, goal=task.goal.model_copy(update={field: value}))
        with pytest.raises(TwinError, match=text):
            contact_scene.course(scene, props, wrong)
    flat = [replace(m, vertices=m.vertices * (1, 1, 0)) for m in props.body("dome").meshes]
    bodies = tuple(replace(b, meshes=tuple(flat)) if b.name == "dome" else b for b in props.bodies)
    with pytest.raises(TwinError, match=r"task 'ring': dome 'dome' is flat.* Draw it with a thickness"):
        contact_scene.course(scene, replace(props, bodies=bodies), task)
    with pytest.raises(TwinError, match="has no ring to guide"):
        contact_scene.course(scene, props, replace(task, goal=None))


def test_an_unknown_mistake_is_named(scene, tmp_path, capsys):
    arms = {h: SeenArm(f"raven_{h}", None, np.eye(4), np.eye(4)) for h in ("right", "left")}
    with pytest.raises(WorldError, match=r"there is no mistake 'droped'\. Did you mean 'dropped'"):
        GuidingSurgeon(Seat("pedals", arms, "ecm", 1.0, 0.5), RING, WireCourse(WIRE, BALL), "left", None, "droped")
    with pytest.raises(TwinError, match="makes mistakes only in a task with a ring to guide"):
        operate_console(twin.load_scene("davinci"), "touch", mistake="dropped")
    assert main(["operate", "davinci", "--mistake", "dropped", "--out", str(tmp_path / "x")]) == 2
    assert "--mistake applies to a procedure or a ring to guide; task 'touch' is neither" in capsys.readouterr().err
    assert main(["operate", "sils", "--mistake", "asleep"]) == 2
    assert "--mistake requires a scene with a procedure or a ring to guide; sils is a robot" in capsys.readouterr().err


# -- by hand -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_attempt_by_hand_has_the_scoreboard_and_can_be_ended(scene, props):
    live = LiveConsole(LoadedScene(scene, robots_at(scene.places), props), Exercise(scene.tasks["ring"]))
    live.advance(0.02)
    board = live.reading["task"]
    assert dict(board["rows"])["Steps done"] == "0 of 5"
    assert [name for name, *_ in board["rings"]] == ["ring"]
    assert board["rings"][0][1] == "not picked up"
    live.end("page 1")
    live.advance(0.01)
    assert live.reading["task"]["over"] == "The task was ended."
    live.close()


# -- the whole task ------------------------------------------------------------------------------------------

DOCS = Path(__file__).parents[2] / "docs/raven.md"


@pytest.fixture(scope="module")
def performed(scene):
    return operate_console(scene, seed=1)


@pytest.mark.nightly
def test_a_simulated_surgeon_hands_the_ring_over_and_guides_it(performed, props):
    found, kept = performed.outcome.guided, performed.run.recording
    assert performed.verdict == "agree", performed.findings
    assert performed.word == "The ring was guided along the wire"
    assert (found.missed, found.exceeded, performed.run.missed) == ([], [], ())
    assert 20 < found.time < 60
    holder = kept["ring.holder"][:, 0]
    changes = holder[np.flatnonzero(np.diff(holder)) + 1]
    assert changes.tolist() == [1, 0, -1]  # left, right, nobody: it is never free in between
    T = kept["ring.pose"].reshape(-1, 4, 4)
    assert T[0, 2, 3] > 0.9
    assert np.linalg.norm(T[-1, :3, 3] - performed.outcome.wire[-1]) < 12 * MM  # it hangs on the wire
    assert judge(performed, props) > 0.3 * MM  # exact geometry, without the simulation of contact


@pytest.mark.nightly  # tests/simulation/test_pegboard.py and tests/simulation/test_camera_task.py replay shorter tasks
def test_the_same_seed_gives_the_same_bytes_and_they_replay(scene, performed, tmp_path):
    again = operate_console(scene, seed=1)
    assert hashlib.sha256(again.recorded).digest() == hashlib.sha256(performed.recorded).digest()
    (tmp_path / FILE).write_bytes(again.recorded)
    replayed = replay_session(tmp_path / FILE, scene)
    assert replayed.run.difference is None
    assert replayed.outcome.guided == performed.outcome.guided


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "missed", "exceeded"),
    [
        ("dropped", STEPS[1:], {"drops of the ring"}),
        pytest.param(
            "wire_touched", (), {"touches of the wire", "collisions of instruments"}, marks=pytest.mark.nightly
        ),
        pytest.param("not_handed_over", STEPS[1:], {"drops of the ring"}, marks=pytest.mark.nightly),
        pytest.param("stopped_short", STEPS[2:], {"drops of the ring"}, marks=pytest.mark.nightly),
        pytest.param("wall_hit", (), {"collisions of instruments"}, marks=pytest.mark.nightly),
        pytest.param("left_inside", STEPS[4:], set(), marks=pytest.mark.nightly),
    ],
)
def test_a_mistake_fails_what_the_docs_say(scene, mistake, missed, exceeded):
    found = operate_console(scene, seed=3, mistake=mistake)
    assert found.verdict == "disagree"
    assert found.outcome.guided.missed == list(missed)
    assert {row[0] for row in found.outcome.guided.exceeded} == exceeded
    row = next(line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith(f"| `{mistake}` |"))
    said = [cell.strip() for cell in row.split("|")[3:5]]
    assert said == [", ".join(missed) or "-", ", ".join(sorted(exceeded)) or "-"]


@pytest.mark.nightly
def test_the_command_writes_the_measures_and_a_report(tmp_path, capsys):
    assert main(["operate", "raven_dome", "--task", "ring", "--seed", "2", "--json", "--out", str(tmp_path)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert list(data["guided"]["steps_s"]) == list(STEPS)
    assert data["guided"]["ring_dropped"] == 0
    table = np.genfromtxt(tmp_path / "session.csv", delimiter=",", names=True)
    assert table["ring_holder"].max() == 1
    page = (tmp_path / "session.html").read_text(encoding="utf-8")
    assert "Wire passed" in page
    assert (tmp_path / "session.png").stat().st_size > 10_000
