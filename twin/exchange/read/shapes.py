"""Convert shapes of URDF and SDF to meshes: primitives, and mesh files if they exist."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from xml.etree.ElementTree import Element, tostring

import numpy as np

from twin.cad.mesh import SUFFIXES, load_mesh
from twin.core.errors import CadError
from twin.core.findings import Finding
from twin.core.spatial import Array
from twin.core.units import linear
from twin.exchange.read.imported_robot import Findings
from twin.exchange.read.xml_file import Xml
from twin.model.body import Mesh

SIZE_ATTRIBUTES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}
"""Names of the size attributes of each shape in URDF and SDF."""

Color = tuple[float, float, float, float]
"""Red, green, blue and alpha as display values (sRGB) 0..1, as in URDF, MJCF and SDF."""

GREY: Color = (0.8, 0.8, 0.8, 1.0)
"""Default colour as display values 0..1."""


_MESHES_READ: ContextVar[dict[tuple[Path, int, int], tuple[Mesh, list[Finding]]] | None]
_MESHES_READ = ContextVar("meshes_read", default=None)
"""{(file, time of its change, its size): what was read} within `mesh_cache`."""


@contextmanager
def mesh_cache() -> Iterator[None]:
    """Read each mesh file once within this block: for a robot that is read again and again with other numbers."""
    token = _MESHES_READ.set({})
    try:
        yield
    finally:
        _MESHES_READ.reset(token)


def _read_mesh(path: Path) -> tuple[Mesh, list[Finding]]:
    """Return the mesh of a file in m with the axes of the file, and findings on it; see `load_mesh` for errors."""
    cache = _MESHES_READ.get()
    if cache is None:
        return load_mesh(path, "m", None, apply_up_axis=False)
    resolved = path.resolve()
    status = resolved.stat()
    # With time and size: a file may be written anew while robots with its mesh are compared.
    key = (resolved, status.st_mtime_ns, status.st_size)
    if key not in cache:
        cache[key] = load_mesh(path, "m", None, apply_up_axis=False)
    return cache[key]


def primitive(kind: str, size: Sequence[float]) -> tuple[Array, np.ndarray]:
    """Return vertices (n, 3) in m and triangles (m, 3) of a shape.

    Sizes in m: box (edges), cylinder (radius, length), capsule (radius, length between centres), sphere (radius),
    ellipsoid (half axes).
    """
    from trimesh import creation

    if kind == "box":
        solid = creation.box(size)
    elif kind == "cylinder":
        # 48 sides: the radius is at most 0.2 % too small between two corners (1 - cos of half a side's angle).
        solid = creation.cylinder(size[0], size[1], sections=48)
    elif kind == "capsule":
        solid = creation.capsule(size[1], size[0], count=[24, 24])
        solid.vertices -= solid.bounds.mean(axis=0)  # the origin of the shape is its middle
    elif kind == "ellipsoid":
        solid = creation.icosphere(3, 1.0)
        solid.vertices *= size
    else:
        solid = creation.icosphere(3, size[0])
    return np.asarray(solid.vertices, float), np.asarray(solid.faces, np.int32)


def sized_primitive(
    xml: Xml, where: str, kind: str, text: Callable[[str], str | None], findings: Findings
) -> tuple[Array, np.ndarray] | None:
    """Return the surface of a box, cylinder or sphere as in `primitive`. `text` returns the text of an attribute.

    If a size is 0, the shape has no volume: return None and add a warning to `findings`.

    Raises:
        SourceError: a size is missing or negative.
    """
    size = []
    for key in SIZE_ATTRIBUTES[kind]:
        count = 3 if key == "size" else 1
        size += xml.numbers(where, f"{kind} {key}", text(key), count, None).tolist()
    if min(size) < 0:
        xml.fail(where, f"a size of the {kind} is {min(size):g}, but must not be negative")
    if min(size) == 0:
        findings.warn("shape", f"{where}: a {kind} of size 0 is left out.", where)
        return None
    return primitive(kind, size)


def stated_color(text: str | None, where: str, findings: Findings) -> Color:
    """Return the colour in a text of three or four numbers: red, green, blue and alpha (1 if it is missing).

    Grey without a text; also, with a warning, if the text is not such numbers: a colour is no reason to refuse a robot.
    """
    if text is None:
        return GREY
    try:
        values = list(map(float, text.split()))
    except ValueError:
        values = []
    if len(values) not in (3, 4) or not np.all(np.isfinite(values)):
        shown_text = " ".join(text.split())[:80]
        findings.warn("color", f"{where}: the colour '{shown_text}' is not three or four numbers; grey is used.", where)
        return GREY
    if len(values) == 3:
        values.append(1.0)
    red, green, blue, alpha = values
    return red, green, blue, alpha


def shows_all(link: Element, read: int) -> bool:
    """Return whether the meshes of a link of a URDF or SDF show the whole link.

    `read` is the number of meshes made of its visual shapes or, without visual shapes, of its collision shapes. They
    show the whole link if none is missing, and none of its collision shapes differs from all visual shapes. Visual
    shapes alone are for display, and need not show what has mass.
    """
    visuals = link.findall("visual")
    colliders = link.findall("collision")
    if not visuals:
        return read == len(colliders)
    if read != len(visuals) or not colliders:
        return False
    shown_shapes = set(map(_shape_text, visuals))
    return shown_shapes.issuperset(map(_shape_text, colliders))


def _shape_text(element: Element) -> str:
    """Return the geometry and the place of a <visual> or <collision> as text without white space."""
    text = ""
    for child in element:
        if child.tag in ("geometry", "origin", "pose"):
            text += tostring(child, "unicode")
    return "".join(text.split())


def placed_mesh(name: str, vertices: Array, triangles: np.ndarray, T_body_mesh: Array, color: Color) -> Mesh:
    """Return a mesh transformed to the frame of its body, with the colour converted to linear components."""
    points = vertices @ T_body_mesh[:3, :3].T + T_body_mesh[:3, 3]
    r, g, b, a = color
    return Mesh(name, points, np.asarray(triangles, np.int32), (linear(r), linear(g), linear(b), a))


def link_meshes(
    name: str, link: Element, read: Callable[[str, list[Element]], list[Mesh]], findings: Findings, ignored: str = ""
) -> list[Mesh]:
    """Return the visual shapes of a link; if there are none, or none can be read, its collision shapes.

    `read` converts the <visual> or <collision> elements of the link with this name. `ignored` is the note added to
    `findings` if the link has collision shapes that are not imported, because its visual shapes are; none if empty.
    """
    visuals = link.findall("visual")
    collisions = link.findall("collision")
    if not visuals:
        return read(name, collisions)
    meshes = read(name, visuals)
    if not collisions:
        return meshes
    if meshes:
        if ignored:
            findings.note("collision", ignored, name)
        return meshes
    meshes = read(name, collisions)
    if meshes:
        text = f"link '{name}': none of its visual shapes can be read: {len(meshes)} of its collision shapes serve."
        findings.warn("collision", text, name)
    return meshes


def find_file(uri: str, beside: Path) -> Path | None:
    """Return the file at a path or a `package://`, `model://` or `file://` address; None if the file does not exist.

    The search for a package includes `beside` and up to four of its parent folders; environment variables are not used.
    """
    scheme, separator, address = uri.partition("://")
    if not separator:
        address = uri
    name = address.lstrip("/")
    names = [name]
    if separator and scheme != "file":
        _, _, in_package = name.partition("/")
        names.append(in_package)
    candidates = []
    if scheme == "file" or not separator:
        candidates.append(Path(address))
    # In a package, descriptions and meshes are in folders beside each other, such as urdf/ and meshes/.
    folders = [beside, *list(beside.resolve().parents)[:4]]
    # The whole name in all folders first: without the name of the package, a file of another package may be found.
    for name in names:
        if name:
            for folder in folders:
                candidates.append(folder / name)
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    return None


def mesh_file(uri: str, beside: Path, scale: Array, link: str, findings: Findings) -> tuple[Array, np.ndarray] | None:
    """Return (vertices (n, 3) in m, z up, triangles (m, 3)) of a mesh file.

    glTF is y up. The up axis of a Collada file is not applied: RViz, Gazebo (for SDF too), MoveIt, DART and Pinocchio
    ignore it, and authors of robots place their meshes as these programs show them. The first file with another up axis
    than z adds a warning to `findings`. If the file cannot be read, return None and add a warning that names the file.

    Sources: rviz mesh_loader.cpp and ros2/rviz assimp_loader.cpp (AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION);
    gz-common ColladaLoader.cc (reads only the unit) and AssimpLoader.cc; moveit/geometric_shapes pull request 52;
    hpp-fcl src/mesh_loader/assimp.cpp.
    """
    path = find_file(uri, beside)
    if path is None or path.suffix.lower() not in SUFFIXES:
        reason = f"is not a file of type {', '.join(SUFFIXES)}"
        if path is None:
            reason = "was not found"
        findings.warn("mesh", f"link '{link}': mesh {uri} {reason}: the link is shown without this mesh.", uri)
        return None
    try:
        mesh, mesh_findings = _read_mesh(path)
    except CadError as error:
        findings.warn("mesh", f"link '{link}': {error}: the link is shown without this mesh.", uri)
        return None
    is_reported = any(f.code == "import.up_axis" for f in findings)  # once a robot: its files are from one program
    for finding in mesh_findings:
        if finding.code == "cad.up_axis" and not is_reported:
            findings.warn("up_axis", f"link '{link}': {finding.message}; {finding.suggestion}.", uri)
    triangles = mesh.triangles
    if np.prod(scale) < 0:  # a mirrored mesh: its triangles must turn the other way to show their outer side
        triangles = triangles[:, ::-1]
    return mesh.vertices * scale, triangles
