"""Expand a xacro by the package `xacro`; the program of `guard.run` for this format, in a process with limits.

The package needs ROS only to find packages; `RosPackages` finds them by their package.xml. Each element keeps the file
and line where it was written (`xml_lines`), so that errors, and numbers of the expanded robot, can be traced to a line
of a file. `main` states the keys of the answer, which `twin.exchange.xacro` reads.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from types import ModuleType, TracebackType
from xml.dom import minidom
from xml.etree.ElementTree import ParseError
from xml.parsers.expat import ExpatError

from twin.core.errors import TwinError
from twin.core.foreign.budget import INCLUDES
from twin.core.foreign.ros_packages import PackageMissingError, RosPackages
from twin.core.foreign.text import DoctypeError, parse_xml
from twin.core.foreign.xml_lines import LineBuilder, SourceLine, source_line

_MOST_MACROS = 150
"""Maximum number of macros that call each other. A chain of a hundred links by a macro that calls itself has 100."""

_MOST_FRAMES = 4000
"""Maximum depth of Python's calls: each macro takes up to ten, and each level of elements one."""

_APPEARANCE_TAGS = ("visual", "collision", "material", "gazebo")
"""Elements in which a macro that was not found changes no pose and no mass."""

_VALUE_CHARACTERS = 80
"""Number of characters of a value that a message shows."""

