"""The tool errors over the strokes of several joints: findings, data, text and CSV of `twin validate --sweep`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from twin.core.findings import Finding, Kind
from twin.core.format import quantity
from twin.core.json_types import JsonObject
from twin.core.quantity import mm
from twin.core.result import Part, Result, TextTable
from twin.core.units import DEG, MM, UM, display_unit
from twin.validation.stroke import StrokeSweep

_TOOL_DIFFERS = Kind(
    "stroke.tool", "disagreement", "`twin explain` finds an edit that fixes the equations", word="tolerance"
)


class ToolRequirement(NamedTuple):
    """The position accuracy in m that the tool must have, the provenance of this number, and its reason."""

    position: float
    provenance: str
    note: str


@dataclass(frozen=True)
class Strokes(Result):
    """Comparisons over the strokes of several joints.

    Attributes:
        sweeps: one comparison per joint.
        requirement: the required accuracy, or None if the CAD states none.
    """

    robot: str
    sweeps: tuple[StrokeSweep, ...]
    requirement: ToolRequirement | None = None

    kind = "stroke"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One finding per stroke over which the equations disagree with the mechanism."""
        findings = []
        for sweep in self.sweeps:
            if not sweep.agrees:
                findings.append(_disagreement(sweep))
        return tuple(findings)

    def content(self) -> JsonObject:
        """Return all comparisons as plain data."""
        requirement = None
        if self.requirement is not None:
            stated = self.requirement
            tool_um = stated.position / UM
            requirement = {"tool_um": tool_um, "provenance": stated.provenance, "note": stated.note}
        return {
            "robot": self.robot,
            "requirement": requirement,
            "sweeps": [sweep.as_dict() for sweep in self.sweeps],
        }

    def text(self) -> Iterator[Part]:
        """Yield a row per joint and model."""
        yield f"{self.robot} · tool error over the stroke of each joint (all other joints at home)\n"
        header = ("joint", "stroke", "model", "mean error", "largest error", "largest rotation", "")
        rows: list[tuple[str, ...]] = []
        for sweep in self.sweeps:
            rows += self._rows(sweep)
        yield TextTable(header, rows)
        if self.requirement:
            stated = self.requirement
            accuracy = f"{stated.position / UM:g} µm at the tool"
            yield f"\n  requirement: {accuracy} ({stated.provenance}: {stated.note})"
        yield ""

    def _rows(self, sweep: StrokeSweep) -> Iterator[tuple[str, ...]]:
        """Yield the cells of one stroke: the equations, then each simplified model."""
        unit, scale = display_unit(sweep.angle)
        stroke = f"{sweep.q[0] / scale:g} .. {sweep.q[-1] / scale:g} {unit}"
        for name, curve in sweep.curves.items():
            errors = curve.as_dict()
            largest = errors["position_max"]
            if largest is None:
                yield sweep.joint, stroke, name, "-", "-", "-", curve.note
                continue
            mean = quantity(errors["position_mean"], "m")
            rotation = quantity(errors["rotation_max"], "rad")
            yield sweep.joint, stroke, name, mean, quantity(largest, "m"), rotation, self._mark(sweep, name, largest)

    def _mark(self, sweep: StrokeSweep, name: str, largest: float) -> str:
        """Return the judgement of a model whose largest position error is `largest` in m."""
        # only the equations are judged; the simplified models are compared with what the tool needs
        if name == "equations":
            return "ok" if sweep.agrees else "DIFFERS"
        if not self.requirement:
            return ""
        required = self.requirement.position
        if largest <= required:
            return f"within {required / UM:g} µm"
        return f"over {required / UM:g} µm"

    def write(self, folder: Path) -> None:
        """Write one CSV file per joint with the position errors in µm."""
        for sweep in self.sweeps:
            unit = "mm"
            scale = MM
            if sweep.angle:
                unit = "deg"
                scale = DEG
            names = [f"{sweep.joint}_{unit}"]
            columns = [sweep.q / scale]
            for model, curve in sweep.curves.items():
                if len(curve.offset):
                    names += [f"{model}_x_um", f"{model}_y_um", f"{model}_z_um"]
                    columns.append(curve.offset / UM)
            values = np.column_stack(columns)
            np.savetxt(folder / f"{sweep.joint}.csv", values, "%.9g", ",", header=",".join(names), comments="")


def _disagreement(sweep: StrokeSweep) -> Finding:
    """Return the finding on a stroke over which equations and mechanism disagree."""
    largest = float(sweep.equations.distance.max())
    limit = sweep.tolerance[0]
    return _TOOL_DIFFERS(
        sweep.joint,
        f"over the stroke of {sweep.joint}, the equations and the mechanism give different tool positions",
        mm(largest),
        mm(limit),
    )
