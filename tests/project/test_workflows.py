"""The hosted workflows: actions pinned, no rights, an end, and targets that exist."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))


@pytest.fixture(params=WORKFLOWS, ids=lambda p: p.stem)
def workflow(request):
    """Text and content of a workflow."""
    text = request.param.read_text(encoding="utf-8")
    return text, yaml.safe_load(text)


def test_there_are_two_lanes_and_a_release():
    assert {p.stem for p in WORKFLOWS} == {"commit", "nightly", "publish"}


def test_actions_are_pinned_to_commits(workflow):
    lines = re.findall(r"uses: *(.*)", workflow[0])
    assert lines
    for line in lines:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v[0-9.]+", line), line


def test_workflow_reads_only_and_every_job_ends(workflow):
    assert workflow[1]["permissions"] == {"contents": "read"}
    for name, job in workflow[1]["jobs"].items():
        # PyPI gives a token to who proves by an identity token to be this workflow
        allowed = {"contents": "read", "id-token": "write"} if name == "publish" else None
        assert job.get("permissions") == allowed, name
        assert job["timeout-minutes"] <= 90, name


def test_targets_exist(workflow):
    known = set(re.findall(r"^([\w./-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    runs = [step["run"] for job in workflow[1]["jobs"].values() for step in job["steps"] if "run" in step]
    wanted = {target for run in runs for line in re.findall(r"\bmake (.*)", run) for target in line.split()}
    assert wanted
    assert wanted <= known


def test_oldest_python_is_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    commit = yaml.safe_load((ROOT / ".github/workflows/commit.yml").read_text(encoding="utf-8"))
    versions = commit["jobs"]["test"]["strategy"]["matrix"]["python"]
    assert project["requires-python"] == f">={versions[0]}"
