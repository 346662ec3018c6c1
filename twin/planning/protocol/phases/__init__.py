"""One file per phase type, discovered in this folder."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from twin.planning.protocol.phase import PhaseTable

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

TABLES: dict[str, type[PhaseTable]] = {
    t.kind_of(): t for t in sorted(PhaseTable.__subclasses__(), key=lambda t: t.rank)
}
"""Table classes of the phase types, by `type`."""
