"""Trials of a simulated operator on one robot, and the result of these trials (`twin operate`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.core.findings import Finding, by_severity, disagreement
from twin.core.json_types import JsonObject
from twin.core.progress import Progress
from twin.core.quantity import mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import MM, UM
from twin.kinematics import Kinematics
from twin.model.mechanism import Mechanism
from twin.planning.protocol import Protocol
from twin.simulation.controllers.clutch_test import ClutchReport, clutch_report
from twin.simulation.controllers.jacobian_step import Solver
from twin.simulation.controllers.teleoperation import Clutch, Gains, Teleoperation, scales_of
from twin.simulation.devices.hand import Goal
from twin.simulation.limits import JointLimits
from twin.simulation.trial import Measures, Record, goals_of, measure, operate

_PERIOD = 1 / 200
"""Duration in s of a tick of the teleoperation; ASSUMED."""


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
        findings: findings on insertions without contact, on goals that the operator gave up, and on a clutch that
            causes a jump.
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
        if self.verdict == "agree":
            return "All goals were reached"
        return super().word

    def content(self) -> JsonObject:
        """Return the measures of every trial; keys end with their unit."""
        trials = []
        for trial in self.trials:
            measures = trial.measures
            trials.append(
                {
                    "seed": trial.seed,
                    "time_s": measures.time,
                    "clutch_presses": measures.presses,
                    "path_mm": measures.path / MM,
                    "contacts": measures.contacts,
                    "nearest_um": _in_um(measures.nearest),
                    "aside_um": _in_um(measures.aside),
                    "gave_up": trial.record.missed,
                }
            )
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "clutch": self.clutch,
            "scale": self.scale,
            "solver": self.solver,
            "assumed": "hand, tremor, gains, scale and contact: the paper gives no values",
            "trials": trials,
        }

    def text(self) -> Iterator[Part]:
        """Yield the settings, a row per trial, and the findings."""
        yield f"{self.robot} · {self.title} · {self.clutch} clutch · hand, tremor, gains and scale ASSUMED\n"
        rows = []
        for trial in self.trials:
            measures = trial.measures
            time = f"{measures.time:.1f} s"
            path = f"{measures.path / MM:.1f} mm"
            contacts = f"{sum(measures.contacts.values())} of {len(measures.contacts)}"
            aside = "-"
            if measures.aside:
                aside = f"{max(measures.aside.values()) / UM:.0f} µm"
            rows.append((str(trial.seed), time, str(measures.presses), path, contacts, aside))
        yield TextTable(("seed", "time", "clutch presses", "path", "contacts", "max. off axis"), rows)
        yield ""
        yield from by_severity(self.findings)

    def write(self, folder: Path) -> None:
        """Write seed<seed>.csv for each trial, with one row per tick of the teleoperation."""
        coordinates, joints = self.columns
        head = ["t_s", "pedal"]
        for name in coordinates:
            head.append(f"handle_{name}")
        head += [*joints, "tip_x_m", "tip_y_m", "tip_z_m"]
        for trial in self.trials:
            record = trial.record
            tip = (record.Ts_base_tool @ self.T_tool_tip)[:, :3, 3]
            body = np.column_stack([record.t, record.pedal, record.handle, record.q, tip])
            # comments="": without it, numpy writes "# " before the head
            np.savetxt(folder / f"seed{trial.seed}.csv", body, "%.9g", ",", header=",".join(head), comments="")


def run_trials(
    name: str,
    kin: Kinematics,
    mechanism: Mechanism,
    protocol: Protocol,
    trials: int,
    seed: int,
    clutch: Clutch,
    scale: float,
    solver: Solver,
    progress: Progress,
) -> Operated:
    """Simulate an operator who performs a protocol, once per seed.

    Args:
        name: name of the robot.
        kin: the robot's equations.
        mechanism: the robot's mechanism, with limits and frames.
        protocol: the protocol; the ends of its phases are the goals.
        trials: number of trials, with the seeds seed, seed + 1, ...
        seed: seed of the first trial.
        clutch: variant of the clutch, eq. (7) of the SHER simulation paper, "printed" or "corrected".
        scale: tool translation divided by handle translation; rotations are not scaled.
        solver: solver of the joint step.
        progress: called with a description of the current step and the fraction done.

    Raises:
        TwinError: the protocol has no insertion.
        KinematicsError: the robot cannot reach a goal.
    """
    T_tool_tip = mechanism.frame_in_tool(protocol.frame)
    start_pose, goals = goals_of(protocol, T_tool_tip)
    limits = JointLimits.of(mechanism)
    scales = scales_of(kin, scale)

    def controller() -> Teleoperation:
        return Teleoperation(Gains(scale=scales), _PERIOD, clutch, len(scales))

    start = kin.inverse(start_pose)
    finished_trials = []
    for i in range(trials):
        # i=i: the number of this trial, also when it is called later
        def tell(goal: str, part: float, i: int = i) -> None:
            fraction = (i + part) / trials
            # above 0, because 0 is shown as an unknown fraction
            progress(f"trial {i + 1} of {trials}: {goal}", max(fraction, 1e-6))

        record = operate(kin, start, limits, controller(), goals, seed + i, solver=solver, progress=tell)
        measures = measure(record, goals, T_tool_tip, protocol.shaft_axis)
        finished_trials.append(Trial(seed + i, record, measures))
    return Operated(
        robot=name,
        protocol=protocol.name,
        title=protocol.title,
        clutch=clutch,
        scale=scale,
        solver=solver,
        columns=(kin.formula.coordinates.names, [joint.name for joint in mechanism.active]),
        T_tool_tip=T_tool_tip,
        goals=goals,
        trials=finished_trials,
        findings=[*_jump(clutch_report(controller)), *_missed(finished_trials)],
    )


def _in_um(lengths: Mapping[str, float]) -> dict[str, float]:
    """Return lengths in m by name in µm."""
    values = {}
    for name, length in lengths.items():
        values[name] = length / UM
    return values


def _jump(report: ClutchReport) -> list[Finding]:
    if report.keeps:
        return []
    return [
        disagreement(
            "clutch.jump",
            "eq. (7)",
            f"when the pedal is pressed again with the handle {mm(report.handle)} away and at rest, the tool "
            "jumps; it must not move",
            mm(report.jump),
            mm(0.0),
            "use --clutch corrected: it keeps the offset until the next press",
        )
    ]


def _missed(trials: Sequence[Trial]) -> list[Finding]:
    """Return a finding for each trial with an insertion without contact, or with a goal that was given up."""
    findings = []
    for trial in trials:
        untouched = []
        for goal, touched in trial.measures.contacts.items():
            if not touched:
                untouched.append(goal)
        given_up = trial.record.missed
        faults = []
        if untouched:
            faults.append(f"no contact in {', '.join(untouched)}")
        if given_up:
            faults.append(f"the operator gave up at '{given_up}'")
        if not faults:
            continue
        # a goal may be given up after every contact, such as the retraction after the last insertion
        where = untouched[0] if untouched else given_up
        findings.append(disagreement("task.missed", where, f"seed {trial.seed}: {'; '.join(faults)}"))
    return findings
