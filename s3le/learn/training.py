"""One training loop for S3LE and the two baselines it is compared with (Sec. V-B).

s3le: two Wasserstein autoencoders, latent consensus, NT-Xent, on mocap and sampled tuples.
lwl2: the same without the sampled tuples and without NT-Xent.
ale: two variational autoencoders and consensus, on mocap tuples; its decoder is its answer.

Deterministic for one seed, machine and thread count; a killed training resumes to the bits of
an uninterrupted one (CPU). Arrays in, a trained model out: only the checkpoint touches a disk.
"""

import hashlib
import json
import logging
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from s3le.errors import ModelError, ParameterError, TrainingError
from s3le.learn import losses
from s3le.learn.artifact import read_tensors, write_tensors
from s3le.learn.batches import (
    Batch,
    Batches,
    TrainingData,
    check,
    draw_prior,
    fingerprint,
    prior_spread,
)
from s3le.learn.models import METHODS, AleModel, SharedLatent, Sizes, build
from s3le.learn.settings import Training

log = logging.getLogger(__name__)


class Trained(NamedTuple):
    """What a training returns."""

    model: SharedLatent | AleModel  # on the training's device, in eval mode
    weights: dict[str, Tensor]  # its state dict, on the CPU
    history: list[dict[str, float]]  # `step` and the mean of each loss term since the last row


def wae_terms(
    model: SharedLatent, batch: Batch, hyper: Training, contrastive: bool, g: torch.Generator
) -> tuple[dict[str, Tensor], Tensor]:
    """Loss terms of S3LE and LWL2 for one batch.

    Reconstruction and prior fitting see the relaxed skeletons and the mocap domain in X, the
    feasible poses and the robot domain in Y; the consensus pairs are (x~, q-bar),
    (x-bar, q-bar), (x', q-bar); the NT-Xent pairs (x~, x-bar) and (x', x-bar).

    Returns:
        Pair (terms, adversary): weighted terms of encoders and decoders by name, and the
        discriminators' own loss, which has no gradient to the encoders.
    """
    b = len(batch.x_relaxed)
    unit_q = model.joints.to_unit(torch.cat((batch.q_feasible, batch.robot_q)))
    seen = [batch.x_relaxed, batch.x_feasible] + ([batch.x_mixed] if hyper.mixup else [])
    x = torch.cat((*seen[:1], batch.mocap_x, *seen[1:]))  # one pass for all skeletons
    z_x = model.encoder_x(x).float()
    z_y = model.encoder_y(unit_q).float()  # and one for all poses
    m = len(batch.mocap_x)
    z_relaxed, z_feasible, *z_mixed = torch.cat((z_x[:b], z_x[b + m :])).split(b)
    wae_x, wae_y = z_x[: b + m], z_y  # rows of eq. (wae_loss), tuples first
    target = batch.x_relaxed if hyper.reconstruct == "itself" else batch.x_feasible
    terms = {}

    inward = [wae_x] + ([z_y[:b]] if hyper.weight_q_to_x else [])
    outward = [wae_y] + ([z_relaxed] if hyper.weight_x_to_q else [])
    x_out = model.decoder_x(torch.cat(inward)).float()
    q_out = model.decoder_y(torch.cat(outward)).float()
    terms["recon_x"] = hyper.weight_recon_x * losses.reconstruction(
        torch.cat((target, batch.mocap_x)), x_out[: b + m]
    )
    terms["recon_q"] = hyper.weight_recon_q * losses.reconstruction(unit_q, q_out[: len(unit_q)])
    if hyper.weight_q_to_x:
        cross = losses.reconstruction(batch.x_feasible, x_out[b + m :])
        terms["q_to_x"] = hyper.weight_q_to_x * cross
    if hyper.weight_x_to_q:
        cross = losses.reconstruction(unit_q[:b], q_out[len(unit_q) :])
        terms["x_to_q"] = hyper.weight_x_to_q * cross

    glue = losses.consensus if hyper.consensus_kind == "plain" else losses.consensus_normalised
    z_tuples = torch.cat((z_relaxed, z_feasible, *z_mixed))
    z_pose = z_y[:b].repeat(len(seen), 1)
    terms["consensus"] = hyper.weight_consensus * glue(z_tuples, z_pose)
    if contrastive and hyper.weight_nt_xent:
        pulls = [losses.nt_xent(z, z_feasible, hyper.tau) for z in (z_relaxed, *z_mixed)]
        terms["nt_xent"] = hyper.weight_nt_xent * torch.stack(pulls).mean()

    adversary = torch.zeros((), device=z_x.device)
    if hyper.prior_fit != "none" and hyper.beta:
        chosen = {"all": slice(None), "tuples": slice(0, b), "domain": slice(b, None)}
        rows = chosen[hyper.prior_rows]
        for name, z in (("x", wae_x[rows]), ("y", wae_y[rows])):
            prior = draw_prior(hyper.prior, len(z), hyper.latent, g)
            if hyper.prior_fit == "mmd":
                spread = prior_spread(hyper.prior, hyper.latent)
                terms[f"prior_{name}"] = losses.mmd(z, prior, spread, hyper.beta)
                continue
            judge = getattr(model, f"discriminator_{name}")
            judged = judge(torch.cat((prior, z.detach()))).float()
            adversary = adversary + losses.prior_discriminator(
                judged[: len(prior)], judged[len(prior) :], hyper.beta
            )
            judge.requires_grad_(False)  # the next term moves the encoder alone
            terms[f"prior_{name}"] = losses.prior_encoder(judge(z).float(), hyper.beta)
            judge.requires_grad_(True)
    return terms, adversary


