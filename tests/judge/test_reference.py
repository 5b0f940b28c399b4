"""Reference answers: a table of pairs that must match and of pairs that must not."""

from __future__ import annotations

from time import process_time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from webgym.judge.config import WAYS_BY_SOURCE, Way
from webgym.judge.reference import READ_CHARS, as_set, compare_with_reference, exact, is_reference, normalised
from webgym.judge.value_comparison import Match
from webgym.judge.values import tokens

WAYS: tuple[Way, ...] = ("normalised", "set")

SAME = [
    # case, white space, typographic forms, articles, accents, punctuation
    ("Paris", "paris"),
    ("Paris", "  PARIS. "),
    ("The Hague", "the hague"),
    ("The Beatles", "Beatles"),
    ("A Tale of Two Cities", "Tale of Two Cities"),
    ("Beyoncé", "Beyonce"),
    ("São Paulo", "Sao Paulo"),
    ("Dvořák", "Dvorak"),
    ("Ｐａｒｉｓ", "Paris"),
    ("“Blue Mug”", '"Blue Mug"'),
    ("Macy’s", "Macy's"),
    ("rock & roll", "Rock and Roll"),
    ("e-mail", "email"),
    ("Rolls-Royce", "Rolls Royce"),
    ("Straße", "STRASSE"),
    ("ﬁsh", "fish"),
    ("C++", "c++"),
    ("東京", "東京"),
    # in a sentence
    ("Paris", "The answer is Paris."),
    ("Blue Mug", "The result: Blue Mug"),
    ("Ada Lovelace", "It was Ada Lovelace."),
    ("Paris", "The answer to the question is:\n\nParis"),
    ("Paris", "**Answer:** “Paris”"),
    ("Paris", '{"answer": "Paris"}'),
    ("Paris", "<answer>Paris</answer>"),
    ("Paris", "I found the answer. It is Paris, according to the website."),
    ("Paris", "Based on the page, it is Paris. Paris."),
    # numbers
    ("1234", "1,234"),
    ("1,234.50", "1234.5"),
    ("1234567", "1 234 567"),
    ("1234567", "1'234'567"),
    ("1234567", "1.234.567"),
    ("1234.56", "1.234,56"),
    ("1234567", "12,34,567"),
    ("0.5", "½"),
    ("2.5", "2½"),
    ("12.5", "12,5"),
    ("3", "three"),
    ("25", "twenty-five"),
    ("7", "It has 7."),
    ("3 albums", "3"),
    ("5000", "5k"),
    ("1200000", "1.2 million"),
    ("1.2 billion", "1,200,000,000"),
    ("24", "2 dozen"),
    ("-5", "−5"),
    ("-3", "minus 3"),
    ("-3", "negative three"),
    ("-$5", "minus $5"),
    ("3rd", "third"),
    ("1st", "the first"),
    ("42", "４２"),
    # units
    ("5 km", "5 kilometres"),
    ("5 km", "5000 m"),
    ("5km", "5 Kilometers"),
    ("150 min", "2 h 30 min"),
    ("2 hours 30 minutes", "2h30m"),
    ("2 hours and 30 minutes", "150 minutes"),
    ("90 minutes", "1.5 hours"),
    ("5'10\"", "5 ft 10 in."),
    ("70 inches", "5 feet 10 inches"),
    ("7 lb 3 oz", "115 ounces"),
    ("1 kg", "1000 g"),
    ("2 weeks", "14 days"),
    ("2 years", "24 months"),
    ("20 °C", "20 degrees Celsius"),
    ("100 m²", "100 square metres"),
    ("1500 sq ft", "1,500 square feet"),
    ("60 mph", "60 mph"),
    ("50%", "50 percent"),
    ("50 %", "50 per cent"),
    ("512 GB", "512GB"),
    ("3 GHz", "3000 MHz"),
    ("250 ml", "0.25 l"),
    # money
    ("$12.50", "12.50 dollars"),
    ("$12.50", "USD 12.5"),
    ("$12.50", "US$12.50"),
    ("$12.50", "It costs $12.50."),
    ("€1.234,50", "1,234.50 EUR"),
    ("12 €", "€12.00"),
    ("£5", "5 pounds"),
    ("5 lb", "5 pounds"),
    ("$0.50", "50 cents"),
    ("$1.2 million", "$1,200,000"),
    ("$26.1 billion", "$26.1  billion"),
    ("$3M", "3 million dollars"),
    ("¥1000", "1,000 yen"),
    ("₹1,00,000", "Rs. 100000"),
    ("$12.50", "$12.50 USD"),
    # dates
    ("2024-05-03", "May 3, 2024"),
    ("2024-05-03", "3 May 2024"),
    ("2024-05-03", "3rd of May 2024"),
    ("2024-05-03", "Friday, May 3rd, 2024"),
    ("2024/05/03", "2024-5-3"),
    ("3 May 2024", "03.05.2024"),
    ("25/12/2024", "December 25, 2024"),
    ("12/25/2024", "25 Dec 2024"),
    ("Sept 2024", "September 2024"),
    ("3 May", "May 3rd"),
    ("3 May", "3rdMay"),
    ("2024年5月3日", "2024-05-03"),
    ("Dec. 25, 2024", "25 December 2024"),
    # times
    ("3:30 PM", "15:30"),
    ("3:30 p.m.", "3.30pm"),
    ("3 pm", "15:00"),
    ("noon", "12:00 pm"),
    ("midnight", "00:00"),
    ("08:00", "8 am"),
    # yes and no
    ("Yes", "Yes, it does."),
    ("No", "No. It does not."),
    ("Yes", "The answer is yes."),
    ("No", "Answer: **No**"),
    ("yes", "True"),
    # identifiers, links
    ("(555) 123-4567", "555-123-4567"),
    ("978-3-16-148410-0", "978 3 16 148410 0"),
    ("https://www.example.com/", "example.com"),
    ("http://example.com/a", "https://example.com/a/"),
    # lists
    ("apples, pears", "pears, apples"),
    ("apples, pears and plums", "Plums, apples, pears"),
    ("Red Mug; Blue Mug", "Blue Mug and Red Mug"),
    ("1, 2, 3", "3, 2, 1"),
    ("- Rome\n- Paris", "1. Paris\n2. Rome"),
    ("Blue Mug; $12.50", "The Blue Mug costs $12.50."),
    ("May 3, 2024; $5", "$5, on 3 May 2024"),
    ("A, B, C", "C, B and A"),
    ("1,200 and 3,400", "3400; 1200"),
]

