"""Convert a plain formula file (`inverse(pose)`, `forward(q)` or both, in NumPy or CasADi) to a `Formula`.

The functions are run once on symbols when the file is loaded, so that errors are reported early, with file and line.
"""

from __future__ import annotations

import ast
import inspect
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import FunctionType, ModuleType

import casadi as ca
import numpy as np

from twin.core.errors import KinematicsError
from twin.core.program_end import ProgramEndError, contained
from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula import symbolic
from twin.formula.contract import POSE_SYMBOL, ActiveJoint, Coordinates, Equation, Formula, Stage
from twin.formula.lift import lifted_globals
from twin.formula.loader import text_of
from twin.formula.plain_function import POSE, PlainRows, entries
from twin.formula.scalar import Value
from twin.formula.symbol import from_sx, to_sx

FUNCTIONS = ("inverse", "forward", "points")
"""Names of the functions of a plain formula that twin calls."""

_OUTPUTS = {
    "inverse": ((1, 1), "a number"),
    "points": ((3, 1), "three numbers"),
    "forward": ((4, 4), "a pose (4, 4)"),
}
"""Shape of each output in CasADi, and the shape in words, by kind of function."""

_DEFAULT_LENGTH = 0.1
"""Characteristic length in m of a formula whose parameters include no length."""


def is_plain(module: ModuleType) -> bool:
    """Return whether a module is a plain formula (has functions `inverse` or `forward`, no FORMULA)."""
    return hasattr(module, "inverse") or hasattr(module, "forward")


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
    first_line = text.splitlines()[0].strip(" .")
    values = vars(module)
    casadi = any(map(_of_casadi, values.values()))
    functions = values
    if not casadi:
        functions = lifted_globals(values)
    parameters = _parameters(module, path)
    parameter_names = [parameter.name for parameter in parameters]
    joint_names = [joint for joint, _ in joints]
    argument_names = _names_of_arguments(functions)
    coordinates = _coordinates({*joint_names, *parameter_names}, argument_names)
    symbol_names = [*coordinates.names, *parameter_names]
    unread = []
    for parameter_name in parameter_names:
        if parameter_name not in argument_names:
            unread.append(parameter_name)

    def rows(kind: str, points: Sequence[str] = ()) -> _Rows | None:
        """Return the function of a kind, which may use the named points; None if the module does not have it."""
        value = values.get(kind)
        if value is None:
            return None
        if not isinstance(value, FunctionType):
            line = _line_of(module, path, kind)
            raise KinematicsError(f"{path}:{line}: {kind} must be a function, not {type(value).__name__}.")
        return _Rows(kind, path, functions[kind], joint_names, [*symbol_names, *points], POSE_SYMBOL, casadi, unread)

    points = rows("points")
    point_names: tuple[str, ...] = ()
    if points is not None:
        point_names = _point_names(points, parameters, joint_names, coordinates)
        points.outputs = point_names
    inverse = rows("inverse", point_names)
    forward = rows("forward")
    # whether inverse() uses named points, which points() must then compute from the pose
    points_first = inverse is not None and bool(set(point_names) & set(inverse.argument_names))
    if points is not None and points_first and set(joint_names) & set(inspect.signature(points).parameters):
        text = "inverse() cannot use the named points, because points() computes them from the joints"
        raise points.error(text, points.line)
    before_joints = [inverse]
    if points_first:
        before_joints = [points, inverse]
    formula = Formula(
        name=name,
        title=str(values.get("TITLE", first_line)),
        source=str(values.get("SOURCE", path.name)),
        parameters=parameters,
        joints=_active_joints(joints),
        coordinates=coordinates,
        equations=_equations(points, inverse, forward, joints=joint_names, points_first=points_first, path=path),
        characteristic_length=_length_scale(parameters),
        points=dict(zip(point_names, point_names, strict=True)),
        seeds=_seeds(coordinates, home, inverse is not None),
        first_fault=_first_fault_finder(_existing_functions(before_joints), coordinates),
    )
    _check_on_symbols(formula, _existing_functions((points, inverse, forward)))
    return formula


def _active_joints(joints: Sequence[tuple[str, bool]]) -> tuple[ActiveJoint, ...]:
    """Return the active joints, from (name, whether the coordinate is an angle) of each."""
    active_joints = []
    for name, is_angle in joints:
        active_joints.append(ActiveJoint(name, "revolute" if is_angle else "prismatic"))
    return tuple(active_joints)


