"""Pages that are hard to call finished, each with the truth about when it is.

page.py     what a page is
apps.py     pages as people meet them, noisy
pages.py    the corpus: what each page does, the action, and the moment when its content is final
server.py   the server behind them: late, in pieces, in chains, or never
"""

from __future__ import annotations

from benchmarks.settle.hardweb.page import Group, HardPage
from benchmarks.settle.hardweb.pages import OTHER_HOST, PAGES, TRUTH
from benchmarks.settle.hardweb.server import HardSite

__all__ = ["OTHER_HOST", "PAGES", "TRUTH", "Group", "HardPage", "HardSite"]
