"""Evaluate designs, store each result immediately, and report the Pareto-optimal designs."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.analysis import design, table
from twin.analysis.cluster import HERE, cluster, each
from twin.api.robot import Progress, Robot, silent
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.result import Part, Result, Table
from twin.core.spatial import Array
from twin.core.units import MM
from twin.kinematics.closed_loops.passive_limits import passive_limits

_SHOWN = 20
"""Maximum number of Pareto-optimal designs in the text."""


@dataclass(frozen=True)
class Sweep(Result):
    """Results of evaluated designs.

    Attributes:
        work: the factors and the objectives.
        designs: (k, factors) in SI units, the CAD's design first.
        judged: (k, objectives) values, in the units of `design.OBJECTIVES`.
        best: (k,) bool, whether a design is Pareto-optimal.
        before: number of designs with results that a previous run had stored in the folder.
        unchecked: names of the passive joints with limits, which are not checked for designs.
    """

    robot: str
    work: design.Job
    designs: Array
    judged: Array
    best: np.ndarray
    before: int
    unchecked: tuple[str, ...] = ()

    kind = "sweep"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Always empty: designs are compared, not judged against a limit."""
        return ()

    @property
    def rows(self) -> list[JsonObject]:
        """A row for each design: factors, objectives, and whether it is Pareto-optimal."""
        names = self.work.objectives
        return [
            {**design.row(self.work, i, d, dict(zip(names, j, strict=True))), "pareto": bool(b)}
            for i, (d, j, b) in enumerate(zip(self.designs, self.judged.tolist(), self.best, strict=True))
        ]

    def content(self) -> JsonObject:
        """Return the results as plain data."""
        known = {n: design.OBJECTIVES[n] for n in self.work.objectives}
        grid = None  # only volumes are computed by counting cells
        if "volume" in known:
            grid = {"step_mm": self.work.step / MM, "volume_error_dm3": design.grid_error(self.work)}
        rows = self.rows
        return {
            "robot": self.robot,
            "designs": len(self.designs),
            "judged_before": self.before,
            "objectives": {n: {"unit": unit, "meaning": meaning} for n, (unit, _, meaning) in known.items()},
            "grid": grid,
            "passive_limits_unchecked": list(self.unchecked),
            "drawn": rows[0],
            "pareto": [r for r in rows if r["pareto"]],
        }

    def text(self) -> Iterator[Part]:
        """Yield the CAD's design and the Pareto-optimal designs."""
        data = self.content()
        yield f"{self.robot} · {len(self.designs)} designs evaluated ({self.before} from the cache)"
        yield from (f"  {name}: {meaning['meaning']}" for name, meaning in data["objectives"].items())
        if (grid := data["grid"]) is not None:
            cells = f"a grid of {grid['step_mm']:.3g} mm, the same for every design"
            yield f"  volumes are sums of cells of {cells}: ± {grid['volume_error_dm3']:.1g} dm³ for the CAD's design"
        if self.unchecked:
            names, why = ", ".join(self.unchecked), "a design changes the equations, but not the mechanism of the CAD"
            yield f"  not checked: limits of the passive joints {names}: {why}"
        yield ""
        head = [n for n in data["drawn"] if n != "pareto"]
        best = [r for r in data["pareto"] if r["design"] != 0]
        yield Table(head, [[_cell(n, r[n]) for n in head] for r in [data["drawn"], *best[:_SHOWN]]], fit=True)
        if len(best) > _SHOWN:
            yield f"  and {len(best) - _SHOWN} more Pareto-optimal designs"
        if beaten := len(self.designs) - len(best) - 1:
            yield f"  not shown: {beaten} dominated or infeasible designs; all are in sweep.csv"
        yield ""


def _cell(name: str, value: Any) -> str:
    if name == "design":
        return "CAD" if value == 0 else str(value)
    return f"{value:.4g}"


def sweep(
    robot: Robot,
    vary: Sequence[str],
    folder: Callable[[str], Path],
    *,
    source: str,
    objectives: Sequence[str] = (),
    protocol: str | None = None,
    samples: int = 200,
    grid: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    progress: Progress = silent,
) -> Sweep:
    """Evaluate designs, and reuse results that a previous run has stored in the same folder.

    Args:
        robot: a robot with CAD, and with equations if an objective requires them.
        vary: factors, NAME=LOW..HIGH with a unit, see `twin.analysis.design.factor`.
        folder: function from the hash of the request to the folder for the results.
        source: name or path by which workers load the robot.
        objectives: names in `twin.analysis.design.OBJECTIVES`; default: "tolerance" if all factors are distances, else
            "volume" and "conditioning".
        protocol: name of the protocol that sets the trocar positions; default: the robot's default protocol.
        samples: number of designs in a Latin hypercube; not used with `grid`.
        grid: number of levels of each factor; None: Latin hypercube.
        seed: seed of the Latin hypercube.
        workers: number of processes; default: one for each processor.
        scheduler: address of a Dask scheduler to use instead of local processes.
        fresh: whether designs with stored results are evaluated again.
        progress: see `twin.api.Progress`.

    Raises:
        TwinError: a factor or an objective does not exist.
    """
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    factors = [design.factor(robot, text) for text in vary]
    if len({f.name for f in factors}) < len(factors):
        raise TwinError("--vary: the same factor is given twice")
    default = ("tolerance",) if all(":" in f.name for f in factors) else ("volume", "conditioning")
    objectives = tuple(dict.fromkeys(objectives or default))
    progress("positions", 0.0)
    work = design.job(robot, source, protocol, factors, objectives)
    designs = design.values(factors, samples, grid, seed)
    with table.Table(folder(table.key_of(work, designs)), work, designs, fresh=fresh) as kept:
        before = len(kept.done)
        todo = [i for i in range(len(designs)) if i not in kept.done]
        if todo:
            _judge(work, designs, todo, kept, scheduler or HERE, workers, progress)
    judged = np.array([[kept.done[i][n] for n in objectives] for i in range(len(designs))])
    best = design.pareto(judged, [design.OBJECTIVES[n][1] for n in objectives])
    return Sweep(robot.name, work, designs, judged, best, before, _unchecked(robot, objectives))


def _unchecked(robot: Robot, objectives: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the passive joints with limits, if an objective depends on the reached positions."""
    if set(objectives) == {"tolerance"}:
        return ()
    return tuple(dict.fromkeys(limit.joint.name for limit in passive_limits(robot.mechanism)))


def _judge(
    work: design.Job,
    designs: Array,
    todo: list[int],
    kept: table.Table,
    scheduler: str,
    workers: int | None,
    progress: Progress,
) -> None:
    # Ctrl-C or SIGTERM stops the sweep; results of evaluated designs are kept.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with cluster(scheduler, workers) as client:
            for k, result in each(client, design.judge, [(work, designs[i].tolist()) for i in todo]):
                kept.add(todo[k], result)
                progress(f"{len(kept.done)} of {len(designs)} designs", len(kept.done) / len(designs))
    except KeyboardInterrupt:
        text = f"{len(kept.done)} of {len(designs)} designs are in {kept.folder}; run the same command again to go on"
        raise KeyboardInterrupt(text) from None
    finally:
        signal.signal(signal.SIGTERM, before)
