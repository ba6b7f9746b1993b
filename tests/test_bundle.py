"""An exported retargeter: whole or refused, and the same as what it was made from."""

import json
import shutil

import numpy as np
import pytest
import torch
from streaming import DEFAULT, DT, held_to_its_word, motion, stored
from worlds import coman

from s3le.errors import BundleError, ParameterError
from s3le.learn import artifact, models
from s3le.retarget import encoder
from s3le.retarget.exported import save
from s3le.retarget.follow import follow
from s3le.retarget.stream import Retargeter
from s3le.search.metrics import look_up
from s3le.study import comparison


def a_model(folder, method="s3le", tag=None):
    made = coman()
    sizes = models.Sizes(dim_q=made.n_dof, latent=6, hidden=32, layers=2)
    net = models.build(method, sizes, torch.tensor(made.lower), torch.tensor(made.upper))
    path = folder / f"{method}.safetensors"
    artifact.save_model(path, net, {"method": method, "robot_hash": tag or made.tag})
    return path, net


def an_index(z):
    q, n = stored()[0], len(stored()[0])
    report = coman().certifier().check(q)
    return {
        "row": np.arange(n, dtype=np.int32), "z": np.asarray(z, np.float32), "q": q,
        "x": stored()[1],
        "clearance": report.clearance, "limit_margin": report.limit_margin,
    }  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    top = tmp_path_factory.mktemp("bundle")
    path, net = a_model(top)
    index = an_index(artifact.encode_q(net, stored()[0]))
    save(top / "it", coman(), "s3le", "l2", DEFAULT, index, path)
    return top / "it"


def test_what_is_exported_retargets(folder):
    found = follow(Retargeter.load(folder), motion()[:40], np.arange(40) * DT)
    held_to_its_word(found.q, found.v, np.full(39, DT))


@pytest.mark.parametrize("method", ["ale", "skeleton"])
def test_a_method_without_an_index_or_without_a_model_is_exported_too(method, tmp_path):
    path = None if method == "skeleton" else a_model(tmp_path, method)[0]
    index = an_index(stored()[1]) if method == "skeleton" else None
    save(tmp_path / "it", coman(), method, "l2", DEFAULT, index, path)
    found = follow(Retargeter.load(tmp_path / "it"), motion()[:20], np.arange(20) * DT)
    held_to_its_word(found.q, found.v, np.full(19, DT))


def test_two_exports_are_the_same_bytes(folder, tmp_path):
    path, net = a_model(tmp_path)
    index = an_index(artifact.encode_q(net, stored()[0]))
    save(tmp_path / "it", coman(), "s3le", "l2", DEFAULT, index, path)
    assert (tmp_path / "it/retargeter.json").read_bytes() == (
        folder / "retargeter.json"
    ).read_bytes()


def test_settings_can_be_changed_when_loading(folder):
    assert Retargeter.load(folder, {"speed_factor": 0.5}).speed.max() == 2.0
    with pytest.raises(ParameterError, match="no setting 'speed'; there are: k,"):
        Retargeter.load(folder, {"speed": 0.5})


def cut(name):
    def damage(folder):
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: len(data) // 2])

    return damage


def edit(**changed):
    def damage(folder):
        about = json.loads((folder / "retargeter.json").read_text())
        (folder / "retargeter.json").write_text(json.dumps(about | changed))

    return damage


@pytest.mark.parametrize(
    "damage, words",
    [
        (cut("poses.parquet"), "poses.parquet is not what retargeter.json says"),
        (cut("model.safetensors"), "model.safetensors is not what retargeter.json says"),
        (cut("robot/robot.yaml"), "robot/robot.yaml is not what retargeter.json says"),
        (cut("retargeter.json"), "retargeter.json is not JSON"),
        (lambda folder: (folder / "poses.parquet").unlink(), "poses.parquet is missing"),
        (lambda folder: (folder / "more").write_text("x"), "more does not belong to it"),
        (lambda folder: (folder / "retargeter.json").unlink(), "retargeter.json is missing"),
        (edit(format=2), "has format 2, this code reads 1"),
        (edit(robot="other"), "the rest is for 'other'"),
        (edit(method="magic"), "unknown method 'magic'"),
        (edit(settings={}), "is incomplete"),
        (edit(files=3), "is incomplete"),
        (edit(metric="decoded"), "neighbours holds"),
        (cut("neighbours"), "neighbours is not what retargeter.json says"),
    ],
)
def test_damaged_and_foreign_pieces_are_refused_in_one_line(folder, tmp_path, damage, words):
    shutil.copytree(folder, tmp_path / "it")
    damage(tmp_path / "it")
    with pytest.raises(BundleError, match=words) as refusal:
        Retargeter.load(tmp_path / "it")
    assert "\n" not in str(refusal.value)


def test_a_model_of_another_robot_is_not_exported(tmp_path):
    path, net = a_model(tmp_path, tag="another")
    index = an_index(artifact.encode_q(net, stored()[0]))
    with pytest.raises(Exception, match="has robot_hash 'another'"):
        save(tmp_path / "it", coman(), "s3le", "l2", DEFAULT, index, path)
    assert not (tmp_path / "it").exists()


@pytest.mark.parametrize("method", ["s3le", "ale"])
def test_one_row_without_torch_is_what_torch_says(method, tmp_path):
    path, net = a_model(tmp_path, method)
    nets = encoder.read(path, coman().tag)
    for x in motion()[:5]:
        z = artifact.encode_x(net, x[None])[0]
        assert np.abs(nets.encoder(x) - z).max() < 1e-5
        assert np.abs(nets.decoder_q(z) - artifact.decode_q(net, z[None])[0]).max() < 1e-5
        told = artifact.decode_x(net, z[None])[0]
        assert np.abs(nets.decoder_x(z) - told).max() < 1e-5
        assert np.abs(nets.encoder.then(nets.decoder_x)(x) - told).max() < 1e-5


@pytest.mark.parametrize("metric", ["l1", "cosine", "decoded", "mahalanobis"])
def test_every_metric_finds_what_the_comparison_finds(tmp_path, metric):
    path, net = a_model(tmp_path)
    index = an_index(artifact.encode_q(net, stored()[0]))
    save(tmp_path / "it", coman(), "s3le", metric, DEFAULT, index, path)
    it = Retargeter.load(tmp_path / "it")
    x = motion()[:30]
    given = comparison.comparable(index, artifact.encode_x(net, x), metric, net)
    rows, _ = look_up(*given)
    found = np.array([it.propose(row)[0] for row in x])
    assert (found == index["q"][rows]).all(axis=1).mean() > 0.95  # float32 ties, a walk's misses
