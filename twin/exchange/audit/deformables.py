"""Audit the deformables of an exported scene: compare the motion in organs.glb with the points in usd/organs.usdc."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom

from twin.core.errors import TwinError
from twin.core.foreign.admit import admit
from twin.core.foreign.budget import read_bytes
from twin.core.json_types import JsonObject
from twin.core.sampling import spread
from twin.exchange.audit import poses
from twin.exchange.audit.ledger import Ledger, Measured, ReadError
from twin.exchange.audit.poses import Array
from twin.exchange.audit.value_text import quantity
from twin.exchange.formats.glb.audit.clips import Clips
from twin.exchange.formats.glb.audit.container import Gltf, open_gltf
from twin.exchange.formats.glb.audit.nodes import parents_first, read_nodes
from twin.exchange.formats.usd.audit.header import trouble

GLB = "organs.glb"
"""Path of the file of the deformables for displays, relative to the folder of the scene."""

USD = "usd/organs.usdc"
"""Path of the layer of the deformables, relative to the folder of the scene."""

TOLERANCE = 10e-6
"""Maximum difference in m between the coordinates of the same vertex in the two files."""

_MAX_TIMES = 16
"""Maximum number of time samples of each mesh, evenly distributed, at which the files are compared."""


def audit_deformables(folder: Path, expects_usd: bool = True) -> list[Ledger]:
    """Check the deformables of an exported scene; return [ledger], or [] if organs.glb does not exist.

    The ledger contains the checks and the findings. If organs.usdc does not exist, this is a finding, unless
    `expects_usd` is False because the scene was not exported to USD: then only the surfaces in organs.glb are checked.
    """
    glb = folder / GLB
    usd = folder / USD
    # "bends" is a former word for deformables; checks and codes of findings keep it, for programs that read them.
    ledger = Ledger(GLB, "twin.exchange.audit bends", "1")
    if not glb.is_file():
        return []
    try:
        admit(glb)
        file = open_gltf(glb, ledger)
        glb_meshes = _AnimatedMeshes(file)
        if usd.is_file():
            fault = trouble(read_bytes(usd, "USD"))
            if fault:
                raise ValueError(f"{USD}: {fault}")
            admit(usd)
            _compare(glb_meshes, Usd.Stage.Open(str(usd)), ledger)
        elif expects_usd:
            ledger.row("vertices against the points in USD", None, "m", TOLERANCE, fits=False)
            ledger.wrong("bend.missing", f"{USD} is missing: the motion of the deformables is compared with nothing.")
        if not glb_meshes.names:
            ledger.wrong("bend.missing", f"{GLB} has no deformables.")
        for name in glb_meshes.names:
            glb_meshes.vertices(name, 0.0)  # only to read all of it: a fault of the file is an exception
            open_edges = _count_open_edges(glb_meshes.triangles(name))
            ledger.row(f"edges of '{name}' that do not join two triangles", float(open_edges), "found", 0.0)
            if open_edges:
                text = f"mesh '{name}' is not closed: {open_edges} edges do not join exactly two triangles."
                ledger.wrong("bend.open", text, name, size=Measured(open_edges, 0.0))
    except (ReadError, TwinError, Tf.ErrorException, OSError, KeyError, TypeError, ValueError, IndexError) as error:
        text = f"the deformables cannot be read: {type(error).__name__}, {str(error)[:200]}."
        ledger.add("bend.unreadable", "error", text)
    return [ledger]


class _AnimatedMeshes:
    """The meshes with morph targets in a glTF file, and the first animation of the morph weights."""

    def __init__(self, file: Gltf) -> None:
        self._file = file
        nodes = read_nodes(file)
        clips = Clips(file, nodes, parents_first(nodes))
        world = clips.world({})
        to_z_up = poses.pose(poses.R_Z_UP_Y_UP)
        self._node: dict[str, int] = {}
        self._T: dict[str, Array] = {}
        for node in nodes:
            if "mesh" in node.spec:
                if node.name in self._node:
                    raise ReadError(f"two meshes are named '{node.name}'", "gltf.names")
                self._node[node.name] = node.index
                self._T[node.name] = to_z_up @ world[node.index][0]
        self.names = tuple(self._node)
        self._keys: dict[int, tuple[Array, Array]] = {}
        for animation in file.items("animations"):
            for channel in animation.get("channels", []):
                if channel["target"].get("path") == "weights":
                    sampler = animation["samplers"][channel["sampler"]]
                    times = file.accessor(sampler["input"])[:, 0]
                    values = file.accessor(sampler["output"]).reshape(len(times), -1)
                    # setdefault: of several animations, players start with the first
                    self._keys.setdefault(channel["target"]["node"], (times, values))

    def _primitive(self, name: str) -> JsonObject:
        """Return the only primitive of a mesh; ValueError if it has another number of them."""
        node = self._file.item("nodes", self._node[name])
        mesh = self._file.item("meshes", node["mesh"])
        (primitive,) = mesh["primitives"]
        return primitive

    def triangles(self, name: str) -> np.ndarray:
        """Return the triangles (m, 3) of the mesh `name`, as indices of its vertices."""
        indices = self._file.accessor(self._primitive(name)["indices"])
        return indices.astype(int).reshape(-1, 3)

    def vertices(self, name: str, t: float) -> Array:
        """Return the vertices (n, 3) in m, z up, of the mesh `name` at time t in s."""
        primitive = self._primitive(name)
        points = self._file.accessor(primitive["attributes"]["POSITION"]).copy()
        targets = primitive.get("targets", [])
        if targets and self._node[name] in self._keys:
            times, values = self._keys[self._node[name]]
            for number, target in enumerate(targets):
                weight = np.interp(t, times, values[:, number])
                points += weight * self._file.accessor(target["POSITION"])
        T = self._T[name]
        return points @ T[:3, :3].T + T[:3, 3]


def _compare(glb_meshes: _AnimatedMeshes, stage: Usd.Stage, ledger: Ledger) -> None:
    stage.Reload()  # USD keeps layers in memory, but the file may have changed
    rate = stage.GetTimeCodesPerSecond()
    usd_meshes = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            if prim.GetName() in usd_meshes:
                raise ValueError(f"{USD}: two meshes are named '{prim.GetName()}'")
            usd_meshes[prim.GetName()] = UsdGeom.Mesh(prim)
    for name in sorted({*glb_meshes.names} ^ {*usd_meshes}):
        text = f"deformable '{name}' is in only one of the files {GLB} and {USD}."
        ledger.wrong("bend.missing", text, name)
    for name in glb_meshes.names:
        if name not in usd_meshes:
            continue
        _compare_mesh(glb_meshes, name, usd_meshes[name], rate, ledger)


def _compare_mesh(glb_meshes: _AnimatedMeshes, name: str, mesh: UsdGeom.Mesh, rate: float, ledger: Ledger) -> None:
    """Compare a mesh in both files; `rate` is the number of time codes of USD per second.

    Points without time samples and points that are not finite are findings of their own: there is nothing to compare.
    """
    worst = np.inf
    when = ""
    code = "bend.vertices"
    faces = np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    invalid_time = _first_not_finite(mesh, rate)
    if not mesh.GetPointsAttr().GetTimeSamples():
        code = "bend.samples"
        text = f"mesh '{name}' has no time samples of its points in {USD}: its motion is compared with nothing."
    elif invalid_time is not None:
        code = "bend.not_finite"
        when = f"t = {invalid_time:.3f} s"
        text = f"mesh '{name}' has points that are not finite in {USD}."
    elif not np.array_equal(faces, glb_meshes.triangles(name)):
        when = "triangles"
        text = f"mesh '{name}' has different vertex counts or triangles in {GLB} and {USD}."
    else:
        worst, when = _largest_difference(glb_meshes, name, mesh, rate)
        text = f"the vertices of '{name}' differ by {quantity(worst, 'm')} between {GLB} and {USD}."
        if np.isnan(worst):
            code = "bend.not_finite"
            text = f"mesh '{name}' has vertices that are not finite in {GLB}."
        elif np.isinf(worst):
            text = f"mesh '{name}' has different vertex counts or triangles in {GLB} and {USD}."
    ledger.row(f"vertices of '{name}' against {USD}", worst, "m", TOLERANCE, where=name, when=when)
    if not worst <= TOLERANCE:
        ledger.wrong(code, text, name, size=Measured(worst, TOLERANCE, "m"), when=when)


def _first_not_finite(mesh: UsdGeom.Mesh, rate: float) -> float | None:
    """Return the first time in s at which a point of a mesh is not finite, of all time samples; None if all are."""
    points = mesh.GetPointsAttr()
    for code in points.GetTimeSamples():
        if not np.isfinite(np.array(points.Get(code), float)).all():
            return code / rate
    return None


def _largest_difference(glb_meshes: _AnimatedMeshes, name: str, mesh: UsdGeom.Mesh, rate: float) -> tuple[float, str]:
    """Return (largest difference of a coordinate in m, time) of a mesh with time samples in both files.

    The difference is infinite for other vertex counts, and NaN, with its first time, if a vertex in organs.glb is not
    finite.
    """
    points = mesh.GetPointsAttr()
    codes = points.GetTimeSamples()
    worst = 0.0
    when = ""
    for sample in spread(len(codes), _MAX_TIMES):
        t = codes[sample] / rate
        expected = np.array(points.Get(codes[sample]), float)
        vertices = glb_meshes.vertices(name, t)
        if not np.isfinite(vertices).all():
            return np.nan, f"t = {t:.3f} s"
        difference = np.inf
        if vertices.shape == expected.shape:
            difference = float(np.abs(vertices - expected).max())
        if difference > worst:
            worst = difference
            when = f"t = {t:.3f} s"
    return worst, when


def _count_open_edges(triangles: np.ndarray) -> int:
    """Return the number of edges that do not belong to exactly two triangles."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.count_nonzero(counts != 2))