def ale_terms(
    model: AleModel, batch: Batch, hyper: Training, g: torch.Generator
) -> dict[str, Tensor]:
    """Loss terms of ALE for one batch: two ELBOs, consensus between means, optional x to q.

    beta weighs the divergences, as it weighs the prior elsewhere.
    """
    b, m = len(batch.x_relaxed), len(batch.mocap_x)
    x = torch.cat((batch.mocap_x, batch.x_relaxed))
    unit_q = model.joints.to_unit(torch.cat((batch.q_feasible, batch.robot_q)))
    mean_x, logvar_x = model.encoder_x(x).float().chunk(2, dim=1)
    mean_y, logvar_y = model.encoder_y(unit_q).float().chunk(2, dim=1)

    def sample(mean: Tensor, logvar: Tensor) -> Tensor:
        noise = torch.randn(mean.shape, generator=g, device=mean.device)
        return mean + noise * (0.5 * logvar).exp()

    z_x, z_y = sample(mean_x, logvar_x), sample(mean_y, logvar_y)
    outward = [z_y] + ([z_x[m:]] if hyper.weight_x_to_q else [])
    q_out = model.decoder_y(torch.cat(outward)).float()
    glue = losses.consensus if hyper.consensus_kind == "plain" else losses.consensus_normalised
    terms = {
        "recon_x": hyper.weight_recon_x * losses.reconstruction(x, model.decoder_x(z_x).float()),
        "recon_q": hyper.weight_recon_q * losses.reconstruction(unit_q, q_out[: len(unit_q)]),
        "prior_x": hyper.beta * losses.kl_to_standard_normal(mean_x, logvar_x),
        "prior_y": hyper.beta * losses.kl_to_standard_normal(mean_y, logvar_y),
        "consensus": hyper.weight_consensus * glue(mean_x[m:], mean_y[:b]),
    }
    if hyper.weight_x_to_q:
        cross = losses.reconstruction(unit_q[:b], q_out[len(unit_q) :])
        terms["x_to_q"] = hyper.weight_x_to_q * cross
    return terms


def rate_at(step: int, hyper: Training) -> float:
    """Factor on the learning rates at a step (0-based): linear warm-up, then constant or cosine."""
    rise = min(1.0, (step + 1) / hyper.warm_up) if hyper.warm_up else 1.0
    if hyper.schedule == "constant":
        return rise
    return rise * 0.5 * (1.0 + math.cos(math.pi * step / hyper.steps))


