"""What an interactive session keeps: postures, phases and recordings, and files that stay whole."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

import twin
from made.lanes import contrasting
from twin.cad.build import read_mechanism
from twin.core import spatial
from twin.core.errors import DescriptionError, OutputError, ProtocolError, TwinError
from twin.core.units import DEG
from twin.planning.phase_path import build
from twin.planning.protocol import load_protocol
from twin.planning.protocol.course import angles_of, rotation
from twin.ui.session.recorded_session import RecordedSession
from twin.ui.session.robot_file_edits import append_phase, save_posture
from twin.ui.session.toml_edits import TomlEntry, rewrite

ROOT = Path(__file__).parents[2]
PROTOCOLS = sorted(ROOT.glob("trajectories/*/*.toml"))
ENDS_INSIDE = (
    "davinci_ecm/look_around",
    "davinci_psm/about_port",
    "davinci_psm_si/about_port",
    "hibou/cavity",
    "sils/table2_printed",
)


def ident(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def by_joints(path: Path) -> bool:
    """Whether a waypoint has joint values: then only the mechanism knows where it is."""
    return any(w.joints is not None for w in load_protocol(path).waypoints.values())


@pytest.fixture(scope="module")
def robots():
    return {name: twin.load(name) for name in twin.names()}


@pytest.fixture
def copied(tmp_path):
    """A copy of a robot's description beside its CAD."""

    def copy(robot: str) -> Path:
        shutil.copytree(ROOT / "cad" / robot, tmp_path / robot, ignore=shutil.ignore_patterns("*.py"))
        return tmp_path / robot / f"{robot}.toml"

    return copy


@pytest.fixture
def protocol(tmp_path):
    def copy(name: str) -> Path:
        return Path(shutil.copy(ROOT / "trajectories" / f"{name}.toml", tmp_path))

    return copy


@pytest.fixture
def left_alone():
    """Check that a call is refused, says so in every word, and leaves the whole folder as it was."""

    def check(path: Path, call, kind: type[TwinError], *words: str) -> None:
        before = {p: p.read_bytes() for p in path.parent.rglob("*") if p.is_file()}
        with pytest.raises(kind) as caught:
            call()
        assert all(word in str(caught.value) for word in (*words, str(path))), str(caught.value)
        assert ".twin-" not in str(caught.value)
        assert {p: p.read_bytes() for p in path.parent.rglob("*") if p.is_file()} == before

    return check


def somewhere(mechanism, rng) -> dict[str, float]:
    """Values within the limits of every active joint."""
    return {j.name: float(rng.uniform(*j.limits)) for j in mechanism.active}


def lines_are_kept(old: str, new: str) -> bool:
    """Whether every line of the old text, comments among them, is in the new one, in order."""
    left = iter(new.splitlines())
    return all(line in left for line in old.splitlines())


# ------------------------------------------------------------------------------------------------- postures


@pytest.mark.slow
@pytest.mark.parametrize("name", contrasting())
def test_a_posture_comes_back_with_the_robot(name, copied, rng):
    path = copied(name)
    text = path.read_text()
    old = read_mechanism(path, with_mass=False).mechanism
    values = somewhere(old, rng)
    save_posture(path, "reached_up", values)
    new = read_mechanism(path, with_mass=False).mechanism
    np.testing.assert_allclose(new.posture("reached_up"), list(values.values()), rtol=0, atol=1e-9)
    for posture in old.postures:
        np.testing.assert_array_equal(new.posture(posture), old.posture(posture))
    assert list(new.postures) == [*old.postures, "reached_up"]
    written = path.read_text()
    assert lines_are_kept(text, written)
    assert written.startswith(text.rstrip("\n") + "\n\n[posture.reached_up]\n")
    assert re.fullmatch(r"(\w+_(mm|deg) = -?\d+\.\d{1,8}\n)+", written.split("[posture.reached_up]\n")[1])
    assert sorted(p.name for p in path.parent.iterdir() if p.name.startswith(".")) == []


