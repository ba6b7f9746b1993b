"""Options of the tests, and what many of them share."""

import pytest


def pytest_addoption(parser):
    parser.addoption(
        "--mutants",
        type=int,
        default=300,
        help="broken files that are sent through each reader, e.g. 10000",
    )


@pytest.fixture(scope="session")
def project(tmp_path_factory):
    """A copy of the project after one whole tiny run, committed; leave it as it is."""
    import tiny  # of the slow tests alone

    folder = tmp_path_factory.mktemp("project")
    tiny.make(folder)
    return folder
