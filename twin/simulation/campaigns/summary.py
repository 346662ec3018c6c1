"""Results of a campaign by class of faults: outcome, detection, and the trainee's responses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from twin.core.findings import Finding, disagreement, warning
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result, TextTable
from twin.simulation.campaigns.attacked_session import HARM
from twin.simulation.campaigns.campaign_table import FREE, CampaignTable, Scenario
from twin.simulation.campaigns.roc import Roc, curves, dangerous, in_time
from twin.simulation.controllers.cue import Cue
from twin.simulation.machine.machine_faults import LOCATIONS

Row = JsonMapping
"""Line of the log: the attributes of a `DrawnSession` and of its `Outcome`; as "response" a `Response`, or None."""


@dataclass(frozen=True)
class ClassRow:
    """Results of one class of faults; numbers count sessions, except the peaks in mm and the delay in ms.

    Attributes:
        kind, scenario, location: name of the class, its scenario in the paper's table ("": none), and location of its
            faults in the machine.
        sessions: completed sessions.
        harmed: the tip deviated more than `HARM`, before or after a stop.
        beyond: the tip deviated more than 3 mm.
        felt: there was a force (cue) on the operator's hand.
        stopped: a check stopped the arm.
        peak_p50, peak_max: median and largest peak deviation in mm.
        delay: 95th percentile of the time in ms from a deviation of 3 mm to the cue; None: no session has both.
        jumped: the tip was more than `HARM` from every point of the model's path.
        unseen_checks: the tip jumped, and a check of the software stopped the arm later or never.
        unseen_fixed, unseen_adaptive: the tip jumped, and the measured distance exceeded the fixed limit, or the
            adaptive limit, later or never.
        danger: dangerous sessions, see `roc.dangerous`.
        in_time: dangerous sessions in which a check stopped the arm before harm.
        seen_adaptive: dangerous sessions in which the adaptive limit was exceeded before harm or stop.
        early: sessions in which the deviation exceeded first the adaptive limit, and later 3 mm.
    """

    kind: str
    scenario: str
    location: str
    sessions: int
    harmed: int
    beyond: int
    felt: int
    stopped: int
    peak_p50: float
    peak_max: float
    delay: float | None
    jumped: int
    unseen_checks: int
    unseen_fixed: int
    unseen_adaptive: int
    danger: int
    in_time: int
    seen_adaptive: int
    early: int


@dataclass(frozen=True)
class ResponseRow:
    """Results of the trainee in those sessions of one class that had a force or a stop to notice.

    Attributes:
        kind: class.
        sessions: number of sessions.
        noticed, acted: median times in ms from the start of the fault to the first force or stop, and to the first
            response.
        peak, peak_alone: median peak deviation in mm with the responses, and without a response.
        harmed: number of sessions in which the deviation exceeded `HARM` despite the responses, before the arm was
            braked.
        trained: mean fraction of the scenario's responses that the trainee performed; None: the class has no scenario.
        works: number of sessions in which the arm followed the hand at the end.
        converted: number of sessions in which the trainee converted the procedure (continued without the robot).
    """

    kind: str
    sessions: int
    noticed: float
    acted: float
    peak: float
    peak_alone: float
    harmed: int
    trained: float | None
    works: int
    converted: int


@dataclass(frozen=True)
class Hazards(Result):
    """Outcomes of the sessions of a campaign.

    Attributes:
        robot: name of the robot.
        table: the campaign file.
        expected: number of sessions of the campaign.
        rows: result of each completed session, as in the log, in the order of the index.
        assumed: a line for each ASSUMED number of machine, trainee or detection, with its reason.
    """

    kind = "hazards"
    robot: str
    table: CampaignTable
    expected: int
    rows: Sequence[Row]
    assumed: Sequence[str]

    @cached_property
    def by_class(self) -> dict[str, list[Row]]:
        """The rows of each class that has sessions; the keys are the names of the classes."""
        rows: dict[str, list[Row]] = {}
        for row in self.rows:
            rows.setdefault(row["kind"], []).append(row)
        # in the order of the campaign file, whatever was drawn first
        by_class = {}
        for fault in self.table.class_:
            if fault.name in rows:
                by_class[fault.name] = rows[fault.name]
        if FREE in rows:
            by_class[FREE] = rows[FREE]
        return by_class

    @cached_property
    def classes(self) -> list[ClassRow]:
        """One row for each class that has sessions."""
        class_by_name = {fault.name: fault for fault in self.table.class_}
        results = []
        for name, rows in self.by_class.items():
            if name in class_by_name:
                fault = class_by_name[name]
                results.append(_class_row(name, fault.scenario, LOCATIONS[fault.signal], rows))
            else:
                results.append(_class_row(name, "", "", rows))
        return results

    @cached_property
    def responses(self) -> list[ResponseRow]:
        """One row for each class with sessions that had a force or a stop to notice."""
        scenarios = {scenario.name: scenario for scenario in self.table.scenario}
        scenario_of = {}
        for fault in self.table.class_:
            scenario_of[fault.name] = scenarios.get(fault.scenario)
        results = []
        for name, rows in self.by_class.items():
            noticed = []
            for row in rows:
                if row["response"] is not None:
                    noticed.append(row)
            if noticed:
                results.append(_response_row(name, noticed, scenario_of.get(name)))
        return results

    @cached_property
    def roc(self) -> list[Roc]:
        """The ROC curves of the fixed and of the adaptive limit."""
        return curves(self.rows, Cue().tol)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on cues without a fault, and on missing sessions."""
        findings = []
        false_cues = []
        for row in self.rows:
            if row["kind"] == FREE and row["cue"] is not None:
                false_cues.append(row["index"])
        if false_cues:
            text = f"a cue without a fault in sessions {false_cues[:5]}"
            findings.append(disagreement("hazards.false", self.robot, text))
        if len(self.rows) < self.expected:
            progress = f"{len(self.rows)} of {self.expected} sessions are done"
            resume = "run the same command again to resume"
            findings.append(warning("hazards.unfinished", self.robot, progress, suggestion=resume))
        return tuple(findings)

    @property
    def word(self) -> str:
        """The verdict as text; empty if no session without a fault has run."""
        if self.verdict == "disagree":
            return "False cues"
        return "No cue without a fault" if FREE in self.by_class else ""

    def content(self) -> JsonObject:
        """Return plain data."""
        detectors = []
        for curve in self.roc:
            detected, false = curve.at(curve.limit)
            detectors.append(
                {
                    "name": curve.name,
                    "unit": curve.unit,
                    "limit": curve.limit,
                    "area": curve.area,
                    "detected": detected,
                    "false": false,
                }
            )
        return {
            "robot": self.robot,
            "campaign": self.table.title,
            "sessions": len(self.rows),
            "expected": self.expected,
            "scenarios": [scenario.model_dump() for scenario in self.table.scenario],
            "classes": list(map(asdict, self.classes)),
            "responses": list(map(asdict, self.responses)),
            "detectors": detectors,
            "assumed": list(self.assumed),
        }

    def text(self) -> Iterator[Part]:
        """Yield the parts of the printed result."""
        yield f"{self.robot} · {self.table.title} · {len(self.rows)} of {self.expected} sessions"
        yield "\nScenarios"
        scenarios = []
        for scenario in self.table.scenario:
            incidents = ", ".join(scenario.incidents)
            responses = ", ".join(scenario.responses)
            scenarios.append((scenario.name, incidents, scenario.impact, responses))
        yield TextTable(("scenario", "incidents", "impact", "responses"), scenarios)
        outcomes = []
        detections = []
        for row in self.classes:
            outcomes.append(_outcome_cells(row))
            if row.danger or row.jumped:  # in the other classes, there was nothing to detect
                detections.append(_detection_cells(row))
        yield "\nOutcome without a response (sessions)"
        head = ("class", "location", "sessions", f"> {HARM:g} mm", "> 3 mm", "felt", "stopped")
        yield TextTable((*head, "peak p50 mm", "max mm", "cue ms p95"), outcomes)
        yield "\nDetection (sessions)"
        head = ("class", "dangerous", "checks in time", "adaptive in time", "adaptive before 3 mm", "jumps > 1 mm")
        unseen = ("before checks", "before 3 mm limit", "before adaptive")
        yield TextTable((*head, *unseen), detections)
        yield from self._detectors()
        if self.responses:
            yield "\nResponses of the scripted trainee (medians)"
            head = ("class", "sessions", "noticed ms", "acted ms", "peak mm", "without", f"> {HARM:g} mm")
            yield TextTable(
                (*head, "performed", "works again", "converted"), list(map(_response_cells, self.responses))
            )
        yield ""
        yield from self.assumed
        yield self.word or "No session without a fault has run: false cues cannot be counted"
        yield from self.findings

    def _detectors(self) -> Iterator[Part]:
        """Yield a line for each ROC curve, and one for the checks of the software."""
        for curve in self.roc:
            detected, false = curve.at(curve.limit)
            yield (
                f"  {curve.name}, {curve.used}: {100 * detected:.1f} % of dangerous sessions detected in time, "
                f"{100 * false:.2f} % false alarms, area below the curve {curve.area:.3f}"
            )
        stopped_in_time = []
        for row in self.rows:
            if dangerous(row):
                stopped_in_time.append(in_time(row))
        if not stopped_in_time:
            return
        share = float(np.mean(stopped_in_time))
        free = self.by_class.get(FREE, [])
        free_text = ""
        if free:
            wrong = _count(free, "stop")
            free_text = f", {wrong} of {len(free)} sessions without a fault stopped"
        yield f"  checks of the software: {100 * share:.1f} % of dangerous sessions stopped in time{free_text}"


