"""What `explain` finds: plain data, ready for JSON and for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from twin.core.findings import EXIT_CODES, Finding, Verdict


@dataclass(frozen=True)
class Row:
    """One row of the formula that is off.

    Attributes:
        equation, variant, symbol: which.
        file, line: where it is written.
        text: the row. term: the part of it that the best repair touches, or "".
        means: the named point, joint or pose that the symbol is.
        off: worst difference; unit "mm" or "deg".
        share: part of the judged poses where it is off.
        worst_at, least_at: poses where it is off most and least.
        why: instead of a difference, for a row that is judged by where it vanishes (`off` is NaN, or in `unit`).
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
    """One edit, as people and tools need it: the line before, and as it reads when all is done."""

    file: str
    line: int
    edit: str
    kind: str
    before: str
    after: str


@dataclass(frozen=True)
class Reading:
    """Edits that, together, make the rows agree.

    Attributes:
        changes: one, or two; `after` of each is its line with all of them made.
        diff: all of them as one unified diff, with what they need defined.
        note: what else is to be done by hand, or "".
        dropped: symbols that a row depended on and does not after the edits.
    """

    changes: tuple[Change, ...]
    diff: str
    note: str = ""
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Repair:
    """How rows of a formula can be made to agree.

    Attributes:
        rows: symbols of the rows that it cures, "eq1.X_S1".
        before, after: worst residual of these rows as written and repaired, in units of the tolerance.
        margin: worst residual of the runner-up over that of the repair; 0 if there is no repair.
        runner_up: the edit that comes next, and what it leaves.
        ways: each a list of readings that are the same function; more than one way is a tie that the poses cannot
            settle, more than one reading of a way a tie that no pose can.
        tie: why the paper or the data do not settle which, or "".
        tried: how many edits.
        complete: whether every edit of the kinds known here was tried.
        seconds: how long pairs of edits were searched; 0 where one edit serves.
        note: what else is to be said, above all if there is no repair.
    """

    rows: tuple[str, ...]
    before: float
    after: float
    margin: float
    runner_up: str
    ways: tuple[tuple[Reading, ...], ...]
    tie: str
    tried: int
    complete: bool
    note: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Moved:
    """A parameter whose value explains the difference.

    Attributes:
        name, unit: of the parameter; the values below are in that unit.
        formula, fitted, sigma: value in the formula, value that fits the mechanism, its standard deviation.
        note: "metres for millimetres", say, or "".
    """

    name: str
    unit: str
    formula: float
    fitted: float
    sigma: float
    note: str = ""


@dataclass(frozen=True)
class Identified:
    """Parameters fitted to the mechanism.

    Attributes:
        exact: whether the fitted values make all rows agree.
        before, after: worst residual in units of the tolerance.
        moved: parameters that moved, each a way by itself if `alternatives`.
        alternatives: whether the entries of `moved` exclude each other.
        blind: combinations that the rows cannot tell apart.
        covariance: (n, n) of `names`, in SI.
        names: the parameters that were fitted.
    """

    exact: bool
    before: float
    after: float
    moved: tuple[Moved, ...]
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
        rows: what it cures.
        after: worst residual that is left, in units of the tolerance.
    """

    kind: str
    message: str
    rows: tuple[str, ...]
    after: float


@dataclass(frozen=True)
class PartOff:
    """Joints that do not meet in the drawing for one reason, and the part that is off.

    Attributes:
        joints: which.
        part, features: what is off, and where on it; "" if no single part explains it.
        told_by: "drawing" (lengths, parts that are alike), "joints" (those of the other part meet), "loops" (they
            close only so), "rows" (they hold only so), or "" if it cannot be told from `others`.
        why: what tells it.
        others: what else may be off.
        message: one sentence.
    """

    joints: tuple[str, ...]
    part: str
    features: tuple[str, ...]
    told_by: str
    why: tuple[str, ...]
    others: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Explanation:
    """The answer of `explain`.

    Attributes:
        robot, variants: what was judged.
        verdict: "agree": nothing to explain. "disagree": explained or not. "unchecked": something was not judged.
        explained: whether every row that is off has an exact repair, exact numbers or an exact convention, or holds
            with the corrected drawing.
        samples: poses that were judged.
        invariants: what must stay constant, close, be orthogonal or have the right dimension, and does not.
        rows: the rows that are off.
        repairs, identified, conventions: what would make them agree.
        notes: what was not judged, and why.
        judged, rows_of_formula: how many rows were judged, of how many.
        seconds: how long it took, by step.
        lead: what explains it: "drawing", "edits", "numbers", "edits or numbers" (as well the one as the other),
            "conventions", or "" if there is nothing to explain or no explanation.
        drawing: joints that do not meet in the CAD.
        parts: what is off in the CAD, if joints do not meet.
    """

    robot: str
    variants: Mapping[str, str]
    verdict: Verdict
    explained: bool
    samples: int
    invariants: tuple[Finding, ...]
    rows: tuple[Row, ...]
    repairs: tuple[Repair, ...] = ()
    identified: Identified | None = None
    conventions: tuple[Convention, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    lead: str = ""
    drawing: tuple[Finding, ...] = ()
    parts: tuple[PartOff, ...] = ()
    judged: int = 0
    rows_of_formula: int = 0

    @property
    def exit_code(self) -> int:
        """0 agree, 1 disagree, 2 could not check."""
        return EXIT_CODES[self.verdict]

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        out = asdict(self)
        out["findings"] = [f.as_dict() for f in (*self.drawing, *self.invariants)]
        return out
