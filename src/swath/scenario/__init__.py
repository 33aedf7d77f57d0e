"""Scenarios: the file, its reader, the slots of a machine and the levels they may have."""
