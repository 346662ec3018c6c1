"""What is shipped of the page: small, whole, with its notices, and made of the sources beside it."""

from __future__ import annotations

import gzip
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from made import headset_page as headset
from twin.ui.access.responses import POLICY
from twin.ui.headset.server_files import page_files
from witness import environments

ROOT = Path(__file__).parents[2]
WEB = ROOT / "twin/ui/headset/web"
DIST = WEB / "dist"
FILES = {"THIRD_PARTY.txt", "icon.svg", "index.html", "twin.css", "twin.js"}


def text(name):
    return (DIST / name).read_text(encoding="utf-8")


def test_it_is_whole_and_small():
    assert {str(p.relative_to(DIST)) for p in DIST.rglob("*") if p.is_file()} == FILES
    packed = sum(len(gzip.compress((DIST / n).read_bytes(), 6)) for n in FILES)
    assert packed < 250_000
    assert page_files(DIST)["/"].type.startswith("text/html")


def test_notices_of_what_is_bundled_are_there():
    notices = text("THIRD_PARTY.txt")
    assert "three 0.187.0 (MIT)" in notices
    assert "three.js authors" in notices
    assert "Permission is hereby granted, free of charge" in notices


def test_nothing_is_fetched_from_elsewhere():
    """The one address in the bundle names an XML namespace; the script asks for files beside it and for no other."""
    for name in FILES - {"THIRD_PARTY.txt"}:
        found = set(re.findall(r"(?:https?:)//[^\s\"'`)]+|(?<=[\"'`])//[\w.-]+", text(name)))
        assert found <= {"http://www.w3.org/1999/xhtml", "http://www.w3.org/2000/svg"}, name
    assert not re.search(r"@import|url\(", text("twin.css"))
    assert set(re.findall(r"fetch\(\"([^\"]*)\"", text("twin.js"))) == {"scene.json"}


def test_the_page_keeps_to_its_policy():
    """No script or style stands in the page itself: the policy would not let it run."""
    assert "unsafe" not in POLICY
    page = text("index.html")
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script(?![^>]*\ssrc=)", page)
    assert re.findall(r"(?:src|href)=\"([^\"]+)\"", page) == [
        "icon.svg", "twin.css", "scene.json", "twin.js",
    ]  # fmt: skip
    script = text("twin.js")
    assert not re.search(r"\beval\(|new Function\(|\.setAttribute\(\"style\"", script)


def test_sources_are_pinned():
    import json

    package = json.loads((WEB / "package.json").read_text())
    versions = {**package["dependencies"], **package["devDependencies"]}
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", v) for v in versions.values())
    locked = json.loads((WEB / "package-lock.json").read_text())["packages"]
    assert all("integrity" in p for n, p in locked.items() if n)


@pytest.mark.slow
def test_a_rebuild_is_what_is_shipped(tmp_path):
    """The sources pass the type checker, and make the same bytes with the packages of the lock file."""
    packages, node = headset.npm_environment("web"), environments.node()
    for item in ("src", "build.mjs", "tsconfig.json", "package.json"):
        source = WEB / item
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / item)
    (tmp_path / "node_modules").symlink_to(packages / "node_modules")
    tsc = packages / "node_modules/typescript/bin/tsc"
    for command in ([node, tsc, "--noEmit"], [node, "build.mjs", "out"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stdout + done.stderr
    assert {p.name for p in (tmp_path / "out").iterdir()} == FILES
    for made in FILES:
        assert (tmp_path / "out" / made).read_bytes() == (DIST / made).read_bytes(), made
