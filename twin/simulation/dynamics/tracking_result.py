"""Result of a computed-torque simulation: errors with exact and wrong models, efforts, findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from twin.core.findings import Finding, by_severity, disagreement, warning
from twin.core.json_types import JsonObject
from twin.core.quantity import mm, um
from twin.core.result import Part, Result, TextTable
from twin.core.units import MM, UM
from twin.simulation.dynamics.arm import Arm
from twin.simulation.dynamics.computed_torque import (
    ENCODER,
    EXACT_LIMIT,
    TIP_LIMIT,
    DesiredMotion,
    EffortRow,
    Run,
    effort_table,
)

EXACT = "exact model"
"""Name of the run without model mismatch."""

SOURCES = {
    "cited": "masses, mass centres and tensors as cited in inertia.toml",
    "cad": "masses, mass centres and tensors from shapes and densities of the CAD (ASSUMED where marked)",
}
"""Descriptions of the sources of the masses; `Tracking.inertia` is one of the keys."""


@dataclass(frozen=True)
class Tracking(Result):
    """Runs with computed-torque control along one protocol.

    Attributes:
        robot, protocol, title: names of robot and protocol, and title of the protocol.
        inertia: source of the masses, a key of `SOURCES`.
        arm: the robot model.
        motion: the desired motion.
        phases: (name, type, start in s, end in s) of each phase of the protocol.
        mismatch: relative error of the masses in the wrong models.
        runs: the runs, with their names as keys; the first run has the exact model.
        curves: lists of runs with different inertia errors; the keys are names of the other conditions. Empty if not
            requested.
    """

    kind: ClassVar[str] = "track"
    robot: str
    protocol: str
    title: str
    inertia: str
    arm: Arm
    motion: DesiredMotion
    phases: tuple[tuple[str, str, float, float], ...]
    mismatch: float
    runs: Mapping[str, Run]
    curves: Mapping[str, list[Run]]

    @property
    def worst(self) -> str:
        """Name of the run with the largest tip error among the runs with a wrong model."""
        wrong_models = list(self.runs)
        wrong_models.remove(EXACT)
        return max(wrong_models, key=lambda name: self.runs[name].tip_max)

    @property
    def duration(self) -> float:
        """Duration of the motion in s."""
        return float(self.motion.t[-1] - self.motion.t[0])

    @cached_property
    def efforts(self) -> list[EffortRow]:
        """Peak and rms effort of each motor over all runs."""
        return effort_table(self.arm, *self.runs.values())

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on exceeded limits of tip error and motor effort."""
        findings: list[Finding] = []
        for name, run in self.runs.items():
            findings += _judged(name, run, self.arm)
        return tuple(findings)

    @property
    def word(self) -> str:
        """The verdict as text."""
        if self.verdict == "agree":
            return f"The tip error stays within {TIP_LIMIT / MM:g} mm"
        return "The tip error exceeds the limit"

    def content(self) -> JsonObject:
        """Return plain data."""
        masses = {}
        for joint, mass in self.arm.masses.items():
            masses[joint] = round(mass, 6)
        runs = {}
        for name, run in self.runs.items():
            runs[name] = run.as_dict()
        curves = {}
        for name, curve in self.curves.items():
            curves[name] = [run.as_dict() for run in curve]
        torques = []
        for row in self.efforts:
            torques.append(row.as_dict())
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "inertia": SOURCES[self.inertia],
            "masses_kg": masses,
            "duration_s": self.duration,
            "assumed": "rate, gains, mismatch, encoders and instrument: the paper gives no values",
            "runs": runs,
            "worst": self.worst,
            "torques": torques,
            "curves": curves,
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        conditions = self.runs[EXACT].conditions
        moving_mass = sum(self.arm.masses.values())
        friction_percent = 100 * conditions.friction_error
        yield f"{self.robot} · {self.title} · {self.duration:.3f} s · simulated with {conditions.plant}"
        yield (
            f"  Kp = w², Kv = 2 w, w = {conditions.w:g} rad/s, {conditions.rate:g} Hz, efforts constant during a tick. "
            f"Wrong models:\n"
            f"  masses {100 * self.mismatch:g} % wrong, friction {friction_percent:g} % wrong, encoder step "
            f"{ENCODER * 1e6:.2f} µrad. All ASSUMED: the paper prints no values.\n"
            f"  Inertias: {SOURCES[self.inertia]}; moving mass {moving_mass:.2f} kg.\n"
        )
        rows = []
        for name, run in self.runs.items():
            rcm_error = "-" if run.rcm_max is None else f"{run.rcm_max / UM:.2f}"
            rows.append((name, *_tip_errors(run), rcm_error))
        yield TextTable(("model", "tip error max µm", "tip error RMS µm", "shaft to RCM max µm"), rows)
        yield ""
        for name, curve in self.curves.items():
            rows = []
            for run in curve:
                inertia_error = f"{100 * run.conditions.inertia_error:+.0f} %"
                rows.append((inertia_error, *_tip_errors(run)))
            yield TextTable((name, "tip error max µm", "tip error RMS µm"), rows)
            yield ""
        yield TextTable(("all runs", "unit", "peak", "RMS", "limit", "margin"), list(map(_effort, self.efforts)))
        yield ""
        yield from by_severity(self.findings)

    def write(self, folder: Path) -> None:
        """Write track.csv: time; tip and RCM error of every run; joint errors and motor efforts of the worst run."""
        head = ["t_s"]
        columns = [self.motion.t]
        for name, run in self.runs.items():
            label = _label(name)
            head += [f"tip_error_{label}_m", f"rcm_error_{label}_m"]
            columns += [run.tip_error, run.rcm_error]
        worst = self.runs[self.worst]
        columns += [*worst.joint_error.T, *worst.effort.T]
        for joint in self.arm.mechanism.active:
            unit = "rad" if joint.is_angle else "m"
            head.append(f"error_{joint.name}_{unit}")
        for motor, effort_unit in zip(self.arm.motors, self.arm.effort_units, strict=True):
            head.append(f"torque_{motor}_n_m" if effort_unit == "N m" else f"force_{motor}_n")
        # comments="": without it, numpy writes "# " before the head
        np.savetxt(folder / "track.csv", np.column_stack(columns), "%.9g", ",", header=",".join(head), comments="")


