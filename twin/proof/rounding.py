"""Rounding in double precision, and by how much bounds are enlarged because they are rounded themselves."""

from __future__ import annotations

UNIT_ROUNDOFF = 2.0**-53
"""Largest relative rounding error of one operation of IEEE 754."""

BOUND_MARGIN = 1.0 + 2.0**-40
"""Factor by which bounds are enlarged: more than the rounding of the few hundred operations that compute one."""

SMALLEST_BOUND = 1e-290
"""Added to bounds, so that underflow counts."""