def test_a_posture_is_replaced_in_its_place(copied):
    path = copied("sils")
    text = path.read_text()
    values = {f"q{i}": 0.1 * i for i in range(1, 6)} | {"q6": 0.25}
    save_posture(path, "insertion", values, replace=True)
    new = path.read_text()
    assert [line for line in new.splitlines() if "#" in line] == [line for line in text.splitlines() if "#" in line]
    changed = [b for a, b in zip(text.splitlines(), new.splitlines(), strict=True) if a != b]
    assert changed == [f"q{i}_mm = {100.0 * i}" for i in range(1, 6)] + ["q6_mm = 250.0"]


def test_a_value_is_rounded_but_not_out_of_its_limits(copied, robots):
    path = copied("sils")
    home = dict(robots["sils"].mechanism.postures["home"])
    save_posture(path, "low", home | {"q1": 0.02 - 1e-13, "q4": -1e-15, "q5": 0.3 + 4e-10})
    low = path.read_text().split("[posture.low]\n")[1]
    assert "q1_mm = 20.0\n" in low
    assert "q4_mm = 0.0\n" in low
    assert "q5_mm = 300.0\n" in low


def test_what_stands_below_the_postures_stays_below(copied, robots):
    path = copied("pa10")
    head, tail = "[[drive]]", "# ---- Drives\n# of Table 3\n\n"
    text = path.read_text()
    at = text.index("# ---- Postures")
    block = text[at:].rstrip("\n") + "\n# a last word on it\n\n"
    first = text.index(head)
    path.write_text(text[:first] + block + tail + text[first:at])
    old = path.read_text()
    save_posture(path, "up", robots["pa10"].mechanism.postures["home"])
    new = path.read_text()
    assert lines_are_kept(old, new)
    assert new.index("# a last word") < new.index("[posture.up]") < new.index("# ---- Drives") < new.index(head)
    assert tail + head in new


def test_a_first_posture_makes_its_table(copied, robots):
    path = copied("pa10")
    text = path.read_text()
    path.write_text(text[: text.index("# ---- Postures")])
    save_posture(path, "first", robots["pa10"].mechanism.postures["home"])
    assert list(read_mechanism(path, with_mass=False).mechanism.postures) == ["first"]


def test_windows_line_ends_stay(copied, robots):
    path = copied("pa10")
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    save_posture(path, "up", robots["pa10"].mechanism.postures["home"])
    data = path.read_bytes()
    assert b"[posture.up]\r\n" in data
    assert data.count(b"\n") == data.count(b"\r\n")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("home", {}, ["posture.home", "a posture of that name exists", "replace it"]),
        ("2nd", {}, ["posture.2nd", "must begin with a lower-case letter"]),
        ("Über oben", {}, ["must begin with a lower-case letter"]),
        ("", {}, ["must begin with a lower-case letter"]),
        (
            "up",
            {"q2": 0.6},
            ["posture.up.q2_mm", "600 mm is outside the limits 20 .. 580 mm of 'q2'", "move the joint back"],
        ),
        ("up", {"q3": float("nan")}, ["posture.up.q3_mm", "nan is not finite"]),
        ("up", {"q9": 0.1}, ["posture.up", "no active joint 'q9'", "q1, q2, q3, q4, q5, q6"]),
        ("up", {"q6": None}, ["posture.up", "active joint 'q6' is missing"]),
    ],
)
def test_a_posture_that_is_refused_changes_nothing(name, change, words, copied, left_alone, robots):
    path = copied("sils")
    values = {**robots["sils"].mechanism.postures["home"], **change}
    values = {k: v for k, v in values.items() if v is not None}
    left_alone(path, lambda: save_posture(path, name, values), DescriptionError, *words)


def test_a_posture_of_another_robot_is_refused(copied, left_alone, robots):
    path = copied("sils")
    values = robots["pa10"].mechanism.postures["home"]
    left_alone(path, lambda: save_posture(path, "up", values), DescriptionError, "no active joint 'q7'")


@pytest.mark.parametrize("text", [b"name = \n", b"\xff\xfe", b'name = "sils"\n'])
def test_a_broken_description_is_not_written(text, tmp_path, left_alone):
    path = tmp_path / "sils.toml"
    path.write_bytes(text)
    left_alone(path, lambda: save_posture(path, "up", {}), DescriptionError)


