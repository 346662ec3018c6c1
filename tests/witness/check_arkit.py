"""UsdUtils.ComplianceChecker with the rules of ARKit: the last OpenUSD that has it is 26.5.

    python check_arkit.py file.usdz ...

Prints {file: {errors: [...], failed: [...], warnings: [...]}, version}.
"""

from __future__ import annotations

import json
import sys

from pxr import Usd, UsdUtils

out: dict[str, object] = {"version": "OpenUSD " + ".".join(map(str, Usd.GetVersion()[1:]))}
for path in sys.argv[1:]:
    checker = UsdUtils.ComplianceChecker(arkit=True, skipARKitRootLayerCheck=False)
    checker.CheckCompliance(path)
    out[path] = {
        "errors": checker.GetErrors(),
        "failed": checker.GetFailedChecks(),
        "warnings": checker.GetWarnings(),
    }
sys.stdout.write(json.dumps(out) + "\n")
