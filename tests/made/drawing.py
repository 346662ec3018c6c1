"""Run drawings (cad/*/model.py) in processes that have imported build123d: the import is slower than the drawing."""

from __future__ import annotations

import json
import multiprocessing
import os
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

_processes = multiprocessing.get_context("forkserver")
_processes.set_forkserver_preload(["build123d"])


def draw(model: Path, *arguments: object) -> None:
    """Run a drawing with command-line arguments, in a process of its own.

    Raises:
        ChildProcessError: the drawing failed; the message contains its output.
    """
    with tempfile.NamedTemporaryFile() as said:
        process = _processes.Process(target=_run, args=(str(model), [str(a) for a in arguments], said.name))
        process.start()
        process.join()
        code = process.exitcode
        process.close()
        if code:
            text = Path(said.name).read_text("utf-8", "replace")[-2000:]
            raise ChildProcessError(f"{model} ended with {code}\n{text}")


_LOAD = """
import importlib.util, json, sys
from pathlib import Path

spec = importlib.util.spec_from_file_location("model", sys.argv[1])
model = importlib.util.module_from_spec(spec)
spec.loader.exec_module(model)
cad = model.cad
out, defects = Path(sys.argv[2]), json.loads(sys.argv[3])
d = model.dimensions(Path(sys.argv[1]).with_name("dimensions.toml"))
parts = cad.parts(Path(sys.argv[1]).parent)
"""


def defective(model: Path, script: str, defects: dict, folder: Path) -> Path:
    """Draw a robot once for each defect, in one process; return the folder with a STEP file for each label.

    `script` can use: the module `model` of the drawing, its module `cad`, the result `parts` of `cad.parts`, the
    dimensions `d`, the folder `out`, and `defects` by label.
    """
    (folder / "draw.py").write_text(_LOAD + script)
    command = [sys.executable, str(folder / "draw.py"), str(model), str(folder), json.dumps(defects)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    return folder


def measured(description: Path, folder: Path, label: str):
    """Read the STEP file of a defect with the description of its robot."""
    from twin.cad.build import read_mechanism  # imported here: the drawing processes do not need twin

    home = folder / label
    home.mkdir(exist_ok=True)
    shutil.copy(description, home)
    shutil.copy(folder / f"{label}.step", home / f"{description.stem}.step")
    return read_mechanism(home / description.name, with_mass=False)


def _run(model: str, arguments: list[str], said: str) -> None:
    with Path(said).open("w") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    sys.argv = [model, *arguments]
    sys.path.insert(0, str(Path(model).parent))
    runpy.run_path(model, run_name="__main__")
