"""`swath calibrate`: fit a cheap level to a dear one, or to measurements."""
