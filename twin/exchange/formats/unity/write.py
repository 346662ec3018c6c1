"""Copy the Unity package `com.twin.player` into an export."""

from __future__ import annotations

from pathlib import Path

from twin.core.errors import OutputError
from twin.core.findings import Finding
from twin.exchange.write.order import Order

PACKAGE = Path(__file__).resolve().parents[3] / "ui/headset/unity"
"""Folder of the package, both in a source checkout and in an installed wheel."""


def package_files() -> tuple[str, ...]:
    """Return the relative paths of the package's files, sorted, with forward slashes.

    Raises:
        OutputError: the package does not exist.
    """
    names = []
    for file in PACKAGE.rglob("*"):
        path = file.relative_to(PACKAGE)
        if file.is_file() and not any(part.startswith(".") for part in path.parts):
            names.append(path.as_posix())
    if "package.json" not in names:
        raise OutputError(f"the Unity package is not in {PACKAGE}: install twin again, or export without 'unity'")
    return tuple(sorted(names))


def write_unity(folder: Path) -> tuple[Path, ...]:
    """Copy the package into `folder` and return the paths of its files, sorted.

    The package is the same for every robot. The menu "Twin > Import bundle…" of Unity imports the robot's model and
    tracks from the export folder. Times and permissions of the files are not copied. The folder, `<bundle>/unity`, is
    created if it does not exist.

    Raises:
        OutputError: the package does not exist, or the folder cannot be written.
    """
    written = []
    for name in package_files():
        target = Path(folder) / name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes((PACKAGE / name).read_bytes())
        except OSError as error:
            raise OutputError(
                f"cannot write to {target}: {error.strerror or error}. Choose another folder with --out."
            ) from error
        written.append(target)
    return tuple(written)


def write(order: Order, folder: Path) -> list[Finding]:
    """Write the package, which is the same for every robot, into `folder`/unity."""
    write_unity(folder / "unity")
    return []


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [("unity/", "Unity package: player, stream client, interaction, tests")]
