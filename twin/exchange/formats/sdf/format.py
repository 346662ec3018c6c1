"""SDF in lists of formats."""

from __future__ import annotations

from twin.exchange.format import Format, Places

FORMAT = Format(name="sdf", title="SDF", places=Places(new=30), sources=(".sdf",), takes=("root",))
