"""Checks that need no equations: the motion baked into USD and read back, and clearances between parts.

`measure_motion` takes and returns plain data, so that it can run in another process during the comparison.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch
from twin.core.errors import StageError
from twin.core.findings import Finding, Kind, Severity, disagreement, finding
from twin.core.quantity import mm
from twin.core.spatial import Array
from twin.core.units import MM
from twin.model.mechanism import Mechanism
from twin.planning.link_motion import LinkMotion
from twin.planning.trajectory import Trajectory, key_times
from twin.reference import ReferenceModel
from twin.reference.clearance import Clearance, clearance
from twin.reference.mating import LOOSE, Mate, mates
from twin.usd.read import read_motion, read_stage
from twin.usd.write import BakedMotion, write_motion, write_stage
from twin.validation.residual_rows import SampleClock, Tolerances, rotation_vectors, row
from twin.validation.result import PhaseSummary, Residual

KEY_RATE = 60.0
"""Rate in Hz of the keys of the baked motion."""

CLEARANCE_RATE = 5.0
"""Rate in Hz at which clearances are measured."""

INTERVALS_PER_CHECKED_MIDDLE = 4
"""Of the intervals between keys, every n-th is checked in its middle; this constant is n."""

TIME_TOLERANCE = 1e-6
"""Tolerance in s of time codes."""

_OWN_TIME_TOLERANCE = 1e-9
"""Tolerance in s of the time codes that were written just before, without another program between."""

_SINGLE_PRECISION = 1e-6
"""Tolerance in m of a position stored in single precision."""

_BAKED_DIFFERS = Kind("baked.differs", "disagreement", word="tolerance")
_PARTS_APART = Kind("cad.apart", "disagreement", "check scale and place of the shapes of both bodies")
_CONTACT = Kind("clearance.contact", "disagreement", "change the parts, or the protocol", word="")


@dataclass(frozen=True)
class MotionSamples:
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
        if self.followed:
            run = model.run(q)
        else:
            run = model.run_poses(Ts, near=q)
        return model.link_poses(run.x)


@dataclass(frozen=True)
class MeasuredMotion:
    """Result of `measure_motion`.

    Attributes:
        times: (k,) in s, time codes read back.
        position, rotation: (k,) in m and rad, largest error of any baked link at each time code.
        between: (j,) in m, largest error of any link in the middle between keys, where the keys are interpolated
            linearly.
        clearance: clearances at the times `MotionSamples.sparse`; None if no body has a mesh.
        written: errors of an existing baked motion; None if no baked motion exists.
        mates: for each joint, the distance in the CAD between the two parts that it connects.
    """

    times: Array
    position: Array
    rotation: Array
    between: Array
    clearance: Clearance | None
    written: ExistingMotion | None = None
    mates: tuple[Mate, ...] = ()


@dataclass(frozen=True)
class ExistingMotion:
    """Errors of an existing baked motion: file, time codes (k,) in s, and errors (k,) in m and rad.

    Each error is the largest of all links at one time. The errors are computed at the intended times; the error arrays
    are empty if the time codes differ from the intended times. `missing` lists moving bodies without samples.
    """

    file: str
    times: Array
    position: Array
    rotation: Array
    missing: tuple[str, ...] = ()


def sampled_motion(trajectory: Trajectory, motion: LinkMotion | None = None) -> MotionSamples:
    """Return the checked times of a trajectory, with poses and joint values, for `measure_motion`.

    `motion` at `key_times(trajectory.duration, KEY_RATE)` is baked and then judged by the reference model; None: the
    motion of the reference model is baked.
    """
    keys = key_times(trajectory.duration, KEY_RATE)
    middle = (0.5 * (keys[1:] + keys[:-1]))[::INTERVALS_PER_CHECKED_MIDDLE]
    # both ends also of a motion that is shorter than one interval
    sparse_count = max(2, int(trajectory.duration * CLEARANCE_RATE) + 1)
    sparse = np.linspace(0.0, trajectory.duration, sparse_count)
    planned = MotionSamples(
        name=trajectory.protocol,
        keys=keys,
        Ts_keys=trajectory.poses(keys),
        q_keys=trajectory.joints(keys),
        middle=middle,
        Ts_middle=trajectory.poses(middle),
        q_middle=trajectory.joints(middle),
        sparse=sparse,
        Ts_sparse=trajectory.poses(sparse),
        q_sparse=trajectory.joints(sparse),
        followed=trajectory.followed,
    )
    if motion is None:
        return planned
    followed = trajectory.followed or motion.by_plan
    return replace(planned, q_keys=motion.q, followed=followed, links=motion.links, driver=motion.driver)


def measure_motion(mechanism: Mechanism, samples: MotionSamples, written: Path | None = None) -> MeasuredMotion:
    """Bake a motion, read it back, compare it with the mechanism, and measure clearances between parts.

    `written` is a stage with an existing baked motion, which is also compared with the mechanism; or None.

    Raises:
        AssemblyError: the mechanism cannot be assembled at one of the tool poses.
    """
    model = ReferenceModel(mechanism)
    links = samples.reference_links(model, samples.Ts_keys, samples.q_keys)
    with Scratch() as folder:
        home = model.home()
        # meshes have no influence on the motion
        bodies = []
        for body in mechanism.bodies:
            bodies.append(replace(body, meshes=()))
        bare = replace(mechanism, bodies=tuple(bodies))
        write_stage(bare, Path(folder), home.link_poses, home.q_full)
        baked = links
        if samples.links is not None:
            baked = samples.links
        files = write_motion(bare, Path(folder), BakedMotion(samples.name, samples.keys, baked))
        times, read_back = read_motion(files.root)
    position = np.zeros(len(samples.keys))
    rotation = np.zeros(len(samples.keys))
    between = np.zeros(len(samples.middle))
    # with other time codes, poses cannot be compared: `baked_rows` reports the time codes
    if len(times) == len(samples.keys):
        position, rotation = _largest_errors(links, read_back, len(times))
        in_middle = samples.reference_links(model, samples.Ts_middle, samples.q_middle)
        for name, Ts in in_middle.items():
            p = read_back[name][:, :3, 3]
            # a player interpolates linearly: in the middle of an interval, it shows the mean of the two keys
            interpolated = 0.5 * (p[1:] + p[:-1])[::INTERVALS_PER_CHECKED_MIDDLE]
            between = np.maximum(between, np.linalg.norm(interpolated - Ts[:, :3, 3], axis=1))
    distances = None
    if any(body.meshes for body in mechanism.bodies):
        distances = clearance(mechanism, samples.reference_links(model, samples.Ts_sparse, samples.q_sparse))
    return MeasuredMotion(
        times=times,
        position=position,
        rotation=rotation,
        between=between,
        clearance=distances,
        written=existing_motion(written, samples.keys, links),
        mates=tuple(mates(mechanism)),
    )


def existing_motion(root: Path | None, keys: Array, links: Mapping[str, Array]) -> ExistingMotion | None:
    """Compare the baked motion of a stage with link poses (k, 4, 4) at times `keys` (k,) in s; None without a stage."""
    if root is None:
        return None
    try:
        times, read_back = read_motion(root)
    except StageError as error:
        # reported as a motion without time codes; the reason is part of the file's name
        return ExistingMotion(f"{root.name}: {error}", np.zeros(0), np.zeros(0), np.zeros(0))
    missing = [name for name in links if name not in read_back]
    if len(times) != len(keys) or np.abs(times - keys).max() > TIME_TOLERANCE:
        return ExistingMotion(root.name, times, position=np.zeros(0), rotation=np.zeros(0), missing=tuple(missing))
    return ExistingMotion(root.name, times, *_largest_errors(links, read_back, len(keys)), tuple(missing))


def _largest_errors(links: Mapping[str, Array], read_back: Mapping[str, Array], count: int) -> tuple[Array, Array]:
    """Return the largest errors (count,) in m and rad of the poses `read_back` of any link that is there."""
    position = np.zeros(count)
    rotation = np.zeros(count)
    for name, Ts in links.items():
        if name not in read_back:
            continue
        offset = read_back[name][:, :3, 3] - Ts[:, :3, 3]
        turn = rotation_vectors(Ts, read_back[name])
        position = np.maximum(position, np.linalg.norm(offset, axis=1))
        rotation = np.maximum(rotation, np.linalg.norm(turn, axis=1))
    return position, rotation


def existing_motion_rows(
    written: ExistingMotion, samples: MotionSamples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances, due: bool
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on an existing baked motion.

    `due` states whether the motion was baked from this trajectory. If false, the motion may be older than the protocol,
    and a difference is only a warning.
    """
    keys = SampleClock(samples.keys, phases)
    severity: Severity = "disagreement" if due else "warning"
    kind = Kind("baked.written", severity, "bake the motion again with `twin build`")
    if len(written.position) != len(samples.keys) or written.missing:
        t = written.times
        text = "the motion on the stage has no time codes"
        if len(t):
            text = f"the motion on the stage has {len(t)} time codes from {t[0]:.4g} to {t[-1]:.4g} s"
        if written.missing:
            text += f"; {', '.join(written.missing)} have no time codes"
        text += f"; the protocol lasts {samples.keys[-1]:.4g} s"
        text += f" and needs {len(samples.keys)} time codes: the motion belongs to another protocol, or was changed"
        return [], [kind(written.file, text)]
    rows = []
    findings = []
    text = "a link pose of the motion on the stage differs from the motion of the protocol"
    for unit, errors, tolerance in (
        ("m", written.position, tolerances.baked_position),
        ("rad", written.rotation, tolerances.baked_rotation),
    ):
        limit = tolerance if due else None  # a motion that may be older than the protocol is not judged
        residual = row(
            "B-D",
            "baked",
            "links, existing motion",
            unit=unit,
            differences=errors,
            tolerance=limit,
            clock=keys,
            note=written.file,
        )
        rows.append(residual)
        if residual.worst > tolerance:
            findings.append(residual.finding(kind, text, written.file))
    return rows, findings


