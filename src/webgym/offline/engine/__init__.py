"""The declarative engine: a website is a table of fields and a few specifications; tasks follow from them.

table.py      what a website knows: records with fields
questions.py  from a table to parts of tasks: look up, compare, extreme, count, either-or
cart.py       what is put into a cart, and how it is proven
form.py       a form as a specification: choices, their pages, what is sent, and how it is proven
compose.py    from parts to a website's tasks, in a mix of difficulties

Pages are apart from all this, so that rich pages and pages of a few signs can stand on the same tables:

signs.py      what a small page can show: colours, icons, numbers, short words
design.py     theme, layout and stock of signs of a small website, and which combinations are held out
screen.py     a small page: signs on a grid of cells
site.py       what every small website is

Large websites follow from a specification, a TOML file beside the family:

spec.py       the specification: fields, forms, words
records.py    items with values, and how pages and answers write them
specified.py  the website: list, item, forms, saved list
extras.py     what some have beside: groups, reviews, cart, account
errands.py    its tasks; look_ups.py and beside.py have what is asked, ways.py how one gets there
finder.py     filters and an order of a list, for pages, solutions and evidence alike
composing.py  tasks of parts that are drawn until they are well posed
asking.py, saying.py  addresses as patterns, lists, and the ways to spell what is answered
"""
