"""A few records of every source, written by hand in its native shape, and how to make files of them."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
from pathlib import Path
from typing import Any

REAL = Path(__file__).resolve().parents[4] / "shared" / "data"
"""Real files, where the checkout has them beside it. Never part of the repository."""

INSTA: list[dict[str, Any]] = [
    {
        "website": "museum.example.org",
        "instruction": "Find the opening hours of the café on Sundays.",
        "steps": ["Open https://museum.example.org.", "Open 'Visit'."],
        "criteria": ["The hours are those of the café: 10 to 16."],
    },
    {
        "website": "trains.example.co.uk",
        "instruction": "What does a day ticket cost in 2019?",
        "steps": [],
        "criteria": [],
    },
]
INSTA_V1: list[dict[str, Any]] = [
    {"domain": "library.example.net", "task": "Look up who may borrow books."},
    {"domain": "club.example.com", "task": "Find out when the club meets."},
]
WEBVOYAGER: list[dict[str, Any]] = [
    {
        "web_name": "Allrecipes",
        "id": "Allrecipes--0",
        "ques": "Find a lentil soup.",
        "web": "https://www.allrecipes.com/",
    },
    {
        "web_name": "Google Map",
        "id": "Google Map--1",
        "ques": "How far is it from Bonn to Köln?",
        "web": "https://www.google.com/maps/",
    },
    {
        "web_name": "Amazon",
        "id": "Amazon--31",
        "ques": "Find a kettle for a trip on March 3, 2024.",
        "web": "https://www.amazon.com/",
    },
]
WEBVOYAGER_ANSWERS = {
    "Allrecipes": {"notice": "", "answers": [{"id": 0, "type": "possible", "ans": "Red Lentil Soup"}]},
    "Google Map": {"notice": "", "answers": [{"id": 1, "type": "golden", "ans": "28 km"}]},
}
AGENTSYNTH: list[dict[str, Any]] = [
    {
        "website": "radio.example.com",
        "task": "On radio.example.com, find tonight's show.",
        "action_sequence": [
            json.dumps({"action_key": "click", "action_kwargs": {}, "target_element_id": 3}),
            json.dumps({"action_key": "stop", "action_kwargs": {"answer": "Night Owls"}}, indent=4),
        ],
        "thoughts_sequence": ["The schedule is linked.", "There it is."],
        "webpage_text": "Tonight: Night Owls",
    },
    {
        "task": "Find the three newest songs.",
        "website": "songs.example.com",
        "action_sequence": [{"action_key": "stop", "action_kwargs": {"answer": "A, B, C"}}],
        "thoughts_sequence": ["There they are."],
    },
]
TRAVELPLANNER: list[dict[str, Any]] = [
    {
        "org": "Bonn",
        "dest": "Kiel",
        "days": "3",
        "visiting_city_number": "1",
        "date": "['2022-03-16', '2022-03-17', '2022-03-18']",
        "people_number": "2",
        "local_constraint": "{'house rule': None, 'cuisine': ['Thai', 'Greek'], 'room type': 'private room'}",
        "budget": "1400",
        "query": 'Plan 3 days in Kiel for 2 people from Bonn, "by the sea", with $1,400.',
        "level": "easy",
        "reference_information": repr([{"Description": "Hotels", "Content": "x" * 200_000}]),
    }
]
TRAVELPLANNER_LINES: list[dict[str, Any]] = [
    {"idx": 1, "query": "Plan a trip to Ulm, March 13th to March 15th, 2022.", "plan": [{"days": 1}]},
    {"idx": 2, "query": "Plan a trip to Graz.", "plan": None},
]
MIND2WEB_LIVE: list[dict[str, Any]] = [
    {
        "index": 0,
        "task": "Find the shop nearest to 53111",
        "reference_task_length": 2,
        "evaluation": [
            {
                "match_function_name": "url_included_match",
                "content": {
                    "key": "",
                    "reference_answer": "shop.",
                    "url": "https://www.shop.example.com/?gclid=1",
                },
            },
            {
                "match_function_name": "url_exactly_match",
                "content": {"key": "zip", "reference_answer": "53111", "url": "https://maps.example.org/"},
            },
            {
                "match_function_name": "element_path_exactly_match",
                "method": "selector",
                "content": {
                    "reference_answer": ".a >b",
                    "netloc": "shop",
                    "url": "https://shop.example.com/",
                },
            },
        ],
    },
    {"index": "WXkY6pe", "task": "Open the cart", "reference_task_length": 1, "evaluation": []},
]
ONLINE_MIND2WEB: list[dict[str, Any]] = [
    {
        "task_id": "b7258ee0",
        "confirmed_task": "Find the shop nearest to 53111.",
        "website": "https://www.shop.example.com/",
        "reference_length": 8,
        "level": "medium",
    },
    {
        "task_id": "c1",
        "confirmed_task": "Compare two phones.",
        "website": "https://phones.example.com/compare?region=de#top",
        "reference_length": 5,
        "level": "easy",
    },
]
HUMAN_LABELS: list[dict[str, Any]] = [
    {"task_id": "b7258ee0", "confirmed_task": "Find the shop.", "SeeAct_human_label": "2"}
]
DEEPSHOP: list[dict[str, Any]] = [
    {
        "web_name": "Amazon",
        "id": "Amazon--31",
        "ques": "Find a compact camera on Amazon.",
        "web": "https://www.amazon.com/?language=en_US&currency=USD",
        "attribute": "Compact camera",
        "filter": "**",
        "sort": "None",
        "category": "Electronics",
        "difficulty": "easy",
    },
    {
        "web_name": "Amazon",
        "id": "Amazon--32",
        "ques": "Find a blender on Amazon.",
        "web": "https://www.amazon.com/?language=en_US&currency=USD",
        "attribute": "**Steel blender**",
        "filter": "",
        "sort": "**- **Blenders sortedBlenders by price by price** newest****",
        "category": "Home",
        "difficulty": "hard",
    },
]
MIND2WEB_2: dict[str, dict[str, Any]] = {
    "find_parks": {
        "task_description": "Find three parks.\n\n- With addresses.",
        "rubric_path": "./static/find_parks_rubric.json",
    },
    "buy_monitor": {"task_description": "Find a 34'' monitor.", "rubric_path": None},
}
MIND2WEB_2_TREE = {
    "eval_breakdown": [
        {
            "verification_tree": {
                "id": "root",
                "desc": "All of it",
                "critical": False,
                "score": 1.0,
                "status": "passed",
                "strategy": "parallel",
                "children": [
                    {
                        "id": "park_0",
                        "desc": "Park 1",
                        "critical": False,
                        "children": [
                            {"id": "a", "desc": "It is a state park", "critical": True, "children": []},
                            {"id": "b", "claim": "Its address is right", "critical": False, "children": []},
                        ],
                    }
                ],
            }
        }
    ]
}
GAIA: list[dict[str, Any]] = [
    {
        "task_id": "8e867cd7-0000",
        "Level": 1,
        "Final answer": "3",
        "id": "level1-1",
        "web": "https://www.google.com/",
        "ques": "How many albums did the band release between 2000 and 2009?",
    },
    {
        "task_id": "9f0",
        "Level": "2",
        "answer": "none",
        "id": "level2-2",
        "web": "https://www.google.com/",
        "ques": "Which of the three rivers is the longest?",
    },
]
PUBLISHED: list[dict[str, Any]] = [
    {
        "benchmark_name": "deepshop",
        "task_name": "Find a green controller rated above 4 stars.",
        "domain": "Electronics",
        "subdomain": "E-commerce Shopping",
        "website": "https://www.amazon.com/",
        "definite_answer": "",
        "task_id": "Amazon--100",
        "difficulty": 2,
        "evaluator_reference": [
            {"id": 1, "description": "product", "facts": ["Controller in green"]},
            {"id": 2, "description": "filter", "facts": ["Rated above 4 stars"]},
        ],
        "task_id_decomposed_from": None,
    },
    {
        "benchmark_name": "insta-v3",
        "task_name": "Find the museum's hours.",
        "domain": "Entertainment",
        "subdomain": "Books & Reading",
        "website": "https://museum.example.org/",
        "definite_answer": "10 to 16",
        "task_id": "17+2",
        "difficulty": 1,
        "evaluator_reference": [{"id": 1, "description": "hours", "facts": ["Hours OR days of opening"]}],
        "task_id_decomposed_from": "17",
        "distribution": "train",
    },
]


def browsecomp(question: str, answer: str, canary: str = "a canary", topic: str = "Music") -> dict[str, str]:
    """A row in BrowseComp's cipher."""

    def encrypt(plain: str) -> str:
        data = plain.encode()
        digest = hashlib.sha256(canary.encode()).digest()
        key = digest * (len(data) // len(digest) + 1)
        return base64.b64encode(bytes(a ^ b for a, b in zip(data, key, strict=False))).decode()

    return {"problem": encrypt(question), "answer": encrypt(answer), "problem_topic": topic, "canary": canary}


BROWSECOMP = [
    browsecomp("Which naïve painter wrote the song of a town whose name is that of a river?", "Ada Müller"),
    browsecomp("Who came third?", "nobody", canary="another", topic="Art"),
]

RECORDS: dict[str, list[dict[str, Any]]] = {
    "insta-v3": INSTA,
    "pae-webvoyager": WEBVOYAGER,
    "agentsynth-web": AGENTSYNTH,
    "browsecomp": BROWSECOMP,
    "travelplanner": TRAVELPLANNER,
    "mind2web-live": MIND2WEB_LIVE,
    "online-mind2web": ONLINE_MIND2WEB,
    "deepshop": DEEPSHOP,
    "mind2web-2": [{"task_id": name, **record} for name, record in MIND2WEB_2.items()],
    "gaia-web": GAIA,
    "webgym": PUBLISHED,
}
"""Records by source, as objects."""


def as_lines(records: list[dict[str, Any]]) -> str:
    return "".join(json.dumps(record, ensure_ascii=False) + "\n" for record in records)


def as_csv(records: list[dict[str, Any]], delimiter: str = ",") -> str:
    """As pandas writes it: nested values as Python literals."""
    text = io.StringIO()
    names = list(dict.fromkeys(name for record in records for name in record))
    writer = csv.DictWriter(text, names, delimiter=delimiter, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    return text.getvalue()