_NUMBER_ATTRIBUTES = {
    *("xyz", "rpy", "lower", "upper", "effort", "velocity", "mass", "size", "radius", "length", "scale"),
    *("multiplier", "offset", "ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
}
"""Attributes with numbers."""

_ARGUMENT_MISSING = "Undefined substitution argument"
"""Beginning of what xacro says of an argument without a value."""

_NOT_FINITE = re.compile(r"(?i)(?<![\w.])[+-]?(nan|inf(inity)?)(?![\w.])")
"""A number that is not finite, as a word of its own."""

_MATH_CONSTANTS = {
    **{"m_pi": math.pi, "M_PI": math.pi, "PI": math.pi},
    **{"m_pi_2": math.pi / 2, "M_PI_2": math.pi / 2, "m_pi_4": math.pi / 4, "M_PI_4": math.pi / 4},
    **{"DEG2RAD": math.pi / 180, "deg_to_rad": math.pi / 180, "RAD2DEG": 180 / math.pi},
}
"""Constants of mathematics by the names that packages of ROS give them, where such a package was not found."""


class _Fault(Exception):  # noqa: N818, it carries a message of another error
    """A fault with the file and line where it is, and a way out; `incomplete`: arguments or packages are not here."""

    def __init__(self, message: str, place: SourceLine | None = None, incomplete: bool = False) -> None:
        super().__init__(message)
        self.place = place
        self.incomplete = incomplete


class _Expansion:
    """One run of xacro with the changes that files without ROS need."""

    def __init__(self, file: Path, arguments: Mapping[str, str], packages: list[str]) -> None:
        import xacro
        from xacro import substitution_args

        self.xacro: ModuleType = xacro
        self.file = file
        self.packages = RosPackages(file, packages)
        self.missing_packages: list[tuple[str, str, int]] = []
        """(package, file, line) of each include whose package was not found."""
        self.left_out_macros: list[tuple[str, str, int]] = []
        """(macro, file, line) of each macro of a missing package that was left out."""
        self.files_read = 0
        self._arguments = dict(arguments)
        """Values of the arguments; xacro adds the defaults."""
        self._lent_constants: set[str] = set()
        """Names of `_MATH_CONSTANTS` that no file had defined where a package was missing."""
        self._file_texts: list[str] = []
        """Texts of all files that were read."""
        # xacro has no hooks: these functions of it are replaced in this process, which expands one file
        self._include = xacro.process_include
        self._call = xacro.handle_macro_call
        xacro.parse = self.parse
        xacro.process_include = self.include
        xacro.handle_macro_call = self.call
        xacro.warning = lambda *args, **more: None  # they go to a terminal that nobody sees
        substitution_args._eval_find = self.packages.find
        substitution_args._eval_dict["find"] = self.packages.find

    def expand(self) -> minidom.Document:
        """Return the expanded document.

        Raises:
            _Fault: the file cannot be expanded.
        """
        try:
            document = self.xacro.process_file(str(self.file), mappings=self._arguments, verbosity=0)
        except _Fault:
            raise
        except (RecursionError, MemoryError):
            raise
        except Exception as error:
            raise _Fault(self._message(error), _error_line(error), self._is_incomplete(error)) from error
        self._check_finite(document.documentElement)
        self._find_meshes(document.documentElement)
        return document

    def parse(self, source: object, filename: str) -> minidom.Document:
        """Return the document of a file, whose elements know their places; the counterpart of `xacro.parse`."""
        stack = self.xacro.filestack
        self.files_read += 1
        if stack.count(filename) > 1:
            names = " -> ".join(Path(name).name for name in stack)
            raise _Fault(f"the file includes itself: {names}. Remove one of the includes")
        if self.files_read > INCLUDES:
            raise _Fault(f"more than {INCLUDES} files are included. Remove includes")
        try:
            parse_xml(Path(filename))  # counts its elements
            data = Path(filename).read_bytes()
            self._file_texts.append(data.decode("utf-8", "replace"))
            return LineBuilder(filename).parseString(data)
        except OSError as error:
            stack.pop()  # the file that includes it is the one to correct
            raise self.xacro.XacroException(f"the file {filename} cannot be read", exc=error) from error
        except (ExpatError, ParseError) as error:
            line = error.lineno if isinstance(error, ExpatError) else error.position[0]
            raise _Fault(f"the file is not XML: {error}. Correct it", (filename, line)) from error
        except (DoctypeError, LookupError, ValueError) as error:
            raise _Fault(f"{error}", (filename, 1)) from error

    def include(
        self, element: minidom.Element, macros: object, symbols: MutableMapping[str, str], function: object
    ) -> None:
        """Include a file. One of a package that was not found is left out; `_message` names it if it is needed."""
        try:
            self._include(element, macros, symbols, function)
        except self.xacro.XacroException as error:
            package = _missing_package(error)
            if package is None or element.parentNode is None:
                raise
            file, line = source_line(element) or (str(self.file), 0)
            self.missing_packages.append((package, file, line))
            for name, value in _MATH_CONSTANTS.items():
                if name not in symbols:
                    symbols[name] = str(value)
                    self._lent_constants.add(name)
            self.xacro.replace_node(element, by=None)

    def call(self, node: minidom.Element, macros: object, symbols: object) -> bool:
        """Expand a macro. One of a missing package is left out where it only changes what a link looks like."""
        if len(self.xacro.macrostack) > _MOST_MACROS:
            name = self.xacro.macrostack[-1].body.getAttribute("name")
            text = f"macro '{name}' calls itself without end: more than {_MOST_MACROS} macros call each other. "
            raise _Fault(text + "Give the recursion an end, by <xacro:if>", source_line(node))
        try:
            return self._call(node, macros, symbols)
        except self.xacro.XacroException as error:
            text = str(error)
            is_unknown = text.startswith("unknown macro name: ") and text.endswith(node.tagName)
            if not (is_unknown and self.missing_packages and _is_appearance(node)):
                raise
            file, line = source_line(node) or (str(self.file), 0)
            self.left_out_macros.append((node.tagName, file, line))
            self.xacro.replace_node(node, by=None)
            return True

    def _is_incomplete(self, error: BaseException) -> bool:
        """Return whether an error is due to an argument or a package that is not here, and not to the file."""
        if _missing_package(error) is not None or _one_line(error).startswith(_ARGUMENT_MISSING):
            return True
        causes = list(_causes(error))
        if any(isinstance(cause, OSError) for cause in causes):
            # "arms/$(arg size)/arm.xacro" with an empty default: the argument must be given
            return "" in self._arguments.values()
        if any(isinstance(cause, MemoryError) for cause in causes):
            return False
        return bool(self.missing_packages)  # macros and properties may be in the package that was not found

    def _message(self, error: BaseException) -> str:
        """Return what is wrong and the way out."""
        text_of_error = _one_line(error)
        causes = list(_causes(error))
        package = _missing_package(error)
        if package is not None:
            text = f"package '{package}' was not found: it is in no folder of --packages, ROS_PACKAGE_PATH and "
            return text + "AMENT_PREFIX_PATH, and not beside the file. Give the folder that contains it: --packages DIR"
        if text_of_error.startswith(_ARGUMENT_MISSING):
            name = text_of_error.split()[-1]
            return f"the argument '{name}' has no value and no default. Give it: --arg {name}:=VALUE"
        for cause in causes:
            if isinstance(cause, OSError):
                head, _, of_system = text_of_error.partition("[Errno")
                if not head:  # an error in an expression, which stands behind the text of the system
                    _, _, expression = of_system.partition(str(cause.filename))
                    head = f"the file {cause.filename} cannot be read{expression}"
                return f"{head.strip()} ({cause.strerror}). Correct the path, or add the file"
            if isinstance(cause, MemoryError):
                return f"there is not enough memory {text_of_error}. Make the expression smaller"
        way_out = _way_out(text_of_error, causes)
        if self.missing_packages:
            names = ", ".join(sorted({package for package, _, _ in self.missing_packages}))
            way_out += f"; it may be in a package that was not found ({names}): give its folder by --packages DIR"
        return f"{text_of_error}. {way_out}"

    def lent_constants(self) -> list[str]:
        """Return the names in `_MATH_CONSTANTS` that the files use and that a missing package would have defined."""
        text = "\n".join(self._file_texts)
        defined = set(re.findall(r"<xacro:property[^>]*?\bname\s*=\s*[\"'](\w+)", text))
        used_names = []
        for name in sorted(self._lent_constants - defined):
            if re.search(rf"\$\{{[^}}]*\b{name}\b", text):
                used_names.append(name)
        return used_names

    def _check_finite(self, root: minidom.Element) -> None:
        """Raise `_Fault` if a number of a link or joint is not finite."""
        for element in root.getElementsByTagName("*"):
            for name, value in element.attributes.items():
                if name in _NUMBER_ATTRIBUTES and _NOT_FINITE.search(value):
                    text = (
                        f'<{element.tagName}> has {name}="{value[:_VALUE_CHARACTERS]}", but must be finite. Correct the'
                    )
                    raise _Fault(f"{text} expression", source_line(element))

    def _find_meshes(self, root: minidom.Element) -> None:
        """Replace package:// in addresses of meshes by the package's folder, if the mesh is there."""
        for mesh in root.getElementsByTagName("mesh"):
            match = re.fullmatch(r"package://([\w.-]+)/(.*)", mesh.getAttribute("filename"))
            if match is None:
                continue
            try:
                file = Path(self.packages.find(match[1])) / match[2]
            except PackageMissingError:
                continue
            if file.is_file():
                mesh.setAttribute("filename", f"file://{file}")

    def places(self, root: minidom.Element) -> dict[str, SourceLine]:
        """Return {"joint/NAME", "joint/NAME/origin", ...: (file, line)} for joints, links and what is in them."""
        places: dict[str, SourceLine] = {}

        def collect(element: minidom.Element, path: str) -> None:
            place = source_line(element)
            if place is not None:
                places.setdefault(path, place)
            for child in element.childNodes:
                if isinstance(child, minidom.Element):
                    collect(child, f"{path}/{child.tagName}")

        for child in root.childNodes:
            if isinstance(child, minidom.Element) and child.tagName in ("link", "joint"):
                collect(child, f"{child.tagName}/{child.getAttribute('name')}")
        return places


def _one_line(error: BaseException) -> str:
    """Return the text of an error of xacro in one line, without the names of Python's classes."""
    text = " ".join(str(error).split()).rstrip(".")
    return re.sub(r"<class '[\w.]+'>: ", "", text)


def _way_out(text_of_error: str, causes: Sequence[BaseException]) -> str:
    """Return what to do about an error in the text of a file."""
    if text_of_error.startswith("unknown macro name"):
        return "Define the macro, or include the file that defines it"
    if "Undefined parameters" in text_of_error or "Invalid parameter" in text_of_error:
        return "Correct the parameters of the macro's call"
    if any(isinstance(cause, NameError) for cause in causes) or "is not defined" in text_of_error:
        return "Define it by <xacro:property>, or correct its name"
    if "circular variable definition" in text_of_error:
        return "Remove one of these definitions"
    return "Correct the expression"


def _is_appearance(node: minidom.Node | None) -> bool:
    """Return whether an element is inside one that only says what a link looks like."""
    while node is not None:
        if isinstance(node, minidom.Element) and node.tagName in _APPEARANCE_TAGS:
            return True
        node = node.parentNode
    return False


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and those that it wraps."""
    visited_ids: set[int] = set()
    while error is not None and id(error) not in visited_ids:
        visited_ids.add(id(error))
        yield error
        error = getattr(error, "exc", None) or error.__cause__ or error.__context__


def _missing_package(error: BaseException) -> str | None:
    """Return the name of the package that an error is about; None if it is about none."""
    for cause in _causes(error):
        if isinstance(cause, PackageMissingError):
            return str(cause)
    return None


def _error_line(error: BaseException) -> SourceLine | None:
    """Return the place of the element that xacro processed when the error was raised."""
    innermost: SourceLine | None = None
    trace: TracebackType | None = error.__traceback__
    while trace is not None:
        names = trace.tb_frame.f_locals
        if trace.tb_frame.f_code.co_filename.endswith(("xacro/__init__.py", "xacro/xmlutils.py")):
            for name in ("node", "elt", "tag"):
                value = names.get(name)
                if isinstance(value, minidom.Node):
                    innermost = source_line(value) or innermost
        trace = trace.tb_next
    return innermost


def _last_file(expansion: _Expansion | None) -> str | None:
    """Return the file that xacro was reading last; None if it had read none."""
    if expansion is None:
        return None
    names = [name for name in expansion.xacro.filestack or [] if name]
    return names[-1] if names else None


def main(file: str, request: str, answer: str) -> None:
    """Expand the file; write the result to the file `answer`.

    It is {"text", "missing", "left_out", "lent", "places"} or {"error", "file", "line", "incomplete"}.
    """
    request_data = json.loads(Path(request).read_text("utf-8"))
    sys.setrecursionlimit(_MOST_FRAMES)
    outcome: dict[str, object]
    expansion: _Expansion | None = None
    try:
        expansion = _Expansion(Path(file), request_data["arguments"], request_data["packages"])
        document = expansion.expand()
        root = document.documentElement
        assert root is not None  # the parser refuses a document without a root
        outcome = {"text": root.toxml(), "missing": expansion.missing_packages, "left_out": expansion.left_out_macros}
        outcome["places"] = expansion.places(root)
        outcome["lent"] = {name: _MATH_CONSTANTS[name] for name in expansion.lent_constants()}
    except _Fault as fault:
        fault_file, line = fault.place or (_last_file(expansion) or file, 0)
        outcome = {"error": str(fault), "file": fault_file, "line": line, "incomplete": fault.incomplete}
    except TwinError as error:
        outcome = {"error": str(error), "file": "", "line": 0, "incomplete": False}
    except RecursionError:
        text = "its elements or macros are nested too deeply. Simplify the file"
        outcome = {"error": text, "file": file, "line": 0, "incomplete": False}
    Path(answer).write_text(json.dumps(outcome), "utf-8")