def _count(rows: Sequence[Row], event: str) -> int:
    """Return the number of sessions in which an event happened: its time is not None."""
    count = 0
    for row in rows:
        count += row[event] is not None
    return count


def _first(row: Row, event: str, later_event: str) -> bool:
    """Return whether an event happened, and another event happened later or never."""
    if row[event] is None:
        return False
    # two events in the same tick are no lead
    return row[later_event] is None or row[later_event] > row[event]


def _class_row(kind: str, scenario: str, location: str, rows: Sequence[Row]) -> ClassRow:
    """Return the results of the sessions of one class; see the attributes of `ClassRow`."""
    peaks = np.array([row["peak"] for row in rows])
    delays = []
    undetected_jumps = dict.fromkeys(("stop", "cue", "adaptive"), 0)
    danger = 0
    stopped_in_time = 0
    seen_adaptive = 0
    early = 0
    for row in rows:
        if row["cue"] is not None and row["beyond"] is not None:
            delays.append(row["cue"] - row["beyond"])
        for event in undetected_jumps:  # a jump counts for each way of detection that comes later or never
            undetected_jumps[event] += _first(row, "jump", event)
        if dangerous(row):
            danger += 1
            stopped_in_time += in_time(row)
            seen_adaptive += row["seen_ratio"] > 1
        # the adaptive limits are compared with the fixed one only where both were passed
        if row["beyond"] is not None and row["adaptive"] is not None:
            early += row["adaptive"] < row["beyond"]
    return ClassRow(
        kind=kind,
        scenario=scenario,
        location=location,
        sessions=len(rows),
        harmed=_count(rows, "harm"),
        beyond=_count(rows, "beyond"),
        felt=_count(rows, "cue"),
        stopped=_count(rows, "stop"),
        peak_p50=float(np.median(peaks)),
        peak_max=float(peaks.max()),
        delay=float(np.percentile(delays, 95)) if delays else None,
        jumped=_count(rows, "jump"),
        unseen_checks=undetected_jumps["stop"],
        unseen_fixed=undetected_jumps["cue"],
        unseen_adaptive=undetected_jumps["adaptive"],
        danger=danger,
        in_time=stopped_in_time,
        seen_adaptive=seen_adaptive,
        early=early,
    )


