"""The paper's synthetic example: many points of Relaxed X belong to one point of Feasible Y.

Relaxed X = [0, 2]^2, Feasible X = [0, 1]^2, Proj_X(x) = (min(x_1, 1), min(x_2, 1)); Feasible Y
is the image of Feasible X under a bent one-to-one map. Latent spaces are learnt from the same
data with and without NT-Xent on (x, Proj_X(x)), glued by a few pairs; a point of Relaxed X is
answered by the stored y whose latent is nearest. Nothing here knows a robot.
Source: Sec. V-A; the map is the one that the authors' published notebook prints.

All trainings (seeds times variants) step together: r of them, stacked in a leading dimension.
They share no weight, so each is what it would be alone.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from s3le.errors import ParameterError, TrainingError
from s3le.learn import artifact, losses
from s3le.learn.batches import draw_prior
from s3le.learn.models import SharedLatent, Sizes, build

LOWER, UPPER = np.array([0.25, 0.2]), np.array([1.75, 1.55])  # of Feasible Y
SIDE = 2.0  # of Relaxed X
VARIANTS = (False, True)  # trained without and with NT-Xent, in the order of a stack

_Stack = list[tuple[Tensor, Tensor]]  # per layer: weights (r, n_in, n_out), biases (r, 1, n_out)
_NETS = (
    "encoder_x", "decoder_x", "encoder_y", "decoder_y", "discriminator_x", "discriminator_y",
)  # fmt: skip


def project(x: np.ndarray) -> np.ndarray:
    """Proj_X: Relaxed X (n, 2) to Feasible X."""
    return np.minimum(x, 1.0)


def invariant(x: np.ndarray) -> np.ndarray:
    """True, (n,), where a point of Relaxed X (n, 2) shares its projection with others."""
    return np.asarray((x > 1.0).any(axis=1))


def to_y(x: np.ndarray) -> np.ndarray:
    """The one-to-one map from Feasible X to Feasible Y, both (n, 2).

        y_0 = 0.25 + 1.5 (1 - x_0),   y_1 = 0.3 sin(2 pi (1 - x_0)) + 0.75 x_1 + 0.5

    Source: the authors' published notebook.
    """
    back = 1.0 - x[:, 0]
    y0 = 0.25 + 1.5 * back
    y1 = 0.3 * np.sin(2.0 * np.pi * back) + 0.75 * x[:, 1] + 0.5
    return np.stack((y0, y1), axis=1)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numbers of the experiment; what params.yaml says of each stands there."""

    seed: int  # of the first training; the others count on from it
    seeds: int  # trainings of each variant
    points: int  # of Relaxed X, and as many of Feasible Y
    glue: int  # pairs
    glue_side: float  # their x are uniform in [0, side]^2: 1 Feasible X, 2 Relaxed X
    steps: int
    batch: int
    latent: int
    hidden: int
    layers: int
    learning_rate: float
    adversary_rate: float
    beta: float  # prior fitting
    tau: float  # NT-Xent
    weight_consensus: float
    weight_nt_xent: float  # of the variant that has it
    grid: int  # test points along each side of Relaxed X
    first_gain: float = 3.0  # of the first layers' weights

    def __post_init__(self) -> None:
        """Refuse numbers that no experiment can have."""
        may_be_zero = ("seed", "beta", "weight_consensus", "weight_nt_xent")
        for name, value in vars(self).items():
            least = 0 if name in may_be_zero else 2 if name == "grid" else 1e-9
            if not least <= value < float("inf"):
                raise ParameterError(f"synthetic {name} must be at least {least:g}, got {value!r}")


class World(NamedTuple):
    """The data of one seed; no weight of a loss has a part in them."""

    x: np.ndarray  # (points, 2) of Relaxed X, to learn from
    feasible: np.ndarray  # (points, 2) of Feasible X, those whose y are stored
    glue: np.ndarray  # (glue, 2) the x of the glue pairs


