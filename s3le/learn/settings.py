"""What can be chosen about a training: each setting once, with its sentence, range and users.

params.yaml gives its value, pipeline/train.py makes parameters of it.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any

from s3le.errors import ParameterError
from s3le.learn.batches import PRIORS

TRAIN = "train"  # section of params.yaml that all methods share
ALL = ("s3le", "lwl2", "ale")
WASSERSTEIN = ("s3le", "lwl2")

_ABOVE = 1e-9  # what "above 0" means for a parameter
_MOST = math.inf


def _setting(
    default: Any,
    doc: str,
    *,
    least: float = 0.0,
    most: float = _MOST,
    one_of: tuple[str, ...] = (),
    of: tuple[str, ...] = (TRAIN,),
    top: bool = False,
) -> Any:
    """A setting.

    Args:
        default: of Training; params.yaml has its own.
        doc: what it is.
        least, most: range of a number, both ends allowed.
        one_of: words that are allowed.
        of: sections of params.yaml that hold it: TRAIN, or those of methods.
        top: it is a symbol of the paper and stands at the top of params.yaml.
    """
    about = {"doc": doc, "range": (least, most), "one_of": one_of, "of": of, "top": top}
    return field(default=default, metadata=about)


@dataclass(frozen=True, kw_only=True)
class Training:
    """Hyper-parameters of one training; the paper's values are named where it gives any."""

    beta: float = _setting(1.0, "weight of latent prior fitting [-] (paper)", top=True)
    tau: float = _setting(
        1.0, "temperature of NT-Xent [-] (paper)", least=1e-6, of=("s3le",), top=True
    )

    seed: int = _setting(0, "root of the trainings' own random streams")
    latent: int = _setting(32, "dimension of Z (paper: silent)", least=1, most=4096)
    hidden: int = _setting(512, "units of a hidden layer (paper)", least=1, most=8192)
    layers: int = _setting(3, "hidden layers (paper)", least=1, most=16)
    first_gain: float = _setting(
        3.0, "of the first layers' weights (paper: silent)", least=1e-3, most=100
    )
    learning_rate: float = _setting(
        3e-3, "of encoders and decoders (paper: 1e-3)", least=_ABOVE, most=1
    )
    second_moment: float = _setting(
        0.95, "decay of Adam's squared gradients; 0.999 learns half as fast", least=0.5, most=0.9999
    )
    schedule: str = _setting(
        "cosine", "of both learning rates after the warm-up", one_of=("constant", "cosine")
    )
    warm_up: int = _setting(100, "steps of linear rise, either schedule")
    weight_decay: float = _setting(0.0, "decoupled", most=1)
    precision: str = _setting(
        "bf16", "of matrix products; weights stay float32", one_of=("float32", "bf16")
    )
    history_every: int = _setting(50, "steps averaged into one point of a curve", least=1)

    steps: int = _setting(6000, "optimiser steps", least=1, of=ALL)
    batch: int = _setting(128, "kinematic tuples a step; 0: none", of=("s3le",))
    batch_pairs: int = _setting(32, "mocap tuples a step; 0: none", of=ALL)
    batch_domain: int = _setting(64, "rows a step of each domain's own data", least=1, of=ALL)
    weight_recon_x: float = _setting(50.0, "weight of c in X; the paper leaves it open", of=ALL)
    weight_recon_q: float = _setting(
        0.3, "weight of c in Y: q keeps what x cannot see, so it must not dominate", of=ALL
    )
    consensus_kind: str = _setting(
        "normalised",
        "form of the consensus: the authors' code, or eq. (lc_loss)",
        one_of=("plain", "normalised"),
        of=ALL,
    )
    weight_consensus: float = _setting(3.0, "weight of the latent consensus", of=ALL)
    weight_nt_xent: float = _setting(50.0, "weight of NT-Xent", of=("s3le",))

    prior: str = _setting("ball", "latent prior", one_of=PRIORS, of=WASSERSTEIN)
    prior_fit: str = _setting(
        "adversarial",
        "how the prior is fitted; adversarial in the paper",
        one_of=("adversarial", "mmd", "none"),
        of=WASSERSTEIN,
    )
    prior_rows: str = _setting(
        "tuples", "latents held to it", one_of=("all", "tuples", "domain"), of=WASSERSTEIN
    )
    adversary_rate: float = _setting(
        2e-4, "learning rate of the discriminators", least=_ABOVE, most=1, of=WASSERSTEIN
    )
    reconstruct: str = _setting(
        "itself", "what x~ decodes to (paper: itself)", one_of=("itself", "feasible"),
        of=WASSERSTEIN,
    )  # fmt: skip
    mixup: bool = _setting(True, "use x' among the consensus and NT-Xent pairs", of=WASSERSTEIN)
    weight_x_to_q: float = _setting(
        0.0, "weight of decoding x~ to q-bar; not in the paper", of=WASSERSTEIN
    )
    weight_q_to_x: float = _setting(
        0.0, "weight of decoding q-bar to x-bar; not in the paper", of=WASSERSTEIN
    )

    # No parameters, for they say how and not what; the count of threads fixes the bits.
    threads: int = 0  # CPU threads; 0: as torch finds them
    checkpoint_every: int = 500  # steps; 0: never

    def __post_init__(self) -> None:
        """Refuse values outside their range.

        Raises:
            ParameterError: names the first wrong field, its value and what is wanted.
        """
        for each in fields(self):
            name, value = each.name, getattr(self, each.name)
            if words := each.metadata.get("one_of"):
                if value not in words:
                    raise ParameterError(f"{name} must be one of {', '.join(words)}, got {value!r}")
            elif each.type is bool:
                if not isinstance(value, bool):
                    raise ParameterError(f"{name} must be true or false, got {value!r}")
            else:
                least, most = each.metadata.get("range", (0, math.inf))
                kinds = (int,) if each.type is int else (int, float)
                ok = isinstance(value, kinds) and not isinstance(value, bool)
                if not (ok and math.isfinite(value) and least <= value <= most):
                    kind = "int" if each.type is int else "float"
                    span = f"at least {least:g}" + (f", at most {most:g}" if most < _MOST else "")
                    raise ParameterError(f"{name} must be a finite {kind} {span}, got {value!r}")
