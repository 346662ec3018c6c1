"""Controllers: blocks that read devices and encoders, and write commands for plants.

`teleoperation` computes tool rates from handle and pedal, eqs (5) to (7) of the SHER paper. `velocity` computes joint
values from tool rates with the Jacobian. `protocol` plays a planned trajectory. `clutch_test` tests requirements on any
teleoperation.

For a console with two hands: `console_equations` has equations (1) to (7) of its paper; `pedals` selects what the hands
control: instruments, camera or nothing; `tool_following` moves a tool by a hand; `jaw` moves a jaw by a gripper;
`camera` moves the camera by two hands; `reaching` computes joint values for a given pose.
"""
