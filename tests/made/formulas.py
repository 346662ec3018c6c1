"""Formulas with replaced equations."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from twin.formula.contract import Formula
from twin.formula.equations import Equations


def replaced(formula, equation, function):
    """Return a formula in which `function` replaces an equation, in every variant."""
    out = {e.name: e for e in formula.equations}
    out[equation] = dataclasses.replace(out[equation], variants=dict.fromkeys(out[equation].variants, function))
    return dataclasses.replace(formula, equations=tuple(out.values()))


def with_reach(formula: Formula, margins: Mapping[str, Callable[[Any], Any]]) -> Formula:
    """Return a formula with rows of reach: functions from the tool pose (4, 4) to a margin, by name of the row."""
    symbols = {name: f"margin{k}" for k, name in enumerate(margins)}
    equation = Equations("ASSUMED", variant="written")

    @equation("helper", "margins", gives=" ".join(symbols.values()))
    def rows(T_base_tool):
        values = [margin(T_base_tool) for margin in margins.values()]
        return values if len(values) > 1 else values[0]

    return dataclasses.replace(formula, equations=(*formula.equations, *equation), reach=symbols)
