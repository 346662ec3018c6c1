"""urdf-validator: what its checks say of each URDF.

    judge_urdfvalidator.py list.json        a list of paths; those that are no URDF are left out

Prints {path: [[element, check, message], ...], version} with what it calls critical, a warning or a failure: of the
file, of the joints' torques and of the stability. Its workspace is not asked: it samples poses for 12 s a file, and
says how far the arm reaches, not whether this is right.
"""

import importlib.metadata
import json
import re
import sys
from pathlib import Path

from urdf_validator_main.checks.schema import run as check_schema
from urdf_validator_main.checks.stability import run as check_stability
from urdf_validator_main.checks.statics import run as check_statics
from urdf_validator_main.parser.urdf_adapter import ParseError, load_urdf
from urdf_validator_main.report.models import ValidationReport

out = {"version": f"urdf-validator {importlib.metadata.version('urdf-validator')}"}
for path in json.loads(Path(sys.argv[1]).read_text()):
    if not path.endswith(".urdf"):
        continue
    robot = load_urdf(path)
    if isinstance(robot, ParseError):
        out[path] = [["", "parse", robot.message]]
        continue
    report = ValidationReport(path, robot.name, "unknown", "estimated", "", out["version"])
    check_schema(robot, report)
    check_statics(robot, report)
    check_stability(robot, report)
    said = []
    for message in [*report.schema.critical_issues, *report.schema.warnings]:
        named = re.search(r"'([^']*)'", message)
        said.append([named[1] if named else "", re.sub(r"-?[0-9][0-9.e+-]*", "#", message), message])
    for joint in report.statics.joints:
        if joint.status in ("FAIL", "WARN"):
            said.append([joint.name, f"torque {joint.status}", joint.status])
    out[path] = said
sys.stdout.write(json.dumps(out) + "\n")
