"""What twin knows about a format before it loads a reader or a writer of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Flag, auto
from importlib import import_module
from pathlib import Path
from types import ModuleType

from twin.core.foreign.budget import Budget


class Holds(Flag):
    """What the files of a format contain, and therefore what an audit compares with other files."""

    NOTHING = 0
    LINKS = auto()
    """The links of the robot, and no auxiliary links."""
    REST = auto()
    """Poses of the links at rest."""
    MASSES = auto()
    """The masses of all links: a link without mass has none."""
    JOINT_TREE = auto()
    """A tree of joints, whose values give the poses; a joint may be divided into several."""
    COORDINATES = auto()
    """Values of joints at the keys of a motion: a ball joint has a value, and a name, for each coordinate."""
    UNNAMED_FIXED_JOINTS = auto()
    """Fixed joints without names of their own."""
    TRANSMISSIONS = auto()
    """Transmissions of the driven joints."""
    ALL_MOTIONS = auto()
    """All motions in one file, each with its name."""
    ONE_MOTION = auto()
    """One motion in each file; the files together contain all motions."""
    UNNAMED_MOTION = auto()
    """A motion without name: it has the name of the file, which ends in the name of the protocol."""
    REPEATED_MOTION = auto()
    """A motion that another file contains with more digits."""
    ALL_NAMES = auto()
    """The names of all parts of the mechanism; the other files of an export name only some."""


@dataclass(frozen=True)
class FormatVariant:
    """One kind of file of a format.

    Attributes:
        name: its name in reports, which `Content.format` of an audit repeats.
        suffix: suffix of the file name, in lower case.
        syntax: name of the kind of file in messages about its size.
        budget: limits of a file.
        rank: files with smaller ranks are the references for poses and motions; 0 is the mechanism.
        trust: if files contradict each other and as many agree with either, the source with the smallest number is
            right; 0 is the mechanism.
    """

    name: str
    suffix: str
    syntax: str
    budget: Budget
    rank: int = 90
    trust: int = 900


@dataclass(frozen=True)
class Places:
    """Positions of a format in lists, smallest first; None: the format is not in the list.

    Attributes:
        export: in an export, and in the list of files in its README.txt.
        use: in the instructions of that README.txt.
        audit: in an audit: files of formats with smaller numbers are read first.
        new: in the list of formats that `twin new` reads.
    """

    export: int | None = None
    use: int | None = None
    audit: int | None = None
    new: int | None = None


@dataclass(frozen=True)
class Format:
    """A format. Beside `format.py`, its folder contains the modules for what the format takes part in.

    `write.py`, for an export: `write(order, folder)` writes the files and returns findings; `files(order)` returns
    (file, content) for each line of README.txt.
    `audit.py`, for an audit: `read(path, ledger, context)` returns the `Content` of a file, or None.
    `read.py`, for `twin new`: `read(path, options)` returns an `Imported`.

    Attributes:
        name: name of the format in options, and of its folder.
        title: name of the format in texts.
        places: see `Places`.
        variants: kinds of files that an audit reads.
        marker: name of a file; the whole folder with this file is audited as one. "": files are audited.
        recognise: returns whether a file with the suffix of a variant, or with the name `marker`, has this format.
            None: the suffix is sufficient.
        outermost: returns the files to audit among all files of the format: not those that are parts of others.
        holds: see `Holds`.
        code: first word of the codes of findings.
        guard: name of the parser in another process that tries all files of the formats with this guard together.
        sources: suffixes of the files that `twin new` reads.
        takes: options of `twin new` that the format has: "closures", "root".
        use: what to do with the files, a line of README.txt.
        package: package of the modules `write`, `audit` and `read`, `__package__`; formats of twin leave it out.
    """

    name: str
    title: str
    places: Places
    variants: tuple[FormatVariant, ...] = ()
    marker: str = ""
    recognise: Callable[[Path], bool] | None = None
    outermost: Callable[[Sequence[Path]], list[Path]] = list
    holds: Holds = Holds.NOTHING
    code: str = ""
    guard: str = ""
    sources: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    use: str = ""
    package: str = ""

    def module(self, name: str) -> ModuleType:
        """Import and return the module `name` of the format: "write", "audit" or "read"."""
        return import_module(f"{self.package}.{name}")

    def variant(self, path: Path) -> FormatVariant | None:
        """Return the variant with the suffix of a file; None if there is none."""
        suffix = path.suffix.lower()
        for variant in self.variants:
            if variant.suffix == suffix:
                return variant
        return None

    def accepts(self, path: Path) -> bool:
        """Return whether a file has this format."""
        return self.recognise is None or self.recognise(path)
