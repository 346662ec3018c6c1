"""Model of robots and scenes: bodies, joints, loops, trocars, inertia; places, props, cameras."""
