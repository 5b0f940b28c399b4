"""What pages can find out about the browser, compared with a headed Chromium on a virtual screen.

.venv/bin/python benchmarks/desktop.py            # Debian packages: xvfb, chromium
.venv/bin/python benchmarks/desktop.py --write    # stores the headed browser's answers in the package
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path

from webgym.browser import questions
from webgym.browser.find import find_browser
from webgym.browser.questions import Answers

PROGRAMS = ("xvfb-run", "chromium")
STORED = Path(questions.__file__).with_name("headed.json")
SCREEN = "-screen 0 1920x1080x24"


@contextlib.asynccontextmanager
async def running(*command: str) -> AsyncIterator[None]:
    """Run a program, and end it with everything that it started."""
    quiet = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(
        *command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True
    )
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)  # xvfb-run ends the screen, too
        await process.wait()


async def ask_headed() -> Answers:
    """The answers of a headed Chromium."""
    ended = asyncio.Event()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        flags = ["--no-sandbox", "--no-first-run", "--lang=en-US", f"--user-data-dir={folder}"]

        async def visit(url: str) -> None:
            async def run() -> None:
                async with running("xvfb-run", "-a", "-s", SCREEN, "chromium", *flags, url):
                    await ended.wait()

            tasks.append(asyncio.create_task(run()))

        tasks: list[asyncio.Task[None]] = []
        try:
            return await questions.ask(visit)
        finally:
            ended.set()
            await asyncio.gather(*tasks)


async def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help="store the headed browser's answers")
    arguments = parser.parse_args()
    if missing := [name for name in PROGRAMS if shutil.which(name) is None]:
        sys.exit(f"not installed: {', '.join(missing)}")
    headed = await ask_headed()
    if arguments.write:
        STORED.write_text(json.dumps(headed, indent=1, ensure_ascii=False) + "\n", "utf-8")
    ours = await questions.ask_own(find_browser().path)
    found = questions.differences(ours, headed)
    for one in found:
        print(one)
    unwanted = sum(not one.reason for one in found)
    print(f"{len(headed)} questions, {len(found)} differ, {unwanted} of them without a reason")
    return int(unwanted > 0)


if __name__ == "__main__":
    sys.exit(asyncio.run(main()))
