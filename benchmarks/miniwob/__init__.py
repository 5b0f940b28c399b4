"""The tasks of MiniWoB++, solved by scripts with the actions of agents.

The pages are those of the package ``miniwob`` on PyPI, which is downloaded at the first run. The scripts
read the instruction and the document of the page, and act only by actions of :mod:`webgym.core.action`,
with coordinates or marks.
"""
