"""The peg board: what the scene declares, what a simulated surgeon does with it, and how that is judged."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader

import twin
from made.scene_text import refused
from twin.api.console_runs import FILE, operate_console, replay_session
from twin.api.scene_parts import props_of
from twin.cli import main
from twin.core import spatial
from twin.core.errors import TwinError
from twin.core.units import MM
from twin.model.movable import Movable
from twin.simulation import contact_scene
from twin.simulation.contact_scene import Peg
from twin.simulation.plants.contact.collision_shapes import add_part
from twin.simulation.tasks.transfer import ring_referee
from twin.simulation.tasks.transfer.task import Transfer, Transfers
from twin.simulation.world import Recording


@pytest.fixture(scope="module")
def davinci():
    return twin.load_scene("davinci")


@pytest.fixture(scope="module")
def props(davinci):
    return props_of(davinci)


def only(scene, *names, **changes):
    """Return the scene with a task of the named rings."""
    task = scene.tasks["pegboard"]
    few = replace(task, goal=Transfers(tuple(t for t in task.goal.transfers if t.ring in names)))
    return replace(scene, tasks={"pegboard": few}, **changes)


# -- the board -----------------------------------------------------------------------------------------------


def test_pegs_are_where_they_are_drawn(davinci, props):
    pegs = contact_scene.pegs(davinci, props, davinci.tasks["pegboard"])
    for name, x in (("board_peg_left", -42), ("board_peg_right", 42)):
        np.testing.assert_allclose(pegs[name].end / MM, [x, 40, 895 + 25.1], atol=0.02)
        assert pegs[name].foot[2] < 895 * MM
        assert pegs[name].radius == pytest.approx(2.8 * MM, abs=0.02 * MM)


def test_what_collides_is_what_is_drawn(props):
    """No vertex of floor, wall and pegs is further than 30 um from the box or capsule that stands for it."""
    kinds = {}
    for part in props.body("board").meshes:
        spec = mujoco.MjSpec()
        add_part(spec, spec.worldbody, part, np.eye(4), "board")
        (geom,) = spec.geoms
        kinds[part.name] = geom.type
        T = spatial.pose(spatial.matrix_from_quat_wxyz(geom.quat), geom.pos)
        p = (part.vertices - T[:3, 3]) @ T[:3, :3]
        if geom.type == mujoco.mjtGeom.mjGEOM_BOX:
            off = np.max(np.abs(p) - geom.size, axis=1)
        else:
            radius, half = geom.size[:2]
            axis = np.column_stack([np.zeros((len(p), 2)), np.clip(p[:, 2], -half, half)])
            off = np.linalg.norm(p - axis, axis=1) - radius
        assert np.abs(off).max() < 0.03 * MM, part.name
    assert kinds.pop("board_floor") == kinds.pop("board_wall") == mujoco.mjtGeom.mjGEOM_BOX
    assert len(kinds) == 14
    assert set(kinds.values()) == {mujoco.mjtGeom.mjGEOM_CAPSULE}


@pytest.mark.parametrize("shape", ["ring", "box", "ball"])
def test_the_surface_of_an_object_is_closed(shape):
    import trimesh

    sizes = {"ring": (6.75 * MM, 0.7 * MM), "box": (1 * MM, 2 * MM, 3 * MM), "ball": (2 * MM,)}
    a, *more = sizes[shape]
    volume = {
        "ring": lambda: 2 * np.pi**2 * a * more[0] ** 2,
        "box": lambda: 8 * a * more[0] * more[1],
        "ball": lambda: 4 / 3 * np.pi * a**3,
    }[shape]()
    mesh = Movable("x", shape, sizes[shape], 1e-3, 0.5).mesh()
    body = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=True)
    assert body.is_watertight
    assert body.volume == pytest.approx(volume, rel=0.05)  # positive: seen from outside, triangles turn left


# -- the task ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def performed(davinci):
    return operate_console(only(davinci, "ring1", "ring2"), seed=1)


@pytest.mark.slow
def test_a_simulated_surgeon_brings_a_ring_with_each_hand(performed):
    board = performed.outcome.board
    assert performed.verdict == "agree"
    assert [(r.ring, r.peg) for r in board.rings] == [("ring1", "board_peg_right"), ("ring2", "board_peg_left")]
    assert (board.transferred, board.dropped) == (2, 0)
    assert board.errors == board.collisions
    assert 5 < board.time < 30
    kept = performed.run.recording
    for k, name in enumerate(("ring1", "ring2")):
        holder = kept[f"{name}.holder"][:, 0]
        assert set(holder) == {-1.0, float(k)}
        T = kept[f"{name}.pose"].reshape(-1, 4, 4)
        assert T[0, 2, 3] > 920 * MM  # on the wall
        assert T[-1, 2, 3] == pytest.approx(895.7 * MM, abs=0.1 * MM)  # flat on the floor
    for name in ("ring3", "ring4"):  # nobody touches these
        T = kept[f"{name}.pose"].reshape(-1, 4, 4)
        assert np.linalg.norm(T[-1, :3, 3] - T[0, :3, 3]) < 0.5 * MM


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_bytes_and_they_replay(davinci, tmp_path):
    scene = only(davinci, "ring1")
    digests = set()
    for _ in range(2):
        found = operate_console(scene, seed=5)
        digests.add(hashlib.sha256(found.recorded).hexdigest())
    assert len(digests) == 1
    (tmp_path / FILE).write_bytes(found.recorded)
    replayed = replay_session(tmp_path / FILE, scene)
    assert replayed.verdict == "agree"
    assert replayed.run.difference is None
    assert replayed.outcome.board == found.outcome.board
    other = replace(scene, objects=tuple(replace(o, friction=0.61) for o in scene.objects))
    with pytest.raises(TwinError, match="has changed since this session"):
        replay_session(tmp_path / FILE, other)


@pytest.mark.nightly
def test_slippery_rings_stay_where_they_are(davinci):
    scene = only(
        davinci,
        "ring1",
        objects=tuple(replace(o, friction=0.0) for o in davinci.objects),
        contact=davinci.contact.model_copy(update={"friction": 0.0}),
    )
    found = operate_console(scene, seed=1)
    assert found.verdict == "disagree"
    assert found.outcome.board.transferred == 0
    assert found.word == "Not all rings are on their pegs"
    assert [f.where for f in found.findings if f.code == "task.missed"] == ["ring1"]


@pytest.mark.nightly
def test_four_rings_by_the_command(tmp_path, capsys):
    assert main(["operate", "davinci", "--task", "pegboard", "--seed", "3", "--json", "--out", str(tmp_path)]) == 0
    data = json.loads(capsys.readouterr().out)
    board = data["board"]
    assert board["rings_transferred"] == 4
    assert board["errors"] == board["rings_dropped"] + board["instrument_collisions"]
    table = np.genfromtxt(tmp_path / "session.csv", delimiter=",", names=True)
    assert table["ring1_z_m"][0] > 0.92
    assert table["ring1_z_m"][-1] < 0.9
    assert table["ring1_holder"].max() == 0
    with (tmp_path / "session.mcap").open("rb") as file:
        _, _, message = next(make_reader(file).iter_messages(["/tf"]))
    places = {t["child_frame_id"]: t["translation"] for t in json.loads(message.data)["transforms"]}
    assert places["ring1"]["z"] == pytest.approx(table["ring1_z_m"][0], abs=1e-6)
    assert (tmp_path / "session.png").stat().st_size > 10_000


# -- how it is judged ----------------------------------------------------------------------------------------

PEG = Peg("peg", np.array([0, 0, 0.025]), np.zeros(3), 2.8e-3)
TASK = Transfers((Transfer(ring="ring", peg="peg"),))
RING = Movable("ring", "ring", (6.75 * MM, 0.7 * MM), 0.5e-3, 0.5)


def recorded(places, holders, touches=None, meets=None):
    """Return a recording: places (3,) in mm of a flat ring, its holder, collisions of two instruments; 0.1 s each."""
    k = len(places)
    zero = np.zeros((k, 1))
    columns = {
        "ring.pose": np.array([spatial.pose(p=np.array(p) * MM).ravel() for p in places]),
        "ring.holder": np.reshape(holders, (k, 1)),
        "a.follows": zero + 1,
        "b.follows": zero + 1,
        "a.touches": zero if touches is None else np.reshape(touches, (k, 1)),
        "b.touches": zero,
        "a.meets": zero if meets is None else np.reshape(meets, (k, 1)),
        "b.meets": zero if meets is None else np.reshape(meets, (k, 1)),
    }
    sizes = {n: v.shape[1] for n, v in columns.items()}
    return Recording(0.1, sizes, np.column_stack(list(columns.values())).astype(float))


def judged(*args, **more):
    return ring_referee.measure(recorded(*args, **more), TASK, [RING], {"peg": PEG}, ["a", "b"])


AWAY, ON, FLOOR = (40, 0, 30), (1, 0, 1), (40, 0, 1)


def test_a_ring_is_transferred_when_it_lies_on_its_peg_without_a_hand():
    found = judged([AWAY, AWAY, (0, 0, 20), ON, ON], [-1, 0, 0, -1, -1])
    assert (found.transferred, found.dropped, found.time) == (1, 0, pytest.approx(0.3))
    held = judged([AWAY, AWAY, (0, 0, 20)], [-1, 0, 0])
    assert (held.transferred, held.dropped) == (0, 0)
    beside = judged([AWAY, AWAY, (8, 0, 1), (8, 0, 1)], [-1, 0, -1, -1])
    assert beside.transferred == 0
    above = judged([AWAY, AWAY, (0, 0, 27), (0, 0, 27)], [-1, 0, -1, -1])
    assert above.transferred == 0


def test_a_ring_that_falls_from_a_hand_is_dropped():
    fell = judged([AWAY, AWAY, AWAY, FLOOR, FLOOR], [-1, 0, -1, -1, -1])
    assert (fell.transferred, fell.dropped, fell.errors) == (0, 1, 1)
    caught = judged([AWAY, AWAY, AWAY, AWAY, AWAY], [-1, 0, -1, 0, 0])
    assert caught.dropped == 0
    put_back = judged([AWAY, AWAY, AWAY, AWAY, AWAY, AWAY], [-1, 0, -1, -1, -1, -1])
    assert put_back.dropped == 0
    never_held = judged([AWAY, FLOOR, FLOOR], [-1, -1, -1])
    assert never_held.dropped == 0


def test_collisions_are_counted_once_each():
    touches = [0, 1, 1, 0, 1, 0, 0, 0, 1, 1]  # interrupted for 0.1 s: one; after 0.3 s: another
    assert judged([AWAY] * 10, [-1] * 10, touches=touches).collisions == 2
    assert judged([AWAY] * 10, [-1] * 10, meets=touches).collisions == 2


# -- bad input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("size_mm = [6.75, 0.7]", "size_mm = [6.75]", "a ring needs 2 lengths above 0; [6.75] was given"),
        ("size_mm = [6.75, 0.7]", "size_mm = [0.6, 0.7]", "a ring needs a hole"),
        ("friction = 0.6", "friction = -0.6", "object.ring1.friction"),
        ("mass_g = 0.5", "mass_g = 0", "object.ring1.mass_g"),
        ("axis = [0, 1, 0]", "axis = [0, 0, 0]", "the axis is a zero vector"),
        ("axis = [0, 1, 0]", "axis = [0, 1e200, 0]", "the axis has the length 1e+200"),
        ('color = "#e0a81c"', 'color = "gold"', "object.ring1.color"),
        ('ring = "ring1"', 'ring = "ring5"', "there is no object 'ring5'. Did you mean"),
        ('ring = "ring2"', 'ring = "ring1"', "'ring1' is listed twice"),
        ("[contact]", "[task.contact]", "task"),
        ("jaw_effort_n_mm = 20", "jaw_effort_n_mm = 0", "contact.jaw_effort_n_mm"),
        ("transfer = [", "hold_s = 1\ntransfer = [", "a task with `transfer` takes no `hold_s`"),
    ],
)
def test_a_wrong_object_is_named(davinci, tmp_path, old, new, text):
    assert text in refused(davinci, tmp_path, old, new)


def test_a_wrong_peg_or_body_is_named(davinci, props):
    task = davinci.tasks["pegboard"]
    wrong = replace(task, goal=Transfers((Transfer(ring="ring1", peg="board_peg_rihgt"),)))
    with pytest.raises(TwinError, match=r"there is no peg 'board_peg_rihgt'\. Did you mean 'board_peg_right'"):
        contact_scene.pegs(davinci, props, wrong)
    scene = replace(davinci, contact=davinci.contact.model_copy(update={"solid": ["bord"]}))
    with pytest.raises(TwinError, match=r"there is no props body 'bord'"):
        contact_scene.pegs(scene, props, task)
    with pytest.raises(TwinError, match="no contact: add a section"):
        contact_scene.pegs(replace(davinci, contact=None), props, task)


def test_a_peg_without_another_part_is_named(davinci, props):
    task = davinci.tasks["pegboard"]
    peg = task.goal.transfers[0].peg
    alone = [replace(b, meshes=tuple(m for m in b.meshes if m.name == peg) or b.meshes) for b in props.bodies]
    with pytest.raises(TwinError, match=f"task 'pegboard': '{peg}' is the only part of its body"):
        contact_scene.pegs(
            davinci, replace(props, bodies=tuple(alone)), replace(task, goal=Transfers(task.goal.transfers[:1]))
        )


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["view", "sils", "--task", "pegboard"], "--task is for the live console of a scene"),
        (["view", "davinci", "--task", "pegbord"], "there is no task 'pegbord'. Did you mean 'pegboard'?"),
    ],
)
def test_a_wrong_task_is_named_before_a_page_opens(arguments, text, capsys):
    assert main([*arguments, "--port", "0", "--no-browser"]) != 0
    assert text in capsys.readouterr().err
