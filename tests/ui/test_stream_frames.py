"""The protocol of `twin serve`: frames to the bit, every message good and bad, and that docs/stream.md is true."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.core import spatial
from twin.core.errors import TwinError
from twin.ui.access import rate_limits as limits
from twin.ui.headset import scene_frame, server
from twin.ui.headset import stream_frames as wire
from twin.ui.headset.client import STALL_TIMEOUT
from twin.ui.headset.client_messages import (
    ERRORS,
    LONGEST_MESSAGE,
    ClientMessage,
    RefusedError,
    RobotMessage,
    parse_message,
)
from twin.ui.headset.stream_frames import pack, pack_body, unpack

DOCS = (Path(__file__).parents[2] / "docs/stream.md").read_text(encoding="utf-8")
EXAMPLES = [line for line in re.findall(r"```json\n(.*?)```", DOCS, re.DOTALL)[0].splitlines() if line]
NAMES = {m.model_fields["type"].annotation.__args__[0] for m in get_args(ClientMessage)}


# --------------------------------------------------------------------------------------------------- frames


@given(
    st.integers(0, 40), st.integers(0, 9), st.integers(0, 2**33), st.booleans(), st.floats(0, 1e9), st.floats(0, 1e4)
)
def test_frames_come_back_to_the_bit(links, joints, seq, has_ghost, server_time, clip_time):
    # Any bits at all, also those that are no number.
    bits = np.random.default_rng(seq).integers(0, 2**32, 7 * links + joints + 7, dtype=np.uint32).view(np.float32)
    poses, q = bits[: 7 * links].reshape(links, 7), bits[7 * links : -7]
    ghost = bits[-7:] if has_ghost else None
    flags = wire.HELD_FLAG | wire.PLAYING_FLAG | (wire.GHOST_FLAG if has_ghost else 0)
    frame = unpack(pack(seq, server_time, clip_time, flags, pack_body(poses, q, ghost), links, joints))
    assert (frame.seq, frame.server_time, frame.clip_time, frame.flags) == (seq % 2**32, server_time, clip_time, flags)
    assert frame.poses.tobytes() == poses.tobytes()
    assert frame.poses.shape == (links, 7)
    assert frame.q.tobytes() == q.tobytes()
    assert (frame.ghost is None) == (ghost is None)
    if ghost is not None:
        assert frame.ghost.tobytes() == ghost.tobytes()


def test_a_frame_lies_as_the_documentation_says():
    poses, q, ghost = np.arange(14.0).reshape(2, 7), np.array([20.0, 21.0, 22.0]), np.arange(30.0, 37.0)
    data = pack(5, 1.5, 2.5, 15, pack_body(poses, q, ghost), 2, 3)
    for offset, kind, value in [
        (0, "<I", 0x314E5754), (4, "<I", 5), (8, "<d", 1.5), (16, "<d", 2.5), (24, "<H", 2), (26, "<H", 3),
        (28, "<I", 15), (32, "<f", 0.0), (32 + 4 * 8, "<f", 8.0), (32 + 28 * 2, "<f", 20.0),
        (32 + 28 * 2 + 4 * 3, "<f", 30.0),
    ]:  # fmt: skip
        assert struct.unpack_from(kind, data, offset) == (value,)
    assert data[:4] == b"TWN1"
    assert len(data) == 32 + 28 * 2 + 4 * 3 + 28


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d[:20], "the header needs 32"),
        (lambda d: b"XXXX" + d[4:], "begins with"),
        (lambda d: d[:-1], "need 72"),
        (lambda d: d + b"\0", "need 72"),
        (lambda d: d[:28] + struct.pack("<I", wire.GHOST_FLAG) + d[32:], "need 100"),
    ],
)
def test_what_is_no_frame_is_refused(spoil, message):
    data = pack(0, 0.0, 0.0, 0, pack_body(np.zeros((1, 7)), np.zeros(3), None), 1, 3)
    unpack(data)
    with pytest.raises(TwinError, match=message):
        unpack(spoil(data))


def test_poses_and_quaternions_go_there_and_back(rng):
    Ts = spatial.pose(spatial.exp_so3(rng.normal(size=(50, 3))), rng.normal(size=(50, 3)))
    sevens = wire.sevens(Ts)
    assert np.allclose([wire.pose_of(s) for s in sevens], Ts, atol=1e-14)
    last = sevens * np.where(rng.random((50, 1)) < 0.5, -1.0, 1.0)
    near = wire.near_signs(sevens, last)
    assert (np.sum(near[:, 3:] * last[:, 3:], axis=1) > 0).all()
    assert np.allclose([wire.pose_of(s) for s in near], Ts, atol=1e-14)


# --------------------------------------------------------------------------------------------------- messages


@pytest.mark.parametrize("text", EXAMPLES)
def test_examples_of_the_documentation_are_understood(text):
    message = parse_message(text)
    assert message.id is None
    for id in (7, "abc"):
        assert parse_message(json.dumps({**json.loads(text), "id": id})).id == id


def test_the_documentation_shows_every_message_code_flag_and_limit():
    assert {json.loads(e)["type"] for e in EXAMPLES} == NAMES
    assert dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", DOCS, re.MULTILINE)) == ERRORS
    said = re.search(r"^Flags: (.*?)\n\n", DOCS, re.DOTALL | re.MULTILINE)[1]
    assert [int(n) for n in re.findall(r"(?:^|, )\s*(\d+) ", said)] == [1, 2, 4, 8]
    assert (wire.GHOST_FLAG, wire.PLAYING_FLAG, wire.REFUSED_FLAG, wire.HELD_FLAG) == (1, 2, 4, 8)
    words = " ".join(DOCS.split())
    for number in (
        f"at most {LONGEST_MESSAGE} bytes", f"{limits.MESSAGE_LIMIT[0]:g} messages",
        f"{limits.BYTE_LIMIT[0] / 1e3:g} kB a second",
        f"{limits.MAX_WEBSOCKETS} clients", f"{limits.MAX_CONNECTIONS} connections",
        f"after {server.SILENCE_TIMEOUT:g} s without",
        f"{server.RECONNECTION_TIME:g} s after its connection", f"reads nothing for {STALL_TIMEOUT:g} s",
    ):  # fmt: skip
        assert number in words, number
    for number in (f"divided by {scene_frame.QUANTISATION_STEPS}", f"at most {scene_frame.MAX_VERTICES} vertices"):
        assert number in words, number
    of_robot = re.search(r"((?:`\w+`(?:, | and )?)+) may have a `robot`", words)[1]
    assert set(re.findall(r"`(\w+)`", of_robot)) == {
        m.model_fields["type"].annotation.__args__[0] for m in get_args(RobotMessage)
    }
    assert {m for m in get_args(ClientMessage) if "robot" in m.model_fields} == set(get_args(RobotMessage))
    assert limits.MAX_CONNECTIONS_OF_ADDRESS * 2 == limits.MAX_CONNECTIONS


BAD = [
    "", "null", "[]", "7", '"play"', "{", "nonsense", "{}", '{"type": 1}', '{"type": "hack"}', "\ud800",
    '{"type": "play"}', '{"type": "play", "on": 1}', '{"type": "play", "on": "true"}',
    '{"type": "play", "on": true, "more": 1}', '{"type": "play", "on": true, "id": -1}',
    '{"type": "play", "on": true, "id": [1]}', '{"type": "play", "on": true, "id": "' + 41 * "x" + '"}',
    '{"type": "seek", "t": -1}', '{"type": "seek", "t": NaN}', '{"type": "seek", "t": Infinity}',
    '{"type": "seek", "t": 1e400}', '{"type": "seek", "t": "1"}', '{"type": "speed", "value": 0}',
    '{"type": "speed", "value": 100}', '{"type": "loop", "on": null}', '{"type": "protocol", "name": ""}',
    '{"type": "protocol", "name": "' + 65 * "x" + '"}', '{"type": "posture", "name": null}',
    '{"type": "undo", "on": true}',
    '{"type": "grab", "target": "moon"}', '{"type": "grab", "target": "tool", "name": "x"}',
    '{"type": "grab", "target": "joint"}', '{"type": "grab", "target": "link", "name": "x"}',
    '{"type": "grab", "target": "joint", "name": "x", "point": [0, 0, 0]}',
    '{"type": "grab", "target": "link", "name": "x", "point": [0, 0]}',
    '{"type": "grab", "target": "link", "name": "x", "point": [0, 0, 1000]}', '{"type": "drag"}',
    '{"type": "drag", "value": 1, "point": [0, 0, 0]}', '{"type": "drag", "pose": [0, 0, 0, 0, 0, 0, 0]}',
    '{"type": "drag", "pose": [0, 0, 0, 0, 0, 1]}', '{"type": "drag", "pose": [0, 0, 0, 1, 1, 0, 0]}',
    '{"type": "drag", "pose": [0, 0, null, 0, 0, 0, 1]}', '{"type": "drag", "value": 1e9}',
    '{"type": "release", "on": true}', '{"type": "release", "robot": ""}', '{"type": "play", "on": true, "robot": "a"}',
    '{"type": "grab", "target": "tool", "robot": ["a"]}',
    '{"type": "drag", "value": 1, "robot": "' + 65 * "x" + '"}', '{"type": "variant"}',
    '{"type": "variant", "name": 3}',
    '{"type": "distance", "value": 0.2}', '{"type": "distance", "index": -1, "value": 0.2}',
    '{"type": "workspace", "on": 0}', '{"type": "record"}', '{"type": "ping"}', '{"type": "ping", "t": true}',
    '{"type": "hands"}', '{"type": "hands", "number": 1, "right": null, "left": null, "clutch": false}',
    '{"type": "scale", "value": 0}', '{"type": "scale", "value": 1.5}',
    '{"type": "task", "do": "again"}', '{"type": "task"}',
    '{"type": "training", "mode": "play"}', '{"type": "button"}',
    '{"type": "form", "when": "before", "name": "ssq"}', '{"type": "form", "name": "ssq", "answers": [1]}',
    '{"type": "form", "when": "before", "name": "ssq", "answers": ["much"]}',
    '{"type": "haptics", "on": "maybe"}', '{"type": "haptics"}',
    '{"type": "fulcrum", "mode": "outer"}', '{"type": "tool", "hand": "third", "name": "scissors"}',
    '{"type": "tool", "hand": "right"}',
    '{"type": "plan"}', '{"type": "plan", "do": "again", "hand": "right"}',
    '{"type": "plan", "do": "aim", "hand": "third"}',
    "[" * 2000, '{"type":' * 300, '{"type": "ping", "t": 1' + " " * 5000 + "}",
]  # fmt: skip


@pytest.mark.parametrize("text", BAD, ids=lambda t: ascii(t)[:40])
def test_what_is_no_message_is_refused(text):
    with pytest.raises(RefusedError) as refused:
        parse_message(text)
    assert refused.value.code == "invalid"
    assert 0 < len(str(refused.value)) <= 300


def test_every_message_has_a_bad_one():
    assert {m for m in NAMES if any(f'"type": "{m}"' in b for b in BAD)} == NAMES


def test_the_limit_of_a_message_is_in_bytes():
    """A text that fits exceeds the limit with the same number of characters, if one of them has three bytes."""
    text = '{"type": "ping", "t": 1' + " " * (LONGEST_MESSAGE - 24) + "}"
    assert len(text) == LONGEST_MESSAGE
    parse_message(text)
    with pytest.raises(RefusedError, match="longer than"):
        parse_message(text.replace(" }", "\u2003}"))


def test_binary_messages_are_refused():
    with pytest.raises(RefusedError, match="JSON text"):
        parse_message(b"{}")


def test_a_refusal_brings_back_the_id_but_not_what_was_sent():
    with pytest.raises(RefusedError) as refused:
        parse_message('{"type": "seek", "t": -12345, "id": 9}')
    assert refused.value.id == 9
    assert "12345" not in str(refused.value)


@pytest.mark.slow
@given(st.one_of(st.text(max_size=200), st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(
        st.sampled_from(["type", "id", "on", "t", "name", "pose", "point", "value", "target"]) | st.text(max_size=3),
        inner | st.sampled_from(sorted(NAMES)), max_size=5), max_leaves=9).map(json.dumps)))  # fmt: skip
def test_nothing_but_a_refusal_comes_of_anything(text):
    try:
        message = parse_message(text)
    except RefusedError:
        return
    assert message.type in NAMES
