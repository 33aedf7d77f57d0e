"""Objects: what is no crop, from what the sensors measure."""
