"""Numbers and curves of the report."""

import math

import numpy as np
import pytest

from twin.core import findings
from twin.core import format as fmt
from twin.core.quantity import Quantity
from twin.core.units import DEG
from twin.ui.report import plot_data


def test_thinned_curves_keep_peaks_gaps_and_ends():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 12, 15000)
    for peak in (0, 1, 7499, 14998, 14999, *rng.integers(0, 15000, 20)):
        y = np.sin(t)
        y[peak] = 9.0
        y[(peak + 3000) % 15000] = -9.0
        y[5000:5200] = np.nan if not 5000 <= peak < 5200 else 1.0
        tt, yy = plot_data.thinned_curve(t, y)
        assert len(tt) <= plot_data.MAX_CURVE_POINTS
        assert (tt[0], tt[-1]) == (t[0], t[-1])
        assert np.all(np.diff(tt) > 0)
        assert t[peak] in tt[yy == 9.0]
        if not np.isnan(y).any():
            continue
        assert np.isnan(yy[(tt > t[5010]) & (tt < t[5190])]).all()
        assert np.isnan(yy).any()
    assert plot_data.thinned_curve(t[:50], t[:50])[0] is not None


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (12.3e-9, "m", "12.3 nm"),
        (0.04578, "m", "45.78 mm"),
        (0.05 * DEG, "rad", "0.05°"),
        (0.0, "m", "0 mm"),
        (-0.0123, "m", "-12.3 mm"),
        (999.96e-9, "m", "1 µm"),
        (0.657, "m", "657 mm"),
        (12.0, "m", "12 m"),
        (1e-13, "m", "< 1 pm"),
        (3e-17, "m", "< 1 pm"),
        (0.1, "m/s", "100 mm/s"),
        (2e-6, "m/s2", "2 µm/s²"),
        (20 * DEG, "rad/s", "20°/s"),
        (1e-13, "rad", "< 10⁻⁹\u202f°"),
        (123.456 * DEG, "rad", "123.5°"),
        (4.82, "kg", "4.82 kg"),
        (math.nan, "m", "–"),
        (None, "m", "–"),
        (-math.inf, "rad", "-∞"),
    ],
)
def test_quantity(value, unit, text):
    assert fmt.quantity(value, unit) == text


@pytest.mark.parametrize(
    ("value", "unit", "limit", "text"),
    [
        (9e-10, "m", None, "exact"),
        (9e-10, "m", 1e-9, "exact"),
        (9e-10, "m", 1e-11, "900 pm"),  # beyond its tolerance, a difference always has its size
        (-9e-10, "m", 1e-11, "-900 pm"),
        (1.1e-9, "m", 1e-6, "1.1 nm"),
        (9e-10, "rad", None, "exact"),
        (5e-8, "deg", 1.0, "exact"),
        (6e-8, "deg", 1.0, "6×10⁻⁸\u202f°"),
        (9e-7, "mm", None, "exact"),
        (8e-11, "m/s2", 1e-4, "exact"),
        (2e-9, "m/s", 1e-6, "2 nm/s"),
        (1e-12, "kg", None, "1×10⁻¹² kg"),
        (math.nan, "m", 1.0, "–"),
        (math.inf, "m", None, "∞"),
        (None, "m", None, "–"),
    ],
)
def test_a_rounding_error_is_exact_unless_it_is_beyond_its_tolerance(value, unit, limit, text):
    assert fmt.deviation(value, unit, limit) == text


def test_a_finding_says_exact_only_of_a_tolerance_that_is_kept():
    within = findings.finding("info", "a.b", "x", "distance", Quantity(1e-9, "mm"), 0.1, word="tolerance")
    beyond = findings.finding("disagreement", "a.b", "x", "distance", Quantity(1e-9, "mm"), 1e-12, word="tolerance")
    other = findings.finding("info", "a.b", "x", "distance", Quantity(1e-9, "mm"), 0.1)
    assert within.message == "distance: exact (tolerance 0.1 mm)"
    assert within.size == 1e-9  # data keep the number
    assert beyond.message == "distance: 1 pm (tolerance < 1 pm)"
    assert other.message == "distance: 1 pm (limit 0.1 mm)"


def test_other_numbers():
    assert fmt.shown(0.5, "um") == "0.5 µm"
    assert fmt.shown(15.0, "deg") == "15°"
    assert fmt.shown(7850.0, "kg/m3") == "7850 kg/m³"
    assert fmt.shown(80, "deg/s2") == "80°/s²"
    assert fmt.shown(2.1e-10, "mm") == "< 1 pm"
    assert fmt.shown(2.1e-5, "mm") == "21 nm"
    assert fmt.shown(0.35, "") == "0.35"
    assert fmt.ratio(1.27e-3, 1e-6) == "1270×"
    assert fmt.ratio(3e-13, 1e-6) == "3×10⁻⁷"
    assert fmt.ratio(1.0, None) == "–"
    assert fmt.seconds(7.2081) == "7.208 s"
    assert fmt.point((0.38, 0.28, 0.145)) == "(380.00, 280.00, 145.00) mm"
    assert fmt.count(1, "warning") == "1 warning"
    assert fmt.count(15001, "sample") == "15\u202f001 samples"
