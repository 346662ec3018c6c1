"""simcheck: what its static checks say of each file of a robot.

    judge_simcheck.py list.json        a list of paths

Prints {path: [[element, check, message], ...], version} with the errors and warnings. Its physics engines are not
asked: they refuse robots whose links have no mass, which most entries do not state.
"""

import json
import sys
from pathlib import Path

import simcheck

out = {"version": f"simcheck {simcheck.__version__}"}
for path in json.loads(Path(sys.argv[1]).read_text()):
    report = simcheck.check(path, static_only=True).to_dict()
    said = []
    for result in report["results"]:
        for finding in result["findings"]:
            if finding["severity"] in ("error", "warning"):
                said.append([finding["target"], finding["check"], finding["message"]])
    out[path] = said
sys.stdout.write(json.dumps(out) + "\n")
