"""The tasks of MiniWoB++, solved by scripts that act as an agent does.

The pages come from the package ``miniwob`` of the package index, at the first run; nothing of them is part
of this repository. What is to be done is read from the instruction and the page's document, as a person
would read it from the picture; it is done by the actions of :mod:`webgym.core.action` alone, by coordinates
or by marks.
"""
