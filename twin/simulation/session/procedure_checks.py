"""Judge a procedure from the signals of its World: five stages, and what must not happen in any of them.

Nothing that the surgeon says is used: clips, cuts, the bed, depths and places are those of the World.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.procedure import ProcedureTable
from twin.model.tissue import Tissue
from twin.model.vessel import Vessel
from twin.simulation.world import Recording

_SHUT = 1 - 1e-9
"""Smallest fraction of a vessel's width between the legs of a clip that shuts it."""


@dataclass(frozen=True)
class Check:
    """Result of a check.

    Attributes:
        name: "expose", "show", "clip", "cut", "remove"; "organs" and "vessels" for what is to be spared.
        done: whether it is passed.
        t: time in s at which it was passed; None: not passed, or a check of the whole session.
        text: what was measured, and the limit.
    """

    name: str
    done: bool
    t: float | None
    text: str


@dataclass(frozen=True)
class ProcedureMeasures:
    """Measures of a procedure.

    Attributes:
        checks: the five stages in order, then the checks of the whole session.
        time: time in s until the last stage was passed; of the session if one was not.
        paths: length in m of the path of each tip.
        clips: number of clips used.
        energy: energy in J that the bed got.
        largest_pull: largest force of a grasper in N.
        slipped: largest distance in m by which something slipped in the jaws.
    """

    checks: Sequence[Check]
    time: float
    paths: Mapping[str, float]
    clips: int
    energy: float
    largest_pull: float
    slipped: float

    @property
    def done(self) -> bool:
        """Whether all checks are passed."""
        return all(c.done for c in self.checks)


def measure(
    kept: Recording,
    p: ProcedureTable,
    organ: Tissue,
    vessels: Sequence[Vessel],
    ports: Sequence[Array],
) -> ProcedureMeasures:
    """Return the measures of a session.

    Args:
        kept: the signals that `twin.simulation.plants.tissue.Operating` writes, and their times.
        p: the procedure.
        organ: the organ that is taken out.
        vessels: all vessels, in the order of their numbers in `clip_<k>.on`.
        ports: (3,) of each port in the World in m.
    """
    robots = [n for n in p.start if f"{n}.holds" in kept.sizes]
    number = next(k for k, v in enumerate(vessels) if v.name == p.vessel)
    clips = [
        _Clip(kept, n.removesuffix(".on")) for n in sorted(kept.sizes) if n.startswith("clip_") and n.endswith(".on")
    ]
    first = min((c.t for c in clips), default=np.inf)
    before = slice(0, int(np.searchsorted(kept.t, first)))
    cut = kept[f"{p.vessel}.cut"]
    severed = np.flatnonzero(cut.any(axis=1))
    t_cut = float(kept.t[severed[0]]) if len(severed) else np.inf
    shut = [c for c in clips if c.on == number and c.cover >= _SHUT]
    stages = [
        _expose(kept, p, robots, first, before),
        _show(kept, p, first, before),
        _clip(p, [c for c in shut if c.t <= t_cut], clips, number),
        _cut(vessels[number], cut[-1], shut, t_cut),
        _remove(kept, p, organ, ports),
    ]
    whole = [_organs(kept, p), _vessels(kept, vessels, clips, number)]
    times = [c.t for c in stages if c.t is not None]
    paths = {n: float(np.linalg.norm(np.diff(kept[f"{n}.tip"], axis=0), axis=1).sum()) for n in robots}
    return ProcedureMeasures(
        [*stages, *whole],
        max(times) if len(times) == len(stages) else float(kept.t[-1]),
        paths,
        sum(c.t < np.inf for c in clips),
        float(kept[f"{organ.name}.energy"][-1].sum()),
        max((float(np.linalg.norm(kept[f"{n}.pull"], axis=1).max()) for n in robots), default=0.0),
        max((float(kept[f"{n}.slipped"].max()) for n in robots), default=0.0),
    )


class _Clip:
    """A clip at the end: on which vessel (-1: none), where in m, its cover; when in s, infinite: unused."""

    def __init__(self, kept: Recording, name: str) -> None:
        on = kept[f"{name}.on"][:, 0]
        used = np.flatnonzero(on > -1.5)
        self.t = float(kept.t[used[0]]) if len(used) else np.inf
        self.on = round(float(on[-1]))
        self.at, self.cover = float(kept[f"{name}.at"][-1, 0]), float(kept[f"{name}.cover"][-1, 0])


