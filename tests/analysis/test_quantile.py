"""A quantile of batches is that of all values together."""

from __future__ import annotations

import numpy as np
import pytest

from twin.analysis.quantile import UpperQuantile


@pytest.mark.parametrize("count", [1, 2, 3, 20, 21, 1000, 12_345])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95, 1.0])
@pytest.mark.parametrize("batch", [1, 7, 512])
def test_batches_have_the_quantile_of_all(count, share, batch):
    values = np.random.default_rng(count).exponential(size=count)
    quantile = UpperQuantile(share, count)
    for first in range(0, count, batch if count < 2000 else 512):
        quantile.add(values[first : first + (batch if count < 2000 else 512)])
    assert quantile.value == pytest.approx(np.quantile(values, share), rel=1e-14)


def test_equal_values_and_few_of_them_are_kept():
    quantile = UpperQuantile(0.95, 100_000)
    for _ in range(100):
        quantile.add(np.ones(1000))
        assert sum(map(len, quantile._largest)) <= 13_000
    assert quantile.value == 1.0


def test_nan_is_not_lost():
    quantile = UpperQuantile(0.5, 400)
    quantile.add(np.array([np.nan]))
    for _ in range(399):
        quantile.add(np.ones(1))
    assert np.isnan(quantile.value)


def test_another_number_of_values_is_refused():
    with pytest.raises(ValueError, match="at least 1 value"):
        UpperQuantile(0.95, 0)
    quantile = UpperQuantile(0.95, 3)
    quantile.add(np.zeros(2))
    with pytest.raises(ValueError, match="2 values are given; 3 were expected"):
        _ = quantile.value
    with pytest.raises(ValueError, match="4 values are given; 3 were expected"):
        quantile.add(np.zeros(2))
