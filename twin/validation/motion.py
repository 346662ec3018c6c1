"""What needs no equations: the motion baked into USD and read back, and whether parts run through each other.

`measure` is plain arrays in, plain arrays out, so that it can run beside the comparison with the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import StageError
from twin.core.findings import Finding, Severity
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import Trajectory, key_times
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, clearance
from twin.reference.mating import Mate, mates
from twin.usd.read import read_motion
from twin.usd.write import Motion, write_motion, write_stage
from twin.validation.result import PhaseSummary, Residual
from twin.validation.rows import Clock, Tolerances, rotation_vectors, row, text

KEY_RATE = 60.0
"""Hz of baked motion."""

CLEARANCE_RATE = 5.0
"""Hz at which distances between parts are measured."""

MIDDLE = 4
"""Of the intervals between keys every fourth is looked into."""

TIME = 1e-6
"""Seconds by which a time code may be beside the time that it stands for."""


@dataclass(frozen=True)
class Samples:
    """When to look at a motion, and where its tool then is.

    Attributes:
        name: of the protocol.
        keys, Ts_keys, q_keys: time codes (k,) in s of the baked motion, T_base_tool (k, 4, 4) and joints (k, n) there.
        middle, Ts_middle, q_middle: times between keys.
        sparse, Ts_sparse, q_sparse: times at which distances are measured.
        followed: as in the trajectory.
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

    def links(self, model: ReferenceModel, Ts: Array, q: Array) -> dict[str, Array]:
        """Return T_base_body (k, 4, 4) of every body at poses, or at joint values where the mechanism was led."""
        run = model.run(q) if self.followed else model.run_poses(Ts, near=q)
        return model.link_poses(run.x)


@dataclass(frozen=True)
class Measured:
    """What `measure` found.

    Attributes:
        times: time codes read back (k,) in s.
        position, rotation: largest error (k,) of any baked link at its time codes, m and rad.
        between: largest error (j,) in m of any link, interpolated linearly between keys.
        clearance: distances at `Samples.sparse`, or None if no body has a mesh.
        written: the same of a motion that was written before, or None if there is none.
        mates: how far the parts of each joint are apart as drawn.
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
    """A motion that lies beside a stage: its file, its time codes (k,) in s, and how far (k,) its links are off.

    `missing` names bodies without samples that move. Errors are given at the times that were meant; without them
    (another number, another rate) they are empty.
    """

    file: str
    times: Array
    position: Array
    rotation: Array
    missing: tuple[str, ...] = ()


def samples(trajectory: Trajectory) -> Samples:
    """Return when and where `measure` is to look."""
    keys = key_times(trajectory.duration, KEY_RATE)
    middle = (0.5 * (keys[1:] + keys[:-1]))[::MIDDLE]
    sparse = np.linspace(0.0, trajectory.duration, max(2, int(trajectory.duration * CLEARANCE_RATE) + 1))

    def at(times: Array) -> tuple[Array, Array, Array]:
        return times, trajectory.poses(times), trajectory.joints(times)

    return Samples(trajectory.protocol, *at(keys), *at(middle), *at(sparse), trajectory.followed)


def measure(mechanism: Mechanism, samples: Samples, written: Path | None = None) -> Measured:
    """Bake the mechanism's motion, read it back, and measure distances between parts.

    Args:
        mechanism: what moves.
        samples: when to look.
        written: a stage with the motion baked in it before, to be held against the mechanism as well.

    Raises:
        AssemblyError: the mechanism cannot take the tool poses.
    """
    model = ReferenceModel(mechanism)
    links = samples.links(model, samples.Ts_keys, samples.q_keys)
    with Scratch() as folder:
        home = model.home()
        bare = replace(mechanism, bodies=tuple(replace(b, meshes=()) for b in mechanism.bodies))
        write_stage(bare, Path(folder), home.link_poses, home.q_full)
        files = write_motion(bare, Path(folder), Motion(samples.name, samples.keys, links))
        times, back = read_motion(files.root)
    between = samples.links(model, samples.Ts_middle, samples.q_middle)
    position, rotation = np.zeros(len(samples.keys)), np.zeros(len(samples.keys))
    apart = np.zeros(len(samples.middle))
    if len(times) == len(samples.keys):
        for name, Ts in links.items():
            read = back[name]
            position = np.maximum(position, np.linalg.norm(read[:, :3, 3] - Ts[:, :3, 3], axis=1))
            rotation = np.maximum(rotation, np.linalg.norm(rotation_vectors(Ts, read), axis=1))
            blend = 0.5 * (read[1:, :3, 3] + read[:-1, :3, 3])[::MIDDLE]
            apart = np.maximum(apart, np.linalg.norm(blend - between[name][:, :3, 3], axis=1))
    found = None
    if any(b.meshes for b in mechanism.bodies):
        found = clearance(mechanism, samples.links(model, samples.Ts_sparse, samples.q_sparse))
    return Measured(
        times, position, rotation, apart, found, written_motion(written, samples.keys, links), tuple(mates(mechanism))
    )


def written_motion(root: Path | None, keys: Array, links: Mapping[str, Array]) -> Written | None:
    """Return how far the motion baked into a stage is off the poses (k, 4, 4) of the links at times (k,) in s."""
    if root is None:
        return None
    try:
        times, back = read_motion(root)
    except StageError as error:
        return Written(f"{root.name}: {error}", np.zeros(0), np.zeros(0), np.zeros(0))
    missing = tuple(n for n in links if n not in back)
    if len(times) != len(keys) or np.abs(times - keys).max() > TIME:
        return Written(root.name, times, np.zeros(0), np.zeros(0), missing)
    position, rotation = np.zeros(len(keys)), np.zeros(len(keys))
    for name, Ts in links.items():
        if name in back:
            position = np.maximum(position, np.linalg.norm(back[name][:, :3, 3] - Ts[:, :3, 3], axis=1))
            rotation = np.maximum(rotation, np.linalg.norm(rotation_vectors(Ts, back[name]), axis=1))
    return Written(root.name, times, position, rotation, missing)


def written_rows(
    written: Written, samples: Samples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances, due: bool
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on a motion that was written before.

    Args:
        written: as measured.
        samples: what was meant.
        phases: of the protocol.
        tolerances: what counts as agreement.
        due: whether it was made for this very motion; one that merely lies there may be older than the protocol.
    """
    keys = Clock(samples.keys, phases)
    severity: Severity = "disagreement" if due else "warning"
    again = "bake it again with `twin build`"
    if len(written.position) != len(samples.keys) or written.missing:
        t = written.times
        has = f"{len(t)} time codes from {t[0]:.4g} to {t[-1]:.4g} s" if len(t) else "no time codes"
        lacks = f"; {', '.join(written.missing)} have none" if written.missing else ""
        said = f"the motion on the stage has {has}{lacks}; the protocol takes {samples.keys[-1]:.4g} s"
        said += f" and {len(samples.keys)} of them: it is not this protocol's, or its samples were moved"
        return [], [Finding("baked.written", severity, said, where=written.file, suggestion=again)]
    rows = [
        row("B-D", "baked", "links as written", unit, values, tolerance if due else None, keys, note=written.file)
        for unit, values, tolerance in (
            ("m", written.position, tolerances.baked_position),
            ("rad", written.rotation, tolerances.baked_rotation),
        )
    ]
    findings = [
        Finding(
            "baked.written",
            severity,
            f"a link of the motion on the stage is {text(r.worst, r.unit)} off the protocol's",
            where=written.file,
            when=f"{r.phase}, t = {r.t:.2f} s",
            suggestion=again,
        )
        for r, limit in zip(rows, (tolerances.baked_position, tolerances.baked_rotation), strict=True)
        if r.worst > limit
    ]
    return rows, findings


