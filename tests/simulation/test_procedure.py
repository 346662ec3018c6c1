"""The cholecystectomy: tables, jaws that hold and slip, a bed that lets go, vessels clipped and cut, checks."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import twin
from made import organs as made
from model.test_tissue_scene import changed
from twin.api import procedure as api_procedure
from twin.api.procedure import ProcedureSession, replay_procedure
from twin.cli import main
from twin.core.errors import DescriptionError, TwinError, WorldError
from twin.core.units import MM
from twin.model.scene import load_scene
from twin.model.surface import nearest, volume
from twin.model.vessel import Vessel
from twin.simulation import operating_scene, procedure_scene
from twin.simulation.plants.tissue import Organs, Sight, Tool
from twin.simulation.plants.tissue.tubes import Held, Tube
from twin.simulation.session.session_file import CHUNK, NAME, Chunk, Session, head
from twin.simulation.session.session_run import Difference
from twin.simulation.session.tape import Tape
from twin.simulation.setup import Setup
from twin.simulation.tasks.procedure import procedure_checks, procedure_run
from twin.simulation.tasks.procedure.procedure_surgeon import ProcedureHabits, ProcedureSurgeon
from twin.simulation.world import Recording

STAGES = ["expose", "show", "clip", "cut", "remove"]


@pytest.fixture(scope="module")
def vsrs():
    return twin.load_scene("vsrs")


# -- tables --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('pa10 = "clip_applier"', 'pa10 = "clip_gun"', r"scene.toml:\d+: .*start: there is no tool 'clip_gun'"),
        ('start = { pa10 = "clip_applier"', 'start = { pa11 = "clip_applier"', "there is no robot 'pa11'"),
        (
            'kind = "clip_applier"\nrobots = ["pa10", "lapbot"]',
            'kind = "clip_applier"\nrobots = ["lapbot"]',
            "pa10 cannot carry 'clip_applier'",
        ),
        ('robots = ["pa10", "lapbot"]', 'robots = ["pa10", "raven"]', "tool.grasper.robots: there is no robot 'raven'"),
        ("pinch_n = 8\n", "", "a grasper needs `pinch_n`"),
        ("power_w = 30", "power_w = 30\nclips = 2", "a cautery takes no `clips`"),
        ("friction = 0.5\n", "friction = -0.5\n", "tool.grasper.friction"),
        ('vessel = "cystic_duct"', 'vessel = "duct"', "there is no vessel 'duct'"),
        ('spare = ["liver"]', 'spare = ["lung"]', "there is no tissue 'lung'"),
        (
            'organ = "gallbladder"\nradius_mm',
            'organ = "bladder"\nradius_mm',
            "vessel.cystic_duct.organ: there is no tissue",
        ),
    ],
)
def test_wrong_table_is_named_with_its_line(tmp_path, old, new, message):
    with pytest.raises(DescriptionError, match=message):
        load_scene(changed(tmp_path, (old, new)))


def test_task_without_a_goal_is_refused(tmp_path):
    path = changed(tmp_path)
    body = path.read_text(encoding="utf-8")
    path.write_text(body[: body.index("[task.cholecystectomy.procedure]")], encoding="utf-8")
    line = body[: body.index("title = ", body.index("[task.cholecystectomy]"))].count("\n") + 1
    with pytest.raises(DescriptionError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}:{line}: task.cholecystectomy.title = ")
    assert "a task needs a goal: " in str(caught.value)
    assert str(caught.value).endswith("`align` or `procedure`; this task has none of them")


def test_vessel_that_is_too_fine_is_refused(tmp_path):
    with pytest.raises(
        TwinError, match=r"vessel 'cystic_duct' has 67 segments; the limit is 60: increase segment_mm \(0.5 mm\)"
    ):
        load_scene(changed(tmp_path, ("segment_mm = 1.5", "segment_mm = 0.5")))


def test_vessel_that_cannot_be_built_is_named_with_its_line(tmp_path):
    path = changed(tmp_path)
    body = path.read_text(encoding="utf-8")
    begin = body.index("line_mm = [", body.index("[vessel.cystic_duct]"))
    line, end = body[:begin].count("\n") + 1, body.index("]]", begin) + 2
    for points, text in (
        ("[[0, 0, 0], [0, 0, 0]]", "two points of line_mm are equal"),
        ("[[0, 0, 0], [1e200, 0, 0]]", "1e+200 mm"),
    ):
        path.write_text(body[:begin] + "line_mm = " + points + body[end:], encoding="utf-8")
        with pytest.raises(DescriptionError) as caught:
            load_scene(path)
        assert str(caught.value).startswith(f"{path}:{line}: vessel.cystic_duct.line_mm: ")
        assert text in str(caught.value)


def test_numbers_are_assumed_with_a_note(vsrs):
    ours = [p for p in vsrs.parameters if p.name.startswith(("vessel ", "tool ", "task "))]
    assert len(ours) > 50
    assert {p.provenance for p in ours} == {"ASSUMED"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mistake", "asleep"], "there is no mistake 'asleep'. Known: bed_left, clip_missed"),
        (["--scale", "0.5"], "--scale applies to a console"),
        (["--task", "appendectomy"], "there is no task 'appendectomy'"),
    ],
)
def test_wrong_option_is_named(arguments, message, tmp_path, capsys):
    assert main(["operate", "vsrs", "--out", str(tmp_path / "out"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# -- jaws and bed --------------------------------------------------------------------------------------------


def held_block(limit):
    """A block in jaws that hold the middle of its upper face up to a force in N, and the weights of that point."""
    block = made.block()
    organs = Organs([block], [Tool("tool", made.rod())], [made.at(0, 0, 2)], operable_name="block")
    p, triangle, shares = nearest(np.array([0, 0, 0.08]), block.surface.vertices, block.surface.triangles)
    weights = shares @ block.weights[block.surface.triangles[triangle]]
    hold = organs.operable.hold
    hold.grasp(0, weights, p, limit)
    return organs, hold, weights


def lift(organs, hold, height, steps=100):
    for _ in range(steps):
        for grip in hold.grips.values():
            grip.p = grip.p + np.array([0, 0, height / steps])
        organs.step([made.at(0, 0, 2)])


@pytest.mark.slow
def test_jaws_lift_an_organ_that_keeps_its_volume():
    organs, hold, weights = held_block(50.0)
    start = weights @ organs.nodes["block"]
    lift(organs, hold, 15 * MM)
    lift(organs, hold, 0.0)
    moved = weights @ organs.nodes["block"] - start
    assert moved[2] > 13 * MM
    assert np.abs(moved[:2]).max() < 0.5 * MM
    assert hold.grips[0].force[2] > 1.0
    assert hold.grips[0].slipped == 0
    (tissue,) = organs.tissues
    found = volume(organs.vertices("block"), tissue.surface.triangles)
    assert abs(found / tissue.surface.volume - 1) < 0.02
    hold.release(0)
    lift(organs, hold, 0.0, 200)
    assert np.abs(organs.nodes["block"] - tissue.nodes).max() < 0.1 * MM


@pytest.mark.slow
def test_what_jaws_hold_slips_at_the_stated_force():
    organs, hold, _ = held_block(0.8)
    lift(organs, hold, 30 * MM, 300)
    lift(organs, hold, 0.0)
    assert np.linalg.norm(hold.grips[0].force) == pytest.approx(0.8, rel=0.05)
    assert hold.grips[0].slipped > 5 * MM


@pytest.mark.slow
def test_bed_lets_go_node_by_node():
    organs, hold, _ = held_block(50.0)
    lift(organs, hold, 15 * MM)
    (tissue,) = organs.tissues
    still = [n for n in tissue.pinned_nodes.tolist() if n in hold.held]
    assert np.abs(organs.nodes["block"][still] - tissue.nodes[still]).max() < 0.5 * MM
    first = still[0]
    hold.let_go(first)
    lift(organs, hold, 0.0)
    moved = np.linalg.norm(organs.nodes["block"] - tissue.nodes, axis=1)
    assert moved[first] > 1 * MM
    assert moved[still[1:]].max() < 0.5 * MM
    for node in still[1:]:
        hold.let_go(node)
    lift(organs, hold, 40 * MM)
    lift(organs, hold, 0.0, 200)
    assert np.linalg.norm(hold.grips[0].force) < 0.02
    assert (organs.nodes["block"] - tissue.nodes)[:, 2].min() > 40 * MM


@pytest.mark.slow
def test_bed_holds_its_own_nodes_also_where_others_have_no_material():
    organ = made.corner()
    organs = Organs([organ], [Tool("tool", made.rod())], [made.at(0, 0, 2)], operable_name="corner")
    hold = organs.operable.hold
    p, triangle, shares = nearest(np.array([0, 0, 0.12]), organ.surface.vertices, organ.surface.triangles)
    hold.grasp(0, shares @ organ.weights[organ.surface.triangles[triangle]], p, 50.0)
    lift(organs, hold, 2 * MM, 8)
    moved = np.linalg.norm(organs.nodes["corner"] - organ.nodes, axis=1)
    assert moved[organ.pinned_nodes].max() < 0.1 * MM < moved.max()
    for node in organ.pinned_nodes.tolist():
        hold.let_go(node)
    lift(organs, hold, 2 * MM, 8)
    assert np.linalg.norm(organs.nodes["corner"] - organ.nodes, axis=1)[organ.pinned_nodes].max() > 1 * MM


# -- vessels -------------------------------------------------------------------------------------------------


def tube(n=20):
    points = np.column_stack([np.linspace(0, 0.04, n + 1), np.zeros(n + 1), np.zeros(n + 1)])
    return Tube(Vessel("duct", points, "", 2.5 * MM, 5e4), 8e-3)


def pieces(t):
    """Return the closed pieces of a vessel's surface as lists of segments, from the drawn triangles."""
    drawn = t.vessel.deformable
    vertices = drawn.vertices(t.nodes().ravel())
    each = np.array_split(drawn.mesh.triangles, t.vessel.segments)
    volumes = np.array([volume(vertices, f) for f in each])
    closed = [trimesh.Trimesh(vertices, f, process=False).is_watertight for f in each]
    assert all(closed)
    return volumes


