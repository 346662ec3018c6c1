"""Schema of the JSON that each command prints with --json."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from twin.core.findings import Severity, Verdict
from twin.schema.tables import Table

Kind = Literal[
    "twin/audit/1",
    "twin/build/1",
    "twin/check/1",
    "twin/compare/1",
    "twin/completion/1",
    "twin/console/1",
    "twin/diff/1",
    "twin/doctor/1",
    "twin/error/1",
    "twin/explain/1",
    "twin/export/1",
    "twin/hazards/1",
    "twin/inertia/1",
    "twin/info/1",
    "twin/list/1",
    "twin/machine/1",
    "twin/motion/1",
    "twin/new/1",
    "twin/open/1",
    "twin/operate/1",
    "twin/plan-together/1",
    "twin/plan/1",
    "twin/procedure/1",
    "twin/prove/1",
    "twin/prove-bounds/1",
    "twin/prove-workspace/1",
    "twin/report/1",
    "twin/reports/1",
    "twin/samples/1",
    "twin/scene-export/1",
    "twin/scene/1",
    "twin/selftest/1",
    "twin/session/1",
    "twin/stroke/1",
    "twin/study/1",
    "twin/sweep/1",
    "twin/tolerance/1",
    "twin/track/1",
    "twin/trends/1",
    "twin/workspace/1",
]
"""Schema names of results, by command or variant. Every command may print an error instead of its result."""


class FindingTable(Table):
    """One finding of a check, with the fields of `twin.core.findings.Finding`."""

    code: Annotated[str, Field(description="dotted, constant identifier for scripts")]
    severity: Annotated[Severity, Field(description="disagreement: two values differ; error: could not be checked")]
    message: Annotated[str, Field(description="one sentence with the subject, the value and the limit")]
    where: Annotated[str, Field(description="name of the point, joint, loop, prim or file")]
    when: Annotated[str, Field(description="pose, phase or time")]
    size: Annotated[float | None, Field(description="the measured value, in unit")]
    unit: Annotated[str, Field(description="unit of size and limit")]
    limit: Annotated[float | None, Field(description="limit of size")]
    suggestion: Annotated[str, Field(description="how to fix the fault")]
    cause: Annotated[str, Field(description="the same text in all findings with this cause")]


class ResultTable(BaseModel):
    """Keys that the JSON results of all commands have in common; each kind of result has further keys."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False)

    schema_: Annotated[Kind, Field(alias="schema")]
    verdict: Annotated[Verdict, Field(description="unchecked: could not be checked; tolerance: nothing is required")]
    findings: Annotated[list[FindingTable], Field(description="the most severe first")]
