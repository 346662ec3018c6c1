"""Remove from a MuJoCo specification what needs files that are missing, so that the rest compiles."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from twin.exchange.read.imported_robot import Findings


class BodiesWithMissingMeshes(NamedTuple):
    """Names of bodies that lack shapes because of missing files, and of those among them whose mass is unknown."""

    shapeless: set[str]
    weightless: set[str]


def remove_missing_files(spec, path: Path, findings: Findings) -> BodiesWithMissingMeshes:
    """Remove meshes and textures whose files are missing, and the geoms of these meshes, from a MuJoCo specification.

    `spec` is parsed, but not compiled. Each missing file is reported as a warning.

    The mass of a body is unknown if a geom was removed and the file states no inertia.
    """
    missing_meshes: dict[str, str] = {}
    for mesh in list(spec.meshes):
        if mesh.file and not _searched_path(spec, path, spec.meshdir, mesh.file).is_file():
            searched = Path(mesh.file).name if spec.strippath else mesh.file
            missing_meshes[mesh.name or Path(mesh.file).stem] = (Path(spec.meshdir) / searched).as_posix()
            spec.delete(mesh)
    weightless: set[str] = set()
    shapeless: set[str] = set()
    removed_geoms: set[str] = set()
    for geom in list(spec.geoms):
        if geom.meshname not in missing_meshes:
            continue
        body = geom.parent
        text = (
            f"body '{body.name}': mesh {missing_meshes[geom.meshname]} is missing: the body is shown without this mesh."
        )
        findings.warn("mesh", text, missing_meshes[geom.meshname])
        shapeless.add(body.name)
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        removed_geoms.add(geom.name)
        spec.delete(geom)
    reported = {finding.where for finding in findings}
    for name, file in missing_meshes.items():
        if file not in reported:
            reported.add(file)
            findings.warn("mesh", f"mesh '{name}': {file} is missing; no body uses it.", file)
    removed_geoms.discard("")  # a geom without a name is in no pair
    for pair in list(spec.pairs):
        if pair.geomname1 in removed_geoms or pair.geomname2 in removed_geoms:
            spec.delete(pair)
    _remove_missing_textures(spec, path, findings)
    for body in spec.bodies:
        if body.name in weightless:  # a placeholder that compiles; the reader ignores this mass
            body.explicitinertial = True
            body.mass = 1.0
            body.inertia = [1.0, 1.0, 1.0]
            text = f"body '{body.name}' has no mass, because its mesh is missing."
            findings.warn("inertia", text, body.name)
    return BodiesWithMissingMeshes(shapeless, weightless)


def _remove_missing_textures(spec, path: Path, findings: Findings) -> None:
    for texture in list(spec.textures):
        missing: list[str] = []
        for file in (texture.file, *texture.cubefiles):
            if file and not _searched_path(spec, path, spec.texturedir, file).is_file():
                missing.append(file)
        if not missing:
            continue
        for material in spec.materials:
            textures = list(material.textures)
            if texture.name in textures:
                # Assigned as a whole, because MuJoCo returns a copy of the list.
                for index, name in enumerate(textures):
                    if name == texture.name:
                        textures[index] = ""
                material.textures = textures
        findings.warn("texture", f"texture '{texture.name}': {missing[0]} does not exist.", missing[0])
        spec.delete(texture)


def _searched_path(spec, path: Path, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file."""
    if spec.strippath:
        file = Path(file).name
    return path.parent / folder / file
