"""A headless Chromium without a GPU, controlled through its DevTools pipe, for tests and timings of the viewer page.

Protocol: https://chromedevtools.github.io/devtools-protocol, JSON messages that end in a zero byte, commands on
descriptor 3 and answers on 4 of the browser.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lippmann.errors import DeviceError, MissingLibraryError

#: Names of the Chromium program, in the order in which they are tried.
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: Render in software, WebGL too (SwiftShader): figures of machines with and without a GPU can then be compared.
SOFTWARE = ("--disable-gpu", "--enable-unsafe-swiftshader")
#: Time-outs, seconds: of an answer, and of the end of the browser.
ANSWER_S, END_S = 120.0, 10.0


def chromium() -> str:
    """Return the path of Chromium.

    Raises
    ------
    MissingLibraryError
        When it is not installed.
    """
    for name in NAMES:
        path = shutil.which(name)
        if path is not None:
            return path
    raise MissingLibraryError("Chromium is not installed; run make setup as root, or apt-get install chromium")


class Browser:
    """A browser with one page of a given size (pixels). Use it as a context manager."""

    def __init__(self, width_px: int = 800, height_px: int = 600) -> None:
        program = chromium()
        self._folder = tempfile.TemporaryDirectory(prefix="lippmann-chromium-", ignore_cleanup_errors=True)
        commands, self._commands = os.pipe()
        self._answers, answers = os.pipe()
        words = [
            program, "--headless", "--remote-debugging-pipe", f"--user-data-dir={self._folder.name}",
            "--no-first-run", "--disable-background-networking", "--hide-scrollbars",
            f"--window-size={width_px},{height_px}", *SOFTWARE,
        ]  # fmt: skip
        if os.geteuid() == 0:
            words.append("--no-sandbox")  # the sandbox does not work for root
        self._process = subprocess.Popen(
            # The shell only moves the pipes to the descriptors that Chromium uses.
            ["/bin/sh", "-c", f'exec "$@" 3</dev/fd/{commands} 4>/dev/fd/{answers}', "sh", *words, "about:blank"],
            pass_fds=(commands, answers),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(commands)
        os.close(answers)
        self._number = 0
        self._session: str | None = None
        self._rest = b""
        #: Events that the browser has sent: (method, parameters).
        self.events: list[tuple[str, dict[str, Any]]] = []
        try:
            target = self.call("Target.createTarget", url="about:blank")["targetId"]
            self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            self.call(
                "Emulation.setDeviceMetricsOverride",
                width=width_px, height=height_px, deviceScaleFactor=1, mobile=False,
            )  # fmt: skip
            for domain in ("Page", "Runtime", "Network", "Log"):
                self.call(f"{domain}.enable")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Return the browser."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the browser."""
        self.close()

    def close(self) -> None:
        """End the browser."""
        os.close(self._commands)  # the browser ends when its pipe closes
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._answers)
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result.

        Raises
        ------
        DeviceError
            When the browser refuses the command, ends, or does not answer.
        """
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        try:
            while data:
                data = data[os.write(self._commands, data) :]
        except BrokenPipeError:
            raise _silent("ended") from None
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise DeviceError(f"Chromium refuses {method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result
            if "method" in answer:
                self.events.append((answer["method"], answer["params"]))

    def processor_seconds(self) -> float:
        """Return the processor time so far, seconds, of the browser's running processes."""
        ticks = 0
        for status in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = status.read_text().rpartition(")")[2].split()
            except OSError:  # the process has ended
                continue
            # After the name: state, parent, process group, ..., user's and system's ticks.
            if int(fields[2]) == self._process.pid:
                ticks += int(fields[11]) + int(fields[12])
        return ticks / os.sysconf("SC_CLK_TCK")

    def _receive(self) -> dict[str, Any]:
        deadline = time.monotonic() + ANSWER_S
        pieces = [self._rest]
        while b"\0" not in pieces[-1]:
            ready, _, _ = select.select([self._answers], [], [], max(0.0, deadline - time.monotonic()))
            piece = os.read(self._answers, 1 << 20) if ready else b""
            if not piece:
                raise _silent("ended" if ready else f"gave no answer for {ANSWER_S:g} s")
            pieces.append(piece)
        data, _, self._rest = b"".join(pieces).partition(b"\0")
        answer: dict[str, Any] = json.loads(data)
        return answer

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression; wait for it when it is a promise.

        Raises
        ------
        DeviceError
            When the page throws an exception.
        """
        done = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in done:
            details = done["exceptionDetails"]
            raise DeviceError(
                f"the page throws an exception: {details.get('exception', {}).get('description', details['text'])}"
            )
        return done["result"].get("value")

    def open(self, url: str) -> None:
        """Open a page, and return when its document is loaded."""
        self.events.clear()
        self.call("Page.navigate", url=url)
        self.evaluate(
            "new Promise(done => document.readyState === 'complete' ? done() : addEventListener('load', () => done()))"
        )


def _silent(what: str) -> DeviceError:
    return DeviceError(f"Chromium {what}; try it by hand: {chromium()} --headless --dump-dom about:blank")