class _State:
    """Everything that a training carries from one step to the next."""

    def __init__(self, model: SharedLatent | AleModel, hyper: Training, device: torch.device):
        self.model = model
        named = dict(model.named_parameters())
        judges = [k for k in named if k.startswith("discriminator")]
        own = [k for k in named if k not in judges]
        betas = (0.9, hyper.second_moment)
        kw = {"betas": betas, "weight_decay": hyper.weight_decay, "fused": True}
        self.groups = [(own, hyper.learning_rate)]
        if judges:
            self.groups.append((judges, hyper.adversary_rate))
        self.optimisers = [
            torch.optim.AdamW([named[k] for k in names], lr=rate, **kw)
            for names, rate in self.groups
        ]
        self.generator = torch.Generator(device).manual_seed(hyper.seed)
        self.step = 0
        self.history: list[dict[str, float]] = []
        self.sums: dict[str, float] = {}

    def save(self, path: Path, mark: str) -> None:
        tensors = {f"model.{k}": v for k, v in self.model.state_dict().items()}
        for (names, _), optimiser in zip(self.groups, self.optimisers, strict=True):
            named = dict(self.model.named_parameters())
            for name in names:
                for key, value in optimiser.state.get(named[name], {}).items():
                    tensors[f"adam.{key}.{name}"] = value
        tensors["generator"] = self.generator.get_state()
        # As pairs: a note's keys are sorted, but terms in order are the columns of a curve.
        history, sums = [list(row.items()) for row in self.history], list(self.sums.items())
        note = {"mark": mark, "step": self.step, "history": history, "sums": sums}
        write_tensors(path, tensors, note)

    def load(self, path: Path, mark: str) -> bool:
        """Take over a checkpoint; False, with a line in the log, where it is another's."""
        if not path.is_file():
            return False
        try:
            tensors, note = read_tensors(path)
        except ModelError as error:
            log.warning("checkpoint ignored: %s", error)
            return False
        if note.get("mark") != mark:
            log.warning("checkpoint ignored: %s is of another training; starting anew", path)
            return False
        self.model.load_state_dict({k[6:]: v for k, v in tensors.items() if k.startswith("model.")})
        named = dict(self.model.named_parameters())
        for (names, _), optimiser in zip(self.groups, self.optimisers, strict=True):
            for name in names:
                parameter = named[name]
                state = optimiser.state[parameter]
                for key in ("step", "exp_avg", "exp_avg_sq"):
                    value = tensors.get(f"adam.{key}.{name}")
                    if value is not None:
                        state[key] = value.to(parameter.device)
        self.generator.set_state(tensors["generator"])
        self.step, self.sums = note["step"], dict(note["sums"])
        self.history = [dict(row) for row in note["history"]]
        log.info("resuming at step %d from %s", self.step, path)
        return True


def train(
    method: str,
    data: TrainingData,
    hyper: Training,
    *,
    device: str | torch.device | None = None,
    checkpoint: Path | None = None,
    on_step: Callable[[int, int, dict[str, float]], None] | None = None,
) -> Trained:
    """Train one method.

    Args:
        method: "s3le", "lwl2" or "ale". The baselines leave `data.sampled` unused.
        data: tuples and domain data; see TrainingData.
        hyper: hyper-parameters.
        device: where to train; None: cuda if there is one, else cpu.
        checkpoint: file to resume from and to write to every `checkpoint_every` steps and at
            the end; the caller removes it once the model is stored. A damaged checkpoint, or
            one of other data or hyper-parameters, is ignored with a line in the log.
        on_step: called after each step with (steps done, steps in all, loss terms).

    Returns:
        Model, weights and history.

    Raises:
        ParameterError: unknown method.
        TrainingError: data that is empty, misshapen or not finite; a loss or weight that is
            not finite, naming step and term.
    """
    if method not in METHODS:
        raise ParameterError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if method != "s3le":
        data = data._replace(sampled=None)
        if data.pairs is None:
            raise TrainingError(f"{method} trains on mocap pairs alone, and there are none")
    check(data)
    device = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
    threads = torch.get_num_threads()
    if hyper.threads:
        torch.set_num_threads(hyper.threads)
    try:
        return _train(method, data, hyper, device, checkpoint, on_step)
    finally:
        torch.set_num_threads(threads)


