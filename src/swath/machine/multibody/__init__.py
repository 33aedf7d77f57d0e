"""Bodies and wheels of the motion level `multibody`."""
