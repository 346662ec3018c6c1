"""Published equations of motion for some joints of a robot: M(q) qdd + C(q, qd) qd + g(q) = efforts of these joints.

All terms are linear in the inertial parameters, as for any rigid bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from twin.core.provenance import Parameter
from twin.core.spatial import Array
from twin.formula.scalar import Value


@dataclass(frozen=True)
class ClosedForm:
    """Equations of motion of n joints; all other joints are at zero and at rest.

    Attributes:
        source: document and equation.
        joints: names of the n joints, in the order of q.
        parameters: inertial parameters, with provenance.
        tolerance: largest error that the rounding of the parameters can cause in a term, in the SI unit of the term.
        terms: function of symbols (q (n,), qd (n,), {parameter: value}) that returns M (n, n), C (n, n) and g (n,).
    """

    source: str
    joints: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    tolerance: float
    terms: Callable[[Value, Value, Mapping[str, Value]], tuple[Value, Value, Value]]

    @property
    def values(self) -> Array:
        """Values of the parameters (k,) in SI."""
        return np.array([parameter.value for parameter in self.parameters])

    def compiled(self) -> Callable[[Array, Array], Terms]:
        """Return the function (q (n,), qd (n,)) -> `Terms`."""
        import casadi as ca  # imported here, because it takes long

        joint_count = len(self.joints)
        parameter_count = len(self.parameters)
        q = ca.SX.sym("q", joint_count)
        qd = ca.SX.sym("qd", joint_count)
        parameter_symbols = ca.SX.sym("p", parameter_count)
        parameters: dict[str, Value] = {}
        for i, parameter in enumerate(self.parameters):
            parameters[parameter.name] = parameter_symbols[i]
        M, C, g = self.terms(q, qd, parameters)
        M_column = ca.reshape(M, joint_count * joint_count, 1)  # CasADi stacks columns: order="F" below
        M_rate = ca.reshape(ca.jtimes(M_column, q, qd), joint_count, joint_count)
        derivatives = ca.jacobian(ca.vertcat(M_column, g), parameter_symbols)
        function = ca.Function("terms", [q, qd, parameter_symbols], [M, C, g, M_rate, derivatives])
        values = self.values

        def evaluate(q_values: Array, qd_values: Array) -> Terms:
            results = function(q_values, qd_values, values)
            M, C, g, M_rate, derivatives = map(_array, results)
            M_entries = joint_count * joint_count
            M_by_parameters = derivatives[:M_entries].reshape(joint_count, joint_count, parameter_count, order="F")
            return Terms(
                M=M,
                C=C,
                g=g.reshape(-1),
                M_rate=M_rate,
                M_by_parameters=M_by_parameters,
                g_by_parameters=derivatives[M_entries:],
            )

        return evaluate


def _array(result: object) -> Array:
    """Return a result of CasADi, always a matrix, as an array of floats."""
    return np.array(result, float)


@dataclass(frozen=True)
class Terms:
    """Values of the terms of `ClosedForm` in one state.

    Attributes:
        M: (n, n) mass matrix.
        C: (n, n) matrix of the Coriolis and centrifugal efforts, C qd.
        g: (n,) efforts of gravity.
        M_rate: (n, n) dM/dt.
        M_by_parameters: (n, n, k) derivatives of M with respect to the k parameters.
        g_by_parameters: (n, k) derivatives of g with respect to the k parameters.
    """

    M: Array
    C: Array
    g: Array
    M_rate: Array
    M_by_parameters: Array
    g_by_parameters: Array
