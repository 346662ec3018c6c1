"""Write a mechanism as a robot folder: description with given frames, meshes, templates.

Everything is given in drawn coordinates: the base frame, with the loops closed. Lengths are printed with all
digits of a double, so the folder's mechanism closes as well as the one that was read.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from twin import assets, spatial
from twin.errors import OutputError
from twin.findings import Finding
from twin.importing.source import Imported
from twin.importing.templates import formula, protocol
from twin.mechanism import Body, Joint, Mechanism, Mesh
from twin.spatial import Array
from twin.units import DEG, MM


def write_folder(imported: Imported, name: str, target: Path, source: Path) -> list[Path]:
    """Write the robot folder of a mechanism whose loops are closed (see `close`).

    Args:
        imported: mechanism and findings.
        name: identifier of the robot.
        target: the folder; it must not exist, or be empty.
        source: the file it came from, for the description.

    Returns:
        The files written, the description first.

    Raises:
        OutputError: the folder holds something already, or cannot be written.
    """
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise OutputError(f"{target}: there is something already; choose another name or --out")
    mechanism = replace(imported.mechanism, name=name)
    with assets.atomic_folder(target) as work:
        (work / "cad/meshes").mkdir(parents=True)
        (work / "templates").mkdir()
        for body in mechanism.bodies:
            for mesh in body.meshes:
                _obj(work / f"cad/meshes/{mesh.name}.obj", mesh, mechanism.rest[body.name])
        (work / f"cad/{name}.toml").write_text(describe(mechanism, imported.findings, source.name), "utf-8")
        (work / "templates/formula.py").write_text(formula(mechanism), "utf-8")
        (work / "templates/first.toml").write_text(protocol(mechanism), "utf-8")
        written = sorted(p.relative_to(work) for p in work.rglob("*") if p.is_file())
    first = Path("cad") / f"{name}.toml"
    return [target / first, *(target / p for p in written if p != first)]


def describe(m: Mechanism, findings: list[Finding], source: str) -> str:
    """Return the description of a mechanism in TOML."""
    lost = [f for f in findings if f.severity != "info"]
    lines = [
        f"# {m.name}, made by `twin new` from {_plain(source)}.",
        "# Everything is in drawn coordinates: the base frame, loops closed.",
        *(f"# {f.severity}: {_plain(f.message)}" for f in lost),
        f"name = {_str(m.name)}",
        f"title = {_str(m.name)}",
        f"source = {_str(source)}",
        'default_protocol = "first"',
        f"base = {_str(m.base)}",
        f"tool = {_str(m.tool)}",
        *([f"trocar = {_str(m.trocar)}"] if m.trocar else []),
        "",
        "[tolerance]",
        "gross_mm = 1",
        "gross_deg = 1",
        "meeting_um = 1",
        "meeting_deg = 0.001",
    ]
    for body in m.bodies:
        lines += _body(m, body, source)
    for joint in m.joints:
        lines += [
            "",
            "[[joint]]",
            f"name = {_str(joint.name)}",
            f"type = {_str(joint.type)}",
            f"parent = {_str(joint.parent)}",
            f"child = {_str(joint.child)}",
            *(["active = true"] if joint.active else []),
            f"on_parent = {_frame(m.rest[joint.parent] @ joint.T_parent_joint)}",
            f"on_child = {_frame(m.rest[joint.child] @ joint.T_child_joint)}",
        ]
    for joint in m.joints:
        lines += _limit(joint, source) + _drive(joint, source)
    for c in m.couplings:
        angle = m.joint(c.joints[0]).is_angle
        lines += [
            "",
            "[[coupling]]",
            f"name = {_str(c.name)}",
            f"joints = [{', '.join(map(_str, c.joints))}]",
            f"ratios = {_list(c.ratios)}",
            f"sum_deg = {_num(c.total / DEG)}" if angle else f"sum_mm = {_num(c.total / MM)}",
            *_cited(source),
        ]
    for frame in m.frames:
        T = m.rest[frame.body] @ frame.T_body_frame
        lines += ["", f"[frame.{frame.name}]", f"body = {_str(frame.body)}", f"at = {_frame(T)}"]
    for posture, values in m.postures.items():
        lines += ["", f"[posture.{posture}]"]
        for joint, q in values.items():
            angle = m.joint(joint).is_angle
            lines.append(f"{joint}_{'deg' if angle else 'mm'} = {_num(q / (DEG if angle else MM))}")
    return "\n".join(lines) + "\n"


def _body(m: Mechanism, body: Body, source: str) -> list[str]:
    lines = ["", f"[body.{body.name}]"]
    T = m.rest[body.name]
    if body.inertia is not None:
        R = T[:3, :3]
        com = R @ body.inertia.p_body_com + T[:3, 3]
        I = R @ body.inertia.I_com @ R.T  # noqa: E741
        tensor = _list([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]])
        lines += [
            f"[body.{body.name}.mass]",
            f"mass_kg = {_num(body.inertia.mass)}",
            f"com_mm = {_list(com / MM)}",
            f"inertia_kg_m2 = {tensor} # xx yy zz xy xz yz, about the centre of mass",
            *_cited(source),
        ]
    for mesh in body.meshes:
        lines += [
            "",
            f"[[body.{body.name}.meshes]]",
            f"file = {_str(f'meshes/{mesh.name}.obj')}",
            'unit = "m"',
            f"color = {_list(mesh.color_rgba[:3])}",
        ]
    return lines


def _limit(joint: Joint, source: str) -> list[str]:
    unit, scale = ("deg", DEG) if joint.is_angle else ("mm", MM)
    lines = []
    for key, value in (("limits", joint.limits), ("soft_limits", joint.soft_limits)):
        if value is not None:
            lines.append(f"{key}_{unit} = {_list([v / scale for v in value])}")
    for key, value in (
        (f"max_speed_{unit}_s", joint.max_speed),
        (f"max_acceleration_{unit}_s2", joint.max_acceleration),
    ):
        if value is not None:
            lines.append(f"{key} = {_num(value / scale)}")
    if joint.cone is not None:
        lines.append(f"cone_deg = {_num(joint.cone / DEG)}")
    return ["", "[[limit]]", f"joints = [{_str(joint.name)}]", *lines, *_cited(source)] if lines else []


def _drive(joint: Joint, source: str) -> list[str]:
    drive = joint.drive
    if drive is None:
        return []
    effort = [] if drive.max_effort is None else [f"max_effort = {_num(drive.max_effort)}"]
    return [
        "",
        "[[drive]]",
        f"joints = [{_str(joint.name)}]",
        f"stiffness = {_num(drive.stiffness)}",
        f"damping = {_num(drive.damping)}",
        *effort,
        *_cited(source),
    ]


def _cited(source: str) -> list[str]:
    return ['provenance = "CITED"', f"note = {_str(source)}"]


def _frame(T: Array) -> str:
    return f"{{ position_mm = {_list(T[:3, 3] / MM)}, angles_deg = {_list(zyx(T[:3, :3]) / DEG)} }}"


def zyx(R: Array) -> Array:
    """Return (psi, theta, phi) in rad with R = Rz(psi) Ry(theta) Rx(phi), exact to rounding in every pose."""
    psi = np.arctan2(R[1, 0], R[0, 0])
    theta = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    ex, ey, ez = np.eye(3)
    # phi from what the other two leave: it holds where theta is 90° and psi may be anything
    rest = (spatial.exp_so3(psi * ez) @ spatial.exp_so3(theta * ey)).T @ R
    return np.array([psi, theta, np.arctan2(rest[2, 1] - rest[1, 2], rest[1, 1] + rest[2, 2])]) + 0.0 * ex


def _obj(path: Path, mesh: Mesh, T: Array) -> None:
    points = mesh.vertices @ T[:3, :3].T + T[:3, 3]
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    path.write_text("\n".join(rows) + "\n", "ascii")


def _num(value: float) -> str:
    text = repr(float(value) + 0.0)  # no -0.0
    return text if np.isfinite(value) else ("inf" if value > 0 else "-inf")


def _list(values) -> str:
    return f"[{', '.join(_num(v) for v in values)}]"


def _str(text: str) -> str:
    return json.dumps(text)  # a JSON string is a TOML string


def _plain(text: str) -> str:
    """Return one line without control characters, for a comment."""
    return "".join(c if c.isprintable() else " " for c in text)
