"""The HTML of a report: text in, text out."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from swath.judge.metrics import METRICS

GROUPS: dict[str, dict[str, tuple[str, str, float, int]]] = {
    "Edge detection": {
        "edge_rmse_m": ("edge error, RMS", "cm", 100.0, 2),
        "edge_bias_m": ("edge error, mean", "cm", 100.0, 2),
        "detection_availability": ("availability", "%", 100.0, 1),
        "false_edge_share": ("edges reported where none is", "%", 100.0, 1),
    },
    "Steering": {
        "lateral_rms_m": ("lateral error, RMS", "cm", 100.0, 2),
        "lateral_p95_m": ("lateral error, 95th percentile", "cm", 100.0, 2),
        "lateral_bias_m": ("lateral error, mean", "cm", 100.0, 2),
    },
    "Harvest": {
        "header_use": ("header use", "%", 100.0, 1),
        "area_cut_m2": ("area cut", "m²", 1.0, 1),
        "uncut_area_m2": ("left uncut", "m²", 1.0, 2),
        "grain_cut_kg": ("grain cut", "kg", 1.0, 1),
        "mass_balance_error": ("mass balance error", "", 1.0, -1),
    },
    "Crop and engine": {
        "mean_throughput_t_h": ("throughput of grain", "t/h", 1.0, 1),
        "feed_cv_percent": ("scatter of the feed", "%", 1.0, 1),
        "mean_loss_percent": ("grain lost, mean", "%", 1.0, 2),
        "peak_loss_percent": ("grain lost, peak", "%", 1.0, 2),
        "mean_engine_load": ("engine load, mean", "%", 100.0, 0),
        "peak_engine_load": ("engine load, peak", "%", 100.0, 0),
        "lowest_engine_rpm": ("lowest engine speed", "1/min", 1.0, 0),
        "fuel_l_t": ("diesel", "l/t", 1.0, 2),
    },
    "Run": {
        "distance_m": ("distance", "m", 1.0, 1),
        "simulated_s": ("simulated time", "s", 1.0, 1),
        "wall_s": ("wall time", "s", 1.0, 1),
        "real_time_factor": ("real-time factor", "×", 1.0, 2),
        "ray_count": ("rays cast", "", 1.0, 0),
        "unmeasured_beam_share": ("beams where nothing was measured", "%", 100.0, 2),
    },
}

CSS = """
:root{--ink:#22262b;--soft:#6b6f76;--line:#dfe2e6;--kept:#00664c;--broken:#a33c00;--paper:#fff}
*{box-sizing:border-box}
body{margin:0;background:#f3f4f5;color:var(--ink);font:15px/1.5 system-ui,"Segoe UI",Roboto,"Helvetica Neue",
Arial,sans-serif}
main{max-width:1180px;margin:0 auto;background:var(--paper);padding:34px 46px 40px}
h1{font-size:30px;line-height:1.2;margin:0;letter-spacing:-.01em}
h2{font-size:18px;margin:38px 0 10px;padding-bottom:6px;border-bottom:1px solid var(--line)}
h3{font-size:12px;margin:0 0 6px;color:var(--soft);text-transform:uppercase;letter-spacing:.06em;
font-weight:600}
p{margin:6px 0}.lead{color:var(--soft);font-size:16px}
header{display:flex;justify-content:space-between;gap:30px;align-items:flex-start}
.verdict{flex:none;border:1.5px solid;border-radius:8px;padding:9px 16px;font-weight:600;font-size:16px;
text-align:center}
.verdict small{display:block;font-weight:400;font-size:13px}
.kept{color:var(--kept)}.broken{color:var(--broken)}.none{color:var(--soft)}
.banner{background:#fff4e8;border-left:4px solid #d55e00;padding:8px 14px;margin:16px 0 0}
dl.facts{display:grid;grid-template-columns:repeat(4,auto);gap:10px 34px;margin:20px 0 0;
justify-content:start}
dl.facts dt{font-size:12px;color:var(--soft)}dl.facts dd{margin:0;font-variant-numeric:tabular-nums}
.metrics{display:grid;grid-template-columns:1fr 1fr;gap:22px 44px}
table{border-collapse:collapse;width:100%}
td,th{padding:4px 8px 4px 0;text-align:left;border-bottom:1px solid #eceef0;vertical-align:baseline}
th{font-size:12px;color:var(--soft);font-weight:600}
.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
td.v{font-weight:600}td.limit{color:var(--soft);font-size:13px;white-space:nowrap}
@media(min-width:801px){.metrics td.n{width:128px}.metrics td.limit{width:92px}}
td.mark{width:74px;white-space:nowrap;font-size:13px;font-weight:600;padding-right:0}
figure{margin:0}figure img{width:100%;display:block}
figcaption{color:var(--soft);font-size:13.5px;margin-top:4px}
.bar{background:#0072b2;height:11px;border-radius:2px;min-width:1px;-webkit-print-color-adjust:exact;
print-color-adjust:exact}
code,pre{font:12.5px/1.45 ui-monospace,"DejaVu Sans Mono",Menlo,Consolas,monospace}
pre{background:#f6f7f8;border:1px solid var(--line);border-radius:6px;padding:14px 16px;white-space:pre-wrap;
overflow-wrap:anywhere}
pre i{font-style:normal;color:#8b9097}
details{margin-top:14px}summary{cursor:pointer;font-weight:600}
.digest{overflow-wrap:anywhere}
footer{margin-top:34px;color:var(--soft);font-size:13px}
@media(max-width:800px){main{padding:22px 18px}header{display:block}.metrics{grid-template-columns:1fr}
dl.facts{grid-template-columns:repeat(2,auto)}.wide{overflow-x:auto}.wide img,.wide table{min-width:700px}}
@media print{body{background:#fff;font-size:11.5px}main{max-width:none;padding:0}section,figure,tr
{break-inside:avoid}h2{break-after:avoid;margin-top:22px}@page{margin:14mm}}
"""


@dataclass(frozen=True)
class Figure:
    """A picture with its heading and caption. image: a data address."""

    title: str
    image: str
    caption: str


def render(
    summary: Mapping[str, Any],
    scenario: str,
    figures: Sequence[Figure],
    default_lines: Collection[int] = (),
) -> str:
    """The whole page. default_lines: numbers, from 1, of the lines of the scenario to show as defaults."""
    name = str(summary.get("name", "run"))
    body = [
        _header(summary, name),
        _facts(summary),
        _section("Results", _metrics(summary)),
        *(_section(f.title, _figure(f)) for f in figures),
        _section("Cost", _cost(summary)) if summary.get("cost") else "",
        _section("Scenario as run", _scenario(scenario, default_lines)),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(name)} · swath</title><style>{CSS}</style></head>\n"
        f"<body><main>\n{''.join(body)}\n<footer>Positive lateral and edge errors point towards the standing "
        "crop. Definitions of all metrics: docs/metrics.md.</footer></main></body></html>\n"
    )


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{content}</section>\n"


def _figure(figure: Figure) -> str:
    return (
        f'<figure><div class="wide"><img src="{figure.image}" alt="{escape(figure.title)}"></div>'
        f"<figcaption>{escape(figure.caption)}</figcaption></figure>"
    )


def _header(summary: Mapping[str, Any], name: str) -> str:
    expect = summary.get("expect") or {}
    broken = [n for n, e in expect.items() if e["verdict"] == "broken"]
    if not expect:
        kind, text, small = "none", "No limits set", "this scenario expects nothing"
    elif broken:
        kind, text, small = "broken", f"✗ {len(broken)} of {len(expect)} limits broken", ", ".join(broken)
    else:
        kind, text, small = "kept", f"✓ All {len(expect)} limits kept", ", ".join(expect)
    about = escape(str(summary.get("summary") or ""))
    banner = ""
    if summary.get("incomplete"):
        banner = '<p class="banner"><b>Incomplete.</b> The run was stopped before its end.</p>'
    return (
        f'<header><div><h1>{escape(name)}</h1><p class="lead">{about}</p></div>'
        f'<div class="verdict {kind}">{escape(text)}<small>{escape(small)}</small></div></header>{banner}'
    )


def _facts(summary: Mapping[str, Any]) -> str:
    versions = summary.get("versions") or {}
    facts = {
        "seed": summary.get("seed"),
        "machine": summary.get("machine"),
        "rays on": summary.get("device"),
        **versions,
    }
    items = "".join(
        f"<div><dt>{escape(k)}</dt><dd>{escape(str(v))}</dd></div>" for k, v in facts.items() if v is not None
    )
    digest = summary.get("digest")
    mark = f'<p class="digest"><code>digest {escape(str(digest))}</code></p>' if digest else ""
    return f'<dl class="facts">{items}</dl>{mark}'


def _metrics(summary: Mapping[str, Any]) -> str:
    expect = summary.get("expect") or {}
    tables = []
    for group, members in GROUPS.items():
        rows = [_metric_row(n, m, summary[n], expect.get(n)) for n, m in members.items() if n in summary]
        if rows:
            tables.append(f"<div><h3>{escape(group)}</h3><table>{''.join(rows)}</table></div>")
    return f'<div class="metrics">{"".join(tables)}</div>'


def _metric_row(
    name: str, shown: tuple[str, str, float, int], value: Any, held: Mapping[str, Any] | None
) -> str:
    label, unit, factor, digits = shown
    limit, mark = "", ""
    if held is not None:
        parts = [("≥", held["limit"].get("min")), ("≤", held["limit"].get("max"))]
        limit = " ".join(f"{s} {_number(v, factor, digits, unit)}" for s, v in parts if v is not None)
        kept = held["verdict"] == "kept"
        mark = f'<span class="{"kept" if kept else "broken"}">{"✓ kept" if kept else "✗ broken"}</span>'
    text = _number(value, factor, digits, unit)
    tip = escape(f"{name}: {METRICS.get(name, label)}")
    return (
        f'<tr title="{tip}"><td>{escape(label)}</td><td class="n v">{text}</td>'
        f'<td class="limit n">{limit}</td><td class="mark">{mark}</td></tr>'
    )


def _number(value: Any, factor: float, digits: int, unit: str) -> str:
    if value is None:
        return "–"
    scaled = float(value) * factor
    if digits < 0:
        text = f"{scaled:.1e}" if scaled else "0"
    else:
        text = f"{scaled:,.{digits}f}".replace(",", "\u202f")
        text = text.replace("-", "−")
    return f"{text}\u00a0{unit}" if unit else text


def _cost(summary: Mapping[str, Any]) -> str:
    """Bars of the wall time per slot. cost: slot -> {seconds, steps}."""
    cost: Mapping[str, Any] = summary["cost"]
    total = max(sum(c["seconds"] for c in cost.values()), 1e-12)
    longest = max(max(c["seconds"] for c in cost.values()), 1e-12)
    simulated = summary.get("simulated_s")
    rows = []
    for slot, c in cost.items():
        each = 1e6 * c["seconds"] / c["steps"] if c["steps"] else 0.0
        cells = [str(c["steps"]), f"{each:,.0f} µs".replace(",", "\u202f"), f"{c['seconds']:.2f} s"]
        cells.append(f"{100 * c['seconds'] / total:.1f} %")
        cells.append(f"{100 * c['seconds'] / simulated:.1f} %" if simulated else "–")
        bar = f'<div class="bar" style="width:{100 * c["seconds"] / longest:.1f}%"></div>'
        numbers = "".join(f'<td class="n">{cell}</td>' for cell in cells)
        rows.append(f'<tr><td>{escape(slot)}</td>{numbers}<td style="width:38%">{bar}</td></tr>')
    head = "<tr><th>slot</th><th class=n>steps</th><th class=n>per step</th><th class=n>wall time</th>"
    head += "<th class=n>share</th><th class=n>of real time</th><th></th></tr>"
    return f"<div class=wide><table>{head}{''.join(rows)}</table></div>"


def _scenario(text: str, default_lines: Collection[int]) -> str:
    lines = (
        f"<i>{escape(line)}</i>" if number in default_lines else escape(line)
        for number, line in enumerate(text.splitlines(), 1)
    )
    return (
        "<p>Every value the run used; pale are the defaults, which the scenario does not write.</p><details>"
        "<summary>Show the resolved scenario</summary><pre>" + "\n".join(lines) + "</pre></details>"
    )