def written_trocars(root: Path | None, mechanism: Mechanism, due: bool) -> list[Finding]:
    """Return a finding for each trocar whose position on the stage with the baked motion differs from the protocol.

    `root` is this stage, None if it does not exist; `mechanism` has the trocars of the protocol. For `due`, see
    `existing_motion_rows`.

    Raises:
        StageError: the stage cannot be read.
    """
    if root is None or not mechanism.trocars:
        return []
    # a motion that was baked for another protocol may have the trocar elsewhere
    severity: Severity = "disagreement" if due else "warning"
    # what is on disk is judged, not what would be written now
    written = read_stage(root).trocar_places
    findings = []
    for name, place in mechanism.trocar_places.items():
        if name not in written:
            continue  # a trocar missing on the stage is reported by the comparison of the stage
        distance = float(np.linalg.norm(written[name] - place))
        if distance <= _SINGLE_PRECISION:
            continue
        position = ", ".join(f"{coordinate / MM:.3f}" for coordinate in written[name])
        text = (
            f"the motion on the stage has trocar '{name}' at ({position}) mm; distance from the trocar of the protocol"
        )
        findings.append(
            finding(
                severity,
                "baked.trocar",
                name,
                text,
                size=mm(distance),
                limit=mm(_SINGLE_PRECISION),
                suggestion="run `twin build` again",
            )
        )
    return findings


