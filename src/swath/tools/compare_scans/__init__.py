"""`swath compare scans`: two sets of scans of a crop, cell by cell along the crop edge."""
