"""How the code hangs together: layers, independence, lightness, names."""

from __future__ import annotations

import ast
import graphlib
import importlib
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "twin").rglob("*.py"))


HEAVY = {
    *(
        "casadi",
        "pinocchio",
        "pxr",
        "trimesh",
        "cascadio",
        "toppra",
        "matplotlib",
        "viser",
        "coal",
        "scipy",
        "llvmlite",
    ),
    *("numpy", "pydantic", "jinja2", "rich", "tomlkit"),
}


def _modules_after(*argv: str) -> set[str]:
    """Run Python and return the top-level modules that it had loaded at its end."""
    code = f"import sys; sys.argv = {list(argv)!r}\ntry:\n    {argv[0]}\nexcept SystemExit:\n    pass\n"
    code += "print('@@', *sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd="/")
    return set(done.stdout.rsplit("@@", 1)[1].split())


def test_import_contracts_hold():
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


def test_no_files_import_each_other():
    """Imports for types count, and those inside functions."""
    import grimp

    graph = grimp.build_graph("twin", exclude_type_checking_imports=False)
    imported = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    try:
        graphlib.TopologicalSorter(imported).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_the_validator_reaches_less_than_half_of_the_code():
    """Imports inside functions count; the contracts in pyproject.toml say what it may not reach at all."""
    import grimp

    graph = grimp.build_graph("twin", exclude_type_checking_imports=False)
    reached = graph.find_upstream_modules("twin.cli.commands.validate")
    assert "twin.validation.judge" in reached
    assert len(reached) <= 300


UNINSTALLED = """
import sys
class Uninstalled:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("mujoco", "viser", "websockets", "matplotlib"):
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)
sys.meta_path.insert(0, Uninstalled())
from twin.cli import main
codes = [main(line.split()) for line in sys.argv[1:]]
print(codes, sorted({".".join(m.split(".")[:3]) for m in sys.modules if m.startswith(("twin.simulation", "twin.ui."))}))
"""


@pytest.mark.slow
@pytest.mark.usefixtures("several_processors")
def test_the_validator_stands_alone(tmp_path):
    """Without simulator, pictures and servers it judges a robot and a stage; only its page is of the user interface."""
    commands = ["validate hibou --quiet", f"audit {ROOT / 'usd/hibou/hibou.usda'}"]
    done = subprocess.run(
        [sys.executable, "-c", UNINSTALLED, *commands], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert done.stdout.splitlines()[-1] == "[0, 0] ['twin.ui.report']", done.stdout + done.stderr
    page = next(tmp_path.glob("twin-out/hibou/*/report.html")).read_text(encoding="utf-8")
    assert "There are no plots: matplotlib is not installed" in page


@pytest.mark.parametrize(
    "statement",
    [
        "import twin",
        "import twin; dir(twin)",
        "import twin.cli",
        "from twin.cli import main; main(['--help'])",
        "from twin.cli import main; main(['validate', '--help'])",
        "from twin.cli import main; main(['--version'])",
        "from twin.cli import main; main(['no_such_command'])",
        "import twin.robots; twin.robots.names()",
    ],
)
def test_nothing_heavy_is_imported_for(statement):
    assert _modules_after(statement) & HEAVY == set()


def test_check_of_imports_sees_a_heavy_one():
    assert "numpy" in _modules_after("import twin; twin.load") & HEAVY


@pytest.mark.slow
def test_listing_robots_loads_no_geometry():
    """`twin list` reads descriptions only."""
    loaded = _modules_after("from twin.cli import main; main(['list'])")
    assert loaded & (HEAVY - {"numpy", "pydantic", "rich"}) == set()


# --------------------------------------------------------------------------------- the drawing's independence


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield ("." * node.level) + (node.module or "")
        elif isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            beside = [c.value for a in node.args for c in ast.walk(a) if isinstance(c, ast.Constant)]
            folders = (path.parent, *(f for f in path.parent.iterdir() if f.is_dir()))
            if name == "spec_from_file_location" and any((f / str(b)).is_file() for f in folders for b in beside):
                continue  # another file of the same drawing, or of a drawing that uses this one, itself checked here
            if name in ("import_module", "__import__", "spec_from_file_location", "run_path", "run_module", "exec"):
                yield f"<{name}>"


DRAWINGS = sorted([*ROOT.glob("cad/**/*.py"), *ROOT.glob("docs/examples/*/cad/*.py")])


@pytest.mark.parametrize("path", DRAWINGS, ids=lambda p: f"{p.parent.name}/{p.name}")
def test_drawing_imports_neither_twin_nor_equations(path):
    imported = set(_imports(path))
    beside = {p.stem for p in (*path.parent.glob("*.py"), *(ROOT / "cad").glob("*.py"))}
    wrong = {n for n in imported if n.split(".")[0] in ("twin", "casadi", "formula") or n.startswith(("..", "<"))}
    assert not wrong, f"{path}: {sorted(wrong)}"
    ours = {n for n in imported if n.lstrip(".").split(".")[0] in beside}
    foreign = {n.split(".")[0] for n in imported - ours} - set(sys.stdlib_module_names)
    assert foreign <= {"numpy", "build123d", "OCP"}, f"{path}: what are {sorted(foreign)}?"


def test_every_robot_with_drawing_sources_is_checked():
    assert list(ROOT.glob("cad/*/model.py")), "no drawing was found: the test above tests nothing"


def test_data_folders_are_no_packages():
    for kind in ("cad", "usd", "trajectories"):
        assert not list((ROOT / kind).rglob("__init__.py"))


# ---------------------------------------------------------------------------------------------- names


def test_files_say_what_they_are_about():
    vague = {"utils", "util", "helpers", "helper", "common", "misc", "base", "tools"}
    assert not [p for p in SOURCES if p.stem in vague or p.parent.name in vague]


def test_package_and_public_function_share_no_name():
    import twin

    packages = {p.stem for p in (ROOT / "twin").glob("*.py")} | {p.parent.name for p in (ROOT / "twin").glob("*/*.py")}
    assert not packages & (set(twin.__all__) - {"__version__"})


def test_only_the_command_line_prints_or_leaves():
    for path in SOURCES:
        if ROOT / "twin/cli" in path.parents or path.name == "__main__.py":
            continue
        text = path.read_text(encoding="utf-8")
        if not re.search(r"\b(print|input|breakpoint|exit|_exit)\s*\(", text):
            continue  # to parse all files takes seconds
        calls = [n.func for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call)]
        called = {getattr(f, "id", getattr(f, "attr", "")) for f in calls}
        assert not called & {"print", "input", "breakpoint", "exit", "_exit"}, path


