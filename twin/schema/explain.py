"""Convert errors of tomllib and pydantic to one line for each mistake, with a correction."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError

from twin.core.json_types import JsonObject
from twin.schema.lines import Keys, nearest_line, spell

UNITS = (
    *("mm", "um", "cm", "m", "in", "deg", "rad", "s", "ms", "min", "kg", "g", "n", "nm", "hz", "percent"),
    *("mm_s", "mm_s2", "m_s", "m_s2", "deg_s", "deg_s2", "rad_s", "rad_s2", "kg_m2", "kg_m3", "g_cm3"),
)
"""Suffixes of key names that are units."""

_SHOWN = 60
"""Maximum length in characters of a value in a message; longer values are cut."""


def explain_syntax(text: str, name: str, error: Exception) -> str:
    """Return the message for invalid TOML: file, line, reason, and the text of the line."""
    message = str(error)
    found = re.search(r"\(at line (\d+), column (\d+)\)", message)
    line = int(found[1]) if found else text.count("\n") + 1
    rows = text.splitlines()
    row = rows[line - 1].strip()[:_SHOWN] if 0 < line <= len(rows) else ""
    message = re.sub(r" \(at .*\)$", "", message)
    return f"{name}:{line}: not valid TOML: {message}" + (f", in: {row}" if row else "")


def first_mistake(error: ValidationError) -> tuple[str, str]:
    """Return (location, message) of the first mistake; the location is keys joined by dots, "" for the whole input."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    return ".".join(map(str, first["loc"])), first["msg"]


def explain(error: ValidationError, data: dict, lines: dict[Keys, int], model: type[BaseModel], name: str) -> str:
    """Return the message of a validation error: one line for each mistake, in the order of the file."""
    schema = _schema(model)
    found: dict[Keys, tuple[int, str]] = {}
    kinds: dict[Keys, str] = {}
    replaced: set[Keys] = set()  # missing keys that a misspelt key explains
    for item in error.errors(include_url=False):
        keys, value = _raw_keys(item, data)
        if keys in found:
            continue  # the same keys in another branch of a union; the message of the first branch covers all branches
        if item["type"] == "extra_forbidden":
            text, meant = _unknown_key(keys, _nodes(schema, data, keys[:-1]))
            if meant:
                replaced.add((*keys[:-1], meant))
        else:
            text = _problem(item, keys, value, _nodes(schema, data, keys), data)
        kinds[keys] = item["type"]
        found[keys] = (nearest_line(lines, keys), f"{spell(keys)}{_shown(item, value)}: {text}")
    for keys in list(found):  # the deepest matching branch of a union explains the error best
        for depth in range(len(keys)):
            if kinds.get(keys[:depth]) in _KINDS:
                replaced.add(keys[:depth])
    rows = [row for keys, row in found.items() if keys not in replaced]
    return "\n".join(f"{name}:{line}: {text}" for line, text in sorted(rows, key=lambda row: row[0]))


@cache
def _schema(model: type[BaseModel]) -> JsonObject:
    """Return the JSON Schema of a model, cached because building it takes longer than reading a file."""
    return model.model_json_schema()


def _raw_keys(item: Any, data: Any) -> tuple[Keys, Any]:
    """Return (keys of the faulty value in the file, the value); union branches, which pydantic adds, are omitted."""
    loc, keys, here = [*item["loc"], *item.get("ctx", {}).get("keys", ())], [], data
    for i, key in enumerate(loc):
        if _inside(here, key):
            here = _step(here, key)
        elif i == len(loc) - 1 and item["type"] in ("missing", "at_key"):
            here = None
        else:
            continue
        keys.append(key)
    return tuple(keys), here


def _inside(here: Any, key: Any) -> bool:
    if isinstance(here, list):
        return isinstance(key, int) and key < len(here)
    return isinstance(here, dict) and key in here


def _step(here: Any, key: Any) -> Any:
    return here[key] if _inside(here, key) else None


def _shown(item: Any, value: Any) -> str:
    if item["type"] in ("missing", "extra_forbidden") or isinstance(value, dict) or value is None:
        return ""
    text = json.dumps(value, ensure_ascii=False)
    return f" = {text if len(text) <= _SHOWN else text[: _SHOWN - 3] + '...'}"


def _unknown_key(keys: Keys, nodes: list[dict]) -> tuple[str, str | None]:
    """Return (message for an unknown key, most similar known key or None)."""
    key, known = str(keys[-1]), sorted({p for node in nodes for p in node.get("properties", {})})
    bare, other = [], []  # known keys: this key with a unit added; this key with another unit
    for name in known:
        for unit in sorted(UNITS, key=len, reverse=True):
            if not name.endswith("_" + unit):
                continue
            stem = name[: -len(unit) - 1]
            if key == stem:
                bare.append(name)
            elif key.startswith(stem + "_") and key[len(stem) + 1 :] in UNITS:
                other.append((unit.replace("_", "/"), name))
            break
    if bare:
        return f"the unit is missing: write {' or '.join(bare)}", bare[0]
    if other:
        units, names = (" or ".join(words) for words in zip(*other, strict=True))
        return f"the unit is {units} here: write {names}", other[0][1]
    close = get_close_matches(key, known, n=1, cutoff=0.7)
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"unknown key{hint}; known keys: {', '.join(known) or 'none'}", close[0] if close else None


