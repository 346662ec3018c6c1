"""Trials of a simulated operator on one robot, and the result of these trials (`twin operate`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM, UM
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.phase_path import build
from twin.planning.protocol import Protocol
from twin.simulation.controllers.contract import ClutchReport, clutch
from twin.simulation.controllers.teleoperation import Clutch, Gains, Teleoperation
from twin.simulation.controllers.velocity import Solver
from twin.simulation.devices.hand import Goal
from twin.simulation.limits import JointLimits
from twin.simulation.trial import Measures, Record, measure, operate

_NEAR, _THROUGH = 0.1e-3, 0.05e-3
"""Largest distance in m of the tool from the end pose of a phase at which the phase counts as reached; ASSUMED.

`_NEAR` is for insertions, `_THROUGH` for other phases.
"""


@dataclass(frozen=True)
class Trial:
    """One simulated trial: its seed, record and measures."""

    seed: int
    record: Record
    measures: Measures


@dataclass(frozen=True)
class Operated(Result):
    """Result of several trials of a simulated operator.

    Attributes:
        robot, protocol, title: names of robot and protocol, and title of the protocol.
        clutch, scale, solver: settings of the controller.
        columns: (names of the tool coordinates, names of the joints).
        T_tool_tip: (4, 4) pose of the tip in the tool frame.
        goals: goals of the operator, in order.
        trials: one trial per seed.
        findings: findings on goals that were not reached, and on a clutch that causes a jump.
    """

    robot: str
    protocol: str
    title: str
    clutch: Clutch
    scale: float
    solver: Solver
    columns: tuple[Sequence[str], Sequence[str]]
    T_tool_tip: Array
    goals: Sequence[Goal]
    trials: Sequence[Trial]
    findings: Sequence[Finding]

    kind = "operate"

    @property
    def word(self) -> str:
        """The verdict as text."""
        return "All goals were reached" if self.verdict == "agree" else super().word

    def content(self) -> JsonObject:
        """Return the measures of every trial; keys end with their unit."""
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "clutch": self.clutch,
            "scale": self.scale,
            "solver": self.solver,
            "assumed": "hand, tremor, gains, scale and contact: the paper gives no values",
            "trials": [
                {
                    "seed": trial.seed,
                    "time_s": m.time,
                    "clutch_presses": m.presses,
                    "path_mm": m.path / MM,
                    "contacts": m.contacts,
                    "nearest_um": {n: v / UM for n, v in m.nearest.items()},
                    "aside_um": {n: v / UM for n, v in m.aside.items()},
                    "gave_up": trial.record.missed,
                }
                for trial in self.trials
                for m in (trial.measures,)
            ],
        }

    def text(self) -> Iterator[Part]:
        """Yield the settings, a row per trial, and the findings."""
        yield f"{self.robot} · {self.title} · {self.clutch} clutch · hand, tremor, gains and scale ASSUMED\n"
        rows = []
        for trial in self.trials:
            m = trial.measures
            touched = f"{sum(m.contacts.values())} of {len(m.contacts)}"
            aside = f"{max(m.aside.values()) / UM:.0f} µm" if m.aside else "-"
            rows.append((str(trial.seed), f"{m.time:.1f} s", str(m.presses), f"{m.path / MM:.1f} mm", touched, aside))
        yield TextTable(("seed", "time", "clutch presses", "path", "contacts", "max. off axis"), rows)
        yield ""
        yield from by_severity(self.findings)

    def write(self, folder: Path) -> None:
        """Write seed<seed>.csv for each trial, with one row per tick of the teleoperation."""
        coordinates, joints = self.columns
        head = ["t_s", "pedal", *(f"handle_{n}" for n in coordinates), *joints, "tip_x_m", "tip_y_m", "tip_z_m"]
        for trial in self.trials:
            r = trial.record
            tip = (r.Ts_base_tool @ self.T_tool_tip)[:, :3, 3]
            body = np.column_stack([r.t, r.pedal, r.handle, r.q, tip])
            np.savetxt(folder / f"seed{trial.seed}.csv", body, "%.9g", ",", header=",".join(head), comments="")


def run_trials(
    name: str,
    kin: Kinematics,
    mechanism: Mechanism,
    protocol: Protocol,
    trials: int,
    seed: int,
    clutch_as: Clutch,
    scale: float,
    solver: Solver,
    progress: Callable[[str, float], None],
) -> Operated:
    """Simulate an operator who performs a protocol, once per seed.

    Args:
        name: name of the robot.
        kin: the robot's equations.
        mechanism: the robot's mechanism, with limits and frames.
        protocol: the protocol; the ends of its phases are the goals.
        trials: number of trials, with the seeds seed, seed + 1, ...
        seed: seed of the first trial.
        clutch_as: variant of the clutch, eq. (7) of the SHER simulation paper, "printed" or "corrected".
        scale: tool translation divided by handle translation; rotations are not scaled.
        solver: solver of the joint step.
        progress: called with a description of the current step and the fraction done.

    Raises:
        TwinError: the protocol has no insertion.
        KinematicsError: the robot cannot reach a goal.
    """
    T_tool_tip = mechanism.frame_in_tool(protocol.frame)
    paths = build(protocol, T_tool_tip)
    goals = []
    for path in paths:
        inserts = path.phase.type == "insertion"
        end = path.motion(np.array([1.0])).Ts_base_tool[0]
        goals.append(Goal(path.phase.name, end, _NEAR if inserts else _THROUGH, inserts))
    if not any(g.inserts for g in goals):
        raise TwinError(f"protocol '{protocol.name}' has no insertion, which the trial needs")
    limits = JointLimits.of(mechanism)
    scales = np.array([1.0 if u == "rad" else scale for u in kin.formula.coordinates.units])

    def controller() -> Teleoperation:
        return Teleoperation(Gains(scale=scales), 1 / 200, clutch_as, len(scales))

    start = kin.inverse(paths[0].motion(np.array([0.0])).Ts_base_tool[0])
    done = []
    for i in range(trials):

        def tell(goal: str, part: float, i: int = i) -> None:
            progress(f"trial {i + 1} of {trials}: {goal}", max((i + part) / trials, 1e-6))

        record = operate(kin, start, limits, controller(), goals, seed + i, solver=solver, progress=tell)
        done.append(Trial(seed + i, record, measure(record, goals, T_tool_tip, protocol.shaft_axis)))
    return Operated(
        robot=name,
        protocol=protocol.name,
        title=protocol.title,
        clutch=clutch_as,
        scale=scale,
        solver=solver,
        columns=(kin.formula.coordinates.names, [j.name for j in mechanism.active]),
        T_tool_tip=T_tool_tip,
        goals=goals,
        trials=done,
        findings=[*_jump(clutch(controller)), *_missed(done)],
    )


def _jump(contract: ClutchReport) -> list[Finding]:
    if contract.keeps:
        return []
    return [
        disagreement(
            "clutch.jump",
            "eq. (7)",
            f"when the pedal is pressed again with the handle {mm(contract.handle)} away and at rest, the tool "
            "jumps; it must not move",
            mm(contract.jump),
            mm(0.0),
            "use --clutch corrected: it keeps the offset until the next press",
        )
    ]


def _missed(trials: Sequence[Trial]) -> list[Finding]:
    out = []
    for trial in trials:
        untouched = [n for n, touched in trial.measures.contacts.items() if not touched]
        if untouched:
            why = f"; the operator gave up at '{trial.record.missed}'" if trial.record.missed else ""
            text = f"seed {trial.seed}: no contact in {', '.join(untouched)}{why}"
            out.append(disagreement("task.missed", untouched[0], text))
    return out
