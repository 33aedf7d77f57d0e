"""Odometry levels."""
