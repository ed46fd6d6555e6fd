"""A small random CLIP, saved in the layout of transformers."""

from pathlib import Path

import torch


def save_clip(folder: Path) -> Path:
    """Writes the towers and the tokenizer of a CLIP with vectors of 24 numbers."""
    import transformers

    words = [*map(chr, range(97, 123))]
    vocabulary = words + [f"{w}</w>" for w in words] + ["<|startoftext|>", "<|endoftext|>"]
    transformers.CLIPTokenizer(
        vocab={word: i for i, word in enumerate(vocabulary)}, merges=[]
    ).save_pretrained(folder)
    end = len(vocabulary) - 1
    both = {
        "hidden_size": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "projection_dim": 24,
    }
    config = transformers.CLIPConfig(
        text_config={**both, "vocab_size": end + 1, "eos_token_id": end, "bos_token_id": end - 1},
        vision_config={**both, "image_size": 32, "patch_size": 16},
        projection_dim=24,
    )
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(folder)
    return folder
