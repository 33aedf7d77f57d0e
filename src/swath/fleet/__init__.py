"""A whole field: its ground, one plan, one dispatcher, one schedule on ground that is granted."""
