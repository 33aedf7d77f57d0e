"""Which crop a log is of, and how the trade counts its grain.

A log says it in a column, in the maker's metadata beside it, or in the name of its file.
"""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError

DEFAULT = "wheat"
LEAST_SHARE = 0.02  # of the rows: a crop with fewer is a slip


@dataclass(frozen=True)
class Trade:
    """A crop in trade. names: pattern on lower-case words; bushel: [lb]; moisture: of dry grain, share."""

    names: str
    bushel: float
    moisture: float


TRADES = {
    "wheat": Trade(r"(winter|spring|durum|hard|soft|red)?_?wheat|(w|s)?weizen|(winter|sommer|hart)weizen|ble"
                   r"|blé|trigo|triticale|spelt|dinkel|wheat_.*", 60.0, 0.135),
    "barley": Trade(r"(winter|spring|malting)?_?barley|(winter|sommer|brau)?gerste|orge|cebada", 48.0, 0.145),
    "rye": Trade(r"(winter|hybrid)?_?rye|(winter)?roggen|seigle|centeno", 56.0, 0.14),
    "rape": Trade(r"(winter)?_?(oil_?seed_?)?rape(_?seed)?|osr|canola|(winter)?raps|colza", 50.0, 0.09),
    "maize": Trade(r"(grain_?)?maize|corn(_.*)?|(yellow|white|field|grain)_corn|(koerner|körner|korn)?mais"
                   r"|maïs|maiz|maíz|173", 56.0, 0.155),
    "soy": Trade(r"soy(a|_?beans?)?|soja(bohnen?)?|174", 60.0, 0.13),
}  # fmt: skip
"""Data sheet -> names in English, German, French and Spanish; 173 and 174 are John Deere's numbers of corn
and soybeans. Bushels and moistures are those of the trade in the USA, cited from memory (tag U)."""


def sheet_of(name: str) -> str | None:
    """The bundled data sheet of a crop by the name that people use, None for an unknown one."""
    word = re.sub(r"[\s\-./,()]+", "_", name.strip().lower()).strip("_")
    word = re.sub(r"\.0$|_0$", "", word)
    return next((sheet for sheet, trade in TRADES.items() if re.fullmatch(trade.names, word)), None)


def crop_in_name(text: str) -> str | None:
    """The crop that a word of a file's name says."""
    words = re.findall(r"[a-zäöüßéï]+", text.lower())
    return next((sheet for word in words if len(word) > 2 and (sheet := sheet_of(word))), None)


def crop_of_rows(names: Iterable[str]) -> tuple[str | None, str | None]:
    """(data sheet, its name in the log) of the crop that most rows name; (None, None) where none says one.

    Raises InputError, which names the crop, where that is one without a data sheet.
    """
    counts = Counter(n.strip() for n in names if n.strip() and n.strip() not in ("---", "None", "nan"))
    if not counts:
        return None, None
    name = counts.most_common(1)[0][0]
    sheet = sheet_of(name)
    if sheet is None:
        known = ", ".join(TRADES)
        raise InputError(
            "crop", name, f"expected one of {known}; --crop takes one of these, or a data sheet of your own"
        )
    return sheet, name


def bushel_kg_factor(sheet: str) -> float:
    """Mass of a bushel of this crop over one of wheat; 1 for a crop that is not traded so."""
    return TRADES[sheet].bushel / TRADES[DEFAULT].bushel if sheet in TRADES else 1.0


def wet_over_dry(sheet: str, moisture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mass of grain at a moisture (share of the wet mass) over its mass at that of the trade."""
    dry = 1.0 - TRADES[sheet].moisture if sheet in TRADES else 1.0 - moisture
    return np.asarray(dry / (1.0 - moisture))
