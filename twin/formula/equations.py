"""Decorators that register equation functions with their outputs, sources and variants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar, get_args

from twin.core.errors import KinematicsError
from twin.formula.contract import Equation, Stage, SymbolFunction
from twin.formula.variant_rows import VariantFunction

_Function = TypeVar("_Function", bound=SymbolFunction)


class Equations:
    """The equations of one file, to be passed to `Formula` as `equations`; a decorator registers each function.

    Iteration yields inverse equations, then forward equations, then helpers, each in file order. In a formula file:

        equation = Equations()

        @equation("inverse", "ball -> carriages", gives="q1 q2", source="paper, eq. (2)", why="as in Fig. 3")
        def eq2(x, y, l_1, l_2):
            q1 = x + l_2
            q2 = y - l_1
            return q1, q2

        @equation.variant("printed", of=eq2, why="the row of q1 has the wrong length")
        def eq2_printed(x, l_1):
            q1 = x + l_1
            return q1

    Attributes:
        source: default source (document and equation number).
        variant_name: default name of the first variant (reading) of an equation; for a helper always "corrected".
    """

    def __init__(self, source: str = "DERIVED", variant: str = "corrected") -> None:
        self.source = source
        self.variant_name = variant
        self._registered: list[Equation] = []

    def __call__(
        self,
        stage: Stage,
        title: str,
        gives: str | Sequence[str],
        source: str = "",
        variant: str = "",
        name: str = "",
        why: str = "",
    ) -> Callable[[_Function], _Function]:
        """Return a decorator that registers a function as an equation, in its default variant.

        Args:
            stage: "inverse", "forward" or "helper"; see `Stage`.
            title: inputs and outputs in words, "ball -> carriages".
            gives: symbols that the function returns, in order: a sequence, or a text with spaces between the symbols.
            source: document and equation number.
            variant: name of this variant; not used for a helper, whose first variant is "corrected".
            name: name of the equation; default: the name of the function.
            why: reason why this variant is correct; only needed if there are other variants.

        Raises:
            KinematicsError: an equation of this name is already registered (raised by the decorator).
        """
        if isinstance(gives, str):
            gives = gives.split()
        outputs = tuple(gives)
        if stage == "helper":
            variant_name = "corrected"
        else:
            variant_name = variant or self.variant_name
        reasons = {}
        if why:
            reasons[variant_name] = why

        def register(function: _Function) -> _Function:
            equation_name = name or function.__name__
            if equation_name in [equation.name for equation in self._registered]:
                raise KinematicsError(
                    f"two equations are named '{equation_name}': register the second as a variant of the first"
                )
            equation = Equation(
                equation_name,
                title,
                source=source or self.source,
                stage=stage,
                outputs=outputs,
                variants={variant_name: function},
                reasons=reasons,
                default=variant_name,
            )
            self._registered.append(equation)
            return function

        return register

    def variant(self, name: str, of: SymbolFunction, why: str) -> Callable[[SymbolFunction], VariantFunction]:
        """Return a decorator that registers a variant of an equation: a function with only the rows that differ.

        A row is one assignment. Each row of the variant replaces the row of `of` that assigns the same symbols. If `of`
        has these symbols only as arguments, the row is inserted at the beginning. A row with other symbols is inserted
        before the next changed row of the variant. The arguments of the decorated function are symbols of the flow, or
        names that `of` assigns. The decorated function returns the changed symbols.

        Args:
            name: name of the variant.
            of: the function to change: the function of the equation, or of another variant.
            why: the change in this variant, and its reason.

        Raises:
            KinematicsError: `of` is not an equation of this file, or the equation already has a variant of this name.
                The file is parsed when the variant is first used; only then, an error with file and line is raised for
                a row that does not exist in `of`.
        """
        place = self._place_of(of)
        if place is None:
            raise KinematicsError(f"variant '{name}' changes {of!r}, which is not an equation of this file")

        def register(function: SymbolFunction) -> VariantFunction:
            equation = self._registered[place]
            if name in equation.variants:
                raise KinematicsError(
                    f"two variants of equation '{equation.name}' are named '{name}': give the second another name"
                )
            variant = VariantFunction(of, function)
            variants = {**equation.variants, name: variant}
            reasons = {**equation.reasons, name: why}
            self._registered[place] = replace(equation, variants=variants, reasons=reasons)
            return variant

        return register

    def _place_of(self, function: SymbolFunction) -> int | None:
        """Return the index of the equation of which the function is a variant; None if there is none."""
        for i, equation in enumerate(self._registered):
            for variant in equation.variants.values():
                if variant is function:  # not `in`, which would compare by equality
                    return i
        return None

    def __iter__(self) -> Iterator[Equation]:
        stages = get_args(Stage)
        return iter(sorted(self._registered, key=lambda equation: stages.index(equation.stage)))