def _existing_functions(rows: Sequence[_Rows | None]) -> list[_Rows]:
    """Return the functions that the file has."""
    present_rows = []
    for row in rows:
        if row is not None:
            present_rows.append(row)
    return present_rows


def _equations(
    points: _Rows | None,
    inverse: _Rows | None,
    forward: _Rows | None,
    joints: Sequence[str],
    points_first: bool,
    path: Path,
) -> tuple[Equation, ...]:
    """Return the equations in execution order; points come first if the inverse uses them, else last."""
    equations = []
    if inverse is not None:
        inverse.outputs = tuple(joints)
        title = "points -> joints" if points_first else "pose -> joints"
        equations.append(_equation(inverse, "inverse", title, path))
    if forward is not None:
        forward.outputs = (POSE_SYMBOL,)
        equations.append(_equation(forward, "forward", "joints -> pose", path))
    if points is not None and points_first:
        # `run` evaluates the equations in this order
        equations.insert(0, _equation(points, "inverse", "named points", path))
    elif points is not None:
        equations.append(_equation(points, "helper", "named points", path))
    return tuple(equations)


class _Rows(PlainRows):
    """A plain function that can be called with CasADi symbols."""

    def __call__(self, **symbols: Value) -> tuple[ca.SX, ...]:
        """Return the outputs as a tuple of SX.

        Raises:
            KinematicsError: the function fails, or an output has a wrong shape; the message gives file and line.
        """
        values = self.spread(self.on_symbols(symbols), _split)
        outputs = []
        for value, name in zip(values, self.outputs, strict=True):
            outputs.append(self._output(value, name))
        return tuple(outputs)

    def on_symbols(self, symbols: Mapping[str, Value]) -> object:
        """Return the result of the function for CasADi symbols {name: symbol}."""
        if self.casadi:
            arguments = self.arguments(symbols, lambda x: x, lambda *q: ca.vertcat(*q))
        else:
            arguments = self.arguments(symbols, from_sx, _array_of_symbols)
        return self.run(arguments)

    def run(self, arguments: Mapping[str, Value]) -> object:
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

    def _output(self, value: object, name: str) -> ca.SX:
        """Return an output as SX: a scalar, a column of three, or a pose."""
        shape, what = _OUTPUTS[self.name]
        try:
            expression = to_sx(value)
        except (TypeError, ValueError, NotImplementedError) as error:
            raise self.error(f"{self.name}(): '{name}' is {type(value).__name__}, not {what}") from error
        if shape == (3, 1) and expression.shape == (1, 3):
            expression = expression.T
        if expression.shape != shape:
            shape_found = expression.shape
            if isinstance(value, np.ndarray):
                shape_found = value.shape  # what the author wrote; shapes in CasADi have two dimensions
            raise self.error(f"{self.name}(): '{name}' has shape {shape_found}; it must be {what}")
        return expression


def _array_of_symbols(*q: symbolic.SX) -> np.ndarray:
    """Return an array (n,) of objects for CasADi symbols."""
    return np.array([from_sx(x) for x in q], object)


def _split(value: object) -> list[Value] | None:
    """Return the entries of a row or a column of CasADi, or of an array with one dimension; None: another value."""
    if isinstance(value, ca.SX | ca.DM) and 1 in value.shape and value.numel() > 1:
        return ca.vertsplit(ca.vec(value))
    return entries(value)


def _of_casadi(value: object) -> bool:
    """Return whether a global name of a file is CasADi, or something of CasADi."""
    if isinstance(value, ModuleType):
        module = value.__name__
    else:
        module = getattr(value, "__module__", None) or ""
    package, _, _ = module.partition(".")
    return package == "casadi"


def _names_of_arguments(functions: Mapping[str, object]) -> set[str]:
    """Return the names of all arguments of the functions of a plain formula."""
    names: set[str] = set()
    for kind in FUNCTIONS:
        function = functions.get(kind)
        if isinstance(function, FunctionType):
            code = function.__code__
            names.update(code.co_varnames[: code.co_argcount + code.co_kwonlyargcount])
    return names


