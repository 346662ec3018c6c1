"""Lengths of single parts, as measured on the CAD, against the numbers that the equations use."""

from __future__ import annotations

import numpy as np

from twin.cad.build import CadModel
from twin.cad.lengths import measure
from twin.errors import TwinError, unknown
from twin.findings import Finding
from twin.kinematics import Kinematics
from twin.units import MM, UM
from twin.validation.result import Residual
from twin.validation.rows import Clock, Tolerances, row


def lengths(
    kin: Kinematics, cad: CadModel, clock: Clock, tolerances: Tolerances
) -> tuple[list[Residual], list[Finding]]:
    """Return a row for each length that the description declares, and a finding for each that differs.

    Raises:
        TwinError: the equations have no parameter of that name.
    """
    rows, findings = [], []
    at = clock.at(np.zeros(1, np.intp))
    for length in measure(cad):
        if length.parameter not in kin.parameters:
            raise TwinError(
                f"[[length]] of body '{length.body}': the equations have "
                f"{unknown('parameter', length.parameter, kin.parameters).removeprefix('there is ')}"
            )
        used = kin.parameters[length.parameter]
        where, note = f"{length.parameter} on {length.body}", f"{' to '.join(length.between)}, as drawn"
        r = row("A-B", "length", where, "m", np.array([length.value - used]), tolerances.position, at, note=note)
        rows.append(r)
        if not r.agrees:
            findings.append(
                Finding(
                    "length.differs",
                    "disagreement",
                    f"{where} measures {length.value / MM:.4f} mm from {length.between[0]} to {length.between[1]}; "
                    f"the equations use {used / MM:.4f} mm",
                    where=length.body,
                    when="as drawn",
                    size=r.worst / UM,
                    unit="um",
                    limit=tolerances.position / UM,
                    suggestion=f"mend '{length.body}' in the CAD, or {length.parameter} in the equations",
                )
            )
    return rows, findings
