"""Compare two results that were written as JSON: their verdicts, findings and residuals."""

from __future__ import annotations

import contextlib
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, get_args

from twin.core.errors import TwinError
from twin.core.findings import Finding, Verdict, disagreement, warning
from twin.core.foreign.text import load_json
from twin.core.format import EXACT
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Line, Part, Result, TextTable

_CHANGED_RATIO = 1.5
"""Ratio of two residuals above which they count as different: smaller changes are rounding or another machine."""

_ROUNDING_SHARE = 0.01
"""Fraction of its tolerance up to which deviations count as equal: they are rounding, in which two runs differ."""

_SHOWN_RESIDUALS = 20
"""Largest number of changed residuals that are shown."""

_COLORS = {"agree": "bold green", "disagree": "bold red", "unchecked": "bold yellow"}


@dataclass(frozen=True)
class ChangedResidual:
    """A row of two residual matrices whose deviation differs.

    Attributes:
        name: pair, quantity and name of the row.
        before, after: largest deviation in `unit`; None if the row is missing, NaN if the value is not finite.
        unit: unit of the deviation.
    """

    name: str
    before: float | None
    after: float | None
    unit: str

    @property
    def became_infinite(self) -> bool:
        """Whether the deviation was a number and is no longer finite."""
        if self.before is None or self.after is None:
            return False
        return not math.isnan(self.before) and math.isnan(self.after)


