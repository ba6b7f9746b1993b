"""The networks: encoders, decoders, discriminators and the two models built from them.

X is the space of skeletons x (R^21), Y the robot's joint angles q [rad], Z the shared latent
space. Q^X, Q^Y are `encoder_x`, `encoder_y`; P^X, P^Y are `decoder_x`, `decoder_y`; D is
`discriminator_x`, `discriminator_y` (paper, Sec. III). Both models offer the same four maps
`encode_x`, `encode_q`, `decode_x`, `decode_q`. Joint angles go in and come out in rad; the
model itself scales them by the robot's joint range. Losses live elsewhere.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from s3le.errors import ModelError

# Of the first layer's weights, unless said otherwise: small ones leave tanh linear, FK is learnt
# late.
FIRST_GAIN = 3.0

METHODS = ("s3le", "lwl2", "ale")  # the paper's method and its two baselines (Sec. V-B)


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes of one model; the paper gives 21 inputs and three hidden layers of 512 units."""

    dim_q: int  # joints of the robot, N_DoF
    dim_x: int = 21  # skeleton feature
    latent: int = 14  # dimension of Z; the paper does not say
    hidden: int = 512  # units per hidden layer
    layers: int = 3  # hidden layers

    def __post_init__(self) -> None:
        """Refuse sizes that no network can have."""
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ModelError(f"model size {name} must be a whole number >= 1, got {value!r}")


def mlp(
    n_in: int,
    n_out: int,
    hidden: int,
    layers: int,
    generator: torch.Generator,
    first_gain: float = FIRST_GAIN,
) -> nn.Module:
    """Fully connected net: `layers` hidden layers of `hidden` tanh units, then a linear one.

    Weights start Xavier-uniform (the first layer's `first_gain` times as wide), biases at zero,
    drawn from the given generator alone.
    Source: Sec. V-B (three hidden layers of 512 units, tanh).
    """
    widths = [n_in] + [hidden] * layers + [n_out]
    net = nn.Sequential()
    for i, (fan_in, fan_out) in enumerate(zip(widths[:-1], widths[1:], strict=True)):
        linear = nn.utils.skip_init(nn.Linear, fan_in, fan_out)  # leaves the global RNG alone
        gain = first_gain if i == 0 else 1.0
        nn.init.xavier_uniform_(linear.weight, gain, generator=generator)
        nn.init.zeros_(linear.bias)
        net.append(linear)
        if i < layers:
            net.append(nn.Tanh())
    return net


class JointRange(nn.Module):
    """Joint angles [rad] to and from units of the robot's range: lower -> -1, upper -> +1."""

    def __init__(self, lower: Tensor, upper: Tensor) -> None:
        """Store centre and half-width as buffers, so that they travel with the weights.

        Args:
            lower, upper: joint limits [rad], shape (n_dof,).

        Raises:
            ModelError: the shapes differ, or some lower is not below its upper.
        """
        super().__init__()
        lower, upper = torch.as_tensor(lower).double(), torch.as_tensor(upper).double()
        if lower.ndim != 1 or lower.shape != upper.shape:
            raise ModelError(
                f"joint limits must share one shape (n_dof,), got {tuple(lower.shape)} "
                f"and {tuple(upper.shape)}"
            )
        for i in range(len(lower)):
            if not lower[i] < upper[i]:  # also catches NaN
                raise ModelError(
                    f"joint {i}: lower limit {lower[i]:g} rad is not below upper {upper[i]:g} rad"
                )
        self.register_buffer("centre", ((lower + upper) / 2).float())
        self.register_buffer("half_width", ((upper - lower) / 2).float())

    def to_unit(self, q: Tensor) -> Tensor:
        """Angles q [rad] (n, n_dof) to units of the range."""
        return (q - self.centre) / self.half_width

    def to_rad(self, unit: Tensor) -> Tensor:
        """Units of the range (n, n_dof) to angles [rad]."""
        return unit * self.half_width + self.centre


