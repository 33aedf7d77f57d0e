"""What commands share: options of a scenario, tables and the outcome of a run on stdout, progress."""
