"""Formulas with other equations."""

from __future__ import annotations

import dataclasses


def replaced(formula, equation, function):
    """The formula with another function for an equation, in every variant."""
    out = {e.name: e for e in formula.equations}
    out[equation] = dataclasses.replace(out[equation], variants=dict.fromkeys(out[equation].variants, function))
    return dataclasses.replace(formula, equations=tuple(out.values()))
