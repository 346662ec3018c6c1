"""Formulas with replaced equations."""

from __future__ import annotations

import dataclasses


def replaced(formula, equation, function):
    """Return a formula in which `function` replaces an equation, in every variant."""
    out = {e.name: e for e in formula.equations}
    out[equation] = dataclasses.replace(out[equation], variants=dict.fromkeys(out[equation].variants, function))
    return dataclasses.replace(formula, equations=tuple(out.values()))
