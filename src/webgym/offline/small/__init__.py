"""Small websites: pages of a few large signs, for policies of a few million parameters.

A page is 192 by 128 pixels, a grid of 6 by 4 cells of 32 by 32, and never scrolls. Whatever must be read
is a sign that fills a cell: a colour, an icon, a number or a short word. Instructions, answers and what is
to be remembered are made of one small vocabulary, :func:`small_vocabulary`.

questions.py  from records to parts of tasks: look up, compare, extreme, count, either-or; the words
design.py     theme, layout and signs of a website, and which combinations are held out
screen.py     a page: signs on a grid of cells
site.py       what every small website is, and its tasks, composed of parts

Data lies beside the code in TOML files: a family's own holds how its tasks are asked.
"""

from __future__ import annotations

from webgym.offline.small.catalog import Board, Market
from webgym.offline.small.desk import Desk
from webgym.offline.small.questions import WORDING, small_vocabulary
from webgym.offline.small.signpost import Signpost
from webgym.offline.small.trail import Trail
from webgym.offline.website import Website

__all__ = ["FAMILIES", "WORDING", "small_vocabulary"]

FAMILIES: tuple[type[Website], ...] = (Market, Signpost, Desk, Board, Trail)
