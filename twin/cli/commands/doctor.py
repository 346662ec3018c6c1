"""`twin doctor`: check packages, programs, ports and graphics, and say in one line whether twin can work."""

from __future__ import annotations

import argparse
import platform
import re
import shutil
import socket
import subprocess

from twin.cli.parser import Command

EXAMPLES = """\
  twin doctor
  twin doctor --webgl    also start Chromium, and ask it what draws its pages"""

_CURE = "Reinstall twin: pip install ."


PORTS = {"twin view": 8080, "twin serve": 8765}
"""Default ports of the pages."""

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "firefox", "safari")

_WEBGL_SECONDS = 60.0
"""Time in s after which a browser that does not answer is stopped."""

_WEBGL_PAGE = """data:text/html,<body><script>
const gl = document.createElement('canvas').getContext('webgl2');
const info = gl && gl.getExtension('WEBGL_debug_renderer_info');
const name = gl && gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
document.body.textContent = 'WEB' + 'GL[' + (name || '') + ']';
</script></body>"""
"""Page whose text is WEBGL[name of what draws], with nothing in the brackets if there is no WebGL 2.

The script joins the word from two parts: if it does not run, its own text in the page is no answer.
"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin doctor`."""
    command.flag("--webgl", "start Chromium without a window, and name what draws its pages (some seconds)")


def run(args: argparse.Namespace) -> int:
    """Print what is installed and a verdict; return 2 if a required package is missing, else 0."""
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
    }
    programs = {"chromium": "pictures of the viewer", "uv": "the locked environment"}
    rows: list[tuple[str, str, str]] = []
    missing: list[str] = []
    for name in packages:
        installed = _installed(name)
        if installed is None:
            missing.append(name)
        rows.append((name, installed or "MISSING", "needed"))
    absent: list[str] = []
    for name, purpose in extras.items():
        installed = _installed(name)
        if installed is None:
            absent.append(name)
        rows.append((name, installed or "-", f"optional: {purpose}"))
    # no extra of twin installs it, so the verdict does not count it
    rows.append(("build123d", _installed("build123d") or "-", "optional: redraw the CAD (make cad-check)"))
    for name, purpose in programs.items():
        rows.append((name, shutil.which(name) or "-", f"optional: {purpose}"))
    rows.append(("graphics processor", *_graphics_processor()))
    webgl = _webgl(args.webgl)
    rows.append(("WebGL 2", *webgl))
    taken: list[int] = []
    for command, port in PORTS.items():
        state, purpose = _port(command, port)
        if state == "taken":
            taken.append(port)
        rows.append((f"port {port}", state, purpose))
    if args.json:
        versions = {}
        for name, version, _ in rows:
            versions[name] = version
        content = {"python": platform.python_version(), "found": versions, "missing": missing}
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
        print(f"\n{show.plain(_verdict(missing, absent, taken, webgl[0]))}")
    if missing:
        return 2
    return 0


def _verdict(missing: list[str], absent: list[str], taken: list[int], webgl: str) -> str:
    """Return one line: whether twin can work, and what is limited.

    `missing` and `absent` are required and optional packages, `taken` default ports; `webgl` is a state of `_webgl`.
    """
    if missing:
        from twin.core.format import count

        verb = "is" if len(missing) == 1 else "are"
        return f"  NOT READY: {count(len(missing), 'required package')} {verb} missing"
    limits = []
    if absent:
        limits.append(f"{len(absent)} optional packages are absent (pip install 'twin-robotics[all]')")
    if webgl in ("-", "software"):
        limits.append("pages are drawn slowly or not at all: see WebGL 2")
    for port in taken:
        limits.append(f"port {port} is taken (choose another with --port)")
    if not limits:
        return "  READY: everything is there"
    return f"  READY: all required packages are there; {'; '.join(limits)}"


def _port(command: str, port: int) -> tuple[str, str]:
    """Return (free or taken; what the port is for)."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        # as servers do: a port that was closed a moment ago is free
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return "taken", f"default port of {command}; another is chosen with --port"
    return "free", f"default port of {command}"


def _webgl(asks_browser: bool) -> tuple[str, str]:
    """Return (what is known of WebGL 2; what it is for), by asking Chromium if that is wanted."""
    purpose = "draws the pages of view and serve"
    browser = ""
    for name in _BROWSERS:
        if shutil.which(name):
            browser = name
            break
    if not asks_browser:
        state = f"untested ({browser})" if browser else "untested"
        return state, f"{purpose}; test it: twin doctor --webgl, or chrome://gpu"
    if not browser.startswith(("chromium", "google")):
        return "untested", f"{purpose}; only Chromium can be asked, and it was not found"
    # in containers, Chromium needs a sandbox that it cannot have, and more shared memory than there is
    line = [browser, "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--dump-dom", _WEBGL_PAGE]
    try:
        page = subprocess.run(line, capture_output=True, text=True, timeout=_WEBGL_SECONDS, check=False).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        return "untested", f"{purpose}; {browser} did not answer: {type(error).__name__}"
    renderer = re.search(r"WEBGL\[(.*?)\]", page, re.DOTALL)
    if renderer is None:
        return "untested", f"{purpose}; {browser} did not answer"
    if not renderer[1]:
        return "-", f"{purpose}; {browser} has none"
    if "swiftshader" in renderer[1].lower() or "llvmpipe" in renderer[1].lower():  # drawn by the processor
        return "software", f"{purpose}, slowly: {renderer[1]}"
    return "yes", f"{purpose}: {renderer[1]}"


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
