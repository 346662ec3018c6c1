"""A robot with two trocars, from its folder to files and screens, and what is said when one of them is elsewhere."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Sdf

import twin
from made import protocols
from made import two_trocars as made
from made.loops import through_a_trocar, two_links
from twin.analysis.mutation.units import _trocar_fault
from twin.core import spatial
from twin.core.errors import DescriptionError, MechanismError, ProtocolError, TwinError
from twin.core.units import MM
from twin.exchange.audit import audit
from twin.model.scene import Place, load_scene
from twin.planning import phase_path as paths
from twin.planning.protocol import load_protocol
from twin.simulation.scene_play import Actor as Playing
from twin.simulation.scene_play import _port, trocars_of
from twin.ui.headset.state_document import trocar_entries
from twin.ui.session.movable_robot import MovableRobot
from twin.ui.session.patient import patient_of
from twin.ui.session.readings import read
from twin.ui.session.robot_file_edits import ends_in_patient
from twin.ui.session.timeline import prepare
from twin.ui.session.trocars import in_trocars
from twin.ui.viewer import readout
from twin.ui.viewer.front import ShownRobot
from twin.ui.viewer.page import open_page
from twin.ui.viewer.server import serve
from twin.usd.read import read_stage
from twin.validation.baked_motion import written_trocars
from twin.validation.stage_content import compare_content

AWAY = np.array([1 * MM, 0, 0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made.write(tmp_path_factory.mktemp("trocars") / made.NAME)


@pytest.fixture(scope="module")
def robot(folder):
    return twin.load(folder)


@pytest.fixture(scope="module")
def moved(robot):
    """The trajectory through the trocars of the protocol `moved`."""
    return twin.plan(robot, "moved")


def _said(findings, name):
    """Return the findings that speak of a trocar by its name and are no mere information."""
    return [f for f in findings if f.severity != "info" and re.search(rf"\b{name}\b", f"{f.where} {f.message}")]


def _file(tmp_path, text, name="stitch"):
    path = tmp_path / f"{name}.toml"
    path.write_text(text, "utf-8")
    return path


# -- the model --------------------------------------------------------------------------------------------------------


def test_trocars_are_told_apart_by_name(robot):
    m = robot.mechanism
    assert m.trocars == tuple(made.PLACES)
    there = m.with_trocar(made.MOVED["right"], "right")
    np.testing.assert_allclose(there.trocar_at("right"), made.MOVED["right"], atol=1e-15)
    np.testing.assert_array_equal(there.trocar_at("left"), m.trocar_at("left"))
    with pytest.raises(MechanismError, match="trocars left, right: choose one by name"):
        m.trocar_at()
    with pytest.raises(MechanismError, match=r"no trocar 'rigth'\. Did you mean 'right'"):
        m.with_trocar(AWAY, "rigth")
    with pytest.raises(MechanismError, match="trocar 'left' is listed twice"):
        replace(m, trocars=("left", "left"))
    with pytest.raises(MechanismError, match="the parent of joint 'pin' must be the base"):
        replace(m, trocars=("left", "pin"))


def test_the_shaft_in_a_trocar_is_what_slides_there(robot):
    for name in made.PLACES:
        assert robot.mechanism.shaft_through(name).body == f"shaft_{name}"
    one = through_a_trocar()
    assert one.trocar_at() is not None
    assert one.shaft_through().body == "shaft"
    held = replace(two_links(), trocars=("a",))  # nothing slides in it
    assert held.shaft_through() is None


@pytest.mark.parametrize(
    ("new", "says"),
    [
        ('trocar = "left"\ntrocars = ["right"]', "add 'left' to `trocars` and delete `trocar`"),
        ('trocars = ["left", "rigth"]', r"trocars\[1\].*no joint 'rigth'\. Did you mean 'right'"),
        ('trocar = "lefd"', r"trocar: there is no joint 'lefd'\. Did you mean 'left'"),
    ],
)
def test_a_wrong_word_in_a_description_is_named(folder, tmp_path, new, says):
    own = shutil.copytree(folder, tmp_path / made.NAME)
    path = own / f"cad/{made.NAME}.toml"
    text = path.read_text("utf-8")
    assert 'trocars = ["left", "right"]' in text
    path.write_text(text.replace('trocars = ["left", "right"]', new), "utf-8")
    with pytest.raises(DescriptionError, match=says):
        _ = twin.load(own).mechanism


# -- planning and judging ---------------------------------------------------------------------------------------------


def test_both_shafts_stay_in_their_trocars(robot, moved):
    report = twin.validate(robot, moved)
    assert report.verdict == "agree", [f.message for f in report.findings]
    rows = {r.name: r for r in report.residuals if r.quantity == "rcm"}
    assert rows.keys() >= set(made.PLACES)
    assert max(rows[n].worst for n in made.PLACES) < 1e-12
    kept = [f for f in report.findings if f.code == "rcm.kept"]
    assert [f.where.split(",")[0] for f in kept] == ["trocar left"]


@pytest.fixture(scope="module")
def built(robot, tmp_path_factory):
    """The stage of the robot bound to `moved`, with that motion."""
    bound = robot.bound(robot.protocol("moved"))
    return twin.build(bound, tmp_path_factory.mktemp("built"), protocols=("moved",))[0]


def test_a_bound_robot_keeps_all_its_trocars(robot, built):
    """Weighed, built and read back; and bound again by a protocol that places them elsewhere."""
    bound = robot.bound(robot.protocol("moved"))
    stages = [read_stage(built.with_name(f"{made.NAME}{n}.usda")) for n in ("", "_moved")]
    for m in (bound.mechanism, bound.weighed().mechanism, *stages):
        assert m.trocars == bound.mechanism.trocars
        for n, place in made.MOVED.items():
            np.testing.assert_allclose(m.trocar_at(n), place, atol=1e-7)
    again = bound.bound(robot.protocol("stitch"))
    for n, place in made.PLACES.items():
        np.testing.assert_allclose(again.mechanism.trocar_at(n), place, atol=1e-15)
        for i, axis in enumerate("xyz"):
            assert again.kinematics().parameters[f"trocar_{n}_{axis}"] == pytest.approx(place[i], abs=1e-15)


def test_a_protocol_that_has_a_trocar_beside_its_poses_is_refused_by_name(robot, tmp_path):
    stated = {**made.MOVED, "left": made.MOVED["left"] + AWAY}
    with pytest.raises(ProtocolError, match=r"'to_deep' \(pivot\): .* shaft is .* beside trocar 'left'"):
        twin.plan(robot, _file(tmp_path, made.protocol("moved", made.MOVED, stated), "moved"))


@pytest.mark.slow
def test_a_trocar_that_was_moved_after_the_motion_was_baked_is_told_by_name(robot, moved, built, tmp_path):
    """No pose of the protocol depends on the right one: only what holds it tells."""
    stated = {**made.MOVED, "right": made.MOVED["right"] + AWAY}
    file = _file(tmp_path, made.protocol("moved", made.MOVED, stated), "moved")
    (found,) = _said(twin.validate(robot, moved, protocol=file, stage=built, baked=True).findings, "right")
    assert (found.code, found.severity, found.where) == ("baked.trocar", "disagreement", "right")
    assert found.size == pytest.approx(1, abs=1e-4)
    cad = robot.bound(load_protocol(file)).cad
    moved = built.with_name(f"{made.NAME}_moved.usda")
    findings = written_trocars(moved, cad.mechanism, due=False)
    assert [(f.where, f.severity) for f in findings] == [("right", "warning")]  # it may just be older
    assert not written_trocars(moved, robot.bound(robot.protocol("moved")).cad.mechanism, due=False)


@pytest.mark.nightly
def test_equations_that_have_one_trocar_elsewhere_are_told_by_name(folder, tmp_path):
    own = shutil.copytree(folder, tmp_path / made.NAME)
    file = own / "formula.py"
    text = file.read_text("utf-8")
    wrong = text.replace("np.array([trocar_right_x,", "np.array([trocar_right_x + 0.001,")
    assert wrong.count("+ 0.001") == 2
    file.write_text(wrong, "utf-8")
    report = twin.validate(twin.load(own))
    assert report.verdict == "disagree"
    (row,) = [r for r in report.residuals if r.name == "at_right"]
    assert row.worst == pytest.approx(1 * MM, abs=1e-9)
    assert next(r for r in report.residuals if r.name == "at_left").agrees


@pytest.mark.nightly
def test_a_shaft_beside_its_trocar_is_told_by_name(folder, tmp_path):
    """The tube's bore is drawn 0.5 mm beside the place that it turns about, and what slides in it with it."""
    own = shutil.copytree(folder, tmp_path / made.NAME)
    path = own / f"cad/{made.NAME}.toml"
    text = path.read_text("utf-8")
    head, slide, tail = re.split(r'(name = "q_right".*?)(?=\n\n)', text, maxsplit=1, flags=re.S)
    slide, count = re.subn(r"(position_mm = \[)([^,]+)", lambda x: f"{x[1]}{float(x[2]) + 0.5!r}", slide)
    assert count == 2
    path.write_text(head + slide + tail, "utf-8")
    report = twin.validate(twin.load(own))
    (found,) = [f for f in report.findings if f.code == "rcm.trocar"]
    assert (found.where, found.severity) == ("right", "disagreement")
    assert 0.1 < found.size < 0.5