def _expose(kept: Recording, p: ProcedureTable, robots: Sequence[str], first: float, before: slice) -> Check:
    lifts = np.zeros(len(kept.t[before]))
    for n in robots:
        held = kept[f"{n}.holds"][before, 0] == 0
        lifts = np.maximum(lifts, np.where(held, kept[f"{n}.lifted"][before, 2], 0.0))
    last = float(lifts[-1]) if len(lifts) else 0.0
    high = np.flatnonzero(lifts >= p.lift_mm * MM)
    done = last >= p.lift_mm * MM
    when = "when the first clip was placed" if np.isfinite(first) else "at the end"
    text = f"the held point of the {p.organ} was {last / MM:.1f} mm above its place {when} (required: {p.lift_mm:g} mm)"
    return Check("expose", done, float(kept.t[high[0]]) if done else None, text)


def _show(kept: Recording, p: ProcedureTable, first: float, before: slice) -> Check:
    seen = kept[f"{p.vessel}.seen"][before, 0] >= p.seen
    run = best = 0
    t = None
    for k, yes in enumerate(seen):
        run = run + 1 if yes else 0
        best = max(best, run)
        if t is None and run * kept.dt >= p.seen_s:
            t = float(kept.t[k])
    text = (
        f"{p.camera} saw at least {p.seen:.0%} of the {p.vessel} for {best * kept.dt:.1f} s"
        f"{' before the first clip' if np.isfinite(first) else ''} (required: {p.seen_s:g} s)"
    )
    return Check("show", t is not None, t, text)


def _clip(p: ProcedureTable, shut: Sequence[_Clip], clips: Sequence[_Clip], number: int) -> Check:
    wanted = p.clips_kept + p.clips_taken
    part = sum(c.on == number and c.cover < _SHUT for c in clips)
    beside = sum(c.on == -1 for c in clips)
    more = "".join(
        f"; {n} {what}" for n, what in ((part, "closed on a part of its width"), (beside, "closed beside it")) if n
    )
    text = f"{len(shut)} clips shut the {p.vessel} before it was cut (required: {wanted}){more}"
    times = sorted(c.t for c in shut)
    done = len(shut) >= wanted
    return Check("clip", done, times[wanted - 1] if done else None, text)


def _cut(v: Vessel, cut: Array, shut: Sequence[_Clip], t: float) -> Check:
    gone = np.flatnonzero(cut)
    if not len(gone):
        return Check("cut", False, None, f"the {v.name} is not cut")
    low, high = v.arc[gone[0]], v.arc[gone[-1] + 1]
    taken, kept = (sum(c.at < low for c in shut), sum(c.at > high for c in shut))
    open_ends = [side for side, n in (("the organ", taken), ("the side that stays", kept)) if n == 0]
    text = f"cut {low / MM:.1f} mm from the organ, clips: {taken} on its side, {kept} on the side that stays"
    if open_ends:
        text += f"; the end towards {' and '.join(open_ends)} is open: bile leaks"
    return Check("cut", not open_ends, None if open_ends else t, text)


def _remove(kept: Recording, p: ProcedureTable, organ: Tissue, ports: Sequence[Array]) -> Check:
    freed, energy = kept[f"{organ.name}.freed"] > 0.5, kept[f"{organ.name}.energy"]
    mean = organ.weights.mean(axis=0)
    middle = np.einsum("j,tjk->tk", mean, kept[f"{organ.name}.nodes"].reshape(len(freed), -1, 3))
    far = np.min([np.linalg.norm(middle - port, axis=1) for port in ports], axis=0)
    done = freed.all(axis=1) & (energy.min(axis=1) >= p.bed_j) & (far <= p.out_mm * MM)
    text = (
        f"{int(freed[-1].sum())} of {freed.shape[1]} cells of the bed are free (at least {p.bed_j:g} J each); the "
        f"middle of the {organ.name} is {far[-1] / MM:.0f} mm from the nearest port (allowed: {p.out_mm:g} mm)"
    )
    yes = bool(done[-1])
    return Check("remove", yes, float(kept.t[np.flatnonzero(done)[0]]) if yes else None, text)


def _organs(kept: Recording, p: ProcedureTable) -> Check:
    depths = {name: float(kept[f"{name}.depth"].max()) for name in p.spare}
    worst = max(depths, key=lambda n: depths[n])
    text = f"deepest tip {depths[worst] / MM:.1f} mm below the rest surface of the {worst} (allowed: {p.depth_mm:g} mm)"
    return Check("organs", depths[worst] <= p.depth_mm * MM, None, text)


def _vessels(kept: Recording, vessels: Sequence[Vessel], clips: Sequence[_Clip], number: int) -> Check:
    wrong = [
        f"{sum(c.on == k for c in clips)} clips on and {int(kept[f'{v.name}.cut'][-1].sum())} cuts of the {v.name}"
        for k, v in enumerate(vessels)
        if k != number and (any(c.on == k for c in clips) or kept[f"{v.name}.cut"][-1].any())
    ]
    return Check("vessels", not wrong, None, "; ".join(wrong) or "no other vessel was clipped or cut")
