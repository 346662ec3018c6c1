"""The conditions of the equations as functions of the state, and which states the equations say are within reach."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.proof import formula_side
from twin.proof.degree import Truths
from twin.proof.formula_side import POSE_ENTRIES
from twin.proof.function_branches import EquationCondition, expressions_and_conditions

_LONGEST_TEXT = 60
"""Maximum length of the text of a condition; a longer one is named by its number."""


class EquationConditions:
    """The conditions of the equations as functions of the state; `conditions[i]` is one of them.

    The state has the joints or the coordinates, and the parameters that are drawn; other parameters are constants.

    Attributes:
        state: symbols of the state (n, 1).
        names: their names.
        margins: function of the state that returns the margins of all conditions.
        values: function of the state that returns what must be finite and what must not be negative within reach.
    """

    def __init__(
        self, formula: Formula, variants: Mapping[str, str], drawn: Collection[str], measures: bool = False
    ) -> None:
        """Find the conditions of the equations.

        Args:
            formula: the equations.
            variants: the chosen variant of each equation.
            drawn: names of the parameters that are part of the state.
            measures: whether those that only measures of singularity or aspects depend on are among them.
        """
        self._has_forward = formula.has("forward")
        if self._has_forward:
            state_side = formula_side.from_joints(formula, variants, measures)
        else:
            state_side = formula_side.from_pose(formula, variants, coordinates=True, measures=measures)
        self.names = (*state_side.state, *drawn)
        symbols = {name: ca.SX.sym(name) for name in self.names}
        self.state = ca.vertcat(*symbols.values())
        joints_or_coordinates = self.state[: len(state_side.state)]
        parameter_values = []
        for parameter in formula.parameters:
            published = ca.SX(float(parameter.value))
            parameter_values.append(symbols.get(parameter.name, published))
        parameters = ca.vertcat(*parameter_values)
        results, self._conditions = expressions_and_conditions(formula, state_side, [joints_or_coordinates, parameters])
        must_be_finite = [results["pose"]]
        margins_of_reach = []
        if "reach" in results:
            margins_of_reach.append(results["reach"])
        if "joints" in results:
            must_be_finite.append(results["joints"])
        # From joint values, the state gives the pose first; the inverse equations are then taken at this pose.
        elif formula.has("inverse"):
            inverse_side = formula_side.from_pose(formula, variants, coordinates=False, measures=measures)
            inverse_results, inverse_conditions = expressions_and_conditions(
                formula, inverse_side, [results["pose"], parameters]
            )
            self._conditions += inverse_conditions
            must_be_finite.append(inverse_results["joints"])
            if "reach" in inverse_results:
                margins_of_reach.append(inverse_results["reach"])
        self.margins = self.margins_of(range(len(self._conditions)))
        self.values = ca.Function("values", [self.state], [ca.vertcat(*must_be_finite), ca.vertcat(*margins_of_reach)])

    def __len__(self) -> int:
        return len(self._conditions)

    def __getitem__(self, i: int) -> EquationCondition:
        return self._conditions[i]

    def __iter__(self) -> Iterator[EquationCondition]:
        return iter(self._conditions)

    def margins_of(self, indices: Sequence[int]) -> ca.Function:
        """Return the margins of some conditions, as a function of the state."""
        margins = [self._conditions[i].margin for i in indices]
        return ca.Function("margins", [self.state], [ca.vertcat(*margins)])

    def has_values_and_reach(self, state: Array) -> tuple[Truths, Truths]:
        """Return which states (n, k) have values, and which are within reach by the margins of the equations.

        A margin that is not a number says that a state is out of reach only if conditions choose what is not a number,
        and not if forward equations have a pose there.
        """
        results, reach = self.values(state)
        is_finite = np.isfinite(results.full())
        margins = reach.full()
        # A comparison with NaN is false: margins that are not numbers are judged by themselves below.
        with np.errstate(invalid="ignore"):
            is_beyond = (margins < 0).any(axis=0)
        if any(condition.undefined for condition in self._conditions):
            is_unknown = np.isnan(margins).any(axis=0)
            if self._has_forward:
                has_pose = is_finite[:POSE_ENTRIES].all(axis=0)
                is_unknown &= ~has_pose
            is_beyond |= is_unknown
        has_values = is_finite.all(axis=0) & np.isfinite(margins).all(axis=0)
        return has_values, ~is_beyond

    def text(self, i: int) -> str:
        """Return a condition as text; if it is a long one, only its number."""
        text = str(self._conditions[i].margin)
        if len(text) > _LONGEST_TEXT:
            return f"condition {i + 1}"
        return f"{text} > 0"

    def effect(self, i: int) -> str:
        """Return a condition and the results that depend on it as text."""
        results = ", ".join(sorted(self._conditions[i].effects))
        return f"{self.text(i)} ({results})"
