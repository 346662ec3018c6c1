"""NVIDIA's validator of stages (what Isaac Sim and Omniverse ask for).

    python check_nvidia.py file ... --same-meshes file ...

Files behind --same-meshes are not asked again about triangles: those rules take 15 s a robot, and the same geometry
layer was asked before. All other rules see every file.

Prints {file: [{rule, severity, message, at}, ...], version}.
"""

from __future__ import annotations

import json
import logging
import sys

import usd_validation_nvidia as av

OF_TRIANGLES = (
    *(av.ManifoldChecker, av.NormalsWindingsChecker, av.NormalsValidChecker, av.ZeroAreaFaceChecker),
    *(av.IndexedPrimvarChecker, av.WeldChecker),
)

logging.disable(logging.INFO)
out: dict[str, object] = {"version": f"usd-validation-nvidia {av.get_version()}"}
again = False
for path in sys.argv[1:]:
    if path == "--same-meshes":
        again = True
        continue
    engine = av.ValidationEngine(init_rules=True)
    for rule in OF_TRIANGLES if again else ():
        engine.disable_rule(rule)
    out[path] = [
        {
            "rule": getattr(issue.rule, "__name__", str(issue.rule)),
            "severity": issue.severity.name,
            "message": issue.message,
            "at": str(issue.at),
        }
        for issue in engine.validate(path).issues()
    ]
sys.stdout.write(json.dumps(out) + "\n")
