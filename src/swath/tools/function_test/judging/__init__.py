"""What runs of a function test show: limits kept, margins, ranks, pairs, verdicts."""
