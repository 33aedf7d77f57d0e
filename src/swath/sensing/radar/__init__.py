"""Radar levels: detections of things around, with distance, angles, radial speed and cross section."""
