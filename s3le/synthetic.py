"""The paper's synthetic example: many points of Relaxed X belong to one point of Feasible Y.

Relaxed X = [0, 2]^2, Feasible X = [0, 1]^2, Proj_X(x) = (min(x_1, 1), min(x_2, 1)); Feasible Y
is the image of Feasible X under a bent one-to-one map. Two latent spaces are learnt from the
same data, one with NT-Xent on (x, Proj_X(x)) and one without, glued by a few pairs; a point of
Relaxed X is answered by the stored y whose latent is nearest. Nothing here knows a robot.
Source: Sec. V-A; the map is the one that the authors' published notebook prints.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from s3le import artifact, losses
from s3le.batches import draw_prior
from s3le.errors import ParameterError, TrainingError
from s3le.models import SharedLatent, Sizes, build

LOWER, UPPER = np.array([0.25, 0.2]), np.array([1.75, 1.55])  # of Feasible Y


def project(x: np.ndarray) -> np.ndarray:
    """Proj_X: Relaxed X (n, 2) to Feasible X."""
    return np.minimum(x, 1.0)


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
    """Numbers of the experiment; the paper's where it gives any."""

    points: int = 10_000  # of Relaxed X, and as many of Feasible Y (paper)
    glue: int = 20  # pairs (paper)
    glue_side: float = 1.0  # their x are uniform in [0, side]^2: 1 Feasible X, 2 Relaxed X
    steps: int = 3000
    batch: int = 128
    latent: int = 4
    hidden: int = 64  # units of three hidden layers; small, for the world is
    learning_rate: float = 3e-3
    adversary_rate: float = 1e-3
    beta: float = 0.1  # prior fitting
    tau: float = 1.0  # NT-Xent (paper)
    weight_consensus: float = 100.0
    weight_nt_xent: float = 10.0  # 0: the baseline
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse numbers that no experiment can have."""
        for name, value in vars(self).items():
            least = 0 if name in ("seed", "beta", "weight_consensus", "weight_nt_xent") else 1e-9
            if not least <= value < float("inf"):
                raise ParameterError(f"synthetic {name} must be at least {least:g}, got {value!r}")


class Outcome(NamedTuple):
    """What one training of the example gives."""

    x: np.ndarray  # (m, 2) test points, a regular grid over Relaxed X
    truth: np.ndarray  # (m, 2) to_y(project(x))
    answer: np.ndarray  # (m, 2) what the learnt map returns, rows of the stored y
    z_x: np.ndarray  # (m, latent) latents of x
    z_y: np.ndarray  # (points, latent) latents of the stored y
    stored: np.ndarray  # (points, 2) the stored y
    glue: np.ndarray  # (glue, 2) the x of the glue pairs
    error: float  # mean absolute error over test points and both coordinates
    error_invariant: float  # the same where Proj_X is many-to-one: outside Feasible X
    model: SharedLatent


def run(
    settings: Settings,
    *,
    grid: int = 41,
    on_step: Callable[[int, int, dict[str, float]], None] | None = None,
) -> Outcome:
    """Train once and map a grid of Relaxed X to Feasible Y.

    The data of one seed do not depend on the weights of the losses, so that runs with and
    without NT-Xent are compared on the same points and the same glue.

    Args:
        settings: numbers of the experiment.
        grid: test points along each side of Relaxed X.
        on_step: called after each step with (steps done, steps in all, loss terms).

    Raises:
        TrainingError: a loss is not finite.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # nets this small lose time to a second thread
    try:
        return _run(settings, grid, on_step)
    finally:
        torch.set_num_threads(threads)


