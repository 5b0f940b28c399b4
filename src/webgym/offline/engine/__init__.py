"""The engine of the large families: a website follows from a specification, a TOML file beside the families.

spec.py          the specification: fields, forms, words
records.py       items with values, and how pages and answers write them
spelling.py      lists, numbers, times, days and quantities, in all the ways that an answer may spell them
specified.py     the website: list, item, forms, saved list
extras.py        what some have beside: groups, reviews, cart, account
item_tasks.py    tasks on its items, and the ways to them
tasks.py         all tasks of a website, of parts that are drawn until they are well posed
cross_site.py    tasks on two websites
"""
