"""Probes as published: sizes, shapes, forms; and that learning together is learning alone."""

import math

import numpy as np
import pytest
import torch
from tactileforge_bench.fit.features import FLIPS, PLAIN
from tactileforge_bench.fit.probes import PROBES, probe_class
from tactileforge_bench.fit.probes.attentive import Attentive, Pooler
from tactileforge_bench.fit.probes.base import Probe, ProbeTraining
from tactileforge_bench.fit.probes.force import Force, SparshForce
from tactileforge_bench.fit.probes.knn import Knn
from tactileforge_bench.fit.probes.linear import Linear
from tactileforge_bench.fit.probes.linear_adamw import LinearAdamW
from tactileforge_bench.fit.probes.pose import Pose
from tactileforge_bench.fit.probes.slip import Slip
from tactileforge_bench.fit.training import (
    Examples,
    ProbeEnsemble,
    Schedule,
    seeded_probe,
    train_probes,
)
from tactileforge_bench.tasks.targets import TargetPart
from torch import nn

from tactileforge.encoders.transformer import AttentivePooler
from tactileforge.errors import ConfigError


def classes(count: int, rows: int = 8, columns: int = 1) -> TargetPart:
    generator = torch.Generator().manual_seed(count)
    truth = torch.randint(count, (rows, columns), generator=generator).float()
    return TargetPart("classes", truth, torch.ones_like(truth), tuple(map(str, range(count))))


def force(rows: int = 8) -> TargetPart:
    truth = torch.randn(rows, 3, generator=torch.Generator().manual_seed(1)) / 2
    return TargetPart("force", truth, torch.ones_like(truth), ("x", "y", "z"))


