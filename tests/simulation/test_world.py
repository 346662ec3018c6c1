"""The World: the same input gives the same bytes, hazards change what happens, and nothing is wired wrongly."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from made import worlds
from made.field import Field
from made.loops import two_links
from twin.core.errors import WorldError
from twin.core.units import MM
from twin.reference import ReferenceModel
from twin.simulation.devices.recorded import Recorded
from twin.simulation.hazards.fault import Fault
from twin.simulation.limits import JointLimits
from twin.simulation.plants.kinematic import Kinematic
from twin.simulation.world import Block, Placed, Recording, World, read_recording

FREE = JointLimits(np.full(2, -np.inf), np.full(2, np.inf), np.full(2, np.inf))


# -- the same input, the same bytes ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def here():
    return {name: worlds.happened(make()) for name, make in worlds.KINDS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", worlds.KINDS)
def test_the_same_world_gives_the_same_bytes_twice(name, here):
    assert worlds.happened(worlds.KINDS[name]()) == here[name]


@pytest.mark.nightly
def test_the_same_worlds_give_the_same_bytes_in_another_process(here):
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-m", "made.worlds"], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == here


def test_another_seed_gives_another_world():
    first, other = worlds.sher(), worlds.sher(seed=1)
    first.step(300)
    other.step(300)
    assert first.recording().to_bytes() != other.recording().to_bytes()


@pytest.mark.parametrize(
    "hazards",
    [
        tuple,
        lambda: (
            Fault("hand.pedal", 0.3, 0.5, "hold"),
            Fault("sher.encoder", 0.4, 0.45, "add", 1e-5),
            Fault("hand.handle", 0.4, 0.5, "add", 1e-3),
        ),
    ],
    ids=["quiet", "hazards"],
)
def test_a_recorded_hand_makes_its_world_happen_again(hazards, tmp_path):
    world = worlds.sher(hazards=hazards())
    world.step(700)
    first = world.recording()
    first.write(tmp_path / "a.world")
    again = worlds.sher(Recorded(read_recording(tmp_path / "a.world"), "hand"), hazards()).run()
    assert again.to_bytes() == first.to_bytes()


@pytest.mark.slow
def test_recorded_commands_move_robots_without_their_planners():
    first = worlds.vsrs()
    first.step(300)
    recording = first.recording()
    names = [a.place.name for a in worlds.actors()]
    again = World(
        robots=[Placed(a.place.name, a.mechanism, a.place.T_world_base) for a in worlds.actors()],
        devices=[Recorded(recording, *(f"{n}.command" for n in names))],
        plants=[Kinematic(a.place.name, a.trajectory.q[0], JointLimits.of(a.mechanism)) for a in worlds.actors()],
        dt=first.dt,
    ).run()
    assert again.to_bytes() == recording.to_bytes()


# -- what is in it --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_robots_of_a_scene_are_where_their_plans_lead_at_their_places():
    world = worlds.vsrs()
    world.step(301)
    frame = world.frame()
    for actor in worlds.actors():
        name = actor.place.name
        q = actor.trajectory.joints(np.array([6.0]))[0]
        np.testing.assert_allclose(world.signals[f"{name}.q"], q, atol=1e-12)
        for link, T in ReferenceModel(actor.mechanism).solve(q).link_poses.items():
            np.testing.assert_allclose(frame.link_poses[name][link], actor.place.T_world_base @ T, atol=1e-9)


def test_vertices_travel_with_the_body_that_they_are_pinned_to():
    world = worlds.waving()
    world.step(500)
    frame = world.frame()
    T = frame.link_poses["arm"]["hand"]
    wanted = worlds.wave(worlds.cloth().mesh.vertices, 0.499) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(frame.fields["cloth"], wanted, atol=1e-12)
    assert np.ptp(frame.fields["cloth"][:, 2]) > 0.05
    assert (frame.t, frame.fields["cloth"].shape) == (pytest.approx(0.5), (25, 3))


def test_a_prop_rests_where_it_stands():
    away = np.eye(4)
    away[:3, 3] = 1, 2, 3
    frame = World(props=[Placed("table", two_links(), away)]).frame()
    np.testing.assert_allclose(frame.link_poses["table"]["base"], away)


class Count(Block):
    """Writes how often it was asked, and what it saw of another."""

    def __init__(self, name, sees=None, period=0.0, until=10**9):
        self.name, self.sees, self.period, self.until, self.count = name, sees, period, until, 0
        self.outputs = {f"{name}.count": 0, f"{name}.saw": 0}

    def step(self, signals, t, dt):
        if self.count == self.until:
            return None
        self.count += 1
        return {f"{self.name}.count": self.count, f"{self.name}.saw": signals[self.sees][0] if self.sees else 0}


def test_devices_see_the_tick_before_controllers_and_plants_the_blocks_before_them():
    world = World(
        devices=[Count("device", "plant.count")],
        controllers=[Count("near", "device.count"), Count("far", "near.count")],
        plants=[Count("plant", "far.count"), Count("tissue", "plant.count", period=2e-3)],
    )
    world.step(4)
    seen = {n: world.recording()[f"{n}.saw"][:, 0].tolist() for n in ("device", "near", "far", "plant", "tissue")}
    assert seen.pop("device") == [0, 1, 2, 3]
    assert seen.pop("tissue") == [1, 1, 3, 3]
    assert list(seen.values()) == [[1, 2, 3, 4]] * 3


def test_a_world_ends_before_the_tick_for_which_a_device_has_nothing():
    world = World(devices=[Count("short", until=3), Count("long")], plants=[Count("plant")])
    assert not world.step(5)
    assert (world.tick, world.ended, world.step()) == (3, True, False)
    assert world.recording()["plant.count"][:, 0].tolist() == [1, 2, 3]


@given(
    q=st.floats(-2, 2),
    command=st.floats(-5, 5),
    lower=st.floats(-2, 0),
    upper=st.floats(0, 2),
    speed=st.floats(0.1, 99),
)
def test_joints_stay_within_rates_and_limits_and_reach_what_is_allowed(q, command, lower, upper, speed):
    plant = Kinematic("arm", [q], JointLimits(np.array([lower]), np.array([upper]), np.array([speed])))
    world = World(controllers=[Says(lambda s: {"arm.command": command}, 1)], plants=[plant], dt=0.01)
    world.step()
    after = world.signals["arm.q"][0]
    assert abs(after - q) <= speed * 0.01 * (1 + 1e-12) + 1e-15
    if lower <= q <= upper:
        assert lower - 1e-15 <= after <= upper + 1e-15
    if lower <= command <= upper and abs(command - q) <= speed * 0.01 * (1 - 1e-12):
        assert after == command


def test_a_world_without_devices_does_not_run_for_ever():
    with pytest.raises(WorldError, match="no device whose input ends"):
        worlds.waving().run()


# -- hazards --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_pedal_that_sticks_lets_the_tool_follow_the_hand_back():
    """The handle goes back to the middle with the pedal up; where it sticks down, the tool goes along."""
    far = (9, 0, 0)
    quiet, stuck = worlds.sher(mm=far), worlds.sher(mm=far, hazards=(Fault("hand.pedal", 1.0, 60.0, "hold"),))
    quiet.step(3000)
    stuck.step(3000)
    first, other = quiet.recording(), stuck.recording()
    up = np.flatnonzero((first["hand.pedal"][:, 0] < 0.5) & (first.t > 1.0))
    moved = np.ptp(first["sher.q"][up[:500]], axis=0).max()
    held = np.ptp(other["sher.q"][up[:500]], axis=0).max()
    assert moved == 0
    assert held > 0.5 * MM
    assert (other["hand.pedal"][1000:] == 1).all()
    assert (other["hand.pedal.written"][up[0]] == 0).all()
    assert not np.array_equal(first["sher.q"][-1], other["sher.q"][-1])


def test_an_encoder_that_jumps_pushes_the_robot_away_and_spares_the_plant():
    spike = Fault("sher.encoder", 0.5, 0.6, "add", np.array([1, 0, 0, 0, 0]) * 0.1 * MM)
    quiet, loud = worlds.sher(), worlds.sher(hazards=(spike,))
    quiet.step(600)
    loud.step(600)
    a, b = quiet.recording(), loud.recording()
    np.testing.assert_array_equal(a["sher.q"][:500], b["sher.q"][:500])
    np.testing.assert_allclose((b["sher.encoder"] - b["sher.encoder.written"])[500:600, 0], 0.1 * MM, rtol=1e-6)
    np.testing.assert_array_equal(b["sher.encoder.written"], b["sher.q"])
    assert np.abs(a["sher.q"][599] - b["sher.q"][599]).max() > 0.01 * MM


# -- what is refused ------------------------------------------------------------------------------------------------


class Says(Block):
    """Commands an arm whatever it is given."""

    def __init__(self, out, joints=2):
        self.out, self.outputs = out, {"arm.command": np.zeros(joints)}

    def step(self, signals, t, dt):
        return self.out(signals)


ARM = {"robots": [Placed("arm", two_links())], "plants": [Kinematic("arm", np.zeros(2), FREE)]}


@pytest.mark.parametrize(
    ("made", "text"),
    [
        ({"dt": 0.0}, "dt is 0 s; it must be above 0"),
        ({"dt": np.inf}, "dt is inf s; it must be above 0 and finite"),
        ({"robots": [Placed("arm", two_links())]}, "robot 'arm' has no plant: no block writes 'arm.q'"),
        (ARM | {"plants": [Kinematic("arm", np.zeros(3), FREE)]}, "robot 'arm' needs 2 numbers in 'arm.q'"),
        ({"controllers": [Count("Slow")]}, "signal 'Slow.count' must be called <owner>.<what>"),
        (ARM | {"props": [Placed("arm", two_links())]}, "'arm' is used twice in one World"),
        ({"plants": 2 * ARM["plants"]}, "'arm.q' is used twice in one World"),
        (ARM | {"hazards": [Fault("arm.encodre", 0, 1, "hold")]}, "no signal 'arm.encodre'. Did you mean 'arm.enc"),
        ({"controllers": [Count("slow", period=0.0015)]}, "Count steps every 0.0015 s, which is not a multiple of"),
        ({"controllers": [Count("slow", period=np.nan)]}, "Count steps every nan s, which is not a multiple of"),
        ({"controllers": [Count("slow", period=np.inf)]}, "Count steps every inf s, which is not a multiple of"),
        ({"deformables": [worlds.cloth()]}, "'cloth' has no plant: no block writes 'cloth.vertices'"),
        (
            {"deformables": [worlds.cloth()], "plants": [Field(worlds.cloth(), worlds.wave)]},
            "'cloth': there is no robot or prop 'arm'",
        ),
        (
            {**ARM, "deformables": [c := replace(worlds.cloth(), body="hnd")],
             "plants": [*ARM["plants"], Field(c, worlds.wave)]},
            "'cloth': there is no body of arm 'hnd'. Did you mean 'hand'?",
        ),
        ({**ARM, "controllers": [Says(lambda s: {"arm.q": 1})]}, "Says writes 'arm.q', which is not among its outputs"),
        ({**ARM, "controllers": [Says(lambda s: {"arm.command": [1, 2, 3]})]}, "has 2 numbers; 3 were written"),
        ({**ARM, "controllers": [Says(lambda s: s["arm.qd"])]}, "there is no signal 'arm.qd'"),
        ({**ARM, "controllers": [Says(lambda s: {"arm.command": [np.nan, 0]})]}, "'arm.command' is not finite at"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_named(made, text):
    with pytest.raises(WorldError) as caught:
        World(**made).step()
    assert text in str(caught.value)


def test_a_fault_of_no_number_is_refused():
    with pytest.raises(WorldError, match=r"fault of arm\.q: target is \[\]; give an index"):
        Fault("arm.q", 0, 1, "add", 1.0, target=[])


# -- recordings -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def waved():
    world = worlds.waving()
    world.step(20)
    return world.recording()


def test_a_recording_is_read_as_it_was_written(waved, tmp_path):
    waved.write(tmp_path / "a.world")
    again = read_recording(tmp_path / "a.world")
    assert again.to_bytes() == waved.to_bytes() == (tmp_path / "a.world").read_bytes()
    assert (again.sizes, again.dt) == (waved.sizes, waved.dt)
    np.testing.assert_array_equal(again["arm.q"], waved["arm.q"])
    with pytest.raises(WorldError, match=r"there is no signal 'arm\.p'"):
        again["arm.p"]
    with pytest.raises(WorldError, match="there is no recorded signal 'leg'"):
        Recorded(again, "leg")


def test_a_recording_without_a_tick_is_read_as_it_was_written(waved, tmp_path):
    Recording(waved.dt, waved.sizes, waved.rows[:0]).write(tmp_path / "a.world")
    assert read_recording(tmp_path / "a.world").rows.shape == waved.rows[:0].shape


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda b: b[:-8], "the file is truncated or too long"),
        (lambda b: b + b"\0", "the file is truncated or too long"),
        (lambda b: b[:-1] + bytes([b[-1] ^ 1]), "the rows of the file have changed since the file was written"),
        (lambda b: b.replace(b"twin-world", b"twin-track"), "not a twin-world file of version 1: schema"),
        (lambda b: b.replace(b'"version": 1', b'"version": 2'), "not a twin-world file of version 1: version"),
        (lambda b: b.replace(b'"ticks": 20', b'"ticks": 20, "more": 1'), "not a twin-world file of version 1: more"),
        (lambda b: b.replace(b'"ticks": 20', b'"ticks": "20"'), "not a twin-world file of version 1: ticks"),
        (lambda b: b.replace(b'"dt": 0.001', b'"dt": -0.001'), "not a twin-world file of version 1: dt"),
        (lambda b: b.replace(b'"arm.encoder"', b'"arm.command"'), "two signals have the same name"),
        (lambda b: b"", "not a twin-world file of version 1: first line"),
        (lambda b: b"\0" * 100, "not a twin-world file of version 1: first line"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(waved, spoil, text, tmp_path):
    file = tmp_path / "a.world"
    file.write_bytes(spoil(waved.to_bytes()))
    with pytest.raises(WorldError) as caught:
        read_recording(file)
    assert text in str(caught.value)


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(WorldError, match=r"none\.world: cannot be read: No such file"):
        read_recording(tmp_path / "none.world")
