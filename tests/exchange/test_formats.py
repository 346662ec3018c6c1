"""The list of formats, and a format that another package brings."""

from __future__ import annotations

import json
import re
import sys
from importlib.metadata import entry_points as standard_entry_points
from pathlib import Path

import pytest

import twin
from exchange.test_audit_fuzz import FILES, cases
from made.foreign_format import installed
from twin.cli import main
from twin.cli.parser import parser
from twin.core.entry_points import entry_points
from twin.core.errors import TwinError
from twin.core.findings import EXIT_CODES
from twin.exchange import formats as registry
from twin.exchange.audit import audit
from twin.exchange.read import suffixes

ROOT = Path(__file__).parents[2]


@pytest.fixture
def outside(tmp_path, monkeypatch):
    """Install the package of a format outside of the tree; return the folder on `sys.path`."""
    folder = installed(tmp_path / "site")
    monkeypatch.syspath_prepend(str(folder))
    for made_once in (registry.formats, registry._variants_by_kind, parser):
        made_once.cache_clear()
    yield folder
    for made_once in (registry.formats, registry._variants_by_kind, parser):
        made_once.cache_clear()
    for name in [n for n in sys.modules if n.split(".")[0] == "link_poses"]:
        del sys.modules[name]


def test_each_folder_is_a_format_with_the_modules_that_its_places_need():
    folders = {f.name for f in (ROOT / "twin/exchange/formats").iterdir() if (f / "__init__.py").is_file()}
    assert folders == {format.name for format in registry.formats()}
    needed = {"write": registry.export_formats(), "audit": registry.audit_formats(), "read": registry.import_formats()}
    for module, formats in needed.items():
        for format in formats:
            folder = ROOT / "twin/exchange/formats" / format.name
            assert (folder / f"{module}.py").is_file() or (folder / module / "__init__.py").is_file()


def test_no_format_depends_on_another_one():
    """A layer that is an archive of another format's files (USDZ) is read by that format."""
    folder = ROOT / "twin/exchange/formats"
    crossings = set()
    for file in folder.glob("*/**/*.py"):
        own = file.relative_to(folder).parts[0]
        for other in re.findall(r"twin\.exchange\.formats\.(\w+)", file.read_text("utf-8")):
            if other != own and (folder / other).is_dir():
                crossings.add((own, other))
    assert crossings == {("usdz", "usd")}


def test_each_exported_format_is_audited_and_its_use_is_described():
    assert set(registry.export_formats()) <= set(registry.audit_formats())
    assert set(registry.export_formats()) == set(registry.formats_with_use())
    assert all(format.use.startswith("- ") for format in registry.formats_with_use())


def test_kinds_of_files_are_those_of_one_format_and_have_a_rank_of_their_own():
    variants = [variant for format in registry.audit_formats() for variant in format.variants]
    assert len({variant.name for variant in variants}) == len(variants)
    assert len({variant.trust for variant in variants}) == len(variants)
    sources = [suffix for format in registry.import_formats() for suffix in format.sources]
    assert sorted(suffixes()) == sorted(sources)
    assert len(set(sources)) == len(sources)


def test_files_of_each_format_are_damaged_by_the_tests():
    damaged = [Path(name) for name in FILES]
    for format in registry.audit_formats():
        own = [file for file in damaged if format.variant(file) is not None or file.name == format.marker]
        assert own, format.name


def test_documents_name_each_format():
    tables = {"docs/headset.md": registry.export_formats(), "docs/usd-mapping.md": registry.import_formats()}
    for name, formats in tables.items():
        text = (ROOT / name).read_text(encoding="utf-8").lower()
        assert [f.name for f in formats if f.name not in text and f.name != "step"] == []


def test_entry_points_are_those_of_the_standard_library(outside):
    found = entry_points("twin.formats")
    theirs = {e.name: e.load() for e in standard_entry_points(group="twin.formats")}
    assert found == theirs
    assert list(found) == ["poses"]
    assert entry_points("twin.nothing") == {}


def test_a_package_in_the_working_directory_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "intruder-1.dist-info").mkdir()
    (tmp_path / "intruder-1.dist-info/entry_points.txt").write_text("[twin.formats]\nintruder = intruder:FORMAT\n")
    (tmp_path / "intruder.py").write_text("FORMAT = 1\n")
    monkeypatch.chdir(tmp_path)
    for folder in ("", "."):
        monkeypatch.syspath_prepend(folder)
        assert "intruder" not in entry_points("twin.formats")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert entry_points("twin.formats")["intruder"] == 1


def test_a_format_of_another_package_stands_in_all_lists(outside, capsys):
    for command in ("export", "audit"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        words = " ".join(capsys.readouterr().out.split())
        names = [format.name for format in registry.export_formats()]
        titles = [format.title for format in registry.audit_formats()]
        assert names[-1] == "poses"
        assert titles[-1] == "lists of link poses"
        assert ", ".join(names if command == "export" else titles[-2:]) in words
    with pytest.raises(TwinError, match=r"supported are .*, lists of link poses \(\.poses\) and proof\.json"):
        audit(ROOT / "README.md")


@pytest.mark.slow
def test_a_format_of_another_package_is_exported_audited_and_survives_damage(outside, tmp_path):
    made = twin.export(twin.load("hibou"), out=tmp_path / "out", to=["poses", "glb"], protocols=[])
    assert (made.verdict, made.formats) == ("agree", ("glb", "poses"))
    readme = (tmp_path / "out/README.txt").read_text(encoding="utf-8")
    assert "hibou.poses  poses of the links at rest" in readme
    assert "- Spreadsheets: each line of a .poses file" in readme
    proof = json.loads((tmp_path / "out/proof.json").read_text(encoding="utf-8"))
    compared = [c for c in proof["checks"] if c["file"] == "hibou.poses" and c["check"].startswith("rest: position")]
    assert {(c["against"], c["verdict"]) for c in compared} == {("hibou.glb", "agree"), ("the mechanism", "agree")}

    file = tmp_path / "out/hibou.poses"
    good = file.read_bytes()
    lines = good.decode().split("\n")
    row = lines[2].split(" ")
    row[4] = repr(float(row[4]) + 0.002)  # x of the position
    file.write_text("\n".join([*lines[:2], " ".join(row), *lines[3:]]), encoding="utf-8")
    found = [f for f in audit(tmp_path / "out").findings if f.code == "compare.rest"]
    assert [row[0] in f.where for f in found] == [True]
    for kind, data in cases(good).items():
        file.write_bytes(data)
        report = audit(file)
        assert report.verdict in EXIT_CODES
        assert report.exit_code != 0, kind
    file.write_bytes(good + b" " * 100_000)
    assert [f.code for f in audit(file).findings] == ["file.budget"]


BROKEN = {
    "poses = link_poses.format:NOTHING": "cannot be imported",
    "poses = link_poses.missing:FORMAT": "cannot be imported",
    "poses = json:dumps": "not a twin.exchange.format.Format",
}


@pytest.mark.parametrize("line", BROKEN)
def test_a_format_that_cannot_be_imported_is_named(line, outside):
    (metadata,) = outside.glob("*.dist-info/entry_points.txt")
    metadata.write_text(f"[twin.formats]\n{line}\n", encoding="utf-8")
    with pytest.raises(TwinError, match=BROKEN[line]):
        registry.formats()


def test_two_formats_with_one_name_are_refused(outside):
    file = outside / "link_poses/format.py"
    file.write_text(file.read_text().replace('name="poses"', 'name="glb"'), encoding="utf-8")
    with pytest.raises(TwinError, match="two formats have the name 'glb'"):
        registry.formats()
