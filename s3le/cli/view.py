"""`s3le view`."""


def view() -> None:
    """Later."""
