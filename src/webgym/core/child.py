"""Processes that end with the process that started them, however that one ends.

The parent holds the other end of the pipe that is the child's standard input, which closes when the parent
closes it, ends or is killed. A program of ours waits for that with :func:`call_at_parents_end`. Any other
program runs under this file, which uses only the standard library (:func:`watched`)::

    python -I child.py SECONDS COMMAND...

At the parent's end the program is terminated, and killed after SECONDS. When it has ended, for any reason,
every process that it started is killed too, including those that left its process group: on Linux this
process adopts its orphans. (vLLM's engine processes outlive a server that was killed, and keep the GPU's
memory.)
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

_PR_SET_PDEATHSIG = 1
"""The option of prctl(2): the signal that the kernel sends a process when its parent ends."""
_PR_SET_CHILD_SUBREAPER = 36


def call_at_parents_end(call: Callable[[], object], seconds: float) -> None:
    """Call a function, in a thread, when the parent closes the pipe or ends; ``seconds`` later, this process
    exits if it has not ended by then."""
    # A process that is stopped (SIGSTOP) when its parent is killed would never see the pipe close.
    _prctl(_PR_SET_PDEATHSIG, signal.SIGCONT)

    def wait() -> None:
        while os.read(0, 1024):
            pass
        call()
        threading.Event().wait(seconds)
        os._exit(1)

    threading.Thread(target=wait, name="parents-end", daemon=True).start()


def watched(command: Sequence[str], seconds: float) -> list[str]:
    """The command that runs another one until its parent ends. Start it with a pipe as standard input.

    Args:
        command: program and arguments.
        seconds: how long it may take to end.
    """
    return [sys.executable, "-I", __file__, str(seconds), *command]


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):  # not Linux
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _end(process: subprocess.Popen[bytes], seconds: float) -> None:
    process.terminate()
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()


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
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        preexec_fn=lambda: _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),  # safe: no thread runs yet
    )
    call_at_parents_end(lambda: _end(process, seconds), 2 * seconds)
    status = process.wait()
    _kill_descendants()
    os._exit(status if status >= 0 else 128 - status)


if __name__ == "__main__":
    main()
