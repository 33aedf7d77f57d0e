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
OTHERS = (
    r"(winter_|spring_)?oats?|(sommer|winter)?hafer|avoine|avena|sun_?flowers?|sonnenblumen?|tournesol|girasol|sorgh(um|o)|milo"
    r"|millets?|hirse|rice|reis|arroz|riz|(field_|chick_?|dry_)?peas?|(winter|sommer|futter)?erbsen?|pois|guisantes?"
    r"|((dry|field|faba|fava|broad|edible|navy|black|pinto|kidney)_)?beans?|(acker|busch)?bohnen?|lentils?|linsen"
    r"|flax|linseed|lein|cotton|baumwolle|algodon|lupins?e?|lupinen?|mustard|senf|buckwheat|buchweizen|safflower"
    r"|hemp|hanf|alfalfa|luzerne|clover|klee|grass(_seed)?|gras|sugar_?beets?|zueckerrueben|zuckerrüben|potato(es)?"
    r"|kartoffeln?|peanuts?|quinoa"
)
"""Names of crops without a data sheet, where a name may also be that of a variety."""
STEMS = (0.1, 2.0)  # plausible, of what the crop usually has: 50 to 1000 ears/m2 of wheat; others are clipped
LEAST_SHARE = 0.02  # of the rows: a crop with fewer is a slip


@dataclass(frozen=True)
class Trade:
    """A crop in trade. names: pattern on lower-case words; bushel: [lb]; moisture: of dry grain, share."""

    names: str
    bushel: float
    moisture: float


TRADES = {
    "wheat": Trade(r"(winter|spring|durum|hard|soft|red)?_?wheat|(w|s)?weizen|(winter|sommer|hart)weizen|ble"
                   r"|weichweizen|bl[eé](_tendre|_dur)?|trigo(_blando|_duro)?|triticale|spelt|dinkel|wheat_.*",
                   60.0, 0.135),
    "barley": Trade(r"(winter|spring|malting)?_?barley|(winter|sommer|brau)?gerste|orge(_brassicole)?"
                    r"|cebada", 48.0, 0.145),
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
    word = re.sub(r"\.0$|_0$|_d_hiver$|_de_printemps$", "", _word(name))
    return next((sheet for sheet, trade in TRADES.items() if re.fullmatch(trade.names, word)), None)


def is_other(name: str) -> bool:
    """Whether a name is that of a crop without a data sheet, and not of a variety."""
    return re.fullmatch(OTHERS, _word(name)) is not None


def crop_in_name(text: str) -> str | None:
    """The crop that a word of a file's name says. InputError where that is one without a data sheet."""
    words = [word for word in re.findall(r"[a-zäöüßéï]+", text.lower()) if len(word) > 2]
    found = next((sheet for word in words if (sheet := sheet_of(word))), None)
    other = next((word for word in words if is_other(word)), None)
    if found is None and other is not None:
        raise _unknown(other)
    return found


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
        raise _unknown(name)
    return sheet, name


def _word(name: str) -> str:
    return re.sub(r"[\s\-./,()'’]+", "_", name.strip().lower()).strip("_")


def _unknown(name: str) -> InputError:
    expected = f"expected one of {', '.join(TRADES)}; --crop takes one of these, or a data sheet of your own"
    return InputError("crop", name, expected)


def bushel_kg_factor(sheet: str) -> float:
    """Mass of a bushel of this crop over one of wheat; 1 for a crop that is not traded so."""
    return TRADES[sheet].bushel / TRADES[DEFAULT].bushel if sheet in TRADES else 1.0


def wet_over_dry(sheet: str, moisture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mass of grain at a moisture (share of the wet mass) over its mass at that of the trade."""
    dry = 1.0 - TRADES[sheet].moisture if sheet in TRADES else 1.0 - moisture
    return np.asarray(dry / (1.0 - moisture))
