"""`twin doctor`: list the required and optional packages and programs, with installed versions and purposes."""

from __future__ import annotations

import argparse
import platform
import re
import shutil

from twin.cli.parser import Command

EXAMPLES = """\
  twin doctor"""

_CURE = "Reinstall twin: pip install ."


def arguments(command: Command) -> None:
    """Add no arguments: `twin doctor` has none of its own."""


def run(args: argparse.Namespace) -> int:
    """Print the required and optional packages and programs; return 2 if a required package is missing, else 0."""
    from twin.cli import show
    from twin.core import assets
    from twin.core.findings import error

    packages = _needed()
    extras = {
        "distributed": "sweeps, on several processors or machines (extra: cluster)",
        "mcap": "sessions for Foxglove (extra: mcap)",
        "pyarrow": "--parquet (extra: parquet)",
        "segno": "a QR code of the address of twin serve --host (extra: qr)",
        "pyyaml": "loops of a URDF from a closure YAML (extra: yaml)",
        "aiomqtt": "--mqtt of twin serve (extra: mqtt)",
        "build123d": "redraw the CAD (make cad-check)",
    }
    programs = {"chromium": "pictures of the viewer", "uv": "the locked environment"}
    rows = [(n, _installed(n) or "MISSING", "needed") for n in packages]
    rows += [(n, _installed(n) or "-", f"optional: {why}") for n, why in extras.items()]
    rows += [(n, shutil.which(n) or "-", f"optional: {why}") for n, why in programs.items()]
    missing = [n for n in packages if _installed(n) is None]
    if args.json:
        content = {"python": platform.python_version(), "found": {n: v for n, v, _ in rows}, "missing": missing}
        lacking = [error("doctor.missing", n, f"{n} is not installed", suggestion=_CURE) for n in missing]
        print(show.as_json(show.record("doctor", content, lacking)))
    else:
        print(f"  python {platform.python_version()} on {platform.system()} {platform.machine()}")
        print(f"  data in {assets.data_folder()}\n")
        print(show.table(rows, ("package", "found", "")))
        if missing:
            print(f"\n  missing: {', '.join(missing)}. {_CURE}")
    return 2 if missing else 0


def _needed() -> list[str]:
    """Return the required packages of twin, without the packages of optional extras."""
    from importlib.metadata import requires

    asked = [line for line in requires("twin-robotics") or () if "extra ==" not in line]
    return [re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in asked]


def _installed(name: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return None
