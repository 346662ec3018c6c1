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
        return max((n for n in self.runs if n != EXACT), key=lambda n: self.runs[n].tip_max)

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
        return tuple(f for name, run in self.runs.items() for f in _judged(name, run, self.arm))

    @property
    def word(self) -> str:
        """The verdict as text."""
        return (
            f"The tip error stays within {TIP_LIMIT / MM:g} mm"
            if self.verdict == "agree"
            else "The tip error exceeds the limit"
        )

    def content(self) -> JsonObject:
        """Return plain data."""
        return {
            "robot": self.robot,
            "protocol": self.protocol,
            "inertia": SOURCES[self.inertia],
            "masses_kg": {joint: round(mass, 6) for joint, mass in self.arm.masses.items()},
            "duration_s": self.duration,
            "assumed": "rate, gains, mismatch, encoders and instrument: the paper gives no values",
            "runs": {n: r.as_dict() for n, r in self.runs.items()},
            "worst": self.worst,
            "torques": [row.as_dict() for row in self.efforts],
            "curves": {n: [r.as_dict() for r in rs] for n, rs in self.curves.items()},
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        c = self.runs[EXACT].conditions
        yield f"{self.robot} · {self.title} · {self.duration:.3f} s · simulated with {c.plant}"
        yield (
            f"  Kp = w², Kv = 2 w, w = {c.w:g} rad/s, {c.rate:g} Hz, efforts constant during a tick. Wrong models:\n"
            f"  masses {100 * self.mismatch:g} % wrong, friction {100 * c.friction_error:g} % wrong, encoder step "
            f"{ENCODER * 1e6:.2f} µrad. All ASSUMED: the paper prints no values.\n"
            f"  Inertias: {SOURCES[self.inertia]}; moving mass {sum(self.arm.masses.values()):.2f} kg.\n"
        )
        rows = [(n, *_lengths(r), _um(r.rcm_max)) for n, r in self.runs.items()]
        yield TextTable(("model", "tip error max µm", "tip error RMS µm", "shaft to RCM max µm"), rows)
        yield ""
        for name, runs in self.curves.items():
            yield TextTable(
                (name, "tip error max µm", "tip error RMS µm"),
                [(f"{100 * r.conditions.inertia_error:+.0f} %", *_lengths(r)) for r in runs],
            )
            yield ""
        yield TextTable(("all runs", "unit", "peak", "RMS", "limit", "margin"), [_effort(row) for row in self.efforts])
        yield ""
        yield from by_severity(self.findings)

    def write(self, folder: Path) -> None:
        """Write track.csv: time; tip and RCM error of every run; joint errors and motor efforts of the worst run."""
        columns, head = [self.motion.t], ["t_s"]
        for name, r in self.runs.items():
            label = _label(name)
            columns += [r.tip_error, r.rcm_error]
            head += [f"tip_error_{label}_m", f"rcm_error_{label}_m"]
        r = self.runs[self.worst]
        columns += [*r.joint_error.T, *r.effort.T]
        head += [f"error_{j.name}_{'rad' if j.is_angle else 'm'}" for j in self.arm.mechanism.active]
        kinds = {"N m": "torque_{}_n_m", "N": "force_{}_n"}
        head += [kinds[unit].format(m) for m, unit in zip(self.arm.motors, self.arm.effort_units, strict=True)]
        np.savetxt(folder / "track.csv", np.column_stack(columns), "%.9g", ",", header=",".join(head), comments="")


def _judged(name: str, r: Run, arm: Arm) -> Iterator[Finding]:
    if name == EXACT and r.tip_max > EXACT_LIMIT:
        yield warning(
            "track.exact",
            name,
            "maximum tip error with an exact model; the only cause is that efforts are constant during a tick",
            um(r.tip_max),
            um(EXACT_LIMIT),
        )
    if r.tip_max > TIP_LIMIT:
        yield disagreement(
            "track.tip",
            name,
            f"{name}: maximum tip error exceeds the value in the paper on the PA-10",
            mm(r.tip_max),
            mm(TIP_LIMIT),
            "use a higher control bandwidth w or a better friction model",
            when=f"{r.t[int(r.tip_error.argmax())]:.3f} s",
        )
    cut = [motor for i, motor in enumerate(arm.motors) if r.saturated[:, i].any()]
    if cut:
        ticks = int(r.saturated.any(axis=1).sum())
        text = f"{name}: the efforts of {', '.join(cut)} were at their limits for {ticks} ticks"
        yield warning("track.saturated", cut[0], text)


def _lengths(r: Run) -> tuple[str, str]:
    return f"{r.tip_max / UM:.2f}", f"{r.tip_rms / UM:.2f}"


def _um(value: float | None) -> str:
    return "-" if value is None else f"{value / UM:.2f}"


def _effort(row: EffortRow) -> tuple[str, ...]:
    limit = ("-", "-") if row.margin is None else (f"{row.limit:g}", f"{100 * row.margin:.0f} %")
    return row.joint, row.unit, f"{row.peak:.2f}", f"{row.rms:.2f}", *limit


def _label(name: str) -> str:
    """Return the name of a run as part of a column name: "links -5 %" becomes links_minus_5_percent."""
    for sign, word in (("±", " either "), ("+", " plus "), ("-", " minus "), ("%", " percent "), (",", " ")):
        name = name.replace(sign, word)
    return "_".join(name.replace(".", "p").split())
