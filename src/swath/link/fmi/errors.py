"""What goes wrong inside an FMU. The level adds the slot, the file and the time."""

from swath.core.errors import SwathError


class FmuError(SwathError):
    """An FMU that failed, refused, crashed or gave no answer."""