def test_a_mark_that_is_lost_on_the_stage_is_told_by_name(robot):
    said = compare_content(robot.mechanism, replace(robot.mechanism, trocars=("left",)), robot.cad.description)
    assert [(f.where, f.message) for f in said] == [("right", "trocar 'right' is not marked as a trocar on the stage")]
    said = compare_content(replace(robot.mechanism, trocars=()), robot.mechanism, robot.cad.description)
    assert {f.where for f in said} == {"left", "right"}


# -- what a protocol may say -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('trocar = "left"', 'trocar = "lefd"', r"no trocar 'lefd'. Did you mean 'left'\?.*\[trocars_mm\]"),
        ("[trocars_mm]", "trocar_mm = [0, 0, 0]\n[trocars_mm]", r"trocar_mm.*gives the position of the only trocar"),
        ("right = [", "rigth = [", r"has a trocar 'rigth'.*has left, right"),
        ('type = "pivot"\nto = "deep"\nrcm = "enforced"\ntrocar = "left"', 'type = "insertion"\ndepth_mm = 5',
         "name the trocar of this insertion"),
        ('trocar = "left"', "", "no RCM is registered yet"),
        ('to = "deep"\nrcm = "enforced"\ntrocar = "left"', 'to = "deep"\nrcm = "enforced"\ntrocar = "right"',
         "beside trocar 'right'"),
    ],
)  # fmt: skip
def test_a_wrong_word_on_trocars_is_named(robot, tmp_path, old, new, says):
    text = made.protocol().replace("[limits.pivot]", protocols.limits("insertion", made.LIMITS) + "\n[limits.pivot]")
    assert old in text
    with pytest.raises(TwinError, match=says):
        twin.plan(robot, _file(tmp_path, text.replace(old, new).replace('trocar = "right"\nprov', "prov")))


