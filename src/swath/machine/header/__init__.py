"""Header levels: what the knife takes from the field."""
