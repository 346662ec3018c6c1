"""NVIDIA's asset validator (what Isaac Sim and Omniverse ask for), all of its rules.

    python check_omniverse.py file ...

Prints {file: [{rule, severity, message, at}, ...], version}.
"""

from __future__ import annotations

import json
import logging
import sys

from omni.asset_validator import ValidationEngine, get_version

logging.disable(logging.INFO)
out: dict[str, object] = {"version": f"omniverse-asset-validator {get_version()}"}
for path in sys.argv[1:]:
    out[path] = [
        {
            "rule": getattr(issue.rule, "__name__", str(issue.rule)),
            "severity": issue.severity.name,
            "message": issue.message,
            "at": str(issue.at),
        }
        for issue in ValidationEngine(init_rules=True).validate(path).issues()
    ]
sys.stdout.write(json.dumps(out) + "\n")
