"""A session at a console as a result: its files, read by other programs, and what it says without their packages."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest

import twin
from made.consoles import with_near_targets
from twin.api.console_runs import FILE, operate_console, replay_session
from twin.cli import main
from twin.core import spatial
from twin.core.units import DEG, MM
from twin.exchange.audit import audit
from twin.reference import ReferenceModel
from twin.simulation.session.session_file import read_session


@pytest.fixture(scope="module")
def davinci():
    return twin.load_scene("davinci")


@pytest.fixture(scope="module")
def performed(davinci):
    return operate_console(with_near_targets(davinci), seed=4)


@pytest.fixture(scope="module")
def recorded(performed, tmp_path_factory):
    path = tmp_path_factory.mktemp("session") / "hands.session"
    path.write_bytes(performed.recorded)
    return path


@pytest.fixture(scope="module")
def replayed(recorded, davinci):
    return replay_session(recorded, with_near_targets(davinci))


@pytest.fixture(scope="module")
def exported(replayed, performed, recorded, tmp_path_factory):
    """What `twin session --out` writes; here with the file of the surgeon, as `twin operate` does."""
    folder = tmp_path_factory.mktemp("exported") / "out"
    with pytest.MonkeyPatch.context() as patch:
        as_performed = replace(replayed, recorded=performed.recorded)
        patch.setattr("twin.api.console_runs.replay_session", lambda *args: as_performed)
        assert main(["session", str(recorded), "--out", str(folder), "--quiet"]) == 0
    return folder


def messages(path, topic):
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(topics=[topic]):
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            yield schema.name, message.log_time, json.loads(message.data)


@pytest.mark.slow
def test_mcap_has_the_poses_of_the_reference_model(exported, replayed, davinci, theatre):
    """Read by the reader of the format's authors; every link in the world, without kinematics."""
    at = messages(exported / "session.mcap", "/tf")
    states = messages(exported / "session.mcap", "/joint_states")
    places = {p.name: p for p in davinci.places}
    models = {n: ReferenceModel(r.mechanism) for n, r in theatre.robots.items()}
    worst, seen = 0.0, 0
    for k, ((kind, t, tf), (joint_kind, same, joints)) in enumerate(zip(at, states, strict=True)):
        assert (kind, joint_kind) == ("foxglove.FrameTransforms", "foxglove.JointStates")
        assert t == same == k * 20_000_000
        assert joints["timestamp"] == {"sec": t // 10**9, "nsec": t % 10**9}
        if k % 40:
            continue
        q = {j["name"]: j["position"] for j in joints["joints"]}
        found = {x["child_frame_id"]: x for x in tf["transforms"]}
        assert {x["parent_frame_id"] for x in found.values()} == {"world"}
        for name, model in models.items():
            own = np.array([q[f"{name}/{j.name}"] for j in theatre.robots[name].mechanism.active])
            assert np.array_equal(own, replayed.run.recording[f"{name}.q"][4 * k])
            for link, T in model.solve(own).link_poses.items():
                x = found.pop(f"{name}/{link}")
                R = spatial.matrix_from_quat_wxyz([x["rotation"][c] for c in "wxyz"])
                off = spatial.pose(R, [x["translation"][c] for c in "xyz"]) - places[name].T_world_base @ T
                worst, seen = max(worst, float(np.abs(off).max())), seen + 1
        assert not found
    assert seen >= 2 * sum(len(r.mechanism.bodies) for r in theatre.robots.values())
    assert worst < 1e-9


@pytest.mark.slow
def test_mcap_states_its_schemas_and_the_console(exported):
    from mcap.reader import make_reader

    with (exported / "session.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    for schema in summary.schemas.values():
        told = json.loads(schema.data)
        assert told["title"] == schema.name
        assert told["type"] == "object"
    assert {c.topic for c in summary.channels.values()} == {"/tf", "/joint_states", "/console"}
    said = [m for _, _, m in messages(exported / "session.mcap", "/console")]
    assert {m["scale"] for m in said} == {0.5}
    assert max(m["right_grip"] for m in said) == pytest.approx(30 * DEG)


@pytest.mark.slow
def test_messages_of_ros_have_the_numbers_of_the_session(exported, replayed, davinci):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    kept = replayed.run.recording
    places = {place.name: place for place in davinci.places}
    counts: dict[str, int] = {}
    file = io.BytesIO((exported / "session-ros2.mcap").read_bytes())
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, channel, _, told in reader.iter_decoded_messages():
        topic = channel.topic
        k = counts.get(topic, 0)
        counts[topic] = k + 1
        if topic.endswith("/measured_js"):
            robot = topic.split("/")[1].lower()
            assert list(told.position) == kept[f"{robot}.q"][4 * k].tolist()
            assert told.header.stamp.sec * 10**9 + told.header.stamp.nanosec == k * 20_000_000
        elif topic == "/MTMR/measured_cp":
            p = told.pose.position
            assert [p.x, p.y, p.z] == kept["right.pose"][4 * k].reshape(4, 4)[:3, 3].tolist()
        elif topic == "/footpedals/clutch":
            assert told.buttons == [int(kept["pedals.clutch"][4 * k, 0])]
        elif topic == "/tf" and k % 100 == 0:
            frames = {transform.child_frame_id: transform.transform for transform in told.transforms}
            base = frames["psm1/base"].translation
            assert [base.x, base.y, base.z] == pytest.approx(places["psm1"].T_world_base[:3, 3].tolist())
    assert set(counts) == {
        *("/tf", "/MTMR/measured_cp", "/MTML/measured_cp", "/MTMR/gripper/angle", "/MTML/gripper/angle"),
        *("/footpedals/clutch", "/footpedals/camera", "/console/teleop/scale"),
        *("/PSM1/measured_js", "/PSM2/measured_js", "/ECM/measured_js"),
    }
    assert len(set(counts.values())) == 1


@pytest.mark.slow
def test_csv_has_hands_and_tips(exported, replayed):
    path = exported / "session.csv"
    names = path.read_text().splitlines()[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert len(names) == len(set(names)) == rows.shape[1]
    column = {n: rows[:, i] for i, n in enumerate(names)}
    assert np.allclose(np.diff(column["t_s"]), 0.02)
    tip = np.column_stack([column[f"psm1_tip_{a}_m"] for a in "xyz"])
    assert np.linalg.norm(tip[-1] - replayed.task.goal.targets[0].p_world["right"]) < 1 * MM
    assert {"right_grip_rad", "psm2_follows", "psm1_q3_m", "psm1_q1_rad", "ecm_q4_rad"} <= set(names)


@pytest.mark.slow
def test_glb_and_tracks_pass_the_audit(exported, davinci):
    for place in davinci.places:
        found = audit(exported / place.name)
        assert found.verdict == "agree", found.findings


@pytest.mark.slow
def test_a_folder_has_page_picture_data_and_motions(exported):
    assert {p.relative_to(exported).as_posix() for p in exported.rglob("*") if p.is_file()} == {
        *("session.json", "session.html", "session.png", "session.csv", "session.mcap", "session-ros2.mcap", FILE),
        *(f"{n}/tracks/session.{suffix}" for n in ("psm1", "psm2", "ecm") for suffix in ("csv", "json")),
        *("psm1/davinci_psm.glb", "psm2/davinci_psm.glb", "ecm/davinci_ecm.glb"),
    }
    page = (exported / "session.html").read_text(encoding="utf-8")
    assert "session of a simulated surgeon, seed 4" in page
    assert "<svg" in page
    assert (exported / "session.png").read_bytes().startswith(b"\x89PNG")
    assert read_session(exported / FILE).head.seed == 4


def test_without_the_extra_the_rest_is_written_and_the_command_says_what_to_install(performed, monkeypatch):
    monkeypatch.setattr("twin.api.console_session.find_spec", lambda name: None)
    (finding,) = performed.findings
    assert finding.message == "session.mcap or session-ros2.mcap is not written: pip install 'twin-robotics[mcap]'"
    assert (finding.severity, performed.verdict) == ("info", "agree")
