"""Trained weights on disk, and a trained model as a function of arrays.

One safetensors file holds the weights and, in its header, the configuration as JSON: nothing
to unpickle, nothing to lose beside it. Identical weights and configuration give identical bytes.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from s3le.errors import ModelError
from s3le.learn.models import METHODS, AleModel, SharedLatent, Sizes, build
from s3le.store.atomic import replace

Model = SharedLatent | AleModel
FORMAT = 1  # raised when a stored model can no longer be read by newer code
ROWS = 8192  # rows per forward pass: bounds memory, costs no speed
SUM = "sha256"  # key of a note that holds the checksum of the rest of the file


def write_tensors(path: Path, tensors: Mapping[str, torch.Tensor], note: dict[str, Any]) -> None:
    """Write tensors and a JSON note as one file; readers see the old file or the whole new one.

    Args:
        path: file to write; its folder is made if need be.
        tensors: name -> tensor, on any device.
        note: what JSON can hold; stored with sorted keys.
    """
    still = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    note = json.loads(json.dumps(note, allow_nan=False))  # as it will be read
    text = json.dumps(note | {SUM: _sum(still, note)}, sort_keys=True)
    data = save(still, metadata={"note": text})  # one key: header order is fixed
    replace(path, lambda part: part.write_bytes(data))


def read_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Read what `write_tensors` wrote: tensors on the CPU, and the note.

    Raises:
        ModelError: the file is missing, truncated, of another kind, or not as it was written.
    """
    path = Path(path)
    if not path.is_file():
        raise ModelError(f"{path} is missing; write it with: dvc repro train")
    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            note = json.loads((file.metadata() or {})["note"])
            if not isinstance(note, dict):
                raise ValueError("its note is no mapping")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        intact = note.pop(SUM, None) == _sum(tensors, note)
    except (SafetensorError, OSError, KeyError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ModelError(f"{path} cannot be read ({reason}); train again") from None
    if not intact:
        raise ModelError(f"{path} is not what was written (its checksum differs); train again")
    return tensors, note


def _sum(tensors: Mapping[str, torch.Tensor], note: Mapping[str, Any]) -> str:
    """Checksum of a note and of every tensor with its name, type and shape."""
    digest = hashlib.sha256(json.dumps(note, sort_keys=True).encode())
    for name, value in sorted(tensors.items()):
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy())
    return digest.hexdigest()


def save_model(path: Path, model: SharedLatent | AleModel, config: Mapping[str, Any]) -> None:
    """Store a trained model with its configuration.

    Args:
        path: file to write, in an existing folder.
        model: the model; its sizes are stored with it.
        config: must hold `method`; usually also `robot` (name), `robot_hash`, `joints` (names)
            and `training` (hyper-parameters). Values must fit JSON.

    Raises:
        ModelError: config has no known method, names a method of another kind of model, or
            does not fit JSON; or the weights are not finite.
    """
    method = config.get("method")
    if method not in METHODS:
        raise ModelError(f"{path}: method must be one of {', '.join(METHODS)}, got {method!r}")
    if (method == "ale") != isinstance(model, AleModel):
        raise ModelError(f"{path}: method {method!r} does not fit a {type(model).__name__}")
    weights = model.state_dict()
    for name, value in weights.items():
        if not torch.isfinite(value).all():
            raise ModelError(f"{path}: weight {name} is not finite; train again")
    note = {**config, "sizes": asdict(model.sizes), "format": FORMAT}
    try:
        write_tensors(path, weights, note)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{path}: config does not fit JSON ({error})") from None