def test_cut_vessel_is_two_closed_pieces_and_its_ends_go_apart():
    t = tube()
    whole = pieces(t)
    assert whole.sum() == pytest.approx(8 / 2 * np.sin(np.pi / 4) * (2.5 * MM) ** 2 * 0.04, rel=1e-6)
    for k in range(200):
        t.step(np.array([-min(k, 100) * 0.1 * MM, 0, 0]))  # pulled longer by 10 mm
    assert t.reaction[0] == pytest.approx(5e4 * np.pi * (2.5 * MM) ** 2 * 0.25, rel=0.02)  # E A times the strain
    gone = t.sever(21 * MM)
    for _ in range(300):
        t.step(np.array([-10 * MM, 0, 0]))
    assert gone == 10
    assert (pieces(t)[[k for k in range(20) if k != gone]] > 0).all()
    assert pieces(t)[gone] == 0
    assert np.linalg.norm(t.points[gone + 1] - t.points[gone]) == pytest.approx(12 * MM, abs=0.2 * MM)
    assert np.linalg.norm(t.reaction) < 1e-3


@pytest.mark.parametrize(
    ("base", "tip", "far", "along"),
    [
        ((20, 0, 5), (20, 0, -5), 0, 5),  # in the middle of the jaws
        ((20, 0, 1), (20, 0, -9), 0, 1),  # at their root
        ((20, 6, 5), (20, 6, -5), 6, 5),  # beside
        ((20, 0, 12), (20, 0, 2), 2, 10),  # before
    ],
)
def test_jaws_know_where_a_vessel_crosses_them(base, tip, far, along):
    found = tube().crossed(np.array(base) * MM, np.array(tip) * MM)
    np.testing.assert_allclose(np.array(found[:3]) / MM, [far, along, 20], atol=1e-6)
    assert found[3] == pytest.approx(1.0)


