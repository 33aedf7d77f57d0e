"""What a communication step of an exported FMU costs, stepped by fmpy, beside the same slots inside swath.

Per step and on one core: the slots in swath with their inputs put in; the same behind the FMU's variables in
Python; the FMU through its binary, with every input set and every output read.
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

from _harness import interleave, machine, median, write_json

from swath.link.fmi.export import export_fmu
from swath.link.fmi.export_slave import Session
from swath.scenario.scenario import Scenario, load_scenario

STEPS = 500
CASES: dict[str, tuple[str, tuple[str, ...], float]] = {
    "process: constant": ("process", ("combine.process.level=constant",), 0.1),
    "process: threshing": ("process", (), 0.1),
    "powertrain: hydrostat": ("powertrain", (), 0.05),
    "motion, process, powertrain, steering": ("motion process powertrain steering", (), 0.02),
}


def main(out: Path | str = "out/bench") -> None:
    """Print and save the table."""
    sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "link"))
    rows = [_case(name, *case) for name, case in CASES.items()]
    print(f"{'FMU (FMI 3)':40s} {'step':>7s} {'swath':>9s} {'variables':>10s} {'FMU':>9s}  [us per step]")
    for r in rows:
        print(f"{r['name']:40s} {r['step_ms']:5.0f}ms {r['swath']:9.1f} {r['session']:10.1f} {r['fmu']:9.1f}")
    write_json(Path(out), "fmu_export", {"machine": machine(), "rows": rows})


def _case(name: str, slots: str, sets: tuple[str, ...], h: float) -> dict[str, Any]:
    from fmu_host import Host

    scenario = load_scenario("feed-rate", sets=sets)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "x.fmu"
        export_fmu(scenario, slots.split(), file)
        host = Host(file)
        session = Session(Path(host.folder) / "resources")
        jobs = {
            "swath": _inside(scenario, session, h),
            "session": _session(session, h),
            "fmu": _fmu(host, h),
        }
        times = interleave(jobs, rounds=5)
        host.close()
    us = {key: 1e6 * median(values) / STEPS for key, values in times.items()}
    return {"name": name, "step_ms": 1e3 * h, **us}


def _inside(scenario: Scenario, session: Session, h: float) -> Any:
    """The slots alone: one sample for every input, put in before each step."""
    from swath.runtime.assembly import assemble

    world = assemble(scenario, only=session.slots)
    graph, ns = world.graph, round(h * 1e9)
    graph.reset()
    whole = assemble(scenario).graph
    whole.reset()
    samples = [(s, o, whole.latest(s, o)) for s, ports in graph.outside.items() for o in ports]

    def run() -> None:
        for _ in range(STEPS):
            for slot, output, sample in samples:
                assert sample is not None
                graph.put(slot, output, sample)
            graph.run(graph.t + ns)

    return run


def _session(session: Session, h: float) -> Any:
    session.start()
    inputs = [i for i, v in enumerate(session.variables) if v.causality == "input"]
    outputs = [i for i, v in enumerate(session.variables) if v.causality == "output"]
    values = [session.get(i) for i in inputs]
    at = [0.0]

    def run() -> None:
        for _ in range(STEPS):
            for i, value in zip(inputs, values, strict=True):
                session.set(i, value)
            session.step(at[0], h)
            at[0] += h
            for i in outputs:
                session.get(i)

    return run


def _fmu(host: Any, h: float) -> Any:
    variables = host.model.modelVariables
    refs = {
        (kind, causality): [v.valueReference for v in variables if (v.type, v.causality) == (kind, causality)]
        for kind in ("Float64", "Int64", "Boolean")
        for causality in ("input", "output")
    }
    groups = [
        (getattr(host.fmu, f"get{k}"), getattr(host.fmu, f"set{k}"), c, r) for (k, c), r in refs.items() if r
    ]
    values = [(write, r, read(r)) for read, write, c, r in groups if c == "input"]
    reads = [(read, r) for read, _, c, r in groups if c == "output"]

    def run() -> None:
        for _ in range(STEPS):
            for write, r, given in values:
                write(r, given)
            host.step(h)
            for read, r in reads:
                read(r)

    return run


if __name__ == "__main__":
    main()
