"""How an operator's website writes prices, times and the options of its dropdowns."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from functools import cached_property

from webgym.offline.families.timetable.data import Operator
from webgym.offline.families.timetable.modes import Mode
from webgym.offline.families.timetable.network import Departure, days_on_sale, spell

MOST_PEOPLE = 6


class Spelling:
    """Texts of a website.

    Attributes:
        currency: a pattern for prices.
        half_day: whether the clock has twelve hours.
    """

    mode: Mode
    network: Operator
    currency: str
    half_day: bool

    def money(self, cents: int) -> str:
        """A price: ``€24.50``."""
        return self.currency.format(f"{cents / 100:,.2f}")

    def clock(self, minute: int) -> str:
        """A time of day: ``07:42`` or ``7:42 am``."""
        hour, rest = divmod(minute % 1440, 60)
        if self.half_day:
            return f"{hour % 12 or 12}:{rest:02d} {'am' if hour < 12 else 'pm'}"
        return f"{hour:02d}:{rest:02d}"

    def arrival(self, departure: Departure) -> str:
        """Time of arrival, with the days that lie between."""
        minute = departure.minute + departure.length
        return self.clock(minute) + (f" (+{minute // 1440})" if minute >= 1440 else "")

    @staticmethod
    def span(minutes: int) -> str:
        """A length of time: ``2 h 05 min``."""
        hours, rest = divmod(minutes, 60)
        return f"{hours} h {rest:02d} min" if hours else f"{rest} min"

    @staticmethod
    def changes(departure: Departure) -> str:
        """``Direct`` or ``1 change``."""
        return "Direct" if departure.change is None else "1 change"

    @staticmethod
    def spell(day: date) -> str:
        """A day as this website writes it."""
        return spell(day)

    @cached_property
    def days(self) -> list[tuple[str, str]]:
        """Days on sale, for dropdowns: (ISO date, text)."""
        return [(day.isoformat(), spell(day)) for day in days_on_sale()]

    @cached_property
    def party(self) -> list[tuple[str, str]]:
        """Numbers of travellers, for dropdowns."""
        return [(str(n), str(n)) for n in range(1, MOST_PEOPLE + 1)]

    @cached_property
    def limits(self) -> list[tuple[str, str]]:
        """Latest arrivals, for the filter."""
        return [("", "Any time"), *((str(hour), self.clock(hour * 60)) for hour in (10, 12, 14, 16, 18, 20))]

    @cached_property
    def priced_extras(self) -> list[tuple[str, str]]:
        """Extras with their prices, for dropdowns."""
        return [(name, f"{name}, {self.money(price * 100)}") for name, price in self.mode.extras]

    @cached_property
    def line_options(self) -> list[tuple[str, str]]:
        """Lines, for dropdowns."""
        return [(line.slug, line.name) for line in self.network.lines]

    @cached_property
    def class_names(self) -> list[str]:
        """Fare classes, the cheapest first."""
        return [name for name, _ in self.mode.classes]

    @staticmethod
    def pairs(texts: Sequence[str]) -> list[tuple[str, str]]:
        """Options of a dropdown whose values are their texts."""
        return [(text, text) for text in texts]
