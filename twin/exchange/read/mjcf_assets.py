"""Remove meshes and textures with missing files from an MJCF, with a warning for each file."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.read.source import warning


def without_missing(spec, path: Path, findings: list[Finding]) -> set[str]:
    """Remove meshes and textures with missing files, and geoms that use them, from a MuJoCo specification.

    Args:
        spec: the MuJoCo specification, parsed and not yet compiled.
        path: the MJCF file.
        findings: receives a warning for each missing file.

    Returns:
        Names of bodies without a stated inertia from which a geom was removed; MuJoCo's masses for them are invalid.
    """
    lost: dict[str, str] = {}
    for mesh in list(spec.meshes):
        if mesh.file and not _place(spec, path, spec.meshdir, mesh.file).is_file():
            lost[mesh.name or Path(mesh.file).stem] = mesh.file
            spec.delete(mesh)
    weightless: set[str] = set()
    gone: set[str] = set()
    for geom in list(spec.geoms):
        if geom.meshname not in lost:
            continue
        body = geom.parent
        text = f"body '{body.name}': mesh {lost[geom.meshname]} is missing: the body is shown without it."
        findings.append(warning("mesh", text, lost[geom.meshname]))
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        gone.add(geom.name)
        spec.delete(geom)
    for name, file in lost.items():
        if all(f.where != file for f in findings):
            findings.append(warning("mesh", f"mesh '{name}': {file} is missing; no body uses it.", file))
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & (gone - {""}):
            spec.delete(pair)
    _textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # a placeholder that compiles; the reader ignores this mass
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
            text = f"body '{body.name}' has no mass, because its mesh is missing."
            findings.append(warning("inertia", text, body.name))
    return weightless


def _textures(spec, path: Path, findings: list[Finding]) -> None:
    for texture in list(spec.textures):
        files = [f for f in (texture.file, *texture.cubefiles) if f]
        missing = [f for f in files if not _place(spec, path, spec.texturedir, f).is_file()]
        if not missing:
            continue
        for material in spec.materials:
            if texture.name in list(material.textures):
                material.textures = ["" if t == texture.name else t for t in material.textures]
        findings.append(warning("texture", f"texture '{texture.name}': {missing[0]} does not exist.", missing[0]))
        spec.delete(texture)


def _place(spec, path: Path, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file."""
    return path.parent / folder / (Path(file).name if spec.strippath else file)