class Outcome(NamedTuple):
    """What one training of the example gives."""

    nt_xent: bool  # trained with NT-Xent
    seed: int
    x: np.ndarray  # (m, 2) test points: a regular grid over Relaxed X, then the glue pairs' x
    glue: np.ndarray  # bool (m,) which of them are the glue pairs'
    row: np.ndarray  # (m,) what the learnt map returns: rows of the world's feasible
    answer: np.ndarray  # (m, 2) the y of these rows
    truth: np.ndarray  # (m, 2) to_y(project(x))
    world: World
    model: SharedLatent

    def error(self, where: np.ndarray | None = None) -> float:
        """Mean absolute error in y over both coordinates and the grid, or its points `where`."""
        at = ~self.glue if where is None else ~self.glue & where
        return float(np.abs(self.answer[at] - self.truth[at]).mean())


def run(
    settings: Settings,
    on_step: Callable[[int, int, dict[str, float]], None] | None = None,
) -> list[Outcome]:
    """Train with and without NT-Xent for every seed and map a grid of Relaxed X to Feasible Y.

    Both variants of a seed see the same points, glue, first weights, batches and prior draws.

    Args:
        settings: numbers of the experiment.
        on_step: called after each step with (steps done, steps in all, loss terms, each the mean
            over all trainings).

    Returns:
        Every seed without NT-Xent, then every seed with it.

    Raises:
        TrainingError: a loss is not finite.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # nets this small lose time to a second thread
    try:
        return _run(settings, on_step)
    finally:
        torch.set_num_threads(threads)


def figures(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Errors in y, mean and standard deviation over the seeds (0 for one), by variant and region.

    Returns:
        "with_nt_xent" and "without_nt_xent", each with "error_all" over Relaxed X,
        "error_invariant" where Proj_X is many-to-one and "error_feasible" in Feasible X, each
        {"mean", "sd"}; "better", in how many of the "seeds" NT-Xent makes error_invariant
        smaller; "shown", a typical seed.
    """
    tree: dict[str, Any] = {}
    for nt_xent, name in zip(VARIANTS, ("without_nt_xent", "with_nt_xent"), strict=True):
        own = [o for o in outcomes if o.nt_xent == nt_xent]
        errors = {
            "error_all": [o.error() for o in own],  # dvc takes a key "error" for a failure
            "error_invariant": [o.error(invariant(o.x)) for o in own],
            "error_feasible": [o.error(~invariant(o.x)) for o in own],
        }
        tree[name] = {
            kind: {"mean": float(np.mean(e)), "sd": float(np.std(e, ddof=1)) if own[1:] else 0.0}
            for kind, e in errors.items()
        }
    gains = _gains(outcomes)
    tree["better"] = sum(gain > 0.0 for gain in gains)
    return tree | {"seeds": len(gains), "shown": typical(outcomes)}


