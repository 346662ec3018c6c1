"""A workspace on a grid: its size with the error of counting cells, condition numbers, margins, and its text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from twin.analysis import measure
from twin.analysis.pose_grid import PoseGrid
from twin.core.compute_device import PROCESSOR
from twin.core.findings import Finding
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.result import Part, Result
from twin.core.spatial import Array
from twin.core.units import DEG, MM

COLUMNS = measure.NAMES
"""Columns of the values for each position.

`reached`: fraction of the orientations that are reached at the position. The other values are taken over the reached
orientations. `inverse_condition`: mean inverse condition number. `limit_margin`: largest margin to the joint limits.
`singularity`: smallest singularity measure.
"""


@dataclass(frozen=True)
class CellMeasure:
    """Quantity that measures the size of a set of grid cells: volume, area or length.

    Attributes:
        name: "volume", "area" or "length".
        unit: unit as written in keys of the JSON output.
        symbol: unit as written in text.
        edge: edge length in m of a cube, square or line of size 1 in this unit.
        dimension: 3, 2 or 1.
    """

    name: str
    unit: str
    symbol: str
    edge: float
    dimension: int

    def cell(self, step: float) -> float:
        """Return the size, in `unit`, of a cell with an edge length of `step` m."""
        return (step / self.edge) ** self.dimension

    def key(self, what: str = "") -> str:
        """Return the JSON key of the size, such as "volume_dm3"; with `what` = "error", the key "volume_error_dm3"."""
        if what:
            return f"{self.name}_{what}_{self.unit}"
        return f"{self.name}_{self.unit}"


_MEASURES = {
    3: CellMeasure("volume", unit="dm3", symbol="dm³", edge=0.1, dimension=3),
    2: CellMeasure("area", unit="cm2", symbol="cm²", edge=0.01, dimension=2),
    1: CellMeasure("length", unit="mm", symbol="mm", edge=MM, dimension=1),
}


_SETS = {0: "one point", 1: "a curve", 2: "a surface", 3: "a volume"}


@dataclass(frozen=True)
class Workspace(Result):
    """The workspace of a robot.

    Attributes:
        grid: the evaluated positions and orientations.
        values: (positions, 4) values, see `COLUMNS`.
        facts: further results, with the keys of the JSON output.
        dimension: 3 if the reached positions form a volume, 2 for a surface, 1 for a curve, 0 for a point.
    """

    robot: str
    grid: PoseGrid
    values: np.ndarray
    facts: JsonObject = field(default_factory=dict)
    dimension: int = 3

    kind = "workspace"
    judges = False

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Always empty: a workspace is measured, not judged."""
        return ()

    @property
    def reached(self) -> np.ndarray:
        """(k,) bool: whether a position is reached in at least one orientation."""
        return self.values[:, 0] > 0

    @property
    def cube(self) -> np.ndarray:
        """The values of the positions as an array (nx, ny, nz, 4); the last axis has the order of `COLUMNS`."""
        nx, ny, nz = self.grid.shape
        return self.values.reshape(nz, ny, nx, len(COLUMNS)).transpose(2, 1, 0, 3)

    @property
    def measure(self) -> CellMeasure | None:
        """The measured quantity; None for a point, and for a curve or surface that is not parallel to the axes."""
        if self.dimension != len(self.grid.axes):
            return None
        return _MEASURES.get(self.dimension)

    def content(self) -> JsonObject:
        """Return the size, fractions, condition numbers and limits of the workspace as plain data.

        The size is a volume in dm3, an area in cm2 if all positions are in one plane parallel to two axes of base, or a
        length in mm if all positions are on a line parallel to an axis. For other surfaces and curves, the size is
        None.
        """
        grid = self.grid
        reached = self.reached
        reached_values = self.values[reached]
        share = reached_values[:, 0].astype(float)
        inverse = reached_values[:, 1].astype(float)
        low = np.full(3, np.nan)
        high = np.full(3, np.nan)
        mean_share = 0.0
        best_mm = None
        if len(reached_values):
            positions = grid.position(np.flatnonzero(reached))
            low = positions.min(axis=0)
            high = positions.max(axis=0)
            mean_share = float(share.mean())
            best = np.argmax(np.where(reached, self.values[:, 1], -1))
            best_mm = (grid.position(np.array([best]))[0] / MM).tolist()
        conditioning = None
        condition_quantiles: dict[str, float] = {}
        if inverse.any():  # without equations, there are no condition numbers
            conditioning = float(np.average(inverse, weights=share))
            condition_quantiles = _quantiles(inverse)
        return {
            "robot": self.robot,
            "poses": grid.poses,
            "positions": grid.positions,
            "orientations": grid.turns,
            "tilt_deg": grid.tilt / DEG,
            "step_mm": float(grid.step / MM),
            "dimension": self.dimension,
            **self._size(share),
            "share_of_orientations": mean_share,
            "global_conditioning_index": conditioning,
            "inverse_condition_quantiles": condition_quantiles,
            "limit_margin_quantiles": _quantiles(reached_values[:, 2].astype(float)),
            "smallest_singularity_measure": _least(reached_values[:, 3]),
            "box_mm": {"low": (low / MM).tolist(), "high": (high / MM).tolist()},
            "best_position_mm": best_mm,
            **self.facts,
        }

    def _size(self, share: np.ndarray) -> dict[str, float | None]:
        """Return the size and its error; `share` (k,) is the reached fraction of orientations at reached positions."""
        volume_keys = ("volume_dm3", "volume_error_dm3", "volume_every_orientation_dm3")
        sizes: dict[str, float | None] = dict.fromkeys(volume_keys)
        measure = self.measure
        if measure is None:
            return sizes
        cell = measure.cell(self.grid.step)
        reached = self.cube[..., 0] > 0
        error = volume_error(reached, cell)
        if self.facts.get("sampled"):
            # A sampled cell counts if any part is reached: on average half a cell too much at each face of the
            # boundary.
            faces = 0
            for axis in self.grid.axes:
                faces += int(np.diff(reached, axis=axis).sum())
            error += 0.5 * cell * faces
        sizes[measure.key()] = float(cell * len(share))
        sizes[measure.key("error")] = error
        sizes[measure.key("every_orientation")] = float(cell * (share == 1).sum())
        return sizes

    @property
    def key_figures(self) -> tuple[tuple[str, str, str], ...]:
        """Size with its error, best position, conditioning, and what is not checked."""
        content = self.content()
        figures: list[tuple[str, str, str]] = []
        measure = self.measure
        if measure is not None:
            error = float(f"{content[measure.key('error')]:.1g}")
            size = f"{content[measure.key()]:.4g} {measure.symbol}"
            figures.append(("Reached by the tool", size, f"± {error:g} {measure.symbol} by counting cells"))
        if content["best_position_mm"] is not None:
            position = _position_text(content["best_position_mm"])
            figures.append(("Best position x, y, z", f"{position} mm", "largest inverse condition number"))
        conditioning = content["global_conditioning_index"]
        if conditioning is not None:
            figures.append(("Inverse condition, mean", f"{conditioning:.3f}", "0 singular, 1 isotropic"))
        figures.append(("Not checked", "collisions", "and what the list below names"))
        return tuple(figures)

    def text(self) -> Iterator[Part]:
        """Yield the size, condition numbers, margins and the best position."""
        content = self.content()
        yield f"{self.robot} · {_evaluated(content)} · cells of {content['step_mm']:.3g} mm"
        yield ""
        yield f"  reached           {self._size_text(content)} in x, y, z = {_box_text(content)} mm"
        measure = self.measure
        if self.grid.turns > 1 and measure is not None:
            size = content[measure.key("every_orientation")]
            yield f"  every orientation {size:.4g} {measure.symbol} are reached in every orientation"
        conditioning = content["global_conditioning_index"]
        if conditioning is not None:
            quantiles = _listed(content["inverse_condition_quantiles"], digits=3)
            yield f"  inverse condition mean {conditioning:.3f} (quantiles {quantiles})"
        quantiles = _listed(content["limit_margin_quantiles"], digits=2)
        yield f"  joint limits      margin (0 at a limit, 1 in the middle of the range), quantiles {quantiles}"
        if content.get("without_limits"):
            names = ", ".join(content["without_limits"])
            yield f"                    {names}: no limits are stated; -180° to 180° is assumed"
        singularity = content["smallest_singularity_measure"]
        if singularity is not None:
            yield f"  singularity       smallest measure {singularity:.3g}"
        if content["best_position_mm"] is not None:
            reason = ""
            if conditioning is not None:
                reason = " (largest inverse condition number)"
            yield f"  best position     {_position_text(content['best_position_mm'])} mm{reason}"
        if content.get("passive_limits_kept"):
            names = ", ".join(content["passive_limits_kept"])
            yield f"  passive joints    limits of {names} are kept"
        if content.get("passive_limits_unchecked"):
            names = ", ".join(content["passive_limits_unchecked"])
            reason = "the equations do not describe the mechanism of the CAD"
            yield f"  not checked       limits of the passive joints {names}: {reason}"
        if content.get("soft_limits_unchecked"):
            names = ", ".join(content["soft_limits_unchecked"])
            yield f"  not checked       soft limits of {names}, which only cause warnings"
        yield "  not checked       collisions"
        if content.get("device", PROCESSOR) != PROCESSOR:
            yield f"  computed by       {content['device']}"
        yield ""

    def _size_text(self, content: JsonMapping) -> str:
        """Return the size with its error, or what the set of positions is if it has none."""
        measure = self.measure
        if measure is None:
            return f"{_SETS[self.dimension]}, whose size is not computed,"
        error = float(f"{content[measure.key('error')]:.1g}")  # one digit, without an exponent
        place = {2: " of a plane", 1: " of a line"}.get(self.dimension, "")
        return f"{content[measure.key()]:.4g} ± {error:g} {measure.symbol} (error of counting cells){place}"


