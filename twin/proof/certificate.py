"""The certificate of a proof: the operations of every claim, for programs that share no code with the prover."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from itertools import islice

from twin.core.json_types import JsonObject
from twin.proof import program
from twin.proof.prove import Proof

SCHEMA = "twin/certificate/1"


def certificate(
    proof: Proof,
    robot: str,
    variants: Mapping[str, str],
    files: Mapping[str, str],
    motions: Sequence[JsonObject] = (),
) -> JsonObject:
    """Return the certificate of the claims that are proved, as plain data.

    Its rows are operations on exact numbers. A claim names the rows that are zero at all states: whoever repeats the
    operations at random states, with any exact arithmetic, finds zeros.

    Args:
        proof: the proof.
        robot: name of the robot.
        variants: the chosen variant of each equation.
        files: {file of equations or mechanism: SHA-256 of its bytes}.
        motions: what is proved along protocols, with the SHA-256 of each protocol's file.
    """
    # numbers that are 0 in the equations and in the mechanism, as a point at the origin, need no certificate
    proved = []
    nodes = []
    for claim in proof.claims:
        if claim.status == "proved" and program.depends(claim.nodes):
            proved.append(claim)
            nodes += [*claim.nodes, *claim.reach]
    rows, row_numbers = program.rows(nodes)
    claims = []
    # the numbers are in the order in which the nodes were listed above
    remaining = iter(row_numbers)
    for claim in proved:
        zero = list(islice(remaining, len(claim.nodes)))
        reach = list(islice(remaining, len(claim.reach)))
        claims.append({"name": claim.name, "claim": claim.sentence, "zero": zero, "reach": reach})
    data: JsonObject = {
        "schema": SCHEMA,
        "robot": robot,
        "variants": dict(variants),
        "files": dict(files),
        "ranges": {name: list(limits) for name, limits in proof.ranges.items()},
        "rows": rows,
        "claims": claims,
    }
    if motions:
        data["motions"] = list(motions)
    return {**data, "sha256": digest(data)}


def digest(data: Mapping[str, object]) -> str:
    """Return the SHA-256 of a certificate's content without its own entry `sha256`."""
    content = dict(data)
    content.pop("sha256", None)
    # In one fixed form, so that the hash does not depend on the layout of the file or the order of its keys.
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()
