"""`swath fleet`: a whole field, until it is empty."""
