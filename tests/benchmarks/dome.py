"""Ways out of the dome with many seeds: time, success with tracking, exact geometry, certificate.

Each seed plans phase `out` of the protocol dome by 500 samples, shortcuts and rounding, and computes its timing. The
result is judged by the judge of plans.py at 200 moments, then followed by the Raven's simulated motors, and what they
did is judged too. Processor times.

    python tests/benchmarks/dome.py [seeds] [samples]
"""

from __future__ import annotations

import sys
import time

import numpy as np
from obstacles import length, problem
from plans import Judge, obstacles

import twin
from made.planned_motion import follow
from twin.core.units import MM
from twin.planning.fmt import FmtSearch
from twin.planning.obstacle_avoidance import searched
from twin.planning.timing import time_path
from twin.reference import inertia
from twin.simulation.dynamics.arm import arm
from twin.simulation.machine import settings
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import Physics

SPEED, ACCELERATION = np.array([0.8, 0.8, 0.06, 0.8, 0.8, 0.8, 0.8]), np.array([2.4, 2.4, 0.24, 2.4, 2.4, 2.4, 2.4])


def planned(space, start, goal, box, samples, seed):
    """Return the path of one plan; None if none is found."""
    rng = np.random.default_rng(seed)
    search = FmtSearch(space, start, goal, box, rng)
    for count in (samples, int(1.5 * samples), 2 * samples):
        if (way := searched(search, count, rng)[1]) is not None:
            return way.curve
    return None


def main(seeds: int, samples: int) -> None:
    """Print one row for each seed, and the sums so far."""
    space, start, goal, box = problem()
    robot = twin.load("raven_left")
    model = arm(robot.mechanism, inertia.of_robot(robot.files.cad))
    software = settings.load(robot.files.cad / settings.NAME, model.mechanism)
    plant = MotorPlant(model, Physics.of(model, software.coulomb(model.mechanism)))
    judge = Judge(robot.mechanism, *obstacles("dome", "raven_left"))
    planned(space, start, goal, box, 100, 10_000)  # loads grids, which a space keeps
    rows = []
    for seed in range(seeds):
        began = time.process_time()
        path = planned(space, start, goal, box, samples, seed)
        if path is None:
            rows.append((0, *[np.nan] * 8))
            print(seed, "no path", flush=True)
            continue
        found = time.process_time() - began
        timing = time_path(path, SPEED, ACCELERATION)
        timed = time.process_time() - began
        seen = space.certify(path)
        certified = time.process_time() - began - timed
        s = timing.s
        followed = follow(model, software, path(s), path(s, 1) * timing.sd[:, None], plant)
        every = np.linspace(0, len(followed.q) - 1, 200).astype(int)
        least = judge.least(path, s[np.linspace(0, len(s) - 1, 200).astype(int)])[0]
        kept = judge.closest(followed.q[every], judge.pairs)[0]
        rows.append(
            (
                1,
                found,
                timed,
                certified,
                length(space, path(np.linspace(0, 1, 200))),
                seen.proven / MM,
                seen.found / MM,
                least / MM,
                kept / MM,
            )
        )
        print(seed, np.round(rows[-1], 3), f"tracking error {followed.error.max():.4f}", followed.stop, flush=True)
        a = np.array(rows)
        good = (a[:, 0] == 1) & (a[:, 8] > 0)
        print(
            f"  {len(a)} seeds: {good.sum()} out of the dome with tracking ({100 * good.mean():.1f} %), "
            f"{(a[:, 7] <= 0).sum()} collisions of plans, {(a[:, 8] <= 0).sum()} of tracked motions; path "
            f"{np.nanmedian(a[:, 1]):.2f} s, with timing {np.nanmedian(a[:, 2]):.2f} s, certificate "
            f"{np.nanmedian(a[:, 3]):.2f} s; length {np.nanmean(a[:, 4]):.3f} m; certificate above the exact minimum "
            f"{(a[:, 5] > a[:, 7]).sum()} times, below it by up to {np.nanmax(a[:, 7] - a[:, 5]):.2f} mm",
            flush=True,
        )


if __name__ == "__main__":
    given = [int(x) for x in sys.argv[1:]]
    main(*given, *(200, 500)[len(given) :])
