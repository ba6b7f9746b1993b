"""The loop: it learns, repeats itself bit for bit, resumes after a kill, refuses bad data."""

import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from s3le.errors import ParameterError, TrainingError
from s3le.learn import artifact, batches, losses, training
from s3le.learn.batches import TrainingData, Tuples
from s3le.learn.models import Sizes, build
from s3le.learn.training import Training, train

TINY = Training(
    steps=12,
    batch=16,
    batch_pairs=8,
    batch_domain=16,
    latent=4,
    hidden=16,
    learning_rate=1e-3,
    prior_rows="all",
    consensus_kind="plain",
    weight_recon_x=1.0,
    weight_recon_q=1.0,
    weight_consensus=1.0,
    weight_nt_xent=1.0,
    precision="float32",
    warm_up=2,
    threads=1,
    checkpoint_every=4,
    history_every=5,
)


def world(n=200, seed=0):
    """The clamp world, lifted to 21 numbers: relaxed in [0, 2]^2, feasible in [0, 1]^2."""
    rng = np.random.default_rng(seed)
    lift = np.random.default_rng(99).normal(size=(2, 21)) / 2.0

    def tuples(count, mixed):
        relaxed = rng.uniform(0, 2, size=(count, 2))
        feasible = np.minimum(relaxed, 1.0)
        between = (0.3 * relaxed + 0.7 * feasible) @ lift if mixed else None
        return Tuples(relaxed @ lift, feasible @ lift, relaxed, feasible, between)

    domain = rng.uniform(0, 1, size=(n, 2))
    return TrainingData(
        pairs=tuples(20, False),
        sampled=tuples(n, True),
        robot_q=domain,
        mocap_x=rng.uniform(0, 2, size=(n, 2)) @ lift,
        lower=np.zeros(2),
        upper=np.ones(2),
    )


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[k], b[k]) for k in a)


@pytest.mark.parametrize("method", ["s3le", "lwl2", "ale"])
def test_every_loss_but_the_adversary_falls(method):
    hyper = dataclasses.replace(TINY, steps=300, history_every=30, prior_fit="mmd", beta=0.01)
    history = train(method, world(), hyper, device="cpu").history
    assert [row["step"] for row in history] == list(range(30, 301, 30))
    wanted = {"recon_x", "recon_q", "prior_x", "prior_y", "consensus"}
    wanted |= {"nt_xent"} if method == "s3le" else set()
    assert wanted <= history[0].keys()
    for name in ("recon_x", "recon_q"):
        assert history[-1][name] < 0.6 * history[0][name], name
    assert history[-1]["consensus"] < history[0]["consensus"]


def test_nt_xent_brings_relaxed_and_feasible_skeletons_together():
    data, hyper = world(400), dataclasses.replace(TINY, steps=400, weight_consensus=0.0, tau=0.2)

    def confusion(weight):  # mean -log of the share that the own partner gets among all
        model = train("s3le", data, dataclasses.replace(hyper, weight_nt_xent=weight)).model
        a = torch.from_numpy(artifact.encode_x(model, data.sampled.x_relaxed))
        b = torch.from_numpy(artifact.encode_x(model, data.sampled.x_feasible))
        return losses.nt_xent(a, b, hyper.tau).item()

    assert confusion(1.0) < confusion(0.0) - 0.3


@pytest.mark.parametrize("method", ["s3le", "lwl2", "ale"])
def test_one_seed_gives_one_result_and_the_global_generators_play_no_part(method):
    data = world()
    torch.manual_seed(1)
    first = train(method, data, TINY, device="cpu")
    state = torch.get_rng_state()
    second = train(method, data, TINY, device="cpu")
    assert torch.equal(state, torch.get_rng_state())
    assert same(first.weights, second.weights)
    assert first.history == second.history
    other = train(method, data, dataclasses.replace(TINY, seed=1), device="cpu")
    assert not same(first.weights, other.weights)


def test_the_baselines_leave_the_sampled_tuples_alone():
    data = world()
    for method in ("lwl2", "ale"):
        with_them = train(method, data, TINY, device="cpu")
        without = train(method, data._replace(sampled=None), TINY, device="cpu")
        assert same(with_them.weights, without.weights)
        assert "nt_xent" not in with_them.history[0]


