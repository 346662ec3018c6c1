"""Write docs/schemas/*.schema.json: of TOML files that people write, and of tracks, recordings and JSON of twin.

python docs/make_schemas.py
"""

from __future__ import annotations

import json
from pathlib import Path

from pydantic import BaseModel

from twin.cad.description import Description
from twin.model.scene import scene_table
from twin.planning.protocol.tables import ProtocolTable
from twin.schema import json_schema
from twin.schema.result_schema import ResultTable
from twin.schema.track import Track
from twin.simulation.campaigns.campaign_table import CampaignTable
from twin.simulation.campaigns.trends_table import TrendsTable
from twin.simulation.machine.settings import Settings
from twin.simulation.session.session_file import Head as SessionHead
from twin.simulation.world.recording import RecordingHead

FOLDER = Path(__file__).parent / "schemas"

MODELS: dict[str, type[BaseModel]] = {
    "robot": Description,
    "protocol": ProtocolTable,
    "track": Track,
    "world": RecordingHead,
    "session": SessionHead,
    "scene": scene_table(),
    "machine": Settings,
    "campaign": CampaignTable,
    "trends": TrendsTable,
    "result": ResultTable,
}
"""By the name of the file: cad/<robot>/<robot>.toml, trajectories/<robot>/<protocol>.toml, an export's tracks/, the
first lines of a recording of a World and of a session at a console, cad/<scene>/scene.toml, cad/<robot>/machine.toml,
cad/<robot>/campaigns/<name>.toml, of which trends.toml has the paper's experiments; what every command prints
with --json."""


def schemas() -> dict[Path, str]:
    """Return the text of every schema file by path."""
    return {
        FOLDER / f"{name}.schema.json": json.dumps(json_schema(model), indent=2, ensure_ascii=False) + "\n"
        for name, model in MODELS.items()
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for path, text in schemas().items():
        path.write_text(text, encoding="utf-8")
        print(path)
