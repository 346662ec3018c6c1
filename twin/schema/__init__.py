"""Strict pydantic models for hand-written TOML; their errors name the line and suggest a fix."""

from twin.schema.lines import Key as Key
from twin.schema.lines import Keys as Keys
from twin.schema.lines import key_lines as key_lines
from twin.schema.mistakes import first_mistake as first_mistake
from twin.schema.tables import Identifier as Identifier
from twin.schema.tables import LimitRange as LimitRange
from twin.schema.tables import NotNegative as NotNegative
from twin.schema.tables import Origin as Origin
from twin.schema.tables import Positive as Positive
from twin.schema.tables import Range as Range
from twin.schema.tables import Row as Row
from twin.schema.tables import Sourced as Sourced
from twin.schema.tables import Table as Table
from twin.schema.tables import Vector as Vector
from twin.schema.tables import at as at
from twin.schema.tables import error_at as error_at
from twin.schema.tables import json_schema as json_schema
from twin.schema.tables import load_toml as load_toml
from twin.schema.tables import parse_toml as parse_toml
