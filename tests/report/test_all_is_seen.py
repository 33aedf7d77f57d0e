"""What a slot sends is seen by rule: a column and its line in the report, or a named place of its arrays."""

from dataclasses import replace
from typing import Annotated

import numpy as np
import pytest

from swath.core.blocks import Block, Blocks, Seen
from swath.core.frames import Pose
from swath.core.frozen import frozen
from swath.core.layout import quantities
from swath.core.rows import held_row, row_like
from swath.core.signal import About, Quantity, Signal
from swath.core.together import plain
from swath.judge.catalogue import load_evaluators
from swath.judge.evaluators.unloading import Unloading
from swath.record.recorder import Recorder
from swath.record.tracks import Tracks, arrays_of, machine_columns, read_tracks, sent_columns
from swath.report.flow import flow_figure
from swath.report.report import PictureSampler
from swath.report.scan_sampler import ScanSampler
from swath.report.sent import sent
from swath.scenario.slots import REGISTRY, SLOTS
from swath.signals import F64, MachineState
from swath.signals.flat import build, flat_fields
from tests.fake_run import ArcEdge, GridField, drive, machine
from tests.report.test_flow import driven

NS = 1_000_000_000
TURNS = (0.0, -0.0, np.pi / 2, -np.pi / 2, np.pi, -np.pi)
PORTS = {f"{slot.name}.{p.name}": p.signal for slot in SLOTS for p in (*slot.outputs, *slot.more)}
FIGURES = {"Scans": ScanSampler.SEEN, "Pictures": PictureSampler.SEEN, "Unloading": Unloading.SIGNALS}


def own_ports(slot, level):
    """Ports of a level's class, of one whose ports depend on its parameters all that its kind may have."""
    own = getattr(REGISTRY.get(slot.name, level).component, "outputs", None)
    return own if isinstance(own, tuple) else (*slot.outputs, *slot.more)


def test_every_output_of_every_level_is_a_column_or_says_where_its_arrays_are(capsys):
    levels = outputs = declared = by_rule = 0
    places = []
    for slot in SLOTS:
        for level in REGISTRY.names(slot.name):
            levels += 1
            for port in own_ports(slot, level):
                kind, outputs = port.signal, outputs + 1
                ruled = {c.field for c in sent_columns({f"{slot.name}.{port.name}": kind})}
                for name, field in flat_fields(kind).items():
                    whole = name.partition(".")[0]
                    is_length = field.quantity.is_amount and name == "dt"
                    has_column = bool(quantities(kind)[whole].tracks)
                    declared, by_rule = declared + has_column, by_rule + (whole in ruled)
                    if field.kind != "array":
                        assert has_column + (whole in ruled) + is_length == 1, (slot.name, level, name)
                if arrays_of(kind):
                    assert kind.about.seen_as != About().seen_as, (slot.name, kind)
                    places.append(kind.about.seen_as)
    assert min(levels, outputs, declared, by_rule, len(places)) > 0
    with capsys.disabled():
        print(
            f"\n{len(SLOTS)} slots, {levels} levels, {outputs} outputs: {declared} numbers with a declared "
            f"column, {by_rule} by rule, {len(places)} outputs with arrays in {len(set(places))} places"
        )


def test_no_two_columns_have_one_name():
    judged = load_evaluators().columns
    names = [column.name for column in Tracks(replace(machine(), outputs=PORTS), 20_000_000).columns]
    assert len(names) > 300
    assert len(names) == len(set(names))
    assert not set(judged) & {column.name for column in sent_columns(PORTS)}


