"""What is trained on is what was sampled."""

from __future__ import annotations

import math

import msgspec
import pytest
from tests.inference.tiny import INSTRUCT, THINKING, tiny_renderer
from tests.train.making import PICTURES, request, step, stored

from webgym.core.tokens import ReplyTokens
from webgym.core.trajectory import Message, Reply, TextPart
from webgym.inference.rendering import Renderer
from webgym.train.samples import DropReason, Sample, SampleMaker, UntrainableStep, rebuild_reply

END = "<|im_end|>"


@pytest.fixture(scope="module")
def instruct() -> Renderer:
    return tiny_renderer(INSTRUCT)


@pytest.fixture(scope="module")
def thinking() -> Renderer:
    return tiny_renderer(THINKING)


def made(renderer: Renderer, reply: Reply, **settings: bool | int) -> Sample:
    maker = SampleMaker(renderer, **settings)  # type: ignore[arg-type]
    return maker.of(step(reply=reply, messages=request()), PICTURES.__getitem__, 0.5)


def dropped(renderer: Renderer, reply: Reply, **settings: bool | int) -> DropReason:
    with pytest.raises(UntrainableStep) as caught:
        made(renderer, reply, **settings)
    return caught.value.reason


# --- stored tokens -----------------------------------------------------------------------------------------


def test_stored_tokens_are_used_as_they_are(instruct: Renderer) -> None:
    # "the" in single letters: not how the tokenizer would write it, but how it was sampled.
    ids = [instruct.tokenizer.convert_tokens_to_ids(letter) for letter in "the"]
    ids.append(instruct.tokenizer.eos_token_id)
    found = made(instruct, stored(instruct, "the", reply_ids=ids, logprobs=[-0.5] * 4, weight_version="3"))

    assert found.reply_ids.tolist() == ids != instruct.tokenizer(f"the{END}")["input_ids"]
    assert found.prompt_ids.tolist() == instruct.prompt_ids(request())
    assert found.logprobs is not None
    assert found.logprobs.tolist() == [-0.5] * 4
    assert (found.version, found.advantage) == ("3", 0.5)


def test_a_prompt_with_another_number_of_image_tokens_is_dropped(instruct: Renderer) -> None:
    ids = instruct.prompt_ids(request())
    place = ids.index(instruct.image_id)
    for other in (ids[:place] + ids[place + 1 :], [*ids[:place], instruct.image_id, *ids[place:]]):
        assert dropped(instruct, stored(instruct, "click", prompt_ids=other)) == "image_tokens"


def test_ids_that_were_told_before_expansion_are_expanded_where_the_count_proves_it(
    instruct: Renderer,
) -> None:
    ids = instruct.prompt_ids(request())
    told = [each for place, each in enumerate(ids) if each != instruct.image_id or ids[place - 1] != each]
    assert len(told) == len(ids) - 1
    found = made(instruct, stored(instruct, "click", prompt_ids=told, prompt_tokens=len(ids)))
    assert found.prompt_ids.tolist() == ids
    for count in (0, len(told), len(ids) + 1):
        reply = stored(instruct, "click", prompt_ids=told, prompt_tokens=count)
        assert dropped(instruct, reply) == "image_tokens"


def test_pictures_whose_tokens_are_right_in_sum_but_not_one_by_one_are_dropped(instruct: Renderer) -> None:
    two = (*request(0), Message("assistant", (TextPart("x"),)), *request(1, width=96)[1:])
    ids = instruct.prompt_ids(two)
    first, last = ids.index(instruct.image_id), len(ids) - 1 - ids[::-1].index(instruct.image_id)
    shifted = [*ids[:first], instruct.image_id, *ids[first:last], *ids[last + 1 :]]
    reply = stored(instruct, "click", prompt_ids=shifted)
    with pytest.raises(UntrainableStep, match="image_tokens"):
        SampleMaker(instruct).of(step(reply=reply, messages=two), PICTURES.__getitem__)


