"""Components, ports, schedule, signals, frames, random streams: no agriculture in here."""
