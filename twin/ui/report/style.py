"""Style of all plots: palette, panels, phase bands, and axes in readable units."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.core.format import deviation, power, quantity, seconds, with_degrees
from twin.core.units import DEG
from twin.validation.result import PhaseSummary, Report

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1c2733"
GRID = "#d5dbe1"
BAND = "#eef2f5"
"""Colours of text and axes, of the grid, and of every second phase; the page replaces the colours by CSS variables."""

FIT = "#00795c"
UNFIT = "#c4420a"
NEAR = "#d99100"
"""Colours of values within tolerance, beyond tolerance, near an alarm; green and red also differ in lightness."""

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7A5195", "#8C8C8C")
"""Colours of curves, strong ones first: six of Okabe and Ito, distinguishable with any colour vision; violet; grey."""

XYZ = ("#D55E00", "#009E73", "#0072B2")
"""Colours of x, y and z."""

WIDTH = 9.0
"""Width of a figure in inches, 900 px at 100 dpi."""

_LEFT = 0.86
_RIGHT = 0.18
_BOTTOM = 0.5
_GAP = 0.16
"""Spaces in inches: at the left, right and lower end of a figure, and between rows of axes."""

_MATPLOTLIB_SETTINGS: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "auto",
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "ytick.minor.size": 0,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.4,
    "legend.borderaxespad": 0.0,
    "text.hinting": "none",
    "text.parse_math": False,
    "svg.fonttype": "none",
    "path.simplify": True,
    "path.simplify_threshold": 0.25,
    "agg.path.chunksize": 0,
}


def drawable() -> bool:
    """Return whether matplotlib is installed; without it, pages have no pictures."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        return False
    return True


@contextlib.contextmanager
def styled(salt: str = "twin") -> Iterator[None]:
    """Apply the style within a `with` block, independently of the user's matplotlibrc.

    `salt` is the salt of the ids in SVG; pictures with different salts have different ids.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_MATPLOTLIB_SETTINGS | {"svg.hashsalt": salt})
        yield


def titled_figure(title: str, height: float) -> Figure:
    """Return an empty figure of the usual width with a title at the top left; the height is in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    figure.text(0.012, 1 - 0.24 / height, title, fontsize=11, fontweight="bold", va="center")
    return figure


def log_ticks(ax: Axes, values: Sequence[float], text: Callable[[float], str]) -> None:
    """Make the y axis logarithmic with ticks at the given values; `text` returns the label of a value."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(FixedLocator(list(values)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: text(float(v))))
    ax.yaxis.set_minor_locator(NullLocator())


def panels(
    title: str,
    heights: list[float],
    columns: int = 1,
    right: float = _RIGHT,
    head: float = 0.86,
    gap: float = _GAP,
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with a title and rows of axes that share the time axis.

    Args:
        title: title at the top left.
        heights: heights of the rows in inches.
        columns: number of axes in a row.
        right: space at the right in inches, for a legend beside the axes.
        head: space above the first row in inches, for title, legend and phase names.
        gap: space between the rows in inches.
    """
    height = head + sum(heights) + gap * (len(heights) - 1) + _BOTTOM
    mean = sum(heights) / len(heights)
    label_place = -0.66 if columns == 1 else -0.5
    figure = titled_figure(title, height)
    axes = figure.subplots(
        len(heights),
        columns,
        sharex=True,
        squeeze=False,
        gridspec_kw={
            "left": _LEFT / WIDTH,
            "right": 1 - right / WIDTH,
            "top": 1 - head / height,
            "bottom": _BOTTOM / height,
            "hspace": gap / mean,
            "wspace": 0.22,
            "height_ratios": heights,
        },
    )
    grid = axes.tolist()
    for row, tall in zip(grid, heights, strict=True):
        for ax in row:
            ax.tick_params(length=2.5)
            ax.locator_params(nbins=6, axis="y")
            wide = ax.get_position().width * WIDTH
            ax.yaxis.set_label_coords(label_place / wide, 0.5)  # fixed position: faster
            if row is grid[-1]:
                ax.set_xlabel("time [s]")
                ax.xaxis.set_label_coords(0.5, -0.3 / tall)
            else:
                ax.xaxis.set_visible(False)  # the bands show the times; ticks are slow to draw
                ax.spines["bottom"].set_visible(False)
    return figure, grid


def phase_bands(axes: list[list[Axes]], phases: tuple[PhaseSummary, ...]) -> None:
    """Shade every second phase; write the name of each phase above the first row.

    A name that does not fit is shortened, or replaced by the number of the phase.
    """
    if not phases:
        return
    t0 = phases[0].t0
    t1 = phases[-1].t1
    if not t1 > t0:
        return
    for row in axes:
        for ax in row:
            ax.set_xlim(t0, t1)
            for i, phase in enumerate(phases):
                if i % 2 == 0:
                    ax.axvspan(phase.t0, phase.t1, color=BAND, lw=0, zorder=0)
                if i:
                    ax.axvline(phase.t0, color=INK, lw=0.5, alpha=0.35, zorder=0.5)
    for ax in axes[0]:
        _phase_names(ax, phases)


