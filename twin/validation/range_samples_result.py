"""Equations and mechanism at many states over the joint range: findings, data and text of `validate --samples`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from twin.core.findings import Finding, Kind, by_severity
from twin.core.json_types import JsonObject
from twin.core.quantity import deg, mm
from twin.core.result import Part, Result, TextTable
from twin.core.spatial import Array
from twin.core.units import DEG, MM, display_unit
from twin.model.mechanism import Mechanism

CONFIRMED_STATES = 64
"""Number of states without a suspicion that the reference model judges as well."""

_DIFFERS = Kind(
    "samples.differs",
    "disagreement",
    "look for a quadrant (atan for atan2), a sign or a branch; `twin explain` searches for an edit",
    word="tolerance",
)
_NO_ANSWER = Kind(
    "samples.no_answer",
    "disagreement",
    "extend the equations, or state where they end by a row of `reach` in the formula",
    word="",
)
_NO_MARGIN = Kind(
    "samples.no_margin",
    "disagreement",
    "let the row of `reach` have a value at all states: negative where the equations do not hold",
    word="",
)
_UNDECIDED_STATES = Kind(
    "samples.undecided",
    "error",
    "give --samples fewer states, or compare along protocols through these states",
    word="",
)
_NOTHING_JUDGED = Kind("samples.nothing", "error", "check the limits of the joints and the rest poses", word="")


@dataclass(frozen=True)
class JudgedStage:
    """What was found about the inverse equations, about the forward equations, or about a row of reach.

    Attributes:
        name: "inverse", "forward" or "reach".
        judged: number of states at which the equations were compared.
        position, rotation: largest errors in m and rad, over the states without a suspicion; None if all states are
            suspected, and for a row of reach.
        suspects: number of states at which the kernels find no result, or an error above the tolerance.
        examined: number of suspects that the reference model has judged.
        by_reference: number of states that the reference model has judged: examined ones, and some without a suspicion.
        wrong: number of these at which an error is above the tolerance.
        missing: number of these without a result of the equations.
        worst: errors in m and rad, and the joint values (n,) at which they occur, at that of the wrong states where
            they are largest, each relative to its tolerance; None if there is no wrong state with a result.
        missing_at: joint values (n,) of a state without a result; None if there is none.
        row: name of the row of reach, if the stage is one: a margin has no error, but may have no value.
    """

    name: str
    judged: int
    position: float | None
    rotation: float | None
    suspects: int
    examined: int
    by_reference: int
    wrong: int
    missing: int
    worst: tuple[float, float, Array] | None = None
    missing_at: Array | None = None
    row: str = ""

    @property
    def subject(self) -> str:
        """What the stage is about, as text."""
        return f"the row '{self.row}' of reach" if self.row else f"the {self.name} equations"

    @property
    def share(self) -> str:
        """How many of the judged states are suspected, as text."""
        return f"{self.suspects} of {self.judged} states ({_percent(self.suspects, self.judged)})"

    def cells(self) -> tuple[str, ...]:
        """Return the row of the stage in the table of the text."""
        name = f"{self.name}, {self.row}" if self.row else self.name
        error = "-"
        if self.position is not None and self.rotation is not None:
            error = f"{self.position / MM:.2g} mm, {self.rotation / DEG:.2g}°"
        counts = (self.suspects, self.examined, self.wrong, self.missing)
        return (name, str(self.judged), error, *(str(count) for count in counts))


@dataclass(frozen=True)
class RangeSamples(Result):
    """Comparison of equations and mechanism at many states over the joint range.

    Attributes:
        robot: name of the robot.
        samples: number of states that were drawn.
        on_lines: whether the states are drawn on lines from the rest poses to states over the whole range, because few
            states of the whole range are possible.
        possible: number of states that the mechanism can take, within its limits.
        beyond: number of possible states that are beyond the reach that the equations state; they are not judged.
        tolerance: largest errors in m and rad that count as agreement.
        stages: what was found about inverse and forward equations, and about rows of reach without a value.
        unsuspected: number of judged states without a suspicion.
        confirmed: number of these that the reference model has judged as well.
        device: what has computed the kernels, see `ComputeDevice.name`.
        mechanism: the mechanism, for names and units of joints.
    """

    robot: str
    samples: int
    on_lines: bool
    possible: int
    beyond: int
    tolerance: tuple[float, float]
    stages: tuple[JudgedStage, ...]
    unsuspected: int
    confirmed: int
    device: str
    mechanism: Mechanism = field(repr=False)

    kind = "samples"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on equations that are wrong or without a result; if there are none, on what was not decided."""
        if self.possible == self.beyond:
            return (
                _NOTHING_JUDGED("mechanism", f"none of {self.samples} states over the joint range could be judged"),
            )
        faults: list[Finding] = []
        for stage in self.stages:
            faults += self._of_stage(stage)
        # What is wrong at some states is wrong, whatever was not decided at others.
        return tuple(faults or self._undecided())

    def _undecided(self) -> list[Finding]:
        """Return findings on states that the reference model could not judge."""
        findings: list[Finding] = []
        for stage in self.stages:
            if stage.examined < stage.suspects:
                text = (
                    f"over the joint range, the compiled kernels suspect {stage.subject} at {stage.share}; the "
                    f"reference model judged {stage.examined} of these, and found nothing wrong there"
                )
                findings.append(_UNDECIDED_STATES(stage.row or stage.name, text))
        required_count = min(CONFIRMED_STATES, self.unsuspected)
        if self.confirmed < required_count:
            text = (
                f"over the joint range, the reference model could judge only {self.confirmed} of {required_count} "
                "states at which the compiled kernels suspect nothing"
            )
            way_out = "compare along protocols, by `twin validate` without --samples"
            findings.append(_UNDECIDED_STATES("mechanism", text, suggestion=way_out))
        return findings

    def _of_stage(self, stage: JudgedStage) -> list[Finding]:
        """Return findings on equations of a stage that are wrong or without a result."""
        findings = []
        judged = f"{stage.by_reference} states that the reference model judged"
        suspected = f"the compiled kernels suspect {stage.share}"
        if stage.worst is not None:
            position, rotation, q = stage.worst
            size = mm(position)
            limit = mm(self.tolerance[0])
            if position <= self.tolerance[0]:
                size = deg(rotation)
                limit = deg(self.tolerance[1])
            text = (
                f"over the joint range, {stage.subject} are wrong at {stage.wrong} of {judged}; {suspected}; the "
                "largest error of those judged"
            )
            findings.append(_DIFFERS(stage.name, text, size, limit, when=self._state(q), cause=stage.name))
        if stage.missing_at is not None:
            kind = _NO_ANSWER
            fault = "give no result"
            if stage.row:
                kind = _NO_MARGIN
                fault = "has no value"
            text = (
                f"over the joint range, {stage.subject} {fault} at {stage.missing} of {judged} and that the mechanism "
                f"can take; {suspected}"
            )
            findings.append(kind(stage.row or stage.name, text, when=self._state(stage.missing_at), cause=stage.name))
        return findings

    def _state(self, q: Array) -> str:
        """Return joint values (n,) as text, in mm and degrees."""
        parts = []
        for joint, value in zip(self.mechanism.active, q, strict=True):
            unit, scale = display_unit(joint.is_angle)
            parts.append(f"{joint.name} = {value / scale:.3f} {unit}")
        return ", ".join(parts)

    def content(self) -> JsonObject:
        """Return the comparison as plain data in SI units."""
        stages = []
        for stage in self.stages:
            stages.append(
                {
                    "equations": stage.name,
                    "row": stage.row,
                    "judged": stage.judged,
                    "position_max": stage.position,
                    "rotation_max": stage.rotation,
                    "suspects": stage.suspects,
                    "examined": stage.examined,
                    "judged_by_reference": stage.by_reference,
                    "wrong": stage.wrong,
                    "without_result": stage.missing,
                }
            )
        return {
            "robot": self.robot,
            "samples": self.samples,
            "drawn": "on lines from the rest poses" if self.on_lines else "over the whole range",
            "possible": self.possible,
            "beyond_reach": self.beyond,
            "tolerance": list(self.tolerance),
            "unsuspected": self.unsuspected,
            "confirmed_by_reference": self.confirmed,
            "device": self.device,
            "stages": stages,
        }

    def text(self) -> Iterator[Part]:
        """Yield what was drawn, a row for each stage, who has judged, the findings and the verdict."""
        yield f"{self.robot} · equations and mechanism at {self.samples} states over the joint range · {self.device}"
        if self.on_lines:
            yield "  few states of the whole range are possible: drawn on lines from the rest poses to such states"
        yield f"  {self.possible} states are possible ({_percent(self.possible, self.samples)})"
        if self.beyond:
            yield f"  {self.beyond} of them are beyond the reach that the equations state, and are not judged"
        yield ""
        largest = "largest error of the unsuspected"
        header = ("equations", "judged", largest, "suspected", "examined", "wrong", "none")
        yield TextTable(header, [stage.cells() for stage in self.stages])
        yield "  suspected: by the compiled kernels; examined: suspected states that the reference model judged;"
        yield "  wrong, none: states with a wrong result, or without one, by the reference model"
        yield f"  the reference model also judged {self.confirmed} of {self.unsuspected} states without a suspicion"
        yield ""
        yield from by_severity(self.findings)
        verdicts = {
            "agree": f"AGREE: equations and mechanism agree over the joint range, {self.possible - self.beyond} states",
            "disagree": "DISAGREE: the equations are wrong, or have no result, in a part of the joint range",
            "unchecked": "UNCHECKED: not all that was drawn could be judged",
        }
        yield f"  {verdicts[self.verdict]} (exit code {self.exit_code})"
        yield ""


def _percent(count: int, total: int) -> str:
    return f"{100 * count / max(total, 1):.3g} %"
