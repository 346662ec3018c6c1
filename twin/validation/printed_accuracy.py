"""Check the errors that a study prints for its console: the RMSE, and what a simulated accuracy test explains of them.

A paper may define its RMSE in several ways; each definition is computed from the printed mean and standard deviation.
The simulated test shows how much of the printed deviation the resolution of the haptic pen explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from twin.core.findings import Finding, disagreement, info, warning
from twin.core.json_types import JsonMapping, JsonObject
from twin.core.quantity import Quantity
from twin.core.result import TextTable
from twin.core.spatial import Array
from twin.validation.group_tables import Accuracy, AccuracyChain, AngleChain, half_digit

_LARGEST_EXACT_ERROR = 1e-6
"""Error in mm or deg from which the equations themselves are wrong; rounding errors are far smaller."""

_STD_QUANTILE = 0.99
"""A printed standard deviation above this quantile of the simulated ones is not explained by the resolution."""


def errors_as_data(rows: Sequence[Accuracy]) -> list[JsonObject]:
    """Return the plain data of the printed errors, with the RMSE by each definition."""
    data: list[JsonObject] = []
    for accuracy in rows:
        readings = {}
        for name, span in rms_readings(accuracy).items():
            readings[name] = list(span)
        data.append({"name": accuracy.name, "printed_rmse": accuracy.rmse, "readings": readings})
    return data


def measured_rows(measured: JsonMapping) -> list[tuple[str, str]]:
    """Return a row for each number of the simulated test; vectors have a row for each axis."""
    rows: list[tuple[str, str]] = []
    for name, value in measured.items():
        if not isinstance(value, list):
            rows.append((name, f"{value:.3g}"))
        elif len(value) == 1:
            rows.append((name, f"{value[0]:.3g}"))
        else:
            for axis, component in zip("xyz", value, strict=False):
                rows.append((f"{name} {axis}", f"{component:.3g}"))
    return rows


def rms_readings(accuracy: Accuracy) -> dict[str, tuple[float, float]]:
    """Return {definition of the RMSE: (minimum, maximum) of the RMSE}, from the rounding of the printed components."""
    half = half_digit(accuracy.decimals)
    mean = np.abs(np.array(accuracy.mean))
    std = np.array(accuracy.std)
    # of one axis, the mean square is mean^2 + std^2; both were rounded
    low = np.hypot(np.maximum(mean - half, 0), np.maximum(std - half, 0))
    high = np.hypot(mean + half, std + half)
    return {
        "root mean square of the axes": (_root_mean_square(low), _root_mean_square(high)),
        "length of the vector": (float(np.linalg.norm(low)), float(np.linalg.norm(high))),
        "worst axis": (float(np.max(low)), float(np.max(high))),
    }


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _fitting_definitions(accuracy: Accuracy) -> list[str]:
    """Return the definitions of the RMSE that agree with the printed RMSE."""
    half = half_digit(accuracy.decimals)
    fitting: list[str] = []
    for definition, (low, high) in rms_readings(accuracy).items():
        if low <= accuracy.rmse + half and accuracy.rmse - half <= high:
            fitting.append(definition)
    return fitting


def check_rmse(rows: Sequence[Accuracy]) -> Iterator[Finding]:
    """Yield a finding for each printed RMSE that agrees with no definition."""
    for accuracy in rows:
        if _fitting_definitions(accuracy):
            continue
        definitions: list[str] = []
        distances: list[float] = []
        for definition, (low, high) in rms_readings(accuracy).items():
            definitions.append(f"{definition} {low:.{accuracy.decimals}f} to {high:.{accuracy.decimals}f}")
            distances.append(max(low - accuracy.rmse, accuracy.rmse - high))
        yield disagreement(
            "study.rmse",
            accuracy.name,
            f"{accuracy.name}: the printed RMSE of {accuracy.rmse:.{accuracy.decimals}f} {accuracy.unit} does not "
            f"follow from the printed mean and std by any definition ({', '.join(definitions)})",
            size=Quantity(min(distances), accuracy.unit),
            limit=half_digit(accuracy.decimals),
            suggestion="compare axis by axis: mean and std, not RMSE",
            word="",
        )


def error_table(rows: Sequence[Accuracy]) -> TextTable:
    """Return a table of the printed RMSE of each test, its range by each definition, and the definitions that agree."""
    definitions = list(rms_readings(rows[0]))
    lines: list[list[str]] = []
    for accuracy in rows:
        cells = [accuracy.name, f"{accuracy.rmse:.{accuracy.decimals}f} {accuracy.unit}"]
        for low, high in rms_readings(accuracy).values():
            cells.append(f"{low:.{accuracy.decimals}f} .. {high:.{accuracy.decimals}f}")
        cells.append(", ".join(_fitting_definitions(accuracy)))
        lines.append(cells)
    return TextTable(("", "printed RMSE", *definitions, "agrees with"), lines)


def check_displacements(
    chain: AccuracyChain, printed: Accuracy, measured: JsonMapping, stds: Sequence[float]
) -> Iterator[Finding]:
    """Yield findings on the errors `measured` in a simulated test with displacements (`simulated_accuracy.measure`).

    `stds` (3,) are the standard deviations of the error along x, y and z in mm.
    """
    yield from _check_unquantised("chain", "pen", Quantity(measured["largest_error_unquantised_mm"], "mm"))
    largest = measured["largest_error_mm"]
    if largest > chain.required_mm:
        yield disagreement(
            "study.required",
            "chain",
            "largest error in the simulated accuracy test",
            size=Quantity(largest, "mm"),
            limit=chain.required_mm,
            suggestion=f"measure with a pen of finer resolution than {chain.resolution_mm:g} mm",
            word="required",
        )
    # the paper measured once: its deviation may be above the long-run one by chance
    percentile = _std_percentile(chain.displacements)
    beyond = _axes_beyond(printed, stds, percentile)
    if beyond:
        largest_std = max(stds)
        limit = float(percentile * largest_std)
        yield warning(
            "study.quantised",
            printed.name,
            f"in {chain.displacements} displacements, a pen with a resolution of {chain.resolution_mm:g} mm causes a "
            f"standard deviation of {largest_std:.4f} mm on average, and of at most {limit:.3f} mm (99th percentile); "
            f"the paper prints {', '.join(beyond)} mm",
            size=Quantity(max(printed.std), "mm"),
            limit=limit,
            suggestion="look for other sources of error than the resolution of the pen",
            word="",
        )


def _check_unquantised(chain: str, device: str, largest: Quantity) -> Iterator[Finding]:
    """Yield a finding if the equations have an error with an exact device; `largest` is the largest error."""
    if largest.value >= _LARGEST_EXACT_ERROR:
        yield disagreement(
            "study.chain",
            chain,
            f"the equations have an error even with an exact {device} (no quantisation): largest error",
            size=largest,
            limit=_LARGEST_EXACT_ERROR,
            suggestion="judge the equations of the console: twin console davinci",
        )


def _axes_beyond(printed: Accuracy, stds: Sequence[float], percentile: float) -> list[str]:
    """Return the axes whose printed standard deviation is above `percentile` times the simulated one, with it."""
    beyond: list[str] = []
    for axis, printed_std, std in zip("xyz", printed.std, stds, strict=True):
        if printed_std > percentile * std:
            beyond.append(f"{axis} {printed_std:.3f}")
    return beyond


def _std_percentile(samples: int) -> float:
    """Return the 99th percentile of the standard deviation of a sample, relative to that of the population."""
    from scipy import stats

    # (n - 1) s^2 / sigma^2 of normal values has a chi-square distribution
    freedom = samples - 1
    return float(np.sqrt(stats.chi2.ppf(_STD_QUANTILE, freedom) / freedom))


def check_rotations(
    chain: AngleChain, printed: Accuracy, measured: JsonMapping, stds: Sequence[float]
) -> Iterator[Finding]:
    """Yield findings on the errors `measured` in a simulated test with rotations (`simulated_accuracy.measure_angles`).

    `stds` (3,) are the standard deviations of the error about x, y and z in degrees.
    """
    yield from _check_unquantised("angle_chain", "gimbal", Quantity(measured["largest_error_unquantised_deg"], "deg"))
    percentile = _std_percentile(chain.rotations)
    beyond = _axes_beyond(printed, stds, percentile)
    mean_std = float(np.mean(stds))
    typical = f"a standard deviation of {mean_std:.4f} deg on average, and of at most {percentile * mean_std:.3f} deg"
    gimbal = (
        f"in {chain.rotations} rotations, a gimbal with a resolution of {chain.resolution_deg:g} deg "
        f"({chain.provenance})"
    )
    if beyond:
        yield warning(
            "study.quantised",
            printed.name,
            f"{gimbal} causes {typical} (99th percentile); the paper prints {', '.join(beyond)} deg",
            size=Quantity(max(printed.std), "deg"),
            limit=percentile * mean_std,
            suggestion="look for other sources of error than the resolution of the gimbal",
            word="",
        )
    else:
        text = f"{gimbal} causes {typical}: the resolution explains the printed ones"
        yield info("study.explained", printed.name, text)
