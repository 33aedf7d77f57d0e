"""Steering laws: the crop edge in, a path curvature out."""
