"""Options of the tests."""


def pytest_addoption(parser):
    parser.addoption(
        "--mutants",
        type=int,
        default=300,
        help="broken files that are sent through each reader, e.g. 10000",
    )
