"""The independent model of a mechanism: Pinocchio on the spanning tree, loops closed by damped Gauss-Newton.

The model is built from a `Mechanism` alone, and shares no code with the equations that it checks.

The modules:

- the mechanism as numbers: `tree`, `loops`, `pose_residuals`; `newton` closes the loops
- states: `model` and `states`, at joint values or tool poses; `assembly` for loops that are open in the CAD,
  `regularity` and `singular_departure` for singular states, `loop_closing` for many states at once
- motions: `follower`, `continuation`, `sample_continuation`, `target_continuation`
- ranks and rates: `mobility`, `loop_rates`, `conditioning`, `degeneracy`
- checks of equations and drawing: `margin_zeros` with `newton_walks` (reach margins and singularity measures),
  `joint_range` (states all over the range), `mating` (joints of the CAD), `sensitivity` (rounded frames)
- forces: `inertia`, `dynamics`, `holding_efforts`
- distances: `clearance` along a motion and its proof, `path_clearance`; for a search of paths, `joint_space`
  with `collision_pairs`, `obstacles` and `relative_motion`, and `distance_bounds` with `distance_lookup`
"""

from twin.reference.mobility import Mobility
from twin.reference.model import ReferenceModel
from twin.reference.states import Assembly, SolvedSamples

__all__ = ["Assembly", "Mobility", "ReferenceModel", "SolvedSamples"]
