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
        return np.array([p.value for p in self.parameters])

    def compiled(self) -> Callable[[Array, Array], Terms]:
        """Return the function (q (n,), qd (n,)) -> `Terms`."""
        import casadi as ca  # imported here, because it takes long

        n = len(self.joints)
        k = len(self.parameters)
        q = ca.SX.sym("q", n)
        qd = ca.SX.sym("qd", n)
        p = ca.SX.sym("p", k)
        parameters = {parameter.name: p[i] for i, parameter in enumerate(self.parameters)}
        M, C, g = self.terms(q, qd, parameters)
        M_column = ca.reshape(M, n * n, 1)  # column by column
        change = ca.reshape(ca.jtimes(M_column, q, qd), n, n)
        share = ca.jacobian(ca.vertcat(M_column, g), p)
        f = ca.Function("terms", [q, qd, p], [M, C, g, change, share])
        values = self.values

        def evaluate(at: Array, rates: Array) -> Terms:
            M, C, g, change, share = (np.array(x, float) for x in f(at, rates, values))
            M_share = share[: n * n].reshape(n, n, k, order="F")
            g_share = share[n * n :]
            return Terms(M=M, C=C, g=g.reshape(-1), change=change, M_share=M_share, g_share=g_share)

        return evaluate


@dataclass(frozen=True)
class Terms:
    """Values of the terms of `ClosedForm` in one state.

    Attributes:
        M: (n, n) mass matrix.
        C: (n, n) matrix of the Coriolis and centrifugal efforts, C qd.
        g: (n,) efforts of gravity.
        change: (n, n) dM/dt.
        M_share: (n, n, k) derivatives of M with respect to the k parameters.
        g_share: (n, k) derivatives of g with respect to the k parameters.
    """

    M: Array
    C: Array
    g: Array
    change: Array
    M_share: Array
    g_share: Array
