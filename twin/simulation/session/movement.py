"""Measures of the motion of a tip: speed, movements (intervals between rests), economy of motion, smoothness."""

from __future__ import annotations

import numpy as np

from twin.core.spatial import Array

RESTS = 5e-3
"""Maximum speed in m/s of a tip at rest; ASSUMED: above the tremor of a tip at a motion scale of 0.5."""

SHORT = 0.1
"""Minimum duration of movements and rests in s; ASSUMED. Shorter movements are tremor; shorter rests are ignored."""

CUT_OFF = 10.0
"""Largest frequency in Hz of the spectral arc length; the positions are low-pass filtered at this frequency, too."""

AMPLITUDE = 0.05
"""Smallest amplitude of the spectral arc length, relative to the amplitude at 0 Hz."""

PADDING = 4
"""Padding of the spectral arc length, as an exponent of two."""


def speed(p: Array, dt: float) -> Array:
    """Return the speed (k,) in m/s of a point p (k, 3) in m, sampled every dt in s, by central differences.

    The positions are first filtered forwards and backwards by a Butterworth filter of order 2 at `CUT_OFF`. Without
    this filter, hand states that arrive 30 to 60 times per second would move the tip in steps of a much higher speed.
    """
    if len(p) < 2:
        return np.zeros(len(p))
    if 0.5 / dt > CUT_OFF:
        from scipy.signal import butter, sosfiltfilt  # takes 0.7 s; a server does not need it at start

        # forwards and backwards, so that the filter shifts no movement in time
        low = butter(2, CUT_OFF, fs=1 / dt, output="sos")
        p = sosfiltfilt(low, p, axis=0, padlen=min(len(p) - 1, round(0.1 / dt)))
    return np.linalg.norm(np.gradient(p, dt, axis=0), axis=1)


def path_length(p: Array) -> float:
    """Return the length in m of the path of a point p (k, 3)."""
    return float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())


def movements(v: Array, dt: float) -> list[tuple[int, int]]:
    """Return (first, last) samples of each movement in a speed v (k,) in m/s, sampled every dt in s.

    A movement is an interval in which the speed is above `RESTS`. Rests shorter than `SHORT` belong to the movement
    around them; movements shorter than `SHORT` do not count.
    """
    joined: list[tuple[int, int]] = []
    for first, last in runs(v > RESTS):
        begin = first
        if joined:
            previous_begin, previous_end = joined[-1]
            if (first - previous_end - 1) * dt < SHORT:
                begin = previous_begin
                joined.pop()
        joined.append((begin, last))
    shortest = SHORT - 1e-9  # a movement of exactly `SHORT` counts, whatever its samples round to
    long_enough = []
    for first, last in joined:
        if (last - first + 1) * dt >= shortest:
            long_enough.append((first, last))
    return long_enough


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, last) indices of each run of true values in flags (k,)."""
    padded = np.concatenate([[False], flags, [False]]).astype(int)
    edges = np.flatnonzero(np.diff(padded))
    firsts = edges[::2].tolist()
    lasts = (edges[1::2] - 1).tolist()
    return list(zip(firsts, lasts, strict=True))


def economy(p: Array, movement_rows: list[tuple[int, int]]) -> float:
    """Return the economy of motion: straight distances of all movements divided by their path lengths, 0 to 1.

    Distances and path lengths are added up over the movements; the result is NaN without a movement. `p` (k, 3):
    positions of the point in m; `movement_rows`: the result of `movements`.
    """
    straight = 0.0
    path = 0.0
    for first, last in movement_rows:
        straight += float(np.linalg.norm(p[last] - p[first]))
        path += path_length(p[first : last + 1])
    if path > 0:
        return straight / path
    return np.nan


def spectral_arc_length(v: Array, dt: float) -> float:
    """Return the smoothness (SPARC) of one movement with speed v (k,), sampled every dt in s; the result is at most 0.

    Source: S. Balasubramanian, A. Melendez-Calderon, A. Roby-Brami, E. Burdet, On the analysis of movement smoothness,
    J. NeuroEng. Rehabil. 12:112, 2015, eqs (1) to (3), which refines the measure of Balasubramanian et al., IEEE Trans.
    Biomed. Eng. 59(8), 2012. SPARC is the negative arc length of the amplitude spectrum. Amplitudes are divided by the
    amplitude at 0 Hz. The spectrum ends at the last frequency, up to 10 Hz, with an amplitude of at least 0.05.
    Frequencies are divided by this last frequency.

    Raises:
        ValueError: the speed is zero everywhere.
    """
    if not np.any(v):
        raise ValueError("the speed is zero everywhere: the smoothness is undefined")
    count = 2 ** (int(np.ceil(np.log2(len(v)))) + PADDING)
    f = np.fft.rfftfreq(count, dt)
    amplitude = np.abs(np.fft.rfft(v, count))
    amplitude /= amplitude.max()
    low = f <= CUT_OFF
    f = f[low]
    amplitude = amplitude[low]
    end = int(np.flatnonzero(amplitude >= AMPLITUDE)[-1])
    if end == 0:
        return 0.0
    frequency_steps = np.diff(f[: end + 1]) / f[end]
    amplitude_steps = np.diff(amplitude[: end + 1])
    return -float(np.hypot(frequency_steps, amplitude_steps).sum())
