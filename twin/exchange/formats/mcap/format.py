"""MCAP in lists of formats: `twin session` writes it, an export does not."""

from __future__ import annotations

from twin.exchange.format import Format, Places

FORMAT = Format(name="mcap", title="MCAP", places=Places())
