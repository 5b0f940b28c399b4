"""The declarative engine: a website is a table of fields and a few specifications; tasks follow from them.

data.py       reads words and specifications from TOML into typed structs
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
"""
