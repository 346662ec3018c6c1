"""What a robot and a scene are: bodies, joints, loops, trocars, inertia; places, props, cameras."""
