"""Draw what is proved along protocols: bounds over time, with the sampled values between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin.api.motion_proof import ProvedMotion
from twin.api.proof import Proved
from twin.core.format import quantity
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.proof.motion import value_groups as groups
from twin.proof.motion.motion_claims import MotionClaim
from twin.ui.report.style import INK, PALETTE, UNFIT, log_ticks, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_MOTIONS = 3
"""Largest number of protocols that are drawn side by side."""

_RCM_TICKS = (1e-12, 1e-9, 1e-6, 1e-3, 1.0)
"""Ticks of the axis of the RCM in m."""

_MIN_RCM_DISTANCE = 1e-14
"""Distance in m at which the axis of the RCM begins: smaller ones are rounding."""

_MAX_SAMPLES = 60
"""Number of samples that are drawn as points of a band; more would cover the band."""


@styled()
def figure(proved: Proved) -> Figure | None:
    """Return a figure with the bounds along the first protocols; None if nothing is proved along a protocol."""
    motions = proved.motions[:_MAX_MOTIONS]
    if not motions:
        return None
    heights = [1.5, 1.5, 1.5, 1.5]
    names = ", ".join(motion.protocol for motion in motions)
    title = f"{proved.robot}: proved at every moment of {names}"
    drawing, axes = panels(title, heights, columns=len(motions), gap=0.42)
    for column, motion in enumerate(motions):
        _draw_speeds(axes[0][column], motion)
        _draw_margins(axes[1][column], motion)
        _draw_rcm(axes[2][column], motion)
        _draw_determinant(axes[3][column], motion)
    labels = ("speed / limit", "distance from limit", "distance from RCM", "determinant / start")
    for row, text in zip(axes, labels, strict=True):
        row[0].set_ylabel(text)
    return drawing


def _draw_speeds(ax: Axes, motion: ProvedMotion) -> None:
    """Draw the largest bound of all speeds, each divided by its limit, and the largest sample."""
    claims = []
    for claim in motion.proof.claims:
        if claim.group in groups.SPEEDS and np.isfinite(claim.limit):
            claims.append(claim)
    if not claims:
        _write_reason(ax, "no speed has a limit")
        return
    highs = []
    lows = []
    samples = []
    for claim in claims:
        curve = motion.proof.curves[claim.group, claim.name]
        highs.append(curve.high / claim.limit)
        lows.append(curve.low / claim.limit)
        values = motion.samples.values.get((claim.group, claim.name))
        if values is not None:
            samples.append(values / claim.limit)
    sampled = None
    if samples:
        sampled = np.max(samples, axis=0)
    # the cells of all curves of a motion begin at the same times
    t = motion.proof.curves[claims[0].group, claims[0].name].t
    _draw_band(ax, t, np.max(lows, axis=0), np.max(highs, axis=0), motion, sampled, PALETTE[0])
    ax.axhline(1.0, color=UNFIT, lw=0.8)
    ax.set_title("fastest of joints, motors and tool", fontsize=8.5, loc="left", pad=3)


def _draw_margins(ax: Axes, motion: ProvedMotion) -> None:
    """Draw the bound of the joint, motor or gap that comes nearest to its limit, as a share of its own range."""
    nearest: MotionClaim | None = None
    least = np.inf
    for claim in motion.proof.claims:
        if claim.group not in groups.MARGINS or not np.isfinite(claim.bound):
            continue
        curve = motion.proof.curves[claim.group, claim.name]
        largest = float(np.max(curve.high)) - claim.limit
        share = (claim.bound - claim.limit) / max(largest, 1e-12)
        if share < least:
            least = share
            nearest = claim
    if nearest is None:
        _write_reason(ax, "no joint has limits")
        return
    factor = MM
    unit = "mm"
    if nearest.unit == "rad":
        factor = DEG
        unit = "°"
    curve = motion.proof.curves[nearest.group, nearest.name]
    sampled = motion.samples.values.get((nearest.group, nearest.name))
    values = None
    if sampled is not None:
        values = sampled / factor
    _draw_band(ax, curve.t, curve.low / factor, curve.high / factor, motion, values, PALETTE[2])
    ax.axhline(nearest.limit / factor, color=UNFIT, lw=0.8)
    ax.set_title(f"nearest: {nearest.name} [{unit}]", fontsize=8.5, loc="left", pad=3)


def _draw_rcm(ax: Axes, motion: ProvedMotion) -> None:
    """Draw the distance of the shaft from the RCM, with its tolerance."""
    claims = [claim for claim in motion.proof.claims if claim.group == groups.RCM]
    if not claims:
        _write_reason(ax, "no RCM is registered")
        return
    for claim in claims:
        curve = motion.proof.curves[claim.group, claim.name]
        sampled = motion.samples.values.get((claim.group, claim.name))
        is_bounded = np.isfinite(curve.high)
        low = np.where(is_bounded, np.maximum(curve.low, _MIN_RCM_DISTANCE), np.nan)
        high = np.where(is_bounded, np.maximum(curve.high, _MIN_RCM_DISTANCE), np.nan)
        values = None
        if sampled is not None:
            values = np.maximum(sampled, _MIN_RCM_DISTANCE)
        _draw_band(ax, curve.t, low, high, motion, values, PALETTE[1])
        ax.axhline(claim.limit, color=UNFIT, lw=0.8)
    top = max(claim.high for claim in claims)
    top = max(top, claims[0].limit)
    ticks = [value for value in _RCM_TICKS if value <= 10 * top]
    log_ticks(ax, ticks, lambda value: quantity(value, "m"))
    ax.set_title("shaft, " + " and ".join(claim.name for claim in claims), fontsize=8.5, loc="left", pad=3)


def _draw_determinant(ax: Axes, motion: ProvedMotion) -> None:
    """Draw the determinant of the loops' Jacobian."""
    key = (groups.DETERMINANT, groups.LOOPS)
    if key not in motion.proof.curves:
        _write_reason(ax, "the mechanism has no loops")
        return
    curve = motion.proof.curves[key]
    _draw_band(ax, curve.t, curve.low, curve.high, motion, motion.samples.values.get(key), PALETTE[6])
    ax.set_ylim(bottom=0.0)
    ax.set_title("Jacobian of the loops", fontsize=8.5, loc="left", pad=3)


def _draw_band(
    ax: Axes, t: Array, low: Array, high: Array, motion: ProvedMotion, sampled: Array | None, color: str
) -> None:
    """Draw bounds (M,) in the cells between times t (M + 1,) as a band with its edges, and samples as points."""
    low = np.where(np.isfinite(low), low, np.nan)
    high = np.where(np.isfinite(high), high, np.nan)
    edges = np.repeat(t, 2)[1:-1]
    ax.fill_between(edges, np.repeat(low, 2), np.repeat(high, 2), color=color, alpha=0.35, lw=0)
    ax.plot(edges, np.repeat(high, 2), color=color, lw=0.9)
    ax.plot(edges, np.repeat(low, 2), color=color, lw=0.5)
    if sampled is not None:
        stride = max(1, len(sampled) // _MAX_SAMPLES)
        ax.plot(motion.samples.t[::stride], sampled[::stride], ".", color=INK, ms=2.5)


def _write_reason(ax: Axes, text: str) -> None:
    """Write why there is nothing to draw."""
    ax.text(0.5, 0.5, text, ha="center", va="center", transform=ax.transAxes, color=INK)
    ax.set_yticks([])
