"""Time from the release of the target to the preview on the page, out of the dome, and what it consists of.

Without a graphics card, Chromium draws with all processors, beside the server and the planner; so the page is measured
as it is, and without its drawing. Each time, the target either rests before the release, so that the search has begun,
or it moves until the release. `search` is the processor time of the plan with its timing and pictures, alone in this
process.

    python tests/benchmarks/plan_page.py [plans]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from made import headset_page as headset
from made.console_page import console
from made.dome_console import ABOVE, dome_console
from twin.core.units import DEG, MM
from twin.ui.session import plan_jobs

START = np.append([50 * DEG, 114 * DEG, 378 * MM, 0, -52 * DEG, 0], 0.0)
"""Joint values of the arm at the start of the scene."""

PLAN = "twin.app.console.plan"
DRAWS = (("without drawing", False), ("with drawing by the processors", True))
RESTS = (("after a rest of 1 s", 1.0), ("during the motion", 0.0))
WATCH = """
(() => {
  const p = twin.app.console.plan, hear = p.hear.bind(p), release = p.press.bind(p);
  window.times = {};
  p.hear = (m) => { hear(m); if (m.type === 'plan' && m.poses) window.times.preview = performance.now(); };
  p.press = (d, on) => { release(d, on); if (!on) window.times.released = performance.now(); };
})()
"""


def on_the_page(folder: Path, way: list[float], plans: int, draws: bool, rest: float) -> list[float]:
    """Return the times in s from release to preview of plans to a place above the lid.

    `draws`: the page draws; `rest`: time in s between the last motion of the hand and the release.
    """
    out, server = [], headset.Serving(str(folder))
    for browser in headset.chromium():
        with console(browser, server.url, size=(900, 520)) as page:
            page.until(
                "twin.app.console.move('left', 0, 0, 0) || twin.app.model.console.hands.left.follows", "the hand moves"
            )
            page("twin.app.console.chosen = 'left'")
            page(WATCH)
            page.draws(draws)
            for _ in range(plans):
                page("window.times = {}")
                page.page.keyboard.down("p")
                page.until(f"{PLAN}.phase === 'aim' && {PLAN}.state.ready", "the geometry is loaded")
                for _ in range(20):
                    page(f"twin.app.console.move('left', {way[0] / 20}, {way[1] / 20}, {way[2] / 20})")
                    time.sleep(0.05)
                time.sleep(rest)
                page.page.keyboard.up("p")
                page.until("window.times.preview > 0", f"a preview: {page(f'{PLAN}.state')}")
                out.append(page("window.times.preview - window.times.released") / 1000)
                page.until(f"{PLAN}.clearance?.proven > 0", "the proven clearance")
                page.page.keyboard.press("Escape")
                page.until(f"{PLAN}.phase === 'off'", "cancelled")
    server.stop()
    return out


def alone(file: Path, goal: np.ndarray, plans: int) -> list[float]:
    """Return the processor times in s of plans from the start to a goal (n,), until the preview."""
    room, out = plan_jobs.Room(1, str(file), "raven_left", {}), []
    for seed in range(plans + 1):
        began = time.process_time()
        next(plan_jobs.plan(plan_jobs.PlanJob(room, START, goal, 0.06, 45 * DEG, seed)))
        out.append(time.process_time() - began)
    return out[1:]  # the first one loads the shapes


def main(plans: int) -> None:
    """Print medians and largest values."""
    from twin.cli.scenes import load

    with tempfile.TemporaryDirectory() as folder:
        scene = dome_console(Path(folder))
        robots = load(scene).robots
        kin = robots["raven_left"].kinematics()
        T = kin.forward(START)  # the hand moves the target, and does not turn it
        T[:3, 3] = kin.forward(np.append([x * (MM if i == 2 else DEG) for i, x in enumerate(ABOVE)], 0.0))[:3, 3]
        goal = kin.inverse(T, START)
        rows = [("search, processor time", alone(scene.file, goal, plans))]
        way = way_in_picture(robots, scene, kin, goal)
        rows += [
            (f"release {how} to preview, {what}", on_the_page(Path(folder), way, plans, draws, rest))
            for what, draws in DRAWS
            for how, rest in RESTS
        ]
        for name, times in rows:
            print(f"{name}: median {np.median(times):.2f} s, largest {max(times):.2f} s of {len(times)}", flush=True)


def way_in_picture(robots, scene, kin, goal) -> list[float]:
    """Return the way in m from the tip to the goal, in the axes of the endoscope's picture."""
    from twin.simulation.console_scene import picture_in_tool, start

    at = {p.name: p for p in scene.places}
    arm, eye = at["raven_left"], at["ecm"]
    T = eye.T_world_base @ robots["ecm"].kinematics().forward(start(eye, robots["ecm"].mechanism))
    view = T @ picture_in_tool(scene.cameras[scene.console.camera], robots["ecm"].mechanism)
    way = arm.T_world_base @ (kin.forward(goal) - kin.forward(start(arm, robots["raven_left"].mechanism)))
    return [float(x) for x in view[:3, :3].T @ way[:3, 3]]


if __name__ == "__main__":
    main(int([*sys.argv, 5][1]))