@dataclass(frozen=True)
class ResultDifference(Result):
    """What differs between two results of one kind.

    Attributes:
        files: paths of the two results, first the older.
        verdicts: their verdicts.
        appeared, gone: findings that only the second result has, or only the first.
        residuals: rows of the residual matrix that differ by more than a factor `_CHANGED_RATIO`, largest ratio first.
        protocols: names of the protocols of both results; "" if a result has none.

    JSON writes a deviation that is missing and one that is not finite as null; `in_first` and `in_second` say which.
    """

    files: tuple[str, str]
    verdicts: tuple[Verdict, Verdict]
    appeared: tuple[JsonMapping, ...]
    gone: tuple[JsonMapping, ...]
    residuals: tuple[ChangedResidual, ...]
    protocols: tuple[str, str] = ("", "")

    kind = "diff"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One finding for different verdicts, for each new finding, and for each residual that is no longer finite.

        A warning says that the results are of two protocols.
        """
        findings = []
        before, after = self.verdicts
        if before != after:
            findings.append(disagreement("diff.verdict", self.files[1], f"the verdict was {before} and is {after}"))
        for finding in self.appeared:
            where = str(finding.get("where", ""))
            findings.append(disagreement("diff.finding", where, f"new finding: {finding.get('message', '')}"))
        for row in self.residuals:
            if row.became_infinite:
                before_text = _value_text(row.before, row.unit)
                text = f"{row.name}: it was {before_text} and is not finite"
                findings.append(disagreement("diff.residual", row.name, text))
        if self.protocols[0] != self.protocols[1]:
            first, second = self.protocols
            text = f"the first result is of protocol '{first}', the second of '{second}'"
            findings.append(warning("diff.protocol", self.files[1], text))
        return tuple(findings)

    def content(self) -> JsonMapping:
        """Return files, verdicts and differences as plain data."""
        rows: list[JsonObject] = []
        for row in self.residuals:
            rows.append({**vars(row), "in_first": row.before is not None, "in_second": row.after is not None})
        return {
            "files": list(self.files),
            "verdicts": list(self.verdicts),
            "protocols": list(self.protocols),
            "appeared": list(map(dict, self.appeared)),
            "gone": list(map(dict, self.gone)),
            "residuals": rows,
        }

    def text(self) -> Iterator[Part]:
        """Yield both verdicts, then the findings and residuals that differ."""
        for file, verdict in zip(self.files, self.verdicts, strict=True):
            yield Line(f"  {verdict.upper()}: {file}", _COLORS[verdict])
        yield ""
        for finding in self.findings:
            if finding.code == "diff.protocol":
                yield finding
        for title, findings in (("only in the second", self.appeared), ("only in the first", self.gone)):
            if findings:
                yield f"  findings {title}"
            for finding in findings:
                yield f"    {finding.get('severity', '')}: {finding.get('message', '')}"
        if self.residuals:
            rows = []
            for row in self.residuals[:_SHOWN_RESIDUALS]:
                rows.append((row.name, _value_text(row.before, row.unit), _value_text(row.after, row.unit)))
            yield TextTable(("residual", "first", "second"), rows)
            if len(self.residuals) > _SHOWN_RESIDUALS:
                yield f"  and {len(self.residuals) - _SHOWN_RESIDUALS} more residuals"
        if not (self.appeared or self.gone or self.residuals):
            yield "  no finding and no residual differs"


def _value_text(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    if math.isnan(value):
        return "not finite"
    return f"{value:.3g} {unit}".rstrip()


def diff(first: str | Path, second: str | Path) -> ResultDifference:
    """Compare two results that `--json` printed or a report's folder contains: verdicts, findings, residuals.

    Args:
        first: path of the older JSON, or of the folder of a report.
        second: path of the newer JSON or folder.

    Raises:
        TwinError: a file is not a result of twin, or the two are of different kinds, robots or scenes.

    Examples:
        >>> from pathlib import Path
        >>> import twin
        >>> for variant in ("corrected", "printed"):
        ...     _ = Path(f"{variant}.json").write_text(twin.explain("sils", variant).to_json())
        >>> twin.diff("corrected.json", "printed.json").verdicts
        ('agree', 'disagree')
    """
    older = _read(Path(first))
    newer = _read(Path(second))
    if older["schema"] != newer["schema"]:
        raise TwinError(
            f"{first} is a result {older['schema']}, and {second} is one {newer['schema']}: give two of one kind"
        )
    for subject in ("robot", "scene"):
        first_name = _name(older, subject)
        second_name = _name(newer, subject)
        if first_name and second_name and first_name != second_name:
            raise TwinError(
                f"{first} is of the {subject} '{first_name}', and {second} of '{second_name}': "
                f"give two of one {subject}"
            )
    gone, appeared = _unmatched(older["findings"], newer["findings"])
    residuals = _changed(older.get("residuals"), newer.get("residuals"))
    protocols = (_name(older, "protocol"), _name(newer, "protocol"))
    verdicts = (older["verdict"], newer["verdict"])
    return ResultDifference((str(first), str(second)), verdicts, appeared, gone, residuals, protocols)


def _name(data: JsonMapping, key: str) -> str:
    """Return the name that a result has under a key; "" if there is none."""
    value = data.get(key)
    return value if isinstance(value, str) else ""


def _read(path: Path) -> JsonObject:
    """Return the data of one result, of which `path` is the file or the folder.

    Raises:
        TwinError: the file does not exist or cannot be read, or is not a result of twin.
    """
    try:
        if path.is_dir():
            return _of_folder(path)
        if not path.is_file():
            raise TwinError(f"{path}: the file does not exist; a report's folder contains report.json")
        data = load_json(path)
    except OSError as error:
        raise TwinError(f"{path}: cannot be read: {error.strerror or error}") from error
    except RecursionError as error:
        raise TwinError(f"{path}: the file is not a result of twin: its lists are nested too deeply") from error
    except ValueError as error:
        raise TwinError(f"{path}: the file is not JSON: {error}") from error
    is_result = isinstance(data, dict) and str(data.get("schema", "")).startswith("twin/")
    if not is_result or data.get("verdict") not in get_args(Verdict) or not _are_findings(data.get("findings")):
        raise TwinError(f"{path}: the file is not a result of twin, with schema, verdict and findings")
    return data


def _of_folder(folder: Path) -> JsonObject:
    """Return the data of the result in a folder; other files, such as a certificate, may be beside it.

    Raises:
        TwinError: there is no result, or more than one.
    """
    files = sorted(folder.glob("*.json"))
    if len(files) == 1:
        return _read(files[0])
    all_results: list[JsonObject] = []
    named_results: list[JsonObject] = []
    for file in files:
        with contextlib.suppress(TwinError):  # not a result
            data = _read(file)
            all_results.append(data)
            # a command writes its result into the file <kind>.json, with the schema twin/<kind>/1
            if str(data["schema"]).startswith(f"twin/{file.stem}/"):
                named_results.append(data)
    results = named_results or all_results
    if len(results) == 1:
        return results[0]
    names = ", ".join(file.name for file in files) or "no JSON file"
    raise TwinError(f"{folder}: {len(results)} results are in the folder ({names}): give the path of a file")


def _are_objects(value: object) -> bool:
    if not isinstance(value, list):
        return False
    return all(isinstance(item, dict) for item in value)


def _are_findings(value: object) -> bool:
    """Return whether a value is a list of objects without lists and objects in them, as `Finding.as_dict` makes."""
    if not isinstance(value, list) or not _are_objects(value):
        return False
    for finding in value:
        for item in finding.values():
            if isinstance(item, list | dict):
                return False
    return True


_Identity = Callable[[JsonMapping], tuple[str, ...]]


def _unmatched(
    first: Sequence[JsonMapping], second: Sequence[JsonMapping]
) -> tuple[tuple[JsonMapping, ...], tuple[JsonMapping, ...]]:
    """Return the findings that only the first list has, and those that only the second has.

    Each finding has at most one partner, so that a finding that occurs twice instead of once is found. Findings with
    the same words are partners first, then those that differ only in numbers and in the prefixes of their units.
    """
    for identity in (_words, _words_without_numbers):
        rest_of_first = _rest(first, second, identity)
        second = _rest(second, first, identity)
        first = rest_of_first
    return tuple(first), tuple(second)


def _rest(findings: Sequence[JsonMapping], others: Sequence[JsonMapping], identity: _Identity) -> list[JsonMapping]:
    """Return the findings without a partner in `others`."""
    partners = Counter(map(identity, others))
    unmatched: list[JsonMapping] = []
    for finding in findings:
        key = identity(finding)
        if partners[key] > 0:
            partners[key] -= 1
        else:
            unmatched.append(finding)
    return unmatched


_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
"""A number that stands alone: t = 1.23 s has one, the names s1 and bar1:r12-s1 have none."""


_POWER = "[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+"
"""An exponent as twin writes it in messages: `twin.core.format.power` makes superscripts."""

_VALUE = re.compile(
    rf"(?:< )?(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?:×10{_POWER}|{_POWER})?"
    r"(?:[ \u202f]?(?:[pnµ]m|mm|m|°|deg)(?!\w))?"
    rf"|\b{EXACT}\b"
)
"""A value in a message, with its unit if that is a length or an angle: its prefix depends on the size."""


def _words(finding: JsonMapping) -> tuple[str, ...]:
    """Return (code, severity, where, when, message) of a finding; "" for what it does not have."""
    return tuple(str(finding.get(name, "")) for name in ("code", "severity", "where", "when", "message"))


def _words_without_numbers(finding: JsonMapping) -> tuple[str, ...]:
    """Return what identifies a finding whose place, time and size may change a little."""
    code, severity, where, when, message = _words(finding)
    return code, severity, _NUMBER.sub("#", where), _NUMBER.sub("#", when), _VALUE.sub("#", message)


def _changed(before_value: object, after_value: object) -> tuple[ChangedResidual, ...]:
    """Return the rows of two residual matrices that differ, those that are missing on one side first."""
    first = _rows(before_value)
    second = _rows(after_value)
    changed: list[tuple[float, ChangedResidual]] = []
    for name in dict.fromkeys((*first, *second)):
        before_row = first.get(name)
        after_row = second.get(name)
        ratio = _ratio(before_row, after_row)
        if ratio <= _CHANGED_RATIO:
            continue
        unit = ""
        before_value = None
        if before_row is not None:
            unit = before_row.unit
            before_value = before_row.value
        after_value = None
        if after_row is not None:
            unit = after_row.unit  # rows are paired by names that contain the unit
            after_value = after_row.value
        changed.append((ratio, ChangedResidual(name, before_value, after_value, unit)))
    changed.sort(key=lambda pair: -pair[0])
    return tuple(row for _, row in changed)


class _JudgedDeviation(NamedTuple):
    """The largest deviation of a row, NaN if it is not finite; below `rounding` it counts as `rounding`."""

    value: float
    rounding: float
    unit: str


def _ratio(before: _JudgedDeviation | None, after: _JudgedDeviation | None) -> float:
    """Return the larger of two deviations divided by the smaller; infinity if only one is there, or only one finite."""
    if before is None or after is None:
        return math.inf
    if math.isnan(before.value) and math.isnan(after.value):
        return 1.0
    if math.isnan(before.value) or math.isnan(after.value):
        return math.inf
    # of two tolerances the smaller one, so that a change which matters to it is shown
    rounding = min(before.rounding, after.rounding)
    smaller, larger = sorted((max(before.value, rounding), max(after.value, rounding)))
    if larger == smaller:
        return 1.0
    if smaller <= 0:
        return math.inf
    return larger / smaller


def _rows(residuals: object) -> dict[str, _JudgedDeviation]:
    """Return {name of a row: deviation} of the residuals of a report that are judged.

    Of rows with the same name the largest deviation is returned.
    """
    rows: dict[str, _JudgedDeviation] = {}
    if not isinstance(residuals, Sequence) or not _are_objects(residuals):
        return rows
    for row in residuals:
        if row.get("tolerance") is None:  # measured, but not judged
            continue
        tolerance = _number(row["tolerance"])
        rounding = 0.0  # a tolerance that is not a number excuses nothing
        if not math.isnan(tolerance):
            rounding = _ROUNDING_SHARE * tolerance
        value = _number(row.get("worst"))
        name = f"{row.get('pair', '')} {row.get('quantity', '')} {row.get('name', '')} [{row.get('unit', '')}]"
        if name not in rows or _is_worse(value, rows[name].value):
            rows[name] = _JudgedDeviation(value, rounding, str(row.get("unit", "")))
    return rows


def _is_worse(value: float, other: float) -> bool:
    """Return whether a deviation is worse than another; one that is not finite is the worst."""
    if math.isnan(other):
        return False
    return math.isnan(value) or value > other


def _number(value: object) -> float:
    """Return a number of JSON; NaN for what is none, and for what is not finite or too large."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    try:
        number = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return math.nan
    return number if math.isfinite(number) else math.nan
