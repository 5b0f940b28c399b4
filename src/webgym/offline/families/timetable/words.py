"""The words that operators' websites choose from."""

from __future__ import annotations

LABELS: dict[str, tuple[str, ...]] = {
    "from": ("From", "Leaving from", "Departing from", "Origin", "Start"),
    "to": ("To", "Going to", "Travelling to", "Destination", "Finish"),
    "date": ("Date", "Day of travel", "Travel date", "When", "Outward date"),
    "people": ("Passengers", "Travellers", "Number of travellers", "People"),
    "search": ("Find departures", "Show departures", "Check times and fares", "Search now", "Plan my trip"),
    "sort": ("Sort by", "Order by", "Show first", "Arrange by"),
    "direct": ("Direct only", "No changes", "Without changes", "Direct journeys only"),
    "period": ("Time of day", "Departing", "Leave", "Departure window"),
    "arrive": ("Arrive by", "Arrival no later than", "Latest arrival"),
    "by_time": ("Departure time", "Earliest first", "Time"),
    "by_price": ("Lowest price", "Price: low to high", "Cheapest first"),
    "by_length": ("Shortest journey", "Fastest first", "Journey time"),
    "details": ("Details", "View", "Select", "See journey"),
    "choose": ("Choose", "Book", "Reserve", "Continue with"),
    "name": ("Full name", "Name of lead passenger", "Passenger name", "First and last name"),
    "email": ("E-mail", "E-mail address", "Your e-mail", "Email for tickets"),
    "seat": ("Seat preference", "Where would you like to sit", "Preferred place"),
    "terms": ("I accept the conditions of carriage", "I have read the terms", "I agree to the conditions"),
    "reference": ("Booking reference", "Reservation code", "Reference"),
    "surname": ("Surname", "Last name", "Family name"),
    "extra": ("Add an extra", "Extras", "Add to this booking"),
    "timetable": ("Plan a journey", "Timetable", "Times and fares", "Book"),
    "lines": ("Lines", "Network", "Our lines", "Route map"),
    "fares": ("Fares and conditions", "Ticket guide", "Fare rules", "Tickets"),
    "status": ("Disruptions", "Service updates", "Travel alerts", "Live status"),
    "manage": ("My booking", "Manage booking", "Find my booking", "Your trips"),
    "alerts": ("Alert service", "E-mail alerts", "Get notified", "Subscribe to alerts"),
    "account": ("Club account", "Member area", "Rewards", "My points"),
    "help": ("Help", "Questions and answers", "Customer help", "FAQ"),
    "types": ("Ticket types", "Which ticket?", "Our tickets"),
    "luggage": ("Luggage", "Bags", "What you can bring"),
    "children": ("Children and groups", "Family and groups", "Reductions"),
    "animals": ("Bicycles and pets", "Animals and bicycles", "Pets and bikes"),
}
"""Words a website chooses from: one of every row."""

TICKETS: tuple[tuple[str, str, str, str], ...] = (
    ("Saver", "Semi-flex", "Flex", "Anytime"),
    ("Basic", "Classic", "Plus", "Free"),
    ("Early", "Standard", "Open", "Open Plus"),
    ("Light", "Smart", "Comfort", "Max"),
    ("Blue", "Green", "Silver", "Gold"),
)

HELP: tuple[tuple[str, str, str], ...] = (
    (
        "How do I claim money back for a delay?",
        "claim money back for a delayed journey",
        "Keep your ticket. Fill in form {form} within {days} days, add a copy of the ticket and post it to "
        "the {desk}. Payment takes about {weeks} weeks.",
    ),
    (
        "How do I report lost property?",
        "report something that was lost on board",
        "Note the service code and your seat. Fill in form {form} on the day or call the {desk} "
        "within {days} days. Found things are kept for {weeks} weeks.",
    ),
    (
        "How do I book assistance?",
        "book assistance for a passenger who uses a wheelchair",
        "Send form {form} to the {desk} at least {days} days ahead. Staff meet you {minutes} minutes before "
        "departure at the main entrance.",
    ),
    (
        "How do I make a group booking?",
        "book places for a large group",
        "Groups of {group} or more send form {form} to the {desk}. The offer stays open for {days} days.",
    ),
    (
        "How do I change the name on a ticket?",
        "change the name on a ticket",
        "Hand in form {form} at the {desk} no later than {days} days before travel, together with a copy "
        "of an identity card.",
    ),
    (
        "How do I get a receipt for my employer?",
        "get a receipt for an employer",
        "Send form {form} to the {desk} within {days} days of travel; the receipt arrives by e-mail after "
        "{minutes} minutes.",
    ),
)
"""Question, what a task calls it, and the answer."""

DESKS = (
    "Customer Relations Desk",
    "Passenger Care Office",
    "Travel Care Team",
    "Service Centre",
    "Guest Relations Office",
)

LINE_NAMES = (
    "Coast Heron Amber Summit Valley Lakes Copper Forest Border Harvest Orchard Granite Lantern Swift Meadow "
    "Crown"
).split()
