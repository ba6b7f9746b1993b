"""Stored models: same bytes, same answers, one clear line for every damage."""

import json
import struct

import numpy as np
import pytest
import torch

from s3le.errors import ModelError
from s3le.learn import artifact
from s3le.learn.models import Sizes, build

LOWER, UPPER = torch.tensor([-1.0, 0.0, -3.0]), torch.tensor([1.0, 0.5, 2.0])
SIZES = Sizes(dim_q=3, latent=5, hidden=8)
CONFIG = {"robot": "toy", "robot_hash": "abc", "joints": ["a", "b", "c"], "training": {"tau": 1.0}}


def model_of(method, seed=0):
    return build(method, SIZES, LOWER, UPPER, torch.Generator().manual_seed(seed))


@pytest.fixture
def stored(tmp_path):
    path = tmp_path / "model.safetensors"
    artifact.save_model(path, model_of("s3le"), {**CONFIG, "method": "s3le"})
    return path


@pytest.mark.parametrize("method", ["s3le", "lwl2", "ale"])
def test_a_loaded_model_answers_as_the_saved_one(tmp_path, method):
    path, model = tmp_path / "m", model_of(method)
    artifact.save_model(path, model, {**CONFIG, "method": method})
    loaded, config = artifact.load_model(path, method=method, robot_hash="abc")
    x = np.random.default_rng(0).normal(size=(7, 21))
    q = np.random.default_rng(1).uniform(-1, 1, size=(7, 3))
    assert np.array_equal(artifact.encode_x(model, x), artifact.encode_x(loaded, x))
    assert np.array_equal(artifact.encode_q(model, q), artifact.encode_q(loaded, q))
    z = artifact.encode_x(loaded, x)
    assert np.array_equal(artifact.decode_q(model, z), artifact.decode_q(loaded, z))
    assert {k: config[k] for k in CONFIG} == CONFIG
    assert config["sizes"] == {"dim_q": 3, "dim_x": 21, "latent": 5, "hidden": 8, "layers": 3}
    assert not loaded.training
    assert not any(p.requires_grad for p in loaded.parameters())


def test_identical_weights_are_identical_bytes_and_nothing_is_left_beside(tmp_path):
    for name in ("a", "b"):
        config = {**CONFIG, "method": "s3le"}
        config = config if name == "a" else dict(reversed(config.items()))
        artifact.save_model(tmp_path / name, model_of("s3le"), config)
    artifact.save_model(tmp_path / "c", model_of("s3le", seed=1), {**CONFIG, "method": "s3le"})
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b
    assert a != c
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b", "c"]


def test_a_failed_save_leaves_the_old_file(stored):
    before = stored.read_bytes()
    with pytest.raises(ModelError, match="config does not fit JSON"):
        artifact.save_model(stored, model_of("s3le", 1), {"method": "s3le", "f": object()})
    with pytest.raises(ModelError, match="config does not fit JSON"):
        artifact.save_model(stored, model_of("s3le", 1), {"method": "s3le", "f": float("nan")})
    assert stored.read_bytes() == before


def test_latents_are_float32_whatever_the_batch_and_the_input_type():
    model = model_of("s3le")
    x = np.random.default_rng(0).normal(size=(artifact.ROWS + 3, 21))
    z = artifact.encode_x(model, x)
    assert z.dtype == np.float32
    assert z.shape == (len(x), 5)
    assert np.allclose(z[-5:], artifact.encode_x(model, x[-5:]), atol=1e-6)
    frozen = x[:4].astype(np.float32)
    frozen.setflags(write=False)
    assert np.allclose(artifact.encode_x(model, frozen), z[:4], atol=1e-6)
    assert artifact.encode_x(model, np.empty((0, 21))).shape == (0, 5)
    assert artifact.decode_x(model, z[:2]).shape == (2, 21)


@pytest.mark.parametrize("shape", [(21,), (2, 20), (1, 2, 21)], ids=str)
def test_rows_of_another_width_are_refused(shape):
    with pytest.raises(ModelError, match=r"the model takes rows of shape \(n, 21\)"):
        artifact.encode_x(model_of("s3le"), np.zeros(shape))


