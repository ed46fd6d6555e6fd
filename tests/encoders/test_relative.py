"""The bias of attention by offset, against loops."""

import itertools

import torch
from torch.nn import functional as F

from tactileforge.encoders.relative import NEIGHBOURS, RelativeBias
from tactileforge.encoders.transformer import Attention, Transformer

GRID, PREFIX, HEADS = (2, 3, 4), 2, 5
PLACES = list(itertools.product(*(range(count) for count in GRID)))


def test_the_first_bias_is_the_distance_from_a_neighbour() -> None:
    made = RelativeBias(HEADS, GRID, PREFIX, "neighbours")()
    assert made.shape == (1, HEADS, PREFIX + 24, PREFIX + 24)
    for head, (i, asks), (j, asked) in itertools.product(
        range(HEADS), enumerate(PLACES), enumerate(PLACES)
    ):
        slots, rows, columns = (there - here for here, there in zip(asks, asked, strict=True))
        down, right = NEIGHBOURS[head]
        expected = -2 * ((rows - down) ** 2 + (columns - right) ** 2 + abs(slots))
        assert made[0, head, PREFIX + i, PREFIX + j].item() == expected
    assert not made[0, :, :PREFIX].any()
    assert (made[0, :, PREFIX:, :PREFIX] == -4).all()


def test_the_same_offset_shares_a_number_and_others_do_not() -> None:
    bias = RelativeBias(1, GRID, 0, "zero")
    assert not bias.table.any()
    with torch.no_grad():
        bias.table.copy_(torch.arange(bias.table.numel()).view_as(bias.table))
    made = bias()[0, 0]
    found: dict[tuple[int, ...], float] = {}
    for (i, asks), (j, asked) in itertools.product(enumerate(PLACES), enumerate(PLACES)):
        offset = tuple(there - here for here, there in zip(asks, asked, strict=True))
        assert found.setdefault(offset, made[i, j].item()) == made[i, j].item()
    assert len(set(found.values())) == len(found) == 3 * 5 * 7


def test_a_masked_view_has_the_rows_and_columns_of_what_is_kept() -> None:
    bias = RelativeBias(HEADS, GRID, PREFIX, "neighbours")
    torch.nn.init.normal_(bias.table)
    kept = torch.tensor([[0, 5, 11], [2, 3, 7]])
    some, full = bias(kept), bias()[0]
    for row, spots in enumerate(kept.tolist()):
        tokens = [0, 1, *(PREFIX + 12 * slot + spot for slot in range(2) for spot in spots)]
        torch.testing.assert_close(some[row], full[:, tokens][:, :, tokens], atol=0, rtol=0)


def test_attention_adds_the_bias_to_its_scores() -> None:
    torch.manual_seed(0)
    attention, x, bias = Attention(8, 2), torch.randn(3, 6, 8), torch.randn(1, 2, 6, 6)
    query, key, value = attention.qkv(x).view(3, 6, 3, 2, 4).permute(2, 0, 3, 1, 4)
    weight = F.softmax(query @ key.mT / 2 + bias, dim=-1)
    expected = attention.out((weight @ value).transpose(1, 2).flatten(2))
    torch.testing.assert_close(attention(x, bias), expected)
    torch.testing.assert_close(attention(x, bias, only=slice(4, 5)), expected[:, 4:5])


def test_one_token_of_a_biased_stack_is_that_of_all() -> None:
    torch.manual_seed(0)
    stack, bias = Transformer(8, 2, 2), RelativeBias(2, (1, 2, 2), 1, "neighbours")
    x = torch.randn(3, 5, 8)
    torch.testing.assert_close(stack(x, bias(), only=slice(1)), stack(x, bias())[:, :1])