def _coordinates(taken_names: set[str], used_names: set[str]) -> Coordinates:
    """Return the coordinates: position, and either Rz Ry Rx angles (if a function uses them) or a rotation vector.

    A rotation vector describes every orientation; the angles are singular at theta = ±90 deg. A coordinate whose name
    is taken by a joint or a parameter gets the prefix "tool_".
    """
    orientation = ("psi", "theta", "phi")
    rotation_of = symbolic.rotation_zyx
    orientation_of = symbolic.angles_zyx
    if not set(orientation) & used_names - taken_names:
        orientation = ("rx", "ry", "rz")
        rotation_of = _rotation
        orientation_of = _rotation_vector
    names = []
    for name in ("x", "y", "z", *orientation):
        names.append(f"tool_{name}" if name in taken_names else name)

    def to_pose(x: symbolic.SX, y: symbolic.SX, z: symbolic.SX, *angles: symbolic.SX) -> symbolic.SX:
        return symbolic.pose(rotation_of(*angles), ca.vertcat(x, y, z))

    def from_pose(T: symbolic.SX) -> tuple[symbolic.SX, ...]:
        return T[0, 3], T[1, 3], T[2, 3], *orientation_of(T)

    return Coordinates(tuple(names), ("m", "m", "m", "rad", "rad", "rad"), to_pose, from_pose)


def _rotation(x: symbolic.SX, y: symbolic.SX, z: symbolic.SX) -> symbolic.SX:
    """Return the rotation (3, 3) of a rotation vector in rad."""
    return symbolic.exp_so3(ca.vertcat(x, y, z))


def _rotation_vector(T: symbolic.SX) -> tuple[symbolic.SX, symbolic.SX, symbolic.SX]:
    """Return the rotation vector in rad of a pose (4, 4)."""
    rotation_vector = symbolic.log_so3(T[0:3, 0:3])
    return rotation_vector[0], rotation_vector[1], rotation_vector[2]


def _parameters(module: ModuleType, path: Path) -> tuple[Parameter, ...]:
    """Return the parameters of a module, with their names.

    Raises:
        KinematicsError: `PARAMETERS` is not a dictionary of numbers with units; the message gives file and line.
    """
    parameters_written = getattr(module, "PARAMETERS", {})
    if not isinstance(parameters_written, Mapping):
        line = _line_of(module, path, "PARAMETERS")
        raise KinematicsError(f'{path}:{line}: PARAMETERS must be a dictionary by name, as in {{"l1": mm(135)}}.')
    parameters = []
    for name, value in parameters_written.items():
        line = _line_of(module, path, "PARAMETERS", name)
        place = f"{path}:{line}: PARAMETERS['{name}']"
        if not isinstance(name, str) or not name.isidentifier():
            raise KinematicsError(f"{place}: a parameter's name must be a valid argument name of a function.")
        if isinstance(value, int | float):  # a plain number, as authors write first
            raise KinematicsError(
                f"{place} = {value} has no unit: write mm({value}), m({value}), deg({value}), rad({value}) or "
                f"number({value}), with `from twin.formula import mm, ...`."
            )
        if not isinstance(value, Parameter):
            raise KinematicsError(f"{place} is {type(value).__name__}, not a number with a unit, as in mm(135).")
        if not np.isfinite(value.value):
            raise KinematicsError(f"{place} is {value.value}; the value must be a finite number.")
        parameters.append(replace(value, name=name))
    return tuple(parameters)


def _line_of(module: ModuleType, path: Path, name: str, key: str | None = None) -> int:
    """Return the line of a module's variable or function; with `key`, the line of this key in the dictionary `name`."""
    for node in ast.parse(text_of(path, vars(module))).body:
        # a definition has a name; an assignment has several targets, or one if it is annotated
        names = [getattr(node, "name", None)]
        targets = [getattr(node, "target", None)]
        if isinstance(node, ast.Assign):
            targets = node.targets
        for target in targets:
            names.append(getattr(target, "id", None))
        if name not in names:
            continue
        value = getattr(node, "value", None)
        if key is not None and isinstance(value, ast.Dict):
            for entry in value.keys:
                if isinstance(entry, ast.Constant) and entry.value == key:
                    return entry.lineno
        return node.lineno
    return 1


