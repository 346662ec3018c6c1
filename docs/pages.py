"""Pictures of pages, as a headless Chromium shows them without a graphics card; for the scripts make_*_pictures.py."""

from __future__ import annotations

import argparse
import io
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

FOLDER = Path(__file__).parent / "pictures"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]


def draw(about: str, names: Iterable[str], shown: Callable[[Browser, str], bytes], prefix: str = "") -> None:
    """Write the pictures that the command line asks for.

    Args:
        about: text of --help.
        names: names of all pictures.
        shown: returns the picture of a name as PNG.
        prefix: of the files' names.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=names, default=list(names))
    args = parser.parse_args()
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        for name in args.only:
            file = FOLDER / f"{prefix}{name}.png"
            image = Image.open(io.BytesIO(shown(browser, name))).convert("RGB")
            image.quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)
            print(f"{file.name}: {file.stat().st_size / 1e3:.0f} kB")
