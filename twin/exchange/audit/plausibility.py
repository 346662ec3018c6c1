"""Report physically impossible data in a file: masses, inertias, densities, gravity, drives.

This check needs no second file. If two files of a bundle contradict each other, the check can show which file is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.exchange.audit.file_content import Content, LinkShape
from twin.exchange.audit.file_drives import FileDrive
from twin.exchange.audit.ledger import Ledger, Measured
from twin.exchange.audit.mechanism_data import FileMass
from twin.exchange.audit.value_text import quantity

MAX_DENSITY = 23_000.0
"""Maximum density in kg/m3; osmium has 22 590."""

MIN_BOX_DENSITY = 0.5
"""Minimum ratio in kg/m3 of a link's mass to the volume of the link's bounding box; the density of air is 1.2."""

MAX_CENTRE_DISTANCE = 0.1
"""Maximum distance between a link's bounding box and a centre of mass outside the box, divided by the box diagonal.

A centre of mass outside the box is possible, because the CAD may omit some parts.
"""

EARTH_GRAVITY = 9.81
"""Gravity in m/s2 on earth, as most programs have it."""

OTHER_GRAVITY_RANGE = (1.0, 20.0)
"""Range of gravity in m/s2 that may be meant, of the moon (1.6) and of most planets."""

_MIN_DOWNWARD_COSINE = 0.999
"""Minimum cosine of the angle between gravity and -z at which it points down: 2.6 degrees."""

EARTH_GRAVITY_RANGE = (9.7, 9.9)
"""Range of gravity in m/s2 on earth; zero gravity is also allowed."""

GRAVITY_TOL = 1e-3
"""Maximum distance in m/s2 of two values of gravity that are the same, despite rounding to single precision."""

SHEET_THICKNESS = 1e-4
"""Thickness in m below which an open mesh is a sheet, drawn without its thickness."""

TRIANGLE_INEQUALITY_TOL = 1e-5
"""Maximum relative violation of the triangle inequality of principal inertias that counts as a rounding error."""


def check_sense(content: Content, gravity: Sequence[np.ndarray] = ()) -> None:
    """Report physically impossible data in a file.

    `gravity` are the values (3,) in m/s2 of the mechanism and of files in other formats. Gravity that does not point
    down is wrong only if none of them is the same: some robots are meant for a slope, or drawn with another axis up.
    """
    mechanism = content.mechanism
    ledger = content.ledger
    if mechanism is None:
        return
    before = len(ledger.found)
    for link, mass in mechanism.masses.items():
        _check_mass(ledger, link, mass)
        has_known_mass = np.isfinite(mass.mass) and mass.mass > 0 and link not in mechanism.assumed
        if has_known_mass and link in content.shapes:
            _check_extent(ledger, link, mass, content.shapes[link], link not in mechanism.partly_shown)
    for joint in mechanism.joints:
        if joint.names:
            _check_drive(ledger, joint.names[-1], joint.drive)
    if mechanism.gravity is not None:
        is_stated_elsewhere = any(np.linalg.norm(mechanism.gravity - other) < GRAVITY_TOL for other in gravity)
        _check_gravity(ledger, mechanism.gravity, is_stated_elsewhere)
    if mechanism.masses or mechanism.joints:
        wrong = []
        for finding in ledger.found[before:]:
            if finding.severity != "info":
                wrong.append(finding)
        ledger.row("masses, drives, gravity: physically possible", float(len(wrong)), "found", 0.0)


def _check_mass(ledger: Ledger, link: str, mass: FileMass) -> None:
    """Report a mass, a centre of mass or an inertia that no body has."""

    def wrong(code: str, text: str, size: float, unit: str, limit: float) -> None:
        ledger.wrong(f"physics.{code}", f"link '{link}': {text}.", link, size=Measured(size, limit, unit))

    if not (np.isfinite(mass.mass) and mass.mass > 0):
        wrong("mass_not_positive", f"the mass is {mass.mass:g} kg, but must be positive", mass.mass, "kg", 0.0)
        return
    if mass.center is not None and not np.all(np.isfinite(mass.center)):
        wrong("mass_centre_not_finite", "the centre of mass is not finite", np.nan, "m", 0.0)
    if mass.inertia is not None:
        I = mass.inertia  # noqa: E741 - the symbol of the field
        if not np.all(np.isfinite(I)):
            wrong("inertia_impossible", "the inertia is not finite", np.nan, "kg m2", 0.0)
            return
        # eigvalsh reads one triangle only: a file with an asymmetric tensor is judged by the mean of both.
        moments = np.linalg.eigvalsh((I + I.T) / 2)
        if moments[0] <= 0:
            text = f"the smallest principal moment of inertia is {moments[0]:.4g} kg m2, but must be positive"
            wrong("inertia_impossible", text, float(moments[0]), "kg m2", 0.0)
        elif moments[2] > (moments[0] + moments[1]) * (1 + TRIANGLE_INEQUALITY_TOL):
            text = (
                f"the principal moments of inertia {moments[0]:.4g}, {moments[1]:.4g} and {moments[2]:.4g} kg m2 "
                "violate the triangle inequality: no mass distribution has such moments"
            )
            wrong("inertia_impossible", text, float(moments[2]), "kg m2", float(moments[0] + moments[1]))


def _check_extent(ledger: Ledger, link: str, mass: FileMass, shape: LinkShape, is_whole_link: bool) -> None:
    """Report a mass that does not fit the size of a link's shape; a note if the shape does not show the whole link."""

    def wrong(code: str, text: str, size: float, unit: str, limit: float) -> None:
        if is_whole_link:
            ledger.wrong(f"physics.{code}", f"link '{link}': {text}.", link, size=Measured(size, limit, unit))
            return
        text = f"link '{link}': {text}; these shapes do not show the whole link."
        ledger.add(f"physics.{code}", "info", text, link, size=Measured(size, limit, unit))

    # `_check_mass` has reported them; every comparison with NaN below would be false, as if the mass fitted.
    for numbers in (mass.center, mass.inertia):
        if numbers is not None and not np.all(np.isfinite(numbers)):
            return
    size = shape.high - shape.low
    diagonal = shape.diagonal
    if mass.center is not None:
        outside = np.maximum(shape.low - mass.center, mass.center - shape.high)
        distance = float(np.linalg.norm(np.maximum(outside, 0.0)))
        if distance > MAX_CENTRE_DISTANCE * diagonal:
            text = f"the centre of mass is {quantity(distance, 'm')} outside the bounding box of the link's meshes"
            wrong("mass_centre_outside", text, distance, "m", MAX_CENTRE_DISTANCE * diagonal)
    if mass.inertia is not None and diagonal > 0:
        moments = np.linalg.eigvalsh((mass.inertia + mass.inertia.T) / 2)
        largest = max(moments[2], 0.0)
        # A mean distance from an axis through the centre of mass: no part of the link is a diagonal away from it.
        gyration = float(np.sqrt(largest / mass.mass))
        if gyration > diagonal:
            text = (
                f"the radius of gyration is {quantity(gyration, 'm')}, more than the diagonal "
                f"{quantity(diagonal, 'm')} of the bounding box of the link's meshes"
            )
            wrong("inertia_too_large", text, gyration, "m", diagonal)
    # An open mesh encloses no volume: the mass is compared with that of its bounding box.
    # At least as thick as a sheet: the box of a flat link would have no volume to divide by.
    box = float(np.prod(np.maximum(size, SHEET_THICKNESS)))
    volume = box
    if shape.closed and shape.volume > shape.rounding:
        volume = shape.volume
    if volume == box and np.min(size) < SHEET_THICKNESS:
        return  # a sheet, such as a sticker or a marker, shows no volume
    density = mass.mass / volume
    box_density = mass.mass / box
    if density > MAX_DENSITY:
        text = (
            f"the mass of {mass.mass:.4g} kg in a volume of {volume:.3g} m3 gives {density:.3g} kg/m3, "
            "more than the density of any material"
        )
        wrong("density", text, density, "kg/m3", MAX_DENSITY)
    elif box_density < MIN_BOX_DENSITY:
        text = (
            f"the mass of {mass.mass:.4g} kg in a bounding box of {box:.3g} m3 gives {box_density:.3g} kg/m3, "
            "less than the density of air"
        )
        wrong("density", text, box_density, "kg/m3", MIN_BOX_DENSITY)


