"""Measured data that some tests need, beside the repository or where SWATH_DATA says."""

import os
from pathlib import Path

DATA = Path(os.environ.get("SWATH_DATA", Path(__file__).parents[2] / "shared" / "data"))
MONTANA = DATA / "wheat_combine_logs_msu"
