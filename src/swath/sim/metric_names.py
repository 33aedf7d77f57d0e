"""Metrics that `expect:` may set limits on. What they mean: `study/metrics.py`, docs/metrics.md."""

LIMITABLE_METRICS: tuple[str, ...] = (
    "edge_rmse_m",
    "edge_bias_m",
    "detection_availability",
    "false_edge_share",
    "lateral_rms_m",
    "lateral_p95_m",
    "lateral_bias_m",
    "header_use",
    "uncut_area_m2",
    "area_cut_m2",
    "grain_cut_kg",
    "mass_balance_error",
    "distance_m",
    "real_time_factor",
    "ray_count",
)
