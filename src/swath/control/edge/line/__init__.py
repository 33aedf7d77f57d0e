"""The line of an edge: its wall, its breaks, and the parabola beside the machine."""
