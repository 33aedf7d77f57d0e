"""Levels of cooperation: what a machine does beside another one, to hand grain over on the go."""
