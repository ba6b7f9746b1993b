"""Options of the tests, and what many of them share."""

import os
import shutil

import pytest

from s3le.tuples.engine import lock


def pytest_addoption(parser):
    parser.addoption(
        "--mutants",
        type=int,
        default=100,
        help="broken files that are sent through each reader, e.g. 10000",
    )


# Long files begin before short ones, so that no worker is left with one at the end; while the
# first of these makes the tiny run and compiles for it, the next ones need neither. Each worker
# has two files from the beginning: the first and the third go to one.
BEGIN_WITH = (
    "test_disasters",
    "test_training",
    "test_retarget_many",
    "test_engine",
    "test_pipeline",
    "test_guard_command",
    "test_wheel",
    "test_mutants",
    "test_report",
    "test_front_door",
)


def pytest_collection_modifyitems(items):
    """The order of files for several workers (with xdist's own order switched off)."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    order = {name: place for place, name in enumerate(BEGIN_WITH)}
    items.sort(key=lambda item: order.get(item.path.stem, len(order)))


@pytest.fixture(scope="session")
def project(tmp_path_factory):
    """A copy of the project after one whole tiny run, committed; leave it as it is.

    The run is made once, whatever the number of pytest's workers; each has a copy of its own.
    """
    import tiny  # of the slow tests alone

    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent  # each worker's own folder lies in it
    first, whole = shared / "first-run", shared / "first-run-is-whole"
    with lock.held(shared / "first-run.lock", "the tiny project", patience=900.0):
        if not first.exists():
            first.mkdir()
            tiny.make(first)
            whole.touch()
    assert whole.exists(), "the tiny run failed in another worker, which says why"
    folder = tmp_path_factory.mktemp("project")
    shutil.copytree(first, folder, symlinks=True, dirs_exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def kept(project, tmp_path_factory):
    """What a run changes in the project, as its first run left it."""
    import tiny

    folder = tmp_path_factory.mktemp("kept")
    tiny.put(project, folder)
    return folder


@pytest.fixture
def here(project, kept):
    """The project, which is as it was when the test is over."""
    import tiny

    yield project
    tiny.put(kept, project)
