"""What a number of runs shows of a rate, and whether that is enough.

A claim "at least p0 of runs pass" is `shown` when the runs exclude every lower rate with the claim's
confidence, `broken` when they exclude p0 and every higher rate, and `not shown` otherwise: too few runs.
Where runs are left out because a level in them was outside the range in which it was checked, nothing is
shown of the whole: the claim is `not judged`, unless the others break it.

Runs that were planned and all done are judged by the exact interval of Clopper & Pearson 1934
(doi:10.1093/biomet/26.4.404). While runs are still to come the same question is asked again and again, which
that interval does not allow: then the runs are a bet against the claim's opposite (an e-process, Ramdas et
al. 2023, doi:10.1214/23-STS894). The bet is a mixture of rates with a beta density on the claimed side of p0;
by Ville's inequality its capital exceeds 1 / (1 - confidence) at any time with probability 1 - confidence at
most.
"""

from math import ceil, log
from typing import Any

from swath.core.errors import Extra
from swath.core.number_text import percent_of

SHOWN, BROKEN, NOT_SHOWN, NOT_JUDGED = "shown", "broken", "not shown", "not judged"
VERDICTS = (SHOWN, BROKEN, NOT_SHOWN, NOT_JUDGED)
BET_FOR = 60.0, 0.6  # of the beta density over rates by which the bet for the claim is spread: near 1
BET_AGAINST = 1.0, 1.0


def verdict(passed: int, count: int, rate: float, confidence: float, *, is_complete: bool) -> str:
    """`shown`, `broken` or `not shown`. passed of count runs; is_complete: all that were planned are done."""
    if count == 0:
        return NOT_SHOWN
    if is_complete:
        if lower_bound(passed, count, confidence) >= rate:
            return SHOWN
        return BROKEN if upper_bound(passed, count, confidence) < rate else NOT_SHOWN
    limit = -log(1.0 - confidence)
    if log_capital(passed, count, rate, is_for=True) >= limit:
        return SHOWN
    return BROKEN if log_capital(passed, count, rate, is_for=False) >= limit else NOT_SHOWN


def lower_bound(passed: int, count: int, confidence: float) -> float:
    """One-sided lower limit of the rate (Clopper & Pearson)."""
    return 0.0 if passed == 0 else float(scipy_stats().beta.ppf(1.0 - confidence, passed, count - passed + 1))


def upper_bound(passed: int, count: int, confidence: float) -> float:
    """One-sided upper limit of the rate (Clopper & Pearson)."""
    return 1.0 if passed == count else float(scipy_stats().beta.ppf(confidence, passed + 1, count - passed))


def needed(rate: float, confidence: float) -> int:
    """Runs that all have to pass to show a rate: the least n with rate^n <= 1 - confidence."""
    return ceil(log(1.0 - confidence) / log(rate))


def log_capital(passed: int, count: int, rate: float, *, is_for: bool) -> float:
    """Logarithm of the capital that a bet of 1 has grown to.

    is_for: whether the bet is that the rate is higher, else that it is lower
    """
    from scipy.special import betaln

    a, b = BET_FOR if is_for else BET_AGAINST
    failed = count - passed
    whole = betaln(a + passed, b + failed) - betaln(a, b)
    before, after = _log_share(a, b, rate, is_for), _log_share(a + passed, b + failed, rate, is_for)
    return float(whole + after - before - passed * log(rate) - failed * log(1.0 - rate))


def _log_share(a: float, b: float, rate: float, is_above: bool) -> float:
    """Logarithm of the share of a beta density above a rate, or below it."""
    beta = scipy_stats().beta
    return float(beta.logsf(rate, a, b) if is_above else beta.logcdf(rate, a, b))


def describe(passed: int, count: int, rate: float, confidence: float, result: str) -> str:
    """`10 of 10 passed, shows >= 74 %; 59 without a failure are needed for 95 %`."""
    if count == 0:
        return "no run is done"
    text = f"{passed} of {count} passed, shows "
    if result == BROKEN:
        return text + f"<= {percent_of(upper_bound(passed, count, confidence))}; {percent_of(rate)} is asked"
    text += f">= {percent_of(lower_bound(passed, count, confidence))}"
    if result == NOT_SHOWN and passed == count:
        text += f"; {needed(rate, confidence)} without a failure are needed for {percent_of(rate)}"
    return text


def scipy_stats() -> Any:
    """The module. MissingExtra without scipy."""
    with Extra("test", "swath test"):
        from scipy import stats
    return stats