def test_a_missing_file_names_the_next_command(tmp_path):
    with pytest.raises(ModelError, match="is missing; write it with: dvc repro train"):
        artifact.load_model(tmp_path / "none")


@pytest.mark.parametrize("keep", [0, 5, 100, 0.5, 0.999], ids=str)
def test_a_truncated_file_is_refused_in_one_line(stored, keep):
    raw = stored.read_bytes()
    stored.write_bytes(raw[: keep if keep >= 5 or keep == 0 else int(len(raw) * keep)])
    with pytest.raises(ModelError, match="cannot be read") as caught:
        artifact.load_model(stored)
    assert "\n" not in str(caught.value)


def with_note(path, note):
    """Rewrite a stored file's header note."""
    raw = path.read_bytes()
    size = struct.unpack("<Q", raw[:8])[0]
    header = json.loads(raw[8 : 8 + size])
    header["__metadata__"] = note
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + raw[8 + size :])


@pytest.mark.parametrize("note", [{}, {"note": "{"}, {"note": "[1]"}, {"note": "{}"}], ids=str)
def test_a_foreign_header_is_refused(stored, note):
    with_note(stored, note)
    with pytest.raises(ModelError, match="train again"):
        artifact.load_model(stored)


def test_no_flipped_bit_of_a_model_goes_unseen(stored):
    raw = stored.read_bytes()
    size = struct.unpack("<Q", raw[:8])[0]
    where = [8 + size + 64 * k for k in range((len(raw) - 8 - size) // 64)]  # of the weights
    where += [raw.index(b"tau") + 8, raw.index(b"abc")]  # and of the configuration
    for at in where:
        damaged = bytearray(raw)
        damaged[at] ^= 1
        stored.write_bytes(damaged)
        with pytest.raises(ModelError, match="its checksum differs|cannot be read"):
            artifact.load_model(stored)


def test_weights_that_do_not_fit_the_sizes_are_refused(stored):
    weights, config = artifact.read_tensors(stored)
    for change in ({"latent": 6}, {"latent": -1}, {"hidden": 10**6}, {"layers": 10**9}, {"a": 1}):
        sizes = {**config["sizes"], **change}
        artifact.write_tensors(stored, weights, {**config, "sizes": sizes})
        with pytest.raises(ModelError, match="weights do not fit"):
            artifact.load_model(stored)
    artifact.write_tensors(stored, weights, {**config, "method": "ale"})
    with pytest.raises(ModelError, match="weights do not fit"):
        artifact.load_model(stored)


def test_another_method_robot_or_format_is_refused(stored):
    with pytest.raises(ModelError, match="has method 's3le', 'ale' is wanted; train again"):
        artifact.load_model(stored, method="ale")
    with pytest.raises(ModelError, match="has robot_hash 'abc', 'xyz' is wanted; train again"):
        artifact.load_model(stored, robot_hash="xyz")
    weights, config = artifact.read_tensors(stored)
    artifact.write_tensors(stored, weights, {**config, "format": 99})
    with pytest.raises(ModelError, match="has format 99, this code reads 1; train again"):
        artifact.load_model(stored)


def test_weights_that_are_not_finite_are_neither_stored_nor_loaded(tmp_path, stored):
    model = model_of("s3le")
    with torch.no_grad():
        model.encoder_x[0].weight[0, 0] = float("nan")
    with pytest.raises(ModelError, match="weight encoder_x.0.weight is not finite"):
        artifact.save_model(tmp_path / "bad", model, {**CONFIG, "method": "s3le"})
    _, config = artifact.read_tensors(stored)
    artifact.write_tensors(stored, model.state_dict(), config)
    with pytest.raises(ModelError, match="weight encoder_x.0.weight is not finite"):
        artifact.load_model(stored)


@pytest.mark.parametrize("method", [None, "vae", "ale"])
def test_a_config_whose_method_does_not_fit_is_refused(tmp_path, method):
    with pytest.raises(ModelError, match="method"):
        artifact.save_model(tmp_path / "m", model_of("s3le"), {"method": method})
    assert not list(tmp_path.iterdir())
