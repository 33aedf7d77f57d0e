"""Levels that any slot of a machine may have: somebody else's part. One file each."""
