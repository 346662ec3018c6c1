"""Compare the parameters that a stage lists, with value, unit and provenance, with other files and the mechanism."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from twin.core.json_types import JsonMapping
from twin.core.provenance import EARLIER, Parameter
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.file_statements import ROBOT
from twin.exchange.audit.ledger import MECHANISM, Ledger, Measured

PARAMETERS = "parameters"
"""Key of the parameters of a stage in `Content.extra`: {name: {value, shown, unit, provenance, note}}."""

_ASSUMED = "ASSUMED"

_ASSUMED_LINE = re.compile(
    r"(?P<name>[^=]+?) = (?P<shown>-?(?:inf|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)) (?P<unit>[^:]*): "
)
"""Line of an assumed number: "name = value unit: reason"."""

_SIX_DIGITS_TOL = 1e-5
"""Relative difference of a number and the same number with the six digits of such a line."""

_ALL_DIGITS_TOL = 1e-9
"""Relative difference of two numbers that are written with all their digits."""

_FIELD_WORDS = {
    "provenance": "the provenance",
    "unit": "the unit",
    "shown": "the number",
    "value": "the value",
}
"""{compared field of a parameter: its name in a finding}, the most important first: only the first one is reported."""


def compare_parameters(contents: Sequence[Content], robot: str, parameters: Iterable[Parameter]) -> None:
    """Report parameters of stages that differ from the assumed numbers of a track, or from the expected `parameters`.

    The latter are those of the mechanism of `robot`; stages of other robots are not compared with them.
    """
    stages = []
    for content in contents:
        if content.extra.get(PARAMETERS):
            stages.append(content)
    for content in contents:
        if not content.is_track:
            continue
        lines = content.extra.get("data", {}).get("assumed")
        if isinstance(lines, list):
            _compare_assumed(map(str, lines), content.file, stages)
            break  # the lists of all tracks begin with the same numbers of the robot
    expected: dict[str, JsonMapping] = {}
    for parameter in parameters:
        expected[parameter.name] = vars(parameter)
    for stage in stages:
        if stage.stated.get(ROBOT) == robot:
            for name, row in stage.extra[PARAMETERS].items():
                if name in expected and isinstance(row, Mapping):
                    _compare(name, row, expected[name], MECHANISM, stage.ledger, _ALL_DIGITS_TOL)


def _compare_assumed(lines: Iterable[str], source: str, stages: Iterable[Content]) -> None:
    """Compare assumed numbers, "name = value unit: reason" in the file `source`, with the parameters of stages.

    Lines about numbers that a stage does not list, such as those of protocols, are not compared.
    """
    stated: dict[str, JsonMapping] = {}
    for line in lines:
        parts = _ASSUMED_LINE.match(line)
        if parts is not None:
            row = {"shown": float(parts["shown"]), "unit": parts["unit"].strip(), "provenance": _ASSUMED}
            stated.setdefault(parts["name"].strip(), row)
    for stage in stages:
        for name, row in stage.extra.get(PARAMETERS, {}).items():
            if name in stated and isinstance(row, Mapping):
                _compare(name, row, stated[name], source, stage.ledger, _SIX_DIGITS_TOL)


def _compare(name: str, row: JsonMapping, expected: JsonMapping, source: str, ledger: Ledger, tolerance: float) -> None:
    """Report the fields of a parameter that differ from those in `source`; missing ones are reported elsewhere."""
    for field, word in _FIELD_WORDS.items():
        if field not in row or field not in expected:
            continue
        value = row[field]
        expected_value = expected[field]
        size: Measured | None = None
        if field == "provenance":
            # Files of earlier versions have other words for the same provenance.
            differs = EARLIER.get(value, value) != expected_value
        elif field == "unit":
            differs = value != expected_value
        else:
            differs = not _is_close(value, expected_value, tolerance)
            if isinstance(value, int | float):
                size = Measured(value, expected_value)
        if differs:
            text = f"parameter '{name}' has {word} {value}; in {source} it is {expected_value}."
            ledger.wrong("claims.parameter", text, name, size=size, suggestion="export the files again")
            return


def _is_close(value: object, number: float, tolerance: float) -> bool:
    """Return whether a value is a number within a relative tolerance; a text is never close."""
    if not isinstance(value, int | float):
        return False
    return value == number or abs(value - number) <= tolerance * max(abs(value), abs(number))
