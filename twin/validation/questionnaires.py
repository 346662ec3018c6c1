"""Score questionnaires from the answers of users, by published keys: trajectories/davinci/questionnaire/*.toml."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from twin.core import assets
from twin.core.errors import DescriptionError, TwinError
from twin.core.findings import Finding, info
from twin.schema import Identifier, Table, at, load_toml

BEFORE_PREFIX = "before_"
"""Prefix of the columns of a questionnaire that was answered before a session as well."""


class QuestionItem(Table):
    """A question, the scales to which it belongs, and whether a high answer lowers these scales (`reversed`)."""

    name: str
    scales: list[Identifier] = Field(min_length=1)
    reversed: bool = False


class TotalScore(Table):
    """The total score: `weight` times the sum of all scales, where each scale is the plain sum of its items."""

    name: Identifier
    weight: float = Field(gt=0)


class WeightedScore(Table):
    """A score in which each item has a weight: how often it was chosen in comparisons of all pairs of items.

    The score is the sum of weight times value, divided by the number of comparisons, which is the sum of the weights.
    """

    name: Identifier
    comparisons: int = Field(gt=0)


class QuestionnaireKey(Table):
    """The key of a questionnaire.

    An answer is a number from `low` to `high`, in steps of `step`; its value is answer - `zero`, or `zero` - answer for
    a reversed item. A scale is the sum or the mean of the values of its items, times its factor in the section `scale`.
    The answers of users are in table columns named <name>_1, <name>_2, ..., the weights of the section `weighted` in
    columns named <name>_w1, <name>_w2, ... `ends` are the words at both ends of the scale.
    """

    name: Identifier
    title: str
    source: str = Field(min_length=1)
    low: int
    high: int
    step: int = Field(1, gt=0)
    zero: int
    combine: Literal["sum", "mean"]
    item: list[QuestionItem] = Field(min_length=1)
    scale: dict[Identifier, float]
    total: TotalScore | None = None
    weighted: WeightedScore | None = None
    ends: tuple[str, str] = ("low", "high")

    @property
    def columns(self) -> list[str]:
        """Names of the table columns with the answers, in the order of the items."""
        numbers = range(1, len(self.item) + 1)
        return [f"{self.name}_{number}" for number in numbers]

    @property
    def weight_columns(self) -> list[str]:
        """Names of the table columns with the weights, in the order of the items; none if the key has no weights."""
        if self.weighted is None:
            return []
        numbers = range(1, len(self.item) + 1)
        return [f"{self.name}_w{number}" for number in numbers]

    @model_validator(mode="after")
    def _are_scales_known(self) -> QuestionnaireKey:
        """Check that each item belongs to scales of the questionnaire."""
        for i, item in enumerate(self.item):
            unknown = set(item.scales) - set(self.scale)
            if unknown:
                raise at(("item", i, "scales"), f"there is no scale '{min(unknown)}'; use {', '.join(self.scale)}")
        return self

    def check(self, answers: Sequence[float | None], weights: Sequence[float] | None) -> None:
        """Check the answers of one user, None for an item without an answer, and the weights (None: no comparisons).

        Raises:
            TwinError: a number is missing, not allowed or one too many.
        """
        if len(answers) != len(self.item):
            raise TwinError(f"{self.name} has {len(self.item)} items; {len(answers)} answers are given")
        for column, value in zip(self.columns, answers, strict=True):
            if value is not None and not self.allows(value):
                raise TwinError(f"{column} is {value:g}; give {self.numbers()}, {self.low} to {self.high}")
        if weights is None:
            return
        if self.weighted is None or len(weights) != len(self.item):
            raise TwinError(f"{self.name} has {len(self.weight_columns)} weights; {len(weights)} are given")
        most = len(self.item) - 1
        for column, weight in zip(self.weight_columns, weights, strict=True):
            if not math.isfinite(weight) or weight != int(weight) or not 0 <= weight <= most:
                raise TwinError(f"{column} is {weight:g}; give an integer, 0 to {most}")
        if sum(weights) != self.weighted.comparisons:
            raise TwinError(f"the weights have the sum {sum(weights):g}; it must be {self.weighted.comparisons}")

    def allows(self, value: float) -> bool:
        """Return whether a number is an allowed answer."""
        if not math.isfinite(value):
            return False
        is_integer = value == int(value)
        is_in_range = self.low <= value <= self.high
        return is_integer and is_in_range and (value - self.low) % self.step == 0

    def numbers(self) -> str:
        """Return the allowed kind of numbers in words."""
        if self.step == 1:
            return "an integer"
        return f"a multiple of {self.step}"

    def scores(self, answers: Sequence[float]) -> dict[str, float]:
        """Return the scales and, if defined, the total of one user; a score is NaN if an answer is missing (NaN).

        `answers` has one number per item, `low` to `high`.
        """
        items_of: dict[str, list[float]] = {scale: [] for scale in self.scale}
        for answer, item in zip(answers, self.item, strict=True):
            value = answer - self.zero
            if item.reversed:  # agreement with the item lowers the score
                value = self.zero - answer
            for scale in self.scale:
                if scale in item.scales:
                    items_of[scale].append(value)
        scores: dict[str, float] = {}
        total = 0.0
        for scale, weight in self.scale.items():
            values = items_of[scale]
            total += sum(values)
            divisor = 1 if self.combine == "sum" else len(values)
            scores[f"{self.name}_{scale}"] = weight * sum(values) / divisor
        if self.total is not None:
            scores[f"{self.name}_{self.total.name}"] = self.total.weight * total
        return scores

    def weighted_score(self, answers: Sequence[float], weights: Sequence[float]) -> float:
        """Return the weighted score of one user; NaN if an answer or a weight is missing (NaN).

        `answers` and `weights` have one number per item; the key must have the section `weighted`.
        """
        assert self.weighted is not None
        total = 0.0
        for answer, weight in zip(answers, weights, strict=True):
            total += weight * (answer - self.zero)
        return total / self.weighted.comparisons


def keys() -> list[QuestionnaireKey]:
    """Return the key of every questionnaire that can be scored.

    Raises:
        DescriptionError: a file is invalid.
    """
    folder = assets.data_folder() / "trajectories" / "davinci" / "questionnaire"
    return [load_toml(path, QuestionnaireKey) for path in sorted(folder.glob("*.toml"))]


def _keys_of_columns() -> list[QuestionnaireKey]:
    """Return the keys for columns of tables: each also with the prefix of what was answered before a session."""
    table_keys = keys()
    for key in keys():
        title = f"{key.title}, before the session"
        table_keys.append(key.model_copy(update={"name": f"{BEFORE_PREFIX}{key.name}", "title": title}))
    return table_keys


def scored(
    path: Path, columns: Mapping[str, Sequence[float]], lines: Sequence[int]
) -> tuple[dict[str, list[float]], list[Finding]]:
    """Return the columns of a table of users with scores instead of answers, and findings on the keys.

    `path` and `lines` (line of each user in the file) are used in messages. `columns` contains the values of the users
    by name of the column; NaN: an empty cell.

    Raises:
        DescriptionError: a column of a questionnaire is missing, or an answer is not one of the allowed numbers.
    """
    table: dict[str, list[float]] = {}
    for name, values in columns.items():
        table[name] = list(values)
    findings: list[Finding] = []
    for key in _keys_of_columns():
        answered = []
        for name in columns:
            if re.fullmatch(rf"{key.name}_w?\d+", name):
                answered.append(name)
        if not answered:
            continue
        # columns first: with a missing one, the answers of a user cannot be collected
        _check_columns(path, key, columns, answered)
        _check_answers(path, key, columns, lines)
        replaced = list(key.columns)
        if _has_weights(key, columns):
            replaced += key.weight_columns
        for name in replaced:
            del table[name]
        table |= _scores_of_users(key, columns, len(lines))
        findings.append(info("study.scored", key.name, f"{key.title}, scored by the key of: {key.source}"))
    return table, findings


def _has_weights(key: QuestionnaireKey, columns: Mapping[str, Sequence[float]]) -> bool:
    """Return whether a table has weights for a questionnaire."""
    return any(name in columns for name in key.weight_columns)


def _scores_of_users(
    key: QuestionnaireKey, columns: Mapping[str, Sequence[float]], users: int
) -> dict[str, list[float]]:
    """Return {score: its value for each user} of one questionnaire, from a table with `users` rows."""
    scores: dict[str, list[float]] = {}
    for user in range(users):
        answers = _numbers_of_user(columns, key.columns, user)
        for score, value in key.scores(answers).items():
            scores.setdefault(score, []).append(value)
        if key.weighted is not None and _has_weights(key, columns):
            weights = _numbers_of_user(columns, key.weight_columns, user)
            weighted = key.weighted_score(answers, weights)
            scores.setdefault(f"{key.name}_{key.weighted.name}", []).append(weighted)
    return scores


def _numbers_of_user(columns: Mapping[str, Sequence[float]], names: Sequence[str], user: int) -> list[float]:
    """Return the numbers of one user in the columns `names` of a table."""
    return [columns[name][user] for name in names]


def _check_columns(
    path: Path, key: QuestionnaireKey, columns: Mapping[str, Sequence[float]], answered: Sequence[str]
) -> None:
    """Raise an error if the table lacks a column of a questionnaire, or has more columns than it has items."""
    title = key.name.upper()
    needed = list(key.columns)
    if any(name in key.weight_columns for name in answered):
        needed += key.weight_columns
    missing = []
    for name in needed:
        if name not in columns:
            missing.append(name)
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise DescriptionError(
            f"{path}:1: {title} needs the columns {needed[0]} to {needed[-1]}; {', '.join(missing)} {verb} missing"
        )
    for name in answered:
        if name not in needed:
            raise DescriptionError(f"{path}:1: {title} has {len(key.item)} items; {name} is not an item")


def _check_answers(
    path: Path, key: QuestionnaireKey, columns: Mapping[str, Sequence[float]], lines: Sequence[int]
) -> None:
    """Raise an error if an answer is not an integer in the range of the questionnaire."""
    for name in key.columns:
        for value, line in zip(columns[name], lines, strict=True):
            if math.isnan(value):
                continue
            if not key.allows(value):
                allowed = f"give {key.numbers()}, {key.low} to {key.high}, or leave it empty"
                raise DescriptionError(f"{path}:{line}: {name} is {value:g}; {allowed}")
    if key.weighted is None or key.weight_columns[0] not in columns:
        return
    most = len(key.item) - 1
    for user, line in enumerate(lines):
        weights = _numbers_of_user(columns, key.weight_columns, user)
        for name, weight in zip(key.weight_columns, weights, strict=True):
            allowed = math.isfinite(weight) and weight == int(weight) and 0 <= weight <= most
            if not math.isnan(weight) and not allowed:
                raise DescriptionError(f"{path}:{line}: {name} is {weight:g}; give an integer, 0 to {most}")
        total = sum(weights)
        if not math.isnan(total) and total != key.weighted.comparisons:
            first = key.weight_columns[0]
            last = key.weight_columns[-1]
            comparisons = key.weighted.comparisons
            raise DescriptionError(
                f"{path}:{line}: the weights {first} to {last} have the sum {total:g}; "
                f"{comparisons} comparisons of pairs give the sum {comparisons}"
            )