def _train(
    method: str,
    data: TrainingData,
    hyper: Training,
    device: torch.device,
    checkpoint: Path | None,
    on_step: Callable[[int, int, dict[str, float]], None] | None,
) -> Trained:
    sizes = Sizes(
        dim_q=len(data.lower), latent=hyper.latent, hidden=hyper.hidden, layers=hyper.layers
    )
    lower, upper = (torch.as_tensor(list(map(float, v))) for v in (data.lower, data.upper))
    first = torch.Generator().manual_seed(hyper.seed)
    net = build(method, sizes, lower, upper, first, hyper.first_gain)
    state = _State(net.to(device), hyper, device)
    model = state.model
    batches = Batches(
        data,
        n_pairs=hyper.batch_pairs,
        n_sampled=hyper.batch,
        n_domain=hyper.batch_domain,
        device=device,
    )
    mark = ""
    if checkpoint is not None:
        checkpoint, mark = Path(checkpoint), _mark(method, data, hyper, device)
        state.load(checkpoint, mark)

    while state.step < hyper.steps:
        factor = rate_at(state.step, hyper)
        for (_, rate), optimiser in zip(state.groups, state.optimisers, strict=True):
            optimiser.param_groups[0]["lr"] = rate * factor
            optimiser.zero_grad()
        batch = batches.draw(state.generator)
        with torch.autocast(device.type, torch.bfloat16, enabled=hyper.precision == "bf16"):
            if method == "ale":
                terms, adversary = ale_terms(model, batch, hyper, state.generator), None
            else:
                terms, adversary = wae_terms(model, batch, hyper, method == "s3le", state.generator)
        total = torch.stack(list(terms.values())).sum()
        if adversary is not None:
            terms["discriminator"] = adversary
            total = total + adversary  # the two halves share no parameter
        values = dict(zip(terms, torch.stack(list(terms.values())).tolist(), strict=True))
        for name, value in values.items():
            if not math.isfinite(value):
                raise TrainingError(f"{method}: step {state.step}: loss {name} is {value}")
        total.backward()
        for optimiser in state.optimisers:
            optimiser.step()
        state.step += 1
        _record(state, values, hyper)
        if on_step is not None:
            on_step(state.step, hyper.steps, values)
        due = hyper.checkpoint_every and state.step % hyper.checkpoint_every == 0
        if checkpoint is not None and (due or state.step == hyper.steps):
            state.save(checkpoint, mark)

    weights = {k: v.detach().cpu().clone() for k, v in model.state_dict().items()}
    for name, value in weights.items():
        if not torch.isfinite(value).all():
            raise TrainingError(f"{method}: step {state.step}: weight {name} is not finite")
    return Trained(model.eval(), weights, state.history)


def _record(state: _State, values: dict[str, float], hyper: Training) -> None:
    """Add one step's terms to the running row, and close the row when it is due."""
    for name, value in values.items():
        state.sums[name] = state.sums.get(name, 0.0) + value
    since = (state.step - 1) % hyper.history_every + 1
    if since == hyper.history_every or state.step == hyper.steps:
        means = {name: value / since for name, value in state.sums.items()}
        state.history.append({"step": state.step, **means})
        state.sums = {}


def _mark(method: str, data: TrainingData, hyper: Training, device: torch.device) -> str:
    """Hash of all that decides a training's bits."""
    settings: dict[str, Any] = asdict(hyper)
    del settings["checkpoint_every"]
    settings["threads"] = torch.get_num_threads()
    text = json.dumps([method, settings, device.type, torch.__version__, fingerprint(data)])
    return hashlib.sha256(text.encode()).hexdigest()
