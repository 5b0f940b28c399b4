"""The offline web: websites made from seeds, with their tasks, truths and solutions.

families/   the kinds of large websites: a specification each
engine/     the engine that makes a website of a specification: pages, forms, tasks
small/      small websites, for policies of a few million parameters
website.py  what every website is: routes, pages, a visitor's state
parts.py    what a task is made of, and the rule that decomposes it
look.py     palettes, fonts, layouts and pictures, so that no two websites look the same
web.py      all websites of a seed, their tasks and the split
app.py      the ASGI application that serves them on their own hostnames
"""
