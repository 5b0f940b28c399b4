"""File uploads, restricted to the files that come with the task."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from webgym.browser.cdp_messages import FileChooser
from webgym.browser.page import Page
from webgym.browser.pointer import Point, click, drop_files
from webgym.browser.settle import settle
from webgym.core.errors import ActionFailed
from webgym.core.task import Attachment


@contextmanager
def _collecting_choosers(page: Page) -> Iterator[list[FileChooser]]:
    """Collect the file choosers that open during the block, instead of reporting them as refused."""
    choosers: list[FileChooser] = []
    page.choosers = choosers
    try:
        yield choosers
    finally:
        page.choosers = None


async def upload(page: Page, point: Point, names: Sequence[str]) -> None:
    """Click at a point and choose these files in the file chooser that opens; if none does, drop them there.

    Raises:
        ActionFailed: the task has no such file, or this place takes none, or only one.
    """
    for name in names:
        if name not in page.files:
            available = ", ".join(f'"{file}"' for file in page.files) or "none"
            raise ActionFailed(f'the task comes with no file "{name[:100]}"; its files: {available}')
    with _collecting_choosers(page) as choosers:
        await click(page, point)
        if not choosers:
            await settle(page)  # a script may open it with a delay
    paths = [str(page.files[name]) for name in names]
    if not choosers:
        if not await drop_files(page, point, paths):
            raise ActionFailed("nothing at this place asks for a file")
        return
    chooser = choosers[0]
    if len(names) > 1 and chooser.mode != "selectMultiple":
        raise ActionFailed("only one file can be chosen here")
    chosen = {"files": paths, "backendNodeId": chooser.backend_node_id}
    await page.session.do("DOM.setFileInputFiles", chosen, seconds=page.config.execute_seconds)


async def write_files(files: Sequence[Attachment], folder: Path) -> dict[str, Path]:
    """Write a task's files to a folder that the browser can read. Returns their paths by name.

    Raises:
        OSError: they cannot be written.
    """
    return await asyncio.to_thread(_write_files, files, folder)


def _write_files(files: Sequence[Attachment], folder: Path) -> dict[str, Path]:
    folder.mkdir(mode=0o700, exist_ok=True)
    for old in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):
            old.unlink()
    paths = {file.name: folder / file.name for file in files}
    for file in files:
        paths[file.name].write_bytes(file.content)
    return paths
