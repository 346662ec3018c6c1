"""Remove meshes, height fields and textures whose files are missing, so that a MuJoCo specification compiles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from twin.exchange.read.imported_robot import IS_MISSING, ITS_MESH_IS_MISSING, Findings

if TYPE_CHECKING:
    import mujoco


class BodiesWithMissingMeshes(NamedTuple):
    """Names of bodies that lack shapes because of missing files, and of those among them whose mass is unknown."""

    shapeless: set[str]
    weightless: set[str]


def remove_missing_files(spec: mujoco.MjSpec, path: Path, findings: Findings) -> BodiesWithMissingMeshes:
    """Remove meshes, height fields and textures whose files are missing, and the geoms of what is removed.

    `spec` is parsed, but not compiled. Each missing file is reported as a warning.

    The mass of a body is unknown if a geom was removed and the file states no inertia.
    """
    missing_meshes: dict[str, str] = {}
    for mesh in list(spec.meshes):
        file = _searched_file(spec, spec.meshdir, mesh.file)
        if mesh.file and not (path.parent / file).is_file():
            missing_meshes[mesh.name or Path(mesh.file).stem] = file.as_posix()
            spec.delete(mesh)
    weightless: set[str] = set()
    shapeless: set[str] = set()
    removed_geoms: set[str] = set()
    for geom in list(spec.geoms):
        if geom.meshname not in missing_meshes:
            continue
        body = geom.parent
        file = missing_meshes[geom.meshname]
        text = f"body '{body.name}': mesh {file} {IS_MISSING}: the body is shown without this mesh."
        findings.warn("mesh", text, file)
        shapeless.add(body.name)
        if not body.explicitinertial and body.name != "world":
            weightless.add(body.name)
        removed_geoms.add(geom.name)
        spec.delete(geom)
    reported = {finding.where for finding in findings}
    for name, file in missing_meshes.items():
        if file not in reported:
            reported.add(file)
            findings.warn("mesh", f"mesh '{name}': {file} {IS_MISSING}; no body uses it.", file)
    removed_geoms |= _remove_missing_height_fields(spec, path, findings)
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
            text = f"body '{body.name}' has no mass, {ITS_MESH_IS_MISSING}."
            findings.warn("inertia", text, body.name)
    return BodiesWithMissingMeshes(shapeless, weightless)


def _remove_missing_height_fields(spec: mujoco.MjSpec, path: Path, findings: Findings) -> set[str]:
    """Remove height fields whose files are missing, which never have mass; return the names of their geoms."""
    missing: set[str] = set()
    for field in list(spec.hfields):
        file = _searched_file(spec, spec.meshdir, field.file)
        if field.file and not (path.parent / file).is_file():
            name = field.name or Path(field.file).stem
            missing.add(name)
            text = f"height field '{name}': {file.as_posix()} {IS_MISSING}: it is left out."
            findings.warn("mesh", text, file.as_posix())
            spec.delete(field)
    removed_geoms: set[str] = set()
    for geom in list(spec.geoms):
        if geom.hfieldname in missing:
            removed_geoms.add(geom.name)
            spec.delete(geom)
    return removed_geoms


def _remove_missing_textures(spec: mujoco.MjSpec, path: Path, findings: Findings) -> None:
    for texture in list(spec.textures):
        missing: list[str] = []
        for file in (texture.file, *texture.cubefiles):
            if file and not (path.parent / _searched_file(spec, spec.texturedir, file)).is_file():
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


def _searched_file(spec: mujoco.MjSpec, folder: str, file: str) -> Path:
    """Return the path at which MuJoCo searches for a file, relative to the MJCF unless it is absolute."""
    if spec.strippath:
        file = Path(file).name
    return Path(folder) / file