ASKED = [
    # what the task says may stand around the answer, as long as it can be no second claim
    ("What is the capital of France?", "Paris", "The capital of France is Paris."),
    ("What is the capital of France?", "Paris", "The capital of France is:\nParis"),
    ("Ask Fern Mugs for its owner.", "Jo Ray", "I searched Fern Mugs. The owner is Jo Ray."),
    ("Ask Fern Mugs for its owner.", "Jo Ray", "At Fern Mugs, the owner is Jo Ray."),
    ("How many studio albums are there?", "3", "There are 3 studio albums."),
    ("How many albums and songs are there?", "12; 5", "There are 12 albums and 5 songs."),
    ("Who is the owner, and what is the price?", "Jo; $5", "The owner is Jo and the price is $5."),
    ("How many studio albums are there?", "3", "Studio albums: 3"),
    ("When does it open?", "May 3, 2024", "It opens on 3 May 2024."),
    ("Is the mug in stock?", "No", "No, the mug is not in stock."),
    ("Is the mug in stock?", "Yes", "Yes, the mug is in stock."),
    ("Which cities are named?", "Rome, Paris", "The cities are Paris and Rome."),
    ("How many kilometres is it to Rome?", "17", "17 km"),
    ("What percentage is left?", "50", "50 %"),
    ("How much is it (in $)?", "12.50", "$12.50"),
]

