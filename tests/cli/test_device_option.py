"""What computes: the option --device of four commands, else the environment variable TWIN_DEVICE, else auto."""

from __future__ import annotations

from argparse import Namespace

import pytest

from twin.cli import main
from twin.cli.option_values import device

COMMANDS = [
    ["validate", "davinci_ecm", "--samples", "100"],
    ["tolerance", "davinci_ecm"],
    ["workspace", "davinci_ecm"],
    ["sweep", "sils", "--vary", "l_p=120..150mm"],
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_wrong_value_of_the_variable_is_an_error_that_names_it(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("TWIN_DEVICE", "gpuu")
    assert main([*command, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "environment variable TWIN_DEVICE: there is no compute device 'gpuu'. Did you mean 'gpu'" in said


def test_the_option_comes_before_the_variable_and_auto_last(monkeypatch):
    monkeypatch.delenv("TWIN_DEVICE", raising=False)
    assert device(Namespace(device=None)) == "auto"
    monkeypatch.setenv("TWIN_DEVICE", "cpu")
    assert device(Namespace(device=None)) == "cpu"
    assert device(Namespace(device="gpu")) == "gpu"