def test_vessel_slips_out_of_jaws_at_the_stated_force():
    t = tube()
    t.held[0] = Held(10, t.points[10].copy(), 0.3, np.zeros(3))
    for _ in range(400):
        t.held[0].p = t.held[0].p + np.array([0, 0, 0.05 * MM])
        t.step(t.points[0])
    for _ in range(100):
        t.step(t.points[0])
    assert np.linalg.norm(t.held[0].force) == pytest.approx(0.3, rel=0.05)
    assert t.held[0].slipped > 1 * MM


def test_nearest_point_agrees_with_trimesh():
    ball = trimesh.creation.icosphere(2)
    points = np.random.default_rng(0).normal(size=(40, 3))
    wanted, _, _ = trimesh.proximity.closest_point_naive(ball, points)
    for p, q in zip(points, wanted, strict=True):
        found, triangle, shares = nearest(p, ball.vertices, ball.faces)
        np.testing.assert_allclose(found, q, atol=1e-9)
        np.testing.assert_allclose(shares @ ball.vertices[ball.faces[triangle]], found, atol=1e-12)


def test_endoscope_sees_what_is_in_its_picture_and_not_behind_an_organ():
    ball = trimesh.creation.icosphere(3)
    ball.apply_scale(0.02)
    T = np.eye(4)
    T[2, 3] = -0.1
    sight = Sight(lambda: T, np.deg2rad(70))
    for p, seen in (((0, 0, 50), 0), ((40, 0, 50), 1), ((0, 0, -50), 1), ((0, 300, 50), 0), ((0, 0, -150), 0)):
        assert sight.seen(np.array([p]) * MM, [(ball.vertices, ball.faces)]) == seen, p


