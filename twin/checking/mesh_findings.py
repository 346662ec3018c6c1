"""Findings on the meshes that the elements of a description name."""

from __future__ import annotations

from collections.abc import Iterator

from twin.checking.check_finding import CheckFinding
from twin.checking.elements import Elements
from twin.checking.judge_job import JudgeJob
from twin.checking.mesh_search import find_mesh


def missing_meshes(job: JudgeJob, elements: Elements) -> Iterator[CheckFinding]:
    """Yield the meshes that do not exist; those of packages that are not in the folder as one note."""
    path = job.description.path
    outside: dict[str, int] = {}
    for link in elements.root.iter("link"):
        name = link.get("name", "")
        for mesh in link.iter("mesh"):
            address = mesh.get("filename")
            if elements.sdf:
                address = (mesh.findtext("uri") or "").strip()
            if not address:
                continue
            found_mesh = find_mesh(address, path.parent, job.tree)
            if found_mesh.path is not None:
                continue
            if found_mesh.outside:
                _, _, path_in_tree = address.partition("://")
                package, _, _ = path_in_tree.lstrip("/").partition("/")
                outside[package] = outside.get(package, 0) + 1
                continue
            text = f"mesh '{address}' does not exist"
            if found_mesh.similar:
                text += f"; there is '{found_mesh.similar}'"
            yield elements.finding("mesh/missing", mesh, f"link/{name}", f"link '{name}'", text)
    for package, count in outside.items():
        text = f"{count} meshes are in package '{package}', which is not in the folder"
        yield CheckFinding("mesh/outside", job.description.name, f"package '{package}'", text)
