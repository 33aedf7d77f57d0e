"""`swath test plan-field`: which real passes narrow most how far a simulation may be off."""
