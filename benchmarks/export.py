"""AnyTouch 2 base from uint8 frames: ours, its exported files, and a plain implementation.

`encoder` returns tokens and class tokens like its peers; `Model.features` returns tokens, and
`Model.encode` projected class tokens, the usual requests to a loaded model.

The peer is transformers' CLIP vision tower with a Conv3d of tubes as embedding, and with sensor
tokens after the class token, the architecture of the published weights. Both have the same random
weights. `eager` attention is that of its authors (transformers 4.42), `sdpa` today's default.

Run: OMP_NUM_THREADS=1 python benchmarks/export.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import torch
from common import ratio, save, side_by_side
from tactileforge_export import Exported, export
from torch import Tensor, nn
from torch.nn import functional as F
from transformers import CLIPVisionConfig, CLIPVisionModel

from tactileforge.encoders import CLIP_MEAN, CLIP_STD, TactileViT
from tactileforge.hub import Model, make_header

BATCHES = (1, 4)
SIZE = (240, 320)
ROUNDS = 7


class Peer(nn.Module):
    """AnyTouch 2 on transformers' CLIP vision tower."""

    def __init__(self, attention: str) -> None:
        super().__init__()
        config = CLIPVisionConfig(
            hidden_size=768,
            intermediate_size=3072,
            num_hidden_layers=12,
            num_attention_heads=12,
            image_size=224,
            patch_size=16,
            hidden_act="gelu",
            attn_implementation=attention,
        )
        tower = CLIPVisionModel(config)
        self.tower = getattr(tower, "vision_model", tower)
        self.embed = nn.Conv3d(3, 768, (2, 16, 16), (2, 16, 16), bias=False)
        self.position = nn.Embedding(393, 768)
        self.sensor = nn.Parameter(torch.zeros(20, 5, 768))
        self.project = nn.Linear(768, 512, bias=False)
        self.mean = torch.tensor(CLIP_MEAN).view(3, 1, 1)
        self.std = torch.tensor(CLIP_STD).view(3, 1, 1)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens and projected class token of clips; see `contracts.Encoder`."""
        x = frames.float() / 255 - background[:, None].float() / 255 + 130 / 255
        x = x.clamp(0, 1).flatten(0, 1)
        x = F.interpolate(x, (224, 224), mode="bilinear", antialias=True)
        x = ((x - self.mean) / self.std).view(*frames.shape[:3], 224, 224)
        x = self.embed(x.transpose(1, 2)).flatten(2).transpose(1, 2)
        first = self.tower.embeddings.class_embedding.expand(len(x), 1, -1)
        x = torch.cat([first, x], dim=1) + self.position.weight
        x = torch.cat([x[:, :1], self.sensor[sensor], x[:, 1:]], dim=1)
        x = self.tower.encoder(self.tower.pre_layrnorm(x)).last_hidden_state
        return x, self.project(self.tower.post_layernorm(x[:, 0]))

    @torch.no_grad()
    def take(self, ours: TactileViT) -> None:
        """Copies the weights of our encoder."""
        assert ours.sensor_table is not None
        self.tower.embeddings.class_embedding.copy_(ours.class_token)
        self.position.weight.copy_(ours.position)
        self.sensor.copy_(ours.sensor_table)
        self.embed.weight.copy_(ours.embed.weight.view_as(self.embed.weight))
        self.project.load_state_dict(ours.project.state_dict())
        self.tower.pre_layrnorm.load_state_dict(ours.norm_in.state_dict())
        self.tower.post_layernorm.load_state_dict(ours.norm_out.state_dict())
        for theirs, block in zip(self.tower.encoder.layers, ours.transformer.blocks, strict=True):
            mine: Any = block
            theirs.layer_norm1.load_state_dict(mine.norm1.state_dict())
            theirs.layer_norm2.load_state_dict(mine.norm2.state_dict())
            theirs.mlp.fc1.load_state_dict(mine.mlp[0].state_dict())
            theirs.mlp.fc2.load_state_dict(mine.mlp[2].state_dict())
            attention = theirs.self_attn
            attention.out_proj.load_state_dict(mine.attention.out.state_dict())
            weights = mine.attention.qkv.weight.chunk(3), mine.attention.qkv.bias.chunk(3)
            for name, weight, bias in zip("qkv", *weights, strict=True):
                getattr(attention, f"{name}_proj").weight.copy_(weight)
                getattr(attention, f"{name}_proj").bias.copy_(bias)


def runner(done: Exported) -> Callable[..., list[Any]]:
    """An exported file in onnxruntime, with as many threads as torch."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(done.path, options, ["CPUExecutionProvider"])
    names = ("frames", "background", "sensor")

    def run(*inputs: Tensor) -> list[Any]:
        feed = {name: x.numpy() for name, x in zip(names, inputs, strict=True)}
        return [torch.from_numpy(x) for x in session.run(["tokens", "cls"], feed)]

    return run