def test_one_place_is_for_one_trocar(robot, tmp_path):
    text = re.sub(r"\[trocars_mm\]\n.*\n.*\n", "", made.protocol())
    text = re.sub(r'(rcm = "enforced"\n)trocar = "left"\n', r"\1", text)
    text = text.replace('start = "start"\n', 'start = "start"\ntrocar_mm = [0, 0, 0]\nrcm_mm = [-120, 0, 300]\n')
    with pytest.raises(ProtocolError, match=r"has trocars left, right: give their positions by name in \[trocars_mm\]"):
        twin.plan(robot, _file(tmp_path, text))


def test_an_insertion_begins_at_the_trocar_that_it_names(tmp_path):
    """Of a robot that has no joint for it: the protocol alone knows two trocars, and goes in through one of them."""
    pa10 = twin.load("pa10")
    text = pa10.files.protocols()["circle"].read_text("utf-8")
    first, rest = text.split('type = "insertion"\n', 1)
    entry = next(
        w.position for w in load_protocol(pa10.files.protocols()["circle"]).waypoints.values() if w.label == "trocar"
    )

    def named(place, name="b"):
        places = f"[trocars_mm]\na = [0, 0, 0]\nb = {[float(v) for v in place / MM]}\n\n[patient]"
        out = first.replace("[patient]", places) + f'type = "insertion"\ntrocar = "{name}"\n' + rest
        return _file(tmp_path, out.replace('type = "circle"', 'type = "circle"\ntrocar = "b"', 1), "circle")

    protocol = load_protocol(named(entry))
    with pytest.raises(ProtocolError, match=r"trocar 'a'.*no phase names it"):
        pa10.bound(protocol)
    protocol = replace(protocol, trocars={"b": entry})
    assert pa10.bound(protocol) is pa10
    np.testing.assert_allclose(protocol.first_rcm, entry)
    T = pa10.mechanism.frame_in_tool(protocol.frame)
    plain = paths.build(pa10.protocol("circle"), T)
    for path, same in zip(paths.build(protocol, T), plain, strict=True):
        assert (path.rcm is None) == (same.rcm is None)
        assert path.rcm is None or np.array_equal(path.rcm, same.rcm)
    away = replace(protocol, trocars={"b": entry + AWAY})
    with pytest.raises(ProtocolError, match=r"phase 'insert' \(insertion\): .* tip is 1.000 mm from trocar 'b'"):
        twin.plan(pa10, away)


