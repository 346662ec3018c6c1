"""Pictures of pages, as a headless Chromium shows them without a graphics card; for the scripts make_*_pictures.py."""

from __future__ import annotations

import argparse
import io
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

FOLDER = Path(__file__).parent / "pictures"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]


SIZES = ((390, 844), (1280, 800), (1920, 1080))
"""Width and height in pixels of a phone, a small and a large screen."""

SHEET_ROW = 400
"""Height in pixels of a page on a sheet."""

SHEET_GAP = 12
"""Pixels between the pages of a sheet."""


def sheet(page_of: Callable[[int, int, Literal["light", "dark"]], bytes]) -> bytes:
    """Return a picture of a page at all `SIZES`: with light colours in the first row, with dark ones in the second.

    Args:
        page_of: returns the picture of the page as PNG; takes its width and height in pixels, and "light" or "dark".
    """
    schemes: tuple[Literal["light", "dark"], ...] = ("light", "dark")
    rows: list[list[Image.Image]] = []
    for scheme in schemes:
        row: list[Image.Image] = []
        for width, height in SIZES:
            picture = Image.open(io.BytesIO(page_of(width, height, scheme))).convert("RGB")
            row.append(picture.resize((round(width * SHEET_ROW / height), SHEET_ROW), Image.Resampling.LANCZOS))
        rows.append(row)
    full_width = sum(picture.width for picture in rows[0]) + SHEET_GAP * (len(SIZES) - 1)
    full = Image.new("RGB", (full_width, len(rows) * SHEET_ROW + SHEET_GAP), "white")
    for index, row in enumerate(rows):
        left_edge = 0
        for picture in row:
            full.paste(picture, (left_edge, index * (SHEET_ROW + SHEET_GAP)))
            left_edge += picture.width + SHEET_GAP
    png = io.BytesIO()
    full.save(png, "PNG")
    return png.getvalue()


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
