"""swath: a simulator for harvest machines that act on what they sense."""

__version__ = "0.1.0"
