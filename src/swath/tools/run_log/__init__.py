"""A run as MF4, BLF or ASC."""