def _evaluated(content: JsonMapping) -> str:
    """Return what was evaluated: joint samples, or positions and orientations."""
    if content.get("sampled") == "joints":
        return f"{content['samples']} joint positions, {100 * content['assembled']:.1f} % can be assembled"
    turns = content["orientations"]
    if turns == 1:
        return f"{content['poses']} positions in one orientation"
    return f"{content['positions']} positions in {turns} orientations within {content['tilt_deg']:g}° about each axis"


def _box_text(content: JsonMapping) -> str:
    """Return the range of reached positions along x, y and z in mm."""
    box = content["box_mm"]
    ranges = []
    for low, high in zip(box["low"], box["high"], strict=True):
        ranges.append(f"{low:.0f} .. {high:.0f}")
    return ", ".join(ranges)


def _position_text(position_mm: list[float]) -> str:
    """Return a position in whole millimetres, such as "12, 0, -340"."""
    x, y, z = position_mm
    return f"{x:.0f}, {y:.0f}, {z:.0f}"


def _listed(quantiles: dict[str, float], digits: int) -> str:
    """Return quantiles as text, such as "5 %: 0.12, 50 %: 0.34"."""
    words = []
    for name, value in quantiles.items():
        words.append(f"{name}: {value:.{digits}f}")
    return ", ".join(words)


def volume_error(cube: np.ndarray, cell: float) -> float:
    """Return the uncertainty of a volume computed by counting cells, about two standard deviations.

    The grid is split into eight interleaved grids with twice the step (four grids for one layer of cells). The result
    is the standard deviation of the volumes computed from these grids. It is about twice the standard deviation of the
    volume from the full grid, as measured on SILS with shifted grids of 6 to 32 mm.

    `cube` (nx, ny, nz) states whether each position is reached. `cell` is the volume of one cell; the result has the
    same unit.
    """
    counts = []
    for i, j, k in np.ndindex(*np.minimum(cube.shape, 2)):
        counts.append(cube[i::2, j::2, k::2].sum())
    return float(len(counts) * cell * np.std(counts))


def _quantiles(values: Array) -> dict[str, float]:
    """Return {name: value} of the median and of the quantiles near both ends; empty without values."""
    if not len(values):
        return {}
    low, median, high = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    return {"5 %": low, "50 %": median, "95 %": high}


def _least(values: np.ndarray) -> float | None:
    """Return the smallest finite value; None if there is none."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    return float(finite.min())
