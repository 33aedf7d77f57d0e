"""Threshing levels: drum and concave."""