# -- checks --------------------------------------------------------------------------------------------------


def signals(vsrs, **changes):
    """Measure signals of a procedure that is done, 100 rows at 0.1 s; `changes` replace some of them."""
    p, (gallbladder,) = vsrs.tasks["cholecystectomy"].goal, made.abdomen()[1:2]
    t = np.arange(1, 101) * 0.1
    zero, late = np.zeros((100, 1)), (t > 5.0)[:, None]
    rows = {f"{r}.{what}": np.zeros((100, 3)) for r in p.start for what in ("tip", "pull", "lifted")}
    rows |= {f"{r}.slipped": zero for r in p.start}
    rows |= {"pa10.holds": zero - 1, "lapbot.holds": zero, "lapbot.lifted": np.tile([0, 0, 0.02], (100, 1))}
    up = np.where(t > 8, 0.17, 0.0)[:, None, None] * np.array([0, 0.3, 1.0])
    rows["gallbladder.nodes"] = (gallbladder.nodes[None] + up).reshape(100, -1)
    rows["gallbladder.energy"] = 20.0 * np.repeat((t > 7)[:, None], len(gallbladder.pinned_nodes), axis=1)
    rows["gallbladder.freed"] = rows["gallbladder.energy"] / 20
    rows |= {"liver.depth": zero, "cystic_duct.seen": zero + 1}
    rows |= {f"{v.name}.cut": np.zeros((100, v.segments)) for v in vsrs.vessels}
    rows["cystic_duct.cut"][:, 10] = (t > 6)[:]  # 15.3 mm to 16.9 mm from the organ
    for k, at in enumerate((0.021, 0.025, 0.010, 0.0), 1):
        rows[f"clip_{k}.on"] = np.where(late & (k < 4), 0.0, -2.0)
        rows |= {f"clip_{k}.at": zero + at, f"clip_{k}.cover": zero + (k < 4)}
    for name, value in ((n.replace("__", "."), v) for n, v in changes.items()):
        given = np.broadcast_to(np.asarray(value, float), rows[name].shape)
        rows[name] = np.where(late, given, rows[name]) if name.endswith(".on") else given
    kept = Recording(0.1, {n: r.shape[1] for n, r in rows.items()}, np.concatenate([*rows.values()], axis=1))
    return procedure_checks.measure(kept, Setup(vsrs, {}, vsrs.tasks["cholecystectomy"], organs=[gallbladder]))


