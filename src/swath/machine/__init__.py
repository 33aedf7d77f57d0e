"""The machine: motion, steering, header, process; what the data card says about it."""
