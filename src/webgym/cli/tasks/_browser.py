"""Browsing tasks in a terminal by keys. Linux and macOS terminals."""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import termios
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from rich.console import Console, RenderableType
from rich.text import Text

from webgym.cli.tasks._pages import page_of, table_of
from webgym.tasks.index import TaskIndex

_ENTER_SCREEN: Final = "\x1b[?1049h\x1b[?25l"
_LEAVE_SCREEN: Final = "\x1b[?25h\x1b[?1049l"
_HOME: Final = "\x1b[H"
_TO_LINE_END: Final = "\x1b[K"
_TO_END: Final = "\x1b[J"
_KEYS: Final = {
    "\x1b[A": "up",
    "\x1b[B": "down",
    "\x1bOA": "up",
    "\x1bOB": "down",
    "\x1b[5~": "p",
    "\x1b[6~": "n",
    "\x1b": "q",
    "\x7f": "q",
    "\r": "enter",
    "\n": "enter",
    " ": "n",
    "k": "up",
    "j": "down",
    "\x04": "q",
}
_ONE_KEY: Final = re.compile(r"\x1b(?:\[[0-9;]*[A-Za-z~]|O[A-Z])?|.", re.DOTALL)
_FRAME: Final = 3
"""Lines around the tasks: two of heading, one of keys."""


class Browser:
    """A list of tasks, and one of them when it is opened.

    Args:
        index: of all tasks, for families.
        places: of the tasks to browse.
    """

    def __init__(self, index: TaskIndex, places: Sequence[int]) -> None:
        self._index = index
        self._places = places
        self._at = 0
        self._is_open = False
        self._scrolled = 0

    def run(self) -> None:
        """Show and obey until the user leaves."""
        with _whole_screen():
            self._draw()
            for key in _keys():
                if not self._obey(key):
                    return
                self._draw()

    def _obey(self, key: str) -> bool:
        """Do what a key asks; whether to continue."""
        if key == "q" and not self._is_open:
            return False
        if key in ("q", "b"):
            self._is_open = False
        elif key == "enter":
            self._is_open, self._scrolled = True, 0
        elif self._is_open and key in ("up", "down"):
            self._scrolled = max(0, self._scrolled + (1 if key == "down" else -1))
        elif key in ("n", "p", "up", "down"):
            by = 1 if self._is_open or key in ("up", "down") else self._rows()
            self._move(by if key in ("n", "down") else -by)
        return True

    def _move(self, by: int) -> None:
        self._at = min(max(0, self._at + by), len(self._places) - 1)
        self._scrolled = 0

    def _rows(self) -> int:
        return max(1, shutil.get_terminal_size().lines - _FRAME)

    def _draw(self) -> None:
        size = shutil.get_terminal_size()
        if self._is_open:
            task = self._index.tasks[self._places[self._at]]
            lines = _lines(page_of(task, self._index), size.columns)
            room = size.lines - 1
            self._scrolled = min(self._scrolled, max(0, len(lines) - room))
            lines = lines[self._scrolled : self._scrolled + room]
            keys = "n next  p previous  j/k scroll  q back"
        else:
            rows = self._rows()
            first = self._at - self._at % rows
            shown = [self._index.tasks[place] for place in self._places[first : first + rows]]
            lines = _lines(table_of(shown, cursor=self._at - first), size.columns)
            room = size.lines - 1
            keys = "n next page  p previous page  j/k move  Enter open  q quit"
        where = f"{self._at + 1} of {len(self._places)}"
        foot = Text.assemble((f" {where} ", "reverse"), "  ", (keys, "dim"), no_wrap=True, overflow="crop")
        lines = [*lines, *[""] * (room - len(lines)), *_lines(foot, size.columns)[:1]]
        sys.stdout.write(_HOME + f"{_TO_LINE_END}\r\n".join(lines[: size.lines]) + _TO_LINE_END + _TO_END)
        sys.stdout.flush()


def _lines(shown: RenderableType, width: int) -> list[str]:
    told = io.StringIO()
    console = Console(file=told, width=width, force_terminal=True, highlight=False)
    console.print(shown)
    return told.getvalue().rstrip("\n").split("\n")


@contextmanager
def _whole_screen() -> Iterator[None]:
    """The terminal's other screen, keys as they are pressed; everything as it was afterwards."""
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    try:
        tty.setcbreak(fd)
        sys.stdout.write(_ENTER_SCREEN)
        yield
    finally:
        sys.stdout.write(_LEAVE_SCREEN)
        sys.stdout.flush()
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


def _keys() -> Iterator[str]:
    """Keys by their names, as they are pressed; a terminal that is gone is one that was left."""
    while pressed := os.read(sys.stdin.fileno(), 256).decode(errors="replace"):
        for key in _ONE_KEY.findall(pressed):
            yield _KEYS.get(key, key)
