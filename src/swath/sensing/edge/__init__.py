"""Edge detection that is allowed to see the truth; the real detectors live in `swath.control.edge`."""