def columns(outcomes: Sequence[Outcome], seed: int) -> dict[str, np.ndarray]:
    """Columns of table synthetic: what both variants of one seed learnt."""
    own = [o for o in outcomes if o.seed == seed]
    parts = [
        {
            "nt_xent": np.full(len(o.x), o.nt_xent),
            "row": np.arange(len(o.x)),
            "kind": np.where(o.glue, "glue", "grid"),
            "x": o.x,
            "x_true": project(o.x),
            "y_true": o.truth,
            "x_answer": o.world.feasible[o.row],
            "y_answer": o.answer,
        }
        for o in own
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def typical(outcomes: Sequence[Outcome]) -> int:
    """The seed to show: the one whose gain from NT-Xent in the invariant region is the median.

    Of an even number of seeds the one below the middle; never the best one.
    """
    gains = _gains(outcomes)
    return outcomes[int(np.argsort(gains, kind="stable")[(len(gains) - 1) // 2])].seed


def _gains(outcomes: Sequence[Outcome]) -> list[float]:
    """By how much NT-Xent lowers each seed's error in the invariant region."""
    error = [o.error(invariant(o.x)) for o in outcomes]
    half = len(error) // 2
    return [without - with_it for without, with_it in zip(error[:half], error[half:], strict=True)]


# --- training


def _run(
    settings: Settings, on_step: Callable[[int, int, dict[str, float]], None] | None
) -> list[Outcome]:
    seeds = range(settings.seed, settings.seed + settings.seeds)
    worlds = [_world(settings, seed) for seed in seeds]
    draws = [torch.Generator().manual_seed(seed) for seed in seeds]
    sizes = Sizes(
        dim_x=2, dim_q=2, latent=settings.latent, hidden=settings.hidden, layers=settings.layers
    )
    box = torch.from_numpy(LOWER), torch.from_numpy(UPPER)
    first = [build("s3le", sizes, *box, g, settings.first_gain) for g in draws]
    models = [deepcopy(model) for _ in VARIANTS for model in first]
    stacks = {name: _stack([getattr(model, name) for model in models]) for name in _NETS}
    _train(settings, worlds, draws, models[0].joints.to_unit, stacks, on_step)
    outcomes = []
    for r, model in enumerate(models):
        for name in _NETS:
            _unstack(stacks[name], r, getattr(model, name))
        variant, s = divmod(r, settings.seeds)
        outcomes.append(_map(model.eval(), VARIANTS[variant], seeds[s], worlds[s], settings.grid))
    return outcomes


def _world(settings: Settings, seed: int) -> World:
    rng = np.random.default_rng(seed)
    return World(
        x=rng.uniform(0.0, SIDE, size=(settings.points, 2)),
        feasible=rng.uniform(0.0, 1.0, size=(settings.points, 2)),
        glue=rng.uniform(0.0, settings.glue_side, size=(settings.glue, 2)),
    )


def _train(
    settings: Settings,
    worlds: Sequence[World],
    draws: Sequence[torch.Generator],
    to_unit: Callable[[Tensor], Tensor],
    nets: dict[str, _Stack],
    on_step: Callable[[int, int, dict[str, float]], None] | None,
) -> None:
    """Train all stacked networks in place.

    Args:
        settings: numbers of the experiment.
        worlds: data of each of the s seeds.
        draws: the random stream of each seed.
        to_unit: y in units of its box.
        nets: by name, stacks of r = s len(VARIANTS) networks, seeds within variants.
        on_step: as for run.
    """
    n, variants = settings.batch, len(VARIANTS)

    def stacked(rows: list[np.ndarray]) -> Tensor:
        return torch.from_numpy(np.stack(rows).astype(np.float32))  # (s, ., 2)

    x_all = stacked([world.x for world in worlds])
    y_all = to_unit(stacked([to_y(world.feasible) for world in worlds]))
    glue_x = stacked([world.glue for world in worlds])
    # x~ and x-bar, both of one y
    glue_x = torch.cat((glue_x, glue_x.clamp(max=1.0)), dim=1).repeat(variants, 1, 1)
    glue_y = stacked([to_y(project(world.glue)) for world in worlds])
    glue_y = to_unit(glue_y).repeat(variants, 2, 1)
    weight = settings.weight_nt_xent * torch.tensor(VARIANTS).repeat_interleave(len(worlds))

    def some(rows: Tensor) -> Tensor:
        """A batch of each seed's rows, the same for every variant."""
        at = [torch.randint(rows.shape[1], (n,), generator=g) for g in draws]
        return torch.stack([own[i] for own, i in zip(rows, at, strict=True)]).repeat(variants, 1, 1)

    def prior() -> Tensor:
        drawn = [draw_prior("ball", n, settings.latent, g) for g in draws]
        return torch.stack(drawn).repeat(variants, 1, 1)

    rates = (settings.learning_rate, settings.adversary_rate)
    groups = [
        [p for name in names for layer in nets[name] for p in layer]
        for names in (_NETS[:4], _NETS[4:])
    ]
    optimisers = [
        torch.optim.Adam(group, lr=rate, fused=True)
        for group, rate in zip(groups, rates, strict=True)
    ]
    for step in range(settings.steps):
        fall = 0.5 * (1.0 + np.cos(np.pi * step / settings.steps))
        for optimiser, rate in zip(optimisers, rates, strict=True):
            optimiser.param_groups[0]["lr"] = rate * fall
            optimiser.zero_grad()
        terms = _terms(settings, nets, some(x_all), some(y_all), glue_x, glue_y, prior)
        if "nt_xent" in terms:
            terms["nt_xent"] = weight * terms["nt_xent"]
        values = {name: float(value.detach().mean()) for name, value in terms.items()}
        for name, value in values.items():
            if not np.isfinite(value):
                raise TrainingError(f"synthetic: step {step}: loss {name} is {value}")
        sum(terms.values()).sum().backward()  # a sum over r: no training sees another's gradient
        for optimiser in optimisers:
            optimiser.step()
        if on_step is not None:
            on_step(step + 1, settings.steps, values)


def _terms(
    settings: Settings,
    nets: dict[str, _Stack],
    relaxed: Tensor,
    y: Tensor,
    glue_x: Tensor,
    glue_y: Tensor,
    prior: Callable[[], Tensor],
) -> dict[str, Tensor]:
    """Loss terms of one step, each (r,); NT-Xent not yet weighted.

    Args:
        settings: numbers of the experiment.
        nets: stacks of networks.
        relaxed: points of Relaxed X, (r, n, 2).
        y: points of Feasible Y in units of its box, (r, n, 2).
        glue_x, glue_y: all pairs, (r, 2 glue, 2).
        prior: draws from the latent prior, (r, n, latent).
    """
    n = settings.batch
    z_relaxed, z_feasible, z_glue = _forward(
        nets["encoder_x"], torch.cat((relaxed, relaxed.clamp(max=1.0), glue_x), dim=1)
    ).split((n, n, glue_x.shape[1]), dim=1)
    z_y, z_glue_y = _forward(nets["encoder_y"], torch.cat((y, glue_y), dim=1)).split(
        (n, glue_y.shape[1]), dim=1
    )
    recon, consensus = torch.vmap(losses.reconstruction), torch.vmap(losses.consensus)
    terms = {
        "recon_x": recon(relaxed, _forward(nets["decoder_x"], z_relaxed)),
        "recon_y": recon(y, _forward(nets["decoder_y"], z_y)),
        "consensus": settings.weight_consensus * consensus(z_glue, z_glue_y),
    }
    if settings.weight_nt_xent:
        nt_xent = torch.vmap(lambda a, b: losses.nt_xent(a, b, settings.tau))
        terms["nt_xent"] = nt_xent(z_relaxed, z_feasible)
    if settings.beta:
        judge = torch.vmap(lambda a, b: losses.prior_discriminator(a, b, settings.beta))
        please = torch.vmap(lambda a: losses.prior_encoder(a, settings.beta))
        for name, z in (("x", z_relaxed), ("y", z_y)):
            stack = nets[f"discriminator_{name}"]
            logits = _forward(stack, torch.cat((prior(), z.detach()), dim=1)).split((n, n), dim=1)
            terms[f"discriminator_{name}"] = judge(*logits)
            still = [(w.detach(), b.detach()) for w, b in stack]  # this term moves encoders alone
            terms[f"prior_{name}"] = please(_forward(still, z))
    return terms


def _stack(nets: Sequence[nn.Module]) -> _Stack:
    """Networks of one shape as one with a leading dimension."""
    layers = [[part for part in net if isinstance(part, nn.Linear)] for net in nets]
    return [
        (
            torch.stack([one.weight.detach().T for one in same]).contiguous().requires_grad_(),
            torch.stack([one.bias.detach()[None] for one in same]).requires_grad_(),
        )
        for same in zip(*layers, strict=True)
    ]


def _unstack(stack: _Stack, r: int, net: nn.Module) -> None:
    """Put the weights of the r-th network of a stack into a network of its own."""
    layers = [part for part in net if isinstance(part, nn.Linear)]
    with torch.no_grad():
        for layer, (weight, bias) in zip(layers, stack, strict=True):
            layer.weight.copy_(weight[r].T)
            layer.bias.copy_(bias[r, 0])


def _forward(stack: _Stack, x: Tensor) -> Tensor:
    """What learn.models.mlp computes, for r networks at once: (r, n, n_in) to (r, n, n_out)."""
    *hidden, (weight, bias) = stack
    for w, b in hidden:
        x = torch.tanh(torch.baddbmm(b, x, w))
    return torch.baddbmm(bias, x, weight)


def _map(model: SharedLatent, nt_xent: bool, seed: int, world: World, grid: int) -> Outcome:
    side = np.linspace(0.0, SIDE, grid)
    test = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    x, stored = np.concatenate((test, world.glue)), to_y(world.feasible)
    z_x, z_y = artifact.encode_x(model, x), artifact.encode_q(model, stored)
    row = np.array([np.argmin(((z_y - z) ** 2).sum(axis=1)) for z in z_x])  # ties: lowest row
    return Outcome(
        nt_xent=nt_xent,
        seed=seed,
        x=x,
        glue=np.arange(len(x)) >= len(test),
        row=row,
        answer=stored[row],
        truth=to_y(project(x)),
        world=world,
        model=model,
    )
