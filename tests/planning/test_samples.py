"""A phase of samples over time: the same motion as planned, checked as a planned one, and wrong files are named."""

from __future__ import annotations

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from api.test_multi_robot_plan import Robot, motorised, protocol_of
from made import protocols
from twin.analysis.mutation import units
from twin.core import spatial
from twin.core.errors import DescriptionError, ProtocolError
from twin.core.findings import verdict
from twin.planning.plan import plan
from twin.planning.plan_files import write_samples
from twin.planning.protocol import load_protocol
from twin.planning.sampled_phase import curve_through
from twin.ui.session.robot_file_edits import append_phase

UP, ASIDE, DOWN = (np.array(q) for q in ([0.5, 0.0, 0.0], [0.2, 0.3, 0.1], [-0.3, 0.2, 0.0]))
JOINTS = [(f"q{i}", True) for i in range(3)]


def planned(protocol, robot):
    return plan(protocol, robot.path_kinematics(), T_tool_frame=robot.mechanism.frame_in_tool(protocol.frame))


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """(robot, trajectory of two free phases, folder with a protocol file that gives its samples)."""
    robot, tmp_path = Robot(motorised(9.0)), tmp_path_factory.mktemp("samples")
    protocol_of(tmp_path, UP, ASIDE, DOWN, frame="tip")
    text = (tmp_path / "over.toml").read_text(encoding="utf-8")
    straight = text.replace("free", "joints").replace("clearance_mm = 5\n", "")
    (tmp_path / "over.toml").write_text(straight, encoding="utf-8")
    first = planned(load_protocol(tmp_path / "over.toml"), robot)
    write_samples(tmp_path / "moved.csv", JOINTS, first.t, first.q)
    text = text.replace("free", "samples")
    for span in first.phases:
        head = f'name = "{span.name}"\nto = "{span.waypoint}"\n'
        assert f"{head}clearance_mm = 5\n" in text
        times = f"from_s = {span.t0}\nto_s = {span.t1}"
        text = text.replace(f"{head}clearance_mm = 5", f'{head}file = "moved.csv"\n{times}')
    (tmp_path / "again.toml").write_text(text, encoding="utf-8")
    return robot, first, tmp_path


@pytest.fixture
def made(source, tmp_path):
    """(robot, trajectory, protocol file in an own folder), as `source`."""
    robot, first, folder = source
    for name in ("again.toml", "moved.csv"):
        shutil.copy(folder / name, tmp_path / name)
    return robot, first, tmp_path / "again.toml"


def test_samples_of_a_plan_are_the_same_motion(made):
    robot, first, file = made
    again = planned(load_protocol(file), robot)
    assert verdict(again.findings) == "agree", [f.message for f in again.findings]
    np.testing.assert_allclose(again.t, first.t, atol=1e-12)
    np.testing.assert_allclose(again.q, first.q, atol=1e-12)
    np.testing.assert_allclose(again.Ts_base_tool, first.Ts_base_tool, atol=1e-12)
    np.testing.assert_allclose(again.qd, first.qd, atol=2e-3 * np.abs(first.qdd).max())
    np.testing.assert_allclose(again.tip_velocity, first.tip_velocity, atol=2e-3)
    step = first.phases[0].stop
    inner = np.r_[5 : step - 5, step + 5 : len(first.t) - 5]
    for name in ("tip_acceleration", "angular_acceleration"):
        a, b = getattr(first, name)[inner], getattr(again, name)[inner]
        assert np.median(np.linalg.norm(a - b, axis=1)) < 1e-5
    assert [(p.name, p.t0, p.t1, p.waypoint) for p in again.phases] == [
        (p.name, p.t0, p.t1, p.waypoint) for p in first.phases
    ]


def test_a_coarser_table_gives_the_motion_between_its_samples(made, tmp_path):
    robot, first, file = made
    rows = np.unique(np.r_[0 : len(first.t) : 10, first.phases[0].stop, len(first.t) - 1])
    write_samples(tmp_path / "moved.csv", JOINTS, first.t[rows], first.q[rows])
    again = planned(load_protocol(file), robot)
    assert np.abs(again.q - first.q).max() < 1e-4


def test_a_motion_in_half_of_the_time_exceeds_the_limits_which_are_named(made, tmp_path):
    robot, first, file = made
    write_samples(tmp_path / "moved.csv", JOINTS, first.t / 2, first.q)
    text = file.read_text(encoding="utf-8")
    for span in first.phases:
        text = text.replace(f"from_s = {span.t0}\nto_s = {span.t1}", f"from_s = {span.t0 / 2}\nto_s = {span.t1 / 2}")
    file.write_text(text, encoding="utf-8")
    codes = {f.code for f in planned(load_protocol(file), robot).findings if f.severity == "disagreement"}
    assert codes & {"limit.tip_acceleration", "limit.rotation_acceleration"}


