"""The operating scene: ports, distances against hand-made cases, one stage of references, and its refusals."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import twin
from twin.api import scene_export
from twin.cli import main
from twin.core import spatial
from twin.core.errors import DescriptionError, TwinError
from twin.model.body import Body, Frame, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.scene import load_scene
from twin.reference.clearance import between
from twin.simulation.scene_play import Actor, play, too_near

ROOT = Path(__file__).parents[2]
VSRS = ROOT / "cad/vsrs/scene.toml"
MM = 1e-3


def cube(name, half=0.05):
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
             [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    mesh = Mesh(f"{name}_cube", corners, np.array(faces, np.int32), (0.5, 0.5, 0.5, 1.0))
    bodies = (Body("base", (mesh,)), Body("top"))
    joint = Joint("j", "revolute", "base", "top", active=True)
    return Mechanism(name, "base", bodies, (joint,), (Frame("tool", "top", np.eye(4)),))


def test_distances_between_owners_are_those_of_the_shapes():
    x = np.array([0.5, 0.3, 0.12, 0.08])
    still, moving = np.tile(np.eye(4), (4, 1, 1)), np.array([spatial.pose(p=[v, 0, 0]) for v in x])
    mechanisms = {"a": cube("a"), "b": cube("b")}
    poses = {"a": {"base": still, "top": still}, "b": {"base": moving, "top": moving}}
    found = between(mechanisms, poses)
    assert list(found) == [("a", "b")]
    np.testing.assert_allclose(found["a", "b"].distance, np.maximum(x - 0.1, 0), atol=1e-12)
    assert found["a", "b"].pair[0] == ("a/base", "b/base")
    free = between(mechanisms, poses, frozenset({frozenset(("a/base", "b/base"))}))
    assert np.isinf(free["a", "b"].distance).all()


def test_the_scene_stands_as_its_file_says():
    scene = load_scene(VSRS)
    assert [p.name for p in scene.places] == ["pa10", "lapbot", "hibou"]
    trocars = {"pa10": [0.32, 0.48, 0.10], "lapbot": [0.40, 0, 0.30], "hibou": [0.40, 0, 0.30]}
    for place in scene.places:
        at = (place.T_world_base @ [*trocars[place.name], 1])[:3]
        np.testing.assert_allclose(at, place.p_world_ports[""], atol=1e-6)
    assert {p.provenance for p in scene.parameters} == {"ASSUMED"}


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('port = "left"', 'port = "lefd"', "there is no port 'lefd'. Did you mean 'left'?"),
        ('robot = "hibou"', 'robot = "hibu"', "there is no robot 'hibu'. Did you mean 'hibou'?"),
        ('name = "lapbot"', 'name = "pa10"', "'pa10' is listed twice"),
        ("clearance_mm = 5.0", "clearance_mm = -5.0", "clearance_mm"),
        ('props = "theatre.toml"', 'props = "theater.toml"', "there is no file theater.toml in the folder"),
        (
            '"lapbot/cannula", "theatre/patient"',
            '"lapbot", "theatre/patient"',
            r"'lapbot' is not a body; write \"owner/body\"",
        ),
        ('"lapbot/cannula", "theatre/patient"', '"lapbot/cannula", "lapbot/cannula"', "two different bodies"),
        (
            '"lapbot/cannula", "theatre/patient"',
            '"lapbt/cannula", "theatre/patient"',
            "there is no robot 'lapbt'. Did you mean 'lapbot'?",
        ),
    ],
)
def test_a_wrong_scene_is_named(tmp_path, old, new, text):
    shutil.copy(VSRS.with_name("theatre.toml"), tmp_path)
    body = VSRS.read_text(encoding="utf-8")
    assert old in body
    (tmp_path / "scene.toml").write_text(body.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError, match=text.replace("?", r"\?")):
        load_scene(tmp_path / "scene.toml")


@pytest.mark.slow
def test_three_robots_work_without_meeting(tmp_path, capsys):
    assert main(["run", "vsrs", "--json", "--out", str(tmp_path / "vsrs")]) == 0
    data = json.loads(capsys.readouterr().out)
    assert len(data["pairs"]) == 6
    assert min(p["least_mm"] for p in data["pairs"].values()) >= data["clearance_mm"]
    stage = Usd.Stage.Open(str(tmp_path / "vsrs/usd/vsrs/vsrs.usda"))
    robots = [stage.GetPrimAtPath(f"/vsrs/{n}") for n in ("pa10", "lapbot", "hibou")]
    assert all(p.HasAuthoredReferences() for p in robots)
    cache = UsdGeom.XformCache(Usd.TimeCode(400))
    ball = cache.GetLocalToWorldTransform(stage.GetPrimAtPath("/vsrs/hibou/cannula")).ExtractTranslation()
    port = next(p.p_world_ports[""] for p in load_scene(VSRS).places if p.name == "hibou")
    np.testing.assert_allclose(np.array(ball), port, atol=1e-5)
    camera = stage.GetPrimAtPath("/vsrs/hibou/camera/endoscope")
    assert camera.IsA(UsdGeom.Camera)
    look = np.array(cache.GetLocalToWorldTransform(camera)).T @ [0, 0, -1, 0]
    assert look[2] < -0.9  # into the patient
    assert (tmp_path / "vsrs/scene.png").stat().st_size > 10_000


@pytest.mark.nightly
def test_a_base_beside_its_place_and_robots_that_meet_are_found(tmp_path, capsys):
    """Seeded: Hibou moved by 150 mm towards Lapbot runs into it and misses its port by as much."""
    for file in ("theatre.toml", "vsrs.step"):
        shutil.copy(VSRS.with_name(file), tmp_path)
    body = VSRS.read_text(encoding="utf-8").split("[anatomy]")[0]
    hibou = next(p for p in load_scene(VSRS).places if p.name == "hibou")
    x, y, z = hibou.T_world_base[:3, 3] / MM
    (head, tail) = body.split('name = "hibou"\n', 1)
    start = tail.index("position_mm")
    line = tail[start : tail.index("\n", start)]
    tail = tail.replace(line, f"position_mm = [{x - 60}, {y + 150}, {z}]", 1)
    (tmp_path / "scene.toml").write_text(head + 'name = "hibou"\n' + tail, encoding="utf-8")
    assert main(["run", str(tmp_path), "--json", "--out", str(tmp_path / "out")]) == 1
    found = {f["code"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert found["scene.port"]["size"] == pytest.approx(np.hypot(60, 150), abs=0.1)
    assert "move its base by (60.00, -150.00" in found["scene.port"]["suggestion"]
    assert {"scene.start", "scene.collision", "scene.near"} & set(found)


def test_a_start_in_collision_names_the_nearest_free_one():
    x = np.array([0.05, 0.09, 0.12, 0.2])
    still, moving = np.tile(np.eye(4), (4, 1, 1)), np.array([spatial.pose(p=[v, 0, 0]) for v in x])
    poses = {"a": {"base": still, "top": still}, "b": {"base": moving, "top": moving}}
    found = between({"a": cube("a"), "b": cube("b")}, poses)["a", "b"]
    t = np.arange(4.0)
    finding = too_near(found, int(np.argmin(found.distance)), t, 0.005)
    assert (finding.code, finding.where, finding.when) == ("scene.start", "a/base, b/base", "t = 0.0 s")
    start = "start the protocols from their poses at t = 2.0 s, the first time with a clearance of 5 mm"
    assert start in finding.suggestion
    assert "below 150 mm throughout both protocols" in too_near(found, 0, t, 0.15).suggestion


def test_motions_shorter_than_the_time_between_two_measured_clearances_are_played(monkeypatch):
    monkeypatch.setattr("twin.simulation.scene_play._port", lambda actor: [])
    actors = []
    for name, x in (("a", 0.0), ("b", 0.3)):
        motion = SimpleNamespace(q=np.array([[0.0], [0.1]]), duration=0.04, joints=lambda t: 2.5 * t[:, None])
        place = SimpleNamespace(name=name, T_world_base=spatial.pose(p=[x, 0, 0]))
        actors.append(Actor(place, cube(name), motion, {}))  # type: ignore[arg-type]
    scene = SimpleNamespace(clearance=0.005, touching=frozenset())
    played = play(scene, actors, None)  # type: ignore[arg-type]
    np.testing.assert_allclose(played.t, [0.0, 0.04])
    np.testing.assert_allclose(played.by_pair["a", "b"].distance, 0.2, atol=1e-9)


def one_robot(tmp_path):
    """Write a scene with Hibou alone, and return its file."""
    text = VSRS.read_text(encoding="utf-8")
    text = re.sub(r"touching = \[.*?\n\]\n|props = [^\n]*\n", "", text, flags=re.DOTALL)
    head, *robots = text.partition("[camera")[0].split("[[robot]]")
    one = next(r for r in robots if 'name = "hibou"' in r)
    (tmp_path / "scene.toml").write_text(f"{head}[[robot]]{one}", encoding="utf-8")
    return tmp_path / "scene.toml"


def test_a_scene_is_loaded_by_name_and_by_path_shown_as_a_world_and_played(tmp_path):
    assert [p.name for p in twin.load_scene("vsrs").places] == ["pa10", "lapbot", "hibou"]
    with pytest.raises(TwinError, match=r"there is no scene 'vsr'\. Did you mean 'vsrs'"):
        twin.load_scene("vsr")
    scene = twin.load_scene(one_robot(tmp_path).parent)
    world = twin.world(scene, dt=0.01)
    world.step(100)
    T = world.frame().link_poses["hibou"]["base"]
    np.testing.assert_allclose(T, scene.places[0].T_world_base, atol=1e-12)
    played = twin.play(scene)
    assert (played.verdict, dict(played.by_pair)) == ("agree", {})
    assert played.as_dict()["robots"][0]["name"] == "hibou"
    assert "hibou" in str(list(played.text()))


@pytest.mark.nightly
def test_a_scene_is_exported_robot_by_robot_and_stands_in_one_stage(tmp_path, capsys):
    """One robot of a scene does for all: it stands beside its base, turned."""
    one_robot(tmp_path)
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "scene.toml"), "--to", "usd", "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["verdict"], [r["verdict"] for r in said["robots"]]) == ("agree", ["agree"])
    scene = load_scene(tmp_path / "scene.toml")
    np.testing.assert_array_equal(json.loads((out / "scene.json").read_text())["robots"][0]["T_world_base"],
                                  scene.places[0].T_world_base)  # fmt: skip
    stage = out / "usd" / f"{scene.name}.usda"
    assert not stage.with_name(f"{scene.name}_sim.usda").exists()  # its motions are baked
    report = twin.audit(out)
    assert report.verdict == "agree"
    assert {c.file.split("/")[0] for c in report.checks} == {"scene.json", "hibou", "usd"}
    with pytest.raises(TwinError, match="is an exported scene: omit the robot"):
        twin.audit(out, "hibou")
    where = re.search(r"xformOp:translate = \((\S+),", stage.read_text())
    assert where is not None
    moved = stage.read_text().replace(where[1], str(float(where[1]) + 1e-4), 1)
    stage.write_text(moved)
    own = Usd.Stage.Open(str(out / "hibou/usd" / f"hibou_{scene.places[0].protocol}.usda"))
    links = [p.GetName() for p in own.GetDefaultPrim().GetChildren() if p.IsA(UsdGeom.Xform)]
    cache = UsdGeom.XformCache(0.0)
    poses = {n: np.array(cache.GetLocalToWorldTransform(own.GetDefaultPrim().GetChild(n))).T[None] for n in links}
    motion = SimpleNamespace(clip=SimpleNamespace(times=np.array([0.0])), judged=poses)
    bundle = SimpleNamespace(order=SimpleNamespace(scenes=[motion]))
    (found,) = (f for f in twin.audit(out).findings if f.code == "scene.link")
    assert (found.severity, found.size) == ("disagreement", pytest.approx(1e-4, rel=1e-3))
    seen = scene_export._check(stage, scene, {"hibou": bundle})  # type: ignore[dict-item]
    assert seen["verdict"] == "disagree"
    assert seen["worst"] == pytest.approx(1e-4, rel=1e-3)


def test_a_robot_without_a_protocol_is_exported_where_the_console_takes_it_over():
    (place,) = (p for p in twin.load_scene("davinci").places if p.name == "ecm")
    robot = scene_export._robot(place)
    home = robot.reference().home()
    shown = {"q2": np.degrees(home.q_full["q2"]), "q3": home.q_full["q3"] / MM}
    assert shown == pytest.approx({n: place.start[n] for n in shown}, abs=1e-9)
    assert max(p for p, _ in home.gap.values()) < 1e-12
    assert robot.mechanism.posture("home") == pytest.approx(twin.load("davinci_ecm").mechanism.posture("home"))
    assert all(b.inertia for b in robot.mechanism.bodies)


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ({"T_world_base": [[1]]}, "scene.pose"),
        ({"folder": "../elsewhere"}, "scene.folder"),
        ({"folder": "nothing"}, "scene.folder"),
        ({"name": None, "robots": 0}, "scene.unreadable"),
    ],
)
def test_the_audit_says_what_a_file_of_a_scene_lacks(tmp_path, entry, code):
    row = {"name": "one", "protocol": "", "folder": "one", "T_world_base": np.eye(4).tolist()} | entry
    robots = [{k: v for k, v in row.items() if v is not None}]
    (tmp_path / "scene.json").write_text(json.dumps({"robots": robots}))
    report = twin.audit(tmp_path)
    assert [f.code for f in report.findings if f.severity == "error"] == [code]
    assert report.verdict == "unchecked"
