"""Parameters of a plain formula: a number, its unit, and its provenance."""

from __future__ import annotations

import math

from twin.core.provenance import EARLIER, Parameter, Provenance
from twin.core.units import DEG, MM


def mm(value: float, provenance: Provenance = "ASSUMED", note: str = "") -> Parameter:
    """Return a length given in mm; equations use it in m."""
    return _parameter(value, MM, unit="mm", provenance=provenance, note=note)


def m(value: float, provenance: Provenance = "ASSUMED", note: str = "") -> Parameter:
    """Return a length given in m."""
    return _parameter(value, 1.0, unit="m", provenance=provenance, note=note)


def deg(value: float, provenance: Provenance = "ASSUMED", note: str = "") -> Parameter:
    """Return an angle given in degrees; equations use it in rad."""
    return _parameter(value, DEG, unit="deg", provenance=provenance, note=note)


def rad(value: float, provenance: Provenance = "ASSUMED", note: str = "") -> Parameter:
    """Return an angle given in rad."""
    return _parameter(value, 1.0, unit="rad", provenance=provenance, note=note)


def number(value: float, provenance: Provenance = "ASSUMED", note: str = "") -> Parameter:
    """Return a dimensionless number, such as a ratio or a count."""
    return _parameter(value, 1.0, unit="1", provenance=provenance, note=note)


def _parameter(value: float, scale: float, unit: str, provenance: Provenance, note: str) -> Parameter:
    """Return a parameter without a name, of a value that `scale` converts to SI.

    Raises:
        TypeError: the value is not a number.
        ValueError: it is not finite, or the provenance is not known.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number; write a number such as 135.0")
    if not math.isfinite(value):
        raise ValueError(f"{value} is not a finite number")
    if provenance not in ("PUBLISHED", "CITED", "DERIVED", "ASSUMED", *EARLIER):
        raise ValueError(
            f"provenance {provenance!r} is not known; write PUBLISHED (printed in the paper), CITED, DERIVED or ASSUMED"
        )
    return Parameter("", value * scale, unit, value, provenance, note or "no source is given")
