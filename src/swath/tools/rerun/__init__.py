"""`swath replay`: a recorded run again, with recorded signals in some of its slots."""
