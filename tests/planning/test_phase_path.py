"""Circles as paths: their derivatives, their RCM, their refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.core import spatial
from twin.core.errors import ProtocolError
from twin.planning.phase_path import build
from twin.planning.protocol import Insertion, Pivot, Positioning, Retraction, load_protocol

CIRCLE = Path(__file__).parents[2] / "trajectories/pa10/circle.toml"


@pytest.mark.parametrize("inside", [True, False])
def test_a_circle_has_the_derivatives_it_says(inside):
    """Central differences of pose and rates; with a frame that is not the tool's."""
    T_tool_frame = spatial.pose(spatial.exp_so3([0.0, 0.0, 0.4]), [0.01, -0.02, 0.3])
    protocol = load_protocol(CIRCLE)
    if not inside:
        protocol = replace(protocol, phases=(protocol.phases[0], replace(protocol.phases[2], centre=np.full(3, 0.2))))
    path = build(protocol, T_tool_frame)[-3 if inside else -1]
    s, h = np.linspace(0.02, 0.98, 25), 1e-5
    at, ahead, behind = path.motion(s), path.motion(s + h), path.motion(s - h)
    np.testing.assert_allclose((ahead.p - behind.p) / (2 * h), at.p1, atol=1e-8)
    np.testing.assert_allclose((ahead.p1 - behind.p1) / (2 * h), at.p2, atol=1e-7)
    R1, R0 = ahead.Ts_base_tool[:, :3, :3], behind.Ts_base_tool[:, :3, :3]
    np.testing.assert_allclose(spatial.log_so3(R1 @ np.swapaxes(R0, 1, 2)) / (2 * h), at.w1, atol=1e-8)
    np.testing.assert_allclose((ahead.w1 - behind.w1) / (2 * h), at.w2, atol=1e-7)
    v = (ahead.Ts_base_tool - behind.Ts_base_tool)[:, :3, 3] / (2 * h)
    np.testing.assert_allclose(v, at.twists[:, :3], atol=1e-8)


def test_a_circle_keeps_radius_plane_and_rcm_and_closes_without_spin():
    *_, path, _, _ = build(load_protocol(CIRCLE), np.eye(4))
    m = path.motion(np.linspace(0, 1, 200))
    centre = np.array([0.32, 0.48, 0.0])
    np.testing.assert_allclose(np.linalg.norm(m.p - centre, axis=1), 0.02, atol=1e-9)
    np.testing.assert_allclose(m.p[:, 2], m.p[0, 2], atol=1e-15)
    assert spatial.point_to_line(path.rcm, m.p, m.Ts_base_tool[:, :3, 2]).max() < 1e-15
    np.testing.assert_allclose(m.Ts_base_tool[0], m.Ts_base_tool[-1], atol=1e-14)
    n0 = m.Ts_base_tool[0, :3, 2]  # smallest rotation from the start: its axis is square to the shaft there
    turn = spatial.log_so3(m.Ts_base_tool[:, :3, :3] @ m.Ts_base_tool[0, :3, :3].T)
    assert np.abs(turn @ n0).max() < 1e-14
    assert path.depth(0.5) == pytest.approx(np.hypot(0.02, 0.1), abs=1e-9)


def test_a_circle_without_radius_is_refused():
    protocol = load_protocol(CIRCLE)
    circle = replace(protocol.phases[2], centre=np.array([0.34, 0.48, 0.3]))
    with pytest.raises(ProtocolError, match=r"phase 'circle'.*the radius is 0"):
        build(replace(protocol, phases=(*protocol.phases[:2], circle)), np.eye(4))


@pytest.mark.parametrize("rcm", ["enforced", "monitored"])
def test_a_retraction_keeps_the_rcm_only_if_what_came_before_it_did(rcm):
    """It goes along the shaft: after a pivot that missed the RCM it misses it as far, to the end."""
    protocol = load_protocol(CIRCLE)
    start = protocol.waypoints[protocol.start]
    tilted = replace(start, name="tilted", angles=start.angles + np.array([0.0, 0.2, 0.0]), depth=0.05)
    moved = replace(protocol.phases[0], name="aside", to="aside")
    aside = replace(start, name="aside", position=start.position + np.array([0.01, 0.0, 0.0]))
    assert isinstance(moved, Positioning)
    phases = (moved, Insertion("in", 0.05), Pivot("turn", "tilted", rcm), Retraction("out", -0.02))
    with_them = {**protocol.waypoints, "tilted": tilted, "aside": aside}
    *_, turn, out = build(replace(protocol, waypoints=with_them, phases=phases), np.eye(4))
    m = out.motion(np.linspace(0, 1, 5))
    missed = spatial.point_to_line(out.rcm, m.p, m.Ts_base_tool[:, :3, :3] @ protocol.shaft_axis)
    assert turn.rcm_mode == out.rcm_mode == rcm
    assert (missed.max() < 1e-12) == (rcm == "enforced")
