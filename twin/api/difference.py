"""Compare two results that were written as JSON: their verdicts, findings and residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from twin.core.errors import TwinError
from twin.core.findings import Finding, Verdict, disagreement
from twin.core.foreign.text import load_json
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Line, Part, Result, TextTable

_FACTOR = 1.5
"""Ratio of two residuals above which they count as different: smaller changes are rounding or another machine."""

_ROWS = 20
"""Largest number of changed residuals that are shown."""

_COLORS = {"agree": "bold green", "disagree": "bold red", "unchecked": "bold yellow"}


@dataclass(frozen=True)
class ChangedResidual:
    """A row of two residual matrices whose deviation differs.

    Attributes:
        name: pair, quantity and name of the row.
        before, after: largest deviation in `unit`; None if the row is missing, or the value is not finite.
        unit: unit of the deviation.
    """

    name: str
    before: float | None
    after: float | None
    unit: str


@dataclass(frozen=True)
class ResultDifference(Result):
    """What differs between two results of one kind.

    Attributes:
        files: paths of the two results, first the older.
        verdicts: their verdicts.
        appeared, gone: findings that only the second result has, or only the first.
        residuals: rows of the residual matrix that differ by more than a factor `_FACTOR`, largest ratio first.
    """

    files: tuple[str, str]
    verdicts: tuple[Verdict, Verdict]
    appeared: tuple[JsonMapping, ...]
    gone: tuple[JsonMapping, ...]
    residuals: tuple[ChangedResidual, ...]

    kind = "diff"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One finding if the verdicts differ, and one for each finding that appeared."""
        found = []
        before, after = self.verdicts
        if before != after:
            found.append(disagreement("diff.verdict", self.files[1], f"the verdict was {before} and is {after}"))
        for finding in self.appeared:
            where = str(finding.get("where", ""))
            found.append(disagreement("diff.finding", where, f"new finding: {finding.get('message', '')}"))
        return tuple(found)

    def content(self) -> JsonMapping:
        """Return files, verdicts and differences as plain data."""
        rows: list[JsonObject] = [dict(vars(row)) for row in self.residuals]
        return {
            "files": list(self.files),
            "verdicts": list(self.verdicts),
            "appeared": [dict(finding) for finding in self.appeared],
            "gone": [dict(finding) for finding in self.gone],
            "residuals": rows,
        }

    def text(self) -> Iterator[Part]:
        """Yield both verdicts, then the findings and residuals that differ."""
        for file, verdict in zip(self.files, self.verdicts, strict=True):
            yield Line(f"  {verdict.upper()}: {file}", _COLORS[verdict])
        yield ""
        for title, findings in (("only in the second", self.appeared), ("only in the first", self.gone)):
            if findings:
                yield f"  findings {title}"
            for finding in findings:
                yield f"    {finding.get('severity', '')}: {finding.get('message', '')}"
        if self.residuals:
            rows = []
            for row in self.residuals[:_ROWS]:
                rows.append((row.name, _shown(row.before, row.unit), _shown(row.after, row.unit)))
            yield TextTable(("residual", "first", "second"), rows)
            if len(self.residuals) > _ROWS:
                yield f"  and {len(self.residuals) - _ROWS} more residuals"
        if not (self.appeared or self.gone or self.residuals):
            yield "  no finding and no residual differs"


def _shown(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:.3g} {unit}".rstrip()


def diff(first: str | Path, second: str | Path) -> ResultDifference:
    """Compare two results that `--json` printed or a report's folder contains: verdicts, findings, residuals.

    Args:
        first: path of the older JSON, or of the folder of a report.
        second: path of the newer JSON or folder.

    Raises:
        TwinError: a file is not a result of twin, or the two are of different kinds.

    Example:
        >>> from pathlib import Path
        >>> import twin
        >>> for variant in ("corrected", "printed"):
        ...     _ = Path(f"{variant}.json").write_text(twin.explain("sils", variant).to_json())
        >>> twin.diff("corrected.json", "printed.json").verdicts
        ('agree', 'disagree')
    """
    a = _read(Path(first))
    b = _read(Path(second))
    if a["schema"] != b["schema"]:
        raise TwinError(f"{first} is a result {a['schema']}, and {second} is one {b['schema']}: give two of one kind")
    before = {_key(finding): finding for finding in a["findings"]}
    after = {_key(finding): finding for finding in b["findings"]}
    appeared = tuple(finding for key, finding in after.items() if key not in before)
    gone = tuple(finding for key, finding in before.items() if key not in after)
    residuals = _changed(a.get("residuals"), b.get("residuals"))
    return ResultDifference((str(first), str(second)), (a["verdict"], b["verdict"]), appeared, gone, residuals)


def _read(path: Path) -> dict[str, Any]:
    """Return the data of one result.

    Raises:
        TwinError: the file does not exist, or is not a result of twin.
    """
    if path.is_dir():
        found = sorted(path.glob("*.json"))
        if len(found) != 1:
            names = ", ".join(file.name for file in found) or "none"
            raise TwinError(f"{path}: the folder has not one JSON file, but {names}: give the path of a file")
        path = found[0]
    if not path.is_file():
        raise TwinError(f"{path}: the file does not exist; a report's folder contains report.json")
    try:
        data = load_json(path)
    except ValueError as error:
        raise TwinError(f"{path}: the file is not JSON: {error}") from error
    is_result = isinstance(data, dict) and str(data.get("schema", "")).startswith("twin/")
    if not is_result or data.get("verdict") not in get_args(Verdict) or not _are_objects(data.get("findings")):
        raise TwinError(f"{path}: the file is not a result of twin, with schema, verdict and findings")
    return data


def _are_objects(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _key(finding: JsonMapping) -> tuple[str, ...]:
    """Return what identifies a finding; its numbers may differ."""
    return tuple(str(finding.get(name, "")) for name in ("code", "severity", "where", "when"))


def _changed(before: object, after: object) -> tuple[ChangedResidual, ...]:
    """Return the rows of two residual matrices that differ, those that are missing on one side first."""
    first = _rows(before)
    second = _rows(after)
    changed: list[tuple[float, ChangedResidual]] = []
    for name in dict.fromkeys((*first, *second)):
        a, unit = first.get(name, (None, ""))
        b, other_unit = second.get(name, (None, ""))
        if a is None and b is None:
            continue
        ratio = float("inf")
        if a is not None and b is not None:
            smaller, larger = sorted((a, b))
            if larger == 0:
                continue
            if smaller > 0:
                ratio = larger / smaller
        if ratio > _FACTOR:
            changed.append((ratio, ChangedResidual(name, a, b, unit or other_unit)))
    changed.sort(key=lambda pair: -pair[0])
    return tuple(row for _, row in changed)


def _rows(residuals: object) -> dict[str, tuple[float | None, str]]:
    """Return {name of a row: (largest deviation or None, unit)} of the residuals of a report that are judged."""
    rows: dict[str, tuple[float | None, str]] = {}
    if not isinstance(residuals, Sequence) or not _are_objects(residuals):
        return rows
    for row in residuals:
        tolerance = row.get("tolerance")
        worst = row.get("worst")
        if not isinstance(tolerance, int | float) or isinstance(worst, bool):
            continue
        value = float(worst) if isinstance(worst, int | float) else None
        # rounding far below the tolerance is the same: two runs differ in it
        if value is not None and value < 0.01 * tolerance:
            value = 0.0
        name = f"{row.get('pair', '')} {row.get('quantity', '')} {row.get('name', '')} [{row.get('unit', '')}]"
        rows[name] = (value, str(row.get("unit", "")))
    return rows