def loaded(ours: TactileViT) -> dict[str, Callable[..., Any]]:
    """Functions for tokens and for vectors of a loaded model, see `tactileforge.load`."""
    header = make_header(ours, {"name": "tactile_vit"}, licence="NOASSERTION", spacing=ours.spacing)
    model = Model(ours, header)
    names = {row: name for name, row in ours.sensors.items()}

    def ask(tap: Any) -> Callable[..., Any]:
        def run(frames: Tensor, background: Tensor, rows: Tensor) -> dict[str, Tensor]:
            sensor = [names[row] for row in rows.tolist()]
            return {tap: model.features(frames, background, sensor, tap=tap)}

        return run

    return {"Model.features": ask("tokens"), "Model.encode": ask("projected")}


def difference(subject: Callable[..., Any], ours: TactileViT, inputs: tuple[Tensor, ...]) -> float:
    """Largest difference of a subject's tokens and class tokens from the encoder's."""
    expected = dict(zip(("tokens", "projected"), ours(*inputs), strict=True))
    given = subject(*inputs)
    found = given if isinstance(given, dict) else dict(zip(expected, given, strict=True))
    return max(float((x - expected[name]).abs().max()) for name, x in found.items())


def main() -> None:
    torch.manual_seed(0)
    ours = TactileViT("base", frames=4).eval().requires_grad_(False)
    peers = {name: Peer(name).eval().requires_grad_(False) for name in ("eager", "sdpa")}
    for peer in peers.values():
        peer.take(ours)
    with tempfile.TemporaryDirectory() as folder:
        files = {
            "onnx": export(ours, Path(folder) / "float.onnx", size=SIZE),
            "onnx int8": export(ours, Path(folder) / "int8.onnx", size=SIZE, int8=True),
        }
        megabytes = {
            name: round(Path(done.path).stat().st_size / 1e6, 1) for name, done in files.items()
        }
        subjects: dict[str, Callable[..., Any]] = {
            **{f"transformers, {name}": peer for name, peer in peers.items()},
            "encoder": ours,
            **loaded(ours),
            **{name: runner(done) for name, done in files.items()},
        }
    result: dict[str, Any] = {
        "what": f"4-frame clips, uint8 {SIZE[0]} x {SIZE[1]}, base, fp32",
        "error": {name: done.error for name, done in files.items()},
        "int8": files["onnx int8"].int8,
        "megabytes": megabytes,
        "onnxruntime": onnxruntime.__version__,
    }
    for batch in BATCHES:
        result[f"batch {batch}"] = measure(subjects, ours, batch)
    save("export", result)


def measure(
    subjects: dict[str, Callable[..., Any]], ours: TactileViT, batch: int
) -> dict[str, Any]:
    """Times and differences for one size of batch."""
    frames = torch.from_numpy(
        np.random.default_rng(batch).integers(0, 256, (batch, 5, 3, *SIZE), dtype=np.uint8)
    )
    inputs = (frames[:, 1:].contiguous(), frames[:, 0].contiguous(), torch.ones(batch).long())
    with torch.inference_mode():
        differences = {name: difference(call, ours, inputs) for name, call in subjects.items()}
        for name in subjects:
            assert name == "onnx int8" or differences[name] < 1e-4, (name, differences)
        times = side_by_side(
            {name: lambda call=call: call(*inputs) for name, call in subjects.items()},  # type: ignore[misc]
            rounds=ROUNDS,
            warmup=1,
        )
    return {
        "largest difference from the encoder": differences,
        "times": times,
        "times as fast": {
            f"{mine} against {theirs}": ratio(times, mine, theirs)
            for mine in ("encoder", "Model.features", "Model.encode", "onnx", "onnx int8")
            for theirs in subjects
            if theirs.startswith("transformers")
        },
    }


if __name__ == "__main__":
    main()
