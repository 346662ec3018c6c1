"""Build a `Mechanism` from a description and its CAD: measure both frames of each joint on faces of its bodies."""

from __future__ import annotations

import fnmatch
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np

from twin.cad import features, frames, mesh, references
from twin.cad.description import BodySpec, Description, JointSpec, MassSpec, load
from twin.cad.dimensions import read_dimensions
from twin.cad.features import MeasuredFeature
from twin.cad.frames import DrawnFrames, into
from twin.cad.meeting import meetings
from twin.cad.motors import actuators, transmissions
from twin.cad.noise import CAUSE, Noise, noise
from twin.cad.parameters import parameters
from twin.cad.step import MASS_TOLERANCE, PROP_TOLERANCE, VISUAL_TOLERANCE, Part, StepModel, read_step
from twin.core.errors import CadError, unknown
from twin.core.findings import Finding, info, warning
from twin.core.foreign.once import Once, Read
from twin.core.provenance import Parameter
from twin.core.quantity import um
from twin.core.spatial import Array
from twin.core.units import DEG, MM, SI, UM
from twin.model.body import Body, Finish, Mesh
from twin.model.inertia import Inertia
from twin.model.joint import Drive, Joint
from twin.model.mechanism import EARTH, Coupling, Mechanism


@dataclass(frozen=True)
class CadModel:
    """A robot as read from its CAD and description.

    Attributes:
        mechanism: bodies, joints and loops; the rest poses of the bodies are their poses in the CAD.
        findings: findings on joints (gap between the two parts), on meshes (open surfaces), and on placements (single
            precision).
        description: the content of the TOML file.
        measured: {body: {name: measured feature}}, in drawn coordinates (coordinates of the STEP file, in m).
        dimensions: the dimensions from which the CAD was drawn, with provenance.
        gaps: (lower joint, upper joint, minimum difference upper - lower of the coordinates in m) for each pair of
            joints that slide on the same rail.
        noise: noise of the features, if it causes the gaps of the joints; None if there are none, or if they have
            another cause.
    """

    mechanism: Mechanism
    findings: tuple[Finding, ...]
    description: Description
    measured: dict[str, dict[str, MeasuredFeature]]
    dimensions: tuple[Parameter, ...]
    gaps: tuple[tuple[str, str, float], ...]
    noise: Noise | None = None

    @property
    def placement_loss(self) -> float:
        """Possible error in m of joint frames due to single-precision placements; 0 without such placements."""
        return max((f.size or 0.0 for f in self.findings if f.code == "cad.placement_precision"), default=0.0) * UM


def inputs(description_path: Path, description: Description | None = None) -> list[Path]:
    """Return the files of a robot: its TOML file and the CAD files that the TOML file names.

    `description` is the content of the TOML file; None: the file is read.
    """
    description = description or load(description_path)
    files = [description_path]
    files += [description_path.parent / description.step] if description.step else []
    return files + [description_path.parent / m.file for b in description.body.values() for m in b.meshes]


def fingerprint(description_path: Path, description: Description | None = None, read: Read | None = None) -> str:
    """Return one hash of all files in `inputs`.

    `read` returns the bytes of a TOML or STEP file; by default, it reads the file from disk.
    """
    read = read or Once()
    description = description or load(description_path, read)
    digest = hashlib.sha256()
    for file in inputs(description_path, description):
        try:
            if file == description_path:
                data = read(file, "TOML")
            elif description.step and file == description_path.parent / description.step:
                data = read(file, "STEP")
            else:  # mesh files are not cached; their reader opens them itself
                data = file.read_bytes()
            digest.update(data)
        except OSError as error:
            raise CadError(f"{file}: cannot be read ({error.strerror or error})") from error
    return f"sha256:{digest.hexdigest()}"


def read_props(description_path: Path) -> Mechanism:
    """Return the props (fixed objects) of a scene, without masses, from cad/<scene>/<props>.toml.

    Raises:
        TwinError: see `read_mechanism`.
    """
    return read_mechanism(description_path, with_mass=False, tolerance=PROP_TOLERANCE).mechanism