def test_lwl2_is_s3le_without_sampled_tuples_and_nt_xent():
    data = world()._replace(sampled=None)
    plain = dataclasses.replace(TINY, weight_nt_xent=0.0)
    assert same(train("lwl2", data, TINY).weights, train("s3le", data, plain).weights)


class KilledError(Exception):
    """Stands for the process dying."""


@pytest.mark.parametrize("precision", ["float32", "bf16"])
@pytest.mark.parametrize("method", ["s3le", "lwl2", "ale"])
@pytest.mark.parametrize("death", [3, 7, 11])
def test_a_killed_training_resumes_to_the_same_bits(tmp_path, method, death, precision):
    data, path = world(), tmp_path / "checkpoint"
    hyper = dataclasses.replace(TINY, precision=precision)
    whole = train(method, data, hyper, device="cpu")

    def die(step, total, terms):
        if step == death:
            raise KilledError

    with pytest.raises(KilledError):
        train(method, data, hyper, device="cpu", checkpoint=path, on_step=die)
    seen = []
    resumed = train(
        method, data, hyper, device="cpu", checkpoint=path, on_step=lambda s, *_: seen.append(s)
    )
    assert seen[0] == death // 4 * 4 + 1  # goes on from the last checkpoint
    assert same(whole.weights, resumed.weights)
    assert columns(whole.history) == columns(resumed.history)
    again = train(method, data, hyper, device="cpu", checkpoint=path)  # all done: no step left
    assert same(whole.weights, again.weights)
    assert columns(whole.history) == columns(again.history)


def columns(history):
    """Rows with their terms in order, as the file of a curve will have them."""
    return [list(row.items()) for row in history]


CHILD = """
import sys, dataclasses, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_training import TINY, world, train
hyper = dataclasses.replace(TINY, steps=40)
def tell(step, total, terms):
    print(step, flush=True)
    time.sleep(0.02)
train("s3le", world(), hyper, device="cpu", checkpoint=Path(sys.argv[1]), on_step=tell)
"""


def test_a_training_killed_by_the_system_resumes_to_the_same_bits(tmp_path):
    path, here = tmp_path / "checkpoint", str(Path(__file__).parent)
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), here], stdout=subprocess.PIPE, text=True
    )
    with child:
        for line in child.stdout:
            if int(line) == 17:
                os.kill(child.pid, signal.SIGKILL)
                break
    assert child.returncode == -signal.SIGKILL
    hyper, seen = dataclasses.replace(TINY, steps=40), []
    resumed = train("s3le", world(), hyper, device="cpu", checkpoint=path,
                    on_step=lambda s, *_: seen.append(s))  # fmt: skip
    assert seen[0] >= 17
    assert same(train("s3le", world(), hyper, device="cpu").weights, resumed.weights)


def test_a_foreign_or_damaged_checkpoint_is_ignored_with_a_line(tmp_path, caplog):
    data, path = world(), tmp_path / "checkpoint"
    whole = train("s3le", data, TINY, device="cpu")
    train("s3le", data, dataclasses.replace(TINY, tau=0.5), device="cpu", checkpoint=path)
    assert same(train("s3le", data, TINY, device="cpu", checkpoint=path).weights, whole.weights)
    assert "is of another training; starting anew" in caplog.text
    train("s3le", world(seed=1), TINY, device="cpu", checkpoint=path)
    assert same(train("s3le", data, TINY, device="cpu", checkpoint=path).weights, whole.weights)
    path.write_bytes(path.read_bytes()[:-100])
    caplog.clear()
    assert same(train("s3le", data, TINY, device="cpu", checkpoint=path).weights, whole.weights)
    assert "checkpoint ignored" in caplog.text
    assert "cannot be read" in caplog.text


def test_how_often_checkpoints_are_written_does_not_matter(tmp_path):
    data, path = world(), tmp_path / "checkpoint"
    often = dataclasses.replace(TINY, checkpoint_every=1)
    never = dataclasses.replace(TINY, checkpoint_every=0)
    a = train("s3le", data, often, device="cpu", checkpoint=path)
    b = train("s3le", data, never, device="cpu")
    assert same(a.weights, b.weights)


def test_progress_is_told_after_every_step():
    seen = []
    train("s3le", world(), TINY, device="cpu", on_step=lambda s, n, t: seen.append((s, n, set(t))))
    assert [s for s, _, _ in seen] == list(range(1, 13))
    assert {n for _, n, _ in seen} == {12}
    assert {"recon_x", "consensus", "nt_xent", "discriminator"} <= seen[0][2]


