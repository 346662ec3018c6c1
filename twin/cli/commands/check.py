"""`twin check`: check every robot description in a folder, for continuous integration."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.parser import Command

if TYPE_CHECKING:
    from twin.checking.check_result import FolderCheck

EXAMPLES = """\
  twin check .
  twin check . --exclude third_party --exclude '*_old.urdf' --jobs 4
  twin check . --packages ~/ros/src --sarif twin.sarif --junit twin.xml
  twin check . --baseline .twin-baseline.json --write-baseline    accept what is found now
  twin check . --baseline .twin-baseline.json                     fail only for new findings
  twin check . --fail-on warning"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin check`."""
    text = "a folder with robot descriptions: URDF, xacro, MJCF, SDF, USD, DH tables, robot folders"
    command.add_argument("folder", help=text)
    text = "leave out files and folders that match a pattern as in .gitignore; may be repeated"
    command.text("--exclude", "PATTERN", text, action="append", default=[])
    command.xacro()
    command.flag("--no-compare", "do not compare descriptions of one robot with each other")
    command.text("--sarif", "FILE", "write the findings as SARIF 2.1.0")
    command.text("--junit", "FILE", "write the files as tests of JUnit XML")
    command.text("--baseline", "FILE", "known findings, which do not fail")
    command.flag("--write-baseline", "write the warnings and errors of this run into the file of --baseline")
    text = "least level of a finding that fails (default error)"
    command.choice("--fail-on", ("error", "warning"), text, "error")
    command.integer("--jobs", "number of processes (default 1)", 1, least=1)
    command.number("--seconds", "S", "time for one file; a slower file is not judged", 120.0)
    command.flag("--all", "show notes and every finding, not only the first of each rule")


def run(args: argparse.Namespace) -> int:
    """Check the folder; the exit code is 0 without failing findings, 1 with, 2 if something could not be judged."""
    from twin.checking.baseline import write_baseline
    from twin.checking.checker import check
    from twin.cli import show
    from twin.core.atomic import require_writable_file, write_text
    from twin.core.errors import TwinError
    from twin.exchange.xacro import settings

    if args.write_baseline and not args.baseline:
        raise TwinError("--write-baseline: name the file with --baseline FILE")
    for file in (args.sarif, args.junit):
        if file:
            require_writable_file(Path(file))
    # a new baseline contains all findings, also those that an old one has
    baseline = None if args.write_baseline else args.baseline
    with show.progress(args.quiet or args.json) as progress:
        result = check(
            args.folder,
            exclude=args.exclude,
            xacro=settings(args.arg, args.packages),
            compare=not args.no_compare,
            baseline=baseline,
            fail_on=args.fail_on,
            jobs=args.jobs,
            seconds=args.seconds,
            progress=progress,
        )
    _require_other_files(result, args)
    if args.sarif:
        text = json.dumps(result.sarif(), indent=1, ensure_ascii=False)
        write_text(Path(args.sarif), f"{text}\n")
    if args.junit:
        write_text(Path(args.junit), result.junit())
    code = show.finish(result, args, text=result.lines(args.all))
    if args.write_baseline:
        count = write_baseline(Path(args.baseline), result.found)
        if not args.json:
            print(f"  {args.baseline}: {count} findings are known from now on")
        rules = [finding.rule for finding in result.found]
        if "file/unjudged" in rules:
            return 2  # what was not judged is in no baseline
        if code == 1:
            return 0
    return code


def _require_other_files(result: FolderCheck, args: argparse.Namespace) -> None:
    """Refuse an output file that is one of the descriptions that were checked: it would replace the description."""
    from twin.core.errors import TwinError

    descriptions = {judged.description.path.resolve() for judged in result.judged}
    outputs = {"--sarif": args.sarif, "--junit": args.junit}
    if args.write_baseline:
        outputs["--baseline"] = args.baseline
    for option, file in outputs.items():
        if file and Path(file).resolve() in descriptions:
            raise TwinError(f"{option} {file} is a description that was checked: name another file")
