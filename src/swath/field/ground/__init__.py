"""The ground: its waves, and its heights under a body."""