@pytest.mark.parametrize(
    ("text", "new"),
    [
        ("[t.a]\nx = 1 # one\n", "[t.a]\nx = 1 # one\n\n[t.b]\nx = 2\n"),
        ("# only this\n", "# only this\n\n[t.b]\nx = 2\n"),
        ("[t.a]\nx = 1\n# of a\n\n# of u\n[u]\n", "[t.a]\nx = 1\n# of a\n\n[t.b]\nx = 2\n\n# of u\n[u]\n"),
        ("[t.a]\nx = 1\n[u]\n[t.c]\nx = 3\n\n# of v\n[v]\n", None),
        ("[t]\na = {x = 1}\n[u]\n", None),
        ("[t]\na.x = 1\n[u]\n", None),
        ("t.a = {x = 1}\n[u]\n", None),
    ],
)
def test_a_table_finds_its_place_in_any_layout(text, new, tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(text)
    rewrite(path, [TomlEntry("t", "b", {"x": 2})], lambda fresh: None)
    written = path.read_text()
    assert new is None or written == new
    assert lines_are_kept(text, written)
    assert tomllib.loads(written)["t"]["b"] == {"x": 2}


@pytest.mark.parametrize(("text", "key"), [("t = {a = {x = 1}}\n", "b"), ("t = [{x = 1}]\n", None), ("u = 1\n", None)])
def test_a_layout_without_a_place_is_refused_not_spoilt(text, key, tmp_path, left_alone):
    path = tmp_path / "file.toml"
    path.write_text(text)
    call = lambda: rewrite(path, [TomlEntry("t", key, {"x": 2})], lambda fresh: None)  # noqa: E731
    left_alone(path, call, DescriptionError, "cannot add [", "in this layout", "headers")


def test_a_disk_that_cannot_be_written_is_named(copied, left_alone, robots, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    path = copied("pa10")
    monkeypatch.setattr("twin.core.atomic.os.replace", full)
    values = robots["pa10"].mechanism.postures["home"]
    left_alone(path, lambda: save_posture(path, "up", values), OutputError, "No space left", "a writable place")


# --------------------------------------------------------------------------------------------------- phases


@pytest.mark.parametrize("order", ["zyx", "xyz"])
def test_angles_give_the_rotation_and_are_the_nearest(order, rng):
    for middle in (None, 90.0, -90.0, 90.0 - 1e-7, 180.0, 270.0):
        for _ in range(50):
            angles = rng.uniform(-400, 400, 3) * DEG
            if middle is not None:
                angles[1] = middle * DEG
            R = rotation(angles, order)
            near = angles + rng.uniform(-0.3, 0.3, 3)
            got = angles_of(R, order, near)
            assert spatial.rotation_angle(rotation(got, order).T @ R) < 1e-9
            assert np.linalg.norm(got - near) < 1.0 or abs(np.cos(angles[1])) < 1e-2
            if abs(np.cos(angles[1])) > 0.4:
                np.testing.assert_allclose(got, angles, atol=1e-12)


@pytest.mark.parametrize(
    "source", [p for p in PROTOCOLS if ident(p) not in ENDS_INSIDE and not by_joints(p)], ids=ident
)
def test_a_phase_goes_to_the_pose(source, protocol, robots):
    path = protocol(ident(source))
    text, old = path.read_text(), load_protocol(path)
    T_tool_frame = robots[old.robot].mechanism.frame_in_tool(old.frame)
    end = build(old, T_tool_frame)[-1].motion(np.array([1.0])).Ts_base_tool[0]
    turn = spatial.exp_so3(np.array([0.1, -0.2, 0.3]))
    T = end @ spatial.pose(turn, [0.01, -0.02, 1 / 300])
    append_phase(path, "look", T, T_tool_frame)
    new = load_protocol(path)
    last = build(new, T_tool_frame)[-1]
    reached = last.motion(np.array([1.0])).Ts_base_tool[0]
    np.testing.assert_allclose(reached, T, rtol=0, atol=2e-9)
    assert np.abs(last.angles1 - last.angles0).max() < 0.7  # not round the other way
    assert [p.name for p in new.phases] == [*(p.name for p in old.phases), "look"]
    assert list(new.waypoints) == [*old.waypoints, "look"]
    assert new.waypoints["look"].provenance == "ASSUMED"
    written = path.read_text()
    assert lines_are_kept(text, written)
    assert "\n\n[waypoints.look]\n" in written
    assert written.endswith('\n\n[[phases]]\nname = "look"\ntype = "positioning"\nto = "look"\n')
    append_phase(path, "and_back", end, T_tool_frame)
    assert lines_are_kept(written, path.read_text())


def test_a_heading_between_waypoints_and_phases_stays_over_the_phases(protocol):
    path = protocol("pa10/circle")
    text = path.read_text().replace("[[phases]]", "# ---- Phases\n\n[[phases]]", 1)
    path.write_text(text)
    append_phase(path, "look", spatial.pose(p=[0.3, 0.4, 0.2]), np.eye(4))
    new = path.read_text()
    assert lines_are_kept(text, new)
    assert new.index("[waypoints.look]") < new.index("\n\n# ---- Phases\n\n[[phases]]")


@pytest.mark.parametrize(
    ("name", "T", "kind", "words"),
    [
        ("home", None, DescriptionError, ["waypoints.home", "a waypoint of that name exists"]),
        ("insert", None, DescriptionError, ["phases[1]", "there is a phase 'insert'"]),
        ("no-name", None, DescriptionError, ["no-name", "must begin with a lower-case letter"]),
        ("look", np.full((4, 4), np.nan), TwinError, ["waypoint 'look'", "not a rigid pose"]),
        ("look", 2 * np.eye(4), TwinError, ["waypoint 'look'", "not a rigid pose"]),
        ("look", "there", ProtocolError, ["phase 'look'", "the phase has no length"]),
    ],
)
def test_a_phase_that_is_refused_changes_nothing(name, T, kind, words, protocol, left_alone):
    path = protocol("pa10/circle")
    p = load_protocol(path)
    home = p.waypoints["home"]
    there = spatial.pose(rotation(home.angles, p.rotation), home.position)
    T = there if isinstance(T, str) else spatial.pose(p=[0.3, 0.4, 0.2]) if T is None else T
    words = [*words] if kind is not ProtocolError else [*words, "the file is unchanged"]
    before = path.read_bytes()
    with pytest.raises(kind) as caught:
        append_phase(path, name, T, np.eye(4))
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", ENDS_INSIDE)
def test_nothing_is_positioned_inside_the_patient(name, protocol, left_alone):
    path = protocol(name)
    call = lambda: append_phase(path, "look", np.eye(4), np.eye(4))  # noqa: E731
    left_alone(path, call, DescriptionError, "phases[", "in the patient", "add a retraction to depth 0")


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "name"), [("sils", "lowered_patient"), ("sher", "phantom")])
def test_an_appended_phase_plans_and_arrives(robot, name, protocol, robots):
    path = protocol(f"{robot}/{name}")
    r = robots[robot]
    p = load_protocol(path)
    q = r.mechanism.posture("home") + 2e-3
    T = r.reference().solve(q).T_base_tool
    append_phase(path, "look", T, r.mechanism.frame_in_tool(p.frame))
    trajectory = twin.plan(r, path)
    np.testing.assert_allclose(trajectory.Ts_base_tool[-1], T, rtol=0, atol=1e-7)
    np.testing.assert_allclose(trajectory.q[-1], q, rtol=0, atol=1e-6)


