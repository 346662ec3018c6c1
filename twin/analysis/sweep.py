"""Evaluate designs, store each result immediately, and report the Pareto-optimal designs."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from twin.analysis import design, table
from twin.analysis.cluster import LOCAL, DeviceProcesses, cluster, each, require_keys
from twin.analysis.grid_workspace import limited_passive_joints
from twin.api.name_or_path import name_or_path
from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.findings import Finding
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM

_SHOWN_DESIGNS = 20
"""Maximum number of Pareto-optimal designs in the text."""


@dataclass(frozen=True)
class Sweep(Result):
    """Results of evaluated designs.

    Attributes:
        job: the factors and the objectives.
        designs: (k, factors) in SI units, the CAD's design first.
        judged: (k, objectives) values, in the units of `design.OBJECTIVES`.
        best: (k,) bool, whether a design is Pareto-optimal.
        before: number of designs with results that a previous run had stored in the folder.
        unchecked: names of the passive joints with limits, which are not checked for designs.
        devices: what has computed the designs that were missing, see `ComputeDevice.name`.
        folder: where each result is stored.
    """

    robot: str
    job: design.DesignJob
    designs: Array
    judged: Array
    best: np.ndarray
    before: int
    unchecked: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()
    folder: Path = Path()

    kind = "sweep"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Always empty: designs are compared, not judged against a limit."""
        return ()

    @property
    def rows(self) -> list[JsonObject]:
        """A row for each design: factors, objectives, and whether it is Pareto-optimal."""
        rows = []
        for number, values in enumerate(self.judged.tolist()):
            objectives = dict(zip(self.job.objectives, values, strict=True))
            row = design.table_row(self.job, number, self.designs[number], objectives)
            row["pareto"] = bool(self.best[number])
            rows.append(row)
        return rows

    def content(self) -> JsonObject:
        """Return the results as plain data."""
        objectives = {}
        for name in self.job.objectives:
            unit, _, meaning = design.OBJECTIVES[name]
            objectives[name] = {"unit": unit, "meaning": meaning}
        grid = None  # only volumes are computed by counting cells
        if "volume" in objectives:
            grid = {"step_mm": self.job.step / MM, "volume_error_dm3": design.grid_error(self.job)}
        rows = self.rows
        return {
            "robot": self.robot,
            "designs": len(self.designs),
            "judged_before": self.before,
            "devices": list(self.devices),
            "objectives": objectives,
            "grid": grid,
            "passive_limits_unchecked": list(self.unchecked),
            "drawn": rows[0],
            "pareto": [row for row in rows if row["pareto"]],  # in the order of the designs
        }

    def text(self) -> Iterator[Part]:
        """Yield the CAD's design and the Pareto-optimal designs."""
        data = self.content()
        yield f"{self.robot} · {len(self.designs)} designs evaluated ({self.before} from the cache)"
        for name, objective in data["objectives"].items():
            yield f"  {name}: {objective['meaning']}"
        grid = data["grid"]
        if grid is not None:
            cells = f"a grid of {grid['step_mm']:.3g} mm, the same for every design"
            yield f"  volumes are sums of cells of {cells}: ± {grid['volume_error_dm3']:.1g} dm³ for the CAD's design"
        if self.unchecked:
            names = ", ".join(self.unchecked)
            reason = "a design changes the equations, but not the mechanism of the CAD"
            yield f"  not checked: limits of the passive joints {names}: {reason}"
        yield ""
        drawn_row = data["drawn"]
        best_rows = [row for row in data["pareto"] if row["design"] != 0]
        head = [name for name in drawn_row if name != "pareto"]
        cells = []
        for row in (drawn_row, *best_rows[:_SHOWN_DESIGNS]):
            cells.append([_cell(name, row[name]) for name in head])
        yield TextTable(head, cells)
        if len(best_rows) > _SHOWN_DESIGNS:
            yield f"  and {len(best_rows) - _SHOWN_DESIGNS} more Pareto-optimal designs"
        others = len(self.designs) - len(best_rows) - 1
        if others:
            yield f"  not shown: {others} dominated or infeasible designs; all are in sweep.csv"
        yield ""


def _cell(name: str, value: float) -> str:
    """Return the value of a column as text; design 0 is that of the CAD."""
    if name != "design":
        return f"{value:.4g}"
    if value == 0:
        return "CAD"
    return str(value)


