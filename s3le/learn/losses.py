"""The losses, as functions of tensors: each term of the paper's equations, nothing else.

N is the number of rows, d the latent dimension; every loss is a mean over rows and returns a
scalar tensor. Weights between the losses (beta apart, which is inside its equation) belong to
the training loop. Symbols: z_x = Q^X(x), z_y = Q^Y(y), rho the sigmoid, D a discriminator that
returns a logit.
"""

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, normalize, softplus

from s3le.errors import ParameterError

CONSENSUS_EPSILON = 0.1  # keeps the normalised consensus finite at the origin
MMD_SCALES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # widths of the mixture of MMD kernels


def reconstruction(truth: Tensor, decoded: Tensor) -> Tensor:
    """Cost c: squared error, summed over dimensions, mean over rows.

        1/N sum_i || x_i - P(Q(x_i)) ||_2^2

    Source: eq. (wae_loss), first line; the paper leaves c open, this is the squared distance.

    Args:
        truth, decoded: shape (n, dim).
    """
    return (truth - decoded).square().sum(dim=1).mean()


def prior_discriminator(logit_prior: Tensor, logit_encoded: Tensor, beta: float) -> Tensor:
    """The part of prior fitting that trains the discriminator (psi).

        -beta/2 [ log rho(D(z)) + log(1 - rho(D(Q(x)))) ],   z drawn from the prior

    Source: eq. (wae_loss), second line. Written with softplus, finite for any logit.

    Args:
        logit_prior, logit_encoded: D of prior draws and of encoded rows, any shape.
        beta: weight of the prior fitting [-].
    """
    return 0.5 * beta * (softplus(-logit_prior).mean() + softplus(logit_encoded).mean())


def prior_encoder(logit_encoded: Tensor, beta: float) -> Tensor:
    """The part of prior fitting that trains the encoder (phi).

        -beta log rho(D(Q(x)))

    Source: eq. (wae_loss), third line.

    Args:
        logit_encoded: D of encoded rows, any shape.
        beta: weight of the prior fitting [-].
    """
    return beta * softplus(-logit_encoded).mean()


def mmd(encoded: Tensor, prior: Tensor, spread: float, beta: float) -> Tensor:
    """Maximum mean discrepancy between encoded rows and prior draws, times beta.

        k(a, b) = sum_s  C_s / (C_s + ||a - b||^2),   C_s = s * spread
        MMD = mean_{i != j} k(e_i, e_j) + mean_{i != j} k(p_i, p_j) - 2 mean_{i, j} k(e_i, p_j)

    The unbiased estimator; it can be slightly negative.
    Source: Tolstikhin et al. 2018, WAE-MMD, inverse multiquadratics; not in the paper, which
    fits the prior adversarially.

    Args:
        encoded, prior: shapes (n, d) and (m, d), n and m at least 2.
        spread: mean squared distance between two prior draws.
        beta: weight of the prior fitting [-].

    Raises:
        ParameterError: fewer than two rows on a side.
    """
    n, m = len(encoded), len(prior)
    if min(n, m) < 2:
        raise ParameterError(f"mmd needs at least 2 rows on each side, got {n} and {m}")

    def kernel(a: Tensor, b: Tensor) -> Tensor:
        gap = a.square().sum(1)[:, None] + b.square().sum(1)[None] - 2.0 * (a @ b.T)
        gap = gap.clamp(min=0.0)  # (n, m), rounding can push it below zero
        return sum(s * spread / (s * spread + gap) for s in MMD_SCALES)

    own, ref = kernel(encoded, encoded), kernel(prior, prior)
    within = (own.sum() - own.diagonal().sum()) / (n * (n - 1))
    among = (ref.sum() - ref.diagonal().sum()) / (m * (m - 1))
    return beta * (within + among - 2.0 * kernel(encoded, prior).mean())


def consensus(z_x: Tensor, z_y: Tensor) -> Tensor:
    """Latent consensus, as printed.

        1/N sum_i || Q^X(x_i) - Q^Y(y_i) ||_2^2

    Source: eq. (lc_loss).

    Args:
        z_x, z_y: latents of paired rows, shape (n, d).
    """
    return (z_x - z_y).square().sum(dim=1).mean()


def consensus_normalised(z_x: Tensor, z_y: Tensor) -> Tensor:
    """Latent consensus relative to the latents' size, which a shrinking latent cannot cheat.

        1/N sum_i ( ||d_i||_1 + 5 ||d_i||_2^2 ) / ( ||z_x,i||^2 + ||z_y,i||^2 + 0.1 ),
        d_i = z_x,i - z_y,i

    Source: the authors' published code; the paper prints eq. (lc_loss) instead.

    Args:
        z_x, z_y: latents of paired rows, shape (n, d).
    """
    gap = z_x - z_y
    size = z_x.square().sum(dim=1) + z_y.square().sum(dim=1) + CONSENSUS_EPSILON
    return ((gap.abs().sum(dim=1) + 5.0 * gap.square().sum(dim=1)) / size).mean()


def nt_xent(z_a: Tensor, z_b: Tensor, tau: float) -> Tensor:
    """Normalised temperature-scaled cross entropy over N pairs of latents.

        l(i, j) = -log  exp(cos(z_i, z_j) / tau) / sum_{m != i} exp(cos(z_i, z_m) / tau)
        L = 1/(2N) sum_{k=1}^{N} l(2k-1, 2k) + l(2k, 2k-1)

    The sum over m runs over all 2N latents but i itself: the positive j is in it. Row k of
    z_a and row k of z_b are the pair (2k-1, 2k).
    Source: Sec. IV-A, NT-Xent (after Chen et al. 2020).

    Args:
        z_a, z_b: latents, shape (n, d), n at least 1; need not be normalised.
        tau: temperature [-], above 0.

    Raises:
        ParameterError: tau is not above 0.
    """
    if not tau > 0.0:
        raise ParameterError(f"tau must be above 0, got {tau!r}")
    n = len(z_a)
    unit = normalize(torch.cat((z_a, z_b)), dim=1)  # (2n, d)
    similarity = (unit @ unit.T) / tau  # (2n, 2n)
    similarity = similarity.masked_fill(
        torch.eye(2 * n, dtype=torch.bool, device=unit.device), -torch.inf
    )
    partner = torch.arange(2 * n, device=unit.device).roll(n)  # row i's positive is i +- n
    return cross_entropy(similarity, partner)  # stable: log-sum-exp inside


def kl_to_standard_normal(mean: Tensor, logvar: Tensor) -> Tensor:
    """Divergence of the encoder's Gaussian from N(0, 1), summed over d, mean over rows.

        1/N sum_i 1/2 sum_k ( mean^2 + exp(logvar) - 1 - logvar )

    Source: the prior term of a variational autoencoder; ALE (Yin et al. 2017) has two.

    Args:
        mean, logvar: shape (n, d).
    """
    return 0.5 * (mean.square() + logvar.exp() - 1.0 - logvar).sum(dim=1).mean()
