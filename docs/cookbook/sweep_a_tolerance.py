# %% [markdown]
# # Sweep a tolerance and plot it
#
# How accurate must the parts of an arm be for its tool to be accurate to 0.1 mm? Each joint frame of the Raven-II's
# left arm is displaced at random; the standard deviation is swept.

# %%
import matplotlib.pyplot as plt
import numpy as np

import twin

robot = twin.load("raven_left")
shifts = np.array([2, 5, 10, 20, 50]) * 1e-6  # standard deviations of a joint frame's place, m
budgets = []
for shift in shifts:
    spread = twin.Spread(shift=shift, turn=1e-5, slide=1e-6, angle=1e-5)  # m and rad, of frames and encoders
    budgets.append(twin.tolerance(robot, spread, required=1e-4))
errors = np.array([budget.worst.within[0] for budget in budgets])  # 95 % of all arms are within, m
for shift, error, budget in zip(shifts, errors, budgets, strict=True):
    print(f"{1e6 * shift:4.0f} µm at each joint: tool within {1e6 * error:5.0f} µm, {budget.verdict}")

# %%
figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
axes.loglog(1e6 * shifts, 1e6 * errors, "o-")
axes.axhline(100, color="#c0392b", label="required")
axes.set(xlabel="standard deviation of a joint's place in µm", ylabel="tool error, 95 % in µm")
axes.legend()
axes.grid(which="both", alpha=0.3)

# %% [markdown]
# Which joints matter, at 10 µm: the shares of the variance of the tool's position.

# %%
for joint, position, rotation in budgets[2].worst.contributors[:4]:
    print(f"{joint:12s} {100 * position:5.1f} % of the position, {100 * rotation:5.1f} % of the rotation")
