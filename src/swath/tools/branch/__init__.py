"""`swath branch`: a run again from one of its moments on, with something changed there."""
