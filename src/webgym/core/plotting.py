"""Style and output of figures for a paper. The same data give identical files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from webgym.core.errors import UsageError

COLUMN: Final = 3.4
"""Width of a figure in inches: one column of a two-column paper."""
PAGE: Final = 7.0
"""Width of a figure in inches: both columns."""

INK, MUTED = "#222222", "#666666"
CATEGORIES: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
"""The colours of Okabe and Ito, which people with any colour vision can distinguish."""

_DPI: Final = 300
_METADATA: Final[dict[str, dict[str, None]]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
"""By suffix: metadata to omit, as it would differ between two files of the same figure."""


@contextmanager
def styled() -> Iterator[None]:
    """Apply our style to figures that are made and saved in the block."""
    style = Path(__file__).with_name("figures.mplstyle")
    with mpl.rc_context(mpl.rc_params_from_file(style, use_default_template=False)):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure.

    Args:
        width: in inches.
        height: in inches.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def check_suffix(path: Path) -> str:
    """The suffix of a figure's file.

    Raises:
        UsageError: it is unknown.
    """
    suffix = path.suffix.casefold()
    if suffix not in _METADATA:
        known = ", ".join(_METADATA)
        raise UsageError(f"{path.name} has no suffix of a figure format", hint=f"use one of {known}")
    return suffix


def save(figure: Figure, path: Path) -> None:
    """Write a figure to a file, in the format of the suffix (``.png``, ``.svg``, ``.pdf``).

    Raises:
        UsageError: the suffix is unknown, or the file cannot be written.
    """
    suffix = check_suffix(path)
    if (layout := figure.get_layout_engine()) is not None:
        # Once for the files in all formats, and without drawing: it takes most of the time.
        figure.set_dpi(_DPI)
        layout.execute(figure)
        figure.set_layout_engine(None)
    try:
        figure.savefig(path, dpi=_DPI, metadata=_METADATA[suffix])
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror}") from error
