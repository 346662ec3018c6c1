"""Write a robot and its protocols for other programs: GLB, USD, USDZ, tracks, MJCF, URDF, a Unity package."""
