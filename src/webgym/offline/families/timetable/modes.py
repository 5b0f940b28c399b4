"""What kinds of operators there are, and what is particular to each."""

from __future__ import annotations

from webgym.offline.data import Table, load


class Mode(Table, frozen=True):
    """One kind of operator.

    Attributes:
        name: of the kind.
        suffixes: second words of its brands.
        subdomain: of the taxonomy, under "Travel & Transportation".
        stop, stops: what a place on its network is called.
        vehicle, vehicles: what departs.
        line: what stops in a row are called.
        bay: where at a stop it departs from.
        prefixes: first parts of service codes.
        stop_names: patterns for the names of stops.
        classes: fare classes with their price factors, the cheapest first.
        seats: seat preferences.
        step_km: least and greatest distance between neighbouring stops.
        speed: km/h.
        overhead: minutes that every journey takes on top.
        fare: basic fare and fare per km, in the website's currency.
        hours: earliest and latest departure, hours.
        a_day: fewest and most departures of a pair of stops on a day.
        facilities: what a stop may have.
        amenities: what a vehicle may have.
        extras: what can be added to a booking, with its price.
        causes: of disruptions.
        taglines: under the brand.
    """

    name: str
    suffixes: tuple[str, ...]
    subdomain: str
    stop: str
    stops: str
    vehicle: str
    vehicles: str
    line: str
    bay: str
    prefixes: tuple[str, ...]
    stop_names: tuple[str, ...]
    classes: tuple[tuple[str, float], ...]
    seats: tuple[str, ...]
    step_km: tuple[int, int]
    speed: int
    overhead: int
    fare: tuple[float, float]
    hours: tuple[int, int]
    a_day: tuple[int, int]
    facilities: tuple[str, ...]
    amenities: tuple[str, ...]
    extras: tuple[tuple[str, int], ...]
    causes: tuple[str, ...]
    taglines: tuple[str, ...]


class Stock(Table, frozen=True):
    """``modes.toml``."""

    modes: tuple[Mode, ...]


MODES = load("webgym.offline.families.timetable", "modes.toml", Stock).modes
