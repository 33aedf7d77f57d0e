"""Levels that take echoes out of a scan which tell nothing of the crop, before its edge is looked for."""