def test_an_instrument_that_begins_in_a_trocarends_in_patient(robot):
    assert ends_in_patient(robot.protocol("stitch"))


def test_a_trocar_in_metres_is_among_the_faults_that_are_looked_for(tmp_path, rng):
    document = {"trocars_mm": {"left": [1.0, 2.0, 3.0], "right": [4.0, 5.0, 6.0]}}
    said = {_trocar_fault(json.loads(json.dumps(document)), rng) for _ in range(20)}
    assert said == {"trocar 'left' in metres", "trocar 'right' in metres"}


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def exported(robot, tmp_path_factory):
    out = tmp_path_factory.mktemp("exported") / "export"
    bundle = twin.export(robot, None, out, ("usd", "mjcf", "urdf", "tracks"))
    assert bundle.verdict == "agree", [f.message for f in bundle.findings]
    return out


@pytest.mark.slow
def test_each_format_has_both_where_the_protocol_has_them(exported, moved):
    stage = read_stage(exported / f"usd/{made.NAME}_moved.usda")
    for n, place in made.MOVED.items():
        np.testing.assert_allclose(stage.trocar_at(n), place, atol=1e-7)
    for suffix in ("xml", "urdf"):
        drawn, own = (exported / f"{made.NAME}{n}.{suffix}" for n in ("", "_moved"))
        for text, places in ((drawn, made.PLACES), (own, made.MOVED)):
            for place in places.values():
                assert f'"{" ".join(f"{v:.12g}" for v in place)}"' in text.read_text("utf-8")


def _stage(folder, file):
    layer = Sdf.Layer.FindOrOpen(str(folder / file))
    at = layer.GetAttributeAtPath(f"/{made.NAME}/joints/right.physics:localPos0")
    at.default = at.default + type(at.default)(*map(float, AWAY))
    layer.Save()


def _text(folder, file):
    places = made.MOVED if "moved" in file else made.PLACES
    old, new = (f'"{" ".join(f"{v:.12g}" for v in p)}"' for p in (places["right"], places["right"] + AWAY))
    path = folder / file
    assert old in path.read_text("utf-8")
    path.write_text(path.read_text("utf-8").replace(old, new), "utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "file", "beside"),
    [
        (_stage, "usd/physics.usda", "usd"),
        (_stage, "usd/motion/moved.usdc", "usd"),
        *((_text, f"{made.NAME}{n}.{kind}", f"*.{kind}") for n in ("", "_moved") for kind in ("xml", "urdf")),
    ],
)
def test_the_audit_names_the_trocar_that_is_elsewhere(exported, robot, tmp_path, seed, file, beside):
    """Beside the tracks lies what the file belongs to; with the mechanism as a witness it is no other trocar either."""
    folder = shutil.copytree(exported / "tracks", tmp_path / "export/tracks").parent
    shutil.copytree(exported / "meshes", folder / "meshes")
    for source in exported.glob(beside):
        (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / source.name)
    seed(folder, file)
    report = audit(folder, mechanism=robot.weighed().mechanism)
    assert report.verdict == "disagree"
    found = [f for f in report.findings if f.severity == "disagreement"]
    assert any("right" in f.where for f in found)
    # The instruments are pinned together: with one elsewhere, other efforts hold both, and an MJCF states them.
    assert not any("left" in f.where for f in found if f.code != "mjcf.claim")
    assert {f.where for f in found if f.code == "mjcf.claim"} <= {f"{file}: q_{n}" for n in made.PLACES}


# -- screens -----------------------------------------------------------------------------------------------------------


