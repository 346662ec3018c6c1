"""STEP import by OpenCASCADE (cascadio): parts with triangles, linear colours and exact faces.

The importer writes a GLB whose JSON contains the tree, the names and, for each part, the analytic faces in double
precision. Vertices and instance placements in the GLB are float32. If a STEP file has no instance placements (they are
already applied to the shapes, as in the built-in files), the faces are exact; for other files,
`StepModel.placement_error` is the error.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from twin.core.atomic import Scratch, atomic_folder
from twin.core.cache import cache_folder
from twin.core.errors import CadError, OutputError, SourceError
from twin.core.foreign.budget import read_bytes
from twin.core.foreign.guard import run
from twin.core.foreign.once import Once, Read
from twin.core.spatial import Array
from twin.core.units import MM

VISUAL_TOLERANCE = 0.1 * MM
"""Chord tolerance in m of the displayed meshes; the normals of neighbouring triangles differ by at most 0.5 rad."""

PROP_TOLERANCE = 0.5 * MM
"""Chord tolerance in m of the props of a scene; it yields a third as many triangles as `VISUAL_TOLERANCE`."""

MASS_ANGLE = 0.15
"""Maximum angle in rad between the normals of neighbouring triangles in the meshes for mass computation."""

MASS_TOLERANCE = 0.005 * MM
"""Chord tolerance in m of the meshes for mass computation; the volume of a convex part is slightly too small."""

_MAX_CACHED_FILES = 128
"""Maximum number of converted STEP files in the cache; the built-in robots and scenes need about 40."""

_GREY = (0.6, 0.6, 0.6, 1.0)
"""Linear colour of a part without one."""

_SINGLE_PRECISION = 2.0**-23
"""Relative error of numbers in single precision, which have 23 binary digits after the first."""

_WHITE_SPACE = bytes(byte for byte in range(256) if chr(byte).isspace())
"""The bytes that are spaces or ends of lines in Latin-1."""

_SI_PREFIXES = {"": 1.0, "MILLI": 1e-3, "CENTI": 1e-2, "DECI": 0.1, "MICRO": 1e-6, "KILO": 1e3}
"""{prefix of the metre in a STEP file: size of the unit in m}."""

_NAMED_UNITS = {"INCH": 0.0254, "FOOT": 0.3048, "MILLIMETRE": 1e-3, "CENTIMETRE": 1e-2, "METRE": 1.0}
"""{name of a unit that a STEP file defines by a conversion from another: size of the unit in m}."""

_IMPERIAL_UNITS = {0.0254, 0.3048}
"""Named units in m, which count before a named metric unit: an inch may be defined by named millimetres."""


@dataclass(frozen=True)
class Face:
    """An analytic face in drawn coordinates, in m.

    Attributes:
        kind: "plane", "cylinder" or "sphere", which can be measured; in `Part.drawn` also "cone" or "torus".
        point: (3,) plane: a point of the plane; cylinder: the point of the axis at the middle of the face; sphere and
            torus: the centre; cone: the apex.
        direction: (3,) unit normal or axis with arbitrary sign; zeros for a sphere.
        radius: radius of the cylinder or sphere, major radius of the torus, 0 for a plane or cone.
        half_angle: angle in rad between the axis of a cone and its face; 0 for other kinds.
    """

    kind: str
    point: Array
    direction: Array
    radius: float
    half_angle: float = 0.0


MEASURED = ("plane", "cylinder", "sphere")
"""Kinds of faces that a description can name, and on which frames are measured."""


@dataclass(frozen=True)
class Part:
    """One solid of a STEP file.

    Attributes:
        name: node name, with its encoding repaired.
        path: names of the assembly nodes above the part, outermost first.
        vertices: (n, 3) positions in m, in drawn coordinates.
        triangles: (m, 3) indices of vertices.
        color_rgba: linear colour, 0..1.
        faces: analytic faces of the kinds `MEASURED`.
        drawn: every face, in the order of the file, also those that are not in `faces`; None: a face without axis or
            centre, such as a B-spline.
        face_of_triangle: (m,) index into `drawn` of the face of each triangle.
        numbered: `path` and `name`, with a number at each node that has siblings of its name: leg_1, leg_2, ... No
            other node of the file has the numbered name.
    """

    name: str
    path: tuple[str, ...]
    vertices: Array
    triangles: np.ndarray
    color_rgba: tuple[float, float, float, float]
    faces: tuple[Face, ...]
    numbered: tuple[str, ...] = ()
    drawn: tuple[Face | None, ...] = ()
    face_of_triangle: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))

    @property
    def chain(self) -> tuple[str, ...]:
        """Names of the assembly nodes above the part and of the part, with the numbers of `numbered`."""
        return self.numbered or (*self.path, self.name)


@dataclass(frozen=True)
class StepModel:
    """The parts of a STEP file, its length unit in m, and the error of instance placements in m."""

    path: Path
    unit: float
    parts: tuple[Part, ...]
    placement_error: float


def length_unit(path: Path, read: Read = read_bytes) -> float:
    """Return the length unit of a STEP file in m; `read` returns the bytes of the file.

    Raises:
        CadError: the file is missing, is not a STEP file or is truncated, or its length unit is missing, unknown or not
            unique.
    """
    try:
        data = read(path, "STEP")
    except OSError as error:
        raise CadError(f"{path}: cannot read the STEP file ({error.strerror or error})") from error
    if not data.strip():
        raise CadError(f"{path} is empty: export or copy the STEP file again")
    compact = data.translate(None, _WHITE_SPACE).decode("latin-1")
    if not compact.startswith("ISO-10303-21"):
        raise CadError(f"{path} is not a STEP file: it does not begin with ISO-10303-21")
    if b"END-ISO-10303-21" not in data[-4096:]:
        raise CadError(f"{path} is truncated: END-ISO-10303-21 is missing. Export or copy it again.")
    units = _stated_units(path, compact)
    units = units & _IMPERIAL_UNITS or units
    if not units:
        raise CadError(
            f"{path} states no length unit; a STEP file without a unit cannot be scaled. Export it again in mm."
        )
    if len(units) > 1:
        listed = ", ".join(map("{:g} m".format, sorted(units)))
        raise CadError(f"{path} mixes length units ({listed}); use one.")
    return units.pop()


def _stated_units(path: Path, compact: str) -> set[float]:
    """Return the length units in m that a STEP file states; `compact` is its text without spaces.

    Raises:
        CadError: a named unit is not known.
    """
    named_units: set[float] = set()
    si_units: set[float] = set()
    for entity in compact.split(";"):
        is_length_unit = "LENGTH_UNIT()" in entity and "=(" in entity and entity.endswith(")")
        if not is_length_unit:
            continue
        named = re.search(r"CONVERSION_BASED_UNIT\('([^']*)'", entity)
        if named:
            unit = _NAMED_UNITS.get(named.group(1).upper())
            if unit is None:
                raise CadError(f"{path}: the length unit '{named.group(1)}' is not known; export in mm")
            named_units.add(unit)
            continue
        si = re.search(r"SI_UNIT\((?:\.(\w+)\.|\$),\.METRE\.\)", entity)
        if si:
            prefix = si.group(1) or ""
            if prefix in _SI_PREFIXES:
                si_units.add(_SI_PREFIXES[prefix])
    # A named unit is defined by a conversion from an SI unit, which is therefore also in the file.
    return named_units or si_units


def read_step(
    path: Path, tolerance: float = VISUAL_TOLERANCE, angle: float = 0.5, read: Read | None = None
) -> StepModel:
    """Read a STEP file, with triangles and exact faces.

    `tolerance` is the chord tolerance of the triangles in m, `angle` the maximum angle between neighbouring normals in
    rad. `read` returns the bytes of the file, by default from disk.

    Raises:
        CadError: the file is missing, is not a STEP file, is truncated, or has no unit or no solids.
    """
    read = read or Once()
    unit = length_unit(path, read)
    header, binary = _split_glb(_glb(path, tolerance / MM, angle, read))
    parts, error = _parts(header, binary)
    if not parts:
        raise CadError(f"{path} contains no solids")
    return StepModel(path, unit, tuple(parts), error)


def _glb(path: Path, tolerance: float, angle: float, read: Read = read_bytes) -> bytes:
    """Return the STEP file as GLB with exact faces, from the user's cache if the same file was read before.

    `tolerance` is in mm, because OpenCASCADE converts every file to mm. Because reading takes seconds, the result is
    cached by file content and reader version. The cache may be deleted at any time.
    """
    step = read(path, "STEP")
    key = hashlib.sha256(step)
    key.update(f"{tolerance!r} {angle!r} {version('cascadio')}".encode())
    folder = cache_folder("step")
    cached = folder / f"{key.hexdigest()}.glb"
    with contextlib.suppress(OSError):
        data = cached.read_bytes()
        stated_size = int.from_bytes(data[8:12], "little")
        if data[:4] == b"glTF" and stated_size == len(data):
            with contextlib.suppress(OSError):  # a cache of another user is read, not written
                os.utime(cached)  # the files that were longest unused are removed first
            return data  # complete; a truncated file is written again
    with Scratch() as work:
        glb = Path(work) / "step.glb"
        copy = Path(work) / "read.step"
        try:
            kind = "STEP" if tolerance * MM >= VISUAL_TOLERANCE else "fine STEP"
            copy.write_bytes(step)  # the cached result must come from the hashed bytes
            code = run(path, kind, str(glb), repr(tolerance), repr(angle), given=copy)
        except SourceError as error:
            raise CadError(str(error)) from error
        if code != 0 or not glb.is_file():
            try:  # the exit code does not distinguish a full disk from a reading error
                (Path(work) / "room").write_bytes(bytes(path.stat().st_size))
            except OSError as error:
                raise CadError(
                    f"{path}: cannot write the triangles to {work}: {error.strerror}. "
                    "Choose another folder with TMPDIR."
                ) from None
            raise CadError(f"{path}: OpenCASCADE could not read it (code {code}); the file is damaged")
        data = glb.read_bytes()
    with contextlib.suppress(OSError, OutputError):  # a cache that cannot be written is not an error
        newest_last = sorted(folder.glob("*.glb"), key=lambda file: file.stat().st_mtime)
        for old in newest_last[:-_MAX_CACHED_FILES]:
            old.unlink()
        with atomic_folder(folder) as work:
            (work / cached.name).write_bytes(data)
    return data


def _split_glb(data: bytes) -> tuple[dict, bytes]:
    """Return (JSON, binary chunk) of a GLB that cascadio wrote; each chunk follows a header of 8 bytes."""
    (size,) = struct.unpack_from("<I", data, 12)
    end = 20 + size
    return json.loads(data[20:end]), data[end + 8 :]


def _parts(gltf: dict, binary: bytes) -> tuple[list[Part], float]:
    """Return the parts of the tree in the GLB, and the error in m of its placements, which are in single precision."""
    parts: list[Part] = []
    error = 0.0

    def name_of(index: int) -> str:
        return _repaired_name(gltf["nodes"][index].get("name", f"part{index}"))

    taken_names = set(map(name_of, range(len(gltf["nodes"]))))

    def walk(index: int, T: Array, path: tuple[str, ...], numbered: tuple[str, ...]) -> None:
        nonlocal error
        node = gltf["nodes"][index]
        if "matrix" in node:
            T_step = np.array(node["matrix"], float).reshape(4, 4).T
            T = T @ T_step
            if not np.array_equal(T_step, np.eye(4)):
                largest = float(np.abs(T[:3]).max())
                error = max(error, largest * _SINGLE_PRECISION)
        name = name_of(index)
        if "mesh" in node:
            part = _part(gltf, binary, gltf["meshes"][node["mesh"]], name, path, T)
            parts.append(replace(part, numbered=numbered))
        walk_all(node.get("children", ()), T, (*path, name), numbered)

    def walk_all(siblings: Sequence[int], T: Array, path: tuple[str, ...], numbered: tuple[str, ...]) -> None:
        unique = _numbered(list(map(name_of, siblings)), taken_names)
        for index, name in zip(siblings, unique, strict=True):
            walk(index, T, path, (*numbered, name))

    walk_all(gltf["scenes"][gltf.get("scene", 0)]["nodes"], np.eye(4), (), ())
    return parts, error


def _numbered(names: Sequence[str], taken_names: set[str]) -> list[str]:
    """Return the names of siblings; those that occur several times with a number.

    A numbered name is not in `taken_names`, the names of all nodes, and is added to it.
    """
    counts = Counter(names)
    last: Counter[str] = Counter()
    unique = []
    for name in names:
        numbered = name
        while counts[name] > 1 and numbered in taken_names:
            last[name] += 1
            numbered = f"{name}_{last[name]}"
        taken_names.add(numbered)
        unique.append(numbered)
    return unique


def _part(gltf: dict, binary: bytes, mesh: dict, name: str, path: tuple[str, ...], T: Array) -> Part:
    """Return the part of a mesh at the placement T (4, 4); each of its primitives is a group of faces of one colour."""
    points: list[np.ndarray] = []
    corners: list[np.ndarray] = []
    all_faces: list[Face | None] = []
    owners: list[np.ndarray] = []
    color = _GREY
    count = 0
    for primitive in mesh["primitives"]:
        positions = _accessor(gltf, binary, primitive["attributes"]["POSITION"])
        indices = _accessor(gltf, binary, primitive["indices"]).astype(np.int32)
        points.append(positions)
        corners.append(indices.reshape(-1, 3) + count)
        count += len(positions)
        if "material" in primitive:
            pbr = gltf["materials"][primitive["material"]].get("pbrMetallicRoughness", {})
            red, green, blue, alpha = map(float, pbr.get("baseColorFactor", color))
            color = (red, green, blue, alpha)
        faces, owner = _faces_of_primitive(gltf, binary, primitive, len(corners[-1]), T)
        owners.append(owner + len(all_faces))
        all_faces += faces
    vertices, triangles, has_area = _weld_faces(np.concatenate(points), np.concatenate(corners))
    if np.linalg.det(T[:3, :3]) < 0:
        triangles = triangles[:, ::-1]  # a mirror turns the faces inside out
    measured = tuple(face for face in all_faces if face is not None and face.kind in MEASURED)
    return Part(
        name=name,
        path=path,
        vertices=vertices @ T[:3, :3].T + T[:3, 3],
        triangles=triangles,
        color_rgba=color,
        faces=measured,
        drawn=tuple(all_faces),
        face_of_triangle=np.concatenate(owners)[has_area],
    )


def _faces_of_primitive(
    gltf: dict, binary: bytes, primitive: dict, triangles: int, T: Array
) -> tuple[list[Face | None], np.ndarray]:
    """Return the faces of a primitive, and for each of its triangles (their number is `triangles`) the face's index."""
    extension = primitive.get("extensions", {}).get("TM_brep_faces", {})
    faces = [_face(record, T) for record in extension.get("faces", ())]
    if "faceIndices" in extension:
        return faces, _accessor(gltf, binary, extension["faceIndices"]).astype(np.int32)
    # triangles of which the reader does not name the faces belong to one face of no kind
    return [*faces, None], np.full(triangles, len(faces), np.int32)


