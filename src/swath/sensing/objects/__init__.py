"""Objects from the truth: exact, or with errors."""
