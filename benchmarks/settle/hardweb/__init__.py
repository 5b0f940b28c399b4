"""Pages for which it is hard to tell when they are finished, and which record when they are.

page.py     the type of a page
apps.py     pages like applications, with noise
pages.py    all pages: what each does, the action, and when its content is final
server.py   the server, which responds late, in chunks, with redirects, or never
"""

from __future__ import annotations

from benchmarks.settle.hardweb.page import Group, HardPage
from benchmarks.settle.hardweb.pages import OTHER_HOST, PAGES, TRUTH
from benchmarks.settle.hardweb.server import HardSite

__all__ = ["OTHER_HOST", "PAGES", "TRUTH", "Group", "HardPage", "HardSite"]
