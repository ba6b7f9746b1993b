"""A retargeter as a folder that stands by itself: robot, poses, weights, settings, hashes.

    retargeter.json     method, settings, the robot's tag, SHA-256 of every other file
    robot/              as Robot.write writes it
    poses.parquet       table stored_poses; none for a decoder
    neighbours          what finds them (s3le.search.neighbours); none for a decoder
    model.safetensors   weights; none where the skeleton itself is searched

To load one takes neither the data it was trained on, nor DVC, torch or a GPU.
"""

import hashlib
import shutil
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from s3le.errors import BundleError, ModelError, ParameterError, S3leError
from s3le.retarget import encoder, propose
from s3le.retarget.settings import Settings
from s3le.retarget.table import stored_poses
from s3le.robot.robot import Robot
from s3le.search import neighbours
from s3le.search.metrics import LATENT_METRICS, METRICS, to_skeletons
from s3le.skeleton import DIM
from s3le.store import documents, tables
from s3le.types import Progress

FORMAT = 1
METHODS = ("s3le", "lwl2", "ale", "skeleton")
ABOUT, ROBOT, POSES, MODEL = "retargeter.json", "robot", "poses.parquet", "model.safetensors"
NEIGHBOURS = "neighbours"


def save(
    folder: Path,
    it: Robot,
    method: str,
    metric: str,
    settings: Settings,
    index: Mapping[str, np.ndarray] | None,
    model: Path | None,
    progress: Progress | None = None,
) -> None:
    """Write a retargeter; what lay in the folder before is replaced.

    Args:
        folder: where; its parent is made if need be.
        it: the robot.
        method: one of METHODS.
        metric: distance between latents, one of index.LATENT_METRICS.
        settings: how it retargets.
        index: columns row, z, x, q, clearance, limit_margin of table index; None for ale.
        model: the method's weights; None for skeleton.
        progress: called with numbers of stored poses that have become searchable.

    Raises:
        BundleError: method, metric, index and model do not go together.
        ParameterError, ModelError, TableError: a part is unusable.
    """
    metrics = METRICS if method == "skeleton" else LATENT_METRICS
    if method not in METHODS or metric not in metrics:
        raise BundleError(
            f"cannot export {method!r} with metric {metric!r}; there are "
            f"{', '.join(METHODS)} and {', '.join(metrics)}"
        )
    if (index is None) != (method == "ale") or (model is None) != (method == "skeleton"):
        raise BundleError(
            f"a retargeter of {method} needs other pieces: see s3le/retarget/exported.py"
        )
    settings.rule(it), settings.limits(it)  # refuses
    nets = None if model is None else encoder.read(model, it.tag)
    new = Path(folder).with_name(f".{Path(folder).name}.part")
    shutil.rmtree(new, ignore_errors=True)
    it.write(new / ROBOT)
    if model is not None:
        shutil.copyfile(model, new / MODEL)
    onto = None
    if index is not None:
        table = stored_poses(it.n_dof, it.margin)
        tables.write({name: index[name] for name in table.columns}, table, new / POSES, it.tag)
        z = index["z"]
        if metric == "mahalanobis":
            onto = to_skeletons(z, index["x"])
        if after := _after(metric, nets, onto):
            z = after.rows(z)
        known = metric if metric in METRICS else "l2"
        neighbours.build(z, known, progress=progress).save(new / NEIGHBOURS)
    about = {
        "format": FORMAT,
        "method": method,
        "metric": metric,
        "onto": None if onto is None else onto.tolist(),
        "robot": it.tag,
        "settings": asdict(settings),
        "files": {name: _hash(new / name) for name in _files(new)},
    }
    documents.write_json(about, new / ABOUT)
    shutil.rmtree(folder, ignore_errors=True)
    new.rename(folder)


class Parts(NamedTuple):
    """What a retargeter is made of."""

    robot: Robot
    proposer: propose.Proposer
    settings: Settings


