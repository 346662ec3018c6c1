"""Proofs along a timed path: bounds contain the path at random times, defects between samples are found."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import twin
from twin.api.motion_proof import ProvedClearance, ProvedMotion, _clearance_findings, prove_motion, timed_path
from twin.api.path_samples import SampledPath, sampled
from twin.core.errors import ProtocolError, TwinError
from twin.model.mechanism import Mechanism
from twin.planning.trajectory import Trajectory
from twin.proof.motion import motion_prover
from twin.proof.motion.enclosure import Enclosure
from twin.proof.motion.motion_claims import EnclosedPieces, MotionClaim, MotionProof, motion_proof
from twin.proof.motion.path import TimedPath
from twin.proof.motion.pieces import first_pieces
from twin.proof.motion.prediction import chebyshev_nodes
from twin.proof.motion.quantities import _motor_rows
from twin.proof.motion.series import on_pieces
from twin.proof.motion.taylor import TaylorModel
from twin.proof.motion.time_cells import TimeCells, cells_of
from twin.reference import ReferenceModel

flint = pytest.importorskip("flint", reason="python-flint is in the group dev")


@cache
def planned(robot: str, protocol: str) -> tuple[Mechanism, Trajectory, TimedPath]:
    """Return mechanism, trajectory and timed path of a protocol."""
    loaded = twin.load(robot)
    read = loaded.protocol(protocol)
    bound = loaded.bound(read)
    trajectory = twin.plan(bound, read)
    frame = bound.mechanism.frame_in_tool(trajectory.frame)
    return bound.mechanism, trajectory, timed_path(trajectory, read, bound.path_kinematics(), frame)


def proved(mechanism: Mechanism, path: TimedPath) -> MotionProof:
    """Return the proof of a path."""
    model = ReferenceModel(mechanism)
    return motion_prover.prove_motion(mechanism, path, lambda q: model.link_poses(model.run(q).x))


def claim(proof: MotionProof, group: str, name: str) -> MotionClaim:
    """Return a claim by its group and name."""
    return next(c for c in proof.claims if (c.group, c.name) == (group, name))


def limited(mechanism: Mechanism, joint: str, **changes: object) -> Mechanism:
    """Return a mechanism in which a joint has other limits."""
    joints = []
    for old in mechanism.joints:
        joints.append(replace(old, **changes) if old.name == joint else old)
    return replace(mechanism, joints=tuple(joints))


def _fraction(x: float) -> Any:
    """Return a number exactly."""
    return flint.fmpq(*float(x).as_integer_ratio())


# ------------------------------------------------------------------------------------------- arithmetic


def test_taylor_models_contain_functions_at_random_places() -> None:
    """A composition of all operations is inside its bound at 320 random places, computed with 40 digits."""
    import mpmath

    generator = np.random.default_rng(1)
    mpmath.mp.dps = 40
    c = generator.normal(size=(6, 8)) * 0.1 ** np.arange(6)[:, None]
    a = TaylorModel(c, np.zeros(8))
    sine, cosine = a.sine_cosine()
    model = (sine * cosine + 2.0).root() - (cosine + 3.0).inverted() * a
    parts = model.on_parts(np.full(8, 0.25), np.full(8, 0.5))
    low, high = parts.range()
    for x in generator.uniform(-1, 1, 40).tolist():
        for i in range(8):
            for value, bound in ((x, None), (0.25 + 0.5 * x, (low[i], high[i]))):
                z = sum(mpmath.mpf(c[k, i]) * mpmath.mpf(value) ** k for k in range(6))
                exact = mpmath.sqrt(mpmath.sin(z) * mpmath.cos(z) + 2) - z / (mpmath.cos(z) + 3)
                polynomial = sum(mpmath.mpf(model.c[k, i]) * mpmath.mpf(value) ** k for k in range(6))
                assert abs(polynomial - exact) <= model.r[i]
                if bound is not None:
                    assert bound[0] <= exact <= bound[1]


def test_a_root_that_may_be_of_a_negative_number_is_unknown() -> None:
    """A function that reaches zero has no root and no reciprocal that is known."""
    crossing = TaylorModel(np.array([[0.5], [1.0], [0.0]]), np.zeros(1))
    assert np.isinf(crossing.root().r).all()
    assert np.isinf(crossing.inverted().r).all()


@pytest.mark.parametrize("degree", [1, 9, 60])
def test_pieces_of_a_series_contain_it(degree: int) -> None:
    """Series and derivative are inside their models, computed with 40 digits."""
    import mpmath

    generator = np.random.default_rng(degree)
    mpmath.mp.dps = 40
    series = generator.normal(size=degree + 1) * 10.0 ** (-0.2 * np.arange(degree + 1))
    middle = (np.arange(15) + 0.5) / 15
    half = np.full(15, 0.5 / 15)
    path, slope = on_pieces(series[:, None], middle, half, 5)
    for i in range(15):
        for x in generator.uniform(-1, 1, 3).tolist():
            s = mpmath.mpf(middle[i]) + mpmath.mpf(half[i]) * mpmath.mpf(x)
            argument = 2 * s - 1
            value = sum(mpmath.mpf(b) * mpmath.chebyt(k, argument) for k, b in enumerate(series.tolist()))
            rate = mpmath.mpf(0)
            for k, b in enumerate(series.tolist()[1:], 1):
                rate += 2 * k * mpmath.mpf(b) * mpmath.chebyu(k - 1, argument)
            for model, exact in ((path, value), (slope, rate)):
                polynomial = sum(mpmath.mpf(model.c[k, i, 0]) * mpmath.mpf(x) ** k for k in range(6))
                assert abs(polynomial - exact) <= model.r[i, 0]


def test_nodes_are_inside() -> None:
    """Predictions pass through states inside of the piece."""
    assert np.abs(chebyshev_nodes(5)).max() < 1


# ------------------------------------------------------------------------------------------- protocols


@pytest.mark.slow
def test_bounds_contain_1000_random_times_and_are_tight() -> None:
    """On a protocol of SILS, every value at 1000 times is within its bounds, which exceed it by at most a half."""
    mechanism, trajectory, path = planned("sils", "table2")
    proof = proved(mechanism, path)
    samples = sampled(ReferenceModel(mechanism), trajectory, path)
    assert len(samples.t) > 900
    assert {c.status for c in proof.claims} == {"proved"}
    for one in proof.claims:
        values = samples.values[one.group, one.name]
        curve = proof.curves[one.group, one.name]
        cell = np.clip(np.searchsorted(curve.t, samples.t, side="right") - 1, 0, len(curve.t) - 2)
        known = np.isfinite(values)
        # a sample at a border may be in the cell before or after; the plan's rates are rounded there
        low = np.minimum(curve.low[cell], curve.low[np.maximum(cell - 1, 0)]) - 1e-9
        high = np.maximum(curve.high[cell], curve.high[np.maximum(cell - 1, 0)]) + 1e-9
        assert (values[known] >= low[known]).all(), one
        assert (values[known] <= high[known]).all(), one
        extreme = values[known].min() if one.smallest else values[known].max()
        if one.smallest:
            assert extreme / 1.5 <= one.bound <= extreme + 1e-9, one
        else:
            assert extreme - 1e-9 <= one.bound <= max(1.5 * extreme, 1e-10), one


@cache
def sils() -> tuple[Mechanism, TimedPath]:
    """Return SILS with the first phase of a protocol, which is enough for most tests."""
    mechanism, _, path = planned("sils", "table2")
    return mechanism, replace(path, phases=path.phases[:1])


def wavy(low: float, high: float) -> TimedPath:
    """Return a path of PA-10 of one phase, whose first joint is `low` at s = 0, 0.1, ... 1 and `high` between these."""
    places = np.cos((np.arange(160) + 0.5) * np.pi / 160)
    wave = 0.5 * (low + high) + 0.5 * (low - high) * np.cos(20 * np.pi * 0.5 * (places + 1))
    series = np.polynomial.chebyshev.chebfit(places, wave, 140)
    coefficients = np.zeros((141, 7))
    coefficients[:, 0] = series
    grid = np.linspace(0.0, 1.0, 11)
    rates = np.full(11, 100.0)  # a phase of 10 ms: a sample of 1 kHz at each grid point
    rates[[0, -1]] = 0.0
    phase = replace(
        planned("pa10", "scan")[2].phases[0],
        coefficients=coefficients,
        grid=grid,
        rates=rates,
        start=0.0,
        duration=0.01,
    )
    return replace(planned("pa10", "scan")[2], phases=(phase,))


def test_a_limit_passed_between_two_samples_is_refuted() -> None:
    """A joint is 1e-6 rad within its limit at all samples, and 1e-6 rad beyond it between them: it is found."""
    mechanism, _, _ = planned("pa10", "scan")
    name = mechanism.active[0].name
    path = wavy(1.0 - 1e-6, 1.0 + 1e-6)
    at_samples = np.polynomial.chebyshev.chebval(np.linspace(-1, 1, 11), path.phases[0].coefficients[:, 0])
    assert at_samples.max() < 1.0 - 0.9e-6
    beyond = claim(proved(limited(mechanism, name, limits=(-2.0, 1.0)), path), "joint limit", name)
    assert beyond.status == "refuted"
    assert -1.1e-6 < beyond.low <= beyond.high < 0.0
    within = claim(proved(limited(mechanism, name, limits=(-2.0, 1.0 + 1.01e-6)), path), "joint limit", name)
    assert within.status == "proved"
    assert 0 < within.bound < 1.1e-8


@pytest.mark.slow
def test_a_speed_between_samples_counts() -> None:
    """A speed limit just below the fastest moment is refuted, one just above it is proved."""
    mechanism, _, _ = planned("pa10", "scan")
    name = mechanism.active[0].name
    path = wavy(0.5, 0.6)
    # 0.05 rad amplitude, 20 pi per unit of s, 100 units per second
    fastest = 0.05 * 20 * np.pi * 100
    for factor, status in ((0.997, "refuted"), (1.0, "proved")):
        changed = limited(mechanism, name, max_speed=factor * fastest)
        assert claim(proved(changed, path), "joint speed", name).status == status


def test_predictions_need_not_be_right() -> None:
    """Body poses that are wrong by a millimetre give the same bounds: the loops are closed by the proof itself."""
    mechanism, path = sils()
    model = ReferenceModel(mechanism)

    def wrong(q: np.ndarray) -> dict[str, np.ndarray]:
        poses = {name: T.copy() for name, T in model.link_poses(model.run(q).x).items()}
        for k, T in enumerate(poses.values()):
            T[:, k % 3, 3] += 1e-3
        return poses

    right = proved(mechanism, path)
    shifted = motion_prover.prove_motion(mechanism, path, wrong)
    for one, other in zip(right.claims, shifted.claims, strict=True):
        assert (one.name, one.group, one.status) == (other.name, other.group, "proved")
        assert one.bound == pytest.approx(other.bound, rel=1e-6, abs=1e-8)


@pytest.mark.slow
def test_loops_that_cannot_close_are_unproved() -> None:
    """If a bar is too short, no motion of the passive joints exists, and all that rests on it is unproved."""
    mechanism, path = sils()
    model = ReferenceModel(mechanism)
    loop = mechanism.loops[-1]
    T = loop.T_parent_joint.copy()
    T[:3, 3] += 2.0
    apart = replace(mechanism, joints=tuple(replace(j, T_parent_joint=T) if j is loop else j for j in mechanism.joints))
    proof = motion_prover.prove_motion(apart, path, lambda q: model.link_poses(model.run(q).x))
    assert claim(proof, "determinant", "loops").status == "unproved"
    assert claim(proof, "tool speed", "tip").status == "unproved"
    assert "no motion of the passive joints" in claim(proof, "loop gap", "loops").reason
    assert claim(proof, "joint limit", "q1").status == "proved"


def test_after_a_break_nothing_is_said_of_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the motion may jump to another assembly, all that rests on it is unproved, and never refuted."""
    mechanism, path = sils()
    monkeypatch.setattr(motion_prover, "MOST_HALVINGS", 0)
    whole = proved(mechanism, path)
    curve = whole.curves["determinant", "loops"]
    assert curve.low[0] < 1.0 < curve.high[0]  # the value at the start is known within bounds
    assert claim(whole, "passive limit", "s1").status == "proved"
    pieces = 15

    def broken(closed: object, linkage: object, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        goes_on = np.ones(pieces - 1, bool)
        goes_on[3] = False
        return goes_on

    monkeypatch.setattr(motion_prover, "connected", broken)
    for one in proved(mechanism, path).claims:
        if one.group in ("joint limit", "joint speed", "gap"):
            assert one.status == "proved", one
        else:
            assert one.status == "unproved", one
            assert "goes on in that of the piece before" in one.reason


def test_a_break_before_a_violation_hides_it() -> None:
    """A value beyond its limit counts before a break; after it, it is that of another assembly."""
    cells = 4
    high = np.array([1.0, 1.0, 5.0, 5.0])
    over = Enclosure("enforced", "RCM", "m", high - 0.5, high, 2.0, smallest=False)
    driven = replace(over, group="joint speed")
    index = np.arange(cells)
    pieces = first_pieces(1).chosen(index)
    span = np.linspace(0.0, 1.0, cells + 1)
    square = TaylorModel(np.zeros((2, cells)), np.zeros(cells))
    ones = np.ones(cells)
    made = TimeCells(index, 0 * index, span[:-1], span[1:], 0 * ones, ones, square)
    goes_on = np.array([True, False, True])
    judged = EnclosedPieces(pieces, made, [over, driven], np.ones(cells, bool), goes_on)
    _, path = sils()
    of_body, of_joint = motion_proof(path, judged).claims
    assert of_body.status == "unproved"
    assert of_joint.status == "refuted"


def test_cells_reach_their_grid_points() -> None:
    """A grid point just before the end of a piece begins a cell: (ds/dt)^2 is linear on each side of it only."""
    _, path = sils()
    edge = 1.0 / 15
    grid = np.array([0.0, edge - 3e-11, 1.0])
    rates = np.array([0.0, 1.0, 0.0])
    phase = replace(path.phases[0], grid=grid, rates=rates)
    cells = cells_of(first_pieces(1), (phase,), 5)
    assert grid[1] in cells.first
    low, high = cells.square.range()
    for k in range(len(cells.piece)):
        for s in np.linspace(cells.first[k], cells.last[k], 5):
            exact = np.interp(s, grid, rates**2)
            assert low[k] - 1e-15 <= exact <= high[k] + 1e-15
    for k in range(len(cells.piece) - 1):
        assert cells.middle[k] + cells.width[k] > -1


def test_rows_of_motors_contain_the_exact_inverse() -> None:
    """The inverse of a motor matrix, in exact fractions, is within the bounds of its rounded rows."""
    mechanism = twin.load("raven_left").mechanism
    rows, errors = _motor_rows(mechanism)
    exact = flint.fmpq_mat([[_fraction(x) for x in row] for row in mechanism.motor_matrix.tolist()]).inv()
    assert (mechanism.motor_matrix != np.eye(len(rows))).any()
    for i in range(len(rows)):
        for j in range(len(rows)):
            off = exact[i, j] - _fraction(rows[i, j])
            assert abs(off) <= _fraction(errors[i, j])
    assert errors.max() < 1e-10


def test_clearances_that_are_not_proved_are_findings() -> None:
    """Bodies that may touch, and a phase without a distance, change the verdict; nothing to compare is a note."""
    proof = MotionProof("p", (), {}, 0, 0, 1.0)
    touching = ProvedClearance("insert", 0.0, 1e-4, ("bar1", "bar2"))
    apart = ProvedClearance("sweep", 1e-3, 2e-3, ("bar1", "bar2"))
    samples = SampledPath(np.zeros(0), {})
    motion = ProvedMotion(proof, samples, (touching, apart), "", (), {"lift": "the loops do not close", "rest": ""})
    found = _clearance_findings(motion)
    assert [finding.code for finding in found] == ["prove.open", "prove.open", "prove.clearance"]
    assert [finding.severity for finding in found] == ["error", "error", "info"]
    assert "bar1 and bar2" in found[0].message
    assert "the loops do not close" in found[1].message


# ------------------------------------------------------------------------------------------- bad input


def test_a_path_with_nan_is_refused() -> None:
    """A coefficient that is no number is named with its phase."""
    mechanism, path = sils()
    broken = path.phases[0].coefficients.copy()
    broken[1, 0] = np.nan
    bad = replace(path, phases=(replace(path.phases[0], coefficients=broken),))
    with pytest.raises(ProtocolError, match=r"phase 'approach': the path has a value that is not a finite number"):
        proved(mechanism, bad)


def test_an_unknown_protocol_is_refused() -> None:
    """An unknown name is refused with the names that exist."""
    with pytest.raises(TwinError, match="table2"):
        prove_motion(twin.load("sils"), "tabel2", clearance=False)


def test_a_table_of_samples_is_refused() -> None:
    """Between the rows of a table nothing is known: the phase is named."""
    loaded = twin.load("sils")
    read = loaded.protocol("table2")
    _, trajectory, path = planned("sils", "table2")
    spans = (replace(trajectory.phases[0], curve=None), *trajectory.phases[1:])
    with pytest.raises(ProtocolError, match=r"phase 'approach' .* is a table of samples"):
        timed_path(replace(trajectory, phases=spans), read, loaded.path_kinematics(), path.T_tool_frame)


def test_a_sample_that_two_phases_share_counts_for_both() -> None:
    """Its speed is divided by the smaller limit, and the farther RCM counts; the first sample has one."""
    mechanism, path = sils()
    model = ReferenceModel(mechanism)
    assert mechanism.home is not None
    home = model.solve(mechanism.home).q
    count = 5
    still = np.zeros((count, 3))
    trajectory: Any = SimpleNamespace(
        t=np.arange(count) * 1e-3,
        q=np.tile(home, (count, 1)),
        qd=np.zeros((count, len(home))),
        tip_velocity=still + np.array([0.01, 0.0, 0.0]),
        angular_velocity=still,
        phases=(SimpleNamespace(start=0, stop=2), SimpleNamespace(start=2, stop=4)),
    )
    T_base_tip = model.solve(home).T_base_tool @ path.T_tool_frame
    axis = T_base_tip[:3, :3] @ path.shaft_axis
    across = np.cross(axis, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    phases = []
    for distance, speed in ((3e-3, 0.02), (1e-3, 0.04)):
        rcm = T_base_tip[:3, 3] + distance * across
        phases.append(replace(path.phases[0], rcm=rcm, enforced=True, tip_speed=speed))
    values = sampled(model, trajectory, replace(path, phases=tuple(phases))).values
    np.testing.assert_allclose(values["RCM", "enforced"], [3e-3, 3e-3, 3e-3, 1e-3, 1e-3], rtol=1e-6)
    np.testing.assert_allclose(values["tool speed", "tip"], [0.5, 0.5, 0.5, 0.25, 0.25])
    assert np.isnan(values["RCM", "monitored"]).all()


# ------------------------------------------------------------------------------------------- all robots


@pytest.mark.nightly
@pytest.mark.parametrize("robot", twin.names())
def test_every_protocol_is_bounded_tightly(robot: str) -> None:
    """On every protocol of every robot, bounds contain the samples and exceed their extreme by at most a half."""
    files = twin.load(robot).files
    assert files is not None
    for name in files.protocols():
        mechanism, trajectory, path = planned(robot, name)
        proof = proved(mechanism, path)
        samples = sampled(ReferenceModel(mechanism), trajectory, path, most=20000)
        for one in proof.claims:
            if one.group == "loop gap":
                continue
            values = samples.values[one.group, one.name]
            extreme = np.nanmin(values) if one.smallest else np.nanmax(values)
            assert one.status != "unproved", one
            if one.smallest:
                assert extreme / 1.5 - 1e-8 <= one.bound <= extreme + 1e-8, (name, one, extreme)
            else:
                assert extreme - 1e-8 <= one.bound <= max(1.5 * extreme, 1e-8), (name, one, extreme)