def _weld_faces(points: np.ndarray, triangles: np.ndarray) -> tuple[Array, np.ndarray, np.ndarray]:
    """Merge the vertices that faces share and remove triangles without area: a closed solid becomes a closed mesh.

    On an edge between two faces, the mesher creates bit-identical points for both faces.

    Returns:
        The vertices, the remaining triangles, and for each given triangle whether it remains.
    """
    order = np.lexsort(points.T[::-1])  # as `np.unique` does along an axis, in a third of the time
    ordered = points[order]
    is_new = np.ones(len(points), bool)
    is_new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    vertex_of_point = np.zeros(len(points), np.int32)
    vertex_of_point[order] = np.cumsum(is_new) - 1
    triangles = vertex_of_point[triangles]
    first_corner, second_corner, third_corner = triangles.T
    has_area = (first_corner != second_corner) & (second_corner != third_corner) & (third_corner != first_corner)
    return ordered[is_new].astype(float), triangles[has_area], has_area


def _face(record: dict | None, T: Array) -> Face | None:
    """Return the face of a record in drawn coordinates; None: a face without axis or centre, such as a B-spline."""
    if record is None:
        return None
    radius = 0.0
    half_angle = 0.0
    kind = record["type"]
    if kind == "plane":
        direction = np.array(record["normal"])
        # The y direction is normal x x direction, in plain numbers: np.cross takes much longer for one vector.
        a, b, c = record["normal"]
        i, j, k = record["x_dir"]
        x = np.array(record["x_dir"])
        y = np.array([b * k - c * j, c * i - a * k, a * j - b * i])
        # The origin is a corner of the face's parameter range; the middle of the range is on the face.
        corner = np.array(record["origin"])
        point = corner + x * _middle(record["extent_x"]) + y * _middle(record["extent_y"])
    elif kind == "cylinder":
        direction = np.array(record["axis"])
        point = np.array(record["origin"]) + direction * _middle(record["extent_height"])
        radius = record["radius"]
    elif kind == "sphere":
        point = np.array(record["center"])
        direction = np.zeros(3)
        radius = record["radius"]
    elif kind == "cone":
        direction = np.array(record["axis"])
        point = np.array(record["apex"])
        half_angle = record["semi_angle"]
    elif kind == "torus":
        direction = np.array(record["axis"])
        point = np.array(record["center"])
        radius = record["major_radius"]
    else:
        return None
    R = T[:3, :3]
    return Face(kind, R @ point + T[:3, 3], R @ direction, float(radius), float(half_angle))


def _middle(extent: Sequence[float]) -> float:
    low, high = extent
    return (low + high) / 2


_COMPONENT_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
"""{component type of a glTF accessor: type of its numbers}."""

_COMPONENT_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
"""{type of a glTF accessor: count of numbers of one value}."""


def _accessor(gltf: dict, binary: bytes, index: int) -> np.ndarray:
    """Return the values (count,) or (count, width) of an accessor; the rows may be interleaved with others."""
    accessor = gltf["accessors"][index]
    view = gltf["bufferViews"][accessor["bufferView"]]
    width = _COMPONENT_COUNTS[accessor["type"]]
    dtype = np.dtype(_COMPONENT_TYPES[accessor["componentType"]])
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", width * dtype.itemsize)
    rows = np.ndarray((accessor["count"], width), dtype, binary, start, (stride, dtype.itemsize))
    if width == 1:
        return rows[:, 0].copy()
    return rows.copy()


def _repaired_name(name: str) -> str:
    """Undo the reader's double encoding of UTF-8 names; other names are unchanged."""
    try:
        return name.encode("latin-1").decode("utf-8")
    except (UnicodeEncodeError, UnicodeDecodeError):
        return name
