"""A page in headless Chromium, with a script of the test's own at its end."""

import html
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

CHROMIUM = next(
    (p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None
)
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-logging=stderr",
    "--enable-unsafe-swiftshader", "--no-first-run", "--disable-extensions", "--virtual-time-budget=3000",
    "--window-size=640,480", "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
PROBE = """
<pre id="told"></pre><script>
const told = document.getElementById("told"), ask = async () => { %s };
const say = (t) => { told.textContent = JSON.stringify(t); };
const wait = () => (globalThis.swath && swath.frames
  ? ask().then(say).catch((e) => say({ error: String(e) })) : setTimeout(wait, 50));
wait();
</script>
"""
LIMIT_S = 100  # a machine that does other things draws slowly


def told_by(page: Path, folder: Path, script: str):
    """What the script returns in the page, and the lines on its console. Skips where there is no browser."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here to look at the page with")
    copy = folder / "probed.html"
    copy.write_text(page.read_text(encoding="utf-8") + PROBE % script, encoding="utf-8")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "--dump-dom", f"file://{copy}#detail=0.1"]
        begun = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        try:
            out, err = begun.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(begun.pid, 9)
            begun.communicate()
            pytest.skip(f"Chromium drew nothing in {LIMIT_S} s")
    found = re.search(r'<pre id="told">(.*?)</pre>', out, re.DOTALL)
    assert found, err[-2000:]
    assert found.group(1), f"the page never became ready: {err[-2000:]}"
    return json.loads(html.unescape(found.group(1))), re.findall(r"CONSOLE.*", err)
