"""Convert a plain formula file (`inverse(pose)`, `forward(q)` or both, in NumPy or CasADi) to a `Formula`.

The functions are run once on symbols when the file is loaded, so that errors are reported early, with file and line.
"""

from __future__ import annotations

import ast
import inspect
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError
from twin.core.program_end import ProgramEndError, contained
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.contract import POSE_SYMBOL, ActiveJoint, Coordinates, Equation, Formula, Stage
from twin.formula.lift import scope
from twin.formula.loader import text_of
from twin.formula.rows import POSE, PlainRows, entries
from twin.formula.symbol import from_sx, to_sx

FUNCTIONS = ("inverse", "forward", "points")

_LENGTH = 0.1
"""Characteristic length in m of a formula whose parameters include no length."""


def is_plain(module: ModuleType) -> bool:
    """Return whether a module is a plain formula (has functions `inverse` or `forward`, no FORMULA)."""
    return any(hasattr(module, n) for n in ("inverse", "forward"))


def plain_formula(
    module: ModuleType,
    path: Path,
    name: str,
    joints: Sequence[tuple[str, bool]],
    home: tuple[Array, Array | None] | None = None,
) -> Formula:
    """Return the formula of a module with plain functions.

    `joints` contains (name, whether the coordinate is an angle) of each active joint, in the order of the robot's TOML
    file. `home` is the start of the solvers: a reachable tool pose (4, 4), and q (n,) at this pose or None.

    Raises:
        KinematicsError: at the first fault, with file and line.
    """
    text = (inspect.getdoc(module) or name).strip()
    values = vars(module)
    casadi = any(_of_casadi(v) for v in values.values())
    functions = values if casadi else scope(values)
    parameters = _parameters(module, path)
    names = [n for n, _ in joints]
    asked = {n for f in FUNCTIONS if isinstance(functions.get(f), FunctionType) for n in _arguments(functions[f])}
    coordinates = _coordinates({*names, *(p.name for p in parameters)}, asked)
    known = [*coordinates.names, *(p.name for p in parameters)]
    unread = [p.name for p in parameters if p.name not in asked]

    def rows(which: str, more: Sequence[str] = ()) -> _Rows | None:
        f = values.get(which)
        if f is None:
            return None
        if not isinstance(f, FunctionType):
            raise KinematicsError(
                f"{path}:{_line_of(module, path, which)}: {which} must be a function, not {type(f).__name__}."
            )
        return _Rows(which, path, functions[which], names, [*known, *more], POSE_SYMBOL, casadi, unread)

    points = rows("points")
    if points is not None:
        points.outputs = _point_names(points, parameters, names, coordinates)
    inverse, forward = rows("inverse", points.outputs if points else ()), rows("forward")
    first = points is not None and inverse is not None and bool(set(points.outputs) & set(inverse.argument_names))
    if first and points is not None and set(names) & set(inspect.signature(points).parameters):
        text = "inverse() cannot use the named points, because points() computes them from the joints"
        raise points.error(text, points.line)
    formula = Formula(
        name=name,
        title=str(values.get("TITLE", text.splitlines()[0].strip(" ."))),
        source=str(values.get("SOURCE", path.name)),
        parameters=parameters,
        joints=tuple(ActiveJoint(n, "revolute" if angle else "prismatic") for n, angle in joints),
        coordinates=coordinates,
        equations=_in_order(points, inverse, forward, names, first, path),
        characteristic_length=_length_scale(parameters),
        points={n: n for n in points.outputs} if points else {},
        seeds=_seeds(coordinates, home, inverse is not None),
        numbers=_on_numbers([r for r in ((points if first else None), inverse) if r is not None], coordinates),
    )
    _try(formula, [r for r in (points, inverse, forward) if r is not None])
    return formula


def _in_order(
    points: _Rows | None, inverse: _Rows | None, forward: _Rows | None, joints: Sequence[str], first: bool, path: Path
) -> tuple[Equation, ...]:
    """Return the equations in execution order; if `first`, points are computed before the inverse, which uses them."""
    named = points.outputs if points else ()
    order: tuple[tuple[_Rows | None, Stage, tuple[str, ...], str], ...] = (
        (points, "inverse" if first else "helper", named, "named points"),
        (inverse, "inverse", tuple(joints), "points -> joints" if first else "pose -> joints"),
        (forward, "forward", (POSE_SYMBOL,), "joints -> pose"),
    )
    equations = []
    for row, stage, outputs, title in order if first else (*order[1:], order[0]):
        if row is not None:
            row.outputs = outputs
            equations.append(_equation(row, stage, title, path))
    return tuple(equations)


