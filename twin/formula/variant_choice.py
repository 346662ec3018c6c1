"""Choose a variant for every equation of a formula."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from twin.core.errors import KinematicsError, unknown
from twin.formula.contract import Equation, Formula


def choose(formula: Formula, variants: Mapping[str, str] | str | None) -> dict[str, str]:
    """Return the chosen variant of every equation, {equation: variant}.

    `variants` is {equation: variant}, the same as a text ("eq1=printed"; several with commas), or the name of one
    variant for all equations that have this variant.

    Raises:
        KinematicsError: an equation or a variant is unknown; the message lists the existing names.
    """
    equation_of: dict[str, Equation] = {}
    chosen: dict[str, str] = {}
    for equation in formula.equations:
        if equation.stage != "helper":  # helpers are not published, and have no readings
            equation_of[equation.name] = equation
            chosen[equation.name] = equation.default
    if variants is None:
        return chosen
    if isinstance(variants, str):
        if "=" not in variants:
            return chosen | _wherever_existing(formula, equation_of.values(), variants)
        variants = _pairs(formula, variants)
    for name, variant in variants.items():
        if name not in equation_of:
            raise KinematicsError(f"formula '{formula.name}': {unknown('equation', name, equation_of)}")
        existing = equation_of[name].variants
        if variant not in existing:
            text = unknown("variant", variant, existing)
            raise KinematicsError(f"formula '{formula.name}', equation '{name}': {text}")
        chosen[name] = variant
    return chosen


def _pairs(formula: Formula, text: str) -> dict[str, str]:
    """Return {equation: variant} of a text such as "eq1=printed, eq2=literal".

    Raises:
        KinematicsError: a part of the text has another form, or an equation is given twice.
    """
    pairs: dict[str, str] = {}
    for part in text.split(","):
        equation, mark, variant = map(str.strip, part.partition("="))
        if not (equation and mark and variant):
            way_out = "write EQUATION=VARIANT, as eq1=printed"
            raise KinematicsError(f"formula '{formula.name}', variants '{text}': {way_out}")
        if equation in pairs:
            raise KinematicsError(f"formula '{formula.name}', variants '{text}': equation '{equation}' is given twice")
        pairs[equation] = variant
    return pairs


def _wherever_existing(formula: Formula, equations: Iterable[Equation], variant: str) -> dict[str, str]:
    """Return {equation: variant} for the equations that have this variant.

    Raises:
        KinematicsError: there is no such equation.
    """
    chosen = {}
    existing: set[str] = set()
    for equation in equations:
        existing.update(equation.variants)
        if variant in equation.variants:
            chosen[equation.name] = variant
    if not chosen:
        raise KinematicsError(f"formula '{formula.name}': {unknown('variant', variant, existing)}")
    return chosen
