"""Levels that take echoes out of a scan which say nothing of the crop, before its edge is looked for."""