class SharedLatent(nn.Module):
    """Two Wasserstein autoencoders over one latent space: S3LE and LWL2 (Sec. III)."""

    def __init__(
        self,
        sizes: Sizes,
        lower: Tensor,
        upper: Tensor,
        generator: torch.Generator | None = None,
        first_gain: float = FIRST_GAIN,
    ) -> None:
        """Build the six networks; their first weights are drawn from `generator` (seed 0)."""
        super().__init__()
        g = generator or torch.Generator().manual_seed(0)
        self.sizes = sizes
        shape = (sizes.hidden, sizes.layers, g, first_gain)
        self.joints = JointRange(lower, upper)
        self.encoder_x = mlp(sizes.dim_x, sizes.latent, *shape)
        self.decoder_x = mlp(sizes.latent, sizes.dim_x, *shape)
        self.encoder_y = mlp(sizes.dim_q, sizes.latent, *shape)
        self.decoder_y = mlp(sizes.latent, sizes.dim_q, *shape)
        self.discriminator_x = mlp(sizes.latent, 1, *shape)
        self.discriminator_y = mlp(sizes.latent, 1, *shape)

    def encode_x(self, x: Tensor) -> Tensor:
        """Q^X: skeletons (n, dim_x) to latents (n, latent)."""
        return self.encoder_x(x)

    def encode_q(self, q: Tensor) -> Tensor:
        """Q^Y: joint angles [rad] (n, dim_q) to latents (n, latent)."""
        return self.encoder_y(self.joints.to_unit(q))

    def decode_x(self, z: Tensor) -> Tensor:
        """P^X: latents (n, latent) to skeletons (n, dim_x)."""
        return self.decoder_x(z)

    def decode_q(self, z: Tensor) -> Tensor:
        """P^Y: latents (n, latent) to joint angles [rad] (n, dim_q), not kept within limits."""
        return self.joints.to_rad(self.decoder_y(z))


class AleModel(nn.Module):
    """Associate latent encoding: two variational autoencoders over one latent space.

    Encoders give mean and log-variance of a diagonal Gaussian; a latent is the mean. The answer
    to a skeleton is `answer(x)`, the decoded mean, with no promise about limits or collisions.
    Source: Sec. V-B (ALE, Yin et al. 2017).
    """

    def __init__(
        self,
        sizes: Sizes,
        lower: Tensor,
        upper: Tensor,
        generator: torch.Generator | None = None,
        first_gain: float = FIRST_GAIN,
    ) -> None:
        """Build the four networks; their first weights are drawn from `generator` (seed 0)."""
        super().__init__()
        g = generator or torch.Generator().manual_seed(0)
        self.sizes = sizes
        shape = (sizes.hidden, sizes.layers, g, first_gain)
        self.joints = JointRange(lower, upper)
        self.encoder_x = mlp(sizes.dim_x, 2 * sizes.latent, *shape)
        self.decoder_x = mlp(sizes.latent, sizes.dim_x, *shape)
        self.encoder_y = mlp(sizes.dim_q, 2 * sizes.latent, *shape)
        self.decoder_y = mlp(sizes.latent, sizes.dim_q, *shape)

    def gaussian_x(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance, each (n, latent), of Q^X(z | x)."""
        mean, logvar = self.encoder_x(x).chunk(2, dim=1)
        return mean, logvar

    def gaussian_q(self, q: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-variance, each (n, latent), of Q^Y(z | q), q in rad."""
        mean, logvar = self.encoder_y(self.joints.to_unit(q)).chunk(2, dim=1)
        return mean, logvar

    def encode_x(self, x: Tensor) -> Tensor:
        """Mean latents (n, latent) of skeletons (n, dim_x)."""
        return self.gaussian_x(x)[0]

    def encode_q(self, q: Tensor) -> Tensor:
        """Mean latents (n, latent) of joint angles [rad] (n, dim_q)."""
        return self.gaussian_q(q)[0]

    def decode_x(self, z: Tensor) -> Tensor:
        """P^X: latents (n, latent) to skeletons (n, dim_x)."""
        return self.decoder_x(z)

    def decode_q(self, z: Tensor) -> Tensor:
        """P^Y: latents (n, latent) to joint angles [rad] (n, dim_q), not kept within limits."""
        return self.joints.to_rad(self.decoder_y(z))

    def answer(self, x: Tensor) -> Tensor:
        """ALE's answer to skeletons (n, dim_x): decode_q(encode_x(x)) [rad], (n, dim_q)."""
        return self.decode_q(self.encode_x(x))


def build(
    method: str,
    sizes: Sizes,
    lower: Tensor,
    upper: Tensor,
    generator: torch.Generator | None = None,
    first_gain: float = FIRST_GAIN,
) -> SharedLatent | AleModel:
    """The untrained model of one method.

    Args:
        method: one of METHODS.
        sizes: sizes of the networks.
        lower, upper: joint limits [rad], shape (dim_q,).
        generator: source of the first weights (CPU); None: a fresh one with seed 0.
        first_gain: of the first layers' weights; see mlp.

    Raises:
        ModelError: unknown method, or limits that do not fit dim_q or are not ordered.
    """
    if method not in METHODS:
        raise ModelError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if len(lower) != sizes.dim_q:
        raise ModelError(f"dim_q is {sizes.dim_q}, but {len(lower)} joint limits were given")
    kind = AleModel if method == "ale" else SharedLatent
    return kind(sizes, lower, upper, generator, first_gain)