def sweep(
    robot: Robot | str | Path,
    vary: str | Sequence[str],
    out: str | Path | None = None,
    *,
    objectives: Sequence[str] = (),
    protocol: str | None = None,
    samples: int = 200,
    grid: int | None = None,
    seed: int = 0,
    fresh: bool = False,
    progress: Progress = silent,
    **processes: Unpack[DeviceProcesses],
) -> Sweep:
    """Evaluate designs, and reuse results that a previous run has stored in the same folder.

    Args:
        robot: a robot with CAD, and with equations if an objective requires them; or its name or folder.
        vary: factors, NAME=LOW..HIGH with a unit, see `twin.analysis.design.parse_factor`.
        out: folder for the results; default: ./twin-out/<robot>/sweep-<key>/, with a key for each request.
        objectives: names in `twin.analysis.design.OBJECTIVES`; default: "tolerance" if all factors are distances, else
            "volume" and "conditioning".
        protocol: name of the protocol that sets the trocar positions; default: the robot's default protocol.
        samples: number of designs in a Latin hypercube; not used with `grid`.
        grid: number of levels of each factor; None: Latin hypercube.
        seed: seed of the Latin hypercube.
        fresh: whether designs with stored results are evaluated again.
        progress: see `twin.api.Progress`.
        **processes: `workers`, `scheduler`, `source` and `device`: where designs are evaluated, see `DeviceProcesses`.

    Raises:
        TwinError: a factor or an objective does not exist.

    Examples:
        >>> import twin
        >>> found = twin.sweep("sher", "l4:e_a-e_d=72..75mm", out="designs", grid=2, workers=1)
        >>> len(found.designs)
        3
    """
    require_keys("sweep", processes, DeviceProcesses)
    source = processes.get("source") or name_or_path(robot)
    if isinstance(vary, str):
        vary = [vary]
    robot = loaded(robot)
    if protocol or robot.mechanism.trocars:
        robot = robot.bound(robot.protocol(protocol))
    factors = [design.parse_factor(robot, text) for text in vary]
    distances = design.distance_names(factors)
    if len({factor.name for factor in factors}) < len(factors):
        raise TwinError("--vary: the same factor is given twice")
    default: tuple[str, ...] = ("volume", "conditioning")
    if len(distances) == len(factors):
        default = ("tolerance",)  # distances of the mechanism change nothing else
    objectives = tuple(dict.fromkeys(objectives or default))
    progress("positions", 0.0)
    job = design.design_job(robot, source, protocol, factors, objectives)
    computed_by: set[str] = set()
    designs = design.sample_designs(factors, samples, grid, seed)
    key = table.key_of(job, designs)
    folder = Path("twin-out") / robot.name / f"sweep-{key[:8]}"
    if out is not None:
        folder = Path(out)
    store = table.SweepTable(folder, job, designs, fresh=fresh)
    with store:
        before = len(store.done)
        missing = [number for number in range(len(designs)) if number not in store.done]
        if missing:
            computed_by = _evaluate(job, designs, missing=missing, store=store, processes=processes, progress=progress)
    judged = np.zeros((len(designs), len(objectives)))
    directions = []
    for column, name in enumerate(objectives):
        _, direction, _ = design.OBJECTIVES[name]
        directions.append(direction)
        for number in range(len(designs)):
            judged[number, column] = store.done[number][name]
    best = design.pareto(judged, directions)
    unchecked = _unchecked(robot, objectives)
    return Sweep(
        robot.name,
        job=job,
        designs=designs,
        judged=judged,
        best=best,
        before=before,
        unchecked=unchecked,
        devices=tuple(sorted(computed_by)),
        folder=folder,
    )


def _unchecked(robot: Robot, objectives: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the passive joints with limits, if an objective depends on the reached positions."""
    if set(objectives) == {"tolerance"}:
        return ()
    return tuple(limited_passive_joints(robot))


def _evaluate(
    job: design.DesignJob,
    designs: Array,
    missing: list[int],
    store: table.SweepTable,
    processes: DeviceProcesses,
    progress: Progress,
) -> set[str]:
    """Evaluate the designs with the numbers `missing`, and store the result of each; return what has computed them."""
    scheduler = processes.get("scheduler") or LOCAL
    workers = processes.get("workers")
    if workers is not None:
        workers = min(workers, len(missing))  # more would have nothing to do
    device = processes.get("device", "cpu")
    tasks = []
    for number in missing:
        tasks.append((job, designs[number].tolist(), device))
    computed_by: set[str] = set()
    try:
        # Ctrl-C or SIGTERM stops the sweep; results of evaluated designs are kept.
        with _terminable(), cluster(scheduler, workers) as client:
            for task_number, (result, name) in each(client, design.evaluate_on, tasks):
                store.add(missing[task_number], result)
                computed_by.add(name)
                done = len(store.done)
                progress(f"{done} of {len(designs)} designs", done / len(designs))
    except KeyboardInterrupt:
        stored = f"{len(store.done)} of {len(designs)} designs are in {store.folder}"
        raise KeyboardInterrupt(f"{stored}; run the same command again to go on") from None
    return computed_by


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt in the `with` block; only the main thread can set how signals are handled."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler_before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, handler_before)