def failed(measures):
    return [c.name for c in measures.checks if not c.done]


def test_procedure_that_is_done_passes_all_checks(vsrs):
    found = signals(vsrs)
    assert failed(found) == []
    assert [c.name for c in found.checks] == [*STAGES, "organs", "vessels"]
    assert found.time == pytest.approx(8.0)
    assert found.clips == 3


@pytest.mark.parametrize(
    ("changes", "checks"),
    [
        ({"lapbot__holds": -1}, ["expose"]),
        ({"lapbot__lifted": (0, 0, 0.005)}, ["expose"]),
        ({"cystic_duct__seen": 0.5}, ["show"]),
        ({"clip_1__on": -1}, ["clip"]),  # beside all vessels
        ({"clip_2__cover": 0.6}, ["clip"]),  # not over the whole width
        ({"clip_3__at": 0.018}, ["cut"]),  # all clips on one side of the cut: the end of the organ is open
        ({"clip_1__at": 0.012}, ["cut"]),  # two clips on the organ's side, one on the side that stays
        ({"cystic_duct__cut": 0}, ["cut"]),
        ({"gallbladder__freed": (1, 1, 1, 1, 1, 1, 0)}, ["remove"]),
        ({"liver__depth": 0.009}, ["organs"]),
        ({"clip_4__on": 1}, ["vessels"]),  # a clip on the common duct
        ({"hepatic_artery__cut": 1}, ["vessels"]),
    ],
)
def test_each_fault_fails_its_check(vsrs, changes, checks):
    assert failed(signals(vsrs, **changes)) == checks


def test_clip_after_the_cut_does_not_undo_the_leak(vsrs):
    after_cut = np.where(np.arange(100) > 80, 0.0, -2.0)[:, None]
    clips = {"clip_3__at": 0.018, "clip_4__cover": 1, "clip_4__at": 0.010, "clip_4__on": after_cut}
    assert failed(signals(vsrs, **clips)) == ["cut"]


@pytest.mark.parametrize(
    ("changes", "differs", "word"),
    [
        ({}, False, "All stages are done"),
        ({}, True, "The replay gives different bytes"),
        ({"cystic_duct__cut": 0, "gallbladder__freed": 0}, False, "Not finished: 5 of 7 checks passed"),
        ({"liver__depth": 0.009}, False, "1 of 7 checks failed"),
    ],
)
def test_report_is_headed_by_what_was_done(vsrs, changes, differs, word):
    difference = Difference(0.0, 1.0, "pa10.q", 0.1) if differs else None
    ran = SimpleNamespace(difference=difference)
    found = ProcedureSession(vsrs, vsrs.tasks["cholecystectomy"], "", None, "", ran, made.abdomen()[1])
    found.__dict__["measures"] = signals(vsrs, **changes)
    assert found.word == word


# -- in the World --------------------------------------------------------------------------------------------


@functools.cache
def built():
    scene = twin.load_scene("vsrs")
    return api_procedure._setup(scene, scene.tasks["cholecystectomy"])


class Room:
    """The World of the cholecystectomy with a surgeon, and what was kept of it."""

    def __init__(self, scene, seed=0, mistake="", manner=None):
        self.setup, self.tape = replace(built(), scene=scene), Tape()
        device = ProcedureSurgeon(self.setup, seed, mistake, manner)
        self.world = procedure_scene.world(self.setup, device, False, [self.tape])
        self.keep = procedure_run.keep_for(self.world, self.setup.procedure)

    def step(self, ticks):
        self.world.step(ticks)
        rows = self.tape.take()
        self.keep.add(rows)
        return rows

    def until(self, stage):
        """Step until a stage is over."""
        while not self.world.ended and self.world.signals["surgeon.stage"][0] <= stage:
            assert np.isfinite(self.step(125)).all()
        return procedure_checks.measure(self.keep.recording(), self.setup)