@pytest.mark.parametrize("field", ["robot_q", "mocap_x"])
def test_empty_and_not_finite_domain_data_are_refused(field):
    data = world()
    rows = getattr(data, field)
    with pytest.raises(TrainingError, match=f"{field} has no rows; nothing to train on"):
        train("s3le", data._replace(**{field: rows[:0]}), TINY)
    for bad in (np.nan, np.inf):
        broken = rows.copy()
        broken[[3, 9], 0] = bad
        with pytest.raises(TrainingError, match=f"{field}: 2 of 200 rows are not finite, first at"):
            train("s3le", data._replace(**{field: broken}), TINY)
    with pytest.raises(TrainingError, match=f"{field} must have shape"):
        train("s3le", data._replace(**{field: rows[:, :1]}), TINY)


@pytest.mark.parametrize("group", ["pairs", "sampled"])
def test_bad_tuples_are_refused(group):
    data = world()
    tuples = getattr(data, group)

    def attempt(**change):
        train("s3le", data._replace(**{group: tuples._replace(**change)}), TINY)

    with pytest.raises(TrainingError, match=f"{group}: arrays have .* rows, one count is wanted"):
        attempt(q_feasible=tuples.q_feasible[1:])
    with pytest.raises(TrainingError, match=f"{group}.x_relaxed has no rows"):
        attempt(**{name: rows if rows is None else rows[:0] for name, rows in
                   tuples._asdict().items()})  # fmt: skip
    with pytest.raises(TrainingError, match=f"{group}.x_feasible: 20* of 20* rows are not finite"):
        attempt(x_feasible=tuples.x_feasible * np.nan)


def test_methods_without_their_tuples_are_refused_and_s3le_needs_only_one_kind():
    data = world()
    with pytest.raises(TrainingError, match="lwl2 trains on mocap pairs alone"):
        train("lwl2", data._replace(pairs=None), TINY)
    with pytest.raises(TrainingError, match="no tuples"):
        train("s3le", data._replace(pairs=None, sampled=None), TINY)
    with pytest.raises(TrainingError, match="a step draws no tuples"):
        train("lwl2", data, dataclasses.replace(TINY, batch_pairs=0))
    for absent in ("pairs", "sampled"):
        assert train("s3le", data._replace(**{absent: None}), TINY).history
    with pytest.raises(ParameterError, match="method must be one of s3le, lwl2, ale, got 'gan'"):
        train("gan", data, TINY)


@pytest.mark.parametrize("term", ["consensus", "nt_xent", "prior_encoder"])
def test_a_loss_that_is_not_finite_names_step_and_term(monkeypatch, term):
    calls = []
    true = getattr(losses, term)

    def rot(*args):
        calls.append(1)
        return true(*args) * (float("nan") if len(calls) > 6 else 1.0)

    monkeypatch.setattr(losses, term, rot)
    name = {"prior_encoder": "prior_x"}.get(term, term)
    with pytest.raises(TrainingError, match=rf"s3le: step \d+: loss {name} is nan"):
        train("s3le", world(), TINY, device="cpu")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"tau": 0.0}, "tau must be a finite float at least 1e-06, got 0.0"),
        ({"steps": 0}, "steps must be a finite int at least 1, got 0"),
        ({"steps": 1.5}, "steps must be a finite int at least 1, got 1.5"),
        ({"beta": -1.0}, "beta must be a finite float at least 0, got -1.0"),
        (
            {"learning_rate": float("nan")},
            "learning_rate must be a finite float at least 1e-09, at most 1, got nan",
        ),
        ({"precision": "fp8"}, "precision must be one of float32, bf16, got 'fp8'"),
        ({"mixup": 1}, "mixup must be true or false, got 1"),
        ({"seed": True}, "seed must be a finite int at least 0, got True"),
    ],
    ids=lambda v: next(iter(v)) if isinstance(v, dict) else "",
)
def test_hyper_parameters_out_of_range_are_refused(change, text):
    with pytest.raises(ParameterError, match=text):
        dataclasses.replace(TINY, **change)


