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
PACKAGES = {"yaml": "pyyaml"}


@pytest.mark.parametrize(("module", "extra"), EXTRAS.items())
def test_missing_package_is_named_with_its_extra(monkeypatch, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(TwinError, match=re.escape(f"the thing needs {module}: pip install 'twin-robotics[{extra}]'")):
        require(module, "the thing")
    (line,) = DECLARED[extra]
    assert re.match(r"[a-z]+", line)[0] == PACKAGES.get(module, module)


def test_all_means_all():
    (line,) = DECLARED["all"]
    assert set(line.partition("[")[2].rstrip("]").split(",")) == set(DECLARED) - {"all"}
    assert "twin-robotics[all]" in PROJECT["dependency-groups"]["dev"]


def test_what_is_used_beyond_its_public_interface_has_an_upper_bound():
    bounded = {re.match(r"[a-z-]+", d)[0] for d in PROJECT["project"]["dependencies"] if ",<" in d}
    assert bounded == {re.match(r"[a-z-]+", d)[0] for d in PROJECT["project"]["dependencies"]}
