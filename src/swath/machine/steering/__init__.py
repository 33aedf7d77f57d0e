"""Steering levels: from a wanted curvature to the angle of the steered axle."""
