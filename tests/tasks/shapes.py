"""Files of all ten sources, a dozen hand-shaped records in each, with everything a build has to cope with:
missing websites, placeholders, repeated tasks within and across sources, broken records."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.tasks.sources.native import as_csv, as_lines, browsecomp

_WHAT = "kettle lamp tent violin ladder compass blanket teapot scooter easel lantern hammock".split()
_KIND = "steel wooden folding green antique silent".split()
_PART = "weight price warranty colour origin maker height capacity".split()
_PLACE = "Bergen Ulm Graz Porto Tartu Gent Kiel Basel Lyon Malmö Turin Riga".split()


def ask(number: int) -> str:
    """A task with a number of its own, of some length."""
    what, kind = _WHAT[number % 12], _KIND[number // 2 % 6]
    parts = [_PART[(number + step) % 8] for step in range(number % 5)]
    place = _PLACE[number * 5 % 12]
    told = f"Find a {kind} {what} sold near {place} below {number + 20} euros"
    if parts:
        told += f", naming its {', '.join(parts)}"
    if number % 3 == 0:
        told += f". Afterwards compare delivery options towards {_PLACE[(number + 7) % 12]} with pickup times"
    return f"{told}."


def write_shapes(folder: Path, *, count: int = 12) -> dict[str, Path]:
    """One file for each source; paths by source."""
    numbers = itertools.count()
    paths: dict[str, Path] = {}
    for name, (suffix, make) in _MAKERS.items():
        records = [make(next(numbers)) for _ in range(count)]
        paths[name] = folder / name / f"tasks{suffix}"
        paths[name].parent.mkdir(parents=True)
        paths[name].write_text(_text(name, suffix, records), "utf-8")
    return paths


def _text(name: str, suffix: str, records: list[dict[str, Any]]) -> str:
    if name == "mind2web-2":
        return json.dumps({f"t{n}": record for n, record in enumerate(records)}, ensure_ascii=False)
    if suffix == ".csv":
        return as_csv(records)
    if suffix == ".json":
        return json.dumps(records, ensure_ascii=False)
    broken = '{"website": "broken.example.org", "instruction"\n' if name == "insta-v3" else ""
    return "\ufeff" + as_lines(records[:2]) + broken + as_lines(records[2:]).rstrip("\n")


def _insta(number: int) -> dict[str, Any]:
    return {
        "website": f"insta{number}-shop.org",
        "instruction": ask(number),
        "steps": ["Open 'Offers'."],
        "criteria": [f"The answer names the Zyx{number}00 at {number + 111}.50 euros."],
    }


def _pae(number: int) -> dict[str, Any]:
    # Two thirds say the same in another dress.
    return {
        "web_name": "Allrecipes",
        "id": f"Allrecipes--{number}",
        "ques": ask(number - number % 3),
        "web": "https://www.allrecipes.com/",
    }


def _agentsynth(number: int) -> dict[str, Any]:
    stop = {"action_key": "stop", "action_kwargs": {"answer": f"The Zyx{number}00"}}
    return {
        "website": f"www.synth{number % 4}-shop.com",
        "task": ask(number),
        "action_sequence": [json.dumps(stop)],
        "thoughts_sequence": ["There it is."],
    }


def _browsecomp(number: int) -> dict[str, Any]:
    return browsecomp(
        f"Riddle about naïve painters: {ask(number)}", f"Zyx {number}00", canary=f"canary {number}"
    )


def _travelplanner(number: int) -> dict[str, Any]:
    return {
        "org": "Bonn",
        "dest": "Kiel",
        "days": "3",
        "visiting_city_number": "1",
        "date": "['2022-03-16', '2022-03-17', '2022-03-18']",
        "people_number": "2",
        "local_constraint": "{'house rule': None, 'cuisine': None}",
        "budget": "1400",
        "query": f"Plan 3 days in {_PLACE[number % 12]} for 2 people for ${number + 1400}, museums, parks.",
        "level": "easy",
        "reference_information": repr([{"Description": "Hotels"}]),
    }


def _mind2web_live(number: int) -> dict[str, Any]:
    content = {"key": "", "reference_answer": "x", "url": f"https://www.live{number}-shop.com/shop?x=1"}
    return {
        "index": number,
        "task": ask(number),
        "reference_task_length": 4,
        "evaluation": [{"match_function_name": "url_included_match", "content": content}],
    }


def _online_mind2web(number: int) -> dict[str, Any]:
    # Twelve further on than the task of Mind2Web-Live that is the same but for case and punctuation.
    twin = number - 12
    is_twin = number % 4 == 0
    return {
        "task_id": f"om{number}",
        "confirmed_task": ask(twin).upper().rstrip(".") if is_twin else ask(number),
        "website": f"https://live{twin}-shop.com/" if is_twin else f"https://online{number}-shop.com/",
        "reference_length": 5,
        "level": "easy",
    }


def _deepshop(number: int) -> dict[str, Any]:
    return {
        "web_name": "Amazon",
        "id": f"Amazon--{number}",
        "ques": ask(number),
        "web": "https://www.amazon.com/?language=en_US&currency=USD",
        "attribute": "None",
        "filter": "**",
        "sort": "",
        "category": "Home",
        "difficulty": "easy",
    }


def _mind2web_2(number: int) -> dict[str, Any]:
    return {"task_description": f"{ask(number)}\n\n- With links.", "rubric_path": None}


def _gaia(number: int) -> dict[str, Any]:
    return {
        "task_id": f"8e867cd7-{number}",
        "Level": 1,
        "Final answer": f"{number}",
        "id": f"level1-{number}",
        "web": "https://www.google.com/",
        "ques": ask(number),
    }


_MAKERS: dict[str, tuple[str, Callable[[int], dict[str, Any]]]] = {
    "insta-v3": (".jsonl", _insta),
    "pae-webvoyager": (".jsonl", _pae),
    "agentsynth-web": (".jsonl", _agentsynth),
    "browsecomp": (".csv", _browsecomp),
    "travelplanner": (".csv", _travelplanner),
    "mind2web-live": (".json", _mind2web_live),
    "online-mind2web": (".json", _online_mind2web),
    "deepshop": (".jsonl", _deepshop),
    "mind2web-2": (".json", _mind2web_2),
    "gaia-web": (".jsonl", _gaia),
}
