"""Native code around the rays of a scanner: where its beams start and point, and what it reports."""
