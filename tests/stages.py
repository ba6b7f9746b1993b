"""Stages of the pipeline called in this process, where dvc and a start of Python are not tested."""

import importlib
from contextlib import chdir
from pathlib import Path

import pytest
from dvc.repo import Repo

from pipeline.stage import launch


def run(stage: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What `python -m pipeline.STAGE [ITEM]` does in a folder.

    Raises:
        SystemExit: the stage refuses.
    """
    name, *item = stage.split("@")
    main = importlib.import_module(f"pipeline.{name}").main
    with monkeypatch.context() as there:
        there.chdir(folder)
        there.setattr("sys.argv", [name, *item])
        there.delenv("DVC_STAGE", raising=False)
        launch(main, name)


def stopped(stage: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd) -> str:
    """The one line in which a stage refuses."""
    capfd.readouterr()
    with pytest.raises(SystemExit) as refusal:
        run(stage, folder, monkeypatch)
    assert refusal.value.code == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    return line


def stale(folder: Path, stage: str) -> dict:
    """What dvc says has changed of a stage and all before it, by stage; empty: up to date."""
    with chdir(folder), Repo(".") as repo:  # dvc looks for a stage's name from where it is
        return repo.status([stage], with_deps=True)