NOT_ASKED = [
    ("Start at the page on Fern Mugs. Who is it?", "Jo Ray", "to Fern Mugs, named Jo Ray; "),
    ("Start at the page on Fern Mugs. Who is it?", "Jo Ray", "To Fern Mugs, it is Jo Ray."),
    ("Start at the page on Fern Mugs. Who is it?", "Jo Ray", "On Fern Mugs, called Jo Ray"),
    ("Start at the page on In review.", "Jo Ray", "Final answer: In review\n\nthat is Jo Ray"),
    (
        "Start at the page on 32 g syrup.",
        "3 May 2026; 43 minutes",
        "that is 3 May 2026; 43 minutes It is 32 g syrup.",
    ),
    ("Start at the page on Fern Mugs.", "$4.50; $7", "Fern Mugs $4.50; $7"),
    ("Start at the page on Fern Mugs.", "$4.50; $7", "it is $4.50; $7 is Fern Mugs"),
    ("Start at the page on Red Brick. Who won, and with how many votes?", "Jo; 342", "Jo; 342  Red Brick"),
    ("Start at the page on 31.", "Jo Ray; 396 kcal", "31) (Jo Ray; 396 kcal"),
    # a task that names the answer among others; names of the task as rivals
    ("Is it Sydney or Canberra?", "Canberra", "Sydney. Canberra."),
    ("Is it Sydney or Canberra?", "Canberra", "It is Sydney. It is Canberra."),
    ("Is it Sydney or Canberra?", "Canberra", "Is it Sydney or Canberra."),
    ("Is it on the website or in the app?", "app", "It is on the website. It is in the app."),
    ("Other than Lyon, which city is it?", "Paris", "Lyon. Paris."),
    ("Other than Lyon, which city is it?", "Paris", "It is Lyon. It is Paris."),
    ("Other than Lyon, which city is it?", "Paris", "In Lyon. In Paris."),
    ("Other than Lyon, which city is it?", "Paris", "It is Lyon it is Paris"),
    ("Other than Lyon, which city is it?", "Paris", "Lyon: Paris"),
    ("Is it 3 or 4?", "4", "It is 3. It is 4."),
    ("Start at the page on 16:45. What does it cost?", "$9.00", "16:45 $9.00"),
    ("Start at the page on 16:45. What does it cost?", "$9.00", "16:45: $9.00"),
    ("Start at the page on A23. What is the salary?", "$13,860", "A23 $13,860"),
    ("Start at the page on what Joe used.", "Paris", "What Joe used. Paris."),
    ("Is the mug in stock?", "No", "No, the mug is in stock."),
    ("Is the mug in stock?", "Yes", "It is not yes."),
    ("Is the mug in stock?", "Yes", "Yes. Stock."),
    ("Unlike Lyon, which city is it?", "Paris", "Lyon is Paris"),
    ("Of the mugs that cost $9, which costs the most?", "$12.50", "$9, $12.50"),
    ("Of the mugs that cost $9, which costs the most?", "$12.50", "$9: $12.50"),
    # units that nobody asked for
    ("How many kilometres is it to Rome?", "17", "17 miles"),
    ("How many miles per hour?", "60", "60 miles"),
    ("How many square metres?", "60", "60 metres"),
    ("Which are they?", "apples; pears", "Apples. Pears. Plums. Grapes."),
]

