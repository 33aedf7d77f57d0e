"""The numbers of a run and the limits they are held against. docs/metrics.md states each with its formula.

The names that a scenario may set limits on are in judge/metric_names.py.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.signals import F64

SETTLING_M = 10.0  # driven before the lateral error counts
STEP_M = 0.1  # spacing of the interpolated path

METRICS: dict[str, str] = {
    "edge_rmse_m": "detected against true edge, root mean square [m]",
    "edge_bias_m": "detected minus true edge, mean [m], > 0 towards the standing crop",
    "detection_availability": "share of edge samples with an edge, where a true edge exists",
    "false_edge_share": "share of edge samples with an edge, where no true edge exists",
    "lateral_rms_m": "lateral error of the header end after settling, root mean square [m]",
    "lateral_p95_m": "lateral error of the header end after settling, 95th percentile of its size [m]",
    "lateral_bias_m": "lateral error of the header end after settling, mean [m], > 0 towards the crop",
    "header_use": "cut width / header width, mean over time after settling",
    "uncut_area_m2": "standing crop left on the cut side of the header end's path [m2]",
    "area_cut_m2": "ground from which crop was cut [m2]",
    "grain_cut_kg": "grain taken in by the header [kg]",
    "mass_balance_error": "|left the field - in machine, tank, losses and swath| / left the field",
    "mean_throughput_t_h": "grain taken in per hour, after settling [t/h]",
    "feed_cv_percent": "coefficient of variation of the flow into the feeder house, after settling [%]",
    "mean_loss_percent": "grain lost in the machine, mean weighted by the flow [%]",
    "peak_loss_percent": "the same, largest mean over 2 s [%]",
    "mean_engine_load": "torque asked / largest torque at that speed, mean after settling",
    "peak_engine_load": "the same, largest",
    "lowest_engine_rpm": "lowest engine speed after settling [1/min]",
    "fuel_l_t": "diesel per tonne of grain taken in [l/t]",
    "header_in_band": "share of the time in which the knife's mean height is within its band, after settling",
    "header_knife_in_band": "the same, of the time and of the knife's length",
    "header_height_p95_error_m": "knife's height against the wanted one, 95th percentile of its size [m]",
    "header_loss_percent": "grain shed by the header or left on ears below the knife, of all reached [%]",
    "distance_m": "way of the fixed axle's centre [m]",
    "real_time_factor": "simulated time / wall time",
    "ray_count": "rays cast",
    "unmeasured_beam_share": "share of the beams of replayed scans that ended where nothing was measured",
    "digest": "fingerprint of every sample of the run",
    "incomplete": "true when the run was stopped before its end",
    "expect": "limits with value and verdict",
}


def edge_metrics(error: F64, exists: NDArray[np.bool_], found: NDArray[np.bool_]) -> dict[str, float]:
    """Quality of an edge detection.

    error: detected minus true [m], > 0 towards the crop, nan where either is missing; exists: there was a
    true edge; found: an edge was reported; all of shape (sample_count,)
    """
    good = error[np.isfinite(error) & exists & found]
    return {
        "edge_rmse_m": _rms(good),
        "edge_bias_m": _mean(good),
        "detection_availability": _mean(found[exists].astype(float)),
        "false_edge_share": _mean(found[~exists].astype(float)),
    }


def lateral_metrics(distance: F64, error: F64, *, settling: float = SETTLING_M) -> dict[str, float]:
    """Quality of a driven path from its lateral error [m] at travelled distances [m], both (n,).

    The error is taken at even steps along the path, between samples by linear interpolation, so that it
    depends neither on the sample rate nor on the speed (the interpolation method of dynamic tests after
    ISO 12188; nearest samples err by up to several mm at harvest speed).
    """
    settled = even_path(distance, error, start=settling)[1]
    settled = settled[np.isfinite(settled)]
    p95 = float(np.percentile(np.abs(settled), 95.0)) if len(settled) else float("nan")
    return {"lateral_rms_m": _rms(settled), "lateral_p95_m": p95, "lateral_bias_m": _mean(settled)}


def even_path(distance: F64, value: F64, *, start: float = 0.0, step: float = STEP_M) -> tuple[F64, F64]:
    """Distances [m] every `step` from `start` on and the values interpolated there; empty when too short."""
    if len(distance) < 2 or distance[-1] < start:
        return np.zeros(0), np.zeros(0)
    at = np.arange(start, distance[-1], step)
    at = at[at >= distance[0]]
    return at, np.interp(at, distance, value)


def balance_error(missing: float, accounted: float) -> float:
    """|missing - accounted| / missing; 0 when both are 0, inf when only `missing` is."""
    gap = abs(missing - accounted)
    if gap == 0.0:
        return 0.0
    return gap / abs(missing) if missing else float("inf")


def evaluate(limits: Mapping[str, Mapping[str, float]], metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Hold metrics against limits, e.g. {"lateral_rms_m": {"max": 0.05}}; `min` and `max` both count.

    Returns per limit its `value`, `limit` and `verdict`, "kept" or "broken". A metric that does not exist, is
    null or not finite breaks its limit.
    """
    verdicts: dict[str, Any] = {}
    for name, limit in limits.items():
        value = metrics.get(name)
        is_kept = False
        if isinstance(value, int | float) and np.isfinite(value):
            is_kept = limit.get("min", -np.inf) <= value <= limit.get("max", np.inf)
        verdicts[name] = {
            "value": json_safe(value),
            "limit": dict(limit),
            "verdict": "kept" if is_kept else "broken",
        }
    return verdicts


def is_broken(expect: Mapping[str, Any]) -> bool:
    """True when any limit of an `evaluate` result is broken."""
    return any(e["verdict"] == "broken" for e in expect.values())


def json_safe(value: Any) -> Any:
    """The value as JSON can say it: plain numbers, lists and dicts; nan and infinity become null."""
    if isinstance(value, Mapping):
        return {str(k): json_safe(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return json_safe(value.tolist())
    if isinstance(value, list | tuple):
        return [json_safe(v) for v in value]
    if isinstance(value, np.generic):
        return json_safe(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _rms(values: F64) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _mean(values: F64) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
