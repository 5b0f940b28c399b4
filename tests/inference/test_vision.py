"""The quicker vision tower computes the same numbers, gradients included."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from webgym.inference.model import fast_backward_attention  # noqa: E402


def speed_up(model: Any) -> None:
    from webgym.inference.vision import speed_up_vision  # imports transformers' models

    speed_up_vision(model)


EQUAL, UNEQUAL = [[1, 4, 6], [1, 4, 6]], [[1, 4, 6], [1, 2, 4]]


def test_a_patch_embedding_gives_the_same_as_product_and_as_convolution() -> None:
    torch.manual_seed(0)
    size = (2, 4, 4)
    plain = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick = torch.nn.Sequential(torch.nn.Conv3d(3, 8, kernel_size=size, stride=size))
    quick.load_state_dict(plain.state_dict())
    speed_up(quick)
    assert list(quick.state_dict()) == list(plain.state_dict())
    patches = torch.randn(5, 3, *size)
    made = [model(patches) for model in (plain, quick)]
    assert type(quick[0]) is not torch.nn.Conv3d
    torch.testing.assert_close(made[1], made[0])
    for each in made:
        each.square().sum().backward()
    torch.testing.assert_close(quick[0].weight.grad, plain[0].weight.grad)
    volume = torch.randn(1, 3, 4, 8, 8)  # more than a patch at a time is convolved as ever
    torch.testing.assert_close(quick(volume), plain(volume))


@pytest.mark.parametrize("pictures", [EQUAL, UNEQUAL])
def test_pictures_are_attended_to_together(pictures: list[list[int]]) -> None:
    from transformers import Qwen3VLVisionConfig, Qwen3VLVisionModel

    def made() -> Iterator[Any]:
        for _ in range(2):
            torch.manual_seed(0)
            yield Qwen3VLVisionModel(
                Qwen3VLVisionConfig(
                    depth=2,
                    hidden_size=32,
                    intermediate_size=64,
                    num_heads=2,
                    patch_size=4,
                    out_hidden_size=32,
                    num_position_embeddings=64,
                    deepstack_visual_indexes=[0],
                )
            )

    plain, quick = made()
    speed_up(quick)
    layers = [type(module).__name__ for module in quick.modules()]
    assert "_BatchedVisionAttention" in layers
    assert "Qwen3VLVisionAttention" not in layers
    grid = torch.tensor(pictures)
    patches = torch.randn(int(grid.prod(1).sum()), 3 * 2 * 4 * 4)
    seen = [plain(patches, grid_thw=grid)]
    with fast_backward_attention("cpu"):
        seen.append(quick(patches, grid_thw=grid))
    torch.testing.assert_close(seen[1].pooler_output, seen[0].pooler_output)
    for each in seen:
        each.pooler_output.square().sum().backward()
    for ours, theirs in zip(quick.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad, rtol=1e-4, atol=1e-5)


def test_a_picture_is_computed_once_until_the_weights_change() -> None:
    from transformers import Qwen3VLVisionConfig, Qwen3VLVisionModel

    torch.manual_seed(0)
    config = Qwen3VLVisionConfig(
        depth=1,
        hidden_size=32,
        intermediate_size=64,
        num_heads=2,
        patch_size=4,
        out_hidden_size=32,
        num_position_embeddings=64,
        deepstack_visual_indexes=[0],
    )
    plain, quick = Qwen3VLVisionModel(config), Qwen3VLVisionModel(config)
    quick.load_state_dict(plain.state_dict())
    speed_up(quick)
    computed: list[int] = []
    quick.patch_embed.register_forward_pre_hook(lambda _, inputs: computed.append(len(inputs[0])))
    first, second, tall = (torch.randn(24, 96) for _ in range(3))

    def both(*pictures: Any, grids: list[list[int]]) -> tuple[Any, Any]:
        return tuple(model(torch.cat(pictures), grid_thw=torch.tensor(grids)) for model in (quick, plain))

    def assert_equal(found: Any, truth: Any) -> None:
        torch.testing.assert_close(found.pooler_output, truth.pooler_output)
        torch.testing.assert_close(found.last_hidden_state, truth.last_hidden_state)
        torch.testing.assert_close(found.deepstack_features, truth.deepstack_features)

    wide = [1, 4, 6]
    with torch.no_grad():
        assert_equal(*both(first, second, first, grids=[wide] * 3))
        assert_equal(*both(tall, second, grids=[[1, 6, 4], wide]))
        assert_equal(*both(first, first, grids=[[1, 6, 4], wide]))  # the same patches in another shape
        assert computed == [48, 24, 24]
        for model in (quick, plain):
            model.pos_embed.weight.mul_(2)  # a published version, or a step of the optimizer
        assert_equal(*both(first, grids=[wide]))
        assert computed[3:] == [24]
    found, _ = both(first, first, grids=[wide] * 2)
    assert computed[4:] == [48]  # a tower that is trained computes everything, for its gradients
    assert found.pooler_output.requires_grad
    quick.requires_grad_(requires_grad=False)
    assert not both(first, first, grids=[wide] * 2)[0].pooler_output.requires_grad
    assert computed[5:] == []
