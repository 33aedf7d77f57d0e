"""Crop-edge detectors: a scan and odometry in, the crop edge in the machine frame out."""
