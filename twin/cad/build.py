"""From a description and its CAD to a `Mechanism`: measure every joint frame on the faces of its own body."""

from __future__ import annotations

import fnmatch
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin import spatial
from twin.cad import features, mesh, references
from twin.cad.description import BodySpec, Description, FrameSpec, JointSpec, MassSpec, load
from twin.cad.dimensions import read_dimensions
from twin.cad.features import Measured
from twin.cad.parameters import SCALES, parameters
from twin.cad.step import MASS_TOLERANCE, Part, StepModel, read_step
from twin.errors import CadError, unknown
from twin.findings import Finding
from twin.mechanism import Body, Coupling, Drive, Frame, Inertia, Joint, Mechanism, Mesh, Point
from twin.provenance import Parameter
from twin.spatial import Array
from twin.units import DEG, MM, UM


@dataclass(frozen=True)
class CadModel:
    """What the CAD and its description say.

    Attributes:
        mechanism: bodies, joints and loops, rest poses as drawn.
        findings: parts that do not meet, open meshes, lost precision.
        description: the TOML file as read.
        measured: every feature by body and name, in drawn coordinates.
        dimensions: the lengths that the drawing was made from, with provenance.
        gaps: pairs of joints on one rail and the least distance between them in m.
    """

    mechanism: Mechanism
    findings: tuple[Finding, ...]
    description: Description
    measured: dict[str, dict[str, Measured]]
    dimensions: tuple[Parameter, ...]
    gaps: tuple[tuple[str, str, float], ...]

    @property
    def placement_loss(self) -> float:
        """Return how far in m placements in single precision may have moved a joint frame; 0 if none did."""
        return max((f.size or 0.0 for f in self.findings if f.code == "cad.placement_precision"), default=0.0) * UM


def inputs(description_path: Path) -> list[Path]:
    """Return everything that the mechanism is made from: the TOML file and the CAD it names."""
    description = load(description_path)
    files = [description_path]
    files += [description_path.parent / description.step] if description.step else []
    return files + [description_path.parent / m.file for b in description.body.values() for m in b.meshes]


def fingerprint(description_path: Path) -> str:
    """Return the hash of all `inputs`."""
    digest = hashlib.sha256()
    for file in inputs(description_path):
        try:
            digest.update(file.read_bytes())
        except OSError as error:
            raise CadError(f"{file}: cannot be read ({error.strerror or error})") from error
    return f"sha256:{digest.hexdigest()}"


def read_mechanism(description_path: Path, *, with_mass: bool = True) -> CadModel:
    """Build the mechanism of a robot from its description and CAD.

    Args:
        description_path: cad/<robot>/<robot>.toml.
        with_mass: also weigh the bodies, on a finer mesh; about a second more.

    Raises:
        DescriptionError: the TOML file is wrong.
        CadError: a file or a named feature is missing, or grossly off.
        MechanismError: the bodies and joints form no mechanism.
    """
    d = load(description_path)
    references.check(description_path, d)
    folder = description_path.parent
    found: list[Finding] = []
    step = read_step(folder / d.step) if d.step else None
    parts = _parts_by_body(d, step)
    measured = {
        body: {name: features.find(body, name, spec, parts[body], d.tolerance) for name, spec in specs.items()}
        for body, specs in d.feature.items()
    }

    drawn = {name: np.eye(4) for name in d.body}  # of each body frame, in drawn coordinates
    on = {
        j.name: (_frame(d, measured, j.parent, j.on_parent, j), _frame(d, measured, j.child, j.on_child, j))
        for j in d.joint
    }
    named = {n: _frame(d, measured, f.body, f.at, None, n) for n, f in d.frame.items()}
    for body, spec in d.body.items():
        drawn[body] = _body_frame(d, body, spec, on, named)

    meshes, inertias = _shapes(d, folder, step, parts, drawn, with_mass, found)
    joints = [_joint(d, j, on[j.name], drawn, measured) for j in d.joint]
    found += _meetings(d, on)
    if step is not None and step.placement_error > 0:
        found.append(_placement_finding(step))

    T_base_drawn = spatial.inverse(drawn[d.base])
    mechanism = Mechanism(
        name=d.name,
        base=d.base,
        bodies=tuple(Body(n, tuple(meshes[n]), inertias.get(n)) for n in d.body),
        joints=tuple(joints),
        frames=tuple(Frame(n, f.body, spatial.inverse(drawn[f.body]) @ named[n]) for n, f in d.frame.items()),
        points=tuple(
            Point(n, s.body, _into(drawn[s.body], features.point(s, measured.get(s.body, {}))))
            for n, s in d.point.items()
        ),
        rest={n: T_base_drawn @ T for n, T in drawn.items()},
        postures={n: _posture(values) for n, values in d.posture.items()},
        tool=d.tool,
        parameters=tuple(parameters(d)),
        couplings=tuple(
            Coupling(c.name, tuple(c.joints), tuple(c.ratios), (c.sum_deg or 0.0) * DEG + (c.sum_mm or 0.0) * MM)
            for c in d.coupling
        ),
        trocar=d.trocar or "",
        source=f"{description_path.name} {fingerprint(description_path)}",
    )
    gaps = tuple((g.lower, g.upper, g.min_gap_mm * MM) for g in d.gap)
    return CadModel(mechanism, tuple(found), d, measured, read_dimensions(folder / "dimensions.toml"), gaps)


