"""Write a mechanism as a robot folder: description, meshes, formula, initial protocol, notes.

All frames are given as numbers in the base frame at the rest pose, with the loops closed. Lengths are printed with all
digits of a double, so that the loops of the written mechanism close as well as those of the imported one.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Set
from dataclasses import replace
from pathlib import Path

from twin.core import assets
from twin.core.errors import OutputError
from twin.core.findings import Finding, by_severity
from twin.core.spatial import Array
from twin.core.units import DEG, MM
from twin.core.version import __version__
from twin.exchange.read.drives import NOTE
from twin.exchange.read.source import Imported
from twin.exchange.read.templates import formula, protocol
from twin.exchange.read.text import frame, number, numbers, one_line, string
from twin.model.body import Body, Mesh
from twin.model.joint import Joint
from twin.model.mechanism import Mechanism
from twin.model.transmission import Actuator

NOTES = "IMPORT.md"
"""Name of the file that lists changed, guessed, missing and omitted data."""


@contextlib.contextmanager
def fresh_folder(target: Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary folder that is moved atomically to `target` at the end.

    Raises:
        OutputError: the folder is not empty (without `force`), or cannot be written.
    """
    require_free(target, force)
    with assets.atomic_folder(target) as work:
        yield work


def require_free(target: Path, force: bool = False) -> None:
    """Raise `OutputError` if `fresh_folder` would refuse to write to `target`.

    Raises:
        OutputError: the folder is not empty.
    """
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target}: a file has this name; choose another folder with --out")
    if target.is_dir() and any(target.iterdir()):
        if not force:
            raise OutputError(f"{target}: the folder is not empty; choose another with --out, or use --force")
        others = [p.name for p in (target / "cad").glob("*.toml")]
        if any(target.iterdir()) and not others:
            raise OutputError(f"{target}: it is not a robot folder, so --force does not overwrite it")


def write_folder(imported: Imported, name: str, target: Path, source: Path, force: bool = False) -> list[Path]:
    """Write the robot folder of a mechanism whose loops are closed (see `closing.close`).

    Args:
        imported: mechanism and findings.
        name: identifier of the robot.
        target: the folder; it must be new or empty, unless `force` is set.
        source: the imported file; the description contains its name.
        force: overwrite an existing robot folder, except its protocols and a formula that contains equations.

    Returns:
        The files written, the description first.

    Raises:
        OutputError: the folder is not empty, or cannot be written.
    """
    mechanism = replace(imported.mechanism, name=name)

    def cad(folder: Path) -> Mechanism:
        (folder / "meshes").mkdir()
        for body in mechanism.bodies:
            for mesh in body.meshes:
                _obj(folder / f"meshes/{mesh.name}.obj", mesh, mechanism.rest[body.name])
        (folder / f"{name}.toml").write_text(describe(mechanism, source.name, imported.assumed), "utf-8")
        return mechanism

    return write_robot(name, target, cad, imported.findings, source, force)


def write_robot(
    name: str,
    target: Path,
    cad: Callable[[Path], Mechanism],
    findings: list[Finding],
    source: Path,
    force: bool = False,
) -> list[Path]:
    """Write a robot folder with files from `cad`, a function that fills the folder cad/ and returns the mechanism.

    The other arguments, the return value and the errors are the same as for `write_folder`.
    """
    with fresh_folder(target, force) as work:
        (work / "cad").mkdir()
        (work / "trajectories").mkdir()
        mechanism = cad(work / "cad")
        own = assets.RobotFiles(name, work, work, work, target / "formula.py")
        if not own.has_equations:
            (work / "formula.py").write_text(formula(mechanism), "utf-8")
        if not (target / "trajectories/first.toml").exists():
            (work / "trajectories/first.toml").write_text(protocol(mechanism), "utf-8")
        (work / NOTES).write_text(notes(name, findings, source), "utf-8")
        written = sorted(p.relative_to(work) for p in work.rglob("*") if p.is_file())
    first = Path("cad") / f"{name}.toml"
    return [target / first, *(target / p for p in written if p != first)]


