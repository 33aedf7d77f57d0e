"""Many rolled turns at once: the paths of `swath.control.turns.clothoid`, with angles read from its table.

Ends are met to a centimetre, which is enough to know what a turn sweeps and how long it takes.
"""

import numpy as np

from swath.control.turns.clothoid import GRID, TURN, _bends, bend
from swath.control.turns.limits import TurnLimits
from swath.fleet.machines import Drive

AT_ONCE = 500
KINDS = ("csc", "ccs", "scc")


def shortest_turns(starts: np.ndarray, goals: np.ndarray, drive: Drive) -> list[list[tuple[float, float]]]:
    """Pieces (curvature [1/m], length [m]) of the shortest rolled turn between poses x, y, heading, (n, 3);
    none where there is none.
    """
    return [pieces_of(row, drive) for row in turns_of(starts, goals, drive)]


def turns_of(starts: np.ndarray, goals: np.ndarray, drive: Drive) -> np.ndarray:
    """Of each its length [m], inf where there is none, and what `pieces_of` makes pieces of, (n, 7)."""
    limits, ends = _limits(drive), range(0, max(len(starts), 1), AT_ONCE)
    return np.concatenate([_chunk(starts[i : i + AT_ONCE], goals[i : i + AT_ONCE], limits) for i in ends])


def pieces_of(row: np.ndarray, drive: Drive) -> list[tuple[float, float]]:
    """Pieces (curvature [1/m], length [m]) of one."""
    total, number, first, second, a, b, s = row.tolist()
    if not np.isfinite(total):
        return []
    limits = _limits(drive)
    one, two = _pieces(a, int(first), limits), _pieces(b, int(second), limits)
    line = [(0.0, s)] if s > 1e-6 else []
    return {"csc": one + line + two, "ccs": one + two + line, "scc": line + one + two}[KINDS[int(number)]]


def _limits(drive: Drive) -> TurnLimits:
    return TurnLimits(drive.radius, drive.steering / drive.turning)


def _length(angle: np.ndarray, limits: TurnLimits) -> np.ndarray:
    """Of a bend through angles."""
    peak = np.minimum(1.0 / limits.radius, np.sqrt(np.maximum(angle, 1e-12) * limits.sharpness))
    ramp = peak / limits.sharpness
    return 2.0 * ramp + np.maximum(angle - peak * ramp, 0.0) / peak


def _chunk(starts: np.ndarray, goals: np.ndarray, limits: TurnLimits) -> np.ndarray:
    grid, table = np.linspace(0.0, TURN, GRID + 1), _bends(limits)
    d = (goals[:, 0] - starts[:, 0]) + 1j * (goals[:, 1] - starts[:, 1])
    goal = d * np.exp(-1j * starts[:, 2])
    heading = (goals[:, 2] - starts[:, 2]) % TURN
    n = len(starts)
    best = np.full(n, np.inf)
    found = np.zeros((n, 6))  # kind, first, second, a, b, straight
    final = np.exp(1j * heading)[:, None]
    for first in (1, -1):
        one = table if first > 0 else table.conj()
        course = np.exp(1j * first * grid)[None]
        for second in (1, -1):
            rest = (second * (heading[:, None] - first * grid[None])) % TURN
            at = rest / TURN * GRID
            k = np.minimum(at.astype(int), GRID - 1)
            two = table[k] + (at - k) * (table[k + 1] - table[k])
            two = two if second > 0 else two.conj()
            gap = goal[:, None] - one[None] - course * two
            jump = np.abs(np.diff(rest, axis=1)) > np.pi
            for number, along in enumerate((course, final, np.ones((1, 1)))):
                gone = gap * np.conj(along)
                across, ahead = gone.imag, gone.real
                crossing = (across[:, :-1] * across[:, 1:] <= 0.0) & ~jump
                row, i = np.nonzero(crossing)
                low, high = across[row, i], across[row, i + 1]
                share = np.where(high != low, -low / np.where(high != low, high - low, 1.0), 0.0)
                a = (i + share) * TURN / GRID
                b = rest[row, i] + share * (rest[row, i + 1] - rest[row, i])
                s = ahead[row, i] + share * (ahead[row, i + 1] - ahead[row, i])
                total = np.where(s > -0.01, _length(a, limits) + _length(b, limits) + s, np.inf)
                order = np.argsort(-total, kind="stable")  # the least is written last
                row, a, b, s, total = (v[order] for v in (row, a, b, s, total))
                least = np.full(n, np.inf)
                own = np.zeros((n, 6))
                least[row] = total
                own[row] = np.column_stack(
                    [np.full(len(row), number), np.full(len(row), first), np.full(len(row), second), a, b, s]
                )
                better = least < best - 1e-6
                best[better], found[better] = least[better], own[better]
    return np.column_stack([best, found])


def _pieces(angle: float, side: int, limits: TurnLimits) -> list[tuple[float, float]]:
    """A bend in pieces of at most a metre."""
    if angle < 1e-3 or TURN - angle < 1e-3:
        return []
    out = []
    for length, k0, k1 in bend(angle, side, limits):
        count = max(1, int(np.ceil(length)))
        if length > 1e-9:
            out += [(k0 + (i + 0.5) / count * (k1 - k0), length / count) for i in range(count)]
    return out