def _parts_by_body(d: Description, step: StepModel | None) -> dict[str, list[Part]]:
    """Return the STEP's parts below the node of each body."""
    parts: dict[str, list[Part]] = {name: [] for name in d.body}
    if step is None:
        return parts
    nodes = {node for p in step.parts for node in (*p.path, p.name)}
    for name, spec in d.body.items():
        if spec.meshes:
            continue
        node = spec.node or name
        parts[name] = [p for p in step.parts if node == p.name or node in p.path]
        if not parts[name]:
            raise CadError(f"{step.path}: body '{name}': {unknown('node', node, nodes)}")
    return parts


def _frame(
    d: Description,
    measured: dict[str, dict[str, Measured]],
    body: str,
    spec: FrameSpec,
    joint: JointSpec | None,
    name: str = "",
) -> Array:
    where = f"joint '{joint.name}' on body '{body}'" if joint else f"frame '{name}' on body '{body}'"
    try:
        return features.frame(spec, measured.get(body, {}))
    except CadError as error:
        raise CadError(f"{d.name}: {where}: {error}") from error


def _body_frame(
    d: Description,
    body: str,
    spec: BodySpec,
    on: dict[str, tuple[Array, Array]],
    named: dict[str, Array],
) -> Array:
    """Return the body frame: the named frame that the file asks for, else the first joint whose child it is."""
    if spec.frame is not None:
        return named[spec.frame]
    for joint in d.joint:
        if joint.child == body:
            return on[joint.name][1]
    return np.eye(4)


def _shapes(
    d: Description,
    folder: Path,
    step: StepModel | None,
    parts: dict[str, list[Part]],
    drawn: dict[str, Array],
    with_mass: bool,
    found: list[Finding],
) -> tuple[dict[str, list[Mesh]], dict[str, Inertia]]:
    """Return the meshes of each body and, if asked for, its inertia, both in the body frame."""
    meshes: dict[str, list[Mesh]] = {name: [] for name in d.body}
    masses: dict[str, list[Inertia]] = {name: [] for name in d.body}
    taken: set[str] = set()
    fine: dict[int, Part] = {}
    if step is not None and with_mass:
        # Names need not be unique in a foreign file; the order is the same.
        weighed = read_step(step.path, MASS_TOLERANCE, 0.15).parts
        fine = {id(p): exact for p, exact in zip(step.parts, weighed, strict=True)}
    for body in d.body:
        for part in parts[body]:
            vertices = _into(drawn[body], part.vertices)
            meshes[body].append(Mesh(_unique(part.name, taken), vertices, part.triangles, part.color_rgba))
            if with_mass:
                exact = fine[id(part)]
                _weigh(d, part.name, _into(drawn[body], exact.vertices), exact.triangles, masses[body], found)
        for spec in d.body[body].meshes:
            loaded, notes = mesh.load_mesh(folder / spec.file, spec.unit, spec.up, spec.color)
            found += [n for n in notes if n.code != "cad.open_mesh"]
            vertices = _into(drawn[body], loaded.vertices)
            meshes[body].append(Mesh(_unique(loaded.name, taken), vertices, loaded.triangles, loaded.color_rgba))
            if with_mass:
                _weigh(d, loaded.name, vertices, loaded.triangles, masses[body], found)
    weighed = {name: mesh.combine(list_) for name, list_ in masses.items() if list_}
    given = {n: _given(s.mass, drawn[n]) for n, s in d.body.items() if s.mass is not None}
    return meshes, {**weighed, **given}


def _given(spec: MassSpec, T_drawn_body: Array) -> Inertia:
    """Return a given mass in the body frame."""
    xx, yy, zz, xy, xz, yz = spec.inertia_kg_m2
    R = T_drawn_body[:3, :3]
    I = R.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R  # noqa: E741
    return Inertia(spec.mass_kg, _into(T_drawn_body, np.array(spec.com_mm) * MM), 0.5 * (I + I.T))


def _weigh(
    d: Description,
    part: str,
    vertices: Array,
    triangles: np.ndarray,
    out: list[Inertia],
    found: list[Finding],
) -> None:
    density = None
    for material in d.material.values():
        if any(fnmatch.fnmatch(part, pattern) for pattern in material.parts):
            density = material.density_kg_m3
    if density is None:
        if d.material:
            found.append(
                Finding(
                    "cad.no_material",
                    "warning",
                    f"part '{part}' matches no material: it has no mass",
                    where=part,
                    suggestion="add it to a [material.*] in the description",
                )
            )
        return
    weight = mesh.inertia(vertices, triangles, density)
    if weight is None:
        found.append(mesh.open_mesh(part))
    else:
        out.append(weight)