def read_mechanism(
    description_path: Path,
    *,
    with_mass: bool = True,
    tolerance: float = VISUAL_TOLERANCE,
    read: Read | None = None,
) -> CadModel:
    """Build the mechanism of a robot from its description and CAD.

    `with_mass`: whether masses are computed from a finer mesh, which takes about one second more. `tolerance` is the
    chord tolerance of the triangles in m. `read` returns the bytes of TOML and STEP files; by default, each file is
    read from disk once.

    Raises:
        DescriptionError: the TOML file is malformed.
        CadError: a file or a named feature is missing, or no face is within the gross tolerance of a feature.
        MechanismError: the bodies and joints do not form a mechanism.
    """
    read = read or Once()
    d = load(description_path, read)
    references.check(description_path, d)
    folder = description_path.parent
    found: list[Finding] = []
    step = read_step(folder / d.step, tolerance, read=read) if d.step else None
    parts = _parts_by_body(d, step)
    measured = {
        body: {name: features.find(body, name, spec, parts[body], d.tolerance) for name, spec in specs.items()}
        for body, specs in d.feature.items()
    }

    at = frames.drawn(d, measured)
    fine = read_step(step.path, MASS_TOLERANCE, 0.15, read) if step is not None and with_mass else None
    meshes, inertias = _shapes(d, folder, parts, at.bodies, _exact(step, fine), with_mass, found)
    joints = [_joint(d, j, at, measured) for j in d.joint]
    gaping = meetings(d, at)
    noisy = noise(d, measured, gaping)
    if noisy is not None:
        gaping = [noisy.finding(d), *(replace(f, cause=CAUSE) for f in gaping)]
    found += gaping
    if step is not None and step.placement_error > 0:
        found.append(_placement_finding(step))

    mechanism = Mechanism(
        name=d.name,
        base=d.base,
        bodies=tuple(Body(n, tuple(meshes[n]), inertias.get(n), spec.whole) for n, spec in d.body.items()),
        joints=tuple(joints),
        frames=frames.frames(d, at),
        points=frames.points(d, at, measured),
        rest=frames.rest(d, at),
        postures={n: _posture(values) for n, values in d.posture.items()},
        tool=d.tool,
        parameters=tuple(parameters(d)),
        actuators=actuators(d),
        transmissions=transmissions(d),
        couplings=tuple(
            Coupling(c.name, tuple(c.joints), tuple(c.ratios), (c.sum_deg or 0.0) * DEG + (c.sum_mm or 0.0) * MM)
            for c in d.coupling
        ),
        trocars=(d.trocar,) if d.trocar else tuple(d.trocars),
        gravity=d.gravity_m_s2 or EARTH,
        source=f"{description_path.name} {fingerprint(description_path, d, read)}",
    )
    gaps = tuple((g.lower, g.upper, g.min_gap_mm * MM) for g in d.gap)
    dimensions = read_dimensions(folder / "dimensions.toml", read)
    return CadModel(mechanism, tuple(found), d, measured, dimensions, gaps, noisy)


def _parts_by_body(d: Description, step: StepModel | None) -> dict[str, list[Part]]:
    """Return {body: parts of the STEP file at or below the body's node}."""
    parts: dict[str, list[Part]] = {name: [] for name in d.body}
    if step is None:
        return parts
    nodes = {node for p in step.parts for node in (*p.path, p.name, *p.chain)}
    for name, spec in d.body.items():
        if spec.meshes:
            continue
        node = spec.node or name
        parts[name] = [p for p in step.parts if node == p.name or node in p.path or node in p.chain]
        if not parts[name]:
            raise CadError(f"{step.path}: body '{name}': {unknown('node', node, nodes)}")
    return parts


def _shapes(
    d: Description,
    folder: Path,
    parts: dict[str, list[Part]],
    drawn: Mapping[str, Array],
    fine: Mapping[int, Part],
    with_mass: bool,
    found: list[Finding],
) -> tuple[dict[str, list[Mesh]], dict[str, Inertia]]:
    """Return the meshes and, if requested, the inertia of each body, both in the body frame.

    `fine` maps `id(part)` to the same part with finer triangles, from which masses are computed.
    """
    meshes: dict[str, list[Mesh]] = {name: [] for name in d.body}
    masses: dict[str, list[Inertia]] = {name: [] for name in d.body}
    taken: set[str] = set()
    for body, spec in d.body.items():
        for solid in (*parts[body], *_loaded(folder, spec, found)):
            vertices, finish = into(drawn[body], solid.vertices), _finish(d, solid.name)
            meshes[body].append(Mesh(_unique(solid.name, taken), vertices, solid.triangles, solid.color_rgba, finish))
            if with_mass:
                exact = fine.get(id(solid), solid)
                _weigh(d, solid.name, into(drawn[body], exact.vertices), exact.triangles, masses[body], found)
    weighed = {name: reduce(add, list_) for name, list_ in masses.items() if list_}
    given = {n: _given(s.mass, drawn[n]) for n, s in d.body.items() if s.mass is not None}
    return meshes, {**weighed, **given}


