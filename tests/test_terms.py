"""What a training step is made of, computed once more by hand, one row and one pass at a time.

Every skeleton and every pose of the batch is another one, so that no row can stand for another.
"""

import dataclasses

import numpy as np
import pytest
import torch
from test_training import TINY, world

from s3le.learn import batches, gather, losses
from s3le.learn.batches import Batch, Batches, TrainingData, Tuples
from s3le.learn.models import Sizes, build
from s3le.learn.training import ale_terms, wae_terms

B, M, DIM_Q, LATENT = 5, 3, 2, 4
WEIGHTS = {
    "weight_recon_x": 1.3, "weight_recon_q": 0.7, "weight_consensus": 2.1, "weight_nt_xent": 0.9,
    "weight_q_to_x": 0.4, "weight_x_to_q": 0.6, "beta": 0.3, "tau": 0.5,
}  # fmt: skip
HYPER = dataclasses.replace(TINY, **WEIGHTS)


def a_batch(seed=0):
    g = torch.Generator().manual_seed(seed)
    shapes = [(B, 21)] * 3 + [(B, DIM_Q), (M, 21), (M, DIM_Q)]
    return Batch(*(torch.randn(*shape, generator=g) for shape in shapes))


def a_model(method):
    lower, upper = torch.tensor([-1.0, -2.0]), torch.tensor([1.5, 0.5])
    sizes = Sizes(dim_q=DIM_Q, latent=LATENT, hidden=8)
    model = build(method, sizes, lower, upper, torch.Generator().manual_seed(3))
    with torch.no_grad():
        for parameter in model.parameters():  # an untrained encoder's latents hardly differ
            parameter.mul_(3.0)
    return model, lambda q: (q - (lower + upper) / 2) / ((upper - lower) / 2)


def same(found, want):
    assert found.keys() == want.keys()
    for name, value in want.items():
        assert found[name].item() == pytest.approx(value.item(), rel=2e-5, abs=1e-6), name


def squared(truth, decoded):
    return (truth - decoded).square().sum(1).mean()


def by_hand(model, unit, batch, hyper, contrastive):
    """The terms that eqs. (wae_loss), (lc_loss) and NT-Xent ask for, each from its own rows."""
    own_q, robot_q = unit(batch.q_feasible), unit(batch.robot_q)
    z_of, z_q, z_robot = model.encoder_x, model.encoder_y(own_q), model.encoder_y(robot_q)
    relaxed, feasible, mixed = map(z_of, (batch.x_relaxed, batch.x_feasible, batch.x_mixed))
    domain = z_of(batch.mocap_x)
    target = batch.x_relaxed if hyper.reconstruct == "itself" else batch.x_feasible
    want = {
        "recon_x": hyper.weight_recon_x * squared(
            torch.cat((target, batch.mocap_x)), model.decoder_x(torch.cat((relaxed, domain)))
        ),
        "recon_q": hyper.weight_recon_q * squared(
            torch.cat((own_q, robot_q)), model.decoder_y(torch.cat((z_q, z_robot)))
        ),
        "q_to_x": hyper.weight_q_to_x * squared(batch.x_feasible, model.decoder_x(z_q)),
        "x_to_q": hyper.weight_x_to_q * squared(own_q, model.decoder_y(relaxed)),
    }  # fmt: skip
    glue = losses.consensus if hyper.consensus_kind == "plain" else losses.consensus_normalised
    seen = [relaxed, feasible, *([mixed] if hyper.mixup else [])]
    want["consensus"] = hyper.weight_consensus * sum(glue(z, z_q) for z in seen) / len(seen)
    if contrastive:
        pulled = [relaxed, *([mixed] if hyper.mixup else [])]
        pulls = [losses.nt_xent(z, feasible, hyper.tau) for z in pulled]
        want["nt_xent"] = hyper.weight_nt_xent * sum(pulls) / len(pulls)
    rows = {"all": lambda tuples, own: torch.cat((tuples, own)), "tuples": lambda tuples, _: tuples,
            "domain": lambda _, own: own}[hyper.prior_rows]  # fmt: skip
    return want, {"x": rows(relaxed, domain), "y": rows(z_q, z_robot)}


