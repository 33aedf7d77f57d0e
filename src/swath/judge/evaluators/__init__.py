"""Evaluators: each file judges one thing. A file with a `LEVEL` is one of them, found by its name."""
