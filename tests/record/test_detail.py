"""What `run.record` changes: the files, never the digest or a metric."""

from collections import Counter

import pytest
from mcap.reader import make_reader

from swath.record.message_factory import Template
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from tests.whole.small import small

FILES = {"none": [], "exact": ["run.mcap", "tracks.parquet"], "thinned": ["run.mcap", "tracks.parquet"]}
RUN = ("real_time_factor", "wall_s", "cost")  # of the clock on the wall


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("detail")
    made = {}
    for detail in FILES:
        SAMPLES.clear()
        scenario = small(f"run.record={detail}", "run.max_duration_s=1.5")
        made[detail] = run_job(scenario, folder / detail, hooks=[Counts()])
    return made


SAMPLES = Counter()


class Counts(RunHook):
    """Counts the samples of every slot."""

    def begin(self, run):
        run.observers.append(lambda slot, t, outputs: SAMPLES.update(f"{slot}.{name}" for name in outputs))


def count_of(run):
    """Messages by topic, as slot and output are called."""
    with (run.folder / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    names = {number: channel.topic for number, channel in summary.channels.items()}
    counts = summary.statistics.channel_message_counts
    return {names[number].strip("/").replace("/", "."): count for number, count in counts.items()}


def test_without_a_recording_digest_and_metrics_are_the_same(runs):
    kept = {detail: {k: v for k, v in run.summary.items() if k not in RUN} for detail, run in runs.items()}
    assert kept["none"] == kept["exact"]
    notes = kept["thinned"].pop("notes")
    assert kept["thinned"] == {k: v for k, v in kept["none"].items() if k != "notes"}
    assert "in run.mcap these have no message: " in notes[-1]


def test_the_head_line_says_what_is_changed(runs):
    assert runs["exact"].summary["summary"].endswith("run.max_duration_s=1.5")


def test_a_recording_holds_a_message_of_every_sample_unless_it_is_thinned(runs):
    every, some = count_of(runs["exact"]), count_of(runs["thinned"])
    recorded = {name: count for name, count in SAMPLES.items() if name in every}
    assert {name: every[name] for name in recorded} == recorded
    assert {"combine.lidar.scan", "combine.lidar.truth", "combine.steer.command"} <= set(recorded)
    left = {name: count - some[name] for name, count in recorded.items() if count > some[name]}
    told = runs["thinned"].summary["notes"][-1]
    assert left
    assert all(f"{count} of {name}" in told for name, count in left.items())


@pytest.mark.parametrize("detail", FILES)
def test_files_of_a_run(runs, detail):
    found = sorted(p.name for p in runs[detail].folder.iterdir() if p.suffix in (".mcap", ".parquet"))
    assert found == FILES[detail]


def test_a_large_truth_is_seen_now_and_then(runs):
    with (runs["thinned"].folder / "run.mcap").open("rb") as file:
        times = [m.log_time for _, _, m in make_reader(file).iter_messages(topics=["/combine/lidar/truth"])]
    assert [t // 400_000_000 for t in times] == list(range(4))  # 2.5 a second


def test_a_template_gives_the_bytes_of_the_message():
    """Text of any length moves what follows it, and numbers keep their alignment."""
    from swath.record.message_factory import MessageFactory

    make = MessageFactory()
    kind = "sensor_msgs/msg/Imu"
    paths = ("angular_velocity.z", "linear_acceleration.x", "linear_acceleration.y", "orientation.w")
    for frame in ("", "a", "combine/imu", "combine/imu_left"):

        def build(t, values, frame=frame):
            z, x, y, w = values
            return make(
                kind,
                header=make.header(t, frame),
                angular_velocity=make.vector(z=z),
                linear_acceleration=make.vector(x, y),
                orientation=make("geometry_msgs/msg/Quaternion", w=w),
            )

        first = build(0, [0.0] * 4)
        template = Template(make.store, first, bytes(make.store.serialize_cdr(first, kind)), paths)
        values = [1.5, -2.25, 3e300, float("inf")]
        expected = bytes(make.store.serialize_cdr(build(12_345_678_901, values), kind))
        assert template.fill(12_345_678_901, values) == expected
