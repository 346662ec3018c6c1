"""Files of `twin check` for continuous integration, read by the model of the SARIF schema and by junitparser."""

from __future__ import annotations

import pytest

from made.repository import FAULTS, faulty, repository
from twin.checking.rules import RULES
from twin.cli import main


@pytest.mark.witness("ci")
def test_the_files_of_a_check_are_what_their_readers_expect(foreign, tmp_path, monkeypatch):
    """A folder of a repository with files whose names have signs that mean something in SARIF, in XML and in URIs."""
    foreign.need("ci")
    (tmp_path / ".git").mkdir()
    folder = tmp_path / "my robots"
    for rule in ("limits/order", "mesh/missing", "limits/velocity"):
        file = repository(folder / f"{{0}} <&> {rule.replace('/', ' ')} ü", faulty(rule)[0])
        file.rename(file.with_name(f"{rule.partition('/')[2]}.urdf"))
    repository(folder / "clean")
    (folder / "arm.urdf.xacro").write_text(
        '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro">'
        '<xacro:include filename="$(find none)/arm.xacro"/><xacro:arm/></robot>',
        encoding="utf-8",
    )
    monkeypatch.setenv("TWIN_NO_CODE", "1")  # the xacro is then not judged
    files = (tmp_path / "twin.sarif", tmp_path / "twin.xml")
    options = ["--quiet", "--no-compare", "--sarif", str(files[0]), "--junit", str(files[1])]
    assert main(["check", str(folder), *options]) == 1
    seen = foreign.read("ci", "read_ci.py", *files)
    by_rule = {row[0]: row for row in seen["sarif"]}
    assert set(by_rule) == {"limits/order", "mesh/missing", "limits/velocity", "file/unjudged"}
    for rule, level, address, line in seen["sarif"]:
        assert level == RULES[rule].level
        assert address.startswith("my%20robots/")
        if rule != "file/unjudged":
            assert "%7B0%7D%20%3C%26%3E" in address
            assert abs(line - faulty(rule)[1]) <= 5
    outcomes = {name.rpartition("/")[2]: kind for name, kind, _ in seen["junit"]}
    expected = {"order.urdf": "failure", "missing.urdf": "failure", "velocity.urdf": "passed", "arm.urdf": "passed"}
    assert outcomes == expected | {"arm.urdf.xacro": "error"}
    assert seen["counts"] == [5, 2, 1, 0]
    for name, _, text in seen["junit"]:
        if name.endswith("order.urdf"):
            assert FAULTS["limits/order"][1].split('"')[1] in text
            assert "[limits/order]" in text
