"""Readers of the files for continuous integration: the model of the SARIF schema (pydantic-sarif), and junitparser.

    read_ci.py twin.sarif twin.xml

Prints {"sarif": [[rule, level, address, line], ...], "junit": [[name of the test, "passed" | kind, text], ...],
"counts": [tests, failures, errors, skipped]}. A file that violates its schema ends the program with an error.
"""

import json
import sys
from pathlib import Path

from junitparser import JUnitXml
from pydantic_sarif.model import StaticAnalysisResultsFormatSarifVersion210JsonSchema as Log

log = Log.model_validate_json(Path(sys.argv[1]).read_text("utf-8"))
results = []
for run in log.runs:
    for result in run.results:
        place = result.locations[0].physicalLocation
        results.append([result.ruleId, result.level.value, place.artifactLocation.uri, place.region.startLine])

suites = JUnitXml.fromfile(sys.argv[2])
cases = []
for suite in suites:
    for case in suite:
        kinds = [type(outcome).__name__.lower() for outcome in case.result]
        cases.append([case.name, kinds[0] if kinds else "passed", case.result[0].text if kinds else ""])
counts = [suites.tests, suites.failures, suites.errors, suites.skipped]
print(json.dumps({"sarif": results, "junit": cases, "counts": counts}), flush=True)
