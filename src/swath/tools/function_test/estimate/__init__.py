"""`swath test estimate`: the probability of a rare failure."""
