"""Score `twin compare` on the published errors of this folder (docs/kinerrata.md), or write their files.

python tests/kinerrata/score.py                  the table, in Markdown
python tests/kinerrata/score.py --write FOLDER   before, after and second of each entry, and index.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from made import errata


def write(folder: Path) -> None:
    """Write the files of all entries, each in a folder with its name, and index.json, which lists them.

    `before` has the wrong numbers (of a false alarm: it is the other of two right robots), `after` the right ones,
    `second` is `after` in another format. A file that cannot be written is null.
    """
    index = []
    left_out = []
    for entry in errata.entries():
        if entry.left_out:
            left_out.append({"entry": entry.name, "kind": entry.kind, "reason": entry.left_out})
            continue
        written = errata.write(entry, folder / entry.name)
        files = {}
        for name, path in (("before", written.before), ("after", written.after), ("second", written.second)):
            files[name] = None if path is None else str(path.relative_to(folder))
        index.append(
            {
                "entry": entry.name,
                "kind": entry.kind,
                "accused": entry.accused,
                "by": entry.data["by"],
                "places": entry.data.get("number", []),
                "files": files,
            }
        )
    text = json.dumps({"entries": index, "left_out": left_out}, indent=1, ensure_ascii=False)
    (folder / "index.json").write_text(text + "\n", encoding="utf-8")


def main() -> int:
    """Run the command; the exit code is 1 if a required figure is not reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", metavar="FOLDER", type=Path, help="write the files of all entries into a new folder")
    args = parser.parse_args()
    if args.write is not None:
        write(args.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
