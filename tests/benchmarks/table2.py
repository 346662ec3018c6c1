"""The Raven paper's Table 2 and Fig. 7 with our scene and robot: planning, tracking, waypoints, cost, success.

Each row plans out of the dome by FMT* without shortcuts, for the cost of eq. (1) with the paper's weights, and with no
clearance, as the paper does. A plan is tracked by a simulated arm: rigid bodies, rotors, viscous and Coulomb friction
(`MotorPlant`), under PD control of each joint with constant gains and compensation of gravity. The set point is the
next waypoint, after the time that the planner assumes for an edge. A run succeeds if a plan is found and no body
touches another one or the dome while it is tracked: coal judges every fourth millisecond.

With --simulated, a connection is accepted only if the same arm passes it without a collision, as in the paper: its tip
leaves the straight connection by some millimetres.

Fig. 7 shows the tip: moved by a user who ignores the dome (a straight line from start to goal, minimum jerk at 50 mm/s,
ASSUMED), and tracked along the plans of 500 samples for (eta1, eta2) = (1, 0) and (0, 1); one dot each 20 ms.

    python tests/benchmarks/table2.py [seeds] [figure7.png] [--simulated]
"""

from __future__ import annotations

import sys
import time

import numpy as np
from obstacles import problem
from plans import Judge, obstacles
from scipy.stats import spearmanr

import twin
from twin.core import spatial
from twin.core.units import MM
from twin.planning.costs import total
from twin.planning.fmt import FmtSearch
from twin.planning.published_cost import BANDWIDTH, EDGE_TIME, published_cost
from twin.reference import ReferenceModel, inertia
from twin.simulation.dynamics.arm import arm
from twin.simulation.machine import settings
from twin.simulation.machine.gravity_compensation import holding
from twin.simulation.machine.motor_plant import MotorPlant
from twin.simulation.machine.physics import TICK, Physics

CLEARANCE = 0.1 * MM
"""Required distance in the search: as near to none as its tests allow."""

EVERY = 4
"""Ticks between two states that are judged."""

PAPER_TABLE = {
    200: (3.676, 4.705, 13.5, 21.9, 90.0),
    500: (15.935, 4.277, 14.3, 11.1, 85.0),
    1000: (47.708, 3.909, 11.1, 6.5, 85.0),
    2000: (216.373, 3.688, 11.1, 5.7, 75.0),
}
"""The paper's Table 2: samples -> (planning in s, tracking in s, waypoints, cost, success in %)."""

FIGURE = {"user": "tab:red", "eta = (1, 0): length": "tab:green", "eta = (0, 1): acceleration": "tab:blue"}
"""Colours of the paper's Fig. 7."""


class PdArm:
    """The Raven's plant under PD control of its joints, with constant gains for the bandwidth of the planner."""

    def __init__(self, start):
        robot = twin.load("raven_left")
        self.model = arm(robot.mechanism, inertia.of_robot(robot.files.cad))
        mechanism = self.model.mechanism
        software = settings.load(robot.files.cad / settings.NAME, mechanism)
        self.plant = MotorPlant(self.model, Physics.of(self.model, software.coulomb(mechanism)))
        self.T = mechanism.motor_matrix
        outward = np.linalg.inv(self.T)
        rotors = outward.T @ np.diag(self.plant.physics.rotors) @ outward
        inertias = np.diag(self.model.dynamics().mass_matrix(start) + rotors)
        self.kp = BANDWIDTH**2 * inertias
        # the viscous friction of the joints brakes as well
        self.kd = np.maximum(2 * BANDWIDTH * inertias - self.plant.physics.viscous, 0.0)
        self.gravity = holding(mechanism)

    def tracked(self, waypoints):
        """Return joint values (k, n) in each tick, from rest at the first of waypoints (m, n) to the last."""
        self.plant.reset(waypoints[0])
        states = []
        ticks = round(EDGE_TIME / TICK)
        for goal in waypoints[1:]:
            for _ in range(ticks):
                q, qd = self.plant.q, self.plant.qd
                efforts = self.kp * (goal - q) - self.kd * qd + self.gravity(q)
                self.plant.advance(self.T.T @ efforts)
                states.append(self.plant.q.copy())
        return np.array(states)


class SimulatedSpace:
    """A joint space whose connections are those that the arm under PD control passes without a collision."""

    def __init__(self, space, plant):
        self._space, self._plant = space, plant

    def __getattr__(self, name):
        return getattr(self._space, name)

    def free_each(self, a, b):
        """Return (m,) bool: whether the connections from a to b (m, n) are free, straight and as the arm moves."""
        free = self._space.free_each(a, b)
        for k in np.flatnonzero(free):
            q = self._plant.tracked(np.array([a[k], b[k]]))
            inside = np.clip(q[::EVERY], *self._space.limits.T)  # the arm may stand at a stop
            free[k] = self._space.free(inside, exact=False).all()
        return free


def squares(model, q):
    """Return the integral of |tip acceleration|^2 of a motion q (k, n) in ticks."""
    p = model.run(q).Ts_base_tool[:, :3, 3]
    acceleration = np.diff(p, 2, axis=0) / TICK**2
    return float((acceleration**2).sum() * TICK)