NOT_SAME = [
    ("Paris", "Lyon"),
    ("Paris", ""),
    ("Paris", "I do not know."),
    ("Paris", "Not Paris."),
    ("Paris", "It is not Paris."),
    ("Paris", "Paris or Lyon"),
    ("Paris", "Paris, Lyon, Rome"),
    ("Paris", "It might be Paris."),
    ("Paris", "Paris is wrong."),
    ("Paris", "Paris, Texas"),
    ("York", "New York"),
    ("Jordan", "Michael Jordan"),
    ("Blue Mug", "Blue Mug XL"),
    ("Blue Mug", "Dark Blue Mug"),
    ("Blue Mug", "Red Mug, Blue Mug, Green Mug"),
    ("Blue Mug", "The Red Mug is cheaper than the Blue Mug."),
    ("iPhone 15", "iPhone 15 Pro"),
    ("iPhone 15", "iPhone 14"),
    ("Boeing 747", "747"),
    ("C++", "C"),
    ("C#", "C"),
    ("cat", "category"),
    ("résumé", "resumed"),
    ("東京", "京都"),
    # numbers
    ("3", "13"),
    ("3", "3.5"),
    ("3", "30"),
    ("12", "12.50"),
    ("7", "7/7"),
    ("1", "1:1"),
    ("1234", "1.234"),
    ("1,234", "1,243"),
    ("3", "3 or 4"),
    ("3", "more than 3"),
    ("500", "about 500"),
    ("500", "at least 500"),
    ("500", "not 500"),
    ("500", "between 400 and 500"),
    ("5", "-5"),
    ("102", "10²"),
    ("5 million", "5 billion"),
    ("5000", "5 million"),
    ("3rd", "3"),
    ("3", "third"),
    ("third", "second"),
    ("3.11.2", "3.11.3"),
    ("0.5", "⅓"),
    # units
    ("5 km", "5 miles"),
    ("5 km", "5 m"),
    ("5 kg", "5 lb"),
    ("5 km", "5"),
    ("30 min", "30 s"),
    ("2 h 30 min", "2 h"),
    ("50%", "50"),
    ("50%", "5%"),
    ("20 °C", "20 °F"),
    ("1 GB", "1 MB"),
    ("2 years", "2 months"),
    ("100 m²", "100 m"),
    # money
    ("$12.50", "€12.50"),
    ("$12.50", "$12.05"),
    ("$12.50", "$1250"),
    ("$12.50", "12.50"),
    ("$12.50", "C$12.50"),
    ("£5", "5 pence"),
    ("$1.2 million", "$1.2 billion"),
    ("$12.50", "It costs $12.50 or $13.50."),
    ("$12.50", "under $12.50"),
    ("$12.50", "between $10 and $12.50"),
    # dates
    ("2024-05-03", "2024-03-05"),
    ("May 3, 2024", "03/05/2024"),
    ("May 3, 2024", "May 3"),
    ("May 3, 2024", "May 2024"),
    ("May 3, 2024", "2024"),
    ("May 3, 2024", "May 13, 2024"),
    ("May 3, 2024", "May 3, 2023"),
    ("3 May", "3 March"),
    ("2024", "May 3, 2024"),
    ("May 3, 2024", "from May 1, 2024 to May 3, 2024"),
    # times
    ("3:30 PM", "3:30 AM"),
    ("3:30 PM", "3:30"),
    ("15:30", "15:03"),
    ("noon", "midnight"),
    ("12:00 am", "noon"),
    # yes and no
    ("Yes", "No"),
    ("No", "Yes, it does."),
    ("No", "No information was found about yes or no."),
    ("Yes", "Maybe yes."),
    ("No", "Nothing was found."),
    ("true", "false"),
    # identifiers, links
    ("555-123-4567", "555-123-4568"),
    ("https://example.com/a", "https://example.com/b"),
    ("example.com", "example.org"),
    ("192.168.1.1", "192.168.11"),
    # lists
    ("apples, pears", "apples"),
    ("apples, pears", "apples, pears, plums"),
    ("apples, pears", "apples, plums"),
    ("apples, pears", "apples but not pears"),
    ("apples", "apples, pears"),
    ("1, 2, 3", "1, 2"),
    ("1, 2, 3", "1, 2, 3, 4"),
    ("Rome, Paris", "Paris and Rome and Berlin"),
    ("A, B, C", "B, C"),
    ("A", "B"),
    ("Blue Mug; $12.50", "The Blue Mug costs $13.50."),
    ("Blue Mug; $12.50", "The Red Mug costs $12.50."),
    ("Blue Mug; $12.50", "The Blue Mug costs $12.50, the Red Mug $9.00."),
    ("apples; pears", "Apples. Pears. Plums. Grapes."),
    ("apples; pears", "It is apples and pears. It is plums."),
    ("mug; blue mug", "blue mug"),
    ("2; 2", "2"),
    # a list with the answer in it
    ("Paris", "Paris. London. Rome. Berlin."),
    ("mice", "rats. mice. hamsters."),
    ("mice", "rats – mice – hamsters"),
    ("mice", "(rats) (mice)"),
    ("Paris", "It is London. It is Paris."),
    ("Paris", "It was London, it is now Paris."),
    ("Paris", "I found London. I found Paris."),
    ("3", "3, 4, 5"),
    ("3", "3. 5 km. 7 miles."),
    ("3", "3–5"),
    ("May 3, 2024", "May 3, 2024. May 4, 2024."),
    # talk that is an answer itself
    ("B", "A. B."),
    ("B", "answer A, answer B"),
    ("II", "answer I, answer II"),
    ("off", "It is on. It is off."),
    ("app", "It is on the website. It is in the app."),
    ("completed", "It is done. It is completed."),
    ("there", "here. there."),
    ("The Shining", "I found It. I found The Shining."),
    ("No", "No. It is sold out."),
    ("Yes", "Yes. No."),
    ("Yes", "Yes. Unclear."),
    # struck out, crossed out, cut off
    ("Paris", "~~Paris~~"),
    ("Paris", "P\u0336a\u0336r\u0336i\u0336s\u0336"),
    ("Paris", "<del>Paris</del>"),
    ("Paris", "\u274c Paris"),
    ("Paris", "Paris …"),
    ("-----", "----- …"),
    ("★★★", "★★★ ..."),
    ("A", "A -"),
    ("5", "≠ 5"),
    ("5", "5‰"),
    ("5", '5"'),
    ("5", "5'"),
    ("3", "minus 3"),
    ("17", "17 miles"),
    # signs that say as much as words
    ("5", "5+"),
    ("5+", "5"),
    ("5 or more", "5"),
    (">5", "5"),
    ("<5", ">5"),
    ("≥ 5", "5"),
    ("~5", "5"),
    ("x > 5", "x < 5"),
    ("A", "A+"),
    ("A-", "A"),
    ("B+", "B-"),
    ("AB-", "AB+"),
    ("Disney+", "Disney"),
    ("blue", "blue-green"),
    # numbers that are names, and units whose case tells
    ("007", "7"),
    ("00501", "501"),
    ("version 1.10", "version 1.1"),
    ("3 albums", "3 years"),
    ("5 GB", "5 Gb"),
    ("10 MW", "10 mW"),
    # no answer, though the value stands in it
    ("42", "I tried 42 websites and gave up."),
    ("42", "It failed: error 42"),
    ("42", "42 is what I guessed"),
    ("42", "It might be 42."),
    ("42", "Anything but 42"),
    ("3", "I found nothing after 3 searches."),
    ("7", "The price is listed on page 7."),
    ("$12.50", "It was $12.50 yesterday, but the page now shows a discount."),
    ("Paris", "I couldn't determine whether it is Paris."),
    ("Paris", "The page Paris was blocked."),
    ("Paris", "Paris? No idea."),
    ("Berlin", "Berlin? Nein."),
    ("No", "No information was found."),
    ("No", "No, I could not find it."),
    ("Yes", "Yes, it is not available."),
    ("Yes", "Yes, perhaps."),
    # the words belong to something else
    ("Paris", "The capital of Paris"),
    ("Alice", "alice with bob"),
    ("Alice", "bob, according to alice"),
    ("Bob", "Bob: loser. Winner: someone else"),
    ("in stock", "In stock: 0"),
    ("available", "available from 2030"),
]


