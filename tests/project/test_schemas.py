"""The JSON Schemas in docs/schemas are those of the models that read the files."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from pathlib import Path

import pytest

from made.json_schema import misfits

ROOT = Path(__file__).parents[2]


def _script():
    spec = importlib.util.spec_from_file_location("make_schemas", ROOT / "docs/make_schemas.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def schemas() -> dict[str, str]:
    return {path.name: text for path, text in _script().schemas().items()}


@pytest.mark.parametrize("name", sorted(p.name for p in (ROOT / "docs/schemas").iterdir()))
def test_schema_file_is_current(schemas, name):
    committed = ROOT / "docs/schemas" / name
    text = committed.read_text(encoding="utf-8") if committed.is_file() else ""
    assert text == schemas[name], f"{committed} is not current. Write it anew with: python docs/make_schemas.py"


def test_the_docs_name_every_key_that_a_protocol_requires():
    told = (ROOT / "docs/your-own-robot.md").read_text(encoding="utf-8").partition("## The protocol")[2]
    schema = json.loads((ROOT / "docs/schemas/protocol.schema.json").read_text(encoding="utf-8"))
    keys = {key for table in (schema, *schema["$defs"].values()) for key in table.get("required", ())}
    keys -= {"tolerances", "limits", "waypoints", "phases"}  # tables
    assert {key for key in keys if f"`{key}`" not in told} <= {"body", "port"}  # the patient's, in its own example


def test_no_other_schema_file_lies_about(schemas):
    assert {p.name for p in (ROOT / "docs/schemas").iterdir()} == set(schemas)


@pytest.mark.parametrize("name", sorted(p.name for p in (ROOT / "docs/schemas").iterdir()))
def test_schema_refuses_what_the_reader_refuses(schemas, name):
    """Every table that is read is closed, like the models: editors then mark an unknown key."""
    schema = json.loads(schemas[name])
    tables = [d for d in schema.get("$defs", {}).values() if d.get("type") == "object"]
    tables += [schema] if name != "result.schema.json" else []  # each kind of result has its own keys
    assert schema["$schema"].endswith("2020-12/schema")
    assert all(t["additionalProperties"] is False for t in tables), "a table accepts unknown keys"


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("robot.schema.json", "cad/*/*.toml"),
        ("robot.schema.json", "docs/examples/*/cad/hexapod.toml"),
        ("protocol.schema.json", "trajectories/*/*.toml"),
        ("protocol.schema.json", "docs/examples/*/trajectories/*.toml"),
    ],
)
def test_committed_files_fit_their_schema(schemas, name, pattern):
    schema = json.loads(schemas[name])
    files = [p for p in ROOT.glob(pattern) if p.parts[-3] != "cad" or p.stem == p.parent.name]
    assert files
    for path in files:
        assert list(misfits(tomllib.loads(path.read_text(encoding="utf-8")), schema, schema, path.name)) == []


def test_schema_check_of_this_file_sees_a_misfit(schemas):
    schema = json.loads(schemas["robot.schema.json"])
    data = tomllib.loads((ROOT / "cad/sils/sils.toml").read_text(encoding="utf-8"))
    data["joint"][0]["type"] = "hinge"
    data["tolerance"]["gros_mm"] = 1.0
    del data["base"]
    found = list(misfits(data, schema, schema, "sils"))
    assert {f.split(":")[0] for f in found} == {"sils", "sils.joint.0.type", "sils.tolerance.gros_mm"}


def test_the_earlier_word_for_published_is_still_read():
    from twin.core.provenance import Parameter
    from twin.formula import mm
    from twin.reference.inertia import Mass

    assert mm(160, "SEED", "Table 1").provenance == "PUBLISHED"  # type: ignore[arg-type]
    assert Parameter("a", 1.0, "m", 1.0, "SEED", "x").provenance == "PUBLISHED"  # type: ignore[arg-type]
    read = Mass.model_validate({"value": 1.0, "unit": "kg", "provenance": "SEED", "note": "Table 2"})
    assert read.provenance == "PUBLISHED"
