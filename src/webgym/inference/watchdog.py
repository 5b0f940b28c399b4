"""Runs a server that must not outlive whoever started it. A script of the standard library alone.

    python -I watchdog.py SECONDS COMMAND...

The end of standard input is the starter's end, also when it was killed: the server is asked to end, and is
killed after so many seconds. When the server ends, by itself or not, every process that it started is killed
too, also one that left its process group: on Linux the watchdog adopts what the server leaves behind. (vLLM's
engine processes outlive a server that was killed, and keep the GPU's memory.)
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):  # not Linux
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _end_with_starter(server: subprocess.Popen[bytes], seconds: float) -> None:
    while os.read(0, 1024):
        pass
    server.terminate()
    try:
        server.wait(seconds)
    except subprocess.TimeoutExpired:
        server.kill()


def _kill_what_is_left() -> None:
    """Kill our children, and those that become ours when their parents die, until there is none."""
    while True:
        for thread in Path("/proc/self/task").glob("*/children"):
            with contextlib.suppress(OSError):
                for child in thread.read_text().split():
                    os.kill(int(child), signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def main() -> None:
    """Run the command; our exit status is its."""
    seconds, command = float(sys.argv[1]), sys.argv[2:]
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    server = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        preexec_fn=lambda: _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),  # no thread runs yet
    )
    threading.Thread(target=_end_with_starter, args=(server, seconds), daemon=True).start()
    status = server.wait()
    _kill_what_is_left()
    os._exit(status if status >= 0 else 128 - status)


if __name__ == "__main__":
    main()
