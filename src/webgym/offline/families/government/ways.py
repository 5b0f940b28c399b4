"""Ways to say dates, fees and durations on the authorities' websites."""

from __future__ import annotations

from datetime import date
from typing import TYPE_CHECKING

from webgym.offline.families.government.catalog import Service

if TYPE_CHECKING:
    from webgym.offline.families.government import Government


def date_of(day: date) -> tuple[str, ...]:
    """Ways to say a date."""
    month = f"{day:%B}"
    return (
        f"{day.day} {month}",
        f"{month} {day.day}",
        f"{day.day} {day:%b}",
        f"{day:%b} {day.day}",
        day.isoformat(),
    )


def fee_of(site: Government, service: Service) -> tuple[str, ...]:
    """Ways to say a fee."""
    return site.money(service.fee), f"{service.fee} {_CURRENCIES[site.currency]}", f"{service.fee}.00"


_CURRENCIES = {"£": "pounds", "€": "euros", "$": "dollars"}


def working_days(service: Service) -> tuple[str, ...]:
    """Ways to say a processing time; the first as the pages write it."""
    day = "day" if service.days == 1 else "days"
    return f"{service.days} working {day}", f"{service.days} {day}"


def paid(site: Government, value: int) -> tuple[str, ...]:
    """Ways to say an amount."""
    return site.money(value), f"{value} {_CURRENCIES[site.currency]}", str(value), f"{value}.00"
