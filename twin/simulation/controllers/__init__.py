"""Controllers: blocks that read devices and encoders, and write commands for plants.

- a console with one hand (SHER): `teleoperation` is the law, eqs (5) to (7) of its paper; `jacobian_step` computes
  joint values from tool rates; `pen_handle` makes a pen the handle; `clutch_test` tests any such law;
- a console with two hands: `console_equations` has eqs (1) to (7) of its paper; `pedals` selects what they control;
  `tool_following` moves a tool by a hand, by a `hand_step` in each tick, and by `instrument_pivot` its outer end; `jaw`
  and `tool_grip` move jaws by a gripper; `camera` moves the camera; `plan_states` are those of planned motions;
- forces on the hands: `haptics` is the block, `hand_force` its function of one tick, `passivity` the limit that keeps
  it from feeding energy to the hand; `cue` is the force for the deviation of a machine from its model;
- a machine with its model: `trainer` is the block, `trainer_states` its modes, phases and reasons, `packet_smoother`
  makes packets from a goal, `tip_comparison` tests the start of a record, `view_switch` selects what is drawn;
- any robot: `pose_to_joints` computes joint values for a pose, `through_port` with the shaft in a port; `tip_target`
  is the goal for a position of the tip, `protocol_player` plays a planned trajectory.
"""
