"""The file of a user study with independent groups: its tables as a paper prints them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from twin.schema import Table, Vector, at, load_toml

_LARGEST_NUMBER = 1e12  # of the numbers of a table; their squares and rounded multiples must not overflow

_ByGroup = dict[str, Annotated[float, Field(ge=-_LARGEST_NUMBER, le=_LARGEST_NUMBER)]]

_Std = Annotated[float, Field(ge=0, le=_LARGEST_NUMBER)]

_StdByGroup = dict[str, _Std]


class Group(Table):
    """A group of users, with its name and the number of users."""

    name: str
    users: int = Field(ge=2)


class ComparedPair(Table):
    """Two compared groups and the printed p-value (None if the paper only states "not significant")."""

    between: tuple[str, str]
    printed_p: Annotated[float, Field(ge=0, le=1)] | None = None


class GroupOutcome(Table):
    """Printed mean and standard deviation of one measure, per group.

    The value of a user is the mean of `items` integers; `items` is 0 if values do not come from integers.
    """

    name: str
    unit: str
    decimals: int = Field(ge=0, le=9)
    items: int = Field(default=0, ge=0)
    mean: _ByGroup
    std: _StdByGroup
    compared: list[ComparedPair] = Field(default_factory=list)


class PrintedRange(Table):
    """Printed mean and standard deviation of one measure per group, and its printed range (minimum, maximum)."""

    name: str
    unit: str
    mean: _ByGroup
    std: _StdByGroup
    lower: _ByGroup
    upper: _ByGroup


class Accuracy(Table):
    """Printed mean and standard deviation of the error along x, y, z, and the printed RMSE, in `unit`."""

    name: str
    unit: str
    mean: Vector
    std: tuple[_Std, _Std, _Std]
    rmse: float = Field(ge=0)
    decimals: int = Field(ge=0, le=9)


class AccuracyChain(Table):
    """Accuracy test of the paper's console.

    `displacements` is the number of displacements per axis, `resolution_mm` is the resolution of the haptic pen,
    `required_mm` is the largest accepted error, and `of` names the [[accuracy]] section with the printed results.
    """

    displacements: int = Field(ge=2)
    resolution_mm: float = Field(gt=0)
    required_mm: float = Field(gt=0)
    of: str


class AngleChain(Table):
    """Accuracy test of the paper's console with rotations.

    `rotations` is the number of rotations about each axis, `resolution_deg` is the resolution of the pen's gimbal,
    `provenance` and `note` say where it is from, and `of` names the [[accuracy]] section with the printed results.
    """

    rotations: int = Field(ge=2)
    resolution_deg: float = Field(gt=0, le=10)
    provenance: str
    note: str
    of: str


class PricedPart(Table):
    """A part with its printed price, and the number of pieces that the text requires."""

    name: str
    price: float = Field(ge=0, le=_LARGEST_NUMBER)
    pieces: int = Field(ge=1)


class PriceSum(Table):
    """A printed sum of prices; `unit` is the currency, and the sum is rounded to a multiple of `rounded_to`."""

    name: str
    unit: str
    printed: float = Field(ge=0, le=_LARGEST_NUMBER)
    rounded_to: float = Field(gt=0, le=_LARGEST_NUMBER)
    part: list[PricedPart] = Field(min_length=1)


class StatedMinimum(Table):
    """A sentence of the paper with the claim that the means of the listed outcomes are above a number."""

    text: str
    outcomes: list[str]
    above: float


class RepeatedNumbers(Table):
    """Numbers that the paper prints in several places: one list of values for each place. The lists must be equal."""

    name: str
    where: list[str]
    values: list[list[float]]


class GroupTables(Table):
    """The file of a user study with independent groups."""

    title: str
    source: str
    significance: float = Field(default=0.05, gt=0, lt=1)
    printed_test: str
    group: list[Group] = Field(min_length=1)
    outcome: list[GroupOutcome] = Field(default_factory=list)
    range: list[PrintedRange] = Field(default_factory=list)
    accuracy: list[Accuracy] = Field(default_factory=list)
    chain: AccuracyChain | None = None
    angle_chain: AngleChain | None = None
    sum: list[PriceSum] = Field(default_factory=list)
    claim: list[StatedMinimum] = Field(default_factory=list)
    twice: list[RepeatedNumbers] = Field(default_factory=list)

    @model_validator(mode="after")
    def _are_names_known(self) -> GroupTables:
        """Check that every table has a number for each group, and that every name exists."""
        groups = {group.name for group in self.group}
        for i, outcome in enumerate(self.outcome):
            _require_groups(("outcome", i, "mean"), outcome.mean, groups)
            _require_groups(("outcome", i, "std"), outcome.std, groups)
        for i, printed in enumerate(self.range):
            _require_groups(("range", i, "mean"), printed.mean, groups)
            _require_groups(("range", i, "std"), printed.std, groups)
            _require_groups(("range", i, "lower"), printed.lower, groups)
            _require_groups(("range", i, "upper"), printed.upper, groups)
        for i, printed in enumerate(self.range):
            for group, lower in printed.lower.items():
                if lower > printed.upper[group]:
                    raise at(("range", i, "upper"), f"{group}: the range ends below its beginning")
        for i, twice in enumerate(self.twice):
            places = len(twice.where)
            lists = len(twice.values)
            if places != lists:
                plural = "s" if places > 1 else ""
                text = f"give one list of values for each place: {places} place{plural}, {lists} lists"
                raise at(("twice", i, "values"), text)
        for i, outcome in enumerate(self.outcome):
            for j, pair in enumerate(outcome.compared):
                if not set(pair.between) <= groups:
                    text = f"give the names of two groups; the groups are {', '.join(sorted(groups))}"
                    raise at(("outcome", i, "compared", j, "between"), text)
        self._check_outcomes_of_claims()
        self._check_accuracy_of_chain()
        return self

    def accuracy_of(self, chain: AccuracyChain | AngleChain) -> Accuracy:
        """Return the printed errors of a test; they exist, because the tables are checked when they are read."""
        for accuracy in self.accuracy:
            if accuracy.name == chain.of:
                return accuracy
        raise KeyError(chain.of)

    def _check_outcomes_of_claims(self) -> None:
        """Raise an error at a claim on an outcome that the file does not have."""
        outcomes = {outcome.name for outcome in self.outcome}
        for i, claim in enumerate(self.claim):
            unknown = set(claim.outcomes) - outcomes
            if unknown:
                listed = ", ".join(sorted(outcomes))
                text = f"there is no outcome '{min(unknown)}'; the outcomes are {listed}"
                raise at(("claim", i, "outcomes"), text)

    def _check_accuracy_of_chain(self) -> None:
        """Raise an error at a test whose printed errors the file does not have."""
        printed = [accuracy.name for accuracy in self.accuracy]
        for key, chain in (("chain", self.chain), ("angle_chain", self.angle_chain)):
            if chain is not None and chain.of not in printed:
                listed = ", ".join(printed) or "none"
                text = f"no [[accuracy]] section has the name '{chain.of}'; the names are {listed}"
                raise at((key, "of"), text)


def _require_groups(place: tuple[str | int, ...], numbers: Mapping[str, float], groups: set[str]) -> None:
    """Raise an error at a place of the file unless it has one number for each group."""
    if set(numbers) != groups:
        raise at(place, f"give one number for each group: {', '.join(sorted(groups))}")


def load(path: Path) -> GroupTables:
    """Read the file of a user study with groups.

    Raises:
        DescriptionError: the file is invalid; the message has file, line, key, value and the allowed values.
    """
    return load_toml(path, GroupTables)


def half_digit(decimals: int) -> float:
    """Return half a unit of the last printed digit: how far a rounded number may be from the exact one."""
    return 0.5 * 10**-decimals