def notes(name: str, findings: list[Finding], source: Path) -> str:
    """Return the text of the notes: findings of the import, the most severe first."""
    digest = hashlib.sha256(source.read_bytes()).hexdigest() if source.is_file() else "-"
    lines = [
        f"# How {one_line(name)} was imported",
        "",
        f"It was imported by twin {__version__} from `{one_line(source.name)}`, sha256 {digest}.",
        "",
    ]
    titles = {"warning": "Changes from the file", "info": "Changed without loss"}
    for severity, title in titles.items():
        rows = [f for f in by_severity(findings) if f.severity == severity]
        lines += [f"## {title}", "", *([f"- {one_line(f.message)} ({f.code})" for f in rows] or ["- nothing"]), ""]
    return "\n".join(lines)


def describe(m: Mechanism, source: str, assumed: Set[str] = frozenset()) -> str:
    """Return the description of a mechanism in TOML; drives of the joints in `assumed` are marked ASSUMED."""
    lines = [
        f"# {m.name}, made by `twin new` from {one_line(source)}; omitted and guessed data are listed in ../{NOTES}.",
        "# All frames are in the base frame at the rest pose, with loops closed.",
        f"name = {string(m.name)}",
        f"title = {string(m.name)}",
        f"source = {string(source)}",
        'default_protocol = "first"',
        f"base = {string(m.base)}",
        f"tool = {string(m.tool)}",
        *([f"trocar = {string(m.trocars[0])}"] if len(m.trocars) == 1 else []),
        *([f"trocars = [{', '.join(map(string, m.trocars))}]"] if len(m.trocars) > 1 else []),
        *TOLERANCE,
    ]
    for body in m.bodies:
        lines += _body(m, body, source)
    for joint in m.joints:
        lines += [
            "",
            "[[joint]]",
            f"name = {string(joint.name)}",
            f"type = {string(joint.type)}",
            f"parent = {string(joint.parent)}",
            f"child = {string(joint.child)}",
            *(["active = true"] if joint.active else []),
            f"on_parent = {frame(m.rest[joint.parent] @ joint.T_parent_joint)}",
            f"on_child = {frame(m.rest[joint.child] @ joint.T_child_joint)}",
        ]
    for joint in m.joints:
        lines += _limit(joint, source) + _drive(joint, source, joint.name in assumed)
    for c in m.couplings:
        angle = m.joint(c.joints[0]).is_angle
        lines += [
            "",
            "[[coupling]]",
            f"name = {string(c.name)}",
            f"joints = [{', '.join(map(string, c.joints))}]",
            f"ratios = {numbers(c.ratios)}",
            f"sum_deg = {number(c.total / DEG)}" if angle else f"sum_mm = {number(c.total / MM)}",
            *_cited(source),
        ]
    for a in m.actuators:
        lines += _actuator(a, source, a.name in assumed)
    for t in m.transmissions:
        lines += [
            "",
            "[[transmission]]",
            f"name = {string(t.name)}",
            f"joints = [{', '.join(map(string, t.joints))}]",
            f"actuators = [{', '.join(map(string, t.actuators))}]",
            f"matrix = [{', '.join(map(numbers, t.matrix))}]",
            *_cited(source),
        ]
    for f in m.frames:
        T = m.rest[f.body] @ f.T_body_frame
        lines += ["", f"[frame.{f.name}]", f"body = {string(f.body)}", f"at = {frame(T)}"]
    for p in m.points:
        at = m.rest[p.body][:3, :3] @ p.p_body + m.rest[p.body][:3, 3]
        lines += ["", f"[point.{p.name}]", f"body = {string(p.body)}", f"position_mm = {numbers(at / MM)}"]
    for posture, values in m.postures.items():
        lines += ["", f"[posture.{posture}]"]
        for joint, q in values.items():
            angle = m.joint(joint).is_angle
            lines.append(f"{joint}_{'deg' if angle else 'mm'} = {number(q / (DEG if angle else MM))}")
    return "\n".join(lines) + "\n"


