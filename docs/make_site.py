"""Build the site of the documentation: pages, reference of commands and of Python, robots that play; check its links.

    python docs/make_site.py [--out FOLDER] [--no-robots] [--builder PROGRAM]

The pages of docs/ are copied together with the files to which they link; notebooks of docs/cookbook run, and become
pages with their outputs; the pages that follow from the code are written here; formulas become MathML. A warning of the
builder, a page that is not in the navigation, or a link that leads nowhere fails the build.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import notebooks

import twin
from twin.cli.commands import HELP

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SETTINGS = DOCS / "site/zensical.toml"

COPIED = ("pictures", "schemas", "licenses")
"""Folders of docs/ whose files are copied as they are."""

PROJECT = ("CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
"""Pages in the root of the repository that become pages of the site, in project/."""

_PLAYER = """\
<details>
<summary>Play {name}</summary>
<iframe src="recordings/{name}.html" title="{title}" loading="lazy"
  style="width: 100%; height: 32rem; border: 0"></iframe>
</details>"""
"""A recording in a page; it is loaded when a reader opens it."""

_LINK = re.compile(r"(\]\()([^)#\s]+)((?:#[^)\s]*)?\))")


def pages_of_docs() -> dict[Path, str]:
    """Return {file: its place in the site} of the written pages."""
    places = {}
    for file in sorted([*DOCS.glob("*.md"), *DOCS.glob("tutorials/*.md")]):
        places[file] = file.relative_to(DOCS).as_posix()
    for notebook in sorted(DOCS.glob("cookbook/*.py")):
        places[notebook] = notebook.relative_to(DOCS).with_suffix(".md").as_posix()
    for name in PROJECT:
        places[ROOT / name] = f"project/{name}"
    places[ROOT / "README.md"] = "index.md"  # docs/index.md takes its place; links to the README lead there
    return places


def copy_pages(pages: Path) -> None:
    """Copy the written pages, and each file to which they link, into a folder."""
    for folder in COPIED:
        shutil.copytree(DOCS / folder, pages / folder)
    places = pages_of_docs()
    for file in places:
        if file != ROOT / "README.md" and file.suffix == ".md":
            _copy_page(file, file.read_text(encoding="utf-8"), pages, places)


def _copy_page(file: Path, text: str, pages: Path, places: dict[Path, str]) -> None:
    """Copy a page; its links lead to the places of pages, or to copies of other files in the folder code/."""
    place = places[file]

    def moved(link: re.Match[str]) -> str:
        if urlsplit(link[2]).scheme:
            return link[0]
        linked = (file.parent / link[2]).resolve()
        to = places.get(linked)
        if to is None and linked.is_relative_to(DOCS):
            to = linked.relative_to(DOCS).as_posix()
        if to is None:
            to = f"code/{linked.relative_to(ROOT).as_posix()}"
        if linked not in places and not (pages / to).exists():
            (pages / to).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(linked, pages / to)
        return link[1] + os.path.relpath(to, Path(place).parent) + link[3]

    text = _LINK.sub(moved, text)
    (pages / place).parent.mkdir(parents=True, exist_ok=True)
    (pages / place).write_text(text, encoding="utf-8")


def write_cookbook(pages: Path) -> None:
    """Run the notebooks, and write each as a page with its outputs, and as .ipynb."""
    places = pages_of_docs()
    for file in sorted(DOCS.glob("cookbook/*.py")):
        print(f"run {file.name}", file=sys.stderr)
        with tempfile.TemporaryDirectory() as empty:
            cells = notebooks.run(file, Path(empty))
        text, pictures = notebooks.markdown_of(cells, file.stem)
        folder = (pages / places[file]).parent
        folder.mkdir(parents=True, exist_ok=True)
        for name, png in pictures.items():
            (folder / name).write_bytes(png)
        (folder / f"{file.stem}.ipynb").write_text(json.dumps(notebooks.ipynb_of(cells)), encoding="utf-8")
        # its links are those of the site already: the files lie beside the page
        text += f'\n<a href="{file.stem}.ipynb" download>This page as a notebook</a> of Jupyter.\n'
        _copy_page(file, text, pages, places)


def write_commands(pages: Path) -> None:
    """Write the reference of the command line: the help text of each command."""
    lines = ["# Commands", "", "Every command prints this text with `--help`.", ""]
    for command in HELP:
        text = _run_twin(command, "--help")
        lines += [f"## twin {command}", "", "```text", text.rstrip(), "```", ""]
    _write(pages / "reference/commands.md", lines)


def write_python(pages: Path) -> None:
    """Write the reference of Python: each public name, with its docstring."""
    lines = ["# Python", "", "`import twin` loads nothing else; a name is loaded when it is first used.", ""]
    for name in sorted(twin.__all__, key=str.lower):
        if name == "__version__":
            continue
        home = getattr(twin, name)
        lines += [f"::: {home.__module__}.{home.__qualname__}", ""]
    _write(pages / "reference/python.md", lines)


def write_schemas(pages: Path) -> None:
    """Write the list of the JSON schemas."""
    lines = [
        "# Schemas",
        "",
        "JSON schemas of the files that twin reads and writes; editors complete keys with them.",
        "",
    ]
    lines += ["| schema | content |", "|---|---|"]
    for file in sorted((DOCS / "schemas").glob("*.json")):
        schema = json.loads(file.read_text(encoding="utf-8"))
        about = schema.get("description") or schema.get("title", "")
        first = " ".join(about.split("\n\n")[0].split())
        lines.append(f"| [{file.name}](../schemas/{file.name}) | {first} |")
    _write(pages / "reference/schemas.md", lines)


def write_robots(pages: Path, with_recordings: bool) -> None:
    """Write the page of all robots: title, picture, and a recording that plays in the browser."""
    robots = json.loads(_run_twin("list", "--json"))["robots"]
    lines = [
        "# Robots",
        "",
        "Each robot plays in this page, without Python: open it, turn it with the mouse, press play.",
        "",
    ]
    for robot in robots:
        if robot["kind"] != "robot":
            continue
        name = robot["name"]
        protocols = ", ".join(f"`{protocol}`" for protocol in robot["protocols"])
        lines += [f"## {robot['title']}", "", f"`{name}`; protocols: {protocols}.", ""]
        if (DOCS / f"pictures/{name}.png").is_file():
            lines += [f"![{robot['title']}](pictures/{name}.png)", ""]
        if with_recordings:
            print(f"record {name}", file=sys.stderr)
            (pages / "recordings").mkdir(exist_ok=True)
            _run_twin("view", name, "--html", str(pages / f"recordings/{name}.html"), "--quiet")
            lines += [_PLAYER.format(name=name, title=robot["title"]), ""]
    _write(pages / "robots.md", lines)


def build(out: Path, builder: Path, with_recordings: bool) -> int:
    """Build the site into a folder and return the number of its pages.

    Raises:
        SystemExit: the builder warns, a page has no place in the navigation, or a link leads nowhere.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        pages = work / "docs"
        pages.mkdir()
        copy_pages(pages)
        write_cookbook(pages)
        write_commands(pages)
        write_python(pages)
        write_schemas(pages)
        write_robots(pages, with_recordings)
        formulas = [builder.parent / "python", DOCS / "site/formulas.py", pages]
        subprocess.run([str(part) for part in formulas], check=True)
        settings = SETTINGS.read_text(encoding="utf-8")
        (work / "zensical.toml").write_text(settings, encoding="utf-8")
        (work / "code").symlink_to(ROOT)  # in which the builder finds the docstrings
        missing = [str(file.relative_to(pages)) for file in pages.rglob("*.md") if file.name not in settings]
        if missing:
            raise SystemExit(f"{SETTINGS}: no place in the navigation: {', '.join(missing)}")
        # The builder calls ruff, which is beside it, to fold signatures.
        environment = os.environ | {"PATH": f"{builder.parent}{os.pathsep}{os.environ['PATH']}"}
        command = [str(builder), "build", "--clean", "--strict"]
        done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True)
        print(done.stdout + done.stderr, file=sys.stderr)
        if done.returncode:
            raise SystemExit(f"{builder.name} ended with {done.returncode}")
        wrong = list(broken_links(work / "site"))
        if wrong:
            raise SystemExit("links that lead nowhere:\n  " + "\n  ".join(wrong))
        if out.exists():
            shutil.rmtree(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(work / "site", out)
    return len(list(out.rglob("*.html")))


class _Page(HTMLParser):
    """The anchors of a page, and the addresses to which it links or that it loads."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if value and key in ("id", "name"):
                self.anchors.add(value)
            if value and key in ("href", "src"):
                self.links.append(value)


def broken_links(site: Path) -> Iterator[str]:
    """Yield "page: address" of each address inside the site that leads to no file, or to no anchor of its page.

    Recordings, which are pages of their own, are not read.
    """
    pages = {}
    for file in sorted(site.rglob("*.html")):
        if file.parent.name != "recordings":
            pages[file] = _Page(file)
    for file, page in pages.items():
        for link in page.links:
            address = urlsplit(link)
            if address.scheme or address.netloc or file.name == "404.html":
                continue
            target = (file.parent / unquote(address.path)).resolve() if address.path else file
            if target.is_dir():
                target /= "index.html"
            anchor = unquote(address.fragment)
            found = target.is_file() and (not anchor or target not in pages or anchor in pages[target].anchors)
            if not found:
                yield f"{file.relative_to(site)}: {link}"


def _run_twin(*arguments: str) -> str:
    # so many columns fit in a block of text of the site
    environment = os.environ | {"COLUMNS": "88"}
    command = [sys.executable, "-m", "twin", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout


def _write(file: Path, lines: list[str]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Build the site as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "twin-out/site")
    parser.add_argument("--builder", type=Path, default=ROOT / ".venv-site/bin/zensical")
    parser.add_argument("--no-robots", action="store_true", help="without recordings of the robots")
    args = parser.parse_args()
    count = build(args.out, args.builder.absolute(), not args.no_robots)
    print(f"{count} pages: {args.out / 'index.html'}")


if __name__ == "__main__":
    main()