def test_a_reply_that_does_not_read_as_stored_is_dropped(instruct: Renderer) -> None:
    ids = [*instruct.tokenizer("clack")["input_ids"], instruct.tokenizer.eos_token_id]
    assert dropped(instruct, stored(instruct, "click", reply_ids=ids)) == "reply_text"
    assert dropped(instruct, stored(instruct, "click", reply_ids=[])) == "reply_text"


def test_a_blank_that_only_the_server_put_before_the_first_word_does_not_matter(instruct: Renderer) -> None:
    ids = [*instruct.tokenizer("click")["input_ids"], instruct.tokenizer.eos_token_id]
    assert made(instruct, stored(instruct, " click", reply_ids=ids)).reply_ids.tolist() == ids


def test_a_reply_ends_as_its_finish_reason_says(instruct: Renderer) -> None:
    bare = instruct.tokenizer("click")["input_ids"]
    assert dropped(instruct, stored(instruct, "click", reply_ids=bare)) == "reply_end"
    assert dropped(instruct, stored(instruct, "click", finish_reason="length")) == "reply_end"
    cut = made(instruct, stored(instruct, "click", reply_ids=bare, finish_reason="length"))
    assert cut.reply_ids.tolist() == bare
    assert made(instruct, stored(instruct, "click", reply_ids=bare, finish_reason="max_tokens"))
    assert rebuild_reply(instruct, Reply("click", "p", "max_tokens"), []) == bare
    # A server may end a reply at a string of one's own, which is no token of the reply.
    assert made(instruct, stored(instruct, "click", reply_ids=bare, sampling={"stop": ["\n"]}))


@pytest.mark.parametrize(
    ("reasoning", "text"),
    [("look\n", "\n\nclick"), ("look", "click"), ("look\n", "click")],
)
def test_reasoning_that_was_split_off_is_part_of_the_stored_reply(
    thinking: Renderer, reasoning: str, text: str
) -> None:
    ids = [*thinking.tokenizer("look\n</think>\n\nclick")["input_ids"], thinking.tokenizer.eos_token_id]
    assert (
        made(thinking, stored(thinking, text, reply_ids=ids, reasoning=reasoning)).reply_ids.tolist() == ids
    )
    assert dropped(thinking, stored(thinking, text, reply_ids=ids, reasoning="loot")) == "reply_text"
    assert dropped(thinking, stored(thinking, "clack", reply_ids=ids, reasoning="look")) == "reply_text"


def test_empty_thinking_that_was_split_off_is_part_of_the_stored_reply(thinking: Renderer) -> None:
    ids = [*thinking.tokenizer("\n</think>\n\nclick")["input_ids"], thinking.tokenizer.eos_token_id]
    reply = stored(thinking, "click", reply_ids=ids, separated=True)
    assert made(thinking, reply).reply_ids.tolist() == ids
    assert dropped(thinking, stored(thinking, "clack", reply_ids=ids, separated=True)) == "reply_text"


def test_a_reply_with_an_image_token_is_dropped(instruct: Renderer) -> None:
    ids = [*instruct.tokenizer("click")["input_ids"], instruct.image_id, instruct.tokenizer.eos_token_id]
    assert dropped(instruct, stored(instruct, "click", reply_ids=ids)) == "image_in_reply"


# --- rebuilt -----------------------------------------------------------------------------------------------


class Server:
    """Samples a text token by token, ends it or cuts it off, and gives the text as real ones do."""

    def __init__(self, renderer: Renderer, *, splits: bool = False, strips: bool = False) -> None:
        self.renderer = renderer
        self.splits = splits
        self.strips = strips

    def reply(self, said: str, most: int = 10**6) -> tuple[list[int], list[int], Reply]:
        """The ids of the prompt, those that were sampled, and the reply as it is stored."""
        tokenizer = self.renderer.tokenizer
        prompt = self.renderer.prompt(request(), PICTURES).prompt_ids
        sampled: list[int] = []
        for token in [*tokenizer(said)["input_ids"], tokenizer.eos_token_id]:
            if len(sampled) == most:
                break
            sampled.append(token)
        finished = sampled[-1] == tokenizer.eos_token_id
        text, reasoning = self.renderer.decode(sampled), ""
        if self.splits:
            reasoning, _, text = text.removeprefix("<think>").partition("</think>")
        if self.strips:
            reasoning, text = reasoning.strip(), text.strip()
        return prompt, sampled, Reply(text, "p", "stop" if finished else "length", reasoning=reasoning)


