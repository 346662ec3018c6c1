"""TrueRig: what its validator says of each file of a robot.

    judge_truerig.py list.json        a list of paths

Prints {path: [[element, check, message], ...], version} with the errors and warnings.
"""

import importlib.metadata
import json
import sys
from pathlib import Path

import truerig
from truerig import report
from truerig.validate import validate

out = {"version": f"truerig {importlib.metadata.version('truerig')}"}
for path in json.loads(Path(sys.argv[1]).read_text()):
    robot = truerig.load(path)
    robot.loss_log.extend(validate(robot))
    said = []
    for event in json.loads(report.render(robot, "json"))["events"]:
        if event["severity"] != "info":
            said.append([event["element"], event["message"].partition("(")[0], event["message"]])
    out[path] = said
sys.stdout.write(json.dumps(out) + "\n")
