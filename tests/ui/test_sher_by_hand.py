"""The SHER's console by a person's hand: a pen by UDP packets, and a gamepad on the page in Chromium."""

from __future__ import annotations

import asyncio
import time

import numpy as np
import pytest

import twin
from made import headset_page as headset
from made.console_page import PAD, console
from made.hole_operator import Way
from made.pens import Pens
from twin.cli import scenes
from twin.core import spatial
from twin.simulation.devices.packets import pack
from twin.simulation.session.trial_table import TrialTable
from twin.ui.headset.console_stream import ConsoleStream
from twin.ui.session.exercise import Exercise
from twin.ui.session.timeline import TICK_RATE
from twin.validation.rank_tests import compare

SCALE = 0.1
PUBLISHED = [
    (46.65, 3.00, 166.78),
    (38.11, 2.67, 114.56),
    (40.92, 4.67, 126.82),
    (36.80, 2.33, 153.02),
    (45.63, 3.33, 103.53),
]
"""Time in s, presses and path in mm of the users of the robot, Table 1 of the paper."""


@pytest.fixture(scope="module")
def scene():
    return twin.load_scene("sher_phantom")


@pytest.fixture
def trials(tmp_path):
    """A table of trials that begins with the published users of the robot."""
    file = tmp_path / "trials.csv"
    for user, (seconds, presses, path) in enumerate(PUBLISHED, 1):
        TrialTable(file, str(user), "physical").add({"time_s": seconds, "clutches": presses, "path_mm": path})
    return file


def read_by_study(file):
    """Check that `twin study` compares the new trial with the published ones; return the new row."""
    found = compare(file)
    assert [c.measure for c in found.comparisons if c.counts == (5, 1)] == ["time_s", "clutches", "path_mm"]
    head, *rows = [line.split(",") for line in file.read_text().splitlines()]
    return dict(zip(head, rows[-1], strict=True))


class Pen(Pens):
    """A pen in a right hand with a reach of 50 mm: it goes towards `way` at 60 mm/s, and clutches at its reach."""

    def __init__(self, port):
        super().__init__(port)
        self.at = np.zeros(3)
        self.home = False

    def packet(self, way, dt):
        """Return the packet after dt s; `way` (3,): what the tip lacks, in {H}, of which the hand moves the tenfold."""
        step = 0.06 * dt
        if self.home:
            goal, self.clutch = -self.at, False
            self.home = np.linalg.norm(self.at) > 1e-4
        else:
            goal, self.clutch = 1.5 * dt * way / SCALE, True
            self.home = bool(np.abs(self.at).max() > 0.05)
        length = np.linalg.norm(goal)
        self.at = self.at + goal * min(1.0, step / length if length else 0.0)
        self.number += 1
        return pack(0, self.number, spatial.pose(np.eye(3), self.at), 0.0, self.clutch)


@pytest.mark.slow
def test_a_pen_by_udp_touches_the_five_holes_and_its_trial_is_read_by_study(scene, trials):
    async def session():
        loaded = scenes.load(scene)
        table = TrialTable(trials, "7", "simulation")
        stream = ConsoleStream(loaded, Exercise(scene.tasks["phantom"], trials=table))
        stream.listen("127.0.0.1", 0)
        pen, way, tick = Pen(stream.packets.socket.port), Way(scene), 0.0
        sounds, touching = 0, False
        while stream.reading["task"]["over"] is None:
            missing = way.missing(stream.world.signals["sher.q"])
            pen.send(pen.packet(np.zeros(3) if missing is None else missing, 1 / TICK_RATE))
            stream.frame(tick, tick / TICK_RATE)
            contact = stream.reading["task"]["contact"]
            sounds += contact and not touching
            touching = contact
            tick += 1.0
            assert tick < 200 * TICK_RATE, stream.reading
        presses = stream.referee.judge.presses
        said = stream.reading
        pen.close()
        stream.close()
        return presses, said, sounds, tick / TICK_RATE

    presses, said, sounds, seconds = asyncio.run(session())
    assert said["task"]["over"] == "All holes are touched."
    assert said["task"]["trials"] == {"file": "trials.csv", "number": 1, "problem": ""}
    assert sounds == 5
    row = read_by_study(trials)
    assert (row["user"], row["group"], row["holes_touched"], row["wrong_holes"]) == ("7", "simulation", "5", "0")
    assert float(row["clutches"]) == presses > 3
    assert 50 < float(row["path_mm"]) < 150
    assert 0 < float(row["time_s"]) <= seconds  # on a busy machine, the World waits, and fewer of its seconds pass


AXES = """
(([x, y, z, pedal]) => {
  const live = (v) => v === 0 ? 0 : Math.sign(v) * (0.15 + 0.85 * Math.min(1, Math.abs(v)));
  window.pad.axes = [0, 0, live(x), -live(y)];
  const set = (k, v) => { window.pad.buttons[k] = {pressed: v > 0, value: v > 0 ? Math.abs(live(v)) : 0}; };
  set(4, Number(pedal)); set(6, z); set(7, -z);
  return [...twin.app.model.robots[0].frame.q];
})
"""
"""Script that moves the sticks and triggers of the pad, and returns the joints of the newest frame."""


@pytest.mark.slow
@pytest.mark.browser
def test_a_gamepad_on_the_page_touches_the_five_holes_and_its_trial_is_read_by_study(browser, scene, trials):
    server = headset.Serving(
        "sher_phantom", None, "--task", "phantom", "--trials", str(trials), "--user", "8", "--group", "simulation"
    )
    way = Way(scene)
    speed = 8.0  # mm/s of the tool at the end of a stick
    try:
        with console(browser, server.url, size=(1000, 640), scripts=(PAD,), draws=False) as page:
            page.until("twin.app.loaded", "the scene")
            page.page.mouse.click(500, 20)  # a gesture, without which browsers make no sound
            page("window.pad.connected = true")
            q = page("[...twin.app.model.robots[0].frame.q]")
            end = time.monotonic() + 400
            while not page("twin.app.model.console.task.over !== null"):
                missing = way.missing(q)
                rates = np.zeros(3) if missing is None else 0.8e3 * missing / speed
                largest = np.abs(rates).max()
                rates = rates / max(1.0, largest / 0.6)
                q = page(f"{AXES}({[*rates.tolist(), True]})".replace("True", "true"))
                assert time.monotonic() < end, page("JSON.stringify(twin.app.model.console)")
            page.until("twin.app.console.sound.clicks >= 5", "a click for each hole")  # by the next picture
            sound = page("({clicks: twin.app.console.sound.clicks, state: twin.app.console.sound.context?.state})")
            card = page("document.querySelector('[data-id=result]').textContent")
            felt = page("window.felt.length")
    finally:
        server.stop()
    assert sound["clicks"] >= 5
    assert sound["state"] == "running"
    assert felt > 0
    assert "All holes are touched" in card
    row = read_by_study(trials)
    assert (row["user"], row["group"], row["holes_touched"]) == ("8", "simulation", "5")
    # once; whenever a busy machine stops the page for long, the server lets go, and the pad takes hold again
    assert float(row["clutches"]) >= 1
    print("gamepad:", row)