def same(renderer: Renderer, server: Server, said: str, most: int = 10**6) -> bool:
    prompt, sampled, reply = server.reply(said, most)
    found = made(renderer, reply)
    return found.prompt_ids.tolist() == prompt and found.reply_ids.tolist() == sampled


@pytest.mark.parametrize(
    "said",
    ["click", "the action on the other\n\n", "\n\nMemory: {}", "<tool_call>\n{}\n</tool_call>", "über ☃"],
)
def test_a_rebuilt_instruct_reply_is_what_was_sampled(instruct: Renderer, said: str) -> None:
    assert same(instruct, Server(instruct), said)


@pytest.mark.parametrize("most", [1, 2, 3])
def test_a_reply_that_was_cut_off_has_no_end_token(instruct: Renderer, most: int) -> None:
    assert same(instruct, Server(instruct), "the action", most)


THOUGHTS = ["look there\n</think>\n\nclick on it", "a\n\nb\n</think>\n\n<tool_call>{}</tool_call>"]


@pytest.mark.parametrize("strips", [False, True])
@pytest.mark.parametrize("said", THOUGHTS)
def test_a_rebuilt_thinking_reply_is_what_was_sampled(thinking: Renderer, said: str, strips: bool) -> None:
    assert same(thinking, Server(thinking), said)  # a server that leaves the thinking in
    assert same(thinking, Server(thinking, splits=True, strips=strips), said)


@pytest.mark.parametrize("said", THOUGHTS)
def test_a_template_that_leaves_thinking_to_the_model_has_its_opening_in_the_reply(
    instruct: Renderer, said: str
) -> None:
    assert same(instruct, Server(instruct, splits=True, strips=True), f"<think>\n{said}")


def test_thinking_that_was_split_without_stripping_is_put_together_as_it_was(thinking: Renderer) -> None:
    assert same(thinking, Server(thinking, splits=True), "look\n\n</think>\nclick")


def test_thinking_that_was_cut_off_is_not_closed(thinking: Renderer) -> None:
    assert same(thinking, Server(thinking, splits=True), "look there", 4)


def test_the_whole_conversation_by_the_template_is_prompt_and_reply(thinking: Renderer) -> None:
    """The template writes a whole reply as the model said it: rebuilt targets stand in its own form."""
    _, sampled, reply = Server(thinking, splits=True, strips=True).reply(THOUGHTS[0])
    messages = [{"role": each.role, "content": "".join(map(str, each.content))} for each in request()[:1]]
    said = {"role": "assistant", "content": reply.text, "reasoning_content": reply.reasoning}
    whole = thinking.tokenizer.apply_chat_template([*messages, said], tokenize=False)
    opening = thinking.tokenizer.apply_chat_template(messages, tokenize=False, add_generation_prompt=True)
    assert whole.startswith(opening)
    assert thinking.tokenizer(whole[len(opening) :].removesuffix("\n"))["input_ids"] == sampled


@pytest.mark.parametrize(
    "reply",
    [
        Reply("click", "p", "tool_calls"),
        Reply("click", "p", ""),
        Reply("click", "p", sampling={"stop": ["</tool_call>"]}),
        Reply("", "p", reasoning="thought, and maybe closed it"),
        Reply("click", "p", separated=True),
        Reply("", "p", "length"),
        Reply("click", "p", sampling={"chat_template_kwargs": {"enable_thinking": False}}),
        Reply("click", "p", sampling={"tools": [{"type": "function"}]}),
    ],
)
def test_what_cannot_be_known_is_not_guessed(thinking: Renderer, reply: Reply) -> None:
    assert dropped(thinking, reply) == "not_rebuilt"


def test_an_empty_reply_that_ended_by_itself_is_its_end_token(instruct: Renderer) -> None:
    assert rebuild_reply(instruct, Reply("", "p"), []) == [instruct.tokenizer.eos_token_id]


