"""Files that an MJCF names and that are not there: the model is read without them, each with a warning."""

from __future__ import annotations

from pathlib import Path

from twin.core.findings import Finding
from twin.exchange.read.source import warning


def without_missing(spec, path: Path, findings: list[Finding]) -> set[str]:
    """Take meshes and textures whose files are missing out of a MuJoCo specification, with the geoms that show them.

    Args:
        spec: as parsed, not compiled yet.
        path: the file that it comes from.
        findings: told each file.

    Returns:
        The bodies that lost a geom and state no inertia: the mass that MuJoCo would give them means nothing.
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
        text = f"body '{body.name}': mesh {lost[geom.meshname]} is not there: the body is shown without it."
        findings.append(warning("mesh", text, lost[geom.meshname]))
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        gone.add(geom.name)
        spec.delete(geom)
    for name, file in lost.items():
        if all(f.where != file for f in findings):
            findings.append(warning("mesh", f"mesh '{name}': {file} is not there, and nothing shows it.", file))
    for pair in list(spec.pairs):
        if {pair.geomname1, pair.geomname2} & (gone - {""}):
            spec.delete(pair)
    _textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # anything that compiles; the reader leaves it out
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
            text = f"body '{body.name}': its mass would come from the mesh that is not there: it has none."
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
        findings.append(warning("texture", f"texture '{texture.name}': {missing[0]} is not there.", missing[0]))
        spec.delete(texture)


def _place(spec, path: Path, folder: str, file: str) -> Path:
    """Return where MuJoCo looks for a file."""
    return path.parent / folder / (Path(file).name if spec.strippath else file)
