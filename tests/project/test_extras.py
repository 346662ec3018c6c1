"""What few commands need is an extra: declared, bounded, in the development group, and named where it is missing."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from twin.core.errors import TwinError
from twin.core.extras import EXTRAS, require

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
DECLARED = PROJECT["project"]["optional-dependencies"]
PACKAGES = {
    "cuda.bindings.driver": "cuda-bindings",
    "mcap_ros2.writer": "mcap-ros2-support",
    "yaml": "pyyaml",
}
"""{module: package, where the names differ}."""


@pytest.mark.parametrize(("module", "extra"), EXTRAS.items())
def test_missing_package_is_named_with_its_extra(monkeypatch, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(TwinError, match=re.escape(f"the thing needs {module}: pip install 'twin-robotics[{extra}]'")):
        require(module, "the thing")
    packages = [re.match(r"[a-z0-9-]+", line)[0] for line in DECLARED[extra]]
    assert PACKAGES.get(module, module) in packages


def test_all_means_all():
    (line,) = DECLARED["all"]
    assert set(line.partition("[")[2].rstrip("]").split(",")) == set(DECLARED) - {"all"}
    assert "twin-robotics[all]" in PROJECT["dependency-groups"]["dev"]


def test_what_is_used_beyond_its_public_interface_has_an_upper_bound():
    bounded = {re.match(r"[a-z-]+", d)[0] for d in PROJECT["project"]["dependencies"] if ",<" in d}
    assert bounded == {re.match(r"[a-z-]+", d)[0] for d in PROJECT["project"]["dependencies"]}