def test_an_endpoint_that_separates_thinking_finds_none_in_an_instruct_reply(instruct: Renderer) -> None:
    ids = [*instruct.tokenizer("click")["input_ids"], instruct.tokenizer.eos_token_id]
    assert made(instruct, Reply("click", "p", separated=True)).reply_ids.tolist() == ids
    assert made(instruct, stored(instruct, "click", separated=True)).reply_ids.tolist() == ids


def test_a_request_that_holds_the_placeholder_is_dropped(instruct: Renderer) -> None:
    messages = (Message("system", (TextPart("<|image_pad|>"),)),)
    with pytest.raises(UntrainableStep, match="no_request"):
        SampleMaker(instruct).of(step(messages=messages), PICTURES.__getitem__)


# --- both --------------------------------------------------------------------------------------------------


def test_a_step_longer_than_the_cutoff_is_dropped_and_never_cut(instruct: Renderer) -> None:
    length = len(made(instruct, Reply("click", "p")))
    assert len(made(instruct, Reply("click", "p"), cutoff_tokens=length)) == length
    for reply in (Reply("click", "p"), stored(instruct, "click")):
        assert dropped(instruct, reply, cutoff_tokens=length - 1) == "too_long"


def test_importance_weights_need_logprobs_of_the_full_distribution(instruct: Renderer) -> None:
    assert dropped(instruct, Reply("click", "p"), off_policy=True) == "no_logprobs"
    assert dropped(instruct, stored(instruct, "click", logprobs=None), off_policy=True) == "no_logprobs"
    tokens = stored(instruct, "click").tokens
    assert tokens is not None
    for value in (math.nan, -math.inf):
        unknown = ReplyTokens.of(tokens.prompt_ids, tokens.reply_ids, [value] * len(tokens.reply_ids))
        overflowed = msgspec.structs.replace(stored(instruct, "click"), tokens=unknown)
        assert dropped(instruct, overflowed, off_policy=True) == "no_logprobs"
    for sampling in (
        {"top_k": 2},
        {"top_p": 0.99},
        {"temperature": 0},
        {"min_p": 0.1},
        {"repetition_penalty": 1.1},
        {"presence_penalty": -0.5},
        {"logit_bias": {"7": 1}},
        {"structured_outputs": {"regex": "a|b"}},
        {"min_tokens": 20},
        {"ignore_eos": True},
        {"a_parameter_of_tomorrow": 0.5},
    ):
        reply = stored(instruct, "click", sampling=sampling)
        assert dropped(instruct, reply, off_policy=True) == "altered_sampling"
        assert made(instruct, reply)
    full: dict[str, object] = {
        "top_k": -1,
        "top_p": 1.0,
        "temperature": 0.7,
        "repetition_penalty": 1.0,
        "min_p": None,
    }
    full |= {"typical_p": 1.0, "bad_words": [], "seed": 3, "chat_template_kwargs": {"enable_thinking": False}}
    assert made(instruct, stored(instruct, "click", sampling=full), off_policy=True).temperature == 0.7


def test_drops_are_counted_by_reason_and_the_rest_is_made(instruct: Renderer) -> None:
    maker = SampleMaker(instruct)
    replies = [
        Reply("click", "p"),
        stored(instruct, "click"),
        Reply("", "p", "length"),
        Reply("x", "p", "abort"),
    ]
    steps = [(step(reply=reply, messages=request()), 1.0) for reply in replies]
    assert len(list(maker.make(steps, PICTURES.__getitem__))) == 2
    assert (dict(maker.dropped), maker.rebuilt, maker.stored) == ({"not_rebuilt": 2}, 1, 1)


def test_pictures_are_resized_as_in_the_request(instruct: Renderer) -> None:
    messages = request(1, width=96, height=64)  # stored as 64 x 32
    found = SampleMaker(instruct).of(step(messages=messages), PICTURES.__getitem__)
    pixels = found.pixels(instruct)
    assert pixels is not None
    assert pixels.grid.tolist() == [[1, 4, 6]]
    assert sum(instruct.image_mask(found.prompt_ids.tolist())) == 6
