"""Convert a URDF to USD by urdf-usd-converter: `convert_urdf.py in.urdf folder`; prints the file and the version."""

import json
import sys
from importlib.metadata import version

import urdf_usd_converter

asset = urdf_usd_converter.Converter().convert(sys.argv[1], sys.argv[2])
print(json.dumps({"file": asset.path, "version": f"urdf-usd-converter {version('urdf-usd-converter')}"}))