@pytest.mark.parametrize("seed", range(6))
def test_a_row_is_what_each_column_says_of_the_newest_samples(seed, monkeypatch):
    """However often somebody looks, whether arrays lie in rows or samples are held as they are."""
    rng = np.random.default_rng(seed)
    period, looks = int(rng.integers(1, 4)), rng.random()
    each, blockwise = (Tracks(replace(machine(), outputs=PORTS), period) for _ in range(2))
    monkeypatch.setattr("swath.record.tracks.STORED", int(rng.integers(1, 8)) * len(each.columns))
    firsts = {kind: name for name, kind in reversed(PORTS.items())}
    others = [name for name in PORTS if name != firsts[MachineState]]
    rows = {name: held_row(kind, 1) for name, kind in PORTS.items()}
    blocks, latest, shapes, wanted, row, due = Blocks(), {}, {}, [], False, 0
    for t in range(30):
        chosen = rng.choice(others, int(rng.integers(len(others) // 2)), replace=False).tolist()
        for name in [firsts[MachineState]] * int(seed % 3 <= t and (t < 5 or t % 5 > 0)) + chosen:
            sample, (slot, output) = drawn(PORTS[name], t, rng), name.split(".")
            if name == firsts[MachineState]:
                wanted += [said(each.columns, latest)] if row else []
                row = t >= due
                due = (t // period + 1) * period if row else due
            latest[PORTS[name] if firsts[PORTS[name]] == name else name] = sample
            each.take(Seen.of_one(f"combine.{slot}", t, {output: sample}))
            before, shapes[name] = shapes.get(name), [np.shape(v) for v in vars(sample).values()]
            if rng.random() < 0.3 or not (shapes[name] == before or rows[name].is_held):  # another form
                rows[name] = row_like(sample, 1) if rng.random() < 0.5 else held_row(PORTS[name], 1)
            rows[name].take({0: sample})
            blocks.add(f"combine.{slot}", t, {output: rows[name]})
            if rng.random() < looks / (1 + len(chosen)):
                blockwise.take(Seen([Block(trail, 0) for trail, _ in blocks.take()]))
    blockwise.take(Seen([Block(trail, 0) for trail, _ in blocks.take()]))
    wanted += [said(each.columns, latest)] if row else []
    assert np.isfinite(wanted).any(axis=0).mean() > 0.9
    for tracks in (each, blockwise):
        np.testing.assert_array_equal([v[0] for v in tracks.newest().values()], said(each.columns, latest))
        np.testing.assert_array_equal(np.stack([*tracks.arrays().values()], axis=1), wanted)


@pytest.mark.parametrize("seed", range(5))
def test_columns_of_poses_are_what_the_poses_say(seed):
    rng, own = np.random.default_rng(seed), machine(side=("left", "right")[seed % 2])
    angles = [*rng.uniform(-4.0, 4.0, (20, 3)), *np.array([[k, m, 0.0] for k in TURNS for m in TURNS])]
    poses = [Pose.from_euler(rng.normal(0.0, 100.0, 3), *angle) for angle in angles]
    at = (*own.geometry.header_end(own.edge_side), 0.0)
    said = {"x_m": 0, "y_m": 1, "z_m": 2, "roll_rad": 3, "pitch_rad": 4, "yaw_rad": 5}
    said |= {"header_end_x_m": 6, "header_end_y_m": 7}
    held = np.array([plain(pose) for pose in poses])
    found = {c.name: c.numbers(held) for c in machine_columns(own) if c.name in said}
    assert found.keys() == said.keys()
    for k, pose in enumerate(poses):
        wanted = *pose.numbers[0], *pose.euler(), *pose.point(*at)
        assert all(float(found[name][k]).hex() == wanted[place].hex() for name, place in said.items())


def held(value):
    """Of one sample, as it is held."""
    found = np.array([plain(value)])
    if isinstance(value, np.ndarray):
        found = np.empty(1, object)
        found[0] = value
    return found


def said(columns, latest):
    """A row of the newest samples, each column by itself."""
    found = []
    for column in columns:
        sample, value = latest.get(column.source), np.nan
        if sample is not None and column.field:
            (value,) = column.numbers(held(getattr(sample, column.field)))
        if sample is not None and column.over:
            step = getattr(sample, column.over)
            value = value / step if step > 0.0 else np.nan
        found.append(float(value))
    return found


def drawn(kind, t, rng):
    """A sample of any numbers, one in four of which is 0; its arrays are of length 1 to 3."""
    length = int(rng.integers(1, 4))
    draw = {
        "real": lambda n: float(rng.normal() * rng.integers(4)),
        "int": lambda n: length,
        "bool": lambda n: bool(rng.integers(2)),
        "array": lambda n: np.full(n, 2.0),
    }
    sizes = {
        name: int(np.prod([d if isinstance(d, int) else length for d in field.quantity.shape]))
        for name, field in flat_fields(kind).items()
    }
    return build(kind, t, {name: draw[field.kind](sizes[name]) for name, field in flat_fields(kind).items()})


@pytest.mark.parametrize("title", FIGURES)
def test_a_figure_that_is_named_is_shown_what_is_said_to_be_in_it(title):
    kinds = {kind for kind in PORTS.values() if f"figure `{title}` of" in kind.about.seen_as}
    kinds = {kind for kind in kinds if not kind.about.seen_as.startswith("in run.mcap")}
    assert kinds
    assert kinds <= set(FIGURES[title])


@frozen
class MadeUp(Signal, about=About("sensor")):
    """A signal that no file but this one knows."""

    level: Annotated[float, Quantity("W", "of noise")]
    mass: Annotated[float, Quantity("kg", "in this step", is_amount=True)]
    count: Annotated[int, Quantity("", "in this step", is_amount=True)]
    dt: Annotated[float, Quantity("s", "length of the step", is_amount=True)]
    place: Annotated[Pose, Quantity("", "of a camera")]
    is_on: bool
    gap: Annotated[float, Quantity("m", "of it", nan="none")]
    swath: Annotated[F64, Quantity("m", "across", ("place_count",))]


@pytest.fixture(scope="module", params=[0, 1, 2])
def made(request, tmp_path_factory):
    """Samples that were drawn, the table of the run that sent them, and its lines in the report."""
    rng = np.random.default_rng(request.param)
    poses = [Pose.from_euler(rng.normal(size=3), yaw=float(rng.uniform(-3, 3))) for _ in range(6)]
    samples = [
        MadeUp(
            k * NS // 10, float(rng.normal()), float(rng.uniform(0, 9)), int(rng.integers(0, 99)),
            0.0 if k == 0 else 0.1, pose, bool(rng.integers(2)), float("nan"), rng.normal(size=4),
        )
        for k, pose in enumerate(poses)
    ]  # fmt: skip
    outputs = {"probe.probe": MadeUp, "probe_2.more": MadeUp}
    folder, recorded = tmp_path_factory.mktemp("made"), replace(machine(), outputs=outputs)
    with Recorder(folder, [recorded]) as recorder:
        feed = iter(samples)

        def send(slot, t, published):
            if slot.endswith(".motion") and t % (NS // 10) == 0 and (sample := next(feed, None)) is not None:
                recorder("combine.probe", t, {"probe": sample})
                recorder("combine.probe_2", t, {"more": replace(sample, level=-sample.level)})
            recorder(slot, t, published)

        drive([send], GridField(ArcEdge()), seconds=0.7)
        tracks = recorder.tracks["combine"]
        lines = sent(recorded, tracks.columns, tracks.arrays())
    return samples, read_tracks(folder / "tracks.parquet"), lines


def test_a_made_up_signal_is_seen_without_any_other_file(made):
    samples, table, lines = made
    rule = {
        "level_w": lambda s: s.level,
        "mass_kg_s": lambda s: s.mass / s.dt if s.dt else np.nan,
        "count_1_s": lambda s: s.count / s.dt if s.dt else np.nan,
        "place_x_m": lambda s: s.place.position[0],
        "place_yaw_rad": lambda s: s.place.euler()[2],
        "is_on": lambda s: float(s.is_on),
        "gap_m": lambda s: s.gap,
    }
    for name, value in rule.items():
        wanted = [value(s) for s in samples]
        for column, sign in ((f"probe_{name}", 1), (f"probe_2_more_{name}", -1 if name == "level_w" else 1)):
            found = table[column]
            kept = [v for k, v in enumerate(found) if k == 0 or not same(v, found[k - 1])]
            expected = [v for k, v in enumerate(wanted) if k == 0 or not same(v, wanted[k - 1])]
            np.testing.assert_allclose(kept, [sign * v for v in expected])
    text = "".join(map(str, (lines.parts[0].rows, lines.parts[0].text, lines.parts[1].rows)))
    assert "probe_level_w" in text
    assert "probe.probe: swath" in text
    (course,) = [row[3] for row in lines.parts[0].rows if ">probe_level_w<" in row[0]]
    assert "<path" in course.__html__()
    assert "`probe_gap_m`" in lines.parts[0].text


def same(a, b):
    return a == b or (a != a and b != b)


def test_a_limit_may_be_set_on_what_is_sent():
    names = load_evaluators().sent({"probe.probe": MadeUp})
    assert "probe_level_w" in names
    assert not [name for name in names if "swath" in name or name.startswith("probe_dt")]


def test_settings_stand_below_the_losses_that_they_change():
    from tests.machine.machine_fakes import site
    from tests.machine.process_rig import Row

    _, found, tracks = driven(Row(site(period=0.1)), 60, lambda x: (0.97, 0.6))
    t = tracks["t_s"]
    some = {
        "settings_concave_m": np.where(t > 30.0, 0.012, 0.01),
        "settings_fan_rad_s": 80.0 + t // 20.0,
    }
    none = {"settings_vane_rad": np.full(len(t), 0.5), "settings_lower_m": np.full(len(t), np.nan)}
    for more, titles in (({}, ["Grain lost"]), (some | none, ["Grain lost", "Drum and fan", "Openings"])):
        _, *below = flow_figure(found, tracks | more).axes
        heads = [ax.get_title(loc="left") for ax in below]
        assert [next(t for t in titles if head.startswith(t)) for head in heads] == titles
        assert len({ax.get_xlim() for ax in below}) == 1
        lows = [ax.get_position().y0 for ax in below]
        assert lows == sorted(lows, reverse=True)
