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

_MOST_PROVED_CURES = 6
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
        result: the result of the search; cures that are proved to be one function are merged.
        proofs: the verdict on each cure.
        merged: for each cure, whether it is made of several that differ for other dimensions of the mechanism.
    """

    result: GroupResult
    proofs: tuple[str, ...] = ()
    merged: tuple[bool, ...] = ()


def with_proofs(formula: Formula, results: Sequence[GroupResult], prover: RepairProver | None) -> list[ProvedResult]:
    """Return the results of a search with the verdict on each cure; without a prover, as they are.

    A cure is proved together with the first cure of each other group: only a formula without wrong rows is an identity.
    """
    proved_results: list[ProvedResult] = []
    proofs: _Proofs | None = None
    if prover is not None:
        proofs = _Proofs(formula, prover)
    for result in results:
        if proofs is None:
            proved_results.append(ProvedResult(result))
            continue
        edits_of_others: list[Edit] = []
        for other_result in results:
            if other_result is not result and other_result.cures:
                edits_of_others += _provable_edits(other_result.cures[0])
        proved_results.append(proofs.of(result, edits_of_others))
    return proved_results


def _provable_edits(cure: Sequence[Candidate]) -> list[Edit]:
    """Return the edits of the first reading that keeps all left sides; of the first one if none does."""
    for reading in cure:
        kinds = [edit.kind for edit in reading.edits]
        if "left side" not in kinds:  # an edit of a left side is no edit of the file alone, and cannot be proved
            return reading.edits
    return cure[0].edits


class _Proofs:
    """The verdicts on the cures of all groups; the same edits together are proved once."""

    def __init__(self, formula: Formula, prover: RepairProver) -> None:
        self.formula = formula
        self.prover = prover
        self._verdicts: dict[frozenset[Edit], ProofOfRepair] = {}

    def of(self, result: GroupResult, edits_of_others: Sequence[Edit]) -> ProvedResult:
        """Return one result with its verdicts; `edits_of_others` are those of the first cures of the other groups."""
        cures: list[list[Candidate]] = []
        proofs: list[str] = []
        merged: list[bool] = []
        functions: list[tuple[int, Formula]] = []  # the index of the cure of each proved function, and its formula
        with ExitStack() as stack:  # the edited files exist while formulas are compared
            for n, cure in enumerate(result.cures):
                edited = None
                if n >= _MOST_PROVED_CURES:
                    verdict = ProofOfRepair(
                        f"not judged by the prover: only {_MOST_PROVED_CURES} repairs of these rows are", False
                    )
                else:
                    change = list(dict.fromkeys([*_provable_edits(cure), *edits_of_others]))
                    edited = stack.enter_context(edited_formula(self.formula, change))
                    verdict = self._verdict(edited, frozenset(change))
                if edited is not None and verdict.proved:
                    same_cure = self._index_of_same(functions, edited)
                    if same_cure is not None:
                        cures[same_cure] = [*cures[same_cure], *cure]
                        merged[same_cure] = True
                        continue
                    functions.append((len(cures), edited))
                cures.append(cure)
                proofs.append(verdict.text)
                merged.append(False)
        return ProvedResult(replace(result, cures=cures), tuple(proofs), tuple(merged))

    def _index_of_same(self, functions: Sequence[tuple[int, Formula]], edited: Formula) -> int | None:
        """Return the index of the cure whose proved formula has the same values as another; None if there is none."""
        for i, formula in functions:
            if self.prover.same(formula, edited):
                return i
        return None

    def _verdict(self, edited: Formula | None, change: frozenset[Edit]) -> ProofOfRepair:
        """Return what the prover says of a formula after edits; None cannot be judged by it."""
        if edited is None:
            return ProofOfRepair("not judged by the prover: the edit is not one of the formula's file alone", False)
        if change not in self._verdicts:
            self._verdicts[change] = self.prover.proof(edited)
        return self._verdicts[change]
