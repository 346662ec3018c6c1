"""What a SimReady profile of NVIDIA says of a stage.

    python check_simready.py PROFILE VERSION file

Prints {passed: [feature, ...], required: {requirement: [message, ...]}, asked: the same, not run: [rule, ...],
version}: what fails of what the profile requires, and of what it only asks for.
"""

from __future__ import annotations

import ast
import importlib.metadata
import json
import logging
import sys

import simready.validate as sv

logging.disable(logging.CRITICAL)
profile, version, path = sys.argv[1:]
sv.initialize(rules_and_requirements_paths=[], features_paths=[], profiles_paths=[])
found = sv.validate_asset(sv.AssetValidationConfig(asset_path=path, profile_id=profile, profile_version=version))
failed = {r for d in found.features_summary.values() for r in ast.literal_eval(d.get("failing requirements", "[]"))}
issues = [*found.issues, *found.soft_issues]
out: dict[str, object] = {"required": {}, "asked": {}}
for issue in issues:
    if issue.code:
        group = out["required" if issue.code in failed else "asked"]
        group.setdefault(issue.code.rsplit("simready.")[-1], []).append(issue.message)
out["passed"] = sorted(name for name, d in found.features_summary.items() if d["passed"])
out["not run"] = sorted({i.rule.__name__ for i in issues if not i.code})
out["version"] = f"simready-validate {importlib.metadata.version('simready-validate')}, {profile} {version}"
sys.stdout.write(json.dumps(out) + "\n")