def test_both_trocars_are_read_and_told(robot):
    movable = MovableRobot(robot)
    movable.use_tool_frame_of(robot.protocol("stitch"))
    inside = {t.name: t for t in in_trocars(movable)}
    assert inside.keys() == made.PLACES.keys()
    depth = np.linalg.norm(made.NEEDLE - made.PLACES["left"])
    assert inside["left"].depth == pytest.approx(depth, abs=1e-9)
    assert inside["right"].depth is None  # the left instrument carries the tip
    for n, t in inside.items():
        np.testing.assert_allclose(t.place, made.PLACES[n], atol=1e-12)
        assert np.abs(np.cross(t.axis, made.shaft_axis(made.PLACES[n]))).max() < 1e-9
    assert movable.move_joints(np.array([0.02, -0.01])).good
    reading = read(movable)
    assert reading.rcm_error < 1e-9
    assert reading.agrees
    page = readout.table(reading)
    assert all(f"RCM error, {n}" in page for n in made.PLACES)


@pytest.mark.slow
def test_both_trocars_are_drawn_and_sent_where_the_protocol_has_them(robot, folder):
    playback = prepare(str(folder), "moved")
    actor = ShownRobot(made.NAME, str(folder), MovableRobot(robot))
    front = open_page("test", [actor], None, serve("test", "127.0.0.1", 0))
    try:
        actor.playback = playback
        actor.movable.bind(robot.bound(robot.protocol("moved")))
        front.clock.duration = playback.duration
        front.move_to_clock()
        front.scenery.follow()
        balls, lines = front.scenery.trocars._trocar_balls, front.scenery.trocars._shaft_lines
        assert len(balls) == len(lines) == 2
        for n, place in made.MOVED.items():
            ball = balls[f"{made.NAME}/{n}"]
            assert ball.visible
            assert lines[f"{made.NAME}/{n}"].visible
            np.testing.assert_allclose(ball.position, place, atol=1e-9)
        front.scenery.trail(False)
        front.scenery.follow()
        assert not any(h.visible for h in (*balls.values(), *lines.values()))
        sent = trocar_entries(actor.movable, playback, 0.0)
        assert [t["name"] for t in sent] == list(made.MOVED)
        assert all(t["error_m"] < 1e-9 for t in sent)
        np.testing.assert_allclose([t["at"] for t in sent], list(made.MOVED.values()), atol=1e-8)
    finally:
        front.close()


def test_the_patient_lies_at_the_trocar_that_the_protocol_names(robot, tmp_path):
    for name, places in (("stitch", made.PLACES), ("moved", made.MOVED)):
        np.testing.assert_allclose(patient_of(robot, robot.protocol(name), -0.2).port, places["right"], atol=1e-12)
    text = made.protocol().replace('trocar = "right"\n', "")
    with pytest.raises(TwinError, match="trocars left, right: choose one by name"):
        patient_of(robot, load_protocol(_file(tmp_path, text)), -0.2)


def test_each_trocar_of_a_scene_works_through_its_own_port(robot, moved, tmp_path):
    ports = {n: p + np.array([0, 0, 1.0]) for n, p in made.PLACES.items()}
    at, names = spatial.pose(p=[0, 0, 1]), {n: f"port_{n}" for n in ports}
    place = Place(made.NAME, made.NAME, "stitch", at, names, ports, {})
    m = robot.mechanism
    assert not _port(Playing(place, m, moved, trocars_of(place, m, moved)))
    off = replace(place, p_world_ports={**ports, "right": ports["right"] + AWAY})
    (found,) = _port(Playing(off, m, moved, trocars_of(off, m, moved)))
    assert "with trocar 'right' misses its port 'port_right'" in found.message
    with pytest.raises(TwinError, match="`ports` has no entry for trocar right"):
        trocars_of(replace(place, ports={"left": "a"}), m, moved)
    with pytest.raises(TwinError, match="choose one by name"):
        trocars_of(replace(place, ports={"": "a"}), m, moved)
    unheld = SimpleNamespace(trocars=())
    with pytest.raises(TwinError, match="has no trocar 'left'"):
        trocars_of(place, unheld, moved)
    scene = (made.Path(__file__).parents[2] / "cad/vsrs/scene.toml").read_text("utf-8")
    shutil.copy(made.Path(__file__).parents[2] / "cad/vsrs/theatre.toml", tmp_path)
    scene = scene[: scene.index("[anatomy]")]
    for new, says in (
        ('ports = { a = "left", b = "camera" }', None),
        ('ports = { a = "lefd" }', "no port 'lefd'"),
        ("", "give `port` for a robot with one trocar, or `ports"),
    ):
        path = _file(tmp_path, scene.replace('port = "left"', new, 1), "scene")
        if says is None:
            assert load_scene(path).places[1].ports == {"a": "left", "b": "camera"}
            continue
        with pytest.raises(DescriptionError, match=re.escape(says)):
            load_scene(path)
