"""Run the frame conversions in the scripts of a Unity package, and compare the results with matrix products."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin.exchange.audit import poses
from twin.exchange.audit.poses import Array
from twin.exchange.audit.report import Ledger, Measured
from twin.exchange.formats.unity.audit.csharp import CSharpError, Script, Value

MIRRORS = {
    "GltFast": np.diag([-1.0, 1.0, 1.0]),
    "UrdfImporter": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
"""Matrix (3, 3) from robot coordinates to Unity coordinates, for each importer.

The glTF importer mirrors x; the URDF importer converts forward-left-up (ROS) to right-up-forward.
"""

ROOTS = {"GltFast": poses.R_Z_UP_Y_UP.T, "UrdfImporter": np.eye(3)}
"""Rotation (3, 3) of the root node, for each importer: glTF from z up to y up, URDF none."""

TOL = 1e-6
_POINTS = np.array([[0.3, -0.7, 1.1], [-1.3, 0.2, -0.4], [0.0, 2.0, -0.5]])
_ROTATIONS = np.array([[0.1, -0.5, 0.7, 0.5], [-0.6, 0.2, 0.3, 0.7], [0.0, 0.0, 1.0, 0.0], [0.7, 0.1, -0.1, 0.7]])
_SHARES = (0.0, 0.2, 0.5, 1.0)


def check_frames(path: Path, name: str, ledger: Ledger) -> None:
    """Run the frame conversions in a Frames.cs and report wrong results; `name` is the file's name in reports."""
    try:
        script = Script(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, CSharpError) as error:
        ledger.wrong("unity.frames", f"{name} cannot be read: {error}.", name)
        return
    rotations = _ROTATIONS / np.linalg.norm(_ROTATIONS, axis=1, keepdims=True)
    worst = 0.0
    for convention, M in MIRRORS.items():
        mirrored = [poses.quaternion(M @ poses.rotation(q) @ M.T) for q in rotations]
        there = list(zip(_POINTS, _POINTS @ M.T, strict=True))
        turned = list(zip(rotations, mirrored, strict=True))
        for method, kind, rows in (
            ("ToUnity", "Vector3", there),
            ("FromUnity", "Vector3", [(b, a) for a, b in there]),
            ("ToUnity", "Quaternion", turned),
            ("FromUnity", "Quaternion", [(b, a) for a, b in turned]),
        ):
            for given, meant in rows:
                value = Value(kind, tuple(map(float, given)))
                off = _off(script, ledger, name, method, (value, convention), meant, f"of a {kind} with {convention}")
                worst = max(worst, off)
        meant = poses.quaternion(ROOTS[convention])
        worst = max(worst, _off(script, ledger, name, "RootRotation", (convention,), meant, f"for {convention}"))
    for i, a in enumerate(rotations):
        for sign in (1.0, -1.0):
            b = sign * rotations[i - 1]
            for share in _SHARES:
                meant = poses.slerp(a[None], b[None], np.array([share]))[0]
                given = (Value("Quaternion", tuple(a)), Value("Quaternion", tuple(b)), share)
                worst = max(worst, _off(script, ledger, name, "Slerp", given, meant, f"at fraction {share:g}"))
    ledger.row("conversions of Frames.cs, executed", worst, "1", TOL, where=name)


def _off(script: Script, ledger: Ledger, name: str, method: str, given: tuple, meant: Array, what: str) -> float:
    """Return the error of a method's result, and report an error above `TOL`. Signs of quaternions are ignored."""
    if not script.has(method):
        return 0.0
    try:
        result = script.call(method, *given)
    except (CSharpError, ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
        ledger.add("unity.frames", "warning", f"{name}: {method} cannot be executed by the audit: {error}.", name)
        return 0.0
    got = np.array(result.numbers if isinstance(result, Value) else (np.nan,))
    ways = (meant, -meant) if len(meant) == 4 else (meant,)
    off = min((float(np.abs(got - m).max()) for m in ways if m.shape == got.shape), default=np.inf)
    if not off <= TOL:
        shown = ", ".join(f"{v:.4g}" for v in got)
        text = f"{name}: {method} {what} gives ({shown}), expected ({', '.join(f'{v:.4g}' for v in meant)})."
        ledger.wrong("unity.frames", text, name, size=Measured(off, TOL), suggestion="check the signs")
    return off if np.isfinite(off) else 1e300
