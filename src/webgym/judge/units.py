"""Units, currencies, months and number words, as answers write them."""

from __future__ import annotations

from decimal import Decimal
from typing import Final

_UNITS: Final = """
length    mm millimetre millimetres millimeter millimeters = 0.001
length    cm centimetre centimetres centimeter centimeters = 0.01
length    m metre metres meter meters = 1
length    km kms kilometre kilometres kilometer kilometers = 1000
length    inch inches = 0.0254
length    ft foot feet = 0.3048
length    yd yds yard yards = 0.9144
length    mi mile miles = 1609.344
mass      mg milligram milligrams = 0.001
mass      g gram grams gramme grammes = 1
mass      kg kgs kilo kilos kilogram kilograms = 1000
mass      tonne tonnes = 1000000
mass      oz ounce ounces = 28.349523125
mass      lb lbs = 453.59237
time      ms millisecond milliseconds = 0.001
time      s sec secs second seconds = 1
time      min mins minute minutes = 60
time      h hr hrs hour hours = 3600
time      day days = 86400
time      week weeks wk wks = 604800
months    month months mo mos = 1
months    year years yr yrs = 12
volume    ml millilitre millilitres milliliter milliliters = 0.001
volume    cl centilitre centilitres = 0.01
volume    l litre litres liter liters = 1
volume    gal gallon gallons = 3.785411784
volume    cup cups = 0.2365882365
volume    tbsp tablespoon tablespoons = 0.01478676478125
volume    tsp teaspoon teaspoons = 0.00492892159375
area      m2 sqm = 1
area      km2 = 1000000
area      ha hectare hectares = 10000
area      acre acres = 4046.8564224
area      sqft ft2 = 0.09290304
speed     km/h kmh kph = 1
speed     mph = 1.609344
speed     m/s = 3.6
data      kb kilobyte kilobytes = 1000
data      mb megabyte megabytes = 1000000
data      gb gigabyte gigabytes = 1000000000
data      tb terabyte terabytes = 1000000000000
bitrate   kbps = 0.001
bitrate   mbps = 1
bitrate   gbps = 1000
power     w watt watts = 1
power     kw kilowatt kilowatts = 1000
power     mw megawatt megawatts = 1000000
energy    wh = 0.001
energy    kwh = 1
food      kcal calorie calories cal cals = 1
frequency hz = 1
frequency khz = 1000
frequency mhz = 1000000
frequency ghz = 1000000000
celsius   °c celsius = 1
fahrenheit °f fahrenheit = 1
angle     ° degree degrees = 1
percent   % percent pct = 1
"""

UNITS: Final[dict[str, tuple[str, Decimal]]] = {
    name: (line.split()[0], Decimal(line.split("=")[1].strip()))
    for line in _UNITS.strip().splitlines()
    for name in line.split("=")[0].split()[1:]
}
"""Spelling to dimension, and size in the dimension's base unit."""

CASED_UNITS: Final = {"Kb": "kilobit", "Mb": "megabit", "Gb": "gigabit", "Tb": "terabit", "mW": "milliwatt"}
"""Units that differ from others only in case. They may be meant either way, so each is a unit of its own."""

CURRENCY_SIGNS: Final[dict[str, str]] = {
    "us$": "USD",
    "a$": "AUD",
    "au$": "AUD",
    "c$": "CAD",
    "ca$": "CAD",
    "nz$": "NZD",
    "hk$": "HKD",
    "s$": "SGD",
    "$": "USD",
    "€": "EUR",
    "£": "GBP",
    "¥": "JPY",
    "₹": "INR",
    "₩": "KRW",
    "₽": "RUB",
}
"""Sign to currency. A bare dollar sign means US dollars, a bare yen sign Japanese yen."""

CURRENCY_WORDS: Final[dict[str, tuple[str, Decimal]]] = {
    **{
        code.lower(): (code, Decimal(1))
        for code in (
            "USD EUR GBP JPY CNY INR KRW CHF AUD CAD NZD HKD SGD SEK NOK DKK PLN CZK BRL MXN ZAR".split()
        )
    },
    **dict.fromkeys(("dollar", "dollars", "bucks"), ("USD", Decimal(1))),
    **dict.fromkeys(("cent", "cents"), ("USD", Decimal("0.01"))),
    **dict.fromkeys(("euro", "euros"), ("EUR", Decimal(1))),
    **dict.fromkeys(("pence", "penny"), ("GBP", Decimal("0.01"))),
    "quid": ("GBP", Decimal(1)),
    "yen": ("JPY", Decimal(1)),
    **dict.fromkeys(("yuan", "rmb"), ("CNY", Decimal(1))),
    **dict.fromkeys(("rupee", "rupees", "rs"), ("INR", Decimal(1))),
    "won": ("KRW", Decimal(1)),
    **dict.fromkeys(("franc", "francs"), ("CHF", Decimal(1))),
}
"""Word after an amount to currency, and the size of what the word names in that currency."""

AMBIGUOUS_POUNDS: Final = frozenset({"pound", "pounds"})
"""Words for money or mass."""

SCALES: Final[dict[str, Decimal]] = {
    "dozen": Decimal(12),
    "hundred": Decimal("1E2"),
    "thousand": Decimal("1E3"),
    "million": Decimal("1E6"),
    "millions": Decimal("1E6"),
    "mn": Decimal("1E6"),
    "billion": Decimal("1E9"),
    "bn": Decimal("1E9"),
    "trillion": Decimal("1E12"),
    "tn": Decimal("1E12"),
    "lakh": Decimal("1E5"),
    "crore": Decimal("1E7"),
}
"""Word to factor. As powers of ten, so that 1.2 million is known to be precise to hundreds of thousands."""
SHORT_SCALES: Final[dict[str, Decimal]] = {"k": Decimal("1E3"), "m": Decimal("1E6"), "b": Decimal("1E9")}
"""Letter right after the digits to factor. M and B only for money; elsewhere they are a unit or a name."""

MONTHS: Final[dict[str, int]] = {
    name: number
    for number, names in enumerate(
        "january jan|february feb|march mar|april apr|may|june jun|july jul|august aug|september sept sep"
        "|october oct|november nov|december dec".split("|"),
        1,
    )
    for name in names.split()
}
WEEKDAYS: Final = (
    "monday|tuesday|wednesday|thursday|friday|saturday|sunday|mon|tues|tue|wed|thurs|thur|thu|fri|sat|sun"
)

_ONES = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen \
seventeen eighteen nineteen".split()
)
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety".split()
NUMBER_WORDS: Final[dict[str, int]] = {
    **{word: number for number, word in enumerate(_ONES)},
    **{word: 10 * number for number, word in enumerate(_TENS, 2)},
    **{f"{ten}-{one}": 10 * t + o for t, ten in enumerate(_TENS, 2) for o, one in enumerate(_ONES[1:10], 1)},
}
ORDINAL_WORDS: Final[dict[str, int]] = {
    word: number
    for number, word in enumerate(
        "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth "
        "fourteenth fifteenth sixteenth seventeenth eighteenth nineteenth twentieth".split(),
        1,
    )
}
