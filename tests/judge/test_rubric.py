"""The rubric judge against a judge model behind a real endpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from pydantic import ValidationError
from tests.judge.judge_model import Answers, Asked, JudgeModel, serve_judge
from tests.judge.scenes import TASK, episode, look, opened_twice, picture, pictures

from webgym.core.errors import JudgeError
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Verdict
from webgym.judge.config import JudgeChoice, JudgeConfig, StageConfig
from webgym.judge.factory import open_judge
from webgym.judge.rubric import cited
from webgym.llm.cache import ReplyCache
from webgym.llm.config import ChatConfig, Sampling

PUZZLES = tuple(look(f"Welches Bild zeigt {number} Katzen?", title="Ein Moment") for number in (3, 4))
"""A challenge that only a model knows for one."""


def agrees(asked: Asked) -> str:
    """Keeps every screenshot, finds every fact, sees no blocking."""
    if asked.stage == "keypoint":
        return asked.each(lambda name: True)
    return asked.verdict(asked.stage != "blocking", "Step 2 shows it.")


def without(stage: str, text: str = "") -> Answers:
    """Agrees, but for one stage, or for one text in it."""

    def answers(asked: Asked) -> str:
        told = [quoted for label, quoted in asked.quotes.items() if label != "group"]  # it names all facts
        if asked.stage == stage and text in "\n".join(told):
            return asked.verdict(False, "No screenshot shows it.")
        return agrees(asked)

    return answers


async def judge(model: JudgeModel, task: Task = TASK, made: Episode | None = None, **changes: Any) -> Verdict:
    choice = JudgeChoice(name="rubric", rubric=model.config(**changes))
    async with open_judge(choice) as opened:
        verdict = await opened.judge(task, made or episode(), pictures)
        assert verdict.judge == opened.name
        return verdict


async def test_everything_holds() -> None:
    async with serve_judge(agrees) as model:
        verdict = await judge(model)
    assert verdict.reward == 1
    assert verdict.score == 1
    assert [fact.fact for fact in verdict.facts] == [text for _, _, text in TASK.rubric.facts()]
    assert verdict.facts[0].judgement.steps == (1,)
    assert verdict.facts[0].judgement.reason == "Step 2 shows it."
    assert verdict.response is not None
    assert verdict.response.passed
    assert verdict.keypoints == (0, 1, 2)
    assert verdict.cost is not None
    assert (verdict.cost.calls, verdict.cost.repeats) == (5, 0)
    assert (verdict.cost.prompt_tokens, verdict.cost.completion_tokens) == (60, 15)
    assert [len(model.of(stage)) for stage in ("keypoint", "response", "fact", "blocking", "reference")] == [
        1,
        1,
        3,
        0,
        0,
    ]
    assert all(asked.body["temperature"] == 0 for asked in model.asked)


async def test_one_fact_that_fails_fails_the_attempt_and_shows_in_the_score() -> None:
    async with serve_judge(without("fact", "Its price is found")) as model:
        verdict = await judge(model)
    assert verdict.reward == 0
    assert verdict.score == pytest.approx(2 / 3)
    assert [fact.judgement.passed for fact in verdict.facts] == [True, False, True]
    assert not verdict.blocked.passed
    assert not model.of("blocking")  # it had seen the website


async def test_an_answer_that_was_not_seen_fails_the_attempt() -> None:
    async with serve_judge(without("response")) as model:
        verdict = await judge(model)
    assert verdict.reward == 0
    assert verdict.score == 1


async def test_criterion_a_does_not_see_the_answer() -> None:
    secret = "Seventeen and a half zorkmids."
    async with serve_judge(agrees) as model:
        await judge(model, made=episode(answer=secret))
    for asked in model.of("fact") + model.of("keypoint"):
        assert secret not in str(asked.body)
    assert "gave its answer" in model.of("fact")[0].quotes["actions"]
    assert model.of("response")[0].quotes["answer"] == secret
    assert "OR" in model.of("fact")[0].system


async def test_criterion_a_sees_the_fact_group_as_a_whole() -> None:
    async with serve_judge(agrees) as model:
        await judge(model)
    groups = {asked.quotes["fact"]: asked.quotes["group"].split("\n") for asked in model.of("fact")}
    mug = ["The Blue Mug", "- The Blue Mug's page is opened", "- Its price is found"]
    assert groups == {
        "The Blue Mug's page is opened": mug,
        "Its price is found": mug,
        "The cart holds a mug OR a plate": ["The cart", "- The cart holds a mug OR a plate"],
    }


async def test_keypoints_are_chosen_and_the_last_screenshot_always_stays() -> None:
    seen = ["front", "advert", "mug", "advert", "front", "cart", "end"]

    def answers(asked: Asked) -> str:
        if asked.stage == "keypoint":
            return asked.each(lambda name: name in (picture("mug"), picture("cart")))
        return agrees(asked)

    async with serve_judge(answers) as model:
        verdict = await judge(model, made=episode(seen), keypoint=StageConfig(images_per_call=3))
    # Five different screenshots beside the last: asked about once each, in two requests.
    asked_about = [name for asked in model.of("keypoint") for _, name in asked.shots]
    assert sorted(asked_about) == sorted(picture(text) for text in ("front", "advert", "mug", "cart"))
    assert [len(asked.shots) for asked in model.of("keypoint")] in ([3, 1], [1, 3])
    assert verdict.keypoints == (2, 5, 6)
    assert [label for label, _ in model.of("fact")[0].shots] == ["step 3", "step 6", "step 7"]


async def test_one_screenshot_alone_is_kept_without_asking() -> None:
    async with serve_judge(agrees) as model:
        verdict = await judge(model, made=episode(["mug", "mug", "mug"]))
    assert not model.of("keypoint")
    assert verdict.keypoints == (2,)


async def test_the_last_look_of_an_episode_without_an_answer_is_the_end() -> None:
    made = episode(["front", "mug"], answer=None, final=look("cart"))
    async with serve_judge(agrees) as model:
        verdict = await judge(model, made=made)
    assert verdict.reward == 0
    assert verdict.score == 1
    assert verdict.response is None
    assert model.of("fact")[0].shots[-1] == ("step 3 (the end)", picture("cart"))
    assert not model.of("response")


async def test_more_screenshots_than_a_request_takes_are_shown_in_parts_and_none_is_dropped() -> None:
    seen = [f"page {number}" for number in range(30)]

    def in_parts(asked: Asked) -> str:
        """Each fact stands on one page in the middle; the parts note what they show."""
        if asked.stage not in ("fact", "response") or "notes" in asked.quotes:
            return agrees(asked)
        assert "part of the screenshots" in asked.system
        shows = asked.stage == "fact" and picture("page 17") in [name for _, name in asked.shots]
        return asked.verdict(shows, f"Noted {asked.shots[0][0]}.")

    async with serve_judge(in_parts) as model:
        verdict = await judge(model, made=episode(seen), fact=StageConfig(images_per_call=4))
    assert verdict.reward == 1
    one = [asked for asked in model.of("fact") if asked.quotes["fact"] == "Its price is found"]
    labels = sorted(label for asked in one for label, _ in asked.shots)
    assert labels == sorted(f"step {number}" for number in range(1, 31))
    assert {len(asked.shots) for asked in one if asked.shots} == {3, 4}
    assert ["Part 5 of 8:\nNoted step 16." in asked.quotes.get("notes", "") for asked in one].count(True) == 1
    parts = [asked for asked in model.of("response") if asked.shots]
    assert [len(asked.shots) for asked in parts] == [15, 15]
    (closing,) = [asked for asked in model.of("response") if not asked.shots]
    assert closing.quotes["notes"] == "Part 1 of 2:\nNoted step 1.\n\nPart 2 of 2:\nNoted step 16."
    assert closing.quotes["answer"] == "The Blue Mug costs $12.50."


async def test_what_no_part_confirms_is_decided_over_all_parts() -> None:
    seen = [f"page {number}" for number in range(30)]

    def nowhere(asked: Asked) -> str:
        if asked.stage == "fact" and "notes" not in asked.quotes:
            return asked.verdict(False, "Nothing of it.")
        if asked.stage == "fact":
            return asked.verdict(asked.quotes["fact"] == "Its price is found", "Together they do.")
        return agrees(asked)

    async with serve_judge(nowhere) as model:
        verdict = await judge(model, made=episode(seen))
    assert [fact.judgement.passed for fact in verdict.facts] == [False, True, False]


@pytest.mark.parametrize("says", [True, False])
async def test_no_single_part_decides_about_an_answer(says: bool) -> None:
    """One part may show what another contradicts: only the parts together tell."""

    def answers(asked: Asked) -> str:
        if asked.stage == "response":
            return asked.verdict(says if "notes" in asked.quotes else not says)
        return agrees(asked)

    async with serve_judge(answers) as model:
        verdict = await judge(model, made=episode([f"page {number}" for number in range(30)]))
    assert verdict.reward == int(says)


@pytest.mark.parametrize("says", [True, False])
async def test_a_part_without_a_clear_verdict(says: bool) -> None:
    """It may show that a fact which another part confirms was undone."""

    def answers(asked: Asked) -> str:
        is_last = bool(asked.shots) and asked.shots[-1][0] == "step 30"
        if asked.stage == "fact":
            return "It is hard to say." if is_last else asked.verdict(says)
        return agrees(asked)

    async with serve_judge(answers) as model:
        with pytest.raises(JudgeError, match="fact stage"):
            await judge(model, made=episode([f"page {number}" for number in range(30)]), tries=1)


@pytest.mark.parametrize("emptied", [True, False])
async def test_a_fact_that_a_later_part_shows_undone_does_not_hold(emptied: bool) -> None:
    def answers(asked: Asked) -> str:
        if asked.stage != "fact":
            return agrees(asked)
        if notes := asked.quotes.get("notes"):
            return asked.verdict(not notes.endswith("an empty cart."))
        if picture("a mug") in [name for _, name in asked.shots]:
            return asked.verdict(True, "A mug in the cart.")
        return asked.verdict(not emptied, f"{asked.shots[-1][0]}: an empty cart.")

    seen = ["a mug", "page 2", "page 3", "page 4", "empty"]
    async with serve_judge(answers) as model:
        verdict = await judge(model, made=episode(seen), fact=StageConfig(images_per_call=2))
        assert verdict.reward == int(not emptied)
        assert [fact.judgement.passed for fact in verdict.facts] == [not emptied] * 3
        # What every part confirms is confirmed, without a closing question.
        assert any("notes" in asked.quotes for asked in model.of("fact")) is emptied


@pytest.mark.parametrize("tokens", [8_000, 12_000, 16_000])
async def test_requests_stay_within_their_tokens(tokens: int) -> None:
    seen = [look(f"page {number}", url=f"https://mugs.example/{number}/{'x' * 250}") for number in range(60)]
    stage = StageConfig(images_per_call=100, request_tokens=tokens)
    texts = {"history_chars": 4_000, "instruction_chars": 2_000, "answer_chars": 2_000}
    async with serve_judge(agrees) as model:
        made = episode(seen, answer="words " * 5_000)
        long = msgspec.structs.replace(TASK, instruction="Find the Blue Mug. " * 2_000)
        await judge(
            model, long, made, keypoint=stage, fact=stage, response=stage, blocking=stage, texts=texts
        )
    assert {asked.stage for asked in model.asked} == {"keypoint", "fact", "response"}
    for asked in model.asked:
        content = asked.body["messages"][1]["content"]
        told = [{"type": "text", "text": content}] if isinstance(content, str) else content
        text = sum(len(part["text"]) for part in told if part["type"] == "text")
        pixels = 320 * 192 * len(asked.shots)
        assert (text + len(asked.system)) / 3 + pixels / 784 + 1024 <= tokens, asked.stage
        assert asked.shots or "notes" in asked.quotes
    for name in ("fact", "response"):
        assert {label for asked in model.of(name) for label, _ in asked.shots} == {
            f"step {number}" for number in range(1, 61)
        }


def test_a_request_that_could_hold_no_screenshot_is_refused_early() -> None:
    chat = ChatConfig(base_url="http://127.0.0.1:1/v1", model="m")
    with pytest.raises(ValidationError, match="a fact request may take 8192 tokens"):
        JudgeConfig(chat=chat, fact=StageConfig(request_tokens=8_192))


@pytest.mark.parametrize("false_claim", ["", "It was free. "])
async def test_the_middle_of_a_long_answer_is_judged_too(false_claim: str) -> None:
    filler = [f"Mug {number} of 40 costs {number}.50 dollars. " for number in range(40)]
    answer = "".join([*filler[:20], false_claim, *filler[20:]])

    def answers(asked: Asked) -> str:
        if asked.stage != "response":
            return agrees(asked)
        return asked.verdict("It was free." not in asked.quotes["answer"], "Step 2 shows it.")

    texts = {"answer_chars": 400}
    async with serve_judge(answers) as model:
        verdict = await judge(model, made=episode(answer=answer), texts=texts)
    assert verdict.reward == int(not false_claim)
    parts = [asked.quotes["answer"] for asked in model.of("response")]
    assert len(parts) == 6
    assert all(len(part) <= 400 for part in parts)
    assert all(any(claim.strip() in part for part in parts) for claim in filler)
    assert verdict.response is not None
    assert verdict.response.steps == (1,)

    async with serve_judge(without("response")) as model:
        assert (await judge(model, made=episode(answer=answer), texts=texts)).reward == 0
    async with serve_judge(lambda asked: "?" if "free" in str(asked.quotes) else agrees(asked)) as model:
        long = episode(answer=answer + "It was free.")
        with pytest.raises(JudgeError, match="response stage"):
            await judge(model, made=long, texts=texts, tries=1)


async def test_an_answer_of_any_length_is_judged_against_the_reference_answer() -> None:
    """No reference answer is that long, so none is in the middle of it that somebody would have to find."""
    task = msgspec.structs.replace(TASK, reference_answer="twelve and a half dollars, I should say")
    walk = "I looked at every mug. " * 1_000
    async with serve_judge(agrees) as model:
        assert (
            await judge(model, task, episode(answer="It is twelve and a half dollars. " + walk))
        ).reward == 0
        assert not model.of("reference")
        final = f"{walk}\n\nFinal answer: {task.reference_answer}"
        assert (await judge(model, task, episode(answer=final))).reward == 1
        assert (await judge(model, TASK, episode(answer=walk * 10))).reward == 1
        assert len(model.of("response")) > 20


async def test_a_reference_answer_too_long_to_be_sent_is_the_tasks_fault() -> None:
    task = msgspec.structs.replace(TASK, reference_answer="twelve and a half dollars " * 20)
    async with serve_judge(agrees) as model:
        with pytest.raises(JudgeError, match="reference answer is longer than 400 characters"):
            await judge(model, task, texts={"answer_chars": 400})
        assert (await judge(model, task)).reward == 1


@pytest.mark.parametrize("word", ["nan", "NaN", "null", "N/A", "undefined", "None", "-", " "])
async def test_a_word_for_no_reference_answer_overrides_nothing(word: str) -> None:
    task = msgspec.structs.replace(TASK, reference_answer=word)
    async with serve_judge(without("reference")) as model:
        verdict = await judge(model, task)
        assert not model.of("reference")
    assert verdict.reward == 1
    assert verdict.reference is None


async def test_early_exit_stops_at_the_first_failure() -> None:
    async with serve_judge(without("fact", "Its price is found")) as model:
        verdict = await judge(model, early_exit=True)
    assert verdict.reward == 0
    assert [fact.judgement.passed for fact in verdict.facts] == [True, False]
    assert verdict.score is None
    async with serve_judge(without("response")) as model:
        assert (await judge(model, early_exit=True)).facts == ()
        assert not model.of("fact")
    async with serve_judge(agrees) as model:
        assert (await judge(model, early_exit=True)).reward == 1
        unanswered = await judge(model, made=episode(answer=None), early_exit=True)
    assert unanswered.reward == 0
    assert unanswered.facts == ()


# --- verdicts that are not clear ----------------------------------------------------------------------


async def test_an_unclear_reply_is_asked_again_with_the_reason() -> None:
    def answers(asked: Asked) -> str:
        if asked.stage == "response" and len(asked.said_before) < 2:
            return "It looks quite successful to me."
        return agrees(asked)

    async with serve_judge(answers) as model:
        verdict = await judge(model)
    assert verdict.reward == 1
    assert verdict.cost is not None
    assert (verdict.cost.calls, verdict.cost.repeats) == (7, 2)
    last = max(model.of("response"), key=lambda asked: len(asked.said_before))
    assert last.said_before == ["It looks quite successful to me."] * 2
    assert "SUCCESS or NOT SUCCESS" in last.body["messages"][-1]["content"]


@pytest.mark.parametrize("stage", ["fact", "response", "blocking"])
@pytest.mark.parametrize(
    "said",
    [
        "It is hard to say.",
        "",
        "SUCCESS\nNOT SUCCESS",
        {"message": {"content": "Fine.\nSUCCESS"}, "finish_reason": "length"},
        {"message": {"content": "Fine.\nYES"}, "finish_reason": "length"},
    ],
)
async def test_no_clear_verdict_is_an_error_and_never_a_reward(stage: str, said: Any) -> None:
    def answers(asked: Asked) -> Any:
        if asked.stage == stage:
            return said
        # Blocking is asked about only after a failure.
        return without("response")(asked) if stage == "blocking" else agrees(asked)

    made = opened_twice(PUZZLES[0], PUZZLES[1]) if stage == "blocking" else episode()
    async with serve_judge(answers) as model:
        with pytest.raises(JudgeError, match=f"no clear verdict in 2 replies at the {stage} stage"):
            await judge(model, made=made, tries=2)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"finish_reason": "content_filter"}, "the endpoint's filter refused to answer"),
        ({"refusal": "I can't help with that."}, "the model refused to answer"),
    ],
)
async def test_a_refusal_is_named_and_asked_about_once_more(said: dict[str, str], why: str) -> None:
    def answers(asked: Asked) -> Any:
        if asked.stage != "response":
            return agrees(asked)
        message = {"role": "assistant", "content": agrees(asked), "refusal": said.get("refusal")}
        return {"message": message, "finish_reason": said.get("finish_reason", "stop")}

    async with serve_judge(answers) as model:
        with pytest.raises(JudgeError, match=f"2 replies at the response stage: {why}"):
            await judge(model, tries=5)
        assert len(model.of("response")) == 2


async def test_a_verdict_in_parts_is_read() -> None:
    def answers(asked: Asked) -> Any:
        parts = [{"type": "thinking", "thinking": [{"type": "text", "text": "SUCCESS?"}]}]
        parts += [{"type": "text", "text": piece} for piece in agrees(asked).partition("VERDICT")]
        return {"message": {"role": "assistant", "content": parts}}

    async with serve_judge(answers) as model:
        assert (await judge(model)).reward == 1
        assert len(model.asked) == 5


async def test_an_endpoint_that_is_gone_is_an_error_and_never_a_reward() -> None:
    async with serve_judge(agrees) as model:
        config = model.config()
    async with open_judge(JudgeChoice(name="rubric", rubric=config)) as opened:
        with pytest.raises(JudgeError, match="cannot be reached"):
            await opened.judge(TASK, episode(), pictures)


@pytest.mark.parametrize("kept", [0.0, 0.2, 0.5, 0.9])
async def test_a_damaged_screenshot_is_an_error_and_is_not_sent(kept: float) -> None:
    async def damaged(name: str) -> bytes:
        whole = await pictures(name)
        return whole[: int(len(whole) * kept)] if name == picture("cart") else whole

    async with serve_judge(agrees) as model:
        async with open_judge(JudgeChoice(name="rubric", rubric=model.config())) as opened:
            with pytest.raises(JudgeError, match="cannot be read as an image"):
                await opened.judge(TASK, episode(), damaged)
        assert {asked.stage for asked in model.asked} == {"keypoint"}


async def test_a_bare_verdict_counts_unless_it_may_be_an_echo() -> None:
    def bare(asked: Asked) -> str:
        if asked.stage == "keypoint":
            return "\n".join(f"SCREENSHOT {number}: YES" for number in range(1, len(asked.shots) + 1))
        return "Fine.\nSUCCESS"

    async with serve_judge(bare) as model:
        assert (await judge(model, signed_verdicts=False)).reward == 1
        with pytest.raises(JudgeError, match="does not carry the code"):
            await judge(model, made=episode(answer="The payment was a success."), signed_verdicts=False)
        with pytest.raises(JudgeError, match="does not carry the code"):
            await judge(model, made=episode(["front", "SUCCESS", "cart"]), signed_verdicts=False)
        for unread in ({"fields": ("SUCCESS",)}, {"text": None}):  # typed on the page, or not recorded
            made = episode(["front", msgspec.structs.replace(look("mug"), **unread), "cart"])
            with pytest.raises(JudgeError, match="does not carry the code"):
                await judge(model, made=made, signed_verdicts=False)
        with pytest.raises(JudgeError, match="does not carry the code"):
            await judge(model)


# --- what the prompts ask for (paper appendix E) ------------------------------------------------------


def words(stage: str, model: JudgeModel) -> str:
    return " ".join(model.of(stage)[0].system.split())


async def test_the_prompts_keep_the_papers_contract() -> None:
    async with serve_judge(agrees) as model:
        await judge(model)
    keypoint, fact, response = (words(stage, model) for stage in ("keypoint", "fact", "response"))
    # Error messages and blocking screens are kept: they may be why something could not be done.
    matters, _, idle = keypoint.partition("It does not matter if")
    assert all(each in matters for each in ("error message", "refusal", "test for humans", "empty result"))
    assert "error" not in idle
    assert "group, with all of its facts" in fact
    # "Could not be done" is a claim like any other: true if the screenshots agree.
    assert "It holds if the screenshots agree" in response
    assert "makes no claim" not in response
    assert "One claim that no screenshot supports" in response
    assert "needs no proof" not in response  # what the task asks for is no proof that it was done
    for text in (fact, response):
        assert text.endswith(": NOT SUCCESS")
    assert list(model.of("fact")[0].quotes) == ["task", "group", "fact", "actions"]
    assert list(model.of("response")[0].quotes) == ["task", "answer"]


# --- rewards that are decided -------------------------------------------------------------------------

MUG, PRICE, CART = (text for _, _, text in TASK.rubric.facts())


def replies(said: dict[str, bool | None]) -> Answers:
    """Says of a stage or of a fact what it is told to; ``None`` is a reply without a verdict."""

    def answers(asked: Asked) -> str:
        found = said.get(
            asked.quotes["fact"] if asked.stage == "fact" else asked.stage, asked.stage != "blocking"
        )
        if found is None:
            return "It is hard to say."
        return asked.each(lambda name: True) if asked.stage == "keypoint" else asked.verdict(found)

    return answers


NO_ANSWER, UNSURE = episode(answer=None), "a little over twelve dollars"


@pytest.mark.parametrize("early_exit", [False, True])
@pytest.mark.parametrize(
    ("said", "reference", "rule", "made", "reward"),
    [
        # One criterion that clearly fails decides, whatever else cannot be read.
        ({MUG: None, CART: False}, None, "decides", None, 0),
        ({MUG: False, CART: None}, None, "decides", None, 0),
        ({"response": False, MUG: None, PRICE: None, CART: None}, None, "decides", None, 0),
        ({"response": None, PRICE: False}, None, "decides", None, 0),
        ({"keypoint": None, PRICE: False}, None, "decides", None, 0),
        # So does an answer that is not there, and an empty one.
        ({MUG: None}, None, "decides", NO_ANSWER, 0),
        ({MUG: None}, None, "decides", episode(answer=" "), 0),
        # So does a reference answer, either way, by the rule in force.
        ({MUG: None, "response": None}, "$12.50", "decides", None, 1),
        ({MUG: None, "response": None, "reference": False}, "$13.50", "decides", None, 0),
        ({MUG: None, "response": None, "reference": False}, "$13.50", "required", None, 0),
        ({MUG: None}, "$12.50", "required", None, None),
        ({"reference": None, MUG: False}, UNSURE, "required", None, 0),
        ({"reference": None}, UNSURE, "required", None, None),
        ({"reference": None, MUG: False}, UNSURE, "decides", None, None),
        # Where all that is read holds, the reward hangs on what is not.
        ({MUG: None}, None, "decides", None, None),
        ({"response": None}, None, "decides", None, None),
        ({"keypoint": None}, None, "decides", None, 1),
    ],
)
async def test_a_reward_that_is_decided_is_kept(
    said: dict[str, bool | None],
    reference: str | None,
    rule: str,
    made: Episode | None,
    reward: int | None,
    early_exit: bool,
) -> None:
    task = msgspec.structs.replace(TASK, reference_answer=reference)
    async with serve_judge(replies(said)) as model:
        asked = judge(model, task, made, tries=1, reference_rule=rule, early_exit=early_exit)
        if reward is None:
            with pytest.raises(JudgeError, match="no clear verdict in 1 replies at the"):
                await asked
        else:
            assert (await asked).reward == reward


async def test_what_was_not_read_is_noted_and_makes_no_score() -> None:
    async with serve_judge(replies({MUG: None, CART: False})) as model:
        verdict = await judge(model, tries=1)
    assert [fact.judgement.passed for fact in verdict.facts] == [None, True, False]
    assert verdict.facts[0].judgement.reason.startswith(
        "not read: no clear verdict in 1 replies at the fact stage"
    )
    assert verdict.score is None
    assert msgspec.json.decode(msgspec.json.encode(verdict), type=Verdict) == verdict


async def test_a_reference_answer_that_cannot_be_read_leaves_nothing_to_ask_where_it_decides() -> None:
    task = msgspec.structs.replace(TASK, reference_answer=UNSURE)
    async with serve_judge(replies({"reference": None})) as model:
        with pytest.raises(JudgeError, match="reference stage"):
            await judge(model, task, tries=1)
        assert {asked.stage for asked in model.asked} == {"reference"}


async def test_screenshots_without_a_clear_verdict_are_kept() -> None:
    """When in doubt, a screenshot matters: that it cannot be told costs no reward."""
    async with serve_judge(replies({"keypoint": None})) as model:
        verdict = await judge(model, tries=1)
    assert verdict.keypoints == (0, 1, 2)


async def test_a_refused_reply_of_the_cache_is_none_of_the_tries(tmp_path: Path) -> None:
    """An attempt that is judged again is asked about again, and only in what was not read."""
    said: dict[str, bool | None] = {MUG: None}
    async with serve_judge(replies(said)) as model, ReplyCache(tmp_path / "replies.sqlite") as cache:
        choice = JudgeChoice(name="rubric", rubric=model.config(tries=2))
        async with open_judge(choice, cache=cache) as opened:
            for round_ in range(1, 3):
                with pytest.raises(JudgeError, match=f"in {2 * round_} replies at the fact stage"):
                    await opened.judge(TASK, episode(), pictures)
                assert len(model.of("fact")) == 2 * round_ + 2
            model.asked.clear()
            said[MUG] = True
            assert (await opened.judge(TASK, episode(), pictures)).reward == 1
            assert [asked.stage for asked in model.asked] == ["fact"]


# --- stages, blocking, reference ----------------------------------------------------------------------


async def test_every_stage_has_its_model() -> None:
    task = msgspec.structs.replace(TASK, reference_answer="twelve and a half dollars, I should say")
    async with serve_judge(without("response")) as model:
        chat = model.config().chat
        stages: dict[str, Any] = {
            stage: StageConfig(chat=chat.model_copy(update={"model": f"{stage}-model"}))
            for stage in ("keypoint", "fact", "response", "blocking", "reference")
        }
        verdict = await judge(
            model, task, opened_twice(PUZZLES[0], PUZZLES[1]), reference_rule="required", **stages
        )
    assert {asked.body["model"] for asked in model.asked} == {f"{stage}-model" for stage in stages}
    assert all(asked.body["model"] == f"{asked.stage}-model" for asked in model.asked)
    assert "fact-model" in verdict.judge


async def test_blocking_is_seen_by_rule_or_by_the_model() -> None:
    challenge = look("Verify you are human", status=403, title="Just a moment...")

    def says_blocked(asked: Asked) -> Any:
        if asked.stage == "blocking":
            return asked.verdict(True, "Step 2 is a puzzle.")
        return without("fact")(asked)

    async with serve_judge(says_blocked) as model:
        verdict = await judge(model, made=opened_twice(challenge, challenge))
        assert verdict.reward is None
        assert verdict.blocked.passed
        assert not model.of("blocking")
        verdict = await judge(model, made=opened_twice(PUZZLES[0], PUZZLES[1]))
        assert verdict.reward is None
        assert verdict.blocked.steps == (1,)
        assert len(model.of("blocking")) == 1
        assert (
            await judge(model, made=opened_twice(PUZZLES[0], PUZZLES[1]), blocking_model=False)
        ).reward == 0


async def test_the_model_is_not_asked_whether_an_attempt_was_blocked_that_cannot_have_been() -> None:
    def says_blocked(asked: Asked) -> Any:
        return asked.verdict(True) if asked.stage == "blocking" else without("fact")(asked)

    elsewhere = look("puzzle", url="https://search.example/", title="Ein Moment", status=403)
    async with serve_judge(says_blocked) as model:
        for made in (
            episode(),
            episode(["front", "mug $12.50", look("Access Denied", title="Access Denied", status=403)]),
            episode(["front", elsewhere, elsewhere]),
            episode(["front", elsewhere, elsewhere], answer=None),
        ):
            assert (await judge(model, made=made)).reward == 0
        assert not model.of("blocking")


@pytest.mark.parametrize(
    ("reference", "fact_fails", "rule", "reward"),
    [
        ("12", False, "required", 1),
        ("13", False, "required", 0),
        ("12", True, "required", 0),
        ("12", True, "decides", 1),
        ("13", False, "decides", 0),
    ],
)
async def test_the_reference_answer_overrides(
    reference: str, fact_fails: bool, rule: str, reward: int
) -> None:
    task = msgspec.structs.replace(TASK, reference_answer=reference)
    async with serve_judge(without("fact") if fact_fails else agrees) as model:
        verdict = await judge(model, task, episode(answer="12"), reference_rule=rule)
        assert not model.of("reference")
    assert verdict.reward == reward
    assert verdict.reference is not None
    assert verdict.reference.passed == (reference == "12")


async def test_a_possible_answer_never_overrides() -> None:
    task = msgspec.structs.replace(TASK, example_answer="$99.00")
    async with serve_judge(agrees) as model:
        verdict = await judge(model, task)
    assert verdict.reward == 1
    assert verdict.reference is None
    assert not any("$99.00" in str(asked.body) for asked in model.asked)


async def test_where_the_rule_is_not_sure_a_model_is_asked() -> None:
    task = msgspec.structs.replace(TASK, reference_answer="a little over twelve dollars")
    async with serve_judge(agrees) as model:
        assert (await judge(model, task)).reward == 1
        assert len(model.of("reference")) == 1
    async with serve_judge(without("reference")) as model:
        assert (await judge(model, task)).reward == 0
    async with serve_judge(replies({"reference": None})) as model:
        with pytest.raises(JudgeError, match="at the reference stage"):
            await judge(model, task)


async def test_an_empty_answer_makes_no_claim() -> None:
    async with serve_judge(agrees) as model:
        verdict = await judge(model, made=episode(answer="  "))
        assert not model.of("response")
    assert verdict.reward == 0


async def test_the_same_episode_is_asked_about_in_the_same_words() -> None:
    async with serve_judge(agrees) as model:
        await judge(model)
        first = sorted(str(asked.body) for asked in model.asked)
        model.asked.clear()
        await judge(model)
        assert sorted(str(asked.body) for asked in model.asked) == first


async def test_a_name_tells_settings_apart() -> None:
    def sampled(**sampling: Any) -> ChatConfig:
        return ChatConfig(base_url="http://127.0.0.1:1/v1", model="judge-1", sampling=Sampling(**sampling))

    async with serve_judge(agrees) as model:
        names = set()
        elsewhere = ChatConfig(base_url="http://127.0.0.1:1/v1", model="judge-1", concurrency=2)
        changes: tuple[dict[str, Any], ...] = (
            {},
            {"concurrency": 3},
            {"chat": elsewhere},
            {"early_exit": True},
            {"signed_verdicts": False},
            {"keypoint": StageConfig(images_per_call=2)},
            {"chat": sampled(temperature=0.9)},  # every stage sets its own
            {"chat": sampled(top_p=0.5)},
            {"fact": StageConfig(chat=sampled(extra_body={"chat_template_kwargs": {"thinking": True}}))},
        )
        for change in changes:
            async with open_judge(JudgeChoice(name="rubric", rubric=model.config(**change))) as opened:
                names.add(opened.name)
    # Where a model is served, how many at once, and what no request is sent with change no verdict.
    assert len(names) == 6


async def test_large_rubrics_and_long_episodes_are_judged_at_once() -> None:
    groups = tuple(
        FactGroup(number, "", tuple(f"fact {number}.{i}" for i in range(5))) for number in range(4)
    )
    task = msgspec.structs.replace(TASK, rubric=Rubric(groups))
    async with serve_judge(agrees) as model:
        verdict = await judge(model, task, episode([f"page {number}" for number in range(40)]))
    assert len(verdict.facts) == 20
    assert len(model.of("keypoint")) == 10


def test_cited_steps() -> None:
    among = range(10)
    assert cited("Step 3 shows it, and steps 5, 6 and 8 too.", among) == (2, 4, 5, 7)
    assert cited("steps 2-4", among) == (1, 2, 3)
    assert cited("steps 2 to 4", [1, 3]) == (1, 3)
    assert cited("Nothing shows it; 3 of 4 steps failed", among) == ()
    assert cited("step 40", among) == ()
