"""Logs of machines: files of records as columns, their units, times and positions, and what they say."""