def _identifier(name: str) -> str:
    clean = "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower()).strip("_")
    return clean if clean[:1].isalpha() else f"part_{clean}"


def _unique(name: str, taken: set[str]) -> str:
    """Return the name as an identifier that no mesh has yet: the second `peg` becomes `peg_2`."""
    first = clean = _identifier(name)
    count = 1
    while clean in taken:
        count += 1
        clean = f"{first}_{count}"
    taken.add(clean)
    return clean


def _into(T_drawn_body: Array, points: Array) -> Array:
    """Return drawn points (..., 3) in the body frame."""
    return (points - T_drawn_body[:3, 3]) @ T_drawn_body[:3, :3]


def _joint(
    d: Description,
    spec: JointSpec,
    on: tuple[Array, Array],
    drawn: dict[str, Array],
    measured: dict[str, dict[str, Measured]],
) -> Joint:
    limit = next((s for s in d.limit if spec.name in s.joints), None)
    drive = next((s for s in d.drive if spec.name in s.joints), None)
    unit = references.UNITS.get(spec.type, "mm")
    values: dict = {}
    if limit is not None:
        for key, rate in (("limits", ""), ("soft_limits", ""), ("max_speed", "_s"), ("max_acceleration", "_s2")):
            value = getattr(limit, f"{key}_{unit}{rate}")
            if value is not None:
                scale = SCALES[unit]
                values[key] = tuple(v * scale for v in value) if isinstance(value, tuple) else value * scale
        if limit.cone_deg is not None:
            values["cone"] = limit.cone_deg * DEG
    if drive is not None:
        values["drive"] = Drive(drive.stiffness, drive.damping, drive.max_effort)
    mating = {
        measured[body][name].part
        for body, side in ((spec.parent, spec.on_parent), (spec.child, spec.on_child))
        for name in _names(side)
        if name in measured.get(body, {})
    }
    return Joint(
        spec.name,
        spec.type,
        spec.parent,
        spec.child,
        spatial.inverse(drawn[spec.parent]) @ on[0],
        spatial.inverse(drawn[spec.child]) @ on[1],
        active=spec.active,
        mating=tuple(sorted(_identifier(m) for m in mating)),
        **values,
    )


def _names(spec: FrameSpec) -> list[str]:
    """Return the features that touch in the joint: its axis or centre, and what locates it along the axis."""
    out: list[str] = []
    for value in (spec.origin, spec.at, spec.z):
        out += value if isinstance(value, list) else [value] if value else []
    return out


def _posture(values: dict[str, float]) -> dict[str, float]:
    split = {key: key.rpartition("_") for key in values}
    return {joint: values[key] * SCALES[unit] for key, (joint, _, unit) in split.items()}


def _meetings(d: Description, on: dict[str, tuple[Array, Array]]) -> list[Finding]:
    """Return where the two sides of a joint do not meet in the drawing, with the size in the locked directions."""
    found = []
    for joint in d.joint:
        T = spatial.inverse(on[joint.name][0]) @ on[joint.name][1]
        offset, tilt = locked_error(T, joint.type)
        for size, limit, unit, code in (
            (offset / MM, d.tolerance.meeting_um * UM / MM, "mm", "cad.meeting"),
            (tilt / DEG, d.tolerance.meeting_deg, "deg", "cad.tilt"),
        ):
            if size > limit:
                what = "apart" if unit == "mm" else "out of line"
                found.append(
                    Finding(
                        code,
                        "disagreement",
                        f"joint '{joint.name}': the faces on '{joint.parent}' and '{joint.child}' are "
                        f"{size:.4g}{' mm' if unit == 'mm' else '°'} {what} as drawn",
                        where=joint.name,
                        when="as drawn",
                        size=size,
                        unit=unit,
                        limit=limit,
                        suggestion=f"compare the bores of '{joint.parent}' and '{joint.child}' in the CAD",
                    )
                )
    return found


def locked_error(T: Array, joint_type: str) -> tuple[float, float]:
    """Return the offset in m and the tilt in rad of a joint's two frames in the directions it locks."""
    p, R = T[:3, 3], T[:3, :3]
    tilt_of_axis = float(np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2]))
    if joint_type == "free":
        return 0.0, 0.0
    slides = joint_type in ("prismatic", "cylindrical")
    offset = float(np.linalg.norm(p[:2] if slides else p))
    if joint_type == "spherical":
        return offset, 0.0
    if joint_type in ("revolute", "cylindrical"):
        return offset, tilt_of_axis
    return offset, float(spatial.rotation_angle(R))


def _placement_finding(step: StepModel) -> Finding:
    return Finding(
        "cad.placement_precision",
        "info",
        f"{step.path.name} places instances by matrices, which are read in single precision: joint frames "
        f"are measured to ±{step.placement_error / UM:.2g} µm",
        where=step.path.name,
        size=step.placement_error / UM,
        unit="um",
        suggestion="bake placements into the shapes to measure exactly",
    )
