"""Headless Chromium, asked over a pair of pipes in the Chrome DevTools Protocol."""

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.waiting import PATIENCE_S, until

CHROMIUM = next(
    (p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None
)
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--no-first-run",
    "--enable-unsafe-swiftshader", "--disable-extensions", "--remote-debugging-pipe", "--hide-scrollbars",
)  # fmt: skip

AS_3_AND_4 = """
import fcntl, os, sys
far = [fcntl.fcntl(int(fd), fcntl.F_DUPFD, 100) for fd in sys.argv[1:3]]
for fd, place in zip(far, (3, 4)):
    os.dup2(fd, place)
os.execv(sys.argv[3], sys.argv[3:])
"""  # where Chromium looks for its pipes


class NoBrowser(Exception):
    """No Chromium here, or one that does not answer in time."""


class Browser:
    """One page. told: lines of its console and its errors; requests: addresses that it asked for.

    limit_s: of silence, after which it is a `NoBrowser`; a computer that does other things draws slowly
    """

    def __init__(self, size: tuple[int, int] = (640, 480), limit_s: float = PATIENCE_S) -> None:
        if CHROMIUM is None:
            raise NoBrowser("no Chromium on this computer")
        self.limit_s = limit_s
        self.told: list[str] = []
        self.requests: list[str] = []
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        (its_in, self._out), (self._in, its_out) = os.pipe(), os.pipe()
        window = f"--window-size={size[0]},{size[1]}"
        command = [CHROMIUM, *FLAGS, window, f"--user-data-dir={self._profile.name}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", AS_3_AND_4, str(its_in), str(its_out), *command],
            pass_fds=(its_in, its_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(its_in)
        os.close(its_out)
        self._rest, self._count, self._session = b"", 0, ""
        try:
            self._attach(size)
        except BaseException:
            self.close()
            raise

    def _attach(self, size: tuple[int, int]) -> None:
        targets = self._ask("Target.getTargets")["targetInfos"]
        page = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self._ask("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **metrics)

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End it."""
        os.killpg(self._process.pid, 9)
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._profile.cleanup()

    def open(
        self, page: Path | str, place: str = "", ready: str = "globalThis.swath && swath.frames > 0"
    ) -> None:
        """Open a file or an address and wait until an expression in it is true."""
        self._ask("Page.navigate", url=page if isinstance(page, str) else f"file://{page}#{place}")
        until(lambda: self.ask(f"Boolean({ready})"), f"{page} is ready")

    def ask(self, script: str) -> Any:
        """The value of an expression, or of the promise that it is."""
        found = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise AssertionError(found["exceptionDetails"])
        return found["result"].get("value")

    def picture(self) -> bytes:
        """The page as PNG."""
        import base64

        return base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])

    def _ask(self, method: str, **params: Any) -> Any:
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._read()
            if reply.get("id") == self._count:
                if "error" in reply:
                    raise AssertionError(f"{method}: {reply['error']}")
                return reply["result"]
            self._note(reply)

    def _read(self) -> Any:
        while b"\0" not in self._rest:
            if not select.select([self._in], [], [], self.limit_s)[0]:
                raise NoBrowser(f"Chromium did not answer in {self.limit_s:g} s")
            data = os.read(self._in, 1 << 20)
            if not data:
                raise NoBrowser("Chromium went away")
            self._rest += data
        head, _, self._rest = self._rest.partition(b"\0")
        return json.loads(head)

    def _note(self, message: Any) -> None:
        method, params = message.get("method"), message.get("params", {})
        if method == "Runtime.consoleAPICalled":
            self.told.append(" ".join(str(a.get("value")) for a in params["args"]))
        elif method == "Runtime.exceptionThrown":
            self.told.append(str(params["exceptionDetails"]))
        elif method == "Log.entryAdded":
            self.told.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