def _response_row(kind: str, rows: Sequence[Row], scenario: Scenario | None) -> ResponseRow:
    """Return the trainee's results in the sessions of one class that have a response; `scenario`: that of the class."""
    peaks_alone = []
    numbers: dict[str, list[float]] = {"noticed": [], "acted": [], "response_peak": []}
    harmed = 0
    works = 0
    converted = 0
    performed_shares = []
    for row in rows:
        response = row["response"]
        performed = response["responses"]
        peaks_alone.append(row["peak"])
        for key, values in numbers.items():
            values.append(response[key])
        harmed += response["response_harm"]
        works += response["works"]
        converted += "convert" in performed
        if scenario is not None:
            performed_shares.append(np.mean([name in performed for name in scenario.responses]))
    return ResponseRow(
        kind=kind,
        sessions=len(rows),
        noticed=float(np.median(numbers["noticed"])),
        acted=float(np.median(numbers["acted"])),
        peak=float(np.median(numbers["response_peak"])),
        peak_alone=float(np.median(peaks_alone)),
        harmed=harmed,
        trained=float(np.mean(performed_shares)) if performed_shares else None,
        works=works,
        converted=converted,
    )


def _outcome_cells(row: ClassRow) -> tuple[str, ...]:
    """Return the cells of a row of the table "Outcome without a response"; `Hazards.text` has the heads."""
    delay = "-" if row.delay is None else f"{row.delay:.0f}"
    return (
        row.kind,
        row.location,
        str(row.sessions),
        str(row.harmed),
        str(row.beyond),
        str(row.felt),
        str(row.stopped),
        f"{row.peak_p50:.2f}",
        f"{row.peak_max:.2f}",
        delay,
    )


def _detection_cells(row: ClassRow) -> tuple[str, ...]:
    """Return the cells of a row of the table "Detection"; `Hazards.text` has the heads."""
    return (
        row.kind,
        str(row.danger),
        str(row.in_time),
        str(row.seen_adaptive),
        f"{row.early} of {row.beyond}",
        str(row.jumped),
        str(row.unseen_checks),
        str(row.unseen_fixed),
        str(row.unseen_adaptive),
    )


def _response_cells(row: ResponseRow) -> tuple[str, ...]:
    """Return the cells of a row of the table "Responses of the scripted trainee"; `Hazards.text` has the heads."""
    trained = "-" if row.trained is None else f"{100 * row.trained:.0f} %"
    return (
        row.kind,
        str(row.sessions),
        f"{row.noticed:.0f}",
        f"{row.acted:.0f}",
        f"{row.peak:.2f}",
        f"{row.peak_alone:.2f}",
        str(row.harmed),
        trained,
        str(row.works),
        str(row.converted),
    )
