"""Convert arrays of differences to rows of the residual matrix; tolerances of these rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.core import spatial
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM, UM
from twin.validation.result import PhaseSummary, Residual, RowKind

_LINK_LENGTH = 0.1
"""Length in m of the robot's links if it is not known: it relates errors of positions and of angles."""

_SPEED_PER_METRE = 10.0
"""Speed in m/s that counts as much as a difference of 1 m: that of 1 m in 0.1 s."""

_ACCELERATION_PER_METRE = 100.0
"""Acceleration in m/s2 that counts as much as a difference of 1 m: that of 10 m/s in 0.1 s."""

_PHASE_END_TOLERANCE = 1e-9
"""Tolerance in s of the end of a phase, far below a sample: the last sample of a phase belongs to it."""

_MAIN_AXIS_PART = 0.05
"""Part of the largest component from which another one is named as well."""


@dataclass(frozen=True)
class Tolerances:
    """Largest deviations that count as agreement, in SI units.

    The defaults are for geometry in double precision. They are far below drawing errors and far above rounding errors.

    Attributes:
        position, rotation: between equations and mechanism, in m and rad; also for values of prismatic joints
            (`position`) and revolute joints (`rotation`).
        loop: gap of a closed loop, in m.
        stage_position, stage_rotation: between mechanism and stage, in m and rad (UsdPhysics frames are float32).
        baked_position, baked_rotation: between mechanism and baked link poses at their time codes, in m and rad.
        speed, acceleration: of the tool's velocity, in m/s and rad/s, and of the tool's acceleration, in m/s2 and
            rad/s2.
        rcm: distance between the mechanism's shaft and an enforced RCM, in m.
    """

    position: float = 1e-9
    rotation: float = 1e-8
    loop: float = 1e-11
    stage_position: float = 5e-7
    stage_rotation: float = 5e-6
    baked_position: float = 1e-9
    baked_rotation: float = 2e-7
    speed: float = 1e-6
    acceleration: float = 1e-4
    rcm: float = 1e-9

    def widened(self, position: float, link: float | None) -> Tolerances:
        """Return tolerances for errors up to `position` in m, and for the angles to which they lead.

        `link` is the usual length in m of the robot's links, which turn by `position` / `link` in rad; None: 0.1 m.
        """
        p = max(position, self.position)
        r = max(position / (link or _LINK_LENGTH), self.rotation)
        return Tolerances(
            position=p,
            rotation=r,
            loop=max(self.loop, p),
            stage_position=max(self.stage_position, p),
            stage_rotation=max(self.stage_rotation, r),
            baked_position=self.baked_position,
            baked_rotation=self.baked_rotation,
            speed=max(self.speed, _SPEED_PER_METRE * p),
            acceleration=max(self.acceleration, _ACCELERATION_PER_METRE * p),
            rcm=max(self.rcm, p),
        )


@dataclass(frozen=True)
class SampleClock:
    """Times (k,) in s of the compared samples, and the phases of the protocol."""

    t: Array
    phases: tuple[PhaseSummary, ...]

    def phase(self, t: float) -> str:
        """Return the name of the phase at a time in s; after the last phase, its name; "" without phases."""
        name = ""
        for phase in self.phases:
            name = phase.name
            if t <= phase.t1 + _PHASE_END_TOLERANCE:
                break
        return name

    def when(self, k: int) -> str:
        """Return phase and time of sample k as text."""
        t = float(self.t[k])
        return f"{self.phase(t)}, t = {t:.2f} s"

    def at(self, rows: Index) -> SampleClock:
        """Return the times and the phases of the samples with the indices `rows`."""
        return SampleClock(self.t[rows], self.phases)


def row(
    pair: str,
    quantity: RowKind,
    name: str,
    unit: str,
    differences: Array,
    tolerance: float | None,
    clock: SampleClock,
    **more: str,
) -> Residual:
    """Return a row of the residual matrix from differences: scalars (k,), or vectors (k, 3), whose norms are used."""
    are_vectors = differences.ndim > 1
    if are_vectors:
        values = np.linalg.norm(differences, axis=-1)
    else:
        values = np.abs(differences)
    missing = np.isnan(values)
    worst = 0
    if len(values):
        # a sample without a value is never the worst, except if all are without
        worst = int(np.argmax(np.where(missing, -1.0, values)))
    component = ""
    if are_vectors and values[worst] > 0:
        component = _main_axes(np.abs(differences).max(axis=0))
    rms = float("nan")
    if not missing.all():
        present_values = values[~missing]
        rms = float(np.sqrt(np.mean(present_values**2)))
    t = float(clock.t[worst])
    return Residual(
        pair,
        quantity,
        name,
        unit=unit,
        worst=float(values[worst]),
        rms=rms,
        tolerance=tolerance,
        t=t,
        phase=clock.phase(t),
        component=component,
        samples=len(values),
        **more,
    )


def _main_axes(largest: Array) -> str:
    """Return the axes along which vectors differ most, as text; see `_MAIN_AXIS_PART`.

    `largest` (3,) is the largest difference along x, y and z.
    """
    axes = []
    for axis, difference in zip("xyz", largest, strict=True):
        if difference > _MAIN_AXIS_PART * largest.max():
            axes.append(axis)
    return ", ".join(axes)


def pose_rows(
    pair: str,
    name: str,
    Ts: Array,
    others: Array,
    limits: tuple[float, float],
    clock: SampleClock,
    **more: str,
) -> tuple[Residual, Residual]:
    """Return two rows, position and rotation, from the differences between poses `others` and Ts, both (k, 4, 4).

    `limits` are the tolerances in m and rad.
    """
    offset = others[:, :3, 3] - Ts[:, :3, 3]
    return (
        row(pair, "tool", name, unit="m", differences=offset, tolerance=limits[0], clock=clock, **more),
        row(
            pair,
            "tool",
            name,
            unit="rad",
            differences=rotation_vectors(Ts, others),
            tolerance=limits[1],
            clock=clock,
            **more,
        ),
    )


def rotation_vectors(Ts: Array, others: Array) -> Array:
    """Return rotation vectors (k, 3) in rad, in base, that rotate poses Ts (k, 4, 4) to `others` (k, 4, 4)."""
    return spatial.log_so3(others[:, :3, :3] @ np.swapaxes(Ts[:, :3, :3], 1, 2))


def displayed(value: float, unit: str) -> tuple[float, str]:
    """Return a number in SI and its unit as (number, unit) for display: mm, µm or nm for lengths, ° for angles."""
    if unit.startswith("m"):
        for scale, name in ((MM, "mm"), (UM, "µm")):
            if value >= 0.1 * scale:
                return value / scale, name + unit[1:]
        return value * 1e9, "nm" + unit[1:]
    return value / DEG, "°" + unit[3:]


def display_text(value: float, unit: str) -> str:
    """Return a number in SI with its unit, for display."""
    number, name = displayed(value, unit)
    if name.startswith("°"):
        return f"{number:.4g}{name}"
    return f"{number:.4g} {name}"
