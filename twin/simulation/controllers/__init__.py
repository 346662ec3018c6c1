"""Controllers: each reads devices and encoders, and writes a command for a plant.

`teleoperation` computes tool rates from handle and pedal, eqs (5) to (7) of the SHER paper; `velocity` computes joints
from tool rates by the Jacobian; `protocol` plays a planned trajectory. `contract` tests requirements on any
teleoperation.

A console for two hands: `console` equations (1) to (7) of its paper, `pedals` selects what the hands control,
`following` moves a tool by a hand, `jaw` moves a jaw by a gripper, `camera` moves the camera by two hands, `reaching`
computes joints for a given pose.
"""