TOLERANCE = ("", "[tolerance]", "gross_mm = 1", "gross_deg = 1", "meeting_um = 1", "meeting_deg = 0.001")
"""Lines of the table of tolerances in a new description."""


def _body(m: Mechanism, body: Body, source: str) -> list[str]:
    lines = ["", f"[body.{body.name}]"]
    T = m.rest[body.name]
    if body.inertia is not None:
        R = T[:3, :3]
        com = R @ body.inertia.p_body_com + T[:3, 3]
        I = R @ body.inertia.I_com @ R.T  # noqa: E741
        tensor = numbers([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
        lines += [
            f"[body.{body.name}.mass]",
            f"mass_kg = {number(body.inertia.mass)}",
            f"com_mm = {numbers(com / MM)}",
            f"inertia_kg_m2 = {tensor} # xx yy zz xy xz yz, about the centre of mass",
            *_cited(source),
        ]
    for mesh in body.meshes:
        color = mesh.color_rgba if mesh.color_rgba[3] != 1 else mesh.color_rgba[:3]
        lines += [
            "",
            f"[[body.{body.name}.meshes]]",
            f"file = {string(f'meshes/{mesh.name}.obj')}",
            'unit = "m"',
            f"color = {numbers(color)}",
        ]
    return lines


def _limit(joint: Joint, source: str) -> list[str]:
    unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
    lines = []
    for key, value in (("limits", joint.limits), ("soft_limits", joint.soft_limits)):
        if value is not None:
            lines.append(f"{key}_{unit} = {numbers([v / scale for v in value])}")
    for key, value in (
        (f"max_speed_{unit}_s", joint.max_speed),
        (f"max_acceleration_{unit}_s2", joint.max_acceleration),
    ):
        if value is not None:
            lines.append(f"{key} = {number(value / scale)}")
    if joint.cone is not None:
        lines.append(f"cone_deg = {number(joint.cone / DEG)}")
    return ["", "[[limit]]", f"joints = [{string(joint.name)}]", *lines, *_cited(source)] if lines else []


def _drive(joint: Joint, source: str, assumed: bool) -> list[str]:
    drive = joint.drive
    if drive is None:
        return []
    effort = [] if drive.max_effort is None else [f"max_effort = {number(drive.max_effort)}"]
    return [
        "",
        "[[drive]]",
        f"joints = [{string(joint.name)}]",
        f"stiffness = {number(drive.stiffness)}",
        f"damping = {number(drive.damping)}",
        *effort,
        *(['provenance = "ASSUMED"', f"note = {string(NOTE)}"] if assumed else _cited(source)),
    ]


def _actuator(a: Actuator, source: str, assumed: bool) -> list[str]:
    unit, scale = ("deg", DEG) if a.is_angle else ("mm", MM)
    own = {"max_effort": a.max_effort, "rotor_inertia": a.rotor_inertia, "stiffness": a.stiffness}
    own |= {"damping": a.damping or None, f"max_speed_{unit}_s": a.max_speed and a.max_speed / scale}
    return [
        "",
        "[[actuator]]",
        f"name = {string(a.name)}",
        f"kind = {string(a.kind)}",
        *([] if a.limits is None else [f"limits_{unit} = {numbers([v / scale for v in a.limits])}"]),
        *(f"{key} = {number(value)}" for key, value in own.items() if value is not None),
        *(['provenance = "ASSUMED"', f"note = {string(NOTE)}"] if assumed else _cited(source)),
    ]


def _cited(source: str) -> list[str]:
    return ['provenance = "CITED"', f"note = {string(source)}"]


def _obj(path: Path, mesh: Mesh, T: Array) -> None:
    points = mesh.vertices @ T[:3, :3].T + T[:3, 3]
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    path.write_text("\n".join(rows) + "\n", "ascii")
