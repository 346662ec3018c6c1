"""Control of a robot by its equations: joint rates from a desired pose, and the teleoperation above them.

`velocity` is one tick: a joint step from the Jacobian, within joint and rate limits, by two solvers.
`teleoperation` makes tool rates of handle and pedal: scaling, PID, clutch compensation.
`contract` measures what any teleoperation controller must keep.
"""
