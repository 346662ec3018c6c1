"""SILS with its two instruments; the equations are those of `twin.robots.sils`.

The paper has no equations of the instruments. Their joints do not move the platform: they are auxiliary, and no
equation contains them. The poses of the instruments are those of the mechanism.
"""

from __future__ import annotations

from dataclasses import replace

from twin.robots.sils import FORMULA as SILS

FORMULA = replace(
    SILS,
    name="sils_instruments",
    title="SILS 6-DOF parallel robot, three limbs R-PRR-PRS, with two instruments",
)
