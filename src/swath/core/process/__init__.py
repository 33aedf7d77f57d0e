"""Processes: how another Python starts, how a run is stopped, when memory is freed, commands as typed."""