def _judged(name: str, run: Run, arm: Arm) -> Iterator[Finding]:
    """Yield findings on the tip error of a run, and on motors that reached their limits."""
    if name == EXACT and run.tip_max > EXACT_LIMIT:
        yield warning(
            "track.exact",
            name,
            "maximum tip error with an exact model; the only cause is that efforts are constant during a tick",
            um(run.tip_max),
            um(EXACT_LIMIT),
        )
    if run.tip_max > TIP_LIMIT:
        time = run.t[int(run.tip_error.argmax())]
        yield disagreement(
            "track.tip",
            name,
            f"{name}: maximum tip error exceeds the value in the paper on the PA-10",
            mm(run.tip_max),
            mm(TIP_LIMIT),
            "use a higher control bandwidth w or a better friction model",
            when=f"{time:.3f} s",
        )
    saturated = []
    for i, motor in enumerate(arm.motors):
        if run.saturated[:, i].any():
            saturated.append(motor)
    if saturated:
        ticks = int(run.saturated.any(axis=1).sum())
        text = f"{name}: the efforts of {', '.join(saturated)} were at their limits for {ticks} ticks"
        yield warning("track.saturated", saturated[0], text)


def _tip_errors(run: Run) -> tuple[str, str]:
    return f"{run.tip_max / UM:.2f}", f"{run.tip_rms / UM:.2f}"


def _effort(row: EffortRow) -> tuple[str, ...]:
    limit = "-"
    margin = "-"
    if row.limit is not None and row.margin is not None:
        limit = f"{row.limit:g}"
        margin = f"{100 * row.margin:.0f} %"
    return row.joint, row.unit, f"{row.peak:.2f}", f"{row.rms:.2f}", limit, margin


def _label(name: str) -> str:
    """Return the name of a run as part of a column name: "links -5 %" becomes links_minus_5_percent."""
    words = {"±": " either ", "+": " plus ", "-": " minus ", "%": " percent ", ",": " ", ".": "p"}
    return "_".join(name.translate(str.maketrans(words)).split())
