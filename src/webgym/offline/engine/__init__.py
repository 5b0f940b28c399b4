"""The engine of the large families: a website follows from a specification, a TOML file beside the families.

spec.py          the specification: fields, forms, words
table.py         records with fields, what the small websites stand on, too
records.py       items with values, and how pages and answers write them
spelling.py      lists, numbers, times, days and quantities, in all the ways that an answer may spell them
specified.py     the website: list, item, forms, saved list
extras.py        what some have beside: groups, reviews, cart, account
finder.py        filters, an order and the pages of a list, for pages, solutions and evidence alike
navigation.py    ways to an item's page, and what proves that a field of it was seen

tasks.py         the tasks of a website: those on its list, and the others in lookup_tasks.py, form_tasks.py
                 and extra_tasks.py
cross_site.py    tasks on two websites
composer.py      tasks of parts that are drawn until they are well posed
"""