def compare_plants(space, plant, model, box, count=60):
    """Print how the cost of the linear plant ranks edges beside the simulated arm with constant gains."""
    rng = np.random.default_rng(0)
    low, high = box.T
    a = rng.uniform(low, high, (count, len(low)))
    b = np.clip(a + 0.5 * (high - low) * rng.uniform(-1, 1, a.shape), low, high)
    cost = published_cost(space.mechanism, space.limits, (0.0, 1.0))(a, b)
    simulated = np.array([squares(model, plant.tracked(np.array(ends))) for ends in zip(a, b, strict=True)])
    print(
        f"integral of |tip acceleration|^2 of {count} edges, arm with constant gains over linear plant: median "
        f"{np.median(simulated / cost):.2f}, rank correlation {spearmanr(cost, simulated).statistic:.3f}"
    )


def table(seeds, space, start, goal, box, plant, judge):
    """Print Table 2 beside the paper's."""
    cost = published_cost(space.mechanism, space.limits)
    FmtSearch(space, start, goal, box, np.random.default_rng(99), cost).path(100)  # loads grids, which a space keeps
    print(
        "samples  planning s        tracking s      waypoints       cost          success %     (brackets: the paper)"
    )
    for count, paper in PAPER_TABLE.items():
        rows = []
        for seed in range(seeds):
            search = FmtSearch(space, start, goal, box, np.random.default_rng(seed), cost)
            began = time.process_time()
            corners = search.path(count)
            planning = time.process_time() - began
            if corners is None:
                rows.append((planning, np.nan, np.nan, np.nan, 0.0))
                continue
            q = plant.tracked(corners)
            free = judge.closest(q[::EVERY], judge.pairs)[0] > 0
            rows.append((planning, len(q) * TICK, len(corners), total(cost, corners), 100.0 * free))
        means = np.nanmean(rows, axis=0)
        cells = [f"{value:8.3f} ({printed:g})" for value, printed in zip(means, paper, strict=True)]
        print(f"{count:7d}  " + "  ".join(cells), flush=True)


def by_hand(robot, start, goal):
    """Return joint values (k, n), every 1 ms, of a straight line of the tool with minimum jerk, through all bodies."""
    model = ReferenceModel(robot.mechanism)
    Ts = model.run(np.array([start, goal])).Ts_base_tool
    distance = np.linalg.norm(Ts[1, :3, 3] - Ts[0, :3, 3])
    duration = 1.875 * distance / (50 * MM)
    x = np.linspace(0, 1, round(duration / TICK) + 1)
    s = x**3 * (10 - 15 * x + 6 * x**2)
    rotation = spatial.log_so3(Ts[0, :3, :3].T @ Ts[1, :3, :3])
    poses = np.tile(Ts[0], (len(s), 1, 1))
    for pose, share in zip(poses, s, strict=True):
        pose[:3, :3] = Ts[0, :3, :3] @ spatial.exp_so3(share * rotation)
        pose[:3, 3] += share * (Ts[1, :3, 3] - Ts[0, :3, 3])
    return robot.kinematics().inverse_many(poses)


def figure7(name, space, start, goal, box, plant, judge):
    """Draw the three tip paths beside the dome, and print their lengths."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    robot = twin.load("raven_left")
    model = judge.model
    motions = {"user": by_hand(robot, start, goal)}
    for label, eta in (("eta = (1, 0): length", (1.0, 0.0)), ("eta = (0, 1): acceleration", (0.0, 1.0))):
        cost = published_cost(space.mechanism, space.limits, eta)
        corners = FmtSearch(space, start, goal, box, np.random.default_rng(0), cost).path(500)
        motions[label] = plant.tracked(corners)
        lengths = published_cost(space.mechanism, space.limits, (1.0, 0.0))
        print(
            f"{label}: {len(corners)} waypoints, length {total(lengths, corners):.3f} (each joint's range counts as 1)"
        )
    figure = plt.figure(figsize=(9.5, 4.4), layout="constrained")
    views = [figure.add_subplot(1, 2, k + 1, projection="3d") for k in (0, 1)]
    for view, (elevation, azimuth) in zip(views, ((18, -60), (75, -90)), strict=True):
        for _, body, T in obstacles("dome", "raven_left")[0]:
            if body.name != "dome":  # this body includes loops and ring
                continue
            for mesh in body.meshes:
                points = 1e3 * (mesh.vertices @ T[:3, :3].T + T[:3, 3])
                view.plot_trisurf(*points.T, triangles=mesh.triangles, color="0.6", alpha=0.12, linewidth=0)
        for label, q in motions.items():
            p = 1e3 * model.run(q[::20]).Ts_base_tool[:, :3, 3]
            view.plot(*p.T, color=FIGURE[label], linewidth=0.7)
            view.scatter(*p.T, color=FIGURE[label], s=7, label=label, depthshade=False)
        view.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
        view.set_aspect("equal")
        view.view_init(elevation, azimuth)
    views[1].set(zlabel="", zticks=[])
    views[0].legend(fontsize=8, loc="upper left")
    figure.savefig(name, dpi=110, metadata={"Software": None})
    plt.close(figure)


def main(seeds: int, picture: str | None, simulated: bool) -> None:
    """Print the table and the comparison of plants, and draw the figure."""
    space, start, goal, box = problem(CLEARANCE)
    plant = PdArm(start)
    if simulated:
        space = SimulatedSpace(space, plant)
    judge = Judge(twin.load("raven_left").mechanism, *obstacles("dome", "raven_left"))
    compare_plants(space, plant, judge.model, box)
    table(seeds, space, start, goal, box, plant, judge)
    if picture:
        figure7(picture, space, start, goal, box, plant, judge)


if __name__ == "__main__":
    given = [text for text in sys.argv[1:] if text != "--simulated"]
    main(int(given[0]) if given else 20, given[1] if len(given) > 1 else None, "--simulated" in sys.argv)