def baked_rows(
    measured: MeasuredMotion, samples: MotionSamples, phases: tuple[PhaseSummary, ...], tolerances: Tolerances
) -> tuple[list[Residual], list[Finding]]:
    """Return rows and findings on the baked motion (D), compared with the mechanism (B)."""
    keys = SampleClock(samples.keys, phases)
    middle = SampleClock(samples.middle, phases)
    if len(measured.times) != len(samples.keys) or np.abs(measured.times - samples.keys).max() > _OWN_TIME_TOLERANCE:
        return [], [disagreement("baked.times", "", "the baked time codes differ from the requested time codes")]
    name = "links at their time codes"
    rows = [
        row(
            "B-D",
            "baked",
            name,
            unit="m",
            differences=measured.position,
            tolerance=tolerances.baked_position,
            clock=keys,
            note=samples.driver,
        ),
        row(
            "B-D",
            "baked",
            name,
            unit="rad",
            differences=measured.rotation,
            tolerance=tolerances.baked_rotation,
            clock=keys,
            note=samples.driver,
        ),
    ]
    findings = []
    for r in rows:
        if not r.agrees:
            text = "a baked link pose differs from the mechanism"
            findings.append(r.finding(_BAKED_DIFFERS, text, "motion layer", when=f"t = {r.t:.2f} s"))
    note = f"error of a player that interpolates {KEY_RATE:g} Hz keys"
    rows.append(
        row(
            "B-D",
            "baked",
            "links between keys",
            unit="m",
            differences=measured.between,
            tolerance=None,
            clock=middle,
            note=note,
        )
    )
    return rows, findings


def parts_apart(mates: Iterable[Mate]) -> list[Finding]:
    """Return a finding for each joint whose two parts do not touch in the CAD."""
    findings = []
    for mate in mates:
        if not mate.distance > LOOSE:  # NaN is no distance
            continue
        first, second = mate.parts
        text = f"the parts of joint '{mate.joint}', {first} and {second}, are apart in the CAD"
        findings.append(_PARTS_APART(mate.joint, text, mm(mate.distance), mm(LOOSE), when="as drawn"))
    return findings


def clearance_facts(
    measured: Clearance, times: Array, phases: tuple[PhaseSummary, ...]
) -> tuple[dict[str, str], list[Finding]]:
    """Return the minimum clearance as text, and a finding for each contact."""
    clock = SampleClock(times, phases)
    nearest = int(np.argmin(measured.distance))
    body_a, body_b = measured.pair[nearest]
    smallest = measured.distance[nearest] / MM
    facts = {
        "minimum clearance": f"{smallest:.2f} mm between {body_a} and {body_b}, {clock.when(nearest)}",
        "method": f"triangle meshes of the CAD (chord tolerance 0.1 mm), {CLEARANCE_RATE:g} Hz; pairs of "
        "bodies without a common joint, and parts of jointed bodies that do not form the joint",
    }
    # `contacts` has jointed bodies only; of all others, the nearest pair is reported
    contacts = list(measured.contacts)
    if measured.distance[nearest] <= 0:
        contacts.insert(0, (nearest, body_a, body_b))
    findings = []
    for sample, first, second in contacts:
        text = f"{first} and {second} collide"
        findings.append(_CONTACT(f"{first}, {second}", text, mm(0.0), when=clock.when(sample)))
    return facts, findings
