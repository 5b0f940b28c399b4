"""The offline web: websites made from seeds, with their tasks, truths and solutions.

families/   one package per kind of website: its catalogue, its pages, its tasks
engine/     the declarative engine, from which the newer families follow
website.py  what every website is: routes, pages, a visitor's state
parts.py    what a task is made of, and the rule that decomposes it
look.py     palettes, fonts and layouts, so that no two websites look the same
web.py      all websites of a seed, their tasks and the split
app.py      the ASGI application that serves them on their own hostnames
"""