def load(
    folder: Path, changed: Mapping[str, object] | None = None, method: str | None = None
) -> Parts:
    """Read what `save` wrote.

    Args:
        folder: where.
        changed: settings to change, by name.
        method: refuse any other method than this; None: any.

    Raises:
        ModelError: there is no such folder, or its method is another.
        BundleError: a piece is missing, damaged, or of another retargeter.
        ParameterError: a changed setting is unknown or out of range.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ModelError(f"{folder} holds no retargeter; write one with: dvc repro export")
    try:
        about = documents.read_json(folder / ABOUT, "export")
        if about.get("format") != FORMAT:
            raise BundleError(
                f"{folder} has format {about.get('format')!r}, this code reads {FORMAT}; "
                "write it with: dvc repro export"
            )
        _whole(folder, about["files"])
        it = Robot.read(folder / ROBOT)
        if it.tag != about["robot"]:
            raise BundleError(
                f"{folder}: the robot is {it.tag!r}, the rest is for {about['robot']!r}"
            )
        if method not in (None, about["method"]):
            raise ModelError(
                f"{folder} retrieves by '{about['method']}', not '{method}'; "
                f"export another: dvc exp run -S export.method={method} export"
            )
        settings = _settings(about["settings"], changed or {})
        return Parts(it, _proposer(folder, it, about, settings), settings)
    except (BundleError, ModelError, ParameterError):
        raise
    except S3leError as error:
        raise BundleError(f"{folder} cannot be used: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BundleError(
            f"{folder / ABOUT} is incomplete ({type(error).__name__} {error}); "
            "write it with: dvc repro export"
        ) from None


def method(folder: Path) -> str:
    """By which method a retargeter that could be loaded proposes poses."""
    return str(documents.read_json(Path(folder) / ABOUT, "export")["method"])


def digest(folder: Path) -> str:
    """SHA-256 that stands for all of a retargeter that could be loaded: of what names each file's.

    Raises:
        BundleError: it cannot be read.
    """
    try:
        return _hash(Path(folder) / ABOUT)
    except OSError as error:
        raise BundleError(f"{folder}: {ABOUT} cannot be read ({error.strerror})") from None


def _proposer(folder: Path, it: Robot, about: dict, settings: Settings) -> propose.Proposer:
    method, metric, encode = about["method"], about["metric"], None
    if method not in METHODS or metric not in LATENT_METRICS:
        raise BundleError(f"{folder}: unknown method {method!r} or metric {metric!r}")
    if method != "skeleton":
        nets = encoder.read(folder / MODEL, it.tag)
        if nets.note.get("method") != method:
            raise BundleError(
                f"{folder / MODEL} is of method {nets.note.get('method')!r}, not {method!r}"
            )
        if method == "ale":
            return propose.Decoder(nets.encoder, nets.decoder_q)
        after = _after(metric, nets, about["onto"])
        encode = nets.encoder.then(after) if after else nets.encoder
    table = stored_poses(it.n_dof, it.margin)
    poses = np.ascontiguousarray(tables.read(table, folder / POSES, it.tag, ("q",))["q"])
    poses.setflags(write=False)
    index = neighbours.load(folder / NEIGHBOURS)
    width = encode.width if encode else DIM
    if index.stored.shape != (len(poses), width):
        raise BundleError(
            f"{folder / NEIGHBOURS} holds {index.stored.shape}, "
            f"{(len(poses), width)} is wanted; write it with: dvc repro export"
        )
    return propose.LookUp(poses, index, settings.k, encode)


def _after(
    metric: str, nets: encoder.Networks | None, onto: object | None
) -> encoder.Encoder | None:
    """What a latent goes through before it is compared by L2; None: nothing."""
    if metric == "mahalanobis":
        return encoder.linear(np.array(onto, float))
    if metric != "decoded":
        return None
    if nets is None:
        raise BundleError("metric 'decoded' compares what a model decodes, and there is none")
    return nets.decoder_x


def _settings(stored: Mapping, changed: Mapping) -> Settings:
    known = [field.name for field in fields(Settings)]
    for name in changed:
        if name not in known:
            raise ParameterError(f"no setting '{name}'; there are: {', '.join(known)}")
    if missing := [name for name in known if name not in stored]:
        raise KeyError(f"settings.{missing[0]}")  # a default would stand in for it unseen
    return Settings(**(dict(stored) | dict(changed)))


def _files(folder: Path) -> list[str]:
    return sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and path != folder / ABOUT
    )


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _whole(folder: Path, files: Mapping[str, str]) -> None:
    there = _files(folder)
    for name in sorted(set(there) ^ set(files)):
        what = "is missing" if name in files else "does not belong to it"
        raise BundleError(f"{folder / name} {what}; write it with: dvc repro export")
    for name, digest in files.items():
        if _hash(folder / name) != digest:
            raise BundleError(
                f"{folder / name} is not what {ABOUT} says (edited or damaged); "
                "write it with: dvc repro export"
            )
