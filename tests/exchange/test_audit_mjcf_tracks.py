"""The poses that MuJoCo computes from a track: what the track states in part, and numbers that are not finite."""

from __future__ import annotations

import mujoco
import numpy as np

from twin.exchange.audit.file_content import FileClip
from twin.exchange.audit.ledger import Ledger
from twin.exchange.formats.mjcf.audit.track_poses import TrackCoordinates, play_track

TIMES = np.arange(2.0)


def test_a_stated_joint_is_set_beside_one_of_which_the_track_says_nothing():
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody><body name="arm"><joint name="a" axis="0 0 1"/><joint name="b" axis="0 1 0" ref="10"/>
        <joint name="c" type="ball"/><geom size="0.1"/></body></worldbody></mujoco>""")
    coordinates = TrackCoordinates(model, FileClip("swing", TIMES, {}, {"a": np.array([0.3, 0.4])})).all_keys()
    np.testing.assert_allclose(coordinates[:, 0], [0.3, 0.4])
    np.testing.assert_allclose(coordinates[:, 1:], np.tile(model.qpos0[1:], (2, 1)))


def test_a_loop_whose_residual_is_not_a_number_is_wrong():
    model = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody><body name="arm"><joint name="a" axis="0 0 1"/><geom size="0.1"/></body></worldbody>
        <equality><connect name="pin" body1="arm" anchor="1 0 0"/></equality></mujoco>""")
    ledger = Ledger("x.xml")
    play_track(model, {"arm": 1}, FileClip("swing", TIMES, {}, {"a": np.array([0.0, np.nan])}), ledger)
    (row,) = ledger.checks
    assert (row.worst, row.verdict, row.where) == (None, "disagree", "pin")
    (finding,) = ledger.found
    assert finding.message == "clip 'swing': the residual of equality 'pin' is not a finite number."