def _check_drive(ledger: Ledger, joint: str, drive: FileDrive) -> None:
    """Report limits in the wrong order, and negative gains or limits of a drive."""
    if drive.limits is not None:
        lower, upper = drive.limits
        if not lower <= upper:
            text = f"joint '{joint}': lower limit {lower:g} is above upper limit {upper:g}."
            ledger.wrong("physics.limits", text, joint, suggestion="exchange the limits")
    values = {
        "stiffness": drive.stiffness,
        "damping": drive.damping,
        "maximum effort": drive.effort,
        "maximum speed": drive.speed,
    }
    for name, value in values.items():
        if value is not None and not value >= 0:  # also if it is not a number
            text = f"joint '{joint}': the {name} is {value:g}, but must not be negative."
            if np.isnan(value):
                text = f"joint '{joint}': the {name} is not a number."
            ledger.wrong("physics.drive_negative", text, joint, size=Measured(value, 0.0))


def _check_gravity(ledger: Ledger, gravity: np.ndarray, is_stated_elsewhere: bool) -> None:
    """Report gravity (3,) in m/s2 that is not that of earth along -z, unless another source states it."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        ledger.add("physics.gravity", "info", "gravity is zero.", "gravity")
        return
    components = ", ".join(map("{:g}".format, gravity))
    if is_stated_elsewhere:
        # Gravity of a slope, or of another up axis, deserves a note; that of earth along -z does not.
        if abs(gravity[2] + EARTH_GRAVITY) > GRAVITY_TOL or size > EARTH_GRAVITY_RANGE[1]:
            ledger.add("physics.gravity", "info", f"gravity is ({components}) m/s2, as stated elsewhere.", "gravity")
        return
    if not gravity[2] < -_MIN_DOWNWARD_COSINE * size:
        text = f"gravity is ({components}) m/s2 in a world with z up, but must point down (-z)."
        ledger.wrong("physics.gravity", text, "gravity", suggestion="gravity along -z: (0, 0, -9.81)")
    elif not EARTH_GRAVITY_RANGE[0] <= size <= EARTH_GRAVITY_RANGE[1]:
        severity = "disagreement"
        if OTHER_GRAVITY_RANGE[0] < size < OTHER_GRAVITY_RANGE[1]:
            severity = "warning"
        text = f"gravity is {size:g} m/s2; on earth it is {EARTH_GRAVITY} (x {size / EARTH_GRAVITY:.4g})."
        ledger.add("physics.gravity", severity, text, "gravity", size=Measured(size, EARTH_GRAVITY, "m/s2"))
