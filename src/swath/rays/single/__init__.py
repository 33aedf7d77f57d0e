"""Single rays in native code, 16 side by side: beams against bodies."""
