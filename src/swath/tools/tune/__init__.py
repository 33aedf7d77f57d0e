"""`swath tune`: numbers and choices of a scenario against the limits and metrics of cases."""
