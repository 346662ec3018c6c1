"""Checks that need no equations: the motion baked into USD and read back, and clearances between parts.

`measure` takes and returns plain data, so that it can run in another process during the comparison.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import StageError
from twin.core.findings import Finding, Kind, Severity, disagreement
from twin.core.quantity import mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion
from twin.planning.trajectory import Trajectory, key_times
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, clearance
from twin.reference.mating import Mate, mates
from twin.usd.read import read_motion
from twin.usd.write import Motion, write_motion, write_stage
from twin.validation.result import PhaseSummary, Residual
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row

KEY_RATE = 60.0
"""Rate in Hz of the keys of the baked motion."""

CLEARANCE_RATE = 5.0
"""Rate in Hz at which clearances are measured."""

MIDDLE = 4
"""Of the intervals between keys, every n-th is checked in its middle; this constant is n."""

TIME = 1e-6
"""Tolerance in s of time codes."""

_DIFFERS = Kind("baked.differs", "disagreement", word="tolerance")
_CONTACT = Kind("clearance.contact", "disagreement", "change the parts, or the protocol", word="")


@dataclass(frozen=True)
class Samples:
    """Tool poses and joint values of a motion at the times that are checked.

    Attributes:
        keys, Ts_keys, q_keys: times (k,) in s of the baked keys; T_base_tool (k, 4, 4) and joint values (k, n) at these
            times.
        middle, Ts_middle, q_middle: times in the middle between two keys, with poses and joint values as above.
        sparse, Ts_sparse, q_sparse: times at which clearances are measured, with poses and joint values as above.
        followed: whether the joint values define the motion; otherwise the tool poses define the motion.
        links: {body: T_base_body (k, 4, 4)} at `keys`, to be baked; None: those of the reference model.
        driver: what determined `links`, as text.
    """

    name: str
    keys: Array
    Ts_keys: Array
    q_keys: Array
    middle: Array
    Ts_middle: Array
    q_middle: Array
    sparse: Array
    Ts_sparse: Array
    q_sparse: Array
    followed: bool = False
    links: Mapping[str, Array] | None = None
    driver: str = ""

    def reference_links(self, model: ReferenceModel, Ts: Array, q: Array) -> dict[str, Array]:
        """Return T_base_body (k, 4, 4) of every body at tool poses Ts or, if `followed`, at joint values q."""
        run = model.run(q) if self.followed else model.run_poses(Ts, near=q)
        return model.link_poses(run.x)


@dataclass(frozen=True)
class Measured:
    """Result of `measure`.

    Attributes:
        times: (k,) in s, time codes read back.
        position, rotation: (k,) in m and rad, largest error of any baked link at each time code.
        between: (j,) in m, largest error of any link in the middle between keys, where the keys are interpolated
            linearly.
        clearance: clearances at the times `Samples.sparse`; None if no body has a mesh.
        written: errors of an existing baked motion; None if no baked motion exists.
        mates: for each joint, the distance in the CAD between the two parts that it connects.
    """

    times: Array
    position: Array
    rotation: Array
    between: Array
    clearance: Clearance | None
    written: Written | None = None
    mates: tuple[Mate, ...] = ()


@dataclass(frozen=True)
class Written:
    """Errors of an existing baked motion: file, time codes (k,) in s, and errors (k,) in m and rad.

    Each error is the largest of all links at one time. The errors are computed at the intended times; the error arrays
    are empty if the time codes differ from the intended times. `missing` lists moving bodies without samples.
    """

    file: str
    times: Array
    position: Array
    rotation: Array
    missing: tuple[str, ...] = ()


def samples(trajectory: Trajectory, motion: LinkMotion | None = None) -> Samples:
    """Return the checked times of a trajectory, with poses and joint values, for `measure`.

    `motion` at `key_times(trajectory.duration, KEY_RATE)` is baked and then judged by the reference model; None: the
    motion of the reference model is baked.
    """
    keys = key_times(trajectory.duration, KEY_RATE)
    middle = (0.5 * (keys[1:] + keys[:-1]))[::MIDDLE]
    sparse = np.linspace(0.0, trajectory.duration, max(2, int(trajectory.duration * CLEARANCE_RATE) + 1))

    def at(times: Array) -> tuple[Array, Array, Array]:
        return times, trajectory.poses(times), trajectory.joints(times)

    if motion is None:
        return Samples(trajectory.protocol, *at(keys), *at(middle), *at(sparse), trajectory.followed)
    followed = trajectory.followed or motion.by_plan
    at_keys = keys, trajectory.poses(keys), motion.q
    return Samples(trajectory.protocol, *at_keys, *at(middle), *at(sparse), followed, motion.links, motion.driver)


def measure(mechanism: Mechanism, samples: Samples, written: Path | None = None) -> Measured:
    """Bake a motion, read it back, compare it with the mechanism, and measure clearances between parts.

    `written` is a stage with an existing baked motion, which is also compared with the mechanism; or None.

    Raises:
        AssemblyError: the mechanism cannot be assembled at one of the tool poses.
    """
    model = ReferenceModel(mechanism)
    links = samples.reference_links(model, samples.Ts_keys, samples.q_keys)
    with Scratch() as folder:
        home = model.home()
        bare = replace(mechanism, bodies=tuple(replace(b, meshes=()) for b in mechanism.bodies))
        write_stage(bare, Path(folder), home.link_poses, home.q_full)
        baked = links if samples.links is None else samples.links
        files = write_motion(bare, Path(folder), Motion(samples.name, samples.keys, baked))
        times, back = read_motion(files.root)
    between = samples.reference_links(model, samples.Ts_middle, samples.q_middle)
    position = rotation = np.zeros(len(samples.keys))
    apart = np.zeros(len(samples.middle))
    if len(times) == len(samples.keys):
        position, rotation = _errors(links, back, len(times))
        for name, Ts in between.items():
            blend = 0.5 * (back[name][1:, :3, 3] + back[name][:-1, :3, 3])[::MIDDLE]
            apart = np.maximum(apart, np.linalg.norm(blend - Ts[:, :3, 3], axis=1))
    found = None
    if any(b.meshes for b in mechanism.bodies):
        found = clearance(mechanism, samples.reference_links(model, samples.Ts_sparse, samples.q_sparse))
    return Measured(
        times, position, rotation, apart, found, written_motion(written, samples.keys, links), tuple(mates(mechanism))
    )


def written_motion(root: Path | None, keys: Array, links: Mapping[str, Array]) -> Written | None:
    """Compare the baked motion of a stage with link poses (k, 4, 4) at times `keys` (k,) in s; None without a stage."""
    if root is None:
        return None
    try:
        times, back = read_motion(root)
    except StageError as error:
        return Written(f"{root.name}: {error}", np.zeros(0), np.zeros(0), np.zeros(0))
    missing = tuple(n for n in links if n not in back)
    if len(times) != len(keys) or np.abs(times - keys).max() > TIME:
        return Written(root.name, times, np.zeros(0), np.zeros(0), missing)
    return Written(root.name, times, *_errors(links, back, len(keys)), missing)


def _errors(links: Mapping[str, Array], back: Mapping[str, Array], count: int) -> tuple[Array, Array]:
    """Return the largest errors (count,) in m and rad of the poses `back` of any link; missing links are skipped."""
    position, rotation = np.zeros(count), np.zeros(count)
    for name, Ts in links.items():
        if name in back:
            position = np.maximum(position, np.linalg.norm(back[name][:, :3, 3] - Ts[:, :3, 3], axis=1))
            rotation = np.maximum(rotation, np.linalg.norm(rotation_vectors(Ts, back[name]), axis=1))
    return position, rotation


def written_rows(
    written: Written, samples: Samples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances, due: bool
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on an existing baked motion.

    `due` states whether the motion was baked from this trajectory. If false, the motion may be older than the protocol,
    and a difference is only a warning.
    """
    keys = Clock(samples.keys, phases)
    severity: Severity = "disagreement" if due else "warning"
    kind = Kind("baked.written", severity, "bake the motion again with `twin build`")
    if len(written.position) != len(samples.keys) or written.missing:
        t = written.times
        has = f"{len(t)} time codes from {t[0]:.4g} to {t[-1]:.4g} s" if len(t) else "no time codes"
        lacks = f"; {', '.join(written.missing)} have no time codes" if written.missing else ""
        said = f"the motion on the stage has {has}{lacks}; the protocol lasts {samples.keys[-1]:.4g} s"
        said += f" and needs {len(samples.keys)} time codes: the motion belongs to another protocol, or was changed"
        return [], [kind(written.file, said)]
    rows = [
        row("B-D", "baked", "links, existing motion", unit, values, tolerance if due else None, keys, note=written.file)
        for unit, values, tolerance in (
            ("m", written.position, tolerances.baked_position),
            ("rad", written.rotation, tolerances.baked_rotation),
        )
    ]
    findings = [
        r.finding(kind, "a link pose of the motion on the stage differs from the motion of the protocol", written.file)
        for r, limit in zip(rows, (tolerances.baked_position, tolerances.baked_rotation), strict=True)
        if r.worst > limit
    ]
    return rows, findings