# ---------------------------------------------------------------------------------------------- documentation


def _public(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from _public(node, f"{node.name}.")


def test_no_tick_hands_the_interpreter_to_other_threads():
    """`np.linalg.norm` and `dot` of arrays do; see `spatial.length`."""
    places = []
    for room in ("controllers", "machine", "world"):
        for path in sorted((ROOT / "twin/simulation" / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.Attribute):
                    continue
                owner = ast.unparse(node.value)
                is_norm = node.attr == "norm" and owner.endswith("linalg")
                is_dot = node.attr == "dot" and owner != "ca"  # CasADi builds expressions, before any tick
                if is_norm or is_dot:
                    places.append(f"{path.name}:{node.lineno}: {owner}.{node.attr}")
    assert places == []


def test_every_public_function_of_the_api_has_a_docstring():
    files = (ROOT / "twin/api").glob("*.py")
    public = {n: node for file in files for n, node in _public(ast.parse(file.read_text(encoding="utf-8")))}
    assert {"load", "names", "plan", "validate", "build", "Robot.inverse", "Robot.solve"} <= set(public)
    assert not [name for name, node in public.items() if not ast.get_docstring(node)]


def test_facade_reexports_exactly_what_it_promises():
    import twin
    from twin import api

    elsewhere = {n for module, names in twin._NAMES_BY_MODULE.items() if module != "twin.api" for n in names}
    assert set(twin.__all__) - {"__version__"} - elsewhere <= set(dir(api))
    assert all(hasattr(api, n) for n in api.__all__)
    assert set(dir(twin)) == set(twin.__all__)


def test_no_module_of_the_api_hides_a_name_of_the_api():
    """A loaded module becomes an attribute of its package: `twin.api.new` was a function once, then a module."""
    from twin import api

    assert not set(api.__all__) & set(api._NAMES_BY_MODULE)


@pytest.mark.parametrize("file", ["twin/__init__.py", "twin/api/__init__.py"])
def test_type_checkers_see_the_names_that_are_loaded_when_first_used(file):
    path = ROOT / file
    package = importlib.import_module(".".join(path.parent.relative_to(ROOT).parts))
    (block,) = (node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.If))
    seen = set()
    for statement in block.body:
        seen |= {(statement.module, alias.name) for alias in statement.names}
    loaded = set()
    for module, names in package._NAMES_BY_MODULE.items():
        home = module if "." in module else f"{package.__name__}.{module}"
        loaded |= {(home, name) for name in names}
    assert seen - {("typing", "Any")} == loaded


LONGEST = {
    "validation/console_clauses.py:_roll": "five clauses on the same two hands, each with its sentences",
    "planning/plan.py:assemble": "collects the samples and spans of all phases, and builds one trajectory of them",
    "codegen/emit.py:call": "one case for each CasADi instruction",
}
"""The longest functions, by lines of code without docstring, and why each is not cut."""


def _functions(nodes: Iterable[ast.AST]) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Yield the functions in statements, and in all blocks of these; expressions, most of a tree, hold none."""
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node
        for block in ("body", "orelse", "handlers", "finalbody", "cases"):
            inside = getattr(node, block, None)
            if isinstance(inside, list):  # the body of a conditional expression is one node
                yield from _functions(inside)


def test_a_long_function_has_a_reason():
    long = set()
    for file in SOURCES:
        for node in _functions([ast.parse(file.read_text(encoding="utf-8"))]):
            lines = (node.end_lineno or 0) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                lines -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            if lines > 65:
                long.add(f"{file.relative_to(ROOT / 'twin').as_posix()}:{node.name}")
    assert long <= set(LONGEST)
