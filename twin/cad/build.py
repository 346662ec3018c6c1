"""Build a `Mechanism` from a description and its CAD: measure both frames of each joint on faces of its bodies."""

from __future__ import annotations

import fnmatch
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path

import numpy as np

from twin.cad import features, frames, mesh, references
from twin.cad.actuators import actuators, transmissions
from twin.cad.description import BodySpec, CouplingSpec, Description, JointSpec, LimitSpec, MassSpec, load
from twin.cad.features import MeasuredFeature
from twin.cad.frames import DrawnFrames, into
from twin.cad.meeting import meetings
from twin.cad.noise import CAUSE, Noise, noise
from twin.cad.parameters import parameters, read_dimensions
from twin.cad.step import MASS_ANGLE, MASS_TOLERANCE, PROP_TOLERANCE, VISUAL_TOLERANCE, Part, StepModel, read_step
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
        largest = 0.0
        for finding in self.findings:
            if finding.code == "cad.placement_precision":
                largest = max(largest, finding.size or 0.0)
        return largest * UM


def inputs(description_path: Path, description: Description | None = None) -> list[Path]:
    """Return the files of a robot: its TOML file and the CAD files that the TOML file names.

    `description` is the content of the TOML file; None: the file is read.
    """
    description = description or load(description_path)
    folder = description_path.parent
    files = [description_path]
    if description.step:
        files.append(folder / description.step)
    for body in description.body.values():
        for mesh_file in body.meshes:
            files.append(folder / mesh_file.file)
    return files


def fingerprint(description_path: Path, description: Description | None = None, read: Read | None = None) -> str:
    """Return one hash of all files in `inputs`.

    `read` returns the bytes of a TOML or STEP file; by default, it reads the file from disk.

    Raises:
        CadError: a file cannot be read.
        DescriptionError: the TOML file is malformed.
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
    """Return the props (fixed objects) of a scene from cad/<scene>/<props>.toml, without masses of their shapes.

    A mass that the file states is kept.

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
    description = load(description_path, read)
    references.check(description_path, description)
    folder = description_path.parent
    findings: list[Finding] = []
    step = None
    if description.step:
        step = read_step(folder / description.step, tolerance, read=read)
    parts = parts_by_body(description, step)
    measured: dict[str, dict[str, MeasuredFeature]] = {}
    for body, specs in description.feature.items():
        measured[body] = {}
        for name, spec in specs.items():
            measured[body][name] = features.find(body, name, spec, parts[body], description.tolerance)

    drawn_frames = frames.drawn(description, measured)
    fine: dict[int, Part] = {}
    if step is not None and with_mass:
        fine = _fine_parts(step, read_step(step.path, MASS_TOLERANCE, MASS_ANGLE, read))
    meshes, inertias = _shapes(description, folder, parts, drawn_frames.bodies, fine, with_mass, findings)
    bodies = []
    for name, spec in description.body.items():
        bodies.append(Body(name, tuple(meshes[name]), inertias.get(name), spec.whole))
    joints = [_joint(description, spec, drawn_frames, measured) for spec in description.joint]
    gap_findings = meetings(description, drawn_frames)
    feature_noise = noise(description, measured, gap_findings)
    if feature_noise is not None:
        findings.append(feature_noise.finding(description))
        gap_findings = [replace(finding, cause=CAUSE) for finding in gap_findings]
    findings += gap_findings
    if step is not None and step.placement_error > 0:
        findings.append(_placement_finding(step))

    postures: dict[str, dict[str, float]] = {}
    for name, values in description.posture.items():
        postures[name] = joint_values(values)
    mechanism = Mechanism(
        name=description.name,
        base=description.base,
        bodies=tuple(bodies),
        joints=tuple(joints),
        frames=frames.frames(description, drawn_frames),
        points=frames.points(description, drawn_frames, measured),
        rest=frames.rest(description, drawn_frames),
        postures=postures,
        tool=description.tool,
        parameters=tuple(parameters(description)),
        actuators=actuators(description),
        transmissions=transmissions(description),
        couplings=tuple(map(_coupling, description.coupling)),
        trocars=(description.trocar,) if description.trocar else tuple(description.trocars),
        gravity=description.gravity_m_s2 or EARTH,
        source=f"{description_path.name} {fingerprint(description_path, description, read)}",
    )
    gaps = tuple((gap.lower, gap.upper, gap.min_gap_mm * MM) for gap in description.gap)
    dimensions = read_dimensions(folder / "dimensions.toml", read)
    return CadModel(mechanism, tuple(findings), description, measured, dimensions, gaps, feature_noise)


