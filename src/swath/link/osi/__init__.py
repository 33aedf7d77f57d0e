"""ASAM Open Simulation Interface: recorded scans as traces for tool chains that speak it."""