def test_a_robot_at_rest_needs_no_waypoint_at_the_end(made, tmp_path):
    robot, _, file = made
    write_samples(tmp_path / "moved.csv", JOINTS, np.array([0.0, 2.5]), UP[None])
    text = file.read_text(encoding="utf-8")
    file.write_text(
        text[: text.index("[[phases]]")] + '[[phases]]\ntype = "samples"\nname = "rest"\nfile = "moved.csv"\n'
    )
    found = planned(load_protocol(file), robot)
    assert found.duration == pytest.approx(2.5)
    np.testing.assert_allclose(found.q, np.repeat(UP[None], len(found.t), axis=0), atol=1e-12)
    assert np.abs(found.tip_velocity).max() < 1e-9
    assert {f.severity for f in found.findings} <= {"info", "warning"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "moved.csv is no table of samples"),
        ("", "the first line must be t_s,NAME_deg"),
        ("time,q0_deg\n0,1\n1,2\n", "the first line must be t_s,NAME_deg"),
        ("t_s,q0\n0,1\n1,2\n", "column 'q0' is no joint with its unit: write NAME_deg or NAME_mm"),
        ("t_s,_deg\n0,1\n1,2\n", "column '_deg' is no joint with its unit"),
        ("t_s,q0_deg,q0_mm\n0,1,1\n1,2,2\n", "joint 'q0' has two columns"),
        ("t_s,q0_deg,q0_deg\n0,1,1\n1,2,2\n", "joint 'q0' has two columns"),
        ("t_s,q0_deg\n0,1\n1\n", "row 2 must have 2 finite numbers"),
        ("t_s,q0_deg\n0,1\n1,nan\n", "row 2 must have 2 finite numbers"),
        ("t_s,q0_deg\n0,one\n1,2\n", "could not convert string to float"),
        ("t_s,q0_deg\n0,1\n0,2\n", "t_s must increase from row to row"),
        ("t_s,q0_deg\n0,1\n", "t_s must increase from row to row, over at least two rows"),
        ("t_s,q0_deg\n0,1\n0.1,2\n", "samples from 0 to 0.1 s, none at"),
        ("t_s,q0_deg\n2,1\n3,2\n", "from_s: moved.csv has samples from 2 to 3 s, none at 0 s"),
    ],
)
def test_a_wrong_table_is_named_with_the_line_of_the_protocol(made, tmp_path, text, message):
    file = made[2]
    (tmp_path / "moved.csv").unlink()
    if text is not None:
        (tmp_path / "moved.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"again\.toml:\d+: phases\[0\]\..*" + message.replace("(", r"\(")):
        load_protocol(file)


@pytest.mark.parametrize(
    ("name", "q0", "message"),
    [
        (
            "q0_deg",
            20,
            r"the samples begin with q0 = 20 deg, but the phase begins at 28\.6479 deg, a difference of 8\.65 deg",
        ),
        ("q0_mm", 0.5, "joint 'q0' is in deg: write q0_deg, not q0_mm"),
        ("q9_deg", 20, "there is no driven joint 'q9'"),
    ],
)
def test_samples_that_do_not_fit_the_robot_are_named(made, tmp_path, name, q0, message):
    robot, first, file = made
    (tmp_path / "moved.csv").write_text("".join([f"t_s,{name}\n", *(f"{t},{q0}\n" for t in first.t)]), encoding="utf-8")
    protocol = load_protocol(file)
    whole = replace(protocol, phases=protocol.phases[:1])
    with pytest.raises(ProtocolError, match=rf"over: phase 'to_w1' \(samples\).*{message}"):
        planned(whole, robot)


def test_a_table_that_begins_later_is_used_from_its_first_sample(made, tmp_path):
    robot, first, file = made
    write_samples(tmp_path / "moved.csv", JOINTS, first.t + 2, first.q)
    end = first.phases[0].t1
    text = file.read_text(encoding="utf-8").split("\n[[phases]]\n")
    one = text[1].replace("from_s = 0.0\n", "").replace(f"to_s = {end}", f"to_s = {end + 2}")
    file.write_text("\n[[phases]]\n".join([text[0], one]), encoding="utf-8")
    np.testing.assert_allclose(planned(load_protocol(file), robot).duration, end, atol=1e-9)


@pytest.mark.parametrize(("key", "value"), [("from_s", 0.0005), ("to_s", 0.0105)])
def test_a_bound_between_two_samples_is_refused(made, key, value):
    """The motion would begin or end elsewhere than the phase."""
    file, lines = made[2], made[2].read_text(encoding="utf-8").splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith(f"{key} = "))
    lines[at] = f"{key} = {value}"
    file.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(
        DescriptionError, match=rf"phases\[0\]\.{key}: moved\.csv has no sample at {value} s; the nearest"
    ):
        load_protocol(file)


def test_a_phase_is_appended_after_samples_also_back_to_where_they_began(tmp_path):
    """Only the mechanism knows where samples end, so that this phase may have a length."""
    (tmp_path / "moved.csv").write_text("t_s,q0_deg\n0,0\n1,20\n", encoding="utf-8")
    head = {"name": "over", "title": "t", "robot": "arm", "start": "w", "no_patient": "a test"}
    most = dict.fromkeys(("samples", "positioning"), (300, 900, 90, 300))
    parts = protocols.waypoint("w", [0, 0, 0], position_mm=[100, 0, 0], label="w"), protocols.phase(
        type="samples", name="moved", file="moved.csv"
    )  # fmt: skip
    file = tmp_path / "over.toml"
    file.write_text(protocols.text(head, "", most, parts), encoding="utf-8")
    append_phase(file, "back", spatial.pose(p=[0.1, 0, 0]), np.eye(4))
    assert [(p.type, p.name) for p in load_protocol(file).phases] == [("samples", "moved"), ("positioning", "back")]


def test_unit_faults_of_a_protocol_with_samples_are_read_with_its_table(made, tmp_path):
    file, folder = made[2], tmp_path / "faulty"
    folder.mkdir()
    length = SimpleNamespace(name="l", value=0.1, unit="m")
    robot = SimpleNamespace(files="", formula=SimpleNamespace(parameters=[length]), parameters={})
    found = list(units.faults(robot, file, np.random.default_rng(0), 6))  # type: ignore[arg-type]
    assert {f.kind for f in found} == {"parameter", "speed", "turning"}
    for read in (f.protocol for f in found if f.protocol is not None):
        faulty, correct = read(folder), load_protocol(file)
        assert faulty.limits["samples"] != correct.limits["samples"]
        assert len(faulty.phases) == len(correct.phases)


def test_samples_are_in_the_folder_of_their_protocol(made, tmp_path):
    file = made[2]
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("moved.csv", "../moved.csv"), encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"phases\[0\]"):
        load_protocol(file)
    (tmp_path / "copy").mkdir()
    copy = tmp_path / "copy" / file.name
    copy.write_text(text, encoding="utf-8")
    assert len(load_protocol(copy, folder=file.parent).phases) == 2


@pytest.mark.parametrize("kind", ["dwell", "steps", "uneven", "smooth"])
def test_the_motion_stays_between_its_samples(kind):
    """125 drawn tables of each kind; a spline left 0 .. 6 deg by up to 17 deg where a joint moves after a dwell."""
    rng = np.random.default_rng(3)
    for _ in range(125):
        t, q = drawn_table(kind, rng)
        curve = curve_through(t, q)
        assert np.abs(curve(t) - q).max() < 1e-12
        fine = np.linspace(t[0], t[-1], 4001)
        at = np.clip(np.searchsorted(t, fine, side="right"), 1, len(t) - 1)
        low = np.minimum(q[at - 1], q[at])
        high = np.maximum(q[at - 1], q[at])
        step = np.abs(np.diff(q, axis=0)).max(axis=0)
        seen = curve(fine)
        assert (np.maximum(low - seen, seen - high) <= 0.0105 * step + 1e-12).all()


def drawn_table(kind, rng):
    """Return times (k,) in s and joint values (k, 2) in rad of a drawn table."""
    count = int(rng.integers(4, 40))
    t = np.arange(count) / rng.uniform(1, 100)
    if kind == "uneven":
        t = np.cumsum(10 ** rng.uniform(-3, 0.5, count))
    q = np.cumsum(rng.normal(size=(count, 2)), axis=0)
    if kind == "dwell":
        q = np.repeat(q, rng.integers(1, 6, count), axis=0)
        t = np.arange(len(q)) / rng.uniform(1, 100)
    if kind == "steps":
        q = np.round(q)
    if kind == "smooth":
        q = np.column_stack([np.sin(t / t[-1] * rng.uniform(1, 7)), np.cos(t / t[-1] * rng.uniform(1, 7))])
    return t - t[0], q


def test_smooth_samples_are_followed_by_a_spline():
    t = np.linspace(0, 2, 201)
    q = np.column_stack([1 - np.cos(np.pi * t)])
    fine = np.linspace(0, 2, 1777)
    assert np.abs(curve_through(t, q)(fine)[:, 0] - (1 - np.cos(np.pi * fine))).max() < 1e-8


def test_a_joint_that_moves_after_a_dwell_stays_in_its_range():
    """The table of a user: 0, 0, 6, 6 deg at 0, 1, 1.1, 3 s."""
    motion = curve_through(np.array([0, 1, 1.1, 3]), np.array([[0.0], [0], [6], [6]]))(np.linspace(0, 3, 3001))
    assert -1e-12 <= motion.min() <= motion.max() <= 6 + 1e-12
