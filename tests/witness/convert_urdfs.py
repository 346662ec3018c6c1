"""Convert URDFs to USD by urdf-usd-converter.

    convert_urdfs.py list.json folder        a list of paths

Prints {path: stage, ...}; the stage is null, if the converter refuses the file.
"""

import json
import sys
from pathlib import Path

import urdf_usd_converter

out = {}
for number, path in enumerate(json.loads(Path(sys.argv[1]).read_text())):
    try:
        asset = urdf_usd_converter.Converter().convert(path, str(Path(sys.argv[2]) / str(number)))
        out[path] = asset.path
    except Exception as error:  # what it refuses is counted, and the next file is converted
        print(f"{path}: {error}", file=sys.stderr)
        out[path] = None
sys.stdout.write(json.dumps(out) + "\n")
