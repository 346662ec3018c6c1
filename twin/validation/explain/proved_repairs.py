"""Ask a prover about repairs: whether each one is an identity, and whether repairs that look different are one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Protocol

from twin.formula.contract import Formula
from twin.validation.explain.candidate import Candidate, GroupResult
from twin.validation.explain.formula_state import edited_formula
from twin.validation.explain.function_source import Edit

_MOST = 6
"""Maximum number of repairs of one group of rows that are proved: each is a proof of the whole formula."""


@dataclass(frozen=True)
class ProofOfRepair:
    """What a prover says of a repaired formula.

    Attributes:
        text: the verdict as text, as "identity, proved".
        proved: whether all claims about the formula are proved.
    """

    text: str
    proved: bool


class RepairProver(Protocol):
    """Proves repaired formulas; it is no part of the judge, which compares numbers."""

    def proof(self, formula: Formula) -> ProofOfRepair:
        """Return the verdict on a repaired formula."""
        ...

    def same(self, first: Formula, second: Formula) -> bool:
        """Return whether two repaired formulas, all of whose claims are proved, have the same values at every pose."""
        ...


@dataclass(frozen=True)
class ProvedResult:
    """The result of a search with proofs.

    Attributes:
        found: the result; cures that are proved to be one function are merged.
        proofs: the verdict on each cure.
        merged: for each cure, whether it is made of several that differ for other dimensions of the mechanism.
    """

    found: GroupResult
    proofs: tuple[str, ...] = ()
    merged: tuple[bool, ...] = ()


def proved(formula: Formula, found: Sequence[GroupResult], prover: RepairProver | None) -> list[ProvedResult]:
    """Return the results of a search with the verdict on each cure; without a prover, as they are.

    A cure is proved together with the first cure of each other group: only a formula without wrong rows is an identity.
    """
    if prover is None:
        return [ProvedResult(result) for result in found]
    results = []
    proofs = _Proofs(formula, prover)
    for result in found:
        others = [edit for other in found if other is not result for edit in _first_edits(other)]
        results.append(proofs.of(result, others))
    return results


def _first_edits(found: GroupResult) -> list[Edit]:
    """Return the edits of the first cure; none if there is no cure."""
    return _edits(found.cures[0]) if found.cures else []


def _edits(cure: Sequence[Candidate]) -> list[Edit]:
    """Return the edits of the first reading that keeps all left sides; of the first one if none does."""
    for reading in cure:
        if all(edit.kind != "left side" for edit in reading.edits):
            return reading.edits
    return cure[0].edits


class _Proofs:
    """The verdicts on the cures of all groups; the same edits together are proved once."""

    def __init__(self, formula: Formula, prover: RepairProver) -> None:
        self.formula = formula
        self.prover = prover
        self.known: dict[frozenset[Edit], ProofOfRepair] = {}

    def of(self, found: GroupResult, others: Sequence[Edit]) -> ProvedResult:
        """Return one result with its verdicts; `others` are the edits of the other groups."""
        groups: list[list[Candidate]] = []
        proofs: list[str] = []
        merged: list[bool] = []
        functions: list[tuple[int, Formula]] = []  # the group of each proved function, and a formula with it
        with ExitStack() as stack:  # the edited files exist while formulas are compared
            for k, cure in enumerate(found.cures):
                edited = None
                if k >= _MOST:
                    verdict = ProofOfRepair(f"not judged by the prover: only {_MOST} repairs of these rows are", False)
                else:
                    change = list(dict.fromkeys([*_edits(cure), *others]))
                    edited = stack.enter_context(edited_formula(self.formula, change))
                    verdict = self._verdict(edited, frozenset(change))
                if edited is not None and verdict.proved:
                    same = next((group for group, other in functions if self.prover.same(other, edited)), None)
                    if same is not None:
                        groups[same] = [*groups[same], *cure]
                        merged[same] = True
                        continue
                    functions.append((len(groups), edited))
                groups.append(cure)
                proofs.append(verdict.text)
                merged.append(False)
        return ProvedResult(replace(found, cures=groups), tuple(proofs), tuple(merged))

    def _verdict(self, edited: Formula | None, change: frozenset[Edit]) -> ProofOfRepair:
        if edited is None:
            return ProofOfRepair("not judged by the prover: the edit is not one of the formula's file alone", False)
        if change not in self.known:
            self.known[change] = self.prover.proof(edited)
        return self.known[change]
