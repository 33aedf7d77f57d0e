"""Judges: they see samples and truth, and give metrics and limits."""