_KINDS = {"float_type": "a number", "int_type": "a whole number", "string_type": "text in quotes"}
_KINDS |= {"bool_type": "true or false", "tuple_type": "a list", "list_type": "a list", "dict_type": "a table"}
_KINDS |= {"model_type": "a table", "model_attributes_type": "a table", "int_from_float": "a whole number"}


def _problem(item: Any, keys: Keys, value: Any, nodes: list[dict], data: Any) -> str:
    kind, context = item["type"], item.get("ctx", {})
    allowed = _allowed(nodes)
    also = f"; allowed: {allowed}" if allowed else ""
    if kind == "missing":
        if isinstance(keys[-1], int):
            return f"the list is too short: value {keys[-1] + 1} is missing{also}"
        return "this key is missing" + (
            f"; its value must be {'one of ' * (',' in allowed)}{allowed}" if allowed else ""
        )
    if kind == "union_tag_not_found":
        tag = context["discriminator"].strip("'")
        tags = [v for n in nodes for v in _choices(n.get("properties", {}).get(tag, {}))]
        return f"the key {tag} is missing; its value must be one of {', '.join(tags)}"
    if kind == "union_tag_invalid":
        known = re.findall(r"'([^']*)'", context["expected_tags"])
        return (
            f"unknown {context['discriminator'].strip(chr(39))} '{context['tag']}'"
            f"{_close(context['tag'], known)}; allowed: {', '.join(known)}"
        )
    if kind in ("literal_error", "enum"):
        known = [v for node in nodes for v in _choices(node)]
        return f"not known{_close(value, known)}; allowed: {', '.join(known) or context.get('expected', '')}"
    if kind.startswith(("greater_than", "less_than")):
        return f"out of range{also}"
    if kind in ("finite_number", "json_invalid"):
        return f"must be a finite number{also}"
    if kind in _KINDS:
        also = "" if allowed == _KINDS[kind] else also
        return f"{_KINDS[kind]} is expected, not {_kind_of(value)}{also}{_as_number(value, kind)}"
    if kind in ("too_long", "too_short"):
        return f"the list has {len(value)} values{also}"
    if kind == "string_pattern_mismatch":
        return "must begin with a lower-case letter and contain only lower-case letters, digits and _"
    if kind in ("at_key", "swapped"):
        return context["text"]
    return item["msg"].removeprefix("Value error, ") + also


def _close(value: Any, known: list[str]) -> str:
    close = get_close_matches(str(value).lower(), known, n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


def _kind_of(value: Any) -> str:
    names = {bool: "true or false", str: "text", list: "a list", dict: "a table"}
    return names.get(type(value), "a number")


def _as_number(value: Any, kind: str) -> str:
    if isinstance(value, str) and kind in ("float_type", "int_type"):
        try:
            return f"; write {float(value):g} without quotes"
        except ValueError:
            return "; write a number without quotes"
    return ""


def _nodes(schema: dict, data: Any, keys: Keys) -> list[dict]:
    """Return the JSON Schema nodes of the value at `keys`; union branches are chosen by their tag."""

    def expand(node: dict, value: Any) -> Iterator[dict]:
        if "$ref" in node:
            yield from expand(schema["$defs"][node["$ref"].rsplit("/", 1)[1]], value)
            return
        branches = node.get("anyOf") or node.get("oneOf")
        if not branches:
            yield node
            return
        tag = node.get("discriminator")
        if tag and isinstance(value, dict) and str(value.get(tag["propertyName"])) in tag["mapping"]:
            branches = [{"$ref": tag["mapping"][value[tag["propertyName"]]]}]
        for branch in branches:
            yield from expand(branch, value)

    nodes, here = list(expand(schema, data)), data
    for key in keys:
        here = _step(here, key)
        children: list[dict] = []
        for node in nodes:
            if isinstance(key, int):
                prefix = node.get("prefixItems", [])
                child = prefix[key] if key < len(prefix) else node.get("items")
            else:
                patterns = [v for p, v in node.get("patternProperties", {}).items() if re.search(p, key)]
                other = patterns[0] if patterns else node.get("additionalProperties")
                child = node.get("properties", {}).get(key, other)
            if isinstance(child, dict):
                children += expand(child, here)
        nodes = children
    return nodes


def _allowed(nodes: list[dict]) -> str:
    return " or ".join(dict.fromkeys(text for text in map(_allowed_one, nodes) if text))


def _choices(node: dict) -> list[str]:
    return [str(v) for v in node.get("enum", [node.get("const")]) if v is not None]


def _allowed_one(node: dict) -> str:
    if choices := _choices(node):
        return ", ".join(choices)
    kind = node.get("type")
    if kind in ("number", "integer"):
        signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
        bounds = [f"{sign} {node[key]:g}" for key, sign in signs.items() if key in node]
        return ("a number" if kind == "number" else "a whole number") + (f" {' and '.join(bounds)}" if bounds else "")
    if kind == "array":
        low, high = node.get("minItems"), node.get("maxItems")
        return f"a list of {low} values" if low == high and low is not None else "a list"
    return {"string": "text", "boolean": "true or false", "object": "a table"}.get(str(kind), "")
