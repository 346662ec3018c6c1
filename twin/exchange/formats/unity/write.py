"""Copy the Unity package `com.twin.player` into an export, with the kinematics of the robot in C#."""

from __future__ import annotations

import hashlib
from pathlib import Path

from twin.core.errors import OutputError, TwinError
from twin.core.findings import Finding, warning
from twin.exchange.formats.unity.kinematics import DeviceModel, class_name, source
from twin.exchange.write.order import Order

ROBOTS = "Runtime/Robots"
"""Folder of the kinematics in the package."""

# Unity knows files by the GUIDs in their .meta files; an installed package without them is ignored.
_META = "fileFormatVersion: 2\nguid: {guid}\n{importer}  userData: \n  assetBundleName: \n  assetBundleVariant: \n"
_FOLDER_IMPORTER = "folderAsset: yes\nDefaultImporter:\n  externalObjects: {}\n"
_SCRIPT_IMPORTER = (
    "MonoImporter:\n  externalObjects: {}\n  serializedVersion: 2\n  defaultReferences: []\n"
    "  executionOrder: 0\n  icon: {instanceID: 0}\n"
)

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
        is_hidden = any(part.startswith(".") for part in path.parts)  # files of editors and of the system
        if file.is_file() and not is_hidden:
            names.append(path.as_posix())
    if "package.json" not in names:
        raise OutputError(f"the Unity package is not in {PACKAGE}: install twin again, or export without 'unity'")
    return tuple(sorted(names))


def write_unity(folder: Path) -> tuple[Path, ...]:
    """Copy the package into `folder` and return the paths of its files, sorted.

    These files are the same for every robot. The menu "Twin > Import bundle…" of Unity imports the robot's model and
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
    """Write the package and the kinematics of the robot in C# into `folder`/unity."""
    package = folder / "unity"
    write_unity(package)
    model = DeviceModel(order.mechanism, order.equations, order.gaps)
    try:
        text = source(model)
    except (TwinError, ValueError) as error:
        message = f"the Unity package has no kinematics of {order.mechanism.name} for the device: {error}"
        return [warning("unity.no_kinematics", order.mechanism.name, message)]
    name = f"{class_name(order.mechanism.name)}.cs"
    try:
        (package / ROBOTS).mkdir(parents=True, exist_ok=True)
        # The same bytes on every system: git and Unity would report other line ends as a change.
        (package / ROBOTS / name).write_text(text, encoding="utf-8", newline="\n")
        for path, importer in ((ROBOTS, _FOLDER_IMPORTER), (f"{ROBOTS}/{name}", _SCRIPT_IMPORTER)):
            meta = _META.format(guid=guid(path), importer=importer)
            (package / f"{path}.meta").write_text(meta, encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(
            f"cannot write to {package}: {error.strerror or error}. Choose another folder with --out."
        ) from error
    return []


def guid(path: str) -> str:
    """Return the GUID by which Unity knows a file of the package: a hash of the path in the package."""
    # Always the same: another GUID at each export would break the references of a project to the class.
    return hashlib.md5(f"com.twin.player/{path}".encode(), usedforsecurity=False).hexdigest()


def files(order: Order) -> list[tuple[str, str]]:
    """Return (file, content) for README.txt."""
    return [
        ("unity/", "Unity package: player, stream client, interaction, tests"),
        (f"unity/{ROBOTS}/", "kinematics of the robot in C#, to move it on the device without a server"),
    ]
