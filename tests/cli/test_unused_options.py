"""An option that would have no effect is refused, with what it applies to."""

from __future__ import annotations

import pytest

from twin.cli import main

MACHINE = ["--machine", "raven_left=127.0.0.1:36000:36001"]
PAGE = ["--no-browser", "--port", "0"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["serve", "dome", *MACHINE], "--machine requires a console, which scene 'dome' lacks"),
        (["view", "dome", *MACHINE], "--machine requires a console, which scene 'dome' lacks"),
        (["serve", "vsrs", "--protocols", *MACHINE], "--machine and --protocols cannot be combined"),
        (["serve", "sils", "--protocols"], "--protocols applies to a scene with a console; sils is a robot"),
        (["view", "sils", "--protocols"], "omit --protocols: it applies to a scene with a console, and sils is"),
        (["view", "vsrs", "--html", "vsrs.html", "--protocols"], "omit --protocols: a recording always plays"),
        (["view", "sils", "--task", "touch"], "of a scene; name a scene with a console"),
        (["view", "vsrs", "--html", "vsrs.html", "--task", "touch"], "of a scene; omit --html"),
        (["serve", "davinci", "--task", "touch", "--trials", "t.csv", "--user", ""], "--user is empty: give a name"),
        (["serve", "davinci", "--task", "touch", "--trials", "t.csv", "--group", " "], "--group is empty"),
        (["serve", "davinci", "--guided", "s", "--participant", "1", "--group", ""], "--group is empty"),
        (["serve", "davinci", "--guided", "s", "--participant", "1", "--protocols"], "a guided run is at the console"),
    ],
)
def test_an_option_of_a_page_that_has_no_effect_is_refused(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*arguments, *PAGE]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "option",
    [
        ["--dh", "modified"],
        ["--units", "m,rad"],
        ["--closures", "loops.yaml"],
        ["--root", "arm"],
        ["--arg", "prefix:=left_"],
        ["--packages", "."],
    ],
    ids=lambda option: option[0],
)
def test_an_example_is_copied_without_options_for_files(option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine", "--example", "hexapod", *option]) == 2
    assert f"{option[0]} is for a file to read, and --example copies a robot: omit one" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    "option",
    [["--protocol", "table2"], ["--all-protocols"], ["--timing", "toppra"], ["--prove"], ["--tolerance-um", "5"]],
    ids=lambda option: option[0],
)
def test_a_sweep_over_joint_ranges_refuses_what_it_does_not_use(option, tmp_path, capsys):
    assert main(["validate", "sils", "--sweep", "--out", str(tmp_path), *option]) == 2
    assert f"{option[0]} and --sweep cannot be combined" in capsys.readouterr().err


def test_a_sweep_of_no_joint_is_no_comparison_along_a_protocol(tmp_path, capsys):
    assert main(["validate", "sils", "--sweep", "", "--out", str(tmp_path)]) == 2
    assert "--sweep: there is no active joint ''" in capsys.readouterr().err
