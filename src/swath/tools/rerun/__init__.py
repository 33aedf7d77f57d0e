"""`swath rerun`: a recorded run again, with recorded signals in some of its slots."""