def load_model(
    path: Path,
    *,
    method: str | None = None,
    robot_hash: str | None = None,
    device: str | torch.device = "cpu",
) -> tuple[SharedLatent | AleModel, dict[str, Any]]:
    """Load a model, ready to answer (eval mode, no gradients), and its configuration.

    Args:
        path: file written by `save_model`.
        method: refuse any other method than this; None accepts all.
        robot_hash: refuse a model of any other robot than this; None accepts all.
        device: where the weights go.

    Returns:
        Pair (model, config), config as given to `save_model` plus `sizes` and `format`.

    Raises:
        ModelError: missing, truncated or foreign file, another method or robot, weights that
            do not fit the stored sizes or are not finite.
    """
    weights, config = read_tensors(path)
    if config.get("format") != FORMAT:
        raise ModelError(
            f"{path} has format {config.get('format')!r}, this code reads {FORMAT}; train again"
        )
    for name, wanted in (("method", method), ("robot_hash", robot_hash)):
        if wanted is not None and config.get(name) != wanted:
            raise ModelError(
                f"{path} has {name} {config.get(name)!r}, {wanted!r} is wanted; train again"
            )
    try:
        sizes = Sizes(**config["sizes"])
        _refuse_other_sizes(sizes, weights)
        ones = torch.ones(sizes.dim_q)
        model = build(config["method"], sizes, -ones, ones)  # true range: among the weights
        model.load_state_dict(weights)
    except (LookupError, TypeError, ValueError, RuntimeError, ModelError) as error:
        reason = str(error).splitlines()[0]
        raise ModelError(f"{path}: weights do not fit ({reason}); train again") from None
    for name, value in weights.items():
        if not torch.isfinite(value).all():
            raise ModelError(f"{path}: weight {name} is not finite; train again")
    return model.requires_grad_(False).eval().to(device), config


def _refuse_other_sizes(sizes: Sizes, weights: Mapping[str, torch.Tensor]) -> None:
    """Refuse sizes that are not those of the weights, before anything is built of such sizes."""
    layers = sum(name.startswith("encoder_x.") and name.endswith(".weight") for name in weights)
    hidden, dim_x = weights["encoder_x.0.weight"].shape
    dim_q, latent = len(weights["joints.centre"]), weights["decoder_x.0.weight"].shape[1]
    seen = {"dim_q": dim_q, "dim_x": dim_x, "latent": latent, "hidden": hidden}
    for name, value in (seen | {"layers": layers - 1}).items():
        if getattr(sizes, name) != value:
            raise ValueError(f"{name} is {getattr(sizes, name)}, the weights have {value}")


def encode_x(model: SharedLatent | AleModel, x: np.ndarray) -> np.ndarray:
    """Latents of skeletons: Q^X (mean of it for ALE).

    Args:
        model: a trained model, on any device.
        x: skeleton features, shape (n, 21).

    Returns:
        Latents, float32, shape (n, latent).

    Raises:
        ModelError: x has another width.
    """
    return _apply(model.encode_x, model, x, model.sizes.dim_x)


def encode_q(model: SharedLatent | AleModel, q: np.ndarray) -> np.ndarray:
    """Latents of joint angles [rad], shape (n, n_dof): Q^Y. Otherwise as `encode_x`."""
    return _apply(model.encode_q, model, q, model.sizes.dim_q)


def decode_x(model: SharedLatent | AleModel, z: np.ndarray) -> np.ndarray:
    """Skeletons of latents, shape (n, latent): P^X, float32 (n, 21), not normalised."""
    return _apply(model.decode_x, model, z, model.sizes.latent)


def decode_q(model: SharedLatent | AleModel, z: np.ndarray) -> np.ndarray:
    """Joint angles [rad] of latents, shape (n, latent): P^Y, float32 (n, n_dof).

    Nothing keeps them within limits or free of collisions.
    """
    return _apply(model.decode_q, model, z, model.sizes.latent)


def _apply(
    function: Callable, model: SharedLatent | AleModel, rows: np.ndarray, width: int
) -> np.ndarray:
    rows = np.asarray(rows)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ModelError(f"the model takes rows of shape (n, {width}), got {rows.shape}")
    device = next(model.parameters()).device
    with torch.inference_mode():
        parts = [
            function(torch.from_numpy(np.array(rows[i : i + ROWS], np.float32)).to(device))
            for i in range(0, max(len(rows), 1), ROWS)
        ]
        return torch.cat(parts).cpu().numpy()
