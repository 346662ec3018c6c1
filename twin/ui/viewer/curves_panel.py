"""The tab Curves: joint values, their rates, the tip or the RCM error of the protocol over time."""

from __future__ import annotations

import numpy as np
import viser
from viser import uplot

from twin.core.sampling import spread
from twin.core.spatial import Array, Index
from twin.core.units import DEG, MM
from twin.ui.session.timeline import Playback
from twin.ui.viewer import readout
from twin.ui.viewer.front import Front

CURVE_QUANTITIES = ("displacement", "speed", "acceleration", "tip", "RCM error")
"""What can be drawn; the first three are of the active joints."""

MIN_SPAN = 0.01
"""Minimum range of the y axis of a plot, so that ten labels with three decimals are all different."""

_PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#999999")

_MAX_CURVE_POINTS = 400
"""Maximum number of points sent for a curve."""

_DISTANCE_UNITS = (("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9), ("pm", 1e-12))
"""(Name, size in m) of the units of a distance, which may be a rounding error or some centimetres."""


class CurvesPanel:
    """A plot of the active robot's protocol, with a vertical line at the clock's time."""

    def __init__(self, front: Front, tab: viser.GuiTabHandle) -> None:
        self.front = front
        self.gui = front.server.gui
        self._tab = tab
        with tab:
            self._chosen = self.gui.add_dropdown("curve", CURVE_QUANTITIES, initial_value=CURVE_QUANTITIES[0])
            self._chosen.on_update(lambda _: front.ask("curves", lambda: self.draw(force=True)))
            self._legend = self.gui.add_html("")
        self._plot: viser.GuiUplotHandle | None = None
        self._plotted: tuple[str, str, Playback | None] = ("", "", None)  # what the plot shows: curve, robot, playback

    def draw(self, force: bool = False) -> None:
        """Draw the chosen curves, or move only the line of the clock if the plot shows them already.

        With `force`, the plot is made anew in any case. Without a planned protocol, nothing changes.
        """
        playback = self.front.active.playback
        if playback is None:
            return
        joints = []
        angles = []
        for joint in self.front.active.movable.joints:
            joints.append(joint.name)
            angles.append(joint.is_angle)
        names, values = curves(playback, self._chosen.value, joints, angles)
        samples = plotted_samples(values)
        if not len(samples):
            self._remove_plot()
            self._legend.content = "no RCM is registered in this protocol"
            return
        t = playback.t[samples]
        rows = values[:, samples]
        nearest_to_clock = int(np.argmin(np.abs(t - self.front.clock.time)))
        low = float(rows.min())
        high = float(rows.max())
        clock_line = np.full(len(t), low)  # a curve that is a vertical line at the clock's time
        clock_line[nearest_to_clock] = max(high, low + MIN_SPAN)
        data = (t, *rows, clock_line)
        content = (self._chosen.value, self.front.active.name, playback)
        if self._plot is not None and not force and content == self._plotted:
            self._plot.data = data
            return
        self._remove_plot()
        self._legend.content = readout.legend(names, _PALETTE)
        self._plot = self._new_plot(data, names)
        self._plotted = content

    def clear(self) -> None:
        """Remove plot and legend, because the active robot has no planned protocol."""
        self._legend.content = ""
        self._remove_plot()

    def _new_plot(self, data: tuple[Array, ...], names: list[str]) -> viser.GuiUplotHandle:
        """Add a plot of (times, a row for each name, the line of the clock), each (k,)."""
        series = [uplot.Series(label="t")]
        for i, name in enumerate(names):
            color = _PALETTE[i % len(_PALETTE)]
            series.append(uplot.Series(label=name, stroke=color, width=1.5))
        series.append(uplot.Series(label="now", stroke="#888888", width=1.0))
        with self._tab:
            return self.gui.add_uplot(
                data, tuple(series), scales={"x": uplot.Scale(time=False)},
                cursor=uplot.Cursor(show=True), height=300,
                axes=(uplot.Axis(label="time [s]"), uplot.Axis(size=58)), legend=uplot.Legend(show=False),
            )  # fmt: skip

    def _remove_plot(self) -> None:
        if self._plot is not None:
            self._plot.remove()
            self._plot = None


def curves(playback: Playback, what: str, joints: list[str], angles: list[bool]) -> tuple[list[str], Array]:
    """Return (names with units, values (m, k)) of the m curves of a playback with k samples.

    Args:
        playback: the planned protocol.
        what: one of `CURVE_QUANTITIES`.
        joints: names of the active joints.
        angles: of each active joint, whether its value is an angle.
    """
    if what == "tip":
        return ["x [mm]", "y [mm]", "z [mm]"], playback.tip.T / MM
    if what == "RCM error":
        worst = float(np.nanmax(playback.rcm_error, initial=0.0))
        unit, scale = _unit_of(worst)
        return [f"shaft to RCM [{unit}]"], playback.rcm_error[None] / scale
    per, values = {
        "displacement": ("", playback.q),
        "speed": ("/s", playback.qd),
        "acceleration": ("/s²", playback.qdd),
    }[what]
    names = []
    scales = []
    for joint, is_angle in zip(joints, angles, strict=True):
        unit = "°" if is_angle else "mm"
        names.append(f"{joint} [{unit}{per}]")
        scales.append(DEG if is_angle else MM)
    return names, (values / np.array(scales)).T


def plotted_samples(values: Array) -> Index:
    """Return the indices of the samples of curves (m, k) that are plotted, at most `_MAX_CURVE_POINTS`.

    Samples without a value, as those of the RCM error while no RCM is registered, are left out. There may be none.
    """
    has_values = np.isfinite(values).all(axis=0)
    samples = np.flatnonzero(has_values)
    return samples[spread(len(samples), _MAX_CURVE_POINTS)]


def _unit_of(distance: float) -> tuple[str, float]:
    """Return the largest unit, with its size in m, in which a distance is at least 1; otherwise the smallest unit."""
    for unit, size in _DISTANCE_UNITS:
        if distance >= size:
            return unit, size
    return _DISTANCE_UNITS[-1]
