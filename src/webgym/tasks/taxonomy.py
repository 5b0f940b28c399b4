"""The domains of tasks: the taxonomy of Mind2Web-2, with 6 domains and 24 subdomains."""

from __future__ import annotations

from typing import Final

DOMAINS: Final[dict[str, tuple[str, ...]]] = {
    "Lifestyle & Leisure": (
        "Shopping",
        "Food & Cooking",
        "Sports & Fitness",
        "Health & Medicine",
        "Pets & Animal Welfare",
        "Fashion & Beauty",
        "Hobbies & DIY",
    ),
    "Entertainment": (
        "Films & TV Shows",
        "Gaming & Virtual Worlds",
        "Live Shows & Performances",
        "Music",
        "Books & Reading",
    ),
    "Misc.": ("General Info.", "News", "Legal & Government Services", "Real Estate", "Finance & Investment"),
    "Science & Research": ("Research & Academia", "Technology & Science"),
    "Career & Education": ("Education & Learning", "Jobs & Career"),
    "Travel & Transportation": ("Travel & Accommodation", "Outdoor & Recreation", "Ticketed Activities"),
}
"""Subdomains by domain. The dots are part of the names."""

DOMAIN_OF: Final[dict[str, str]] = {
    subdomain: domain for domain, subdomains in DOMAINS.items() for subdomain in subdomains
}
"""The domain of each subdomain; subdomains are unique."""
