"""Write a mechanism as a robot folder: description, meshes, formula, initial protocol, notes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from twin.core import assets
from twin.core.errors import OutputError
from twin.core.findings import Finding, by_severity
from twin.core.toml_text import one_line
from twin.core.version import __version__
from twin.exchange.read.description_text import NOTES, describe
from twin.exchange.read.imported_robot import Imported
from twin.exchange.read.mesh_output import mesh_file, write_mesh
from twin.exchange.read.templates import formula, protocol
from twin.model.mechanism import Mechanism


def require_free(target: Path, force: bool = False) -> None:
    """Check that `write_robot` may write to `target`: a new or empty folder or, with `force`, a robot folder.

    Raises:
        OutputError: `target` is a file, or a folder that must not be overwritten.
    """
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target} is a file; choose another folder with --out")
    if target.is_dir() and any(target.iterdir()):
        if not force:
            raise OutputError(f"{target}: the folder is not empty; choose another folder with --out, or use --force")
        if not any((target / "cad").glob("*.toml")):
            raise OutputError(f"{target}: the folder is not a robot folder, so --force does not overwrite it")


def write_folder(imported: Imported, name: str, target: Path, source: Path, force: bool = False) -> list[Path]:
    """Write the robot folder of a mechanism whose loops are closed (see `loop_closing.close`).

    The target must be a new or empty folder. With `force`, the target may be a robot folder: its files are overwritten,
    except protocols and a formula that contains equations. The description contains the name of `source`, the imported
    file.

    Returns:
        The files written, the description first.

    Raises:
        OutputError: the folder is not empty, or cannot be written.
    """
    mechanism = replace(imported.mechanism, name=name)

    def write_cad(folder: Path) -> Mechanism:
        (folder / "meshes").mkdir()
        for body in mechanism.bodies:
            for mesh in body.meshes:
                write_mesh(folder / "meshes" / mesh_file(mesh), mesh, mechanism.rest[body.name])
        (folder / f"{name}.toml").write_text(
            describe(mechanism, source.name, imported.assumed, imported.unlimited), "utf-8"
        )
        return mechanism

    return write_robot(name, target, write_cad, imported.findings, source, force, imported.formula)


def write_robot(
    name: str,
    target: Path,
    write_cad: Callable[[Path], Mechanism],
    findings: list[Finding],
    source: Path,
    force: bool = False,
    equations: str = "",
) -> list[Path]:
    """Write a robot folder with the files of `write_cad`, which fills the folder cad/ and returns the mechanism.

    `equations` is the text of the formula.py, "" for the template. The other arguments, the return value and the errors
    are the same as for `write_folder`.
    """
    require_free(target, force)
    with assets.atomic_folder(target) as work:
        (work / "cad").mkdir()
        (work / "trajectories").mkdir()
        mechanism = write_cad(work / "cad")
        robot_files = assets.RobotFiles(name, work, work, work, target / "formula.py")
        if not robot_files.has_equations:
            (work / "formula.py").write_text(equations or formula(mechanism), "utf-8")
        if not (target / "trajectories/first.toml").exists():
            (work / "trajectories/first.toml").write_text(protocol(mechanism), "utf-8")
        (work / NOTES).write_text(notes(name, findings, source), "utf-8")
        written = []
        for path in work.rglob("*"):
            if path.is_file():
                written.append(path.relative_to(work))
    description = Path("cad") / f"{name}.toml"
    paths = [target / description]
    for path in sorted(written):
        if path != description:
            paths.append(target / path)
    return paths


def notes(name: str, findings: list[Finding], source: Path) -> str:
    """Return the text of IMPORT.md: the findings of the import, the most severe first."""
    digest = "-"
    if source.is_file():
        digest = hashlib.sha256(source.read_bytes()).hexdigest()
    lines = [
        f"# How {one_line(name)} was imported",
        "",
        f"It was imported by twin {__version__} from `{one_line(source.name)}`, sha256 {digest}.",
        "",
    ]
    titles = {"warning": "Changes from the file", "info": "Changed without loss"}
    for severity, title in titles.items():
        items = []
        for finding in by_severity(findings):
            if finding.severity == severity:
                items.append(f"- {one_line(finding.message)} ({finding.code})")
        lines += [f"## {title}", "", *(items or ["- nothing"]), ""]
    return "\n".join(lines)
