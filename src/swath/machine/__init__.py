"""The machine: motion, steering, header, process; what the data sheet says about it."""