@pytest.mark.parametrize(("reference", "answer"), SAME)
def test_pairs_that_match(reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS).match is Match.SAME


@pytest.mark.parametrize(("reference", "answer"), NOT_SAME)
def test_pairs_that_do_not_match(reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS).match is not Match.SAME


@pytest.mark.parametrize(("task", "reference", "answer"), ASKED)
def test_words_of_the_task_may_stand_around_an_answer(task: str, reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS, task).match is Match.SAME


@pytest.mark.parametrize(("task", "reference", "answer"), NOT_ASKED)
def test_words_of_the_task_excuse_no_second_claim(task: str, reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS, task).match is Match.UNSURE


def test_the_table_is_large_and_has_no_pair_twice() -> None:
    assert len(set(SAME)) == len(SAME) >= 100
    assert len(set(NOT_SAME)) == len(NOT_SAME) >= 90


@pytest.mark.parametrize(
    ("reference", "answer"),
    [
        ("$12.50", "$13.50"),
        ("$12.50", "It costs €12.50."),
        ("3", "There are 4."),
        ("May 3, 2024", "2024-03-05"),
        ("15:30", "3 pm"),
        ("Yes", "No"),
        ("5 km", "50 km"),
        ("Paris", "  "),
    ],
)
def test_rules_are_sure_where_a_value_differs(reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS).match is Match.DIFFERENT


