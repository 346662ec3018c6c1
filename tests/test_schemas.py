"""The JSON Schemas in docs/schemas are those of the models that read the files."""

from __future__ import annotations

import importlib.util
import json
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


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
    """Every table is closed, like the models: editors then mark an unknown key."""
    schema = json.loads(schemas[name])
    tables = [schema, *(d for d in schema.get("$defs", {}).values() if d.get("type") == "object")]
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
        assert list(_misfits(tomllib.loads(path.read_text(encoding="utf-8")), schema, schema, path.name)) == []


def test_schema_check_of_this_file_sees_a_misfit(schemas):
    schema = json.loads(schemas["robot.schema.json"])
    data = tomllib.loads((ROOT / "cad/sils/sils.toml").read_text(encoding="utf-8"))
    data["joint"][0]["type"] = "hinge"
    data["tolerance"]["gros_mm"] = 1.0
    del data["base"]
    found = list(_misfits(data, schema, schema, "sils"))
    assert {f.split(":")[0] for f in found} == {"sils", "sils.joint.0.type", "sils.tolerance.gros_mm"}


def _misfits(value, node: dict, schema: dict, where: str):
    """Yield where a value does not fit; as much of JSON Schema as pydantic writes for these models."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
    branches = node.get("anyOf") or node.get("oneOf")
    if branches:
        if not any(not list(_misfits(value, b, schema, where)) for b in branches):
            yield f"{where}: fits no branch"
        return
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}
    kind = node.get("type")
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if (kind in ("number", "integer") and not number) or (kind in kinds and not isinstance(value, kinds[kind])):
        yield f"{where}: {value!r} is no {kind}"
        return
    if ("enum" in node and value not in node["enum"]) or ("const" in node and value != node["const"]):
        yield f"{where}: {value!r}"
    if "pattern" in node and not re.search(node["pattern"], value):
        yield f"{where}: {value!r}"
    if kind == "object":
        yield from (f"{where}: {k} is missing" for k in node.get("required", ()) if k not in value)
        for key, child in value.items():
            if "properties" in node and key in node["properties"]:
                yield from _misfits(child, node["properties"][key], schema, f"{where}.{key}")
                continue
            patterns = [v for p, v in node.get("patternProperties", {}).items() if re.search(p, key)]
            other = patterns[0] if patterns else node.get("additionalProperties", True)
            if other is False:
                yield f"{where}.{key}: unknown"
            elif isinstance(other, dict):
                yield from _misfits(child, other, schema, f"{where}.{key}")
    if kind == "array":
        prefix = node.get("prefixItems", [])
        for i, child in enumerate(value):
            item = prefix[i] if i < len(prefix) else node.get("items", {})
            yield from _misfits(child, item, schema, f"{where}.{i}")


def test_the_earlier_word_for_published_is_still_read():
    from twin.core.provenance import Parameter
    from twin.formula import mm
    from twin.simulation.dynamics.inertia import Mass

    assert mm(160, "SEED", "Table 1").provenance == "PUBLISHED"  # type: ignore[arg-type]
    assert Parameter("a", 1.0, "m", 1.0, "SEED", "x").provenance == "PUBLISHED"  # type: ignore[arg-type]
    read = Mass.model_validate({"value": 1.0, "unit": "kg", "provenance": "SEED", "note": "Table 2"})
    assert read.provenance == "PUBLISHED"
