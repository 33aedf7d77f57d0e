"""Guidance of a machine over ISO 11783: frames, bus, the machine's side and a controller box."""