class _Rows(PlainRows):
    """A plain function that can be called with CasADi symbols."""

    def __call__(self, **symbols: Any) -> tuple[Any, ...]:
        """Return the outputs as a tuple of SX.

        Raises:
            KinematicsError: the function fails, or an output has a wrong shape; the message gives file and line.
        """
        parts = self.spread(self.on_symbols(symbols), _split)
        return tuple(self._leave(p, n) for p, n in zip(parts, self.outputs, strict=True))

    def on_symbols(self, symbols: Mapping[str, Any]) -> Any:
        """Return the result of the function for CasADi symbols {name: symbol}."""
        if self.casadi:
            return self.run(self.arguments(symbols, lambda x: x, lambda *q: ca.vertcat(*q)))
        return self.run(self.arguments(symbols, from_sx, lambda *q: np.array([from_sx(x) for x in q], object)))

    def run(self, arguments: Mapping[str, Any]) -> Any:
        """Call the function and return its result; an operation that gives NaN or infinity raises an error."""
        try:
            with warnings.catch_warnings(), np.errstate(invalid="raise", divide="raise"):
                warnings.simplefilter("error", FutureWarning)  # CasADi warns about NumPy functions
                with contained(self.function):
                    return self.function(**arguments)
        except (KinematicsError, ProgramEndError):
            raise
        except Exception as error:
            raise self.located(error) from error

    def _leave(self, value: Any, name: str) -> ca.SX:
        """Return an output as SX: a scalar, a column of three, or a pose."""
        shape = {"inverse": (1, 1), "points": (3, 1), "forward": (4, 4)}[self.name]
        what = {"inverse": "a number", "points": "three numbers", "forward": "a pose (4, 4)"}[self.name]
        try:
            out = to_sx(value)
        except (TypeError, ValueError, NotImplementedError) as error:
            raise self.error(f"{self.name}(): '{name}' is {type(value).__name__}, not {what}") from error
        if shape == (3, 1) and out.shape == (1, 3):
            out = out.T
        if out.shape != shape:
            found = np.shape(value) if isinstance(value, np.ndarray) else out.shape
            raise self.error(f"{self.name}(): '{name}' has shape {found}; it must be {what}")
        return out


def _split(value: Any) -> list[Any] | None:
    if isinstance(value, ca.SX | ca.DM) and 1 in value.shape and value.numel() > 1:
        return ca.vertsplit(ca.vec(value))
    return entries(value)


def _of_casadi(value: Any) -> bool:
    name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None) or ""
    return name.split(".")[0] == "casadi"


def _arguments(function: FunctionType) -> tuple[str, ...]:
    code = function.__code__
    return code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]


def _coordinates(taken: set[str], asked: set[str]) -> Coordinates:
    """Return the coordinates: position, and either Rz Ry Rx angles (if a function uses them) or a rotation vector.

    A rotation vector describes every orientation; the angles are singular at theta = ±90 deg.
    """
    angles = ("psi", "theta", "phi")
    if set(angles) & asked - taken:
        names, turned, back = angles, symbolic.rotation_zyx, symbolic.angles_zyx
    else:
        names, turned, back = ("rx", "ry", "rz"), _rotation, _vector
    clear = tuple(f"tool_{n}" if n in taken else n for n in ("x", "y", "z", *names))
    return Coordinates(
        clear,
        ("m", "m", "m", "rad", "rad", "rad"),
        lambda *c: symbolic.pose(turned(*c[3:]), ca.vertcat(*c[:3])),
        lambda T: (T[0, 3], T[1, 3], T[2, 3], *back(T)),
    )


def _rotation(x: Any, y: Any, z: Any) -> Any:
    return symbolic.exp_so3(ca.vertcat(x, y, z))


def _vector(T: Any) -> tuple[Any, Any, Any]:
    w = symbolic.log_so3(T[0:3, 0:3])
    return w[0], w[1], w[2]


def _parameters(module: ModuleType, path: Path) -> tuple[Parameter, ...]:
    given = getattr(module, "PARAMETERS", {})
    if not isinstance(given, Mapping):
        raise KinematicsError(
            f"{path}:{_line_of(module, path, 'PARAMETERS')}: PARAMETERS must be a dictionary by name, "
            'as in {"l1": mm(135)}.'
        )
    out = []
    for name, value in given.items():
        place = f"{path}:{_line_of(module, path, 'PARAMETERS', name)}: PARAMETERS['{name}']"
        if not isinstance(name, str) or not name.isidentifier():
            raise KinematicsError(f"{place}: a parameter's name must be a valid argument name of a function.")
        if isinstance(value, int | float):
            raise KinematicsError(
                f"{place} = {value} has no unit: write mm({value}), m({value}), deg({value}), rad({value}) or "
                f"number({value}), with `from twin.formula import mm, ...`."
            )
        if not isinstance(value, Parameter):
            raise KinematicsError(f"{place} is {type(value).__name__}, not a number with a unit, as in mm(135).")
        if not np.isfinite(value.value):
            raise KinematicsError(f"{place} is {value.value}; the value must be a finite number.")
        out.append(replace(value, name=name))
    return tuple(out)


