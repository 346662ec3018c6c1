"""Time-optimal motion along a path by the package toppra (H. Pham, Q.-C. Pham), as an independent solver.

`topp` solves the same problem with code of our own. A plan is timed by either (`--timing`), and the timing of a plan by
the passes is judged by toppra (`validation.retiming`).
"""

from __future__ import annotations

import contextlib
import logging
import sys
import warnings
from collections.abc import Iterator
from types import ModuleType

import numpy as np

from twin.core.errors import TimingError
from twin.core.spatial import Array


class _Path:
    """A path with the interface of TOPP-RA, which evaluates paths at grid points only.

    Attributes:
        path_interval: (2,) first and last path parameter.
        dof: number of coordinates.
    """

    def __init__(self, grid: Array, first: Array, second: Array) -> None:
        self.path_interval = np.array([grid[0], grid[-1]])
        self.dof = first.shape[1]
        # Limits of speed and acceleration need the derivatives only: the values of the path may be anything.
        self._tables = (np.zeros_like(first), first, second)

    def __call__(self, s: Array, order: int = 0) -> Array:
        if len(s) != len(self._tables[order]):
            raise TimingError("TOPP-RA asked for values of the path between the grid points, where they are not known")
        return self._tables[order]


def fastest(grid: Array, first: Array, second: Array, speed: Array) -> Array:
    """Return ds/dt as `topp.fastest` does for the same arguments, computed by the package toppra.

    Raises:
        TimingError: toppra finds no timing.
    """
    algorithm, constraint = package()
    with _quiet():
        limits = [
            constraint.JointVelocityConstraint(np.array([-1.0, 1.0]) * speed[:, None]),
            constraint.JointAccelerationConstraint(
                np.tile([-1.0, 1.0], (len(first), 1)),
                # As in `topp`: the limits hold at both ends of each interval, not at its beginning alone.
                discretization_scheme=constraint.DiscretizationType.Interpolation,
            ),
        ]
        instance = algorithm.TOPPRA(
            limits,
            _Path(grid, first.T, second.T),
            gridpoints=grid,
            solver_wrapper="seidel",
            parametrizer="ParametrizeConstAccel",
        )
        rates = instance.compute_parameterization(0.0, 0.0)[1]
    if rates is None or not np.all(np.isfinite(rates)):
        code = instance.problem_data.return_code
        raise TimingError(f"the solver returned {getattr(code, 'value', code)}")
    return np.asarray(rates)


def package() -> tuple[ModuleType, ModuleType]:
    """Return the modules `algorithm` and `constraint` of TOPP-RA, imported only here: the import takes seconds.

    TOPP-RA also imports pyplot for figures that are not used; replacing it by an empty module saves two seconds. So it
    needs no matplotlib.
    """
    absent = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    for name in absent:
        sys.modules[name] = ModuleType(name)
    try:
        with _quiet():
            from toppra import algorithm, constraint
    finally:
        for name in absent:
            del sys.modules[name]
    return algorithm, constraint


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Suppress TOPP-RA's warnings: failures are raised as errors, and results are checked."""
    logger = logging.getLogger("toppra")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
