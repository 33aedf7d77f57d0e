"""What commands share: options of a scenario, tables on stdout."""