def baked_rows(
    measured: Measured, samples: Samples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on the baked motion (D), compared with the mechanism (B)."""
    keys, middle = Clock(samples.keys, phases), Clock(samples.middle, phases)
    if len(measured.times) != len(samples.keys) or np.abs(measured.times - samples.keys).max() > 1e-9:
        return [], [disagreement("baked.times", "", "the baked time codes differ from the requested time codes")]
    name = "links at their time codes"
    by = samples.driver
    rows = [
        row("B-D", "baked", name, "m", measured.position, tolerances.baked_position, keys, note=by),
        row("B-D", "baked", name, "rad", measured.rotation, tolerances.baked_rotation, keys, note=by),
    ]
    findings = [
        r.finding(_DIFFERS, "a baked link pose differs from the mechanism", "motion layer", when=f"t = {r.t:.2f} s")
        for r in rows
        if not r.agrees
    ]
    note = f"error of a player that interpolates {KEY_RATE:g} Hz keys"
    return [*rows, row("B-D", "baked", "links between keys", "m", measured.between, None, middle, note=note)], findings


def clearance_facts(
    found: Clearance, times: Array, phases: tuple[PhaseSummary, ...]
) -> tuple[dict[str, str], list[Finding]]:
    """Return the minimum clearance as text, and a finding for each contact."""
    clock = Clock(times, phases)
    k = int(np.argmin(found.distance))
    a, b = found.pair[k]
    facts = {
        "minimum clearance": f"{found.distance[k] / MM:.2f} mm between {a} and {b}, {clock.when(k)}",
        "method": f"triangle meshes of the CAD (chord tolerance 0.1 mm), {CLEARANCE_RATE:g} Hz; pairs of "
        "bodies without a common joint, and parts of jointed bodies that do not form the joint",
    }
    contacts = [(k, a, b)] if found.distance[k] <= 0 else []
    return facts, [
        _CONTACT(f"{p}, {q}", f"{p} and {q} collide", mm(0.0), when=clock.when(i))
        for i, p, q in [*contacts, *found.contacts]
    ]
