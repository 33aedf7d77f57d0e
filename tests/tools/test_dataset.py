"""Labelled pictures: COCO as pycocotools reads it, the same bytes after a kill, labels that fit pixels."""

import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.memory_layout import Organ
from swath.tools.dataset.coco import (
    CATEGORIES,
    NAMES,
    annotations_of,
    category_map,
    mask_of,
    packed,
    run_lengths,
    unpacked,
)
from swath.tools.dataset.dataset import make_dataset, missing, settings_of, write_overview
from tests.waiting import until

SETS = ("combine.camera={level: rays, reach_m: 14, mount: {at: axle, x_m: 2, z_m: 3, pitch_deg: 20}}",)
SMALL = {"count": 4, "per_scene": 2, "width": 64, "height": 48, "sets": SETS}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    make_dataset(settings_of("straight", **SMALL), out, workers=1)
    return out


def files_of(out):
    names = {str(p.relative_to(out)): p for p in sorted(out.rglob("*")) if p.is_file()}
    left_out = (".part", "overview.png", "run.lock")
    return {name: path.read_bytes() for name, path in names.items() if not name.endswith(left_out)}


def test_it_is_coco(made):
    whole = json.loads((made / "annotations.json").read_text())
    assert [i["id"] for i in whole["images"]] == [1, 2, 3, 4]
    assert [c["name"] for c in whole["categories"]] == list(NAMES)
    assert len({a["id"] for a in whole["annotations"]}) == len(whole["annotations"]) > 8
    for annotation in whole["annotations"]:
        mask = mask_of(annotation["segmentation"])
        rows, columns = np.nonzero(mask)
        left, top, width, height = annotation["bbox"]
        assert (mask.shape, mask.sum()) == ((48, 64), annotation["area"])
        assert (rows.min(), rows.max() + 1) == (top, top + height)
        assert (columns.min(), columns.max() + 1) == (left, left + width)
        is_stuff = CATEGORIES[annotation["category_id"] - 1]["supercategory"] == "stuff"
        assert annotation["iscrowd"] == int(is_stuff)


@pytest.mark.drawn
def test_masks_of_a_picture_are_its_category_map(made):
    from PIL import Image

    whole, things = json.loads((made / "annotations.json").read_text()), 0
    for image in whole["images"]:
        name = image["file_name"].removesuffix(".jpg")
        categories = np.asarray(Image.open(made / "masks" / f"{name}.png"))
        for annotation in (a for a in whole["annotations"] if a["image_id"] == image["id"]):
            assert (categories[mask_of(annotation["segmentation"])] == annotation["category_id"]).all()
        assert np.asarray(Image.open(made / "images" / f"{name}.jpg")).shape == (48, 64, 3)
        with np.load(made / "shares" / f"{name}.npz") as kept:
            shares, numbers = kept["share"], kept["instance"].tolist()
        for annotation in (a for a in whole["annotations"] if a["image_id"] == image["id"]):
            if not annotation["iscrowd"]:
                share = shares[..., numbers.index(annotation["instance"])]
                assert share[mask_of(annotation["segmentation"])].min() > 0.0
                assert share.sum() == pytest.approx(annotation["share_area"], rel=1e-5)
                things += 1
    assert things > 0
    assert write_overview(made).stat().st_size > 10_000
    (made / "overview.png").unlink()


@pytest.mark.filterwarnings("ignore")
def test_pycocotools_reads_the_same_masks(made, capsys):
    coco = pytest.importorskip("pycocotools.coco")
    read = coco.COCO(str(made / "annotations.json"))
    assert sorted(read.getImgIds()) == [1, 2, 3, 4]
    for annotation in read.loadAnns(read.getAnnIds()):
        np.testing.assert_array_equal(read.annToMask(annotation) > 0, mask_of(annotation["segmentation"]))