# -------------------------------------------------------------------------------------------------- sessions


def recorded(mechanism, rng) -> RecordedSession:
    session = RecordedSession.of(mechanism)
    for k, label in enumerate(("start", "", 'grazes the "column" at 5 µm', "")):
        q = np.array(list(somewhere(mechanism, rng).values()))
        session.add(0.5 + k / 3, q, spatial.pose(spatial.exp_so3(rng.normal(size=3)), rng.normal(size=3)), label)
    return session


@pytest.mark.parametrize("name", twin.names())
def test_a_session_comes_back_exactly(name, robots, tmp_path, rng):
    mechanism = robots[name].mechanism
    session = recorded(mechanism, rng)
    session.save(tmp_path / "new" / "s.json")
    file = tmp_path / "new" / "s.json"
    text = file.read_text()
    assert text.startswith('{"schema": "twin-posture-session", "version": 1')
    file.write_text(text.replace("twin-posture-session", "twin-session"))  # the name in earlier files
    assert len(RecordedSession.load(file, mechanism).moments) == len(session.moments)
    file.write_text(text)
    back = RecordedSession.load(file, mechanism)
    assert (back.robot, back.joints, back.units) == (session.robot, session.joints, session.units)
    for a, b in zip(session.moments, back.moments, strict=True):
        assert (a.time, a.label) == (b.time, b.label)
        np.testing.assert_array_equal(a.q, b.q)
        np.testing.assert_array_equal(a.T_base_tool, b.T_base_tool)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["s.json"]


