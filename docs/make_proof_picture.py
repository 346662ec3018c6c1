"""Draw docs/pictures/proof.png: an error between samples, as a formula, and a bound at every moment.

    python docs/make_proof_picture.py [--out docs/pictures/proof.png]

The left and the middle part show the printed eq. (1) of SILS; the right one, a joint speed of its protocol table2.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import twin
from twin.core import assets
from twin.core.spatial import Array
from twin.core.units import DEG, MM

PRINTED = "#c0392b"
CORRECTED = "#2471a3"
SAMPLES = "#222222"

TILT = 20 * DEG
"""Largest tilt of the platform that is drawn."""

SHOWN = 0.24
"""Time in s that the right part shows."""


def side_error(robot: twin.Robot, variant: str, theta: Array, phi: Array) -> Array:
    """Return by how much the distance of the balls s1 and s3 differs from the side of the platform, in mm."""
    equations = robot.kinematics({"eq1": variant})
    middle = robot.formula.seeds[0]
    poses = []
    for angles in np.stack([theta.ravel(), phi.ravel()], axis=1):
        poses.append(equations.program.pose_of_coordinates.one(np.array([*middle[:4], *angles])))
    points = equations.points_many(Ts=np.array(poses).reshape(-1, 4, 4))
    side = next(float(p.value) for p in robot.formula.parameters if p.name == "l_p")
    error = np.linalg.norm(points["s1"] - points["s3"], axis=1) - side
    return error.reshape(theta.shape) / MM


def draw_all_poses(ax: Axes, robot: twin.Robot) -> None:
    """Draw the error over both tilts, with the poses where it is zero."""
    angles = np.linspace(-TILT, TILT, 121)
    theta, phi = np.meshgrid(angles, angles, indexing="ij")
    error = side_error(robot, "printed", theta, phi)
    largest = np.abs(error).max()
    degrees = angles / DEG
    image = ax.pcolormesh(degrees, degrees, error.T, cmap="RdBu_r", vmin=-largest, vmax=largest, rasterized=True)
    ax.figure.colorbar(image, ax=ax, label="error of the platform's side in mm", pad=0.02)
    along = np.linspace(-18, 18, 13)
    ax.plot(along, along, ".", color=SAMPLES, label="samples: no error")
    ax.plot(along, -along, ".", color=SAMPLES)
    witness = 2 * np.arctan(1 / 7) / DEG
    ax.plot(witness, 0, "*", color=SAMPLES, ms=12, label="witness: 2 atan(1/7), 0")
    ax.set(xlabel="theta in deg", ylabel="phi in deg", title="1  Samples may all miss an error")
    ax.legend(loc="lower center", fontsize=8, framealpha=0.9)


def draw_formula(ax: Axes, robot: twin.Robot) -> None:
    """Draw the printed and the corrected equation along one line of poses, with the proved formula of the error."""
    theta = np.linspace(-TILT, TILT, 201)
    phi = np.full_like(theta, 10 * DEG)
    ax.plot(theta / DEG, side_error(robot, "printed", theta, phi), color=PRINTED, label="printed: refuted")
    ax.plot(
        theta / DEG, side_error(robot, "corrected", theta, phi), color=CORRECTED, label="corrected: proved, 0 always"
    )
    ax.plot([-10, 10], [0, 0], ".", color=SAMPLES, ms=9, label="samples at phi = theta, -theta")
    found = twin.prove(robot, {"eq1": "printed"}, states=256)
    claim = next(claim for claim in found.proof.claims if claim.name == "inverse: s1 to s3")
    formula = claim.error.removesuffix(" of the square")
    ax.text(0.5, 0.06, f"error of the square:\n{formula}", transform=ax.transAxes, ha="center", fontsize=9)
    ax.set(xlabel="theta in deg, phi = 10 deg", ylabel="error in mm", title="2  A proof finds it, as a formula")
    ax.margins(y=0.25)
    ax.legend(loc="upper center", fontsize=8)


def draw_moments(ax: Axes, robot: twin.Robot) -> None:
    """Draw the bounds of a joint's speed around its largest value, with samples of the plan."""
    motion = twin.prove(robot, states=256, protocols=["table2"], clearance=False).motions[0]
    claim = next(claim for claim in motion.proof.claims if (claim.group, claim.name) == ("joint speed", "q4"))
    curve = motion.proof.curves[claim.group, claim.name]
    first = claim.t - SHOWN / 2
    inside = (curve.t[1:] > first) & (curve.t[:-1] < first + SHOWN)
    edges = np.concatenate([curve.t[:-1][inside], curve.t[1:][inside][-1:]])
    ax.stairs(curve.high[inside] / MM, edges, baseline=curve.low[inside] / MM, fill=True, color=CORRECTED, alpha=0.35)
    samples = motion.samples.values[claim.group, claim.name]
    near = (motion.samples.t > first) & (motion.samples.t < first + SHOWN)
    ax.plot(motion.samples.t[near], samples[near] / MM, ".", color=SAMPLES, label="samples")
    ax.axhline(claim.bound / MM, color=CORRECTED, lw=1, label="never exceeded: proved")
    ax.set_xlim(first, first + SHOWN)
    ax.set(
        xlabel="time in s", ylabel=f"speed of {claim.name} in mm/s", title="3  A bound holds between the samples too"
    )
    ax.legend(loc="lower center", fontsize=8)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=assets.data_folder() / "docs" / "pictures" / "proof.png")
    args = parser.parse_args()
    matplotlib.use("Agg")
    robot = twin.load("sils")
    figure = Figure(figsize=(13.5, 4.2), layout="constrained")
    axes = figure.subplots(1, 3)
    draw_all_poses(axes[0], robot)
    draw_formula(axes[1], robot)
    draw_moments(axes[2], robot)
    figure.savefig(args.out, dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    main()
