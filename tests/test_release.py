"""What a release is made of: versions that agree, links of the metadata, a workflow whose steps exist."""

import os
import re
import runpy
from pathlib import Path

import pytest
import setuptools
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
VERSIONS = runpy.run_path(str(ROOT / ".ci" / "versions.py"))


def test_the_version_is_the_same_everywhere():
    assert VERSIONS["wrong"]("") == []


@pytest.mark.parametrize(
    ("file", "old", "new", "tag", "said"),
    [
        ("CITATION.cff", "\nversion: ", "\nversion: 9", "", r"CITATION.cff says 9\S+, pyproject.toml"),
        ("src/swath/__init__.py", '__version__ = "', '__version__ = "1', "", "src/swath/__init__.py says 1"),
        ("CHANGELOG.md", "# Changelog\n", "# Changelog\n\n## 7.0.0\n", "", "CHANGELOG.md says 7.0.0"),
        ("CHANGELOG.md", "", "", "v9.9.9", "the tag is v9.9.9, expected v"),
        ("CHANGELOG.md", "# Changelog\n", "# Changelog\n\n## 7.0.0 (unreleased)\n", "", r"says 7.0.0\.dev0"),
        ("pyproject.toml", 'version = "', 'version = "7.0.dev0', "v7.0.0", r"7\.0\.dev0\S* is not released"),
    ],
)
def test_a_version_that_differs_is_named(file, old, new, tag, said, tmp_path):
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "src/swath/__init__.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        text = (ROOT / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(text.replace(old, new, 1) if name == file else text, encoding="utf-8")
    assert any(re.search(said, line) for line in VERSIONS["wrong"](tag, tmp_path))


def set_up(monkeypatch, folder):
    """What setup.py tells setuptools in a folder."""
    told = {}
    monkeypatch.setattr(setuptools, "setup", told.update)
    monkeypatch.chdir(folder)
    runpy.run_path(str(ROOT / "setup.py"))
    return told["project_urls"]


def test_the_links_of_the_metadata_are_those_of_the_home_and_stay_in_an_sdist(monkeypatch, tmp_path):
    (tmp_path / "README.md").write_text("# swath\n")
    monkeypatch.delenv("PROJECT_URL", raising=False)
    assert set_up(monkeypatch, tmp_path) == {}
    monkeypatch.setenv("PROJECT_URL", "https://example.org/them/swath/")
    links = set_up(monkeypatch, tmp_path)
    assert links["Source"] == "https://example.org/them/swath"
    assert set(links) == {"Source", "Documentation", "Changelog", "Issues"}
    for url in links.values():
        path = re.sub(r"^https://example.org/them/swath(/(tree|blob)/main)?", "", url).strip("/")
        assert path in ("", "issues") or (ROOT / path).exists()
    monkeypatch.delenv("PROJECT_URL")
    (tmp_path / "PKG-INFO").write_text("".join(f"Project-URL: {k}, {v}\n" for k, v in links.items()))
    assert set_up(monkeypatch, tmp_path) == links


def test_the_workflow_runs_what_is_there_and_publishes_only_what_was_built():
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    jobs = YAML(typ="safe").load(text)["jobs"]
    runs = [step["run"].split()[0] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert runs == [".ci/release"]
    assert os.access(ROOT / ".ci" / "release", os.X_OK)
    assert (jobs["publish"]["needs"], jobs["publish"]["if"]) == ("build", "github.ref_type == 'tag'")
    script = (ROOT / ".ci" / "release").read_text(encoding="utf-8")
    assert all((ROOT / file).is_file() for file in re.findall(r"\.ci/\w+(?:\.py)?", script))
    assert not re.search(r"https?://|\w\.(org|io)\b", text + script)
