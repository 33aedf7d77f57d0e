"""Control: a folder per slot, a file per level; knows signals and geometry, never the truth."""