def _coupling(spec: CouplingSpec) -> Coupling:
    # Only one of the two sums is given: that of angles or that of lengths.
    total = (spec.sum_deg or 0.0) * DEG + (spec.sum_mm or 0.0) * MM
    return Coupling(spec.name, tuple(spec.joints), tuple(spec.ratios), total)


def parts_by_body(description: Description, step: StepModel | None) -> dict[str, list[Part]]:
    """Return {body: parts of the STEP file at or below the body's node}.

    A body has none if there is no file, or if it has meshes.

    Raises:
        CadError: the file has no node of this name.
    """
    parts: dict[str, list[Part]] = {}
    nodes: set[str] = set()
    if step is not None:
        for part in step.parts:
            nodes.update((*part.path, part.name, *part.chain))
    for name, spec in description.body.items():
        parts[name] = []
        if step is None or spec.meshes:
            continue
        node = spec.node or name
        for part in step.parts:
            if node in (*part.path, part.name, *part.chain):
                parts[name].append(part)
        if not parts[name]:
            raise CadError(f"{step.path}: body '{name}': {unknown('node', node, nodes)}")
    return parts


def _shapes(
    description: Description,
    folder: Path,
    parts: dict[str, list[Part]],
    body_frames: Mapping[str, Array],
    fine: Mapping[int, Part],
    with_mass: bool,
    findings: list[Finding],
) -> tuple[dict[str, list[Mesh]], dict[str, Inertia]]:
    """Return the meshes and the inertias of the bodies, both in the body frame.

    A body has the inertia that its description states; otherwise, if `with_mass`, that of its shapes.

    `fine` maps `id(part)` to the same part with finer triangles, from which masses are computed. Findings on meshes and
    masses are added to `findings`.
    """
    meshes: dict[str, list[Mesh]] = {}
    masses: dict[str, list[Inertia]] = {}
    taken_names: set[str] = set()
    for body, spec in description.body.items():
        meshes[body] = []
        masses[body] = []
        for solid in (*parts[body], *_mesh_files(folder, spec, findings)):
            name = _unique(solid.name, taken_names)
            vertices = into(body_frames[body], solid.vertices)
            finish = _finish(description, solid.name)
            meshes[body].append(Mesh(name, vertices, solid.triangles, solid.color_rgba, finish))
            if not with_mass:
                continue
            # A mesh file has no finer triangles.
            exact = fine.get(id(solid), solid)
            mass = _part_inertia(
                description, solid.name, into(body_frames[body], exact.vertices), exact.triangles, findings
            )
            if mass is not None:
                masses[body].append(mass)
    inertias = {}
    for body, spec in description.body.items():
        if spec.mass is not None:
            inertias[body] = _stated_inertia(spec.mass, body_frames[body])
        elif masses[body]:
            inertias[body] = reduce(add, masses[body])
    return meshes, inertias


def _mesh_files(folder: Path, spec: BodySpec, findings: list[Finding]) -> Iterator[Mesh]:
    """Yield the meshes in the mesh files of a body, in drawn coordinates; add findings on these to `findings`."""
    for file in spec.meshes:
        loaded, notes = mesh.load_mesh(folder / file.file, file.unit, file.up, file.color)
        # An open mesh matters only if its mass is computed; then `_part_inertia` reports it.
        for note in notes:
            if note.code != "cad.open_mesh":
                findings.append(note)
        yield loaded


def _fine_parts(step: StepModel, fine: StepModel) -> dict[int, Part]:
    """Return {id(part): finer part}; parts are matched by order, because names in the file may repeat."""
    fine_parts: dict[int, Part] = {}
    for part, fine_part in zip(step.parts, fine.parts, strict=True):
        fine_parts[id(part)] = fine_part
    return fine_parts


def _stated_inertia(spec: MassSpec, T_drawn_body: Array) -> Inertia:
    """Return the mass and inertia stated in the description, in the body frame."""
    xx, yy, zz, xy, xz, yz = spec.inertia_kg_m2
    R = T_drawn_body[:3, :3]
    stated = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    I = R.T @ stated @ R  # noqa: E741 - stated along the axes of the drawing
    com = into(T_drawn_body, np.array(spec.com_mm) * MM)
    return Inertia(spec.mass_kg, com, 0.5 * (I + I.T))  # exactly symmetric, despite rounding