def _run(
    settings: Settings, grid: int, on_step: Callable[[int, int, dict[str, float]], None] | None
) -> Outcome:
    rng = np.random.default_rng(settings.seed)
    x = rng.uniform(0.0, 2.0, size=(settings.points, 2))
    stored = to_y(rng.uniform(0.0, 1.0, size=(settings.points, 2)))
    glue = rng.uniform(0.0, settings.glue_side, size=(settings.glue, 2))
    g = torch.Generator().manual_seed(settings.seed)
    sizes = Sizes(dim_x=2, dim_q=2, latent=settings.latent, hidden=settings.hidden)
    lower, upper = torch.from_numpy(LOWER), torch.from_numpy(UPPER)
    model = build("s3le", sizes, lower, upper, g)

    x_all, y_all, glue_x = (torch.from_numpy(v.astype(np.float32)) for v in (x, stored, glue))
    glue_both = torch.cat((glue_x, glue_x.clamp(max=1.0)))  # x~ and x-bar, both of one y
    glue_y = torch.from_numpy(to_y(project(glue)).astype(np.float32)).repeat(2, 1)
    named = dict(model.named_parameters())
    judges = [p for k, p in named.items() if k.startswith("discriminator")]
    own = [p for k, p in named.items() if not k.startswith("discriminator")]
    rates = (settings.learning_rate, settings.adversary_rate)
    optimisers = [
        torch.optim.Adam(group, lr=rate, fused=True)
        for group, rate in zip((own, judges), rates, strict=True)
    ]
    n = settings.batch
    for step in range(settings.steps):
        fall = 0.5 * (1.0 + np.cos(np.pi * step / settings.steps))
        for optimiser, rate in zip(optimisers, rates, strict=True):
            optimiser.param_groups[0]["lr"] = rate * fall
            optimiser.zero_grad()
        relaxed = x_all[torch.randint(len(x_all), (n,), generator=g)]
        y = y_all[torch.randint(len(y_all), (n,), generator=g)]
        z_relaxed, z_feasible, z_glue = model.encode_x(
            torch.cat((relaxed, relaxed.clamp(max=1.0), glue_both))
        ).split((n, n, len(glue_both)))
        z_y, z_glue_y = model.encode_q(torch.cat((y, glue_y))).split((n, len(glue_y)))
        unit = model.joints.to_unit(y)
        terms = {
            "recon_x": losses.reconstruction(relaxed, model.decode_x(z_relaxed)),
            "recon_y": losses.reconstruction(unit, model.decoder_y(z_y)),
            "consensus": settings.weight_consensus * losses.consensus(z_glue, z_glue_y),
        }
        if settings.weight_nt_xent:
            pull = losses.nt_xent(z_relaxed, z_feasible, settings.tau)
            terms["nt_xent"] = settings.weight_nt_xent * pull
        if settings.beta:
            for name, z in (("x", z_relaxed), ("y", z_y)):
                judge = getattr(model, f"discriminator_{name}")
                prior = draw_prior("ball", n, settings.latent, g)
                terms[f"discriminator_{name}"] = losses.prior_discriminator(
                    judge(prior), judge(z.detach()), settings.beta
                )
                judge.requires_grad_(False)  # the next term moves the encoder alone
                terms[f"prior_{name}"] = losses.prior_encoder(judge(z), settings.beta)
                judge.requires_grad_(True)
        values = {name: float(value.detach()) for name, value in terms.items()}
        for name, value in values.items():
            if not np.isfinite(value):
                raise TrainingError(f"synthetic: step {step}: loss {name} is {value}")
        sum(terms.values()).backward()
        for optimiser in optimisers:
            optimiser.step()
        if on_step is not None:
            on_step(step + 1, settings.steps, values)
    return _map(model.eval(), stored, glue, grid)


def _map(model: SharedLatent, stored: np.ndarray, glue: np.ndarray, grid: int) -> Outcome:
    side = np.linspace(0.0, 2.0, grid)
    x = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    z_x, z_y = artifact.encode_x(model, x), artifact.encode_q(model, stored)
    nearest = [int(np.argmin(((z_y - z) ** 2).sum(axis=1))) for z in z_x]  # ties: lowest row
    truth, answer = to_y(project(x)), stored[nearest]
    gap = np.abs(answer - truth).mean(axis=1)
    outside = (x > 1.0).any(axis=1)
    return Outcome(
        x=x,
        truth=truth,
        answer=answer,
        z_x=z_x,
        z_y=z_y,
        stored=stored,
        glue=glue,
        error=float(gap.mean()),
        error_invariant=float(gap[outside].mean()),
        model=model,
    )