def size(module: nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def test_every_name_gives_a_probe() -> None:
    assert all(issubclass(probe_class(name), Probe) for name in PROBES)
    with pytest.raises(ConfigError, match="did you mean 'linear'"):
        probe_class("linaer")


@pytest.mark.slow
def test_published_sizes() -> None:
    """Numbers of parameters, and shapes, of the published heads for a base encoder."""
    assert size(Force(768, {"force": force()})) == 7_236_867
    assert size(Attentive(768, {"class": classes(20)})) == 7_104_020
    shapes = {k: tuple(v.shape) for k, v in Force(768, {"force": force()}).named_parameters()}
    assert shapes["pooler.queries"] == (1, 1, 768)
    assert shapes["pooler.q.weight"] == (768, 768)
    assert shapes["pooler.kv.weight"] == (1536, 768)
    assert shapes["pooler.mlp.0.weight"] == (3072, 768)
    assert shapes["probe.force.0.weight"] == (192, 768)
    assert shapes["probe.force.2.weight"] == (3, 192)
    linear = LinearAdamW(512, {"class": classes(20)})
    assert [tuple(p.shape) for p in linear.parameters()] == [(20, 512), (20,)]
    rough = LinearAdamW(512, {"class": classes(2)})
    assert [tuple(p.shape) for p in rough.parameters()] == [(1, 512), (1,)]
    pose = Pose(768, {"pose": classes(11, columns=3)})
    assert pose(torch.randn(2, 5, 768))["pose"].shape == (2, 33)


def test_published_training() -> None:
    for kind, schedule in ((Force, "constant"), (Attentive, "cosine"), (LinearAdamW, "cosine")):
        assert kind.published == ProbeTraining(
            epochs=50,
            batch=64,
            lr=(2e-4,),
            optimiser="adamw",
            betas=(0.9, 0.99),
            weight_decay=0.05,
            schedule=schedule,
        )
    for kind in (SparshForce, Slip, Pose):
        assert (kind.published.epochs, kind.published.batch) == (51, 100)
        assert (kind.published.lr, kind.published.optimiser) == ((1e-4,), "adam")


def test_an_optimiser_or_schedule_of_another_name_is_refused() -> None:
    groups = [{"params": [nn.Parameter(torch.zeros(1))], "lr": 0.1}]
    for training in (ProbeTraining(optimiser="sgd"), ProbeTraining(schedule="linear")):
        with pytest.raises(ConfigError, match="give adamw or adam, and cosine or constant"):
            Schedule(groups, training, 1)


def test_398_tokens_of_a_base_encoder() -> None:
    out = Force(768, {"force": force()})(torch.randn(2, 398, 768))
    assert out["force"].shape == (2, 3)


@pytest.mark.parametrize("heads", [2, 16])
def test_the_pooler_is_the_published_one(heads: int) -> None:
    """Taking the query through the keys changes the order of sums, not the result."""
    pooler = Pooler(64, heads)
    for parameter in pooler.parameters():
        nn.init.normal_(parameter, std=0.3)
    plain = AttentivePooler(64, 1, heads)
    plain.load_state_dict(pooler.state_dict())
    tokens = torch.randn(3, 9, 64)
    torch.testing.assert_close(pooler(tokens), plain(tokens)[:, 0], rtol=1e-4, atol=1e-5)
    with pytest.raises(ConfigError, match="7 heads do not divide tokens of 64"):
        Pooler(64, 7)


def test_first_weights_of_the_pooler() -> None:
    pooler = Pooler(768, 16)
    assert float(pooler.q.weight.detach().std()) == pytest.approx(0.02, rel=0.03)
    assert float(pooler.out.weight.detach().std()) == pytest.approx(0.02 / math.sqrt(2), rel=0.03)
    last = pooler.mlp[2].get_parameter("weight").detach()
    assert float(last.std()) == pytest.approx(0.02 / math.sqrt(2), rel=0.03)
    assert float(pooler.kv.bias.detach().abs().max()) == 0


def test_limits_of_outputs() -> None:
    tokens = 50 * torch.randn(16, 4, 48)
    model = SparshForce(48, {"force": force()})
    nn.init.normal_(model.probe["force"].get_parameter("2.weight"), std=5.0)
    out = model(tokens)["force"].detach()
    assert float(out[:, 2].min()) >= 0
    assert float(out.abs().max()) <= 1
    assert float(out[:, :2].min()) < 0
    slip = Slip(48, {"slip": classes(2), "delta": force()})
    nn.init.normal_(slip.probe["delta"].get_parameter("2.weight"), std=5.0)
    out = slip(tokens)["delta"].detach()
    assert float(out.abs().max()) == 1


def test_losses() -> None:
    part = force(4)
    model = Force(48, {"force": part})
    error = torch.tensor([[0.01, 0.0, 0.5]])
    # beta 0.02: quadratic below, then minus half of it
    wanted = (0.5 * 0.01**2 / 0.02 + 0 + 0.5 - 0.01) / 3
    loss = model.loss({"force": error}, {"force": torch.zeros(1, 3)})
    assert float(loss) == pytest.approx(wanted, rel=1e-5)

    rough = LinearAdamW(8, {"class": classes(2)})
    logits = torch.tensor([[0.0, 1.5], [0.0, -0.5]])
    truth = torch.tensor([[1.0], [0.0]])
    binary = nn.functional.binary_cross_entropy_with_logits(logits[:, 1:], truth)
    assert float(rough.loss({"class": logits}, {"class": truth})) == pytest.approx(float(binary))

    slip = Slip(48, {"slip": classes(2)})
    raw = nn.functional.cross_entropy(logits, truth[:, 0].long(), reduction="none")
    weighted = (1.0 * raw[0] + 0.1 * raw[1]) / 1.1
    assert float(slip.loss({"slip": logits}, {"slip": truth})) == pytest.approx(float(weighted))


def test_pose_weights_rare_classes() -> None:
    truth = torch.tensor([[0.0], [0.0], [0.0], [1.0]])
    part = TargetPart("classes", truth, torch.ones_like(truth), ("a", "b"))
    weights = Pose(48, {"pose": part}).weights["pose"]
    torch.testing.assert_close(weights, torch.tensor([[4 / 6, 2.0]]))


def test_neighbours_vote() -> None:
    known = torch.tensor([[1.0, 0.0], [0.9, 0.1], [0.0, 1.0], [0.1, 0.9]])
    truth = torch.tensor([[0.0], [0.0], [1.0], [1.0]])
    part = TargetPart("classes", truth, torch.ones_like(truth), ("a", "b"))
    model = Knn(2, {"class": part}, neighbours=3)
    asked = torch.tensor([[2.0, 0.1], [0.1, 3.0]])
    assert model.vote(known, {"class": truth}, asked)["class"].tolist() == [[0.0], [1.0]]
    vector = torch.tensor([[1.0, 0, 0], [1.0, 0, 0], [0, 0, 4.0], [0, 0, 4.0]])
    of = TargetPart("force", vector, torch.ones_like(vector), ("x", "y", "z"))
    outcome = Knn(2, {"force": of}, neighbours=2).vote(known, {"force": vector}, asked)["force"]
    torch.testing.assert_close(outcome, torch.tensor([[1.0, 0, 0], [0, 0, 4.0]]))


def examples(part: TargetPart, features: torch.Tensor) -> Examples:
    rows = np.arange(len(features))
    arrays = {PLAIN: features.numpy().astype(np.float16)}
    truth = {PLAIN: {"out": part.normalised}}
    return Examples(arrays, rows, truth, torch.device("cpu"))


KINDS = [
    (LinearAdamW, lambda: classes(3, 24), (24, 32)),
    (LinearAdamW, lambda: classes(2, 24), (24, 32)),
    (Attentive, lambda: classes(3, 24), (24, 5, 48)),
    (Force, lambda: force(24), (24, 5, 48)),
    (SparshForce, lambda: force(24), (24, 5, 48)),
    (Slip, lambda: classes(2, 24), (24, 5, 48)),
    (Pose, lambda: classes(11, 24, 3), (24, 5, 48)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "part", "shape"), KINDS)
def test_together_is_as_alone(kind: type[Probe], part: object, shape: tuple[int, ...]) -> None:
    """Three seeds at two rates in one pass end as each does on its own."""
    what: TargetPart = part()  # type: ignore[operator]
    features = torch.randn(*shape, generator=torch.Generator().manual_seed(3))
    data = examples(what, features)
    uses = (np.arange(16), np.arange(16, 20), np.arange(20, 24))

    def score(decoded: dict[str, torch.Tensor]) -> float:
        return float((decoded["out"] - what.normalised[16:20]).abs().mean())

    def run(seeds: list[int], rates: tuple[float, ...]) -> list[object]:
        training = ProbeTraining(epochs=3, batch=8, lr=rates, schedule="cosine")
        build = lambda: kind(shape[-1], {"out": what})  # noqa: E731
        return train_probes(build, training, data, uses, seeds, score, higher=False)  # type: ignore[return-value]

    together = {(o.seed, o.lr): o for o in run([0, 1, 2], (1e-3, 3e-3))}  # type: ignore[attr-defined]
    assert len(together) == 6
    for (seed, rate), outcome in together.items():
        (alone,) = run([seed], (rate,))
        assert outcome.train == pytest.approx(alone.train, rel=1e-3)  # type: ignore[attr-defined]
        assert outcome.epoch == alone.epoch  # type: ignore[attr-defined]
        torch.testing.assert_close(
            outcome.predicted["out"],
            alone.predicted["out"],
            rtol=2e-3,
            atol=2e-3,  # type: ignore[attr-defined]
        )
    losses = {round(outcome.train[0], 6) for outcome in together.values()}
    assert len(losses) > 1, "seeds draw other weights"


def test_one_step_is_that_of_torch() -> None:
    """A member steps as AdamW does on an ordinary module."""
    part = force(8)
    x = torch.randn(8, 5, 48)
    twin, other = (seeded_probe(lambda: Force(48, {"out": part}), 5) for _ in range(2))
    training = ProbeTraining(epochs=1)
    members = ProbeEnsemble(
        [twin, seeded_probe(lambda: Force(48, {"out": part}), 6)], [1e-2, 3e-2], training, 1
    )
    members.step(x, {"out": part.normalised})
    optimiser = torch.optim.AdamW(other.parameters(), 1e-2, betas=(0.9, 0.99), weight_decay=0.05)
    other.loss(other(x), {"out": part.normalised}).backward()  # type: ignore[no-untyped-call]
    optimiser.step()
    for name, value in other.named_parameters():
        torch.testing.assert_close(members.params[0][name], value, rtol=1e-3, atol=1e-4)


def test_the_best_epoch_is_kept() -> None:
    part = force(12)
    data = examples(part, torch.randn(12, 16))
    uses = (np.arange(8), np.arange(8, 10), np.arange(10, 12))
    scores = iter([3.0, 1.0, 2.0, 5.0])
    training = ProbeTraining(epochs=4, batch=4, lr=(1e-2,))

    def go(epochs: int) -> torch.Tensor:
        again = ProbeTraining(epochs=epochs, batch=4, lr=(1e-2,))
        falling = iter(range(100, 0, -1))
        build = lambda: LinearAdamW(16, {"out": part})  # noqa: E731
        (out,) = train_probes(build, again, data, uses, [0], lambda _: float(next(falling)), False)
        assert out.epoch == epochs
        return out.predicted["out"]

    build = lambda: LinearAdamW(16, {"out": part})  # noqa: E731
    (outcome,) = train_probes(build, training, data, uses, [0], lambda _: next(scores), False)
    assert (outcome.epoch, outcome.score) == (2, 1.0)
    torch.testing.assert_close(outcome.predicted["out"], go(2))


def test_mirrored_examples_keep_their_truth() -> None:
    """Each drawn row is a row of its mirror image, with the label of that image."""
    rows = np.arange(6)
    arrays = {f: np.full((6, 1), i * 10, np.float16) + rows[:, None] for i, f in enumerate(FLIPS)}
    truth = {
        f: {"out": torch.full((6, 1), i * 10.0) + torch.arange(6)[:, None]}
        for i, f in enumerate(FLIPS)
    }
    data = Examples(
        {k: v.astype(np.float16) for k, v in arrays.items()}, rows, truth, torch.device("cpu")
    )
    seen = set()
    for seed in range(8):
        x, y = data.mirrored(rows, np.random.default_rng(seed))
        torch.testing.assert_close(x, y["out"])
        seen |= {int(v) // 10 for v in x[:, 0]}
        assert (x[:, 0] % 10).tolist() == list(range(6))
    assert seen == {0, 1, 2, 3}
    assert all(truth[f]["out"][0, 0] == i * 10 for i, f in enumerate(FLIPS)), "nothing is changed"


def test_linear_is_the_minimum_of_its_objective() -> None:
    """The gradient of the penalised cross-entropy, written out, is zero at the fit."""
    torch.manual_seed(0)
    known = torch.randn(60, 5) * torch.tensor([1.0, 10.0, 0.1, 3.0, 0.0]) + 4
    part = classes(3, 60)
    model = Linear(5, {"out": part})
    penalty = 0.01
    layer = model.fit(known, {"out": part.truth}, penalty)["out"]
    assert layer[4].abs().max() == 0, "a constant feature has no weight"
    spread = known.double().std(0, correction=0)
    rows = torch.cat([known.double(), torch.ones(60, 1).double()], 1)
    error = (rows @ layer).softmax(1) - nn.functional.one_hot(part.truth[:, 0].long(), 3)
    # weights of standardised features are those of the features, times their deviations
    slope = rows[:, :4].T @ error / 60 + penalty * spread[:4, None] ** 2 * layer[:4]
    assert slope.abs().max() < 1e-4
    assert error.mean(0).abs().max() < 1e-5


def test_linear_on_numbers_is_ridge_in_closed_form() -> None:
    torch.manual_seed(1)
    known, part = torch.randn(40, 6), force(40)
    layer = Linear(6, {"out": part}).fit(known, {"out": part.truth}, 0.1)["out"]
    mean, spread = known.double().mean(0), known.double().std(0, correction=0)
    x, y = (known.double() - mean) / spread, part.truth.double()
    # half the mean over 40 x 3 numbers: the penalty weighs 120 times as much
    weight = torch.linalg.solve(x.T @ x + 0.1 * 120 * torch.eye(6), x.T @ (y - y.mean(0)))
    torch.testing.assert_close(layer[:-1] * spread[:, None], weight, rtol=0, atol=1e-5)


def test_linear_chooses_the_penalty_on_validation() -> None:
    """Random labels want the strongest penalty; labels equal to a feature do not."""
    rng = torch.Generator().manual_seed(2)
    known, asked = torch.randn(80, 30, generator=rng), torch.randn(400, 30, generator=rng)
    part = TargetPart("numbers", torch.zeros(80, 1), torch.ones(80, 1), ("n",))
    model = Linear(30, {"out": part})
    for signal, strong in ((0.0, True), (1.0, False)):
        truth = signal * known[:, :1] + (1 - signal) * torch.randn(80, 1, generator=rng)
        wanted = signal * asked[:, :1] + (1 - signal) * torch.randn(400, 1, generator=rng)

        def score(values: dict[str, torch.Tensor], wanted: torch.Tensor = wanted) -> float:
            return float((values["out"] - wanted).square().mean())

        penalty, _ = model.choose(known, {"out": truth}, asked, score, higher=False)
        assert (penalty >= 1) is strong