def _material(description: Description, part: str) -> str | None:
    """Return the name of the last material with a pattern that matches the name of the part, or None."""
    # The last one counts, so that a general pattern such as "*" can stand before special ones.
    for name, material in reversed(description.material.items()):
        if any(fnmatch.fnmatch(part, pattern) for pattern in material.parts):
            return name
    return None


def _finish(description: Description, part: str) -> Finish:
    name = _material(description, part)
    if name is None:
        return Finish()
    material = description.material[name]
    return Finish(name, material.metallic, material.roughness)


def _part_inertia(
    description: Description, part: str, vertices: Array, triangles: np.ndarray, findings: list[Finding]
) -> Inertia | None:
    """Return the inertia of a part with vertices (n, 3) in m; None, with a finding, if it cannot be computed.

    A description without materials states no masses: then there is no finding either.
    """
    material = _material(description, part)
    if material is None:
        if description.material:
            text = f"part '{part}' has no material and therefore no mass"
            advice = "add the part to a [material.*] in the description"
            findings.append(warning("cad.no_material", part, text, suggestion=advice))
        return None
    inertia = mesh.inertia(vertices, triangles, description.material[material].density_kg_m3)
    if inertia is None:
        findings.append(mesh.open_mesh(part))
        return None
    if inertia.mass < 0:
        findings.append(mesh.inverted_mesh(part))
        return None
    return inertia


def _identifier(name: str) -> str:
    identifier = re.sub("[^a-z0-9]", "_", name.lower()).strip("_")
    return identifier if identifier[:1].isalpha() else f"part_{identifier}"


def _unique(name: str, taken_names: set[str]) -> str:
    """Return the name as an identifier that no other mesh has: the second `peg` becomes `peg_2`."""
    first = _identifier(name)
    unique = first
    count = 1
    while unique in taken_names:
        count += 1
        unique = f"{first}_{count}"
    taken_names.add(unique)
    return unique


def _joint(
    description: Description,
    spec: JointSpec,
    drawn_frames: DrawnFrames,
    measured: dict[str, dict[str, MeasuredFeature]],
) -> Joint:
    values: dict = {}
    # `references.check` has refused a second entry for the same joint.
    for limit in description.limit:
        if spec.name in limit.joints:
            values = _limits(limit, references.UNITS.get(spec.type, "mm"))
            break
    for drive in description.drive:
        if spec.name in drive.joints:
            values["drive"] = Drive(drive.stiffness, drive.damping, drive.max_effort)
            break
    mating = set()
    for body, side in spec.sides:
        features_of_body = measured.get(body, {})
        for name in side.features("origin", "at", "z"):
            if name in features_of_body:
                mating.add(features_of_body[name].part)
    return Joint(
        spec.name,
        spec.type,
        spec.parent,
        spec.child,
        drawn_frames.on_parent(spec.name, spec.parent),
        drawn_frames.on_child(spec.name, spec.child),
        active=spec.active,
        mating=tuple(sorted(map(_identifier, mating))),
        **values,
    )


def _limits(limit: LimitSpec, unit: str) -> dict:
    """Return the fields of a `Joint` that a table of limits in `unit` ("deg" or "mm") gives, in SI units."""
    scale = SI[unit]
    values: dict = {}
    # (field of a `Joint`, what its unit has in addition to that of the coordinate)
    fields = (
        ("limits", ""),
        ("soft_limits", ""),
        ("max_speed", "_s"),
        ("max_acceleration", "_s2"),
        ("max_jerk", "_s3"),
    )
    for field, rate in fields:
        value = getattr(limit, f"{field}_{unit}{rate}")
        if isinstance(value, tuple):
            low, high = value
            values[field] = (low * scale, high * scale)
        elif value is not None:
            values[field] = value * scale
    if limit.cone_deg is not None:
        values["cone"] = limit.cone_deg * DEG
    return values


def joint_values(values: dict[str, float]) -> dict[str, float]:
    """Return {joint: coordinate in rad or m} of {joint with unit, such as "yaw_deg": coordinate}."""
    posture = {}
    for key, value in values.items():
        joint, _, unit = key.rpartition("_")
        posture[joint] = value * SI[unit]
    return posture


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
