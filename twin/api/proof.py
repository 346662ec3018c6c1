"""Prove that the equations of a robot agree with its mechanism at all poses."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.robot import Robot
from twin.api.robot_loading import loaded
from twin.core.errors import TwinError
from twin.core.findings import Finding, by_severity, disagreement, error, info, warning
from twin.core.format import EXACT_BELOW
from twin.core.json_types import JsonObject
from twin.core.progress import Progress, silent
from twin.core.quantity import Quantity
from twin.core.result import Part, Result, TextTable

if TYPE_CHECKING:
    from twin.api.motion_proof import ProvedMotion
    from twin.proof.branch_report import BranchReport
    from twin.proof.claims import JudgedClaim
    from twin.proof.prove import Proof
    from twin.proof.refused_states import RefusedStates

STATES = 4096
"""Number of random states at which each claim is judged."""

MOST_STATES = 1_000_000
"""Maximum number of states: each needs about 100 kB of memory while an equation is repeated."""

_FEWEST_STATES = 64

_SHOWN_TERMS = 6
"""Maximum number of terms of an error that a finding shows: a longer one would not be read."""

_LONGEST_NAME = 100

_NAMED_CLAIMS = 4
"""Number of claims that are named together if they are not proved for one reason."""


@dataclass(frozen=True)
class Proved(Result):
    """The claims about a robot: proved, refuted with a witness, or not proved with the reason.

    Attributes:
        robot: name of the robot.
        variants: the chosen variant of each equation.
        proof: the claims.
        files: {file of equations or mechanism: SHA-256 of its bytes}; empty for a robot without files.
        findings: a disagreement for each refuted claim, an error for each reason why claims are not proved.
        motions: what is proved along protocols; empty if none was asked for.
    """

    robot: str
    variants: Mapping[str, str]
    proof: Proof
    files: Mapping[str, str]
    findings: tuple[Finding, ...]
    motions: tuple[ProvedMotion, ...] = ()

    kind = "prove"

    @property
    def word(self) -> str:
        """The verdict as text."""
        return {"agree": "Proved", "disagree": "Refuted", "unchecked": "Not proved"}[self.verdict]

    @property
    def summary(self) -> str:
        """How many claims are proved, and what the proofs rest on."""
        proof = self.proof
        count = len(proof.claims)
        text = f"{proof.count('proved')} of {count} claims are proved for all poses"
        if proof.arbitrary_parameters:
            text += f" and for all values of {', '.join(proof.arbitrary_parameters)}"
        if proof.published_angles:
            text += f", for the published values of {', '.join(proof.published_angles)}"
        for motion in self.motions:
            proved = motion.proof.count("proved")
            text += f"; {proved} of {len(motion.proof.claims)} are proved at every moment of {motion.protocol}"
        return text

    def content(self) -> JsonObject:
        """Return the claims as plain data."""
        proof = self.proof
        return {
            "robot": self.robot,
            "variants": dict(self.variants),
            "states": proof.states,
            "within_reach": proof.within_reach,
            "refused_states": _record_of_refused(proof.refused_states),
            "conditions": _conditions(proof),
            "arbitrary_parameters": list(proof.arbitrary_parameters),
            "published_angles": list(proof.published_angles),
            "largest_rounding_of_cad": proof.largest_rounding,
            "recognised_lengths": dict(proof.recognised_lengths),
            "near_numbers": dict(proof.near_numbers),
            "uncovered_bodies": list(proof.uncovered_bodies),
            "uncovered_points": list(proof.uncovered_points),
            "uncovered_values": list(proof.uncovered_values),
            "claims": list(map(_record, proof.claims)),
            "motions": [motion.record() for motion in self.motions],
        }

    def certificate(self) -> JsonObject:
        """Return the certificate of the proved claims, which docs/check_certificate.py checks without twin."""
        from twin.proof.certificate import certificate

        entries = [motion.entry() for motion in self.motions]
        return certificate(self.proof, self.robot, self.variants, self.files, entries)

    def write(self, folder: Path) -> None:
        """Write the certificate, and one of each protocol."""
        text = json.dumps(self.certificate(), ensure_ascii=True, allow_nan=False)
        (folder / "certificate.json").write_text(text, encoding="ascii")
        files = motion_files([motion.protocol for motion in self.motions])
        for file, motion in zip(files, self.motions, strict=True):
            if motion.certificate is not None:  # none if nothing is proved along this protocol
                # up to thousands of pieces: without blanks
                text = json.dumps(motion.certificate, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
                (folder / file).write_text(text, encoding="ascii")

    def _claims_table(self) -> TextTable:
        """Return the claims as a table: verdict, exact zeros, odds that a proof is chance, and largest difference."""
        rows = []
        for claim in self.proof.claims:
            odds = "-"
            if claim.status == "proved":
                odds = f"1e{math.ceil(claim.log10_odds)}"
            largest_text = "rounding"
            if claim.status == "refuted" or claim.largest >= EXACT_BELOW:
                # refuted by exact numbers alone, where floating point has no value
                largest_text = "no value"
                if claim.largest:
                    largest_text = str(_size_of(claim))
            rows.append((claim.name, claim.status, f"{claim.exact_zeros}/{claim.exact_states}", odds, largest_text))
        return TextTable(("claim", "verdict", "exact zeros", "odds of chance", "largest"), rows)

    def text(self) -> Iterator[Part]:
        """Yield the table of the claims, what they rest on, the findings and the verdict."""
        yield f"{self.robot}: claims about its equations and its mechanism"
        yield self._claims_table()
        for motion in self.motions:
            yield ""
            yield f"{motion.protocol}, at every moment of {motion.proof.duration:.3f} s"
            yield motion.table()
        yield ""
        yield from by_severity(self.findings)
        proof = self.proof
        yield f"  {self.summary}"
        text = f"  {100 * proof.within_reach:.3g} % of the drawn states are within reach and have values"
        if proof.within_reach < 1 or (proof.refused_states is not None and proof.refused_states.compared):
            text += f"; {_of_refused(proof.refused_states)}"
        yield text
        yield f"  numbers of the CAD differ from their exact forms by at most {proof.largest_rounding:.1e} m or rad"
        report = proof.branches
        if report is not None and report.count:
            yield f"  {_known(report)}"
        left_out = []
        for claim in proof.claims:
            if claim.status == "proved" and not claim.nodes:
                left_out.append(claim.name)
        if left_out:
            yield f"  the certificate leaves out {', '.join(left_out)}: a half angle is in them"
        if proof.uncovered_bodies:
            yield f"  no claim covers {', '.join(proof.uncovered_bodies)}: the equations do not move them"
        if proof.uncovered_points:
            points = ", ".join(proof.uncovered_points)
            yield f"  no claim covers {points} of the equations: no placed body of the CAD has this point"
        if proof.uncovered_values:
            yield (
                f"  no claim covers the values of {_listed(proof.uncovered_values)}: the mechanism does not determine "
                "them; of a margin, the sign says where the claims hold"
            )
        refuted = proof.count("refuted")
        unproved = proof.count("unproved")
        for motion in self.motions:
            refuted += motion.proof.count("refuted")
            unproved += motion.proof.count("unproved")
        agreement = "PROVED: the equations agree with the mechanism at all poses"
        if proof.within_reach < 1:
            agreement += " within reach of the equations"
        uncovered_count = len(proof.uncovered_values) + len(proof.uncovered_points)
        if uncovered_count:
            agreement += f", but for {uncovered_count} values without a claim"
        if self.motions:
            agreement += ", and the protocols keep their limits at every moment"
        words = {
            "agree": agreement,
            "disagree": f"REFUTED: {refuted} claims are wrong",
            "unchecked": f"NOT PROVED: {unproved} claims are neither proved nor refuted",
        }
        yield f"\n  {words[self.verdict]} (exit code {self.exit_code})"


def prove(
    robot: Robot | str | Path,
    variants: Mapping[str, str] | str | None = None,
    states: int = STATES,
    seed: int = 0,
    progress: Progress = silent,
    *,
    protocols: Sequence[str | Path] = (),
    clearance: bool = True,
) -> Proved:
    """Prove that the equations of a robot agree with its mechanism at all poses, or find a pose where they do not.

    Args:
        robot: a robot, its name or its folder.
        variants: {equation: variant}, or one variant for all equations that have it.
        states: number of random states.
        seed: of the random states.
        progress: see `Progress`.
        protocols: names or paths of protocols, along which limits, speeds, RCM, loops and clearance are proved at every
            moment.
        clearance: whether distances between bodies are among these; their shapes need a minute the first time.

    Raises:
        TwinError: the robot has no equations, the number of states is out of range, a protocol does not exist or cannot
            be planned, or a phase of it is a table of samples.

    Examples:
        >>> import twin
        >>> twin.prove("pa10", states=2000).verdict
        'agree'
    """
    from twin.api.motion_proof import prove_motion
    from twin.formula import variant_choice
    from twin.proof.prove import prove as prove_formula

    if not _FEWEST_STATES <= states <= MOST_STATES:
        raise TwinError(f"{states} states: give {_FEWEST_STATES} to {MOST_STATES}")
    robot = loaded(robot)
    chosen = variant_choice.choose(robot.formula, variants)
    proof = prove_formula(robot.formula, chosen, robot.mechanism, states, seed, progress)
    if not proof.claims:
        raise TwinError(
            f"{robot.name}: nothing can be claimed, because the equations give no joint between placed bodies; "
            "give the passive joints in the formula"
        )
    findings = _findings(proof)
    motions = []
    for protocol in protocols:
        motion = prove_motion(robot, protocol, clearance=clearance, progress=progress)
        motions.append(motion)
        findings += motion.findings
    return Proved(robot.name, chosen, proof, robot.hashes(), tuple(findings), tuple(motions))


def motion_files(protocols: Sequence[str]) -> list[str]:
    """Return the file name of the certificate of each protocol, given their names; no two files are the same.

    Characters other than letters, digits, "-" and "_" become "_", and only the first 100 are kept: the name of a
    protocol is any text, and must not lead to another folder.
    """
    names_of_files: list[str] = []
    used_names: set[str] = set()
    for protocol in protocols:
        plain = re.sub(r"[^A-Za-z0-9_-]", "_", protocol)[:_LONGEST_NAME]
        name = f"motion-{plain}"
        count = 1
        while name.lower() in used_names:  # some file systems do not distinguish capitals
            count += 1
            name = f"motion-{plain}-{count}"
        used_names.add(name.lower())
        names_of_files.append(f"{name}.json")
    return names_of_files


def _listed(values: Sequence[str]) -> str:
    """Return names such as "margin arm" by their kinds, as "margins 'arm', 'shaft'; measures 'elbow'"."""
    texts = []
    for kind in dict.fromkeys(map(_kind_of, values)):
        names = []
        for value in values:
            if _kind_of(value) == kind:
                name = value.removeprefix(f"{kind} ")
                names.append(f"'{name}'")  # in quotes, because names have commas
        texts.append(f"{kind}s {', '.join(names)}")
    return "; ".join(texts)


_UNCLAIMED_KINDS = ("passive joint", "margin", "measure", "aspect")
"""Kinds of values of equations that no claim covers: the first words of their names."""


def _kind_of(value: str) -> str:
    """Return the kind at the beginning of a name such as "margin arm"."""
    for kind in _UNCLAIMED_KINDS:
        if value.startswith(kind):
            return kind
    raise AssertionError(f"'{value}' has none of the kinds {', '.join(_UNCLAIMED_KINDS)}")


def _findings(proof: Proof) -> list[Finding]:
    """Return a finding for each refuted claim, and for each reason why claims are not proved."""
    findings = []
    open_claims: dict[str, list[str]] = {}
    for claim in proof.claims:
        if claim.status == "refuted":
            findings.append(_refuted(claim, proof.arbitrary_parameters))
        elif claim.status == "unproved":
            open_claims.setdefault(claim.reason, []).append(claim.name)
    finding_of_open = error
    if proof.count("refuted"):
        finding_of_open = warning  # the verdict is that of the refuted claims
    for reason, claims in open_claims.items():
        text = f"not proved: {', '.join(claims[:_NAMED_CLAIMS])}"
        if len(claims) > _NAMED_CLAIMS:
            text += f" and {len(claims) - _NAMED_CLAIMS} more"
        findings.append(finding_of_open("prove.open", claims[0], f"{text}; {reason}"))
    for number, form in list(proof.recognised_lengths.items())[:_NAMED_CLAIMS]:
        text = f"{number} of the CAD is taken as {form}; the number in the file stays as it is"
        findings.append(info("prove.number", number, text))
    for number, exact_form in list(proof.near_numbers.items())[:_NAMED_CLAIMS]:
        text = (
            f"{number} is {exact_form}, but for its last digit; it is taken as written: "
            "give more digits if that is meant"
        )
        findings.append(info("prove.near_number", number, text))
    return findings


def _size_of(claim: JudgedClaim) -> Quantity:
    """Return the largest difference of a claim in mm; directions count by the distance at half a metre."""
    return Quantity(claim.largest * 1e3, "mm")


def _refuted(claim: JudgedClaim, drawn: tuple[str, ...]) -> Finding:
    """Return the finding of a refuted claim, with the state where it is wrong."""
    # drawn parameters have no meaning for a reader: the claim is for all their values
    witness = []
    for name, value in claim.witness.items():
        if name not in drawn:
            witness.append(f"{name} = {value:.6g}")
    text = f"it is not so that {claim.sentence}"
    if claim.error_terms > _SHOWN_TERMS:
        text += f'; the error is a polynomial of {claim.error_terms} terms: see "error" with --json'
    elif claim.error:
        text += f"; the error is {claim.error}"
    if claim.fractions:
        fractions = []
        for name, value in claim.fractions.items():
            if name not in drawn:
                fractions.append(f"{name} = {value}")
        text += f"; it is wrong at these fractions too: {', '.join(fractions)}"
    size = None
    if claim.largest:
        size = _size_of(claim)
    return disagreement("prove.refuted", claim.name, text, size, when=", ".join(witness))


def _of_refused(refused: RefusedStates | None) -> str:
    """Return what the mechanism says of states that the equations refuse."""
    if refused is None or not refused.compared:
        return "that the mechanism cannot assemble at the others is not proved"
    beyond = refused.compared - refused.unknown - refused.reached
    text = f"of {refused.compared} others that were compared with the mechanism, {beyond} are beyond a limit of a joint"
    if refused.unknown:
        text += f", at {refused.unknown} no assembly was found"
    if refused.reached:
        text += f", and at {refused.reached} it can be assembled within all limits"
    return f"{text}: samples, not a proof"


def _record_of_refused(refused: RefusedStates | None) -> JsonObject | None:
    """Return what the mechanism says of states that the equations refuse as plain data."""
    if refused is None:
        return None
    return {
        "compared": refused.compared,
        "without_a_known_assembly": refused.unknown,
        "within_all_limits": refused.reached,
        "witness": dict(refused.witness),
    }


def _known(report: BranchReport) -> str:
    """Return how many conditions are in each category; each is in one."""
    text = (
        f"{report.count} conditions in the equations: both answers at drawn states {report.drawn}, no value "
        f"at the other {report.undefined}, one answer by intervals {report.bounded}, the other found by a "
        f"search {report.found}, open {len(report.open)}"
    )
    if report.unfound:
        text += f", one answer found, and no claim depends on it {report.unfound}"
    if report.unjudged:
        text += f", not judged because no drawn state is within reach {report.unjudged}"
    if report.silent:
        number = len(report.silent)
        text += f"; {number} of them have an answer that is rare or not found, and no claim depends on it"
    return text


def _conditions(proof: Proof) -> JsonObject | None:
    """Return what is known of the conditions in the equations as plain data."""
    report = proof.branches
    if report is None:
        return None
    return {
        "count": report.count,
        "both_answers_drawn": report.drawn,
        "no_value_at_the_other": report.undefined,
        "one_answer_by_intervals": report.bounded,
        "other_answer_found": report.found,
        "other_answer_not_found_without_a_claim": report.unfound,
        "open": list(report.open),
        "not_judged": report.unjudged,
        "silent": list(report.silent),
    }


def _record(claim: JudgedClaim) -> JsonObject:
    """Return a claim as plain data."""
    return {
        "name": claim.name,
        "claim": claim.sentence,
        "verdict": claim.status,
        "exact_zeros": claim.exact_zeros,
        "exact_states": claim.exact_states,
        "log10_odds": claim.log10_odds,
        "largest": claim.largest,
        "witness": dict(claim.witness),
        "witness_in_fractions": dict(claim.fractions),
        "reason": claim.reason,
        "error": claim.error,
        "error_terms": claim.error_terms,
    }
