"""Choosing files, of those that the task comes with and no others."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from webgym.browser.cdp_messages import FileChooser
from webgym.browser.page import Page
from webgym.browser.pointer import Point, click
from webgym.browser.settle import settle
from webgym.core.errors import ActionFailed
from webgym.core.task import Attachment


@contextmanager
def _choosing(page: Page) -> Iterator[list[FileChooser]]:
    """What asks for files during the block. It is not told as refused."""
    found: list[FileChooser] = []
    page.choosers = found
    try:
        yield found
    finally:
        page.choosers = None


async def upload(page: Page, point: Point, names: Sequence[str]) -> None:
    """Click here and choose these files.

    Raises:
        ActionFailed: the task has no such file, or nothing here takes them.
    """
    for name in names:
        if name not in page.files:
            there = ", ".join(f'"{one}"' for one in page.files) or "none"
            raise ActionFailed(f'the task comes with no file "{name[:100]}"; its files: {there}')
    with _choosing(page) as choosers:
        await click(page, point)
        if not choosers:
            await settle(page)  # a script may ask a moment later
    if not choosers:
        raise ActionFailed("nothing at this place asks for a file")
    chooser = choosers[0]
    if len(names) > 1 and chooser.mode != "selectMultiple":
        raise ActionFailed("only one file can be chosen here")
    chosen = {
        "files": [str(page.files[name]) for name in names],
        "backendNodeId": chooser.backend_node_id,
    }
    await page.session.do("DOM.setFileInputFiles", chosen, seconds=page.config.execute_seconds)


async def lay_out(files: Sequence[Attachment], folder: Path) -> dict[str, Path]:
    """Write a task's files where a browser can read them. Gives where each is.

    Raises:
        OSError: they cannot be written.
    """
    return await asyncio.to_thread(_lay_out, files, folder)


def _lay_out(files: Sequence[Attachment], folder: Path) -> dict[str, Path]:
    folder.mkdir(mode=0o700, exist_ok=True)
    for old in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):
            old.unlink()
    paths = {file.name: folder / file.name for file in files}
    for file in files:
        paths[file.name].write_bytes(file.content)
    return paths