def test_a_job_of_which_a_picture_is_missing_goes_on_to_the_same_bytes(made, tmp_path):
    out = shutil.copytree(made, tmp_path / "part")
    (out / "annotations.json").unlink()
    last = max((out / "parts").glob("*.json"))
    last.unlink()
    (out / "images" / f"{last.stem}.jpg").write_bytes(b"half")
    settings = settings_of("straight", **SMALL)
    assert [len(j.pictures) for j in missing(settings, out)] == [1]
    make_dataset(settings, out, workers=1)
    assert files_of(out) == files_of(made)


@pytest.mark.parametrize(
    "damage",
    [
        lambda part: part["annotations"][0]["segmentation"].update(counts="o" * 40),
        lambda part: part["annotations"][0]["segmentation"].update(size=[10**12, 64]),
        lambda part: part["annotations"][0].update(category_id=len(NAMES) + 1),
        lambda part: part["annotations"][0].update(bbox=[0, 0, 1e300, "a"]),
        lambda part: part["annotations"].append(None),
        lambda part: part["image"].update(file_name="../../elsewhere.jpg"),
        lambda part: part["image"].update(id=3),
        lambda part: part.pop("image"),
    ],
)
def test_a_picture_whose_annotations_are_damaged_is_made_again(made, tmp_path, damage):
    out = shutil.copytree(made, tmp_path / "part")
    file = out / "parts" / f"{min((out / 'parts').glob('*.json')).stem}.json"
    part = json.loads(file.read_text())
    damage(part)
    file.write_text(json.dumps(part))
    assert [j.pictures for j in missing(settings_of("straight", **SMALL), out)] == [(0,)]


@pytest.mark.draws
def test_a_killed_job_goes_on_to_the_same_bytes(made, tmp_path):
    out = tmp_path / "part"
    command = [sys.executable, "-m", "swath", "dataset", "straight", "--out", str(out), "--workers", "1"]
    command += ["--count", "4", "--per-scene", "2", "--width-px", "64", "--height-px", "48", "--set", SETS[0]]
    job = subprocess.Popen(command, start_new_session=True)
    until(lambda: job.poll() is not None or len(list((out / "parts").glob("*.json"))) >= 2, "two pictures")
    if job.poll() is None:
        os.killpg(job.pid, signal.SIGKILL)
    job.wait()
    settings = settings_of("straight", **SMALL)
    there = sum(len(j.pictures) for j in missing(settings, out))
    assert there <= 2
    make_dataset(settings, out, workers=1)
    assert files_of(out) == files_of(made)


def test_another_data_set_is_not_mixed_in(made):
    with pytest.raises(InputError, match=r"seed = 2: expected 1, as in dataset\.json"):
        make_dataset(settings_of("straight", seed=2, **SMALL), made, workers=1)
    with pytest.raises(InputError, match="--count = 0"):
        settings_of("straight", count=0)


@pytest.mark.parametrize("seed", range(4))
def test_run_lengths_come_back(seed):
    rng = np.random.default_rng(seed)
    mask = rng.uniform(size=(37, 53)) < (0.02, 0.5, 0.9, 0.0)[seed]
    lengths = run_lengths(mask)
    assert unpacked(packed(lengths)) == lengths
    assert (mask_of({"size": [37, 53], "counts": packed(lengths)}) == mask).all()


def test_things_before_stuff_and_nothing_for_sky():
    label = np.full((6, 8), Organ.NONE, np.uint8)
    label[3:] = Organ.EAR
    instance = np.zeros((6, 8), np.uint16)
    instance[1:5, 2:5] = 2
    kinds = ("tree", "person")
    categories = category_map(label, instance, kinds)
    assert categories[0, 0] == 0
    found = annotations_of(instance, categories, kinds, {2: 11.5})
    assert [NAMES[a["category_id"] - 1] for a in found] == ["person", "crop"]
    assert found[0]["bbox"] == [2, 1, 3, 4]
    assert (found[0]["area"], found[0]["share_area"], found[0]["instance"]) == (12, 11.5, 2)
    assert found[1]["area"] == 24 - 6
