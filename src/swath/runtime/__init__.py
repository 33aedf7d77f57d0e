"""The run: world, loop, job, changes on the way, pacing."""
