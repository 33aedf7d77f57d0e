"""`swath twin`: what recorded scans say of crop, mounting and scanner, and whether it fits others."""
