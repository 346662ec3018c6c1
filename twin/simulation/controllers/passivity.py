"""Passivity of a sampled surface: the required damping of the device, and a force that never feeds energy to the hand.

A force that is held for a tick while the hand moves is a source of energy. The energy observer of a hand adds up the
energy that the hand has put in: E += b |dh|^2 / T - F . dh in every tick. Here dh in m is the motion of the hand, F in
N the held force, T in s the tick, and b in N s/m the damping of the device and the fingers that hold it. The first
term is a lower bound of the energy that the damping dissipates (exact at constant speed). In one tick, a force F
reduces E by at most |F|^2 T / (4 b), for any dh. Therefore a force of at most sqrt(4 b E / T) never makes E negative,
for any motion of the hand and any delay of the surface data.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from twin.core.errors import WorldError

FILTER_HZ = 30.0
"""Cut-off frequency in Hz of the rate at which a tool enters a surface; ASSUMED, above the motions of a hand."""

_LOWEST_ANGLE = 1e-3
"""Lowest angle w T in rad per tick at which the condition of passivity is evaluated."""

_ANGLE_COUNT = 4000
"""Number of these angles up to pi."""

_USABLE_FRACTION = 0.99
"""Fraction of the observed energy that a force may use in one tick; the rest allows for rounding."""


def smoothing(dt: float) -> float:
    """Return the weight (0 to 1) of a new rate in the low-pass filter with `FILTER_HZ`, for ticks of dt in s."""
    return 1.0 - math.exp(-2 * math.pi * FILTER_HZ * dt)


def needed_damping(stiffness: float, damping: float, dt: float) -> float:
    """Return the smallest damping in N s/m of a device on which a surface is passive.

    The condition of Colgate and Schenkel (J. Robotic Systems 14(1), 1997) is for a surface with the transfer function
    H(z), sampled and held every T = dt: b > T / (2 (1 - cos w T)) Re[(1 - exp(-j w T)) H(exp(j w T))] at all
    frequencies w up to pi / T. Without a filter, the condition is b > K T / 2 + |B| (K: stiffness, B: damping).

    Args:
        stiffness: stiffness of the surface in N/m.
        damping: damping of the surface in N s/m.
        dt: duration of a tick in s.
    """
    z = np.exp(1j * np.linspace(_LOWEST_ANGLE, np.pi, _ANGLE_COUNT))
    a = smoothing(dt)
    # H(z): the rate is the difference of two samples, then the low-pass filter
    difference = (z - 1) / (dt * z)
    low_pass = a / (1 - (1 - a) / z)
    surface = stiffness + damping * difference * low_pass
    needed = dt / 2 / (1 - np.real(z)) * np.real((1 - 1 / z) * surface)
    return float(np.max(needed))


def require_passive(stiffness: float, damping: float, largest: float, device_damping: float, dt: float) -> None:
    """Check that the parameters of a surface are in range, and that the surface is passive on the device.

    Args:
        stiffness: stiffness of the surface in N/m.
        damping: damping of the surface in N s/m.
        largest: force in N at which the force of the surface is clipped.
        device_damping: damping in N s/m of the device and the fingers that hold it.
        dt: duration of a tick in s.

    Raises:
        WorldError: a number is out of range, or the surface is not passive on this device.
    """
    _require("stiffness", stiffness, "N/m", stiffness > 0, "above 0")
    _require("damping", damping, "N s/m", damping >= 0, "at least 0")
    _require("largest force", largest, "N", largest > 0, "above 0")
    _require("damping of the device", device_damping, "N s/m", device_damping > 0, "above 0")
    needed = needed_damping(stiffness, damping, dt)
    if not needed > device_damping:
        return
    # the needed damping is convex in the damping of the surface: the line between two of its values is not below it
    without_damping = needed_damping(stiffness, 0.0, dt)
    remedy = "stiffness"
    if damping and device_damping > without_damping:
        largest = damping * (device_damping - without_damping) / (needed - without_damping)
        remedy = f"damping to at most {math.floor(100 * largest) / 100:g} N s/m"
    raise WorldError(
        f"haptics: the damping of the device is {device_damping:g} N s/m; a surface with {stiffness:g} N/m and "
        f"{damping:g} N s/m at ticks of {dt * 1e3:g} ms needs at least {needed:.3g} N s/m. Lower the {remedy}, or "
        "use shorter ticks"
    )


def _require(name: str, value: float, unit: str, is_in_range: bool, limit: str) -> None:
    """Raise `WorldError` unless a parameter is finite and in its range."""
    if not (math.isfinite(value) and is_in_range):
        raise WorldError(f"haptics: the {name} is {value:g} {unit}; it must be finite and {limit}")


def observed(energy: ca.SX, force: ca.SX, dh: ca.SX, device_damping: float, dt: float) -> ca.SX:
    """Return the energy in J after a tick in which the hand moved by dh (3,) in m against a held force (3,) in N."""
    return energy + ca.sumsqr(dh) * (device_damping / dt) - ca.dot(force, dh)


def stored(depth: ca.SX, stiffness: float, largest: float) -> ca.SX:
    """Return the energy in J that a surface stores at a depth in m."""
    full = largest / stiffness
    return ca.if_else(depth < full, 0.5 * stiffness * depth**2, largest * (depth - full / 2))


def bounded(force: ca.SX, energy: ca.SX, device_damping: float, dt: float) -> ca.SX:
    """Return a force (3,) in N, shortened so that it cannot use more than `energy` in J in the next tick."""
    largest = ca.sqrt(4 * _USABLE_FRACTION * device_damping / dt * ca.fmax(energy, 0))
    return clipped(force, largest)


def clipped(force: ca.SX, largest: float | ca.SX) -> ca.SX:
    """Return a force (3,) in N, shortened to the length `largest` in N if it is longer."""
    length = ca.fmax(_length(force), 1e-12)  # not 0, by which it is divided
    return force * ca.fmin(1, largest / length)


def _length(v: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(v))