@pytest.mark.parametrize(
    ("reference", "answer"),
    [
        ("5 km", "3.1 miles"),
        ("May 3, 2024", "03/05/2024"),
        ("Paris", "the French capital"),
        ("$12.50", "12.50"),
        ("+1 555 123 4567", "555-123-4567"),
        ("Paris", "x" * 30_000),
        ("1e6", "1000000"),
        ("08", "8"),
        ("3 albums", "3 years"),
        ("17", "17 miles"),
        ("5", "-5"),
        ("-3", "3"),
        ("$5", "C$5"),
        ("39.2", "39.19"),
        ("1.2 million", "1,234,567"),
        ("496", "about 500"),
        ("3", "I found 4 of them"),
    ],
)
def test_rules_leave_to_a_model_what_they_cannot_tell(reference: str, answer: str) -> None:
    assert compare_with_reference(reference, answer, WAYS).match is Match.UNSURE


def test_what_the_task_says_is_no_part_of_the_answer() -> None:
    task = "Among the mugs under $20, which costs the least for 2 persons in Paris, and how much is it?"
    assert normalised("$12.50", "Of those under $20 it is $12.50.", task).match is Match.SAME
    assert normalised("$12.50", "Of those under $20 it is $12.50.").match is not Match.SAME
    assert normalised("Blue Mug", "In Paris it is Blue Mug.", task).match is Match.SAME
    assert normalised("Blue Mug", "In Berlin it is Blue Mug in Rome.", task).match is not Match.SAME


def test_ways_are_taken_in_turn_and_only_when_asked_for() -> None:
    assert exact("Blue Mug", "blue  mug.").match is Match.SAME
    assert exact("1,234", "1234").match is Match.UNSURE
    assert compare_with_reference("1,234", "1234", ("exact",)).match is Match.UNSURE
    assert compare_with_reference("1,234", "1234", ("exact", "normalised")).match is Match.SAME
    assert compare_with_reference("x, y", "y, x", ("normalised",)).match is Match.UNSURE
    assert as_set("x, y", "y, x").match is Match.SAME
    assert as_set("alone", "alone").match is Match.UNSURE
    assert set(WAYS_BY_SOURCE["offline"]) == {"set", "normalised", "model"}


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60), st.text(max_size=60))
def test_any_two_texts_can_be_held_against_each_other(reference: str, answer: str) -> None:
    for way in (normalised, as_set, exact):
        assert way(reference, answer).match in Match
        if reference.strip() and answer.strip():
            assert way(reference, reference).match is not Match.DIFFERENT


PIECES = st.sampled_from(
    "12 1,234 $ € 5 km h min May 3 2024 : / - . , ; and or not the Blue Mug 3rd ½ ² ( ) +1 pm noon k".split()
)


@settings(max_examples=200, deadline=None)
@given(st.lists(PIECES, max_size=12))
def test_a_text_made_of_values_matches_itself(pieces: list[str]) -> None:
    for gap in (" ", ""):
        text = gap.join(pieces)
        assert tokens(text) == tokens(text)
        if text.strip():
            assert compare_with_reference(text, text, WAYS).match is Match.SAME, text


@pytest.mark.parametrize(
    "unit", ["1", "a-", "1 ", "1.", "a.", "1-", "a@", "May ", "$1", "(1", "1,", "' ", "½", "not "]
)
def test_long_texts_are_read_in_time(unit: str) -> None:
    found = tokens(unit * (20_000 // len(unit)))
    assert isinstance(found, list)


@pytest.mark.parametrize("unit", ["Paris. ", "it is ", "apples, pears, ", "the answer is Paris and ", "3 4 "])
@pytest.mark.parametrize("reference", ["Paris", "apples; pears", "3"])
def test_long_answers_are_held_against_a_reference_in_time(reference: str, unit: str) -> None:
    start = process_time()
    for size in (READ_CHARS - 10, 100_000):
        compare_with_reference(reference, unit * (size // len(unit)), WAYS, "Which cities are in France?")
    assert process_time() - start < 3


@pytest.mark.parametrize("reference", ["None", "", " "])
def test_a_field_that_was_never_filled_in_is_no_reference(reference: str) -> None:
    assert not is_reference(reference)
    for answer in ("None", "Paris"):
        assert compare_with_reference(reference, answer, WAYS).match is Match.UNSURE
    assert is_reference("none"), "what some questions are answered with"
