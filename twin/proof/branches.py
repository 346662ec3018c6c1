"""Conditions in the equations: which answers they have, and a search for states with answers that were not drawn."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from twin.core.spatial import Array
from twin.formula.contract import Formula
from twin.proof import formula_side, intervals
from twin.proof.draws import NEAR_PART
from twin.proof.formula_side import Outputs
from twin.proof.interval_function import IntervalFunction
from twin.proof.intervals import Intervals
from twin.proof.values import Truths

_STARTS = 24
"""Number of states nearest to the change of an answer from which a search starts."""

_STEPS = 6
"""Number of Newton steps of a search."""

_BEYOND = tuple(10.0**-k for k in range(10))
"""How far beyond the change of an answer a search aims, as parts of the margin at its start."""

_HALVINGS = 4
"""How often each coordinate is halved at most."""

MOST_BOXES = 4096
"""Maximum number of boxes."""

_RARE = 64
"""Number of states with an answer below which they are judged besides."""

_NEIGHBOURS = 4
"""Number of states beside a state at which its answer must be the same."""

_KEPT = 16
"""Maximum number of states that are kept of those where one condition has another answer."""

_KEPT_REFUSED = 240
"""The same of those where the other answer leaves no value."""


@dataclass(frozen=True)
class Branch:
    """A condition that chooses between expressions.

    Attributes:
        margin: positive where it is true, and negative where it is false, as an expression of state and parameters.
        at_zero: the answer where the margin is 0; None if it may be both.
        undefined: answers at which the equations have no value, or none that depends on the condition, at any state.
        effects: names of the results that depend on it, as "pose", "joints", "margin arm", "measure wrist".
    """

    margin: ca.SX
    at_zero: bool | None
    undefined: frozenset[bool]
    effects: frozenset[str]

    def has(self, answer: bool, margin: Array | Intervals) -> Truths:
        """Return where the answer certainly is a given one, by values or by intervals of the margin."""
        if answer:
            return margin >= 0 if self.at_zero is True else margin > 0
        return margin <= 0 if self.at_zero is False else margin < 0

    @property
    def refuses(self) -> bool:
        """Whether a margin of reach depends on it: where that is not a number, the equations say "out of reach"."""
        return any(effect.startswith("margin ") for effect in self.effects)

    def only_affects(self, results: Collection[str]) -> bool:
        """Return whether no result but the given ones depends on it."""
        return bool(self.effects) and self.effects <= set(results)


class Branches:
    """The conditions of the equations as functions of the state.

    The state has the joints or the coordinates, and the parameters that are drawn; other parameters are constants.

    Attributes:
        all: the conditions.
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
            drawn: parameters that are part of the state.
            measures: whether those that only measures of singularity or aspects depend on are among them.
        """
        if formula.has("forward"):
            first = formula_side.from_joints(formula, variants, measures)
        else:
            first = formula_side.from_pose(formula, variants, coordinates=True, measures=measures)
        self.names = (*first.state, *drawn)
        symbols = {name: ca.SX.sym(name) for name in self.names}
        self.state = ca.vertcat(*symbols.values())
        columns = [symbols[name] for name in first.state]
        parameters = [symbols.get(p.name, ca.SX(float(p.value))) for p in formula.parameters]
        numbers = ca.vertcat(*parameters)
        results, found = _walked(formula, first, [ca.vertcat(*columns), numbers])
        finite = [results[first.names.index("pose")]]
        reach = _of(first.names, results, "reach")
        self._assembles = formula.has("forward")
        if "joints" in first.names:
            finite.append(results[first.names.index("joints")])
        elif formula.has("inverse"):
            second = formula_side.from_pose(formula, variants, coordinates=False, measures=measures)
            results, more = _walked(formula, second, [finite[0], numbers])
            found += more
            finite.append(results[second.names.index("joints")])
            reach += _of(second.names, results, "reach")
        self.all = found
        self.margins = ca.Function("margins", [self.state], [ca.vertcat(*[branch.margin for branch in found])])
        self.values = ca.Function("values", [self.state], [ca.vertcat(*finite), ca.vertcat(*reach)])

    def judged(self, state: Array) -> tuple[Truths, Truths]:
        """Return which states (n, k) have values, and which are within reach by the margins of the equations.

        A margin that is not a number says that a state is out of reach only if conditions choose what is not a number,
        and not if forward equations have a pose there.
        """
        finite, reach = self.values(state)
        margins = reach.full()
        with np.errstate(invalid="ignore"):
            beyond = (margins < 0).any(axis=0)
        if any(branch.undefined for branch in self.all):
            unknown = np.isnan(margins).any(axis=0)
            if self._assembles:
                unknown &= ~np.isfinite(finite.full()[:_POSE]).all(axis=0)
            beyond |= unknown
        known = np.isfinite(finite.full()).all(axis=0) & np.isfinite(margins).all(axis=0)
        return known, ~beyond

    def text(self, i: int) -> str:
        """Return a condition as text; if it is a long one, only its number."""
        text = str(self.all[i].margin)
        if len(text) > _LONGEST:
            return f"condition {i + 1}"
        return f"{text} > 0"

    def effect(self, i: int) -> str:
        """Return a condition and the results that depend on it as text."""
        return f"{self.text(i)} ({', '.join(sorted(self.all[i].effects))})"


_POSE = 16
"""Number of entries of a pose."""

_LONGEST = 60
"""Maximum length of the text of a condition."""


def searched(
    branches: Branches, chosen: Sequence[int], state: Array, limits: Array, refused: bool = False
) -> list[Array]:
    """Return, for each chosen condition, states within reach where it has the answer that it has at no drawn state.

    Each search goes along the gradient of the margin, from the states with the smallest ones.

    Args:
        branches: the conditions.
        chosen: indices of those with one answer.
        state: drawn states (n, k) within reach.
        limits: lowest and highest values (n, 2) of the state.
        refused: whether the other answer leaves no value: then the states that are returned have none.

    Returns:
        for each chosen condition: states (n, j); j is 0 if none was found.
    """
    margin = ca.vertcat(*[branches.all[i].margin for i in chosen])
    margins = ca.Function("margin", [branches.state], [margin])(state).full()
    found = []
    for row, i in enumerate(chosen):
        sizes = np.abs(margins[row])
        nearest = np.argsort(np.where(np.isfinite(sizes), sizes, np.inf))[:_STARTS]
        answer = bool(branches.all[i].has(True, margins[row][nearest[:1]])[0])
        found.append(_beyond(branches, i, answer, state[:, nearest], limits, refused))
    return found


def _beyond(branches: Branches, i: int, answer: bool, state: Array, limits: Array, refused: bool) -> Array:
    """Return states (n, j) where a condition does not have an answer, found from given states; see `searched`."""
    branch = branches.all[i]
    margin = branch.margin
    gradient = ca.Function("gradient", [branches.state], [margin, ca.jacobian(margin, branches.state)])
    n, starts = state.shape
    sign = 1.0 if answer else -1.0
    x = np.repeat(state, len(_BEYOND), axis=1)
    function = gradient.map(x.shape[1])
    kept: list[Array] = []
    most = _KEPT_REFUSED if refused else _KEPT
    aim = None
    for _ in range(_STEPS):
        value, jacobian = (matrix.full() for matrix in function(x))
        passed = np.isfinite(value[0]) & branch.has(not answer, value[0])
        value = sign * value[0]
        slope = sign * jacobian[0].reshape(x.shape[1], n).T
        if aim is None:
            aim = np.tile(_BEYOND, starts) * np.abs(value)
        if refused:
            kept += list(x[:, passed].T)
        elif passed.any():
            finite, reach = branches.judged(x)
            candidates = x[:, passed & finite & reach]
            steady = _steady(gradient, branch, not answer, candidates, limits)
            kept += list(candidates[:, steady].T)
        if len(kept) >= most:
            break
        size = (slope**2).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -(value + aim) / size * slope
        x = np.clip(x + np.where(np.isfinite(step), step, 0.0), limits[:, :1], limits[:, 1:])
    return np.array(kept[:most]).reshape(-1, n).T


def _steady(gradient: ca.Function, branch: Branch, answer: bool, state: Array, limits: Array) -> Truths:
    """Return which states (n, k) have an answer at all states near them that may be judged in their place."""
    steady = np.ones(state.shape[1], bool)
    width = NEAR_PART * (limits[:, 1:] - limits[:, :1])
    generator = np.random.default_rng(0)
    for _ in range(_NEIGHBOURS):
        moved = state + width * generator.uniform(-0.05, 1, state.shape)
        margin, _ = gradient(np.clip(moved, limits[:, :1], limits[:, 1:]))
        steady &= branch.has(answer, margin.full()[0])
    return steady


def _of(names: Sequence[str], results: Sequence[ca.SX], name: str) -> list[ca.SX]:
    """Return the results of a name as a list; an empty one if there is none."""
    if name not in names:
        return []
    return [results[names.index(name)]]


def _walked(formula: Formula, outcome: Outputs, inputs: Sequence[ca.SX]) -> tuple[list[ca.SX], list[Branch]]:
    """Return outputs of the equations as expressions of inputs, and the conditions in them."""
    function = outcome.function
    needed = [k for k, name in enumerate(outcome.names) if name in ("pose", "joints", "reach")]
    memory: dict[int, ca.SX] = {}
    truths: dict[int, tuple[int, bool]] = {}  # {place: (instruction of a condition, whether it is negated)}
    margins: dict[int, ca.SX] = {}
    used: set[int] = set()
    at_zero: dict[int, bool | None] = {}
    outputs = [ca.SX.zeros(function.sparsity_out(k)) for k in range(function.n_out())]

    def margin_of(place: int) -> ca.SX:
        if place not in truths:
            return ca.fabs(memory[place])
        instruction, negated = truths[place]
        return -margins[instruction] if negated else margins[instruction]

    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        targets = function.instruction_output(k)
        if operation == ca.OP_CONST:
            memory[targets[0]] = ca.SX(function.instruction_constant(k))
            truths.pop(targets[0], None)
            continue
        sources = function.instruction_input(k)
        if operation == ca.OP_INPUT:
            memory[targets[0]] = inputs[sources[0]][sources[1]]
            truths.pop(targets[0], None)
            continue
        if operation == ca.OP_OUTPUT:
            outputs[targets[0]].nz[targets[1]] = memory[sources[0]]
            continue
        operands = [memory[place] for place in sources]
        condition: tuple[int, bool] | None = None
        if operation in _MARGINS:
            margins[k] = _MARGINS[operation](*operands)
            at_zero[k] = operation in (ca.OP_LE, ca.OP_EQ)
            condition = (k, False)
        elif operation == ca.OP_NOT and sources[0] in truths:
            instruction, negated = truths[sources[0]]
            condition = (instruction, not negated)
        elif operation in (ca.OP_AND, ca.OP_OR):
            smaller = ca.fmin if operation == ca.OP_AND else ca.fmax
            margins[k] = smaller(*[margin_of(place) for place in sources])
            condition = (k, False)
        else:
            used.update(truths[place][0] for place in sources if place in truths)
        if operation in _CHOOSING:
            margins[k] = _CHOOSING[operation](*operands)
            at_zero[k] = None if operation == ca.OP_COPYSIGN else False
            used.add(k)
        if operation == ca.OP_IF_ELSE_ZERO and sources[0] not in truths:  # a number is a condition: false where it is 0
            margins[k] = ca.fabs(operands[0])
            at_zero[k] = False
            used.add(k)
        if len(operands) == 1:
            memory[targets[0]] = ca.SX.unary(operation, *operands)
        else:
            memory[targets[0]] = ca.SX.binary(operation, *operands)
        truths.pop(targets[0], None)
        if condition is not None:
            truths[targets[0]] = condition
    undefined = _undefined(function, needed, used)
    effects = _effects(formula, outcome, used)
    found = [Branch(margins[k], at_zero.get(k), undefined[k], effects[k]) for k in sorted(used)]
    return outputs, found


def _effects(formula: Formula, outcome: Outputs, used: Collection[int]) -> dict[int, frozenset[str]]:
    """Return, for each condition, the names of the results that depend on it."""
    function = outcome.function
    sources_of: dict[int, set[int]] = {}  # {place: conditions on which it depends}
    found: dict[int, set[str]] = {k: set() for k in used}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        targets = function.instruction_output(k)
        conditions: set[int] = set()
        if operation not in (ca.OP_CONST, ca.OP_INPUT):
            for place in function.instruction_input(k):
                conditions |= sources_of.get(place, set())
        if operation == ca.OP_OUTPUT:
            result = _result(formula, outcome.names[targets[0]], targets[1])
            for condition in conditions:
                found[condition].add(result)
            continue
        if k in found:
            conditions.add(k)
        sources_of[targets[0]] = conditions
    return {k: frozenset(names) for k, names in found.items()}


def _result(formula: Formula, output: str, entry: int) -> str:
    """Return the name of an entry of an output of the equations."""
    if output == "passive":
        return f"passive joint {formula.passive[entry]}"
    if output == "reach":
        return f"margin {list(formula.reach)[entry]}"
    if output == "measures":
        return f"measure {formula.measures[entry].name}"
    if output == "aspects":
        return f"aspect {formula.aspects[entry].symbol}"
    return output


def _undefined(function: ca.Function, needed: Collection[int], used: Collection[int]) -> dict[int, frozenset[bool]]:
    """Return, for each condition, its answers that leave nothing to judge; for the arguments see `_without_value`."""
    constants = [k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CONST]
    any_lost = any(np.isnan(function.instruction_constant(k)) for k in constants)
    found = {}
    for k in used:
        answers: list[bool] = []
        if any_lost and function.instruction_id(k) in (*_MARGINS, ca.OP_AND, ca.OP_OR):
            answers = [answer for answer in (False, True) if _without_value(function, needed, k, answer)]
        found[k] = frozenset(answers)
    return found


def _without_value(function: ca.Function, needed: Collection[int], condition: int, answer: bool) -> bool:
    """Return whether an answer of a condition leaves nothing to judge.

    So it is if a needed output is not a number then, or if none of the outputs that depend on the condition is one.

    Args:
        function: the equations.
        needed: outputs that are numbers within reach.
        condition: instruction of the condition.
        answer: its answer.
    """
    truths: dict[int, bool] = {}  # {place: its answer}, of places whose answer is known
    lost: set[int] = set()  # places that are not a number
    dependent: set[int] = set()  # places that depend on the condition
    with_value = 0
    without_value = 0
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        sources = [] if operation in (ca.OP_CONST, ca.OP_INPUT) else function.instruction_input(k)
        (target, *_) = function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            if target in needed and sources[0] in lost:
                return True
            if sources[0] in dependent:
                without_value += sources[0] in lost
                with_value += sources[0] not in lost
            continue
        is_lost = False
        known: bool | None = None
        if operation == ca.OP_CONST:
            is_lost = bool(np.isnan(function.instruction_constant(k)))
        elif k == condition:
            known = answer
        elif operation == ca.OP_NOT and sources[0] in truths:
            known = not truths[sources[0]]
        elif operation == ca.OP_IF_ELSE_ZERO:
            is_lost = truths.get(sources[0], False) and sources[1] in lost
        elif operation in _PASSING:
            is_lost = any(source in lost for source in sources)
        depends = k == condition or any(source in dependent for source in sources)
        if depends:
            dependent.add(target)
        else:
            dependent.discard(target)
        lost.discard(target)
        truths.pop(target, None)
        if is_lost:
            lost.add(target)
        if known is not None:
            truths[target] = known
    return without_value > 0 and not with_value


_PASSING = (
    *(ca.OP_ASSIGN, ca.OP_NEG, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV),
    *(ca.OP_SQRT, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN, ca.OP_ATAN2, ca.OP_FABS),
)
"""Operations whose result is not a number if an operand is none."""


_MARGINS = {
    ca.OP_LT: lambda a, b: b - a,
    ca.OP_LE: lambda a, b: b - a,
    ca.OP_EQ: lambda a, b: -ca.fabs(a - b),
    ca.OP_NE: lambda a, b: ca.fabs(a - b),
}
"""Margins of comparisons, positive where they are true."""

_CHOOSING = {
    ca.OP_FABS: lambda a: a,
    ca.OP_FMIN: lambda a, b: b - a,
    ca.OP_FMAX: lambda a, b: a - b,
    ca.OP_COPYSIGN: lambda a, b: b,
}
"""Margins of operations that choose by themselves."""


def bounded(branches: Branches, chosen: Sequence[int], answers: Sequence[bool], limits: Array) -> set[int]:
    """Return those of the chosen conditions that have their answers at all states within limits.

    The range of the state is halved along one coordinate after the other, until the margins have bounds with one sign.

    Args:
        branches: the conditions.
        chosen: indices of conditions.
        answers: the answer of each of them.
        limits: lowest and highest values (n, 2) of the state.
    """
    margins = ca.vertcat(*[branches.all[i].margin for i in chosen])
    function = IntervalFunction(ca.Function("margins", [branches.state], [margins]))
    n = len(limits)
    low, high = np.array(limits.T[0])[:, None], np.array(limits.T[1])[:, None]
    open_at = {k: np.ones(1, bool) for k in range(len(chosen))}
    for turn in range(_HALVINGS * n):
        state = [intervals.between(low[i], high[i]) for i in range(n)]
        (found,) = function([state])
        for k in list(open_at):
            right = branches.all[chosen[k]].has(answers[k], found[k])
            open_at[k] &= ~np.broadcast_to(right, low.shape[1:])
        closed = {k for k, where in open_at.items() if not where.any()}
        keep = np.zeros(low.shape[1], bool)
        for k in set(open_at) - closed:
            keep |= open_at[k]
        if not keep.any() or 2 * keep.sum() > MOST_BOXES:
            return {chosen[k] for k in closed}
        i = turn % n
        low, high = low[:, keep], high[:, keep]
        middle = (low[i] + high[i]) / 2
        below, above = np.array(high), np.array(low)
        below[i] = middle
        above[i] = middle
        low, high = np.hstack([low, above]), np.hstack([below, high])
        open_at = {k: np.tile(where[keep], 2) for k, where in open_at.items()}
    return {chosen[k] for k, where in open_at.items() if not where.any()}


@dataclass(frozen=True)
class BranchReport:
    """The conditions of the equations, and how it is known that all their answers were judged.

    Attributes:
        count: number of conditions.
        drawn: those with both answers at drawn states.
        undefined: those with one answer, because the equations have no value at the other.
        bounded: those with one answer at all states within the limits, by intervals.
        found: those whose other answer was found by a search, at states that were judged then.
        open: texts of those with one answer at all drawn states, and their smallest margin; nothing else is known.
        unfound: those with one answer at all drawn states whose other answer no search found, on which nothing depends
            of which anything is claimed: they are among the silent ones.
        silent: texts of those with an answer that few drawn states have, or none, on which nothing depends of which
            anything is claimed; those of them that are not among the unfound are among the drawn or found.
        states: {name: values (j,)} at the states that were found, and at those with rare answers.
        refused: {name: values (j,)} at states that a search found, where a condition leaves no value.
        without_value: {name: value} at a state within reach where the equations have no value; empty if there is none.
    """

    count: int
    drawn: int
    undefined: int
    bounded: int
    found: int
    unfound: int
    open: tuple[str, ...]
    silent: tuple[str, ...]
    states: Mapping[str, Array]
    refused: Mapping[str, Array]
    without_value: Mapping[str, float]

    @property
    def unjudged(self) -> int:
        """Number of conditions in no category, because no drawn state is within reach."""
        return self.count - self.drawn - self.undefined - self.bounded - self.found - self.unfound - len(self.open)


def examined(
    branches: Branches, state: Array, published: Array, limits: Array, unclaimed: Collection[str]
) -> BranchReport:
    """Return what is known of all conditions, from drawn states (n, k) within limits (n, 2).

    `unclaimed` are the results of which nothing is claimed; for their names see `Branch.effects`.

    `published` (n, k) are the same states with the published parameters. Only there, a state without a value is a fault
    of the equations: with other lengths, the mechanism itself may not reach it, and no margin may say so.
    """
    finite, reach = branches.judged(published)
    without_value = {}
    if (reach & ~finite).any():
        place = int(np.argmax(reach & ~finite))
        without_value = {name: float(x) for name, x in zip(branches.names, published[:, place], strict=True)}
    finite, reach = branches.judged(state)
    state = state[:, finite & reach]
    empty = {name: np.zeros(0) for name in branches.names}
    if not branches.all or not state.shape[1]:
        return BranchReport(len(branches.all), 0, 0, 0, 0, 0, (), (), empty, empty, without_value)
    margins = branches.margins(state).full()
    single: dict[int, bool] = {}
    undefined: list[int] = []
    rare: list[Array] = []
    silent: list[str] = []
    for i, branch in enumerate(branches.all):
        true = branch.has(True, margins[i])
        if not true.all() and true.any():
            # the claims were judged at other states: an answer that is rare may not be among those
            fewer = true if true.sum() <= (~true).sum() else ~true
            if fewer.sum() < _RARE:
                rare.append(state[:, fewer][:, :_KEPT])
                if branch.only_affects(unclaimed):
                    silent.append(branches.effect(i))
            continue
        if bool(not true[0]) in branch.undefined:
            undefined.append(i)
            if branch.only_affects(unclaimed) and not branch.refuses:
                silent.append(branches.effect(i))
        else:
            single[i] = bool(true[0])
    drawn = len(branches.all) - len(undefined) - len(single)
    sure: set[int] = set()
    if single:
        sure = bounded(branches, list(single), list(single.values()), limits)
    rest = [i for i in single if i not in sure]
    found = searched(branches, rest, state, limits) if rest else []
    texts = []
    unfound = 0
    for i, other in zip(rest, found, strict=True):
        if branches.all[i].only_affects(unclaimed):
            silent.append(branches.effect(i))
            unfound += not other.shape[1]
        elif not other.shape[1]:
            texts.append(f"{branches.text(i)} (margin {np.abs(margins[i]).min():.2g} or more)")
    columns = np.hstack([np.zeros((len(limits), 0)), *rare, *found])
    states = dict(zip(branches.names, columns, strict=True))
    count = len(branches.all)
    number_found = sum(other.shape[1] > 0 for other in found)
    # a condition without another answer within reach may leave no value, in a way that is not seen in the operations
    lost = undefined + [i for i, other in zip(rest, found, strict=True) if not other.shape[1]]
    refusing = searched(branches, lost, state, limits, refused=True) if lost else []
    columns = np.hstack([np.zeros((len(limits), 0)), *refusing])
    if columns.shape[1]:
        finite, reach = branches.judged(columns)
        columns = columns[:, ~(finite & reach)]
    refused = dict(zip(branches.names, columns, strict=True))
    known = (count, drawn, len(undefined), len(sure), number_found, unfound)
    return BranchReport(*known, tuple(texts), tuple(silent), states, refused, without_value)
