"""Write the .meta files of the Unity package.

Unity knows a file by the GUID in the .meta beside it; without one, a package that is installed from git ignores
the file. The GUID is a hash of the file's path in the package: it stays when the file changes, and no two are alike.

    python tests/unity/make_metas.py           write what is missing or stale, remove what is left over
    python tests/unity/make_metas.py --check   say so and exit 1
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "twin/ui/headset/unity"
NAME = "com.twin.player"

_IMPORTERS = {
    ".cs": "MonoImporter",
    ".asmdef": "AssemblyDefinitionImporter",
    ".json": "TextScriptImporter",
    ".md": "TextScriptImporter",
}


def is_hidden(path: Path) -> bool:
    """Return whether Unity ignores a path (relative to the package): below a `~` folder, or beginning with a dot."""
    return any(part.endswith("~") or part.startswith(".") for part in path.parts)


def wanted(package: Path = PACKAGE) -> dict[Path, str]:
    """Return the text of every .meta file by its path relative to the package."""
    paths = [p for p in sorted(package.rglob("*")) if p.suffix != ".meta" and not is_hidden(p.relative_to(package))]
    return {p.relative_to(package).with_name(p.name + ".meta"): _meta(p, p.relative_to(package)) for p in paths}


def there(package: Path = PACKAGE) -> dict[Path, str]:
    """Return the text of the .meta files that exist."""
    return {p.relative_to(package): p.read_text(encoding="utf-8") for p in sorted(package.rglob("*.meta"))}


def guid(path: Path) -> str:
    """Return the GUID of a file or folder of the package: 32 hexadecimal digits."""
    return hashlib.md5(f"{NAME}/{path.as_posix()}".encode(), usedforsecurity=False).hexdigest()


def _meta(file: Path, path: Path) -> str:
    if file.is_dir():
        kind = "folderAsset: yes\nDefaultImporter:\n"
    elif path == Path("package.json"):
        kind = "PackageManifestImporter:\n"
    else:
        kind = f"{_IMPORTERS[file.suffix]}:\n"
    more = "  serializedVersion: 2\n  defaultReferences: []\n  executionOrder: 0\n  icon: {instanceID: 0}\n"
    return (
        f"fileFormatVersion: 2\nguid: {guid(path)}\n{kind}  externalObjects: {{}}\n"
        f"{more if file.suffix == '.cs' else ''}  userData: \n  assetBundleName: \n  assetBundleVariant: \n"
    )


def main() -> int:
    """Write or check the files; 1 when `--check` finds a difference."""
    now, then = wanted(), there()
    stale = sorted(p for p in now.keys() | then.keys() if now.get(p) != then.get(p))
    for path in stale:
        print(f"{'stale' if path in now and path in then else 'missing' if path in now else 'left over'}: {path}")
        if "--check" in sys.argv[1:]:
            continue
        if path in now:
            (PACKAGE / path).write_text(now[path], encoding="utf-8")
        else:
            (PACKAGE / path).unlink()
    return int(bool(stale) and "--check" in sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