def _line_of(module: ModuleType, path: Path, name: str, key: str | None = None) -> int:
    """Return the line of a module's variable or function; with `key`, the line of this key in the dictionary `name`."""
    for node in ast.parse(text_of(path, vars(module))).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if getattr(node, "name", None) == name or any(getattr(t, "id", None) == name for t in targets):
            if key is not None and isinstance(value := getattr(node, "value", None), ast.Dict):
                for k in value.keys:
                    if isinstance(k, ast.Constant) and k.value == key:
                        return k.lineno
            return getattr(node, "lineno", 1)
    return 1


def _length_scale(parameters: Sequence[Parameter]) -> Any:
    """Return the characteristic length as a function of the parameters: the median of all lengths."""
    lengths = sorted(abs(p.value) for p in parameters if p.unit in ("mm", "m") and p.value)
    scale = lengths[len(lengths) // 2] if lengths else _LENGTH
    return lambda: scale


def _equation(row: _Rows, stage: Stage, title: str, path: Path) -> Equation:
    at = f"{path.name}, line {row.line}"
    return Equation(row.name, title, at, stage, row.outputs, {"written": row}, {"written": at}, "written")


def _seeds(coordinates: Coordinates, home: tuple[Array, Array | None] | None, inverse: bool) -> tuple:
    if home is None:
        return ()
    T, q = home
    if not inverse:
        return () if q is None else (tuple(map(float, q)),)
    return (tuple(float(x) for x in coordinates.from_pose(ca.DM(T))),)


def _symbols(parameters: Sequence[Parameter], joints: Sequence[str], coordinates: Coordinates) -> dict[str, Any]:
    out: dict[str, Any] = {p.name: p.value for p in parameters}
    out |= {n: ca.SX.sym(n) for n in (*coordinates.names, *joints)}
    return out | {POSE_SYMBOL: ca.SX.sym(POSE, 4, 4)}


def _point_names(
    points: _Rows, parameters: Sequence[Parameter], joints: Sequence[str], coordinates: Coordinates
) -> tuple[str, ...]:
    value = points.on_symbols(_symbols(parameters, joints, coordinates))
    if not isinstance(value, Mapping) or not all(isinstance(k, str) for k in value):
        raise points.error(f"points() must return a dictionary of named points, not {type(value).__name__}")
    return tuple(value)


def _on_numbers(rows: Sequence[_Rows], coordinates: Coordinates) -> Any:
    """Return a function that finds the first line of source whose result is NaN or infinite; None if `rows` is empty.

    The function takes a pose (4, 4) and the parameters. It returns a text with file, line and cause, or "" if there is
    no such line.
    """

    def first(T: Array, parameters: Mapping[str, float]) -> str:
        symbols: dict[str, Any] = {**parameters, POSE_SYMBOL: T}
        symbols |= zip(coordinates.names, (float(x) for x in coordinates.from_pose(ca.DM(T))), strict=True)
        try:
            for row in rows:
                if row.casadi:
                    return ""  # CasADi functions return NaN without an error
                value = row.run(row.arguments(symbols, lambda x: x, lambda *q: np.array(q)))
                symbols |= zip(row.outputs, row.spread(value, entries), strict=True)
        except KinematicsError as error:
            return str(error)
        return ""

    return first if rows else None


def _try(formula: Formula, rows: Sequence[_Rows]) -> None:
    """Run every function on symbols.

    Raises:
        KinematicsError: a function fails, or an output is NaN at every pose; the message gives file and line.
    """
    symbols = _symbols(formula.parameters, [j.name for j in formula.joints], formula.coordinates)
    symbols |= {n: ca.SX.sym(n, 3) for n in formula.points}
    for row in rows:
        wanted = inspect.signature(row).parameters
        for name, value in zip(row.outputs, row(**{n: symbols[n] for n in wanted}), strict=True):
            if _has_nan(value):
                raise row.error(f"{row.name}(): '{name}' is nan at every pose, because one of its constants is nan")


def _has_nan(value: ca.SX) -> bool:
    """Return whether an expression contains a NaN constant, so that its value is always NaN."""
    f = ca.Function("f", ca.symvar(value), [value])
    constants = (i for i in range(f.n_instructions()) if f.instruction_id(i) == ca.OP_CONST)
    return any(np.isnan(f.instruction_constant(i)) for i in constants)