def test_a_session_is_linear_between_its_moments(robots, rng):
    session = recorded(robots["pa10"].mechanism, rng)
    a, b = session.moments[1], session.moments[2]
    assert session.duration == pytest.approx(1.0)
    np.testing.assert_allclose(session.at(a.time + 0.25 * (b.time - a.time)), 0.75 * a.q + 0.25 * b.q, atol=1e-15)
    np.testing.assert_array_equal(session.at(-1.0), session.moments[0].q)
    np.testing.assert_array_equal(session.at(99.0), session.moments[-1].q)


def test_an_empty_session_lasts_no_time(robots, tmp_path):
    mechanism = robots["pa10"].mechanism
    session = RecordedSession.of(mechanism)
    assert session.duration == 0
    with pytest.raises(TwinError, match="the session is empty"):
        session.at(0)
    session.save(tmp_path / "s.json")
    assert RecordedSession.load(tmp_path / "s.json", mechanism).moments == []


@pytest.mark.parametrize(
    ("time", "q", "T", "words"),
    [
        (0.0, np.zeros(7), np.eye(4), "time = 0.0 s must be a finite number after 1 s"),
        (np.nan, np.zeros(7), np.eye(4), "time = nan"),
        (2.0, np.zeros(6), np.eye(4), "one finite number for each of q1, q2"),
        (2.0, np.full(7, np.inf), np.eye(4), "one finite number"),
        (2.0, np.zeros(7), np.zeros((4, 4)), "not a rigid pose"),
    ],
)
def test_a_moment_that_makes_no_sense_is_refused(time, q, T, words, robots):
    session = RecordedSession.of(robots["pa10"].mechanism)
    session.add(1.0, np.zeros(7), np.eye(4))
    with pytest.raises(TwinError, match=f"session of pa10, moment 1: .*{re.escape(words)}"):
        session.add(time, q, T)
    assert len(session.moments) == 1


def test_a_moment_keeps_its_own_numbers(robots):
    session, q = RecordedSession.of(robots["pa10"].mechanism), np.zeros(7)
    session.add(0.0, q, np.eye(4))
    q[:] = 1
    np.testing.assert_array_equal(session.at(0), np.zeros(7))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": "sils"}, "robot = 'sils': the session is not of 'pa10'; load robot 'sils'"),
        ({"schema": "twin-report"}, "schema = 'twin-report'"),
        ({"version": 2}, "version = 2"),
        ({"joints": [{"name": "q1", "unit": "m"}]}, "joints: recorded with q1 (m); pa10 has q1 (rad), q2 (rad)"),
        ({"joints": [{"name": "q1", "unit": "mm"}]}, "joints[0].unit = 'mm'"),
        ({"moments": [{"time_s": 0.0}]}, "moments[0].q: Field required"),
        ({"moments": None}, "moments = None"),
        ({"extra": 1}, "extra = 1"),
    ],
)
def test_a_file_that_is_no_session_of_this_robot_is_refused(change, words, robots, tmp_path, rng):
    path, mechanism = tmp_path / "s.json", robots["pa10"].mechanism
    recorded(mechanism, rng).save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(TwinError, match=re.escape(str(path))) as caught:
        RecordedSession.load(path, mechanism)
    assert words in str(caught.value)


@pytest.mark.parametrize("data", [None, b"", b"{", b"\xff", b"[]", b"NaN"])
def test_a_file_that_is_no_session_at_all_is_refused(data, robots, tmp_path):
    path = tmp_path / "s.json"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(TwinError, match=re.escape(str(path))):
        RecordedSession.load(path, robots["pa10"].mechanism)


def test_moments_out_of_order_in_a_file_are_refused(robots, tmp_path, rng):
    path, mechanism = tmp_path / "s.json", robots["pa10"].mechanism
    recorded(mechanism, rng).save(path)
    data = json.loads(path.read_text())
    data["moments"].reverse()
    path.write_text(json.dumps(data))
    with pytest.raises(TwinError, match=r"s\.json: session of pa10, moment 1: time"):
        RecordedSession.load(path, mechanism)
