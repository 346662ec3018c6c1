"""One file per phase type, discovered in this folder."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from twin.planning.protocol.phase_table import PhaseTable

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

TABLES: dict[str, type[PhaseTable]] = {}
"""Table classes of the phase types, by `type`, in the order in which they are listed."""

for _table in sorted(PhaseTable.__subclasses__(), key=lambda table: table.rank):
    TABLES[_table.kind_of()] = _table