def _phase_names(ax: Axes, phases: tuple[PhaseSummary, ...]) -> None:
    """Write the names of the phases above the axes, which extend over all phases."""
    duration = phases[-1].t1 - phases[0].t0
    inches_per_second = ax.get_position().width * WIDTH / duration
    for i, phase in enumerate(phases):
        # a letter is about 0.078 inches wide
        letters = int((phase.t1 - phase.t0) * inches_per_second / 0.078)
        text = phase.name.replace("_", " ")
        if len(text) > letters:
            text = f"{text[: letters - 1]}…" if letters > 3 else str(i + 1)
        if len(text) > letters:  # even the number would overlap adjacent ones
            continue
        middle = (phase.t0 + phase.t1) / 2
        ax.annotate(
            text,
            (middle, 1),
            (0, 3),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
            style="italic",
        )


def legend_above(ax: Axes) -> None:
    """Put the legend between the title and the phase names."""
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=1.9, ncols=8, columnspacing=1.4)


def legend_beside(ax: Axes) -> None:
    """Put the legend to the right of the axes."""
    handles, _ = ax.get_legend_handles_labels()
    if handles:
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1), labelspacing=0.35)


_MIN_AXIS_END = 1e-16
"""Minimum for the lower end of a logarithmic axis, in m or degrees."""


def log_axis(ax: Axes, unit: str, values: list[np.ndarray], limits: list[float]) -> None:
    """Make the y axis logarithmic, with a range that contains values and limits, and ticks such as "10 µm".

    Values, limits and the axis are in SI; `unit` is their unit, such as "m" or "rad/s".
    """
    # ticks are powers of ten of a degree or a metre
    step = np.pi / 180 if unit.startswith("rad") else 1.0
    samples = [np.array(limits)]
    for curve in values:
        samples.append(curve[np.isfinite(curve) & (curve > 0)])
    scaled = np.concatenate(samples) / step
    if not scaled.size:
        scaled = np.array([1e-12, 1e-9])
    largest = scaled.max()
    # a few samples, such as zeros with rounding errors, must not determine the lower end
    lowest = max(np.percentile(scaled, 0.5), largest * 1e-16, _MIN_AXIS_END)
    low = int(np.floor(np.log10(lowest) - 0.05))
    top = np.log10(largest)
    top += 0.3 + 0.17 * (top - low)  # room for a label above the largest value
    high = int(np.floor(top))
    decades_per_tick = max(1, int(np.ceil((high - low) / 6)))
    ticks = []
    for exponent in range(low, high + 1, decades_per_tick):
        ticks.append(10.0**exponent * step)
    log_ticks(ax, ticks, lambda value: _unit_tick(value, unit))
    ax.set_ylim(10.0**low * step, 10.0**top * step)


def _unit_tick(value: float, unit: str) -> str:
    """Return the tick label of a power of ten with its unit."""
    text = quantity(value, unit, 1)
    if not text.startswith("<"):
        return text.removeprefix("1×")
    # too small for a prefix of the unit
    if unit.startswith("rad"):
        rate = unit.removeprefix("rad")
        text = with_degrees(power(value / DEG, 1), f"°{rate}")
    else:
        text = f"{power(value, 1)} {unit}"
    return text.removeprefix("1×")


def limit_line(ax: Axes, value: float | None, label: str, color: str = UNFIT) -> None:
    """Draw a limit as a dashed line, with its label at the left."""
    if value is None:
        return
    ax.axhline(value, color=color, lw=1.0, ls=(0, (5, 2)), zorder=1.8)
    ax.annotate(
        label,
        (0, value),
        (4, 2),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        color=color,
        fontsize=8.5,
        va="bottom",
    )


def mark_sample(ax: Axes, t: float, value: float, text: str, color: str = INK, below: bool = False) -> None:
    """Mark the sample (t, value) with a ring, and write `text` beside the ring.

    The text is above the ring or, if `below` is true, below the ring. Without space there, the text is on the opposite
    side.
    """
    ax.plot([t], [value], "o", ms=6, mfc="none", mec=color, mew=1.2, zorder=4, clip_on=False)
    low, high = ax.get_xlim()
    # in points; text to the right of a ring at the y axis must not cross the axis
    horizontal = "left"
    dx = -4
    if t > low + 0.7 * (high - low):
        horizontal = "right"
        dx = 4
    elif t <= low + 0.01 * (high - low):
        dx = 8
    # as a fraction of the height of the axes
    pixel = ax.transData.transform((t, value))
    _, height = ax.transAxes.inverted().transform(pixel)
    text_below_from = 0.16 if below else 0.9
    vertical = "bottom"
    dy = 6
    if height > text_below_from:
        vertical = "top"
        dy = -6
    ax.annotate(
        text,
        (t, value),
        (dx, dy),
        textcoords="offset points",
        color=color,
        ha=horizontal,
        va=vertical,
        fontsize=8.5,
        fontweight="bold",
        zorder=5,
        clip_on=False,
    )


def value_at_time(value: float, unit: str, t: float, limit: float | None) -> str:
    """Return a text on a difference (in `unit`, as `limit`) at time t in s, such as "1.27 mm at 6.214 s"."""
    return f"{deviation(value, unit, limit)} at {seconds(t)}"


def headline(what: str, report: Report) -> str:
    """Return the title of a figure about `what`, with the names of robot and protocol."""
    return f"{what} · {report.robot} on {report.protocol}"
