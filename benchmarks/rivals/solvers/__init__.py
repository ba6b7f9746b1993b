"""One module an entrant: `about` says which versions run, `make` gives what solves a frame."""

from importlib.metadata import PackageNotFoundError, version


def versions(*names: str) -> dict[str, str]:
    """Versions of packages that are installed here."""
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional part
            continue
    return found
