"""Networks: shapes, determinism, and joint angles scaled by the robot's range."""

import numpy as np
import pytest
import torch

from s3le.errors import ModelError
from s3le.learn.models import AleModel, JointRange, SharedLatent, Sizes, build, mlp

LOWER, UPPER = torch.tensor([-1.0, 0.0, -3.0]), torch.tensor([1.0, 0.5, 2.0])
SMALL = Sizes(dim_q=3, latent=5, hidden=8)


def test_mlp_is_three_hidden_tanh_layers_and_a_linear_one():
    net = mlp(21, 14, 512, 3, torch.Generator().manual_seed(0))
    kinds = [type(layer).__name__ for layer in net]
    assert kinds == ["Linear", "Tanh"] * 3 + ["Linear"]
    widths = [(layer.in_features, layer.out_features) for layer in net[::2]]
    assert widths == [(21, 512), (512, 512), (512, 512), (512, 14)]


def test_mlp_equals_matrices_by_hand():
    net = mlp(4, 2, 6, 2, torch.Generator().manual_seed(1))
    rows = np.random.default_rng(0).normal(size=(5, 4)).astype(np.float32)
    hand = rows
    for i, layer in enumerate(net[::2]):
        hand = hand @ layer.weight.detach().numpy().T + layer.bias.detach().numpy()
        hand = np.tanh(hand) if i < 2 else hand
    assert np.allclose(net(torch.from_numpy(rows)).detach(), hand, atol=1e-6)


def test_the_first_layers_gain_widens_the_first_layer_alone():
    plain, wide = (
        mlp(6, 3, 8, 2, torch.Generator().manual_seed(2), first_gain=gain) for gain in (1.0, 2.5)
    )
    for k in (0, 2, 4):
        ratio = 2.5 if k == 0 else 1.0
        torch.testing.assert_close(wide[k].weight, ratio * plain[k].weight)
    model = build("ale", SMALL, LOWER, UPPER, torch.Generator().manual_seed(2), 1.0)
    other = build("ale", SMALL, LOWER, UPPER, torch.Generator().manual_seed(2))
    torch.testing.assert_close(other.encoder_y[0].weight, 3.0 * model.encoder_y[0].weight)


def test_first_weights_come_from_the_generator_alone():
    torch.manual_seed(5)
    before = torch.get_rng_state()
    a = build("s3le", SMALL, LOWER, UPPER, torch.Generator().manual_seed(3)).state_dict()
    torch.manual_seed(6)
    b = build("s3le", SMALL, LOWER, UPPER, torch.Generator().manual_seed(3)).state_dict()
    other = build("s3le", SMALL, LOWER, UPPER, torch.Generator().manual_seed(4)).state_dict()
    assert all(torch.equal(a[k], b[k]) for k in a)
    assert not torch.equal(a["encoder_x.0.weight"], other["encoder_x.0.weight"])
    torch.manual_seed(5)
    build("ale", SMALL, LOWER, UPPER)
    assert torch.equal(before, torch.get_rng_state())


def test_joint_range_maps_limits_to_minus_and_plus_one_and_back():
    joints = JointRange(LOWER, UPPER)
    ends = torch.stack((LOWER, UPPER))
    assert torch.allclose(joints.to_unit(ends), torch.tensor([[-1.0] * 3, [1.0] * 3]))
    q = torch.rand(20, 3, generator=torch.Generator().manual_seed(0)) * 4 - 2
    assert torch.allclose(joints.to_rad(joints.to_unit(q)), q, atol=1e-6)  # [rad]


@pytest.mark.parametrize(
    ("lower", "upper", "text"),
    [
        ([0.0, 1.0], [1.0, 1.0], "joint 1: lower limit 1 rad is not below upper 1 rad"),
        ([0.0, float("nan")], [1.0, 1.0], "joint 1: lower limit nan rad is not below upper 1 rad"),
        ([0.0], [1.0, 1.0], "joint limits must share one shape"),
    ],
    ids=["equal", "nan", "shape"],
)
def test_joint_range_refuses_limits_that_are_no_range(lower, upper, text):
    with pytest.raises(ModelError, match=text):
        JointRange(torch.tensor(lower), torch.tensor(upper))


@pytest.mark.parametrize("method", ["s3le", "lwl2", "ale"])
def test_every_method_maps_between_the_three_spaces(method):
    model = build(method, SMALL, LOWER, UPPER)
    x, q = torch.zeros(4, 21), torch.zeros(4, 3)
    z_x, z_q = model.encode_x(x), model.encode_q(q)
    assert z_x.shape == z_q.shape == (4, 5)
    assert model.decode_x(z_x).shape == (4, 21)
    assert model.decode_q(z_x).shape == (4, 3)
    assert isinstance(model, AleModel if method == "ale" else SharedLatent)


def test_a_model_sees_joint_angles_in_units_of_their_range():
    model = build("s3le", SMALL, LOWER, UPPER)
    wide = build("s3le", SMALL, LOWER * 10, UPPER * 10)  # same seed, same weights
    q = torch.tensor([[0.3, 0.2, -1.0]])
    assert torch.allclose(model.encode_q(q), wide.encode_q(10 * q), atol=1e-6)
    z = torch.ones(1, 5)
    assert torch.allclose(10 * model.decode_q(z), wide.decode_q(z), atol=1e-4)


def test_ale_answers_with_the_decoded_mean():
    model = build("ale", SMALL, LOWER, UPPER)
    x = torch.rand(6, 21, generator=torch.Generator().manual_seed(0))
    mean, logvar = model.gaussian_x(x)
    assert mean.shape == logvar.shape == (6, 5)
    assert torch.equal(model.answer(x), model.decode_q(mean))
    assert torch.equal(model.gaussian_q(torch.zeros(2, 3))[0], model.encode_q(torch.zeros(2, 3)))


def test_unknown_method_wrong_sizes_and_wrong_limits_are_refused():
    with pytest.raises(ModelError, match="method must be one of s3le, lwl2, ale, got 'vae'"):
        build("vae", SMALL, LOWER, UPPER)
    with pytest.raises(ModelError, match="dim_q is 3, but 2 joint limits were given"):
        build("s3le", SMALL, LOWER[:2], UPPER[:2])
    for bad in (0, -1, 1.5, True):
        with pytest.raises(ModelError, match="model size latent must be a whole number >= 1"):
            Sizes(dim_q=3, latent=bad)