@pytest.mark.parametrize("contrastive", [True, False])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"mixup": False},
        {"consensus_kind": "normalised"},
        {"reconstruct": "feasible"},
        {"prior_rows": "tuples"},
        {"prior_rows": "domain"},
        {"prior": "normal"},
    ],
    ids=str,
)
def test_each_term_of_s3le_and_lwl2_is_that_of_the_printed_rows(change, contrastive):
    hyper, batch = dataclasses.replace(HYPER, **change), a_batch()
    model, unit = a_model("s3le")
    terms, adversary = wae_terms(model, batch, hyper, contrastive, torch.Generator().manual_seed(7))
    want, encoded = by_hand(model, unit, batch, hyper, contrastive)
    g, judged = torch.Generator().manual_seed(7), 0.0
    for name in ("x", "y"):  # draws of the prior, in the order in which they are used
        z, judge = encoded[name], getattr(model, f"discriminator_{name}")
        prior = batches.draw_prior(hyper.prior, len(z), LATENT, g)
        judged += losses.prior_discriminator(judge(prior), judge(z), hyper.beta)
        want[f"prior_{name}"] = losses.prior_encoder(judge(z), hyper.beta)
    same(terms | {"adversary": adversary}, want | {"adversary": judged})


@pytest.mark.parametrize("rows", ["all", "tuples", "domain"])
def test_the_prior_of_each_domain_is_fitted_to_its_own_latents_by_mmd_too(rows):
    hyper = dataclasses.replace(HYPER, prior_fit="mmd", prior_rows=rows)
    model, unit = a_model("s3le")
    terms, adversary = wae_terms(model, a_batch(), hyper, True, torch.Generator().manual_seed(7))
    want, encoded = by_hand(model, unit, a_batch(), hyper, True)
    g = torch.Generator().manual_seed(7)
    for name in ("x", "y"):
        prior = batches.draw_prior(hyper.prior, len(encoded[name]), LATENT, g)
        spread = batches.prior_spread(hyper.prior, LATENT)
        want[f"prior_{name}"] = losses.mmd(encoded[name], prior, spread, hyper.beta)
    same(terms, want)
    assert adversary.item() == 0.0


@pytest.mark.parametrize("kind", ["plain", "normalised"])
@pytest.mark.parametrize("cross", [0.0, 0.6])
def test_each_term_of_ale_is_that_of_its_own_rows_and_its_latents_are_sampled(kind, cross):
    hyper = dataclasses.replace(HYPER, consensus_kind=kind, weight_x_to_q=cross)
    model, unit = a_model("ale")
    batch = a_batch()
    terms = ale_terms(model, batch, hyper, torch.Generator().manual_seed(7))
    x = torch.cat((batch.mocap_x, batch.x_relaxed))
    q = unit(torch.cat((batch.q_feasible, batch.robot_q)))
    mean_x, logvar_x = model.encoder_x(x).split(LATENT, dim=1)
    mean_y, logvar_y = model.encoder_y(q).split(LATENT, dim=1)
    g = torch.Generator().manual_seed(7)
    noise_x, noise_y = (torch.randn(B + M, LATENT, generator=g) for _ in range(2))
    z_x = mean_x + noise_x * torch.sqrt(torch.exp(logvar_x))
    z_y = mean_y + noise_y * torch.sqrt(torch.exp(logvar_y))
    glue = losses.consensus if kind == "plain" else losses.consensus_normalised
    want = {
        "recon_x": hyper.weight_recon_x * squared(x, model.decoder_x(z_x)),
        "recon_q": hyper.weight_recon_q * squared(q, model.decoder_y(z_y)),
        "prior_x": hyper.beta * losses.kl_to_standard_normal(mean_x, logvar_x),
        "prior_y": hyper.beta * losses.kl_to_standard_normal(mean_y, logvar_y),
        "consensus": hyper.weight_consensus * glue(mean_x[M:], mean_y[:B]),
    }
    if cross:
        want["x_to_q"] = cross * squared(q[:B], model.decoder_y(z_x[M:]))
    same(terms, want)
    other = ale_terms(model, batch, hyper, torch.Generator().manual_seed(8))
    for name in ("recon_x", "recon_q"):
        assert abs(other[name] - terms[name]) > 1e-3, name


