"""Runs a server that must end with the process that started it. Uses only the standard library.

    python -I watchdog.py SECONDS COMMAND...

When standard input is closed, because the parent has ended or was killed, the server is terminated, and
killed after SECONDS. When the server has ended, for any reason, every process that it started is killed too,
including
those that left its process group: on Linux the watchdog adopts the server's orphans. (vLLM's engine processes
outlive a server that was killed, and keep the GPU's memory.)
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


def _end_with_parent(server: subprocess.Popen[bytes], seconds: float) -> None:
    while os.read(0, 1024):
        pass
    server.terminate()
    try:
        server.wait(seconds)
    except subprocess.TimeoutExpired:
        server.kill()


def _kill_descendants() -> None:
    """Kill all children of this process, including adopted ones, until there are none."""
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
    """Run the command, and exit with its status."""
    seconds, command = float(sys.argv[1]), sys.argv[2:]
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    server = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        preexec_fn=lambda: _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),  # safe: no thread runs yet
    )
    threading.Thread(target=_end_with_parent, args=(server, seconds), daemon=True).start()
    status = server.wait()
    _kill_descendants()
    os._exit(status if status >= 0 else 128 - status)


if __name__ == "__main__":
    main()
