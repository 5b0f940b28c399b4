"""``webgym bench soak``: a real server under random faults, and whether its books balance afterwards.

plan.py      how long, how many, and the server's limits
clients.py   programs that use browsers, on calm and on hostile pages
callers.py   programs that vanish, stop halfway, or hold the line
faults.py    what is killed, stopped and filled meanwhile
target.py    the server: a gateway and its workers as processes of their own
disk.py      a small disk of their own for the browsers' profiles
leaks.py     what exists before and afterwards
books.py     what was done, what came of it, and whether it adds up
run.py       all of it together
report.py    tables
"""

from __future__ import annotations

from webgym.bench.soak.books import Books
from webgym.bench.soak.plan import SoakPlan
from webgym.bench.soak.report import progress_line, soak_tables
from webgym.bench.soak.run import Soak, soak

__all__ = ["Books", "Soak", "SoakPlan", "progress_line", "soak", "soak_tables"]