def _loaded(folder: Path, spec: BodySpec, found: list[Finding]) -> Iterator[Mesh]:
    """Yield the meshes in the mesh files of a body, in drawn coordinates; add findings on these meshes to `found`."""
    for file in spec.meshes:
        loaded, notes = mesh.load_mesh(folder / file.file, file.unit, file.up, file.color)
        found += [n for n in notes if n.code != "cad.open_mesh"]
        yield loaded


def _exact(step: StepModel | None, fine: StepModel | None) -> dict[int, Part]:
    """Return {id(part): finer part}; parts are matched by order, because names in the file may repeat."""
    return {} if step is None or fine is None else {id(p): f for p, f in zip(step.parts, fine.parts, strict=True)}


def _given(spec: MassSpec, T_drawn_body: Array) -> Inertia:
    """Return the mass and inertia stated in the description, in the body frame."""
    xx, yy, zz, xy, xz, yz = spec.inertia_kg_m2
    R = T_drawn_body[:3, :3]
    I = R.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R  # noqa: E741
    return Inertia(spec.mass_kg, into(T_drawn_body, np.array(spec.com_mm) * MM), 0.5 * (I + I.T))


def _material(d: Description, part: str) -> str | None:
    """Return the name of the last material with a pattern that matches the name of the part, or None."""
    named = [name for name, m in d.material.items() if any(fnmatch.fnmatch(part, p) for p in m.parts)]
    return named[-1] if named else None


def _finish(d: Description, part: str) -> Finish:
    name = _material(d, part)
    return Finish() if name is None else Finish(name, d.material[name].metallic, d.material[name].roughness)


def _weigh(
    d: Description,
    part: str,
    vertices: Array,
    triangles: np.ndarray,
    out: list[Inertia],
    found: list[Finding],
) -> None:
    material = _material(d, part)
    if material is None:
        if d.material:
            found.append(
                warning(
                    "cad.no_material",
                    part,
                    f"part '{part}' has no material and therefore no mass",
                    suggestion="add the part to a [material.*] in the description",
                )
            )
        return
    weight = mesh.inertia(vertices, triangles, d.material[material].density_kg_m3)
    if weight is None:
        found.append(mesh.open_mesh(part))
    else:
        out.append(weight)


def _identifier(name: str) -> str:
    clean = "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower()).strip("_")
    return clean if clean[:1].isalpha() else f"part_{clean}"


def _unique(name: str, taken: set[str]) -> str:
    """Return the name as an identifier that no other mesh has: the second `peg` becomes `peg_2`."""
    first = clean = _identifier(name)
    count = 1
    while clean in taken:
        count += 1
        clean = f"{first}_{count}"
    taken.add(clean)
    return clean


def _joint(
    d: Description,
    spec: JointSpec,
    at: DrawnFrames,
    measured: dict[str, dict[str, MeasuredFeature]],
) -> Joint:
    limit = next((s for s in d.limit if spec.name in s.joints), None)
    drive = next((s for s in d.drive if spec.name in s.joints), None)
    unit = references.UNITS.get(spec.type, "mm")
    values: dict = {}
    if limit is not None:
        rates = ("max_speed", "_s"), ("max_acceleration", "_s2"), ("max_jerk", "_s3")
        for key, rate in (("limits", ""), ("soft_limits", ""), *rates):
            value = getattr(limit, f"{key}_{unit}{rate}")
            if value is not None:
                scale = SI[unit]
                values[key] = tuple(v * scale for v in value) if isinstance(value, tuple) else value * scale
        if limit.cone_deg is not None:
            values["cone"] = limit.cone_deg * DEG
    if drive is not None:
        values["drive"] = Drive(drive.stiffness, drive.damping, drive.max_effort)
    mating = {
        measured[body][name].part
        for body, side in spec.sides
        for name in side.features("origin", "at", "z")
        if name in measured.get(body, {})
    }
    return Joint(
        spec.name,
        spec.type,
        spec.parent,
        spec.child,
        at.on_parent(spec.name, spec.parent),
        at.on_child(spec.name, spec.child),
        active=spec.active,
        mating=tuple(sorted(_identifier(m) for m in mating)),
        **values,
    )


def _posture(values: dict[str, float]) -> dict[str, float]:
    split = {key: key.rpartition("_") for key in values}
    return {joint: values[key] * SI[unit] for key, (joint, _, unit) in split.items()}


def _placement_finding(step: StepModel) -> Finding:
    return info(
        "cad.placement_precision",
        step.path.name,
        f"{step.path.name} places instances by single-precision matrices: the error of measured joint frames is up "
        f"to ±{um(step.placement_error)}",
        um(step.placement_error),
        suggestion="to measure exactly, export the STEP file with the placements applied to the shapes",
        word="",
    )
