"""Data files of the offline web: what does not fit is named with its key."""

from __future__ import annotations

import msgspec
import pytest

from webgym.offline.families.encyclopedia.schema import Lack, Stock


@pytest.mark.parametrize(
    ("data", "shape", "said"),
    [
        (["Overture", ["Short", 3], "has none"], Lack, r"\$\[1\]\[1\]"),
        ({"words": {}, "subject": []}, Stock, "unknown field `subject`"),
    ],
)
def test_rows_and_tables_hold_what_their_fields_say(data: object, shape: type, said: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=said):
        msgspec.convert(data, shape)


def test_a_subject_takes_its_words_from_a_list_that_is_there() -> None:
    data = msgspec.to_builtins(Stock((), (), (), {}, ())) | {"subjects": [SUBJECT]}
    with pytest.raises(msgspec.ValidationError, match="owls: there are no words 'colours'"):
        msgspec.convert(data, Stock)


TEXT = dict.fromkeys("noun domain subdomain picture group_label role profession place".split(), "owl")
SUBJECT = TEXT | {
    "plural": "owls",
    "brands": [],
    "groups": {},
    "first": "colours",
    "measures": [],
    "traits": [],
    "lack": ["Ears", ["Two"], "has no ears"],
    "event": ["Seen", "was seen"],
    "sections": [],
}
