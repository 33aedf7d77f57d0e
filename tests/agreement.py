"""Whether two samples of heights agree."""

from swath.tools.distributions import Agreement
from swath.tools.lab.comparison import RATED, rating_of


def is_good(found: Agreement) -> bool:
    """Within the limits that count as good, the intersection aside."""
    ratings = {name: rating_of(name, getattr(found, name), 0.0) for name in RATED if name != "intersection"}
    return set(ratings.values()) <= {"repeatable", "good"}
