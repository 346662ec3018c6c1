"""Types of data that is written to JSON or read from it; code beyond that border uses classes with typed fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

JsonObject = dict[str, Any]
"""An object of JSON: text, numbers, booleans, None, and lists and objects of these, by name."""

JsonMapping = Mapping[str, Any]
"""An object of JSON that is only read."""
