"""Levels of the job: which pass a machine works next, where it drives, when it stands and calls."""
