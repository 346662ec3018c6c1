"""Read hand-written TOML into pydantic models, with precise errors.

Messages have one line for each mistake: file, line, key, value, allowed values, and a suggestion. Models derive from
`Table`: unknown keys, strings instead of numbers, NaN and infinity are errors.
"""

from __future__ import annotations

import datetime
import json
import math
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from twin.core.errors import DescriptionError
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.once import Read
from twin.core.foreign.text import check_depth, read_text
from twin.core.json_types import JsonObject
from twin.core.provenance import EARLIER, Parameter, Provenance
from twin.core.units import SI
from twin.schema.lines import Key, Keys, key_lines, nearest_line, spell
from twin.schema.mistakes import explain, explain_syntax

M = TypeVar("M", bound=BaseModel)


def _present_name(provenance: object) -> object:
    """Return the present name of a provenance; other values unchanged, which the validation then refuses."""
    if isinstance(provenance, str):
        return EARLIER.get(provenance, provenance)
    return provenance


Origin = Annotated[Provenance, BeforeValidator(_present_name)]
"""Provenance of a number in a table; former provenance names are also accepted."""


class Table(BaseModel):
    """Base class of all tables: strict types, immutable, no unknown keys; lower_x <= upper_x and min_x <= max_x."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="after")
    def _limits_in_order(self) -> Table:
        for lower_name in type(self).model_fields:
            for low, high in (("lower", "upper"), ("min", "max")):
                if lower_name != low and not lower_name.startswith(low + "_"):
                    continue
                upper_name = high + lower_name[len(low) :]
                lower = getattr(self, lower_name)
                upper = getattr(self, upper_name, None)
                if not isinstance(lower, int | float) or not isinstance(upper, int | float):
                    continue
                if lower > upper:
                    raise at(lower_name, f"limits are swapped: {lower_name} {lower:g} is above {upper_name} {upper:g}")
        return self


Row = tuple[str, float | Sequence[float] | None, str]
"""(name, value, unit) of a number, or of a point with three numbers x, y and z; the value None is skipped."""


class Sourced(Table):
    """A table whose numbers have one common provenance and one common note (source or reason)."""

    provenance: Origin
    note: str = Field(min_length=1)

    def parameters(self, label: str, rows: Iterable[Row]) -> Iterator[Parameter]:
        """Yield each number of the rows as a parameter, named after the label, the name of the row and the axis."""
        for name, value, unit in rows:
            if value is None:
                continue
            if isinstance(value, int | float):
                numbers = {"": value}
            else:
                numbers = dict(zip("xyz", value, strict=True))
            scale = SI.get(unit, 1.0)
            for axis, number in numbers.items():
                full_name = " ".join(part for part in (label, name, axis) if part)
                yield Parameter(full_name, number * scale, unit, float(number), self.provenance, self.note)


def _in_order(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits (lower, upper); raise an error of pydantic if they are swapped."""
    first, second = limits
    if first > second:
        text = f"limits are swapped: write [{second:g}, {first:g}]"
        raise PydanticCustomError("swapped", "{text}", {"text": text})
    return limits


def _one_finite(limits: tuple[float, float]) -> tuple[float, float]:
    """Return limits (lower, upper); raise an error of pydantic if neither is a finite number, or one is NaN."""
    first, second = limits
    if not math.isfinite(first) and not math.isfinite(second):
        raise PydanticCustomError("unlimited", 'neither limit is a number: write limits = "none"')
    if math.isnan(first) or math.isnan(second):
        raise PydanticCustomError("nan", "a limit is not a number: write inf or -inf for a side without a limit")
    return limits


Identifier = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$")]
"""A name that is valid in Python, USD, glTF and Unity."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]

Vector = tuple[float, float, float]
"""Type of three finite numbers."""

Range = Annotated[tuple[float, float], AfterValidator(_in_order)]
"""Type of two finite numbers, the lower first."""

_Limit = Annotated[float, Field(allow_inf_nan=True)]

LimitRange = Annotated[tuple[_Limit, _Limit], AfterValidator(_one_finite), AfterValidator(_in_order)]
"""Type of two limits, the lower first; one of them may be infinite: -inf or inf in TOML."""


def at(key: Key | Keys, message: str) -> PydanticCustomError:
    """Return an error that a model validator can raise; the error points at `key` in the validated table."""
    keys = key if isinstance(key, tuple) else (key,)
    return PydanticCustomError("at_key", "{text}", {"text": message, "keys": keys})


def load_toml(path: str | Path, model: type[M], read: Read = read_bytes) -> M:
    """Return the content of a TOML file, read by `read`, as a validated model.

    Raises:
        DescriptionError: the file is missing, not TOML, or does not match the model; one line for each mistake.
    """
    return parse_toml(_text(Path(path), read), model, str(path))


def parse_toml(text: str, model: type[M], name: str = "<text>") -> M:
    """Return TOML text as a validated model; `name` is the file name in messages.

    Raises:
        DescriptionError: the text is not TOML, or does not match the model; one line for each mistake.
    """
    try:
        check_depth(Path(name), "TOML", text)  # tomllib calls itself for each level
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DescriptionError(explain_syntax(text, name, error)) from error
    for keys in _dates(data):
        line = nearest_line(key_lines(text), keys)
        raise DescriptionError(f"{name}:{line}: {spell(keys)}: dates are not supported; put text in quotes")
    try:
        # JSON mode converts arrays to tuples, but does not convert numbers, text or booleans to each other
        return model.model_validate_json(json.dumps(data))
    except ValidationError as error:
        raise DescriptionError(explain(error, data, key_lines(text), model, name)) from error


def error_at(path: str | Path, keys: Keys, message: str) -> DescriptionError:
    """Return an error that points at one key of a file, for checks outside the model."""
    try:
        text = Path(path).read_text(encoding="utf-8")
        line = nearest_line(key_lines(text), keys)
    except (OSError, UnicodeDecodeError):
        line = 1
    return DescriptionError(f"{path}:{line}: {spell(keys)}: {message}")


def json_schema(model: type[BaseModel]) -> JsonObject:
    """Return the JSON Schema (2020-12) of a model, which editors use to complete and check files."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()}


def _text(path: Path, read: Read) -> str:
    """Return the text of a TOML file.

    Raises:
        DescriptionError: it cannot be read; for a missing file, the message names those beside it.
    """
    try:
        return read_text(path, "TOML", read=read)
    except FileNotFoundError:
        parent = path.parent
        hint = ""
        if parent.is_dir():
            names = [file.name for file in parent.glob("*.toml")]
            if names:
                hint = f" In {parent}: {', '.join(sorted(names))}."
        raise DescriptionError(f"{path}: the file does not exist.{hint}") from None
    except UnicodeDecodeError as error:
        raise DescriptionError(f"{path}: not UTF-8 text at byte {error.start}; save the file as UTF-8") from None
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror or error}") from error


def _dates(value: object, keys: Keys = ()) -> Iterator[Keys]:
    """Yield the keys of TOML dates: JSON has no dates, so dates would be accepted as text."""
    if isinstance(value, datetime.date | datetime.time):
        yield keys
    elif isinstance(value, dict):
        for key, child in value.items():
            yield from _dates(child, (*keys, key))
    elif isinstance(value, list):
        for i, child in enumerate(value):
            yield from _dates(child, (*keys, i))