def test_the_rate_rises_then_falls_to_zero_or_stays():
    cosine = dataclasses.replace(TINY, steps=100, warm_up=10, schedule="cosine")
    rates = [training.rate_at(step, cosine) for step in range(101)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(1.0, abs=0.03)
    assert np.argmax(rates) == 9
    assert rates[100] == pytest.approx(0.0, abs=1e-12)
    flat = dataclasses.replace(cosine, schedule="constant")
    assert [training.rate_at(s, flat) for s in (0, 9, 10, 99)] == pytest.approx([0.1, 1, 1, 1])


@pytest.mark.parametrize(
    "change",
    [
        {"precision": "bf16"},
        {"prior_fit": "none"},
        {"prior": "normal"},
        {"prior_rows": "tuples"},
        {"second_moment": 0.9},
        {"consensus_kind": "normalised"},
        {"reconstruct": "feasible"},
        {"mixup": False},
        {"weight_x_to_q": 0.1},
        {"weight_q_to_x": 0.1},
        {"schedule": "constant"},
    ],
    ids=lambda change: "{}-{}".format(*next(iter(change.items()))),
)
def test_every_switch_changes_the_training_and_repeats(change):
    data, hyper = world(), dataclasses.replace(TINY, steps=4, **change)
    one, two = (train("s3le", data, hyper, device="cpu").weights for _ in range(2))
    assert same(one, two)
    assert not same(one, train("s3le", data, dataclasses.replace(TINY, steps=4)).weights)


def test_a_batch_holds_corresponding_rows_and_mixes_mocap_tuples_anew():
    data = world()
    source = batches.Batches(data, n_pairs=8, n_sampled=16, n_domain=5, device=torch.device("cpu"))
    g = torch.Generator().manual_seed(0)
    batch, later = source.draw(g), source.draw(g)
    assert len(batch.x_relaxed) == 24
    assert len(batch.mocap_x) == len(batch.robot_q) == 5
    for k in range(24):
        tuples = data.pairs if k < 8 else data.sampled
        row = np.flatnonzero((tuples.q_feasible.astype(np.float32) ==
                              batch.q_feasible[k].numpy()).all(axis=1))  # fmt: skip
        gaps = np.abs(tuples.x_relaxed[row] - batch.x_relaxed[k].numpy()).max(axis=1)
        assert gaps.min() < 1e-6
    span = (batch.x_relaxed - batch.x_feasible)[:8]
    part = (batch.x_mixed - batch.x_feasible)[:8]
    share = (part * span).sum(1) / span.square().sum(1).clamp(min=1e-12)
    assert torch.all((share >= -1e-5) & (share <= 1 + 1e-5))
    assert torch.allclose(part, share[:, None] * span, atol=1e-5)
    assert not torch.equal(batch.x_mixed, later.x_mixed)


@pytest.mark.parametrize("kind", ["ball", "normal"])
def test_prior_draws_have_the_spread_that_is_stated(kind):
    g = torch.Generator().manual_seed(0)
    a, b = (batches.draw_prior(kind, 20000, 6, g) for _ in range(2))
    spread = (a - b).square().sum(1).mean().item()
    assert spread == pytest.approx(batches.prior_spread(kind, 6), rel=0.02)
    if kind == "ball":
        radius = a.norm(dim=1)
        assert radius.max() <= 1.0 + 1e-6
        assert (radius**6).mean() == pytest.approx(0.5, abs=0.01)  # uniform in volume


def test_the_discriminator_loss_moves_only_the_discriminators_and_the_rest_only_the_rest():
    model = build("s3le", Sizes(dim_q=2, latent=4, hidden=8), torch.zeros(2), torch.ones(2))
    source = batches.Batches(
        world(), n_pairs=4, n_sampled=4, n_domain=4, device=torch.device("cpu")
    )
    g = torch.Generator().manual_seed(0)
    terms, adversary = training.wae_terms(model, source.draw(g), TINY, True, g)

    def touched(loss):
        model.zero_grad(set_to_none=True)
        loss.backward(retain_graph=True)
        return {k.split(".")[0] for k, p in model.named_parameters() if p.grad is not None}

    judges = {"discriminator_x", "discriminator_y"}
    assert touched(adversary) == judges
    assert touched(sum(terms.values())) == {"encoder_x", "encoder_y", "decoder_x", "decoder_y"}
    assert touched(terms["prior_x"]) == {"encoder_x"}
    assert touched(terms["nt_xent"]) == {"encoder_x"}
    assert touched(terms["consensus"]) == {"encoder_x", "encoder_y"}
