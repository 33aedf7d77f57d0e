"""Who has which part of the graph when, and the earliest ways over what is free."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmarks.fleet_graph.lanes import Lanes

from swath.kernels import filled, member_array, start_warp

INF = 1e18
GAP_S = 1.0  # between who leaves a resource and who has it next
SET_OUT_S = 2.0  # that a machine loses until it is at its speed
LABELS, HEAP, POOL, MOST, LOOKS = 200_000, 400_000, 6_000_000, 2_000_000, 60_000


@dataclass
class Way:
    """rows: edge, depart, arrive, (n, 3); close: until when its end is free; goal: which one."""

    rows: Any
    close: float
    goal: int = -1


class Reserved:
    """Arrays of the kernel over a graph for some machines: (name, group, node) each."""

    def __init__(self, lanes: Lanes) -> None:
        start_warp()
        from benchmarks.fleet_graph import kernel

        self.kernel = kernel
        edges, nodes, cells = len(lanes.edges), len(lanes.nodes), len(lanes.crop)
        self.edges, self.nodes = edges, nodes
        a, b = (np.array([getattr(e, key) for e in lanes.edges], np.int32) for key in ("a", "b"))
        succ, pred = np.argsort(a, kind="stable"), np.argsort(b, kind="stable")
        at = np.arange(nodes + 1)
        total = edges + nodes
        i32, f64 = np.int32, np.float64
        self.arrays = {
            "succ_at": np.searchsorted(a[succ], at).astype(i32), "succ": succ.astype(i32),
            "pred_at": np.searchsorted(b[pred], at).astype(i32), "pred": pred.astype(i32),
            "edge_from": a, "edge_to": b, "conf_at": lanes.conflicts[0], "conf": lanes.conflicts[1],
            "need_at": lanes.needs[0], "need": lanes.needs[1],
            "spent": np.array([e.spent for e in lanes.edges]), "cut": np.full(cells, INF),
            "exempt": np.zeros(cells, np.uint8), "dead": np.zeros(100_000, np.uint8),
            "head": np.full(total, -1, i32), "next": np.zeros(POOL, i32), "who": np.zeros(POOL, i32),
            "grant": np.zeros(POOL, i32), "begin": np.zeros(POOL), "until": np.zeros(POOL),
            "counts": np.zeros(1),
            "parked": np.zeros(64), "since": np.zeros(total), "stamp": np.zeros(total, i32),
            "iv_at": np.zeros(total, i32), "iv_count": np.zeros(total, i32), "iv": np.zeros(2 * MOST),
            "labels": np.zeros(7 * LABELS), "first": np.zeros(nodes, i32), "heap_key": np.zeros(HEAP),
            "heap_node": np.zeros(HEAP, i32), "h": np.zeros(nodes, f64), "goal": np.zeros(nodes, f64),
            "found": np.zeros(max(3 * LABELS // 10, nodes + 1)), "numbers": np.zeros(16),
            "given": np.zeros(40_000),
        }  # fmt: skip
        self.its = filled(kernel.Plans, **self.arrays)
        self.cut, self.exempt, self.parked, self.dead = (
            self.arrays[k] for k in ("cut", "exempt", "parked", "dead")
        )
        self.found, self.numbers, self.given = (self.arrays[k] for k in ("found", "numbers", "given"))
        self.asked = 0
        wp = start_warp()
        self.command = wp.launch(kernel.ask, dim=1, inputs=[self.its], device="cpu", record_cmd=True)

    def clear(self, count: int) -> None:
        """Nothing is cut or reserved."""
        self.count, self.grants = count, 0
        self.cut[:] = INF
        self.exempt[:] = 0
        self.dead[:] = 0
        self.arrays["head"][:] = -1
        self.arrays["counts"][0] = 0.0
        self.parked[:] = -1.0

    def _ask(
        self,
        mode: int,
        me: int,
        start: int,
        rows: Any,
        time: float = 0.0,
        partial: int = 0,
        looks: int = LOOKS,
    ) -> int:
        rows = np.asarray(rows, float)
        self.given[: rows.size] = rows.ravel()
        self.numbers[:] = (
            mode, me, start, len(rows), self.edges, self.nodes, self.count, time, GAP_S, SET_OUT_S, HEAP,
            POOL,
            partial, MOST, LABELS, looks,
        )  # fmt: skip
        self.asked += 1
        self.command.launch()
        return int(self.found[0])

    def way(self, me: int, start: int, goals: Any, time: float, looks: int = LOOKS) -> Way | None:
        """Earliest way to one of goals: node, stand until, for how long, latest arrival, extra cost."""
        if not len(goals):
            return None
        n = self._ask(0, me, start, goals, time, looks=looks)
        if n < 0:
            return None
        return Way(self.found[3 : 3 + 3 * n].reshape(-1, 3).copy(), float(self.found[1]), int(self.found[2]))

    def along(self, me: int, start: int, rows: Any, time: float, partial: bool = False) -> Way | None:
        """Earliest along edges, least times in each, its end free for good; partial: or as far as it is."""
        n = self._ask(1, me, start, rows, time, int(partial))
        return None if n < 0 else Way(self.found[3 : 3 + 3 * n].reshape(-1, 3).copy(), float(self.found[1]))

    def far(self, me: int, start: int, time: float) -> Any:
        """Least times from a node to all, over ground that will be cut."""
        self._ask(3, me, start, [], time)
        return self.found[1 : 1 + self.nodes].copy()

    def reserve(self, me: int, rows: Any) -> int:
        """Resources from when to when, as a grant of its own."""
        self.grants += 1
        rows = np.asarray([(*r, self.grants) for r in rows], float)
        if self._ask(2, me, 0, rows) < 0:
            raise MemoryError("more reserved times than there is room for")
        return self.grants

    def is_free(self, me: int, resource: int, a: float, b: float) -> bool:
        """Whether nobody else has a resource, and no crop stands there, from when to when."""
        x = self.arrays
        i, j = x["need_at"][resource : resource + 2]
        need = x["need"][i:j]
        if len(need) and self.cut[need[self.exempt[need] == 0]].max(initial=0.0) > a:
            return False
        conf = x["conf"][x["conf_at"][resource] : x["conf_at"][resource + 1]]
        for k in range(self.count):
            if k != me and self.parked[2 * k] >= 0 and self.parked[2 * k + 1] < b:
                at = self.edges + int(self.parked[2 * k])
                p = np.searchsorted(conf, at)
                if p < len(conf) and conf[p] == at:
                    return False
        n = int(x["head"][resource])
        while n >= 0:
            if (
                x["who"][n] != me
                and not self.dead[x["grant"][n]]
                and x["begin"][n] - GAP_S < b
                and x["until"][n] + GAP_S > a
            ):
                return False
            n = int(x["next"][n])
        return True


__all__ = ["INF", "Reserved", "Way", "member_array"]