def _length_scale(parameters: Sequence[Parameter]) -> Callable[[], float]:
    """Return the characteristic length as a function of the parameters: the median of all lengths."""
    lengths: list[float] = []
    for parameter in parameters:
        if parameter.unit in ("mm", "m") and parameter.value:
            lengths.append(abs(parameter.value))
    lengths.sort()
    scale = _DEFAULT_LENGTH
    if lengths:
        scale = lengths[len(lengths) // 2]
    return lambda: scale


def _equation(row: _Rows, stage: Stage, title: str, path: Path) -> Equation:
    """Return a plain function as an equation with one variant, "written"."""
    source = f"{path.name}, line {row.line}"
    return Equation(
        row.name,
        title,
        source=source,
        stage=stage,
        outputs=row.outputs,
        variants={"written": row},
        reasons={"written": source},
        default="written",
    )


def _seeds(
    coordinates: Coordinates, home: tuple[Array, Array | None] | None, inverse: bool
) -> tuple[tuple[float, ...], ...]:
    """Return the start of the solvers: coordinates with an inverse, joints without; empty if it is not known."""
    if home is None:
        return ()
    T, q = home
    if inverse:
        return (_numbers_of_pose(coordinates, T),)
    if q is None:
        return ()
    return (tuple(np.asarray(q, float).tolist()),)


def _numbers_of_pose(coordinates: Coordinates, T: Array) -> tuple[float, ...]:
    """Return the coordinates of a pose (4, 4) as numbers in m and rad."""
    return tuple(map(float, coordinates.from_pose(ca.DM(T))))


def _symbols(parameters: Sequence[Parameter], joints: Sequence[str], coordinates: Coordinates) -> dict[str, Value]:
    """Return the values of the parameters, and CasADi symbols for coordinates, joints and pose."""
    symbols: dict[str, Value] = {parameter.name: parameter.value for parameter in parameters}
    for name in (*coordinates.names, *joints):
        symbols[name] = ca.SX.sym(name)
    symbols[POSE_SYMBOL] = ca.SX.sym(POSE, 4, 4)
    return symbols


def _point_names(
    points: _Rows, parameters: Sequence[Parameter], joints: Sequence[str], coordinates: Coordinates
) -> tuple[str, ...]:
    """Return the names of the points in the dictionary that points() returns."""
    value = points.on_symbols(_symbols(parameters, joints, coordinates))
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise points.error(f"points() must return a dictionary of named points, not {type(value).__name__}")
    return tuple(value)


def _first_fault_finder(
    rows: Sequence[_Rows], coordinates: Coordinates
) -> Callable[[Array, Mapping[str, float]], str] | None:
    """Return a function that finds the first line of source whose result is NaN or infinite; None if `rows` is empty.

    The function takes a pose (4, 4) and the parameters. It returns a text with file, line and cause, or "" if there is
    no such line.
    """
    if not rows:
        return None

    def first_fault(T: Array, parameters: Mapping[str, float]) -> str:
        symbols: dict[str, Value] = {**parameters, POSE_SYMBOL: T}
        symbols |= zip(coordinates.names, _numbers_of_pose(coordinates, T), strict=True)
        try:
            for row in rows:
                if row.casadi:
                    return ""  # CasADi functions return NaN without an error
                value = row.run(row.arguments(symbols, lambda x: x, lambda *q: np.array(q)))
                symbols |= zip(row.outputs, row.spread(value, entries), strict=True)
        except KinematicsError as error:
            return str(error)
        return ""

    return first_fault


def _check_on_symbols(formula: Formula, rows: Sequence[_Rows]) -> None:
    """Run every function on symbols.

    Raises:
        KinematicsError: a function fails, or an output is NaN at every pose; the message gives file and line.
    """
    joint_names = [joint.name for joint in formula.joints]
    symbols = _symbols(formula.parameters, joint_names, formula.coordinates)
    for point in formula.points:
        symbols[point] = ca.SX.sym(point, 3)
    for row in rows:
        arguments: dict[str, Value] = {}
        for name in inspect.signature(row).parameters:
            arguments[name] = symbols[name]
        values = row(**arguments)
        for name, value in zip(row.outputs, values, strict=True):
            if _has_nan(value):
                raise row.error(f"{row.name}(): '{name}' is nan at every pose, because one of its constants is nan")


def _has_nan(value: ca.SX) -> bool:
    """Return whether an expression contains a NaN constant, so that its value is always NaN."""
    function = ca.Function("f", ca.symvar(value), [value])
    for i in range(function.n_instructions()):
        if function.instruction_id(i) == ca.OP_CONST and np.isnan(function.instruction_constant(i)):
            return True
    return False
