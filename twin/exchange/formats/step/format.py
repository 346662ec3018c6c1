"""STEP in lists of formats."""

from __future__ import annotations

from twin.exchange.format import Format, Places

FORMAT = Format(name="step", title="STEP", places=Places(new=50), sources=(".step", ".stp"))