def baked_rows(
    measured: Measured, samples: Samples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on the baked motion (D against B)."""
    keys, middle = Clock(samples.keys, phases), Clock(samples.middle, phases)
    if len(measured.times) != len(samples.keys) or np.abs(measured.times - samples.keys).max() > 1e-9:
        return [], [Finding("baked.times", "disagreement", "the baked time codes are not those that were meant")]
    name = "links at their time codes"
    rows = [
        row("B-D", "baked", name, "m", measured.position, tolerances.baked_position, keys),
        row("B-D", "baked", name, "rad", measured.rotation, tolerances.baked_rotation, keys),
    ]
    findings = [
        Finding(
            "baked.differs",
            "disagreement",
            f"a baked link pose is {text(r.worst, r.unit)} off",
            where="motion layer",
            when=f"t = {r.t:.2f} s",
        )
        for r in rows
        if not r.agrees
    ]
    note = f"what a player that interpolates {KEY_RATE:g} Hz keys shows"
    return [*rows, row("B-D", "baked", "links between keys", "m", measured.between, None, middle, note=note)], findings


def clearance_facts(
    found: Clearance, times: Array, phases: tuple[PhaseSummary, ...]
) -> tuple[dict[str, str], list[Finding]]:
    """Return the minimum clearance in words, and a finding for every contact."""
    clock = Clock(times, phases)

    def when(t: float) -> str:
        return f"{clock.phase(t)}, t = {t:.2f} s"

    k = int(np.argmin(found.distance))
    a, b = found.pair[k]
    facts = {
        "minimum clearance": f"{found.distance[k] / MM:.2f} mm between {a} and {b}, {when(float(times[k]))}",
        "method": f"triangle meshes of the CAD (chord tolerance 0.1 mm), {CLEARANCE_RATE:g} Hz, bodies without a "
        "common joint; of jointed bodies, parts that do not mate",
    }
    contacts = [(float(times[i]), p, q) for i, p, q in found.contacts]
    if found.distance[k] <= 0:
        contacts.insert(0, (float(times[k]), a, b))
    return facts, [
        Finding(
            "clearance.contact",
            "disagreement",
            f"{p} and {q} run through each other",
            where=f"{p}, {q}",
            when=when(t),
            size=0.0,
            unit="mm",
            suggestion="change the parts, or the protocol",
        )
        for t, p, q in contacts
    ]
