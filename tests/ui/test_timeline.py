"""The samples of a playback, and the speeds at which it plays."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.ui.session.timeline import PLAYBACK_SPEEDS, TICK_RATE, _sample_times


@pytest.mark.parametrize("duration", [0.0, 0.004, 1.0, 1.001, 4.15, 8.05, 16.35])
def test_the_end_of_a_motion_is_sampled_once(duration):
    """By rounding, 4.15 s times 60 is more than 249."""
    t = _sample_times(duration)
    assert t[0] == 0.0
    assert t[-1] == duration
    assert len(t) == int(np.ceil(np.round(duration * TICK_RATE, 6))) + 1
    assert (np.diff(t) > 1e-6).all()


def test_the_page_of_the_headset_offers_the_same_speeds():
    sheet = Path(twin.__file__).parent / "ui/headset/web/src/sheet.ts"
    speeds = re.search(r"const SPEEDS = (\[.*?\]);", sheet.read_text(encoding="utf-8"))
    assert speeds is not None
    assert tuple(json.loads(speeds[1])) == PLAYBACK_SPEEDS