def numbered(n, first, mixed):
    """Tuples in which every number says which row and which array it is of."""
    rows = np.arange(first, first + n, dtype=float)[:, None]
    x, q = np.ones(21), np.ones(DIM_Q)
    return Tuples(rows + 0.1 * x, rows + 0.2 * x, rows + 0.3 * q, rows + 0.4 * q,
                  rows + 0.5 * x if mixed else None)  # fmt: skip


def test_every_array_of_a_batch_holds_its_own_column_of_the_same_row():
    pairs, sampled = numbered(30, 0, False), numbered(50, 100, True)
    domain = np.arange(200.0, 220.0)[:, None]
    data = TrainingData(pairs, sampled, domain + 0.6 * np.ones(DIM_Q), domain + 0.7 * np.ones(21),
                        np.zeros(DIM_Q), np.ones(DIM_Q))  # fmt: skip
    source = Batches(data, n_pairs=6, n_sampled=9, n_domain=8, device=torch.device("cpu"))
    batch = source.draw(torch.Generator().manual_seed(0))
    row = np.floor(batch.x_relaxed[:, 0].numpy())
    assert (row[:6] < 30).all() and (row[6:] >= 100).all() and len(row) == 15
    for name, tenth in (("x_relaxed", 0.1), ("x_feasible", 0.2), ("q_feasible", 0.4)):
        found = getattr(batch, name).numpy()
        assert np.allclose(found, (row + tenth)[:, None], rtol=0, atol=1e-4), name
    assert np.allclose(batch.x_mixed[6:], (row[6:] + 0.5)[:, None], rtol=0, atol=1e-4)
    share = (row[:6] + 0.2 - batch.x_mixed[:6, 0].numpy()) / 0.1  # drawn anew, between the two
    assert (share >= -1e-3).all() and (share <= 1.001).all() and np.ptp(share) > 0.1
    for name, tenth in (("robot_q", 0.6), ("mocap_x", 0.7)):
        found = getattr(batch, name).numpy()
        whole = np.round(found - tenth)
        assert np.allclose(found, whole + tenth, rtol=0, atol=1e-4), name
        assert (whole >= 200).all() and len(found) == 8


def test_what_is_gathered_for_a_training_is_what_each_table_holds():
    made = type("Robot", (), {"lower": -np.ones(DIM_Q), "upper": np.ones(DIM_Q)})
    pairs, sampled = numbered(4, 0, False), numbered(4, 10, True)
    poses, domain = {"q": np.full((3, DIM_Q), 20.0)}, {"x": np.full((3, 21), 30.0)}
    tables = {k: v for k, v in pairs._asdict().items() if v is not None}, sampled._asdict()
    data = gather.gather(made, tables[0], poses, domain, tables[1])
    assert data.pairs == pairs
    for found, want in ((data.pairs, pairs), (data.sampled, sampled)):
        for one, other in zip(found, want, strict=True):
            assert one is other
    assert data.robot_q is poses["q"] and data.mocap_x is domain["x"]
    assert data.lower is made.lower and data.upper is made.upper
    assert gather.gather(made, tables[0], poses, domain, None).sampled is None


def test_a_baseline_trains_on_the_pairs_alone_whatever_else_is_given(monkeypatch):
    """The rows that reach the loss, not only the weights that come of them."""
    from s3le.learn import training

    seen = []
    whole = training.wae_terms

    def watched(model, batch, hyper, contrastive, g):
        seen.append((len(batch.x_relaxed), contrastive))
        return whole(model, batch, hyper, contrastive, g)

    monkeypatch.setattr(training, "wae_terms", watched)
    hyper = dataclasses.replace(TINY, steps=1)
    training.train("lwl2", world(), hyper, device="cpu")
    training.train("s3le", world(), hyper, device="cpu")
    assert seen == [(hyper.batch_pairs, False), (hyper.batch_pairs + hyper.batch, True)]
