"""Poses at rest of two files are compared, also where a number is not finite."""

from __future__ import annotations

import numpy as np
import pytest

from twin.exchange.audit.file_comparison import compare_rest
from twin.exchange.audit.file_content import Content
from twin.exchange.audit.ledger import Ledger


def at_rest(format: str, x: float) -> Content:
    T = np.eye(4)
    T[0, 3] = x
    return Content(Ledger(f"arm.{format}"), format, rest={"base": np.eye(4), "arm": T}, declared=("base", "arm"))


@pytest.mark.parametrize(("x", "is_same"), [(0.2, True), (0.2 + 1e-5, False), (np.nan, False), (np.inf, False)])
def test_a_pose_at_rest_that_differs_is_found(x, is_same):
    contents = [at_rest("glb", 0.2), at_rest("usd", x)]
    compare_rest(contents)
    findings = [finding for content in contents for finding in content.ledger.findings]
    checks = [check for content in contents for check in content.ledger.checks]
    assert (findings == []) == is_same
    assert {check.verdict for check in checks if "position" in check.check} == {"agree" if is_same else "disagree"}
    assert is_same or "'arm'" in findings[0].message
