"""Parts of an explanation as plain data: wrong rows, repairs, fitted numbers, conventions, faulty parts of the CAD.

The names of the fields are the keys of the JSON that `twin explain` writes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WrongRow:
    """One wrong row (assignment) of the formula.

    Attributes:
        equation, variant, symbol: equation and variant of the row, and the symbol it computes.
        file, line: place of the row.
        term: summand of the row that the best repair changes; "" if there is none.
        means: meaning of the symbol: a named point, a joint or the tool pose.
        off: largest difference, in `unit` ("mm" or "deg").
        share: fraction of the judged poses at which the row is wrong.
        worst_at, least_at: poses with the largest and the smallest difference, as text.
        why: explanation of a wrong margin (reach, singularity measure, aspect; `off` may be NaN); "" for other rows.
    """

    equation: str
    variant: str
    symbol: str
    file: str
    line: int
    text: str
    means: str
    off: float
    unit: str
    share: float
    worst_at: str
    least_at: str
    term: str = ""
    why: str = ""


@dataclass(frozen=True)
class Change:
    """One edit, with its source line before the edit and after all edits."""

    file: str
    line: int
    edit: str
    kind: str
    before: str
    after: str


@dataclass(frozen=True)
class Reading:
    """Edits that together make the rows agree.

    Attributes:
        changes: one or two edits.
        diff: all edits as one unified diff, including new definitions.
        note: further changes to make manually, or "".
        dropped: symbols on which a row no longer depends after the edits.
    """

    changes: tuple[Change, ...]
    diff: str
    note: str = ""
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Repair:
    """A repair of rows of a formula.

    Attributes:
        rows: the fixed rows, as "eq1.X_S1".
        before, after: worst residual of these rows before and after the repair, in units of the tolerance.
        margin: worst residual of the runner-up divided by the worst residual of the repair; 0 without a repair.
        runner_up: text with an edit and its residual; of all edits that do not fix the rows, this edit has the smallest
            residual.
        cures: the possible repairs. Cures result in different functions, which agree at all judged poses. Each cure is
            a tuple of readings: different edits that result in the same function, which no pose can distinguish.
        tie: why the data do not determine one repair, or "".
        tried: number of edits tried.
        complete: whether every edit that the search can generate was tried.
        seconds: duration of the search for pairs of edits in s; 0 if one edit is exact.
        note: further remarks, mainly if there is no repair.
        proofs: what a prover says of the equations after each cure; empty if none was asked.
    """

    rows: tuple[str, ...]
    before: float
    after: float
    margin: float
    runner_up: str
    cures: tuple[tuple[Reading, ...], ...]
    tie: str
    tried: int
    complete: bool
    note: str = ""
    seconds: float = 0.0
    proofs: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChangedParameter:
    """A parameter whose changed value explains the differences.

    Attributes:
        name, unit: name of the parameter, and unit of its values.
        formula, fitted, sigma: value in the formula, value fitted to the mechanism, and its standard deviation.
        note: probable mistake, such as "looks like metres instead of millimetres", or "".
    """

    name: str
    unit: str
    formula: float
    fitted: float
    sigma: float
    note: str = ""


@dataclass(frozen=True)
class FittedParameters:
    """Parameters fitted to the mechanism.

    Attributes:
        exact: whether the fitted values make all rows agree.
        before, after: worst residual before and after the fit, in units of the tolerance.
        moved: the parameters whose changes explain the differences.
        alternatives: whether each entry of `moved` alone explains the differences; otherwise, all together do.
        blind: combinations of parameters on which no row depends.
        covariance: (n, n) covariance of the fitted parameters, in SI.
        names: names (n) of the fitted parameters.
    """

    exact: bool
    before: float
    after: float
    moved: tuple[ChangedParameter, ...]
    alternatives: bool
    blind: tuple[str, ...]
    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Convention:
    """A convention under which formula and mechanism agree.

    Attributes:
        kind: "euler", "unit", "sign", "offset", "axes", "handedness", "dh".
        message: one sentence.
        rows: the fixed rows.
        after: worst remaining residual, in units of the tolerance.
    """

    kind: str
    message: str
    rows: tuple[str, ...]
    after: float


@dataclass(frozen=True)
class FaultyPart:
    """A faulty part of the CAD: it causes gaps between the parts of some joints.

    Attributes:
        joints: names of the joints whose parts do not meet.
        part, features: the faulty part and its faulty features; "" and () if no single part causes all the gaps.
        told_by: kind of evidence that this part is faulty. "drawing": lengths or identical parts; "joints": the other
            part of the joint fits at all further joints; "loops": the loops close only if this part is corrected;
            "rows": the rows agree only if this part is corrected; "": undecided between this part and `others`.
        why: the evidence, as text.
        others: alternative parts.
        message: the result in one sentence.
    """

    joints: tuple[str, ...]
    part: str
    features: tuple[str, ...]
    told_by: str
    why: tuple[str, ...]
    others: tuple[str, ...]
    message: str