@pytest.mark.slow
def test_surgeon_grasps_and_lifts_the_gallbladder(vsrs):
    room = Room(vsrs, 3, manner=ProcedureHabits(quick=0.2, slow=0.1))
    found = room.until(1)
    assert found.checks[0].done, found.checks[0].text
    assert set(failed(found)) >= {"clip", "cut", "remove"}
    organ = operating_scene.organ_of(room.setup)
    surface = organ.surface
    vertices = organ.weights @ room.world.signals["gallbladder.nodes"].reshape(-1, 3)
    assert abs(volume(vertices, surface.triangles) / surface.volume - 1) < 0.02


@pytest.mark.slow
def test_instrument_in_an_organ_at_the_start_is_refused(vsrs):
    low = tuple(replace(p, start={"q1": 400.0}) if p.name == "lapbot" else p for p in vsrs.places)
    with pytest.raises(WorldError, match=r"'lapbot/.*' is inside '.*' at the start; start the robot outside, or move"):
        Room(replace(vsrs, places=low))


@pytest.mark.nightly
def test_another_seed_gives_other_bytes(vsrs):
    one, two = (Room(vsrs, seed).step(60) for seed in (3, 4))
    assert one.tobytes() != two.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "stage", "check"),
    [
        ("clip_missed", 3, "clip"),
        pytest.param("wrong_vessel", 3, "vessels", marks=pytest.mark.nightly),
        pytest.param("organ_punctured", 3, "organs", marks=pytest.mark.nightly),
        pytest.param("cut_outside", 4, "cut", marks=pytest.mark.nightly),
    ],
)
def test_mistake_fails_its_check_alone(vsrs, mistake, stage, check):
    found = Room(vsrs, 5, mistake, ProcedureHabits(quick=0.12, slow=0.06)).until(stage)
    judged = [*STAGES[:stage], "organs", "vessels"]  # the later stages are not done yet
    assert [c for c in failed(found) if c in judged] == [check]


@pytest.mark.nightly
def test_command_does_all_stages_and_a_replay_gives_the_same_bytes(tmp_path, capsys):
    assert main(["operate", "vsrs", "--task", "cholecystectomy", "--seed", "1", "--out", str(tmp_path), "--quiet"]) == 0
    assert "All stages are done" in (tmp_path / "procedure.html").read_text(encoding="utf-8")
    table = np.genfromtxt(tmp_path / "procedure.csv", delimiter=",", names=True)
    assert np.isfinite(table["pa10_tip_x_m"]).all()
    whole = (tmp_path / NAME).read_bytes()
    second = whole.index(b"TWNS", whole.index(b"TWNS") + 4)
    (tmp_path / "begin.session").write_bytes(whole[:second])
    capsys.readouterr()
    assert main(["session", str(tmp_path / "begin.session")]) == 1  # interrupted: the stages are not done
    assert "the same bytes" in capsys.readouterr().out
    found = replay_procedure(tmp_path / "begin.session")
    assert found.run.ticks == CHUNK
    assert found.run.difference is None


def test_session_of_another_scene_is_named_before_its_world_is_built(tmp_path, vsrs):
    sizes = {"surgeon.stage": 1}
    first = head("other", "sha256:" + "0" * 64, 1e-3, sizes, sizes, "cholecystectomy")
    session = Session(first, (Chunk(np.zeros((1, 1)), np.zeros(1), b""),), "")
    setup = Setup(vsrs, {}, vsrs.tasks["cholecystectomy"])
    with pytest.raises(WorldError, match="recorded in scene 'other'"):
        procedure_run.replay(session, tmp_path / NAME, setup, lambda name, part: None)
