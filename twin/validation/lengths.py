"""Compare lengths measured on CAD parts with the parameters of the equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.cad.build import CadModel
from twin.cad.description import Description
from twin.cad.lengths import measured_lengths
from twin.core.errors import TwinError, unknown
from twin.core.findings import Finding, disagreement
from twin.core.quantity import um
from twin.core.units import MM
from twin.formula.contract import arguments
from twin.kinematics import Kinematics
from twin.validation.residual_rows import SampleClock, Tolerances, row
from twin.validation.result import Residual


def check_parameters(kin: Kinematics, description: Description) -> None:
    """Check that each declared length names a parameter of the equations.

    Raises:
        TwinError: the equations have no parameter of a declared name.
    """
    for length in description.length:
        if length.parameter not in kin.parameters:
            raise TwinError(
                f"[[length]] of body '{length.body}': the equations have "
                f"{unknown('parameter', length.parameter, kin.parameters).removeprefix('there is ')}"
            )


def check_lengths(
    kin: Kinematics, cad: CadModel, clock: SampleClock, tolerances: Tolerances
) -> tuple[list[Residual], list[Finding]]:
    """Return a row for each length declared in the description, and a finding for each length that differs.

    Raises:
        TwinError: the equations have no parameter of a declared name.
    """
    check_parameters(kin, cad.description)
    rows: list[Residual] = []
    findings: list[Finding] = []
    clock_as_drawn = clock.at(np.zeros(1, np.intp))  # a length is the same at all times
    for length in measured_lengths(cad):
        first, second = length.between
        value_in_equations = kin.parameters[length.parameter]
        where = f"{length.parameter} on {length.body}"
        note = f"{first} to {second}, in the CAD"
        difference = np.array([length.value - value_in_equations])
        residual = row(
            "A-B",
            "length",
            where,
            unit="m",
            differences=difference,
            tolerance=tolerances.position,
            clock=clock_as_drawn,
            note=note,
        )
        rows.append(residual)
        if not residual.agrees:
            findings.append(
                disagreement(
                    "length.differs",
                    length.body,
                    f"{where} measures {length.value / MM:.4f} mm from {first} to {second}; "
                    f"the equations use {value_in_equations / MM:.4f} mm; difference",
                    size=um(residual.worst),
                    limit=um(tolerances.position),
                    suggestion=f"fix '{length.body}' in the CAD, or {length.parameter} in the equations",
                    when="as drawn",
                    cause=f"length {length.parameter}",
                    word="tolerance",
                )
            )
    return rows, findings


def with_length_causes(kin: Kinematics, length_findings: list[Finding], findings: list[Finding]) -> list[Finding]:
    """Return `findings` with corrected causes: if a wrong equation uses a wrong length, the length is the cause.

    `length_findings` are the findings on wrong lengths, `findings` the findings on the equations.
    """
    causes = {}
    for equation in kin.formula.equations:
        variant = kin.variants.get(equation.name, equation.default)
        required, optional = arguments(equation.variants[variant])
        # of several wrong lengths in one equation, the first is named
        for length in length_findings:
            parameter = length.cause.removeprefix("length ")
            if parameter in required or parameter in optional:
                causes[f"{equation.name} ({variant})"] = length.cause
                break
    corrected = []
    for finding in findings:
        cause = causes.get(finding.cause, finding.cause)
        corrected.append(replace(finding, cause=cause))
    return corrected
