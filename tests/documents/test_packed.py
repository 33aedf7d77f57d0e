"""Files of other programs that are taken apart."""

import pytest

from swath.core.errors import InputError
from swath.documents.packed import readable


def test_what_a_file_raises_is_its_damage_and_a_mistake_of_the_program_is_none(tmp_path):
    with pytest.raises(InputError, match="a table: it is damaged"), readable("t", "a table", tmp_path / "t"):
        raise IndexError("torn")
    with pytest.raises(NameError), readable("t", "a table", tmp_path / "t"):
        undefined  # noqa: B018, F821
