"""The DAG as dvc.yaml has it: which stages read a key, and what reruns when they do."""

from pathlib import Path

from dvc.repo import Repo

ROOT = Path(__file__).parents[1]


def readers_and_reruns(root: Path, file: str = "dvc.yaml") -> dict[str, tuple[set[str], set[str]]]:
    """For every key that some stage of a file declares: (stages that read it, stages that rerun).

    A section counts as a key: a stage that declares `sample` reads all of it.
    """
    with Repo(str(root)) as repo:
        reads: dict[str, set[str]] = {}
        after: dict[str, set[str]] = {}
        for stage in repo.index.stages:
            if stage.path_in_repo != file:
                continue
            after[stage.name] = {later.name for later in repo.index.graph.predecessors(stage)}
            for dep in stage.params:
                for key in dep.params:
                    reads.setdefault(key, set()).add(stage.name)
    return {key: (stages, closed(stages, after)) for key, stages in reads.items()}


def closed(stages: set[str], after: dict[str, set[str]]) -> set[str]:
    """Stages and all that follow them."""
    seen, todo = set(), list(stages)
    while todo:
        stage = todo.pop()
        if stage not in seen:
            seen.add(stage)
            todo += after[stage]
    return seen
