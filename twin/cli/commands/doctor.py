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
        "cuda-bindings": "computing on an NVIDIA graphics processor, --device (extra: gpu)",
        "distributed": "sweeps, on several processors or machines (extra: cluster)",
        "cbor2": "subscriptions with CBOR of twin serve --ros (extra: ros)",
        "mcap": "sessions for Foxglove (extra: mcap)",
        "mcap-ros2-support": "sessions for ROS 2 (extra: mcap)",
        "pyarrow": "--parquet (extra: parquet)",
        "segno": "a QR code of the address of twin serve --host (extra: qr)",
        "xacro": "robots as xacro (extra: xacro)",
        "pyyaml": "loops of a URDF from a closure YAML (extra: yaml)",
        "aiomqtt": "--mqtt of twin serve (extra: mqtt)",
        "build123d": "redraw the CAD (make cad-check)",
    }
    programs = {"chromium": "pictures of the viewer", "uv": "the locked environment"}
    rows: list[tuple[str, str, str]] = []
    missing: list[str] = []
    for name in packages:
        installed = _installed(name)
        if installed is None:
            missing.append(name)
        rows.append((name, installed or "MISSING", "needed"))
    for name, purpose in extras.items():
        rows.append((name, _installed(name) or "-", f"optional: {purpose}"))
    for name, purpose in programs.items():
        rows.append((name, shutil.which(name) or "-", f"optional: {purpose}"))
    rows.append(("graphics processor", *_graphics_processor()))
    if args.json:
        found = {name: version for name, version, _ in rows}
        content = {"python": platform.python_version(), "found": found, "missing": missing}
        findings = []
        for name in missing:
            findings.append(error("doctor.missing", name, f"{name} is not installed", suggestion=_CURE))
        print(show.as_json(show.record("doctor", content, findings)))
    else:
        print(f"  python {platform.python_version()} on {platform.system()} {platform.machine()}")
        print(f"  data in {assets.data_folder()}\n")
        print(show.table(rows, ("package", "found", "")))
        if missing:
            names = ", ".join(missing)
            print(f"\n  missing: {names}. {_CURE}")
    if missing:
        return 2
    return 0


def _graphics_processor() -> tuple[str, str]:
    """Return (name of the GPU that can compute, or -; what it is for, or why there is none)."""
    from twin.core import gpu

    card, reason = gpu.found()
    if card is None:
        return "-", f"optional: computing with --device gpu ({reason})"
    return card.name, "optional: computing with --device gpu"


def _needed() -> list[str]:
    """Return the required packages of twin, without the packages of optional extras."""
    from importlib.metadata import requires

    packages: list[str] = []
    for line in requires("twin-robotics") or ():
        if "extra ==" in line:
            continue
        name, *_ = re.split(r"[^\w.-]", line, maxsplit=1)  # before the version
        packages.append(name)
    return packages


def _installed(name: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return None
